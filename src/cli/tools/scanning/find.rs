//! A scan for `init`: the drives of the setting that most of them answer at.

use super::{Scanned, model_text, scanned};
use crate::cli::tools::Failure;
use crate::cli::tools::link_args::LinkArgs;
use crate::config::PortAddress;
use crate::daemon::lines::tool_line::ToolPort;
use crate::daemon::scan::ADVICE;
use crate::daemon::scan::plan::setting_text;
use crate::daemon::scan::plan::{self, Plan, ScanOptions, Setting};
use crate::daemon::scan::survey::Findings;
use crate::domain::link::LinkSettings;
use crate::profile::catalog::Catalog;
use crate::profile::model::Model;
use std::sync::Arc;

/// One drive that answers.
pub struct Drive {
    /// Its station.
    pub station: u8,
    /// The models that fit, the most likely first.
    pub fits: Vec<Arc<Model>>,
    /// Whether a single model is named with good reason.
    pub is_sure: bool,
}

/// The drives of a line.
pub struct Found {
    /// The setting that most of them have.
    pub setting: Setting,
    /// The drives that answer with `setting`.
    pub drives: Vec<Drive>,
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
    announce: impl FnOnce(&Plan) -> Result<(), Failure>,
) -> Result<Found, Failure> {
    let stations =
        plan::stations(stations).map_err(|why| Failure::wrong(format!("--stations: {why}")))?;
    let options = ScanOptions {
        bauds: baud.into_iter().collect(),
        parity: link.parity(),
        stop_bits: link.stop_bits,
        is_network: matches!(port, PortAddress::Tcp { .. }),
        ..ScanOptions::default()
    };
    let models: Vec<_> = catalog.models().cloned().collect();
    let plan = Plan::new(&models, stations, &options);
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
    let Scanned {
        findings,
        echoes,
        ended,
        ..
    } = scanned(&plan, tool_port)?;
    ended?;
    if !findings.is_complete {
        return Err(Failure::failed("interrupted; nothing was written"));
    }
    if findings.drives.is_empty() {
        return Err(Failure::failed(ADVICE));
    }
    settled(&plan, &findings, echoes)
}

fn settled(plan: &Plan, findings: &Findings, echoes: bool) -> Result<Found, Failure> {
    let best = plan
        .most_answer(findings)
        .ok_or_else(|| Failure::failed(ADVICE))?;
    let setting = plan
        .settings
        .get(best)
        .ok_or_else(|| Failure::failed(ADVICE))?
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
    let drives = here.into_iter().map(|finding| Drive {
        station: finding.station,
        fits: finding
            .verdict
            .fits
            .iter()
            .map(|(model, _)| Arc::clone(model))
            .collect(),
        is_sure: finding.verdict.word() == "probable",
    });
    let mut drives: Vec<_> = drives.collect();
    drives.sort_by_key(|drive| drive.station);
    Ok(Found {
        setting,
        drives,
        others,
        echoes,
    })
}
