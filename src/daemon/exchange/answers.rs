//! The way back from the line threads to the north side.

use crate::daemon::exchange::origin::RowOrigin;
use crate::daemon::host::clock;
use crate::domain::command::CommandAnswer;
use crate::domain::ids::AskerId;
use crate::domain::native::NativeAnswer;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveRef;
use crate::drive::view::TripEvent;
use crate::journal::{RowNumber, StoredEvent};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;
use tokio::time::timeout;

/// Something that a line reports to the north side.
#[derive(Clone, Debug, PartialEq)]
pub enum LineNews {
    /// The answer to a native request.
    Native(NativeAnswer),
    /// The outcome of a command, interim or final.
    Command(CommandAnswer),
    /// A drive has tripped, or its trip has been cleared. Sent to the MQTT side only.
    Trip(DriveRef, TripEvent),
    /// Trip events in the journal that were not taken yet, in order. Sent to the MQTT side only.
    Events {
        /// The first of them; may be empty.
        events: Vec<StoredEvent>,
        /// More follow; they have to be requested.
        more: bool,
    },
}

impl LineNews {
    /// Whom it is for.
    #[must_use]
    pub const fn asker(&self) -> AskerId {
        match self {
            Self::Native(answer) => answer.asker,
            Self::Command(answer) => answer.asker,
            Self::Trip(..) | Self::Events { .. } => AskerId::MQTT,
        }
    }
}

/// Answers of all lines that the north side has not fetched yet. Its bound is that of the requests: each connection has
/// at most 16 without an answer, MQTT, Sparkplug, the tools and the page have bounds of their own, and trips occur no
/// faster than polls.
#[derive(Debug, Default)]
pub struct AnswerBox {
    answers: Mutex<PendingAnswers>,
    bell: Notify,
    /// No side fetches answers.
    is_closed: AtomicBool,
}

#[derive(Debug, Default)]
struct PendingAnswers {
    ready: Vec<LineNews>,
    /// Answers that wait until the row that led to them is kept.
    held: Vec<HeldAnswer>,
}

/// An answer that waits for a row of the journal.
#[derive(Debug)]
pub struct HeldAnswer {
    /// The line that sent both.
    pub origin: Arc<RowOrigin>,
    /// The row.
    pub row: RowNumber,
    /// The answer is sent by then, whether the row is kept or not.
    pub until: MonoTime,
    /// The answer.
    pub news: LineNews,
}

impl PendingAnswers {
    /// Releases answers whose row is kept by now or whose time is over. Returns whether there were any.
    fn release(&mut self) -> bool {
        if self.held.is_empty() {
            return false;
        }
        let now = clock::now();
        let before = self.held.len();
        let may_go = |held: &mut HeldAnswer| held.origin.has_kept(held.row) || held.until <= now;
        self.ready
            .extend(self.held.extract_if(.., may_go).map(|held| held.news));
        self.held.len() < before
    }
}

impl AnswerBox {
    /// Sets whether answers are fetched from now on. While they are not, none is kept.
    pub fn set_open(&self, is_open: bool) {
        self.is_closed.store(!is_open, Ordering::SeqCst);
        if !is_open {
            *self.lock() = PendingAnswers::default();
        }
    }

    /// Puts answers in, leaves `batch` empty, and wakes the north side once for all of them.
    pub fn put(&self, batch: &mut Vec<LineNews>) {
        if self.is_closed.load(Ordering::SeqCst) {
            batch.clear();
        }
        if batch.is_empty() {
            return;
        }
        let mut answers = self.lock();
        let was_empty = answers.ready.is_empty();
        answers.ready.append(batch);
        drop(answers);
        if was_empty {
            self.bell.notify_one();
        }
    }

    /// Adds an answer that waits for its row.
    pub fn hold(&self, held: HeldAnswer) {
        if self.is_closed.load(Ordering::SeqCst) {
            return;
        }
        self.lock().held.push(held);
        // The row may have been kept meanwhile, and the fetching task needs the new deadline.
        self.bell.notify_one();
    }

    /// To be called when rows were kept. Returns whether an answer waited for one of them.
    pub fn release(&self) -> bool {
        let has_released = self.lock().release();
        if has_released {
            self.bell.notify_one();
        }
        has_released
    }

    /// When the next waiting answer is sent at the latest.
    #[must_use]
    pub fn next_release(&self) -> Option<MonoTime> {
        self.lock().held.iter().map(|held| held.until).min()
    }

    /// Swaps the queued answers for the empty `batch`.
    pub fn take(&self, batch: &mut Vec<LineNews>) {
        let mut answers = self.lock();
        answers.release();
        std::mem::swap(&mut answers.ready, batch);
    }

    /// Waits for answers and swaps them for the empty `batch`, which may stay empty.
    pub async fn fetch(&self, batch: &mut Vec<LineNews>) {
        match self.next_release() {
            None => self.bell.notified().await,
            Some(until) => {
                // Either way, check which answers may be sent.
                let _ = timeout(until.since(clock::now()), self.bell.notified()).await;
            }
        }
        self.take(batch);
    }

    fn lock(&self) -> MutexGuard<'_, PendingAnswers> {
        self.answers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
