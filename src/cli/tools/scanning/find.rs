//! A scan for `init`: the drives of the setting that most of them answer at.

use super::{ScanOutcome, model_text, scanned};
use crate::cli::tools::CommandFailure;
use crate::cli::tools::link_args::LinkArgs;
use crate::config::PortAddress;
use crate::daemon::lines::tool_line::ToolPort;
use crate::daemon::scan::ADVICE;
use crate::daemon::scan::plan::setting_text;
use crate::daemon::scan::plan::{self, ScanOptions, ScanPlan, ScanSetting};
use crate::daemon::scan::survey::ScanFindings;
use crate::domain::link::LinkSettings;
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;
use std::sync::Arc;

/// One drive that answers.
pub struct ScannedDrive {
    /// Its station.
    pub station: u8,
    /// The models that fit, the most likely first.
    pub fits: Vec<Arc<Model>>,
    /// Whether a single model is named with good reason.
    pub is_sure: bool,
}

/// The drives of a line.
pub struct ScannedLine {
    /// The setting that most of them have.
    pub setting: ScanSetting,
    /// The drives that answer with `setting`.
    pub drives: Vec<ScannedDrive>,
    /// Others, in words.
    pub others: Vec<String>,
    /// The adapter echoes what is sent.
    pub echoes: bool,
}

/// Looks for drives. `announce` is called before the first frame.
///
/// # Errors
/// The line cannot be used or is in use, the scan was interrupted, or nothing answers.
pub fn find(
    port: &PortAddress,
    catalog: &Catalog,
    stations: &str,
    baud: Option<u32>,
    link: &LinkArgs,
    announce: impl FnOnce(&ScanPlan) -> Result<(), CommandFailure>,
) -> Result<ScannedLine, CommandFailure> {
    let stations = plan::stations(stations)
        .map_err(|why| CommandFailure::wrong(format!("--stations: {why}")))?;
    let options = ScanOptions {
        bauds: baud.into_iter().collect(),
        parity: link.parity(),
        stop_bits: link.stop_bits,
        is_network: matches!(port, PortAddress::Tcp { .. }),
        ..ScanOptions::default()
    };
    let models: Vec<_> = catalog.models().cloned().collect();
    let plan = ScanPlan::new(&models, stations, &options);
    announce(&plan)?;
    let first = plan
        .settings
        .first()
        .map_or(LinkSettings::DEFAULT, |setting| setting.link);
    let tool_port = ToolPort {
        address: port.clone(),
        link: first,
        direction: link.direction(),
    };
    let ScanOutcome {
        findings,
        echoes,
        ended,
        ..
    } = scanned(&plan, tool_port)?;
    ended?;
    if !findings.is_complete {
        return Err(CommandFailure::failed("interrupted; nothing was written"));
    }
    if findings.drives.is_empty() {
        return Err(CommandFailure::failed(ADVICE));
    }
    settled(&plan, &findings, echoes)
}

fn settled(
    plan: &ScanPlan,
    findings: &ScanFindings,
    echoes: bool,
) -> Result<ScannedLine, CommandFailure> {
    let best = plan
        .most_answer(findings)
        .ok_or_else(|| CommandFailure::failed(ADVICE))?;
    let setting = plan
        .settings
        .get(best)
        .ok_or_else(|| CommandFailure::failed(ADVICE))?
        .clone();
    let (here, elsewhere): (Vec<_>, Vec<_>) = findings
        .drives
        .iter()
        .partition(|finding| finding.setting == best);
    let others = elsewhere.into_iter().map(|finding| {
        let at = plan
            .settings
            .get(finding.setting)
            .map(setting_text)
            .unwrap_or_default();
        let model = model_text(finding);
        format!(
            "Station {} answers at {at} ({model}): set it to {} first.",
            finding.station, setting.link
        )
    });
    let others = others.collect();
    let drives = here.into_iter().map(|finding| ScannedDrive {
        station: finding.station,
        fits: finding
            .verdict
            .fits
            .iter()
            .map(|(model, _)| Arc::clone(model))
            .collect(),
        is_sure: finding.verdict.keyword() == "probable",
    });
    let mut drives: Vec<_> = drives.collect();
    drives.sort_by_key(|drive| drive.station);
    Ok(ScannedLine {
        setting,
        drives,
        others,
        echoes,
    })
}
