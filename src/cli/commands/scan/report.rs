//! The results of a scan: as a table for people, as JSON, and as a configuration to start from.

use crate::cli::tools::scanning::model_text;
use crate::cli::tools::setup::table;
use crate::config::PortAddress;
use crate::daemon::scan::plan::setting_text;
use crate::daemon::scan::plan::{ScanPlan, ScanSetting};
use crate::daemon::scan::survey::{FoundDrive, ScanFindings};
use crate::domain::link::{Framing, LinkSettings};
use crate::toml_file::words::{FRAMINGS, PARITIES, word_for};
use serde_json::{Value, json};
use std::fmt::Write;

/// A scan with its results.
pub struct ScanReport<'a> {
    /// The port.
    pub port: &'a PortAddress,
    /// What was tried.
    pub plan: &'a ScanPlan,
    /// What was found.
    pub findings: &'a ScanFindings,
    /// The adapter echoes what is sent.
    pub echoes: bool,
    /// The date.
    pub date: &'a str,
}

impl ScanReport<'_> {
    fn setting(&self, finding: &FoundDrive) -> Option<&ScanSetting> {
        self.plan.settings.get(finding.setting)
    }

    /// The drives as a table, and other observations.
    pub fn table(&self) -> String {
        let row = |finding: &FoundDrive| {
            let setting = self
                .setting(finding)
                .map(|it| self.place(it))
                .unwrap_or_default();
            [
                format!("station {}", finding.station),
                setting,
                model_text(finding),
            ]
        };
        let mut text = table(self.findings.drives.iter().map(row));
        for (setting, stations) in self
            .findings
            .damaged
            .iter()
            .filter(|(_, stations)| !stations.is_empty())
        {
            let setting = self
                .plan
                .settings
                .get(*setting)
                .map(|it| self.place(it))
                .unwrap_or_default();
            let stations: Vec<_> = stations.iter().map(u8::to_string).collect();
            let _ = writeln!(
                text,
                "{setting}: something answers as station {}, but damaged: another parity or speed, two devices with one \
                 number, or a bad cable",
                stations.join(", ")
            );
        }
        if self.findings.drives.is_empty() {
            text.push_str("no drive answered\n");
        }
        text
    }

    fn place(&self, setting: &ScanSetting) -> String {
        match self.port {
            PortAddress::Device(_) => setting_text(setting),
            PortAddress::Tcp { .. } | PortAddress::ModbusTcp { .. } => {
                "as the device server is set".to_owned()
            }
        }
    }

    /// All of it for programs, with the configuration.
    pub fn json(&self) -> Value {
        let drive = |finding: &FoundDrive| {
            let fits = &finding.verdict.fits;
            let models: Vec<_> = fits.iter().map(|(model, _)| model.id.as_str()).collect();
            let why: Vec<_> = fits.iter().map(|(_, why)| why.as_str()).collect();
            let mut json = json!({
                "station": finding.station,
                "answer": if finding.by_exception { "exception" } else { "word" },
                "models": models,
                "why": why,
                "says_other": finding.verdict.other,
                "confidence": finding.verdict.keyword(),
            });
            let setting = self.setting(finding);
            json["link"] = match (setting, &self.port) {
                (Some(setting), PortAddress::Device(_)) => link_json(setting.link),
                _ => Value::Null,
            };
            json["framing"] = setting.map(|it| word_for(&FRAMINGS, &it.framing)).into();
            json
        };
        let damaged = self
            .findings
            .damaged
            .iter()
            .flat_map(|(setting, stations)| {
                let link = self
                    .plan
                    .settings
                    .get(*setting)
                    .map(|it| link_json(it.link));
                stations
                    .iter()
                    .map(move |station| json!({ "station": station, "link": link }))
            });
        json!({
            "port": self.port.to_string(),
            "complete": self.findings.is_complete,
            "drives": self.findings.drives.iter().map(drive).collect::<Vec<_>>(),
            "damaged": damaged.collect::<Vec<_>>(),
            "echo": self.echoes,
            "configuration": self.configuration(),
        })
    }

    /// A configuration with the drives whose model is known, read-only; `None` if there is none. A line has one
    /// setting: drives that answer with another one are named in comments.
    pub fn configuration(&self) -> Option<String> {
        let number = self.plan.most_answer(self.findings)?;
        let setting = self.plan.settings.get(number)?;
        let mut text = format!(
            "# Made by `vfd-gateway scan` on {}. No drive can be commanded: write the `control` \
             sections yourself.\n# `vfd-gateway check -c FILE` shows the load of the line; \
             `vfd-gateway run -c FILE` starts it.\n\n",
            self.date
        );
        if !self.findings.is_complete {
            text.push_str("# The scan was interrupted before everything was tried.\n\n");
        }
        self.line(setting, &mut text);
        for finding in self
            .findings
            .drives
            .iter()
            .filter(|it| it.setting == number)
        {
            drive(finding, &mut text);
        }
        for finding in self
            .findings
            .drives
            .iter()
            .filter(|it| it.setting != number)
        {
            let at = self.setting(finding).map(setting_text).unwrap_or_default();
            let station = finding.station;
            let model = model_text(finding);
            let _ = writeln!(
                text,
                "\n# Station {station} answers at {at} ({model}): set it to {} first.",
                setting.link
            );
        }
        text.push_str("\n[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\n");
        Some(text)
    }

    fn line(&self, setting: &ScanSetting, text: &mut String) {
        let LinkSettings {
            baud,
            data_bits,
            parity,
            stop_bits,
        } = setting.link;
        let _ = writeln!(
            text,
            "[[line]]\nname = \"line-1\"\nport = {}",
            json!(self.port.to_string())
        );
        if matches!(self.port, PortAddress::Tcp { .. }) {
            text.push_str(
                "# The device server sets the line. Enter its settings here, so that times are \
                 computed correctly.\n",
            );
        }
        let parity = word_for(&PARITIES, &parity);
        let _ = writeln!(
            text,
            "baud = {baud}\nparity = \"{parity}\"\nstop_bits = {stop_bits}"
        );
        if setting.framing == Framing::Ascii {
            let _ = writeln!(text, "framing = \"ascii\"\ndata_bits = {data_bits}");
        }
        if self.echoes {
            text.push_str(
                "# The adapter echoes what is sent. If you can, switch that off at the adapter.\n\
                 echo = \"strip\"\n",
            );
        }
    }
}

fn drive(finding: &FoundDrive, text: &mut String) {
    let station = finding.station;
    let Some((model, why)) = finding.verdict.fits.first() else {
        let _ = writeln!(text, "\n# Station {station}: {}.", model_text(finding));
        return;
    };
    let others: Vec<_> = finding
        .verdict
        .fits
        .iter()
        .skip(1)
        .map(|(model, _)| model.id.as_str())
        .collect();
    let sure = match (finding.verdict.keyword(), others.is_empty()) {
        ("probable", _) => format!("identified: {why}; compare it with the nameplate"),
        (_, true) if finding.verdict.answers_anything => {
            "a guess: it answers any request; compare it with the nameplate".to_owned()
        }
        (_, true) => format!("a guess: {why}; compare it with the nameplate"),
        (_, false) => format!("or {}; compare it with the nameplate", others.join(" or ")),
    };
    let _ = writeln!(
        text,
        "\n  [[line.drive]]\n  name = \"drive-{station}\"\n  model = \"{}\" # {sure}\n  station = {station}",
        model.id
    );
    if model.needs_full_scale() {
        let place = model.full_scale_parameter().unwrap_or("look it up there");
        let _ = writeln!(
            text,
            "  # full_scale_hz = # needed: the frequency that stands for 100 % at the drive; {place}"
        );
    }
}

fn link_json(link: LinkSettings) -> Value {
    json!({
        "baud": link.baud,
        "data_bits": link.data_bits,
        "parity": word_for(&PARITIES, &link.parity),
        "stop_bits": link.stop_bits,
        "text": link.to_string(),
    })
}
