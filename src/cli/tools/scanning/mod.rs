//! Scans of an unused line, with their progress: for `scan`, for `init`, and single reads for `models new`.

pub mod find;
pub mod single;

use super::CommandFailure;
use super::progress::ProgressBar;
use crate::daemon::lines::tool_line::ToolPort;
use crate::daemon::scan::asker::PortAsker;
use crate::daemon::scan::plan::{ScanPlan, setting_text};
use crate::daemon::scan::survey::{FoundDrive, ScanEvent, ScanFindings, survey};
use crate::daemon::service::signals::told_to_end;

/// The outcome of a scan.
pub struct ScanOutcome {
    /// What was found.
    pub findings: ScanFindings,
    /// Why it ended early.
    pub ended: Result<(), CommandFailure>,
    /// The adapter echoes what is sent.
    pub echoes: bool,
    /// Frames of drives that arrived too late to count.
    pub late: u64,
}

/// Tries everything in `plan`, until Ctrl-C. Shows the progress.
pub fn scanned(plan: &ScanPlan, port: ToolPort) -> Result<ScanOutcome, CommandFailure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    runtime.block_on(async {
        let mut findings = ScanFindings::default();
        let mut asker = PortAsker::new(port);
        let stop_signal = told_to_end().map_err(CommandFailure::failed)?;
        let mut shown = ShownProgress { plan, bar: ProgressBar::new(plan.asks()) };
        let ended = tokio::select! {
            done = survey(plan, &mut asker, &mut findings, |event| shown.event(&event)) => done.map_err(CommandFailure::from),
            () = stop_signal => Ok(()),
        };
        shown.bar.end();
        asker.close().await;
        Ok(ScanOutcome { findings, ended, echoes: asker.echoes > 0, late: asker.late })
    })
}

/// The model candidates, the best first, for people.
pub fn model_text(finding: &FoundDrive) -> String {
    let verdict = &finding.verdict;
    let fits: Vec<_> = verdict
        .fits
        .iter()
        .map(|(model, why)| format!("{} ({why})", model.id))
        .collect();
    let text = match verdict.keyword() {
        "probable" => format!("probably {}", fits.join(", ")),
        "possible" => format!("perhaps {}", fits.join(" or ")),
        _ => "answers, but fits no model".to_owned(),
    };
    match &verdict.other {
        Some(other) => format!("says that it is {other}; {text}"),
        None => text,
    }
}

/// Shows the progress on a terminal.
struct ShownProgress<'a> {
    plan: &'a ScanPlan,
    bar: ProgressBar,
}

impl ShownProgress<'_> {
    fn event(&mut self, event: &ScanEvent<'_>) {
        let at = |number: usize| {
            self.plan
                .settings
                .get(number)
                .map(setting_text)
                .unwrap_or_default()
        };
        match event {
            ScanEvent::Setting(number) => {
                let text = at(*number);
                self.bar.to(self.plan.asks_before(*number), &text);
            }
            ScanEvent::Asked => self.bar.step(),
            ScanEvent::Answers(station) => self.bar.line(&format!("station {station} answers")),
            ScanEvent::Told(finding) => {
                let text = format!(
                    "station {} at {}: {}",
                    finding.station,
                    at(finding.setting),
                    model_text(finding)
                );
                self.bar.line(&text);
            }
        }
    }
}
