//! A scan that runs beside the gateway's own lines, and what it has found so far.

use crate::daemon::lines::tool_line::ToolPort;
use crate::daemon::scan::asker::PortAsker;
use crate::daemon::scan::plan::{ScanPlan, ScanSetting};
use crate::daemon::scan::survey::{FoundDrive, ModelVerdict, ScanEvent, ScanFindings, survey};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, OwnedSemaphorePermit};

/// The name of its line, also in lock files.
pub const NAME: &str = "set-up";

/// How far a scan is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ScanState {
    /// The scan runs.
    Running,
    /// Everything was tried.
    Done,
    /// The scan was ended before.
    Ended,
    /// The scan could not go on, for this reason.
    Failed(String),
}

impl ScanState {
    /// Its word.
    #[must_use]
    pub const fn keyword(&self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Done => "done",
            Self::Ended => "ended",
            Self::Failed(_) => "failed",
        }
    }
}

/// What has been found so far.
#[derive(Clone, Debug)]
pub struct ScanProgress {
    /// How far it is.
    pub state: ScanState,
    /// The setting that is being tried, by its index in the plan; `None` before the first.
    pub setting: Option<usize>,
    /// Reads that looked for drives.
    pub asked: usize,
    /// The drives so far, and more once it is done.
    pub findings: ScanFindings,
    /// Drives whose model was searched for, by setting and station.
    pub judged: Vec<(usize, u8)>,
    /// The adapter echoes what is sent.
    pub echoes: bool,
    /// Frames of drives that arrived too late to count.
    pub late: u64,
}

/// A scan.
#[derive(Debug)]
pub struct RunningScan {
    port: ToolPort,
    plan: ScanPlan,
    progress: Mutex<ScanProgress>,
    ends: Notify,
}

impl RunningScan {
    /// A scan of `port` that tries `plan`.
    #[must_use]
    pub fn new(port: ToolPort, plan: ScanPlan) -> Self {
        let progress = ScanProgress {
            state: ScanState::Running,
            setting: None,
            asked: 0,
            findings: ScanFindings::default(),
            judged: Vec::new(),
            echoes: false,
            late: 0,
        };
        Self {
            port,
            plan,
            progress: Mutex::new(progress),
            ends: Notify::new(),
        }
    }

    /// The port.
    #[must_use]
    pub const fn port(&self) -> &ToolPort {
        &self.port
    }

    /// What is tried.
    #[must_use]
    pub const fn plan(&self) -> &ScanPlan {
        &self.plan
    }

    /// What has been found so far.
    #[must_use]
    pub fn progress(&self) -> ScanProgress {
        self.lock().clone()
    }

    /// The setting that most of the drives have, once the scan is done.
    #[must_use]
    pub fn setting(&self) -> Option<(usize, &ScanSetting)> {
        let progress = self.lock();
        if progress.state != ScanState::Done {
            return None;
        }
        let number = self.plan.most_answer(&progress.findings)?;
        Some((number, self.plan.settings.get(number)?))
    }

    /// Runs to the end. `place` is released with the port.
    pub async fn run(self: Arc<Self>, place: OwnedSemaphorePermit) {
        let mut asker = PortAsker::new(self.port.clone());
        let mut findings = ScanFindings::default();
        let state = tokio::select! {
            ended = survey(&self.plan, &mut asker, &mut findings, |event| self.note(&event)) => match ended {
                Ok(()) => ScanState::Done,
                Err(error) => ScanState::Failed(error.to_string()),
            },
            () = self.ends.notified() => ScanState::Ended,
        };
        asker.close().await;
        let mut progress = self.lock();
        tracing::info!(port = %self.port.address, drives = findings.drives.len(), state = state.keyword(), "scan from the page");
        progress.findings = findings;
        progress.echoes = asker.echoes > 0;
        progress.late = asker.late;
        progress.state = state;
        drop(progress);
        drop(place);
    }

    /// Ends it soon.
    pub fn end(&self) {
        self.ends.notify_one();
    }

    fn note(&self, event: &ScanEvent<'_>) {
        let mut progress = self.lock();
        match event {
            ScanEvent::Setting(number) => {
                progress.asked = self.plan.asks_before(*number);
                progress.setting = Some(*number);
            }
            ScanEvent::Asked => progress.asked += 1,
            ScanEvent::Answers(station) => {
                let setting = progress.setting.unwrap_or_default();
                let verdict = ModelVerdict::default();
                progress.findings.drives.push(FoundDrive {
                    setting,
                    station: *station,
                    by_exception: false,
                    verdict,
                });
            }
            ScanEvent::Told(finding) => {
                let of_station = |it: &&mut FoundDrive| {
                    (it.setting, it.station) == (finding.setting, finding.station)
                };
                if let Some(known) = progress.findings.drives.iter_mut().find(of_station) {
                    known.clone_from(finding);
                }
                progress.judged.push((finding.setting, finding.station));
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, ScanProgress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
