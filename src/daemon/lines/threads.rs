//! The threads of all lines: preparing, beginning, removing and ending them.

use crate::config::LineSettings;
use crate::daemon::exchange::bell::BrokerBell;
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::shared::SharedLine;
use crate::daemon::journal::Journal;
use crate::daemon::line_thread::LineHandle;
use crate::daemon::line_thread::Memory;
use crate::daemon::lines::build;
use crate::domain::report::StopBounds;
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// Most time for a line's thread to exit: as long as its last stops may take, and a write that the port blocks.
const ENDS_WITHIN: Duration = Duration::from_secs(7);
/// Most time for a line's thread to exit after one was waited for already.
const ENDS_SOON: Duration = Duration::from_secs(1);
/// Most time for a line's thread to report whether its drives are in use. It reads its inbox between two exchanges.
const SAYS_WITHIN: Duration = Duration::from_secs(3);
/// Most time for the stops of removed drives to take effect.
const STOPS_WITHIN: Duration = Duration::from_secs(5);

/// The threads of all lines.
#[derive(Debug)]
pub struct LineThreads {
    handles: Vec<LineHandle>,
    sides: NorthSides,
    /// `None` without a data directory.
    journal: Option<Arc<Journal>>,
    changed: Arc<BrokerBell>,
    data_dir: Option<PathBuf>,
    last_number: u16,
    /// Lines have begun, and commands are accepted.
    have_begun: bool,
}

impl LineThreads {
    /// Starts without threads. They will answer to `sides`, send their rows to `journal` and ring `changed`. The lines of
    /// the configuration are `numbered` from 0 already.
    #[must_use]
    pub fn new(
        sides: NorthSides,
        journal: Option<Arc<Journal>>,
        changed: Arc<BrokerBell>,
        data_dir: Option<PathBuf>,
        numbered: usize,
    ) -> Self {
        let last_number = u16::try_from(numbered).unwrap_or(u16::MAX);
        Self {
            handles: Vec::new(),
            sides,
            journal,
            changed,
            data_dir,
            last_number,
            have_begun: false,
        }
    }

    /// A number that no line has.
    pub fn next_number(&mut self) -> u16 {
        loop {
            self.last_number = self.last_number.wrapping_add(1);
            if self
                .handles
                .iter()
                .all(|handle| handle.line().number != self.last_number)
            {
                return self.last_number;
            }
        }
    }

    /// The thread of `line`, with everything it needs. It opens nothing before [`begin`](Self::begin).
    ///
    /// # Errors
    /// The system refuses a resource that it needs.
    pub async fn prepare(
        &self,
        settings: &LineSettings,
        line: Arc<SharedLine>,
    ) -> io::Result<LineHandle> {
        let port = build::line_port(settings, self.data_dir.as_deref());
        let setup = build::line_setup(
            settings,
            first_epoch(),
            self.journal.is_some(),
            self.have_begun,
        );
        let StopBounds {
            all_healthy,
            one_silent,
            ..
        } = setup.stop_bounds();
        tracing::info!(line = %settings.name, ?all_healthy, ?one_silent, "longest time until a STOP starts on the wire");
        let mut handle = LineHandle::prepare(
            port,
            setup,
            line,
            Arc::clone(&self.changed),
            self.sides.clone(),
            self.journal.as_ref(),
        )?;
        if handle.is_ready().await {
            Ok(handle)
        } else {
            Err(io::Error::other(format!(
                "cannot start the thread of line {}",
                settings.name
            )))
        }
    }

    /// Begins these lines, with the remembered state of their drives.
    pub fn begin(&mut self, mut handles: Vec<LineHandle>, memory: &Memory) {
        handles.iter_mut().for_each(|handle| handle.begin(memory));
        self.handles.append(&mut handles);
        self.have_begun = true;
    }

    /// Makes the lines with these numbers refuse commands, and checks whether any of their drives is in use; with
    /// `stops`, those are stopped. Returns the names of drives that are in use, or on which the stop has no effect.
    pub async fn leave(&self, numbers: &[u16], stops: bool) -> Vec<String> {
        let asked: Vec<_> = self
            .among(numbers)
            .map(|handle| (handle, handle.leave(stops)))
            .collect();
        let until = Instant::now() + if stops { STOPS_WITHIN } else { SAYS_WITHIN };
        let mut names = Vec::new();
        for (handle, answer) in asked {
            let drives = &handle.line().drives;
            match timeout_at(until, answer).await {
                Ok(Ok(places)) => {
                    let named = places.iter().filter_map(|place| drives.get(place.get()));
                    names.extend(named.map(|drive| drive.description.name.to_string()));
                }
                // The thread has exited by a fault: no drive is in use.
                Ok(Err(_)) => {}
                Err(_) => {
                    let bound = drives.iter().filter(|drive| {
                        let view = drive.view.load();
                        view.control
                            .as_ref()
                            .is_some_and(|it| it.stop_pending || it.lease.is_some())
                    });
                    names.extend(bound.map(|drive| drive.description.name.to_string()));
                    if names.is_empty() {
                        names.extend(
                            drives
                                .iter()
                                .map(|drive| drive.description.name.to_string()),
                        );
                    }
                }
            }
        }
        names
    }

    /// Lets the lines with these numbers continue after all.
    pub fn stay(&self, numbers: &[u16]) {
        self.among(numbers).for_each(LineHandle::stay);
    }

    /// Ends the lines with these numbers at once.
    pub async fn end(&mut self, numbers: &[u16]) {
        let is_meant = |handle: &LineHandle| numbers.contains(&handle.line().number);
        let (mut ended, kept): (Vec<_>, Vec<_>) = std::mem::take(&mut self.handles)
            .into_iter()
            .partition(is_meant);
        self.handles = kept;
        ended.iter().for_each(LineHandle::close);
        wait_for(&mut ended, ENDS_WITHIN).await;
        ended.into_iter().for_each(LineHandle::join);
    }

    /// Executes the declared action for every drive that is under control, on all lines.
    pub fn begin_shutdown(&self) {
        self.handles.iter().for_each(LineHandle::begin_shutdown);
    }

    /// No line waits for the effect of a stop any more, once each was sent.
    pub fn hurry(&self) {
        self.handles.iter().for_each(LineHandle::hurry);
    }

    /// Waits until the declared actions are done on all lines, within a bound. Stops are still served.
    pub async fn rested(&mut self) {
        let until = Instant::now() + ENDS_WITHIN;
        for handle in &mut self.handles {
            // One that hangs is logged at the end.
            handle.rested_by(until).await;
        }
    }

    /// Ends all lines after the stops that they have. Later stops are refused.
    pub async fn end_all(&mut self) {
        self.handles.iter().for_each(LineHandle::close);
        let has_hung = self.handles.iter().any(|handle| !handle.has_rested());
        // A hanging line was waited for already, and the others have little to do.
        wait_for(
            &mut self.handles,
            if has_hung { ENDS_SOON } else { ENDS_WITHIN },
        )
        .await;
    }

    /// Joins the threads that have exited.
    pub fn join(self) {
        self.handles.into_iter().for_each(LineHandle::join);
    }

    fn among<'h>(&'h self, numbers: &'h [u16]) -> impl Iterator<Item = &'h LineHandle> {
        self.handles
            .iter()
            .filter(|handle| numbers.contains(&handle.line().number))
    }
}

/// Waits until all these threads have exited. One that hangs is abandoned: it must not keep the gateway from its other
/// work.
async fn wait_for(handles: &mut [LineHandle], within: Duration) {
    let until = Instant::now() + within;
    for handle in handles {
        if !handle.ended_by(until).await {
            tracing::error!(line = %handle.line().name, "line thread hangs; abandoned");
        }
    }
}

/// The first epoch of a line's drives. Epochs of an earlier start must differ, whatever the wall clock was then and is
/// now. JSON still represents them exactly, and there is room for every start that is inhibited during a run.
fn first_epoch() -> u64 {
    const BITS: u32 = 52;
    const STOPS_BITS: u32 = 20;
    let random = RandomState::new().hash_one(std::process::id());
    (random >> (64 - (BITS - STOPS_BITS))) << STOPS_BITS
}
