//! Live documents for the page: state, changes as server-sent events, the trend of the last hour, the journal, advice.
//!
//! One task compares the drive views twice a second. What has changed becomes one text for all listeners; without
//! listeners none is made. Nothing here causes traffic on a line.

mod answers;
mod events;
mod journal;
mod last_state;
mod listeners;
pub(super) mod routes;
mod source;
#[cfg(test)]
mod tests;
mod trend;
mod usage;

use super::large::AnswerRoom;
use super::state::HttpState;
use crate::daemon::exchange::shared::SharedPlant;
use crate::daemon::host::clock;
use crate::daemon::host::random;
use crate::north::clock::{ClockMoment, LabelClock};
use crate::north::operator::moments::{self, SealedMoments};
use crate::north::page::kept::MinuteCollector;
use crate::north::page::{DriveTrends, LineUse, PageDrive, PageMoment};
use last_state::LastState;
use listeners::{LiveListener, LiveListeners};
use serde_json::Value;
use source::LiveSource;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Semaphore;
use tokio::time::MissedTickBehavior;

/// How often the views are compared, and a moment is sent to listeners.
const TICK: Duration = moments::EVERY;

/// Most readers of the journal and the trends at once. Reading takes processor time that lines need too.
const READERS_MAX: usize = 2;

/// What the live documents are made from, beside the views.
#[derive(Debug)]
pub struct LiveDocuments {
    state: Arc<HttpState>,
    kept: Mutex<LiveState>,
    /// Places for readers of the journal.
    readers: Arc<Semaphore>,
    /// Room for the state with which each event stream begins.
    room: AnswerRoom,
    /// The moments that orders name.
    moments: SealedMoments,
}

#[derive(Debug)]
struct LiveState {
    clock: LabelClock,
    /// Lines and drives as of the last look.
    shared: Option<Arc<SharedPlant>>,
    /// By the numbers of the lines.
    uses: BTreeMap<u16, LineUse>,
    trends: DriveTrends,
    collector: MinuteCollector,
    listeners: LiveListeners,
    /// What listeners have received; `None` while there is no listener.
    last: Option<LastState>,
}

impl LiveDocuments {
    /// Starts without listeners or measurements.
    #[must_use]
    pub fn new(state: Arc<HttpState>) -> Self {
        let started = ClockMoment {
            mono: state.started,
            wall: state.started_at,
        };
        let kept = LiveState {
            clock: LabelClock::new(started),
            shared: None,
            uses: BTreeMap::new(),
            trends: DriveTrends::default(),
            collector: MinuteCollector::default(),
            listeners: LiveListeners::default(),
            last: None,
        };
        Self {
            state,
            kept: Mutex::new(kept),
            readers: Arc::new(Semaphore::new(READERS_MAX)),
            room: AnswerRoom::default(),
            moments: SealedMoments::new(random::secret()),
        }
    }

    /// The moments that listeners receive.
    #[must_use]
    pub const fn moments(&self) -> &SealedMoments {
        &self.moments
    }

    fn lock(&self) -> MutexGuard<'_, LiveState> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Compares the views from now on. Never returns.
pub async fn run(live: Arc<LiveDocuments>) {
    let mut ticks = tokio::time::interval(TICK);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        live.lock().record_changes(&live, clock::moment());
        ticks.tick().await;
    }
}

impl LiveState {
    /// Records what is due for the trend and the use of the lines, and sends changes to listeners.
    fn record_changes(&mut self, live: &LiveDocuments, at: ClockMoment) {
        let now = at.mono;
        self.clock.see(at);
        let is_new = self.follow(&live.state);
        let Some(shared) = self.shared.clone() else {
            return;
        };
        if self.trends.is_due(now) {
            let views: Vec<_> = shared
                .drives
                .iter()
                .map(|drive| drive.view.load_full())
                .collect();
            let drives = || {
                let both = shared.drives.iter().zip(&views);
                both.map(|(drive, view)| PageDrive {
                    description: &drive.description,
                    view,
                    station: None,
                    standby: None,
                })
            };
            self.trends.note(now, drives());
            if let Some(kept) = &live.state.trends {
                kept.keep(self.collector.note(at.wall, now, drives()));
            }
            for line in &shared.lines {
                self.uses
                    .entry(line.number)
                    .or_default()
                    .note(now, &line.report().counters);
            }
        }
        self.listeners.forget_gone();
        if self.listeners.is_empty() {
            self.last = None;
            return;
        }
        let source = LiveSource {
            state: &live.state,
            shared: &shared,
            uses: &self.uses,
            present: PageMoment {
                now,
                clock: &self.clock,
            },
        };
        let news = match &mut self.last {
            Some(last) if !is_new => last.news(&source),
            last => {
                let events = if is_new {
                    events::event("configuration", "{}")
                } else {
                    String::new()
                };
                *last = Some(LastState::now(&source));
                events + &events::event("state", &source.document().to_string())
            }
        };
        self.listeners
            .tell(news + &events::alive(&live.moments.at(now)));
    }

    /// Follows a change of the configuration. Returns whether there was one since the last call.
    fn follow(&mut self, state: &HttpState) -> bool {
        let shared = state.shared.get();
        if self
            .shared
            .as_ref()
            .is_some_and(|known| Arc::ptr_eq(known, &shared))
        {
            return false;
        }
        self.trends
            .change_to(shared.drives.iter().map(|drive| &drive.description));
        self.collector
            .change_to(shared.drives.iter().map(|drive| &drive.description));
        self.uses
            .retain(|number, _| shared.lines.iter().any(|line| line.number == *number));
        self.shared.replace(shared).is_some()
    }

    /// Applies `made` to the present state of everything.
    fn source<T>(&self, live: &LiveDocuments, made: impl FnOnce(&LiveSource<'_>) -> T) -> T {
        let present = PageMoment {
            now: clock::now(),
            clock: &self.clock,
        };
        made(&LiveSource {
            state: &live.state,
            shared: &live.state.shared.get(),
            uses: &self.uses,
            present,
        })
    }

    /// A new listener, with the state as its first event; `None` if too many large answers are unread.
    fn listen(
        &mut self,
        live: &LiveDocuments,
        stay: super::lasting::StreamPermit,
    ) -> Option<LiveListener> {
        // Existing listeners received an earlier state; that one is kept, so that they get every change.
        let is_first = self.last.is_none();
        let (first, last) = self.source(live, |source| {
            let moment = live.moments.at(source.present.now);
            let last = is_first.then(|| LastState::now(source));
            (events::first(&source.document().to_string(), &moment), last)
        });
        let first = live.room.pieces(first.into())?;
        self.last = self.last.take().or(last);
        Some(self.listeners.add(first, stay))
    }

    /// The trend of the drive called `name`; `None` before its first sample.
    fn trend(&self, name: &str, rows: usize) -> Option<Value> {
        let end = self
            .trends
            .newest_at()
            .map_or(0, |at| self.clock.wall(at).unix_ms.div_euclid(1000));
        self.trends.document(name, end, rows)
    }
}
