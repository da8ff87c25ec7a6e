//! The documents of commissioning.

use crate::config::words::{FAIL_SAFES, of_fail_safe};
use crate::config::{Config, DriveSettings, LineSettings, PortAddress};
use crate::daemon::commissioning::file::ConfigProposal;
use crate::daemon::commissioning::running::{RunningScan, ScanState};
use crate::daemon::commissioning::values::LiveValue;
use crate::daemon::commissioning::{Commissioning, CommissioningRefusal};
use crate::daemon::host::adapters::SerialAdapter;
use crate::daemon::scan::plan::setting_text;
use crate::daemon::scan::survey::FoundDrive;
use crate::domain::problem::Problem;
use crate::profile::model::Model;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// What there is to begin with.
pub(super) fn site_json(
    commissioning: &Commissioning,
    present: Result<(Config, String), CommissioningRefusal>,
    ports: &[SerialAdapter],
) -> Value {
    let (config, digest, why) = match present {
        Ok((config, digest)) => (Some(config), Some(digest), commissioning.why_not_written()),
        Err(why) => (None, None, Some(why.to_string())),
    };
    let lines = config
        .as_ref()
        .map(|config| config.lines.as_slice())
        .unwrap_or_default();
    let meaning =
        |(word, action): &(&str, _)| json!({ "word": word, "meaning": of_fail_safe(*action) });
    json!({
        "configuration": { "path": commissioning.path(), "digest": digest, "why_not": why },
        "ports": ports.iter().map(|port| port_json(port, lines)).collect::<Vec<_>>(),
        "lines": lines.iter().map(line_json).collect::<Vec<_>>(),
        "ways": config.as_ref().map(ways).unwrap_or_default(),
        "actions": FAIL_SAFES.iter().map(meaning).collect::<Vec<_>>(),
        "scan": commissioning.scan().map(|scan| scan_json(&scan)),
    })
}

/// By which ways commands can arrive.
fn ways(config: &Config) -> Vec<&'static str> {
    let mqtt = config.mqtt.as_ref();
    let ways = [
        (
            config
                .http
                .as_ref()
                .is_some_and(|http| !http.users.is_empty()),
            "page",
        ),
        (!config.listeners.is_empty(), "modbus-tcp"),
        (mqtt.is_some(), "mqtt"),
        (
            mqtt.is_some_and(|mqtt| mqtt.sparkplug.is_some()),
            "sparkplug",
        ),
    ];
    ways.into_iter()
        .filter_map(|(is, way)| is.then_some(way))
        .collect()
}

fn port_json(port: &SerialAdapter, lines: &[LineSettings]) -> Value {
    let is_used = |line: &&LineSettings| match &line.port {
        PortAddress::Device(path) => is_same(path, &port.device),
        PortAddress::Tcp { .. } | PortAddress::ModbusTcp { .. } => false,
    };
    json!({
        "port": port.path,
        "driver": port.driver,
        "group": port.group,
        "may_open": port.may_open,
        "holders": port.holders,
        "line": lines.iter().find(is_used).map(|line| line.name.as_str()),
    })
}

fn is_same(path: &Path, device: &Path) -> bool {
    fs::canonicalize(path).is_ok_and(|path| path == device)
}

fn line_json(line: &LineSettings) -> Value {
    let drive = |drive: &DriveSettings| {
        json!({
            "name": drive.name.as_str(),
            "station": drive.station.0,
            "model": drive.model.id,
            "title": drive.model.title,
            "is_controlled": drive.control.is_some(),
            "can_be_commanded": drive.model.run.is_some(),
            "is_unproven": !drive.model.unproven_basics().is_empty(),
        })
    };
    json!({
        "name": line.name.as_str(),
        "port": line.port.to_string(),
        "drives": line.drives.iter().map(drive).collect::<Vec<_>>(),
    })
}

/// A scan so far.
pub(super) fn scan_json(scan: &RunningScan) -> Value {
    let progress = scan.progress();
    let here = scan.setting();
    let at = |number: usize| scan.plan().settings.get(number).map(setting_text);
    let drive = |finding: &FoundDrive| {
        let is_judged = progress
            .judged
            .contains(&(finding.setting, finding.station));
        let verdict = &finding.verdict;
        json!({
            "station": finding.station,
            "at": at(finding.setting),
            "is_here": here.map(|(number, _)| number == finding.setting),
            "confidence": if is_judged { verdict.keyword() } else { "asking" },
            "models": verdict.fits.iter().map(|(model, why)| model_json(model, why)).collect::<Vec<_>>(),
            "other": verdict.other,
        })
    };
    let damaged = progress
        .findings
        .damaged
        .iter()
        .flat_map(|(setting, stations)| {
            stations
                .iter()
                .map(move |station| json!({ "station": station, "at": at(*setting) }))
        });
    let error = match &progress.state {
        ScanState::Failed(why) => Some(why),
        _ => None,
    };
    json!({
        "port": scan.port().address.to_string(),
        "state": progress.state.keyword(),
        "error": error,
        "asked": progress.asked,
        "asks": scan.plan().asks(),
        "at": progress.setting.and_then(at),
        "longest_s": scan.plan().duration().0.as_secs_f64(),
        "link": here.map(|(_, setting)| setting_text(setting)),
        "drives": progress.findings.drives.iter().map(drive).collect::<Vec<_>>(),
        "damaged": damaged.collect::<Vec<_>>(),
        "late": progress.late,
        "echoes": progress.echoes,
    })
}

fn model_json(model: &Model, why: &str) -> Value {
    json!({
        "id": model.id,
        "vendor": model.vendor,
        "title": model.title,
        "why": why,
        "needs_full_scale": model.needs_full_scale(),
        "full_scale_parameter": model.full_scale_parameter(),
        "can_be_commanded": model.run.is_some(),
        "is_unproven": !model.unproven_basics().is_empty(),
    })
}

/// Live values of the candidates of a drive.
pub(super) fn values_json(station: u8, values: &[(String, Vec<LiveValue>)]) -> Value {
    let value = |value: &LiveValue| {
        json!({
            "name": value.name,
            "label": value.label,
            "text": value.text.as_ref().ok(),
            "why": value.text.as_ref().err(),
        })
    };
    let model = |(id, values): &(String, Vec<LiveValue>)| json!({ "id": id, "values": values.iter().map(value).collect::<Vec<_>>() });
    json!({ "station": station, "models": values.iter().map(model).collect::<Vec<_>>() })
}

/// What a change would make of the file.
pub(super) fn proposal_json(proposal: &ConfigProposal) -> Value {
    let text = &proposal.edited.text;
    let before = text.get(..proposal.edited.added.start).unwrap_or_default();
    let problems = problems_json(proposal.problems(), text);
    let is_right = proposal.config.is_ok();
    let (problems, warnings) = if is_right {
        (json!([]), problems)
    } else {
        (problems, json!([]))
    };
    json!({
        "digest": proposal.digest,
        "text": proposal.added(),
        "line_number": before.matches('\n').count() + 1,
        "is_right": is_right,
        "problems": problems,
        "warnings": warnings,
        "summary": proposal.summary(),
    })
}

/// Problems of `text`, or of a text that is not there.
pub(super) fn problems_json(problems: &[Problem], text: &str) -> Value {
    let problem = |it: &Problem| {
        let line = (!text.is_empty()).then(|| it.place_in(text).0);
        json!({ "key": it.key, "what": it.what, "right": it.right, "line": line })
    };
    problems.iter().map(problem).collect()
}
