//! The way back from the line threads to the north side.

use crate::daemon::host::clock;
use crate::daemon::journal::origin::Origin;
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

/// Something that a line tells the north side.
#[derive(Clone, Debug, PartialEq)]
pub enum News {
    /// The answer to a native request.
    Native(NativeAnswer),
    /// What became of a command, so far or for good.
    Command(CommandAnswer),
    /// A drive has tripped, or its trip holds no more. Only the MQTT side is told.
    Trip(DriveRef, TripEvent),
    /// The journal has trip events that were not taken yet, in their order. Only the MQTT side is told.
    Events {
        /// Some of them, or none.
        events: Vec<StoredEvent>,
        /// There are others behind these; they have to be asked for.
        more: bool,
    },
}

impl News {
    /// For whom it is.
    #[must_use]
    pub const fn asker(&self) -> AskerId {
        match self {
            Self::Native(answer) => answer.asker,
            Self::Command(answer) => answer.asker,
            Self::Trip(..) | Self::Events { .. } => AskerId::MQTT,
        }
    }
}

/// Answers of all lines that the north side has not fetched yet. Its bound is that of the requests: each
/// connection has at most 16 without an answer, MQTT, Sparkplug, the tools and the page have bounds of their own, and trips come
/// no faster than polls.
#[derive(Debug, Default)]
pub struct AnswerBox {
    answers: Mutex<Answers>,
    bell: Notify,
    /// Nobody fetches them.
    is_closed: AtomicBool,
}

#[derive(Debug, Default)]
struct Answers {
    ready: Vec<News>,
    /// Those that wait until what led to them is kept.
    held: Vec<Held>,
}

/// An answer that waits for a row of the journal.
#[derive(Debug)]
pub struct Held {
    /// The line that said both.
    pub origin: Arc<Origin>,
    /// The row.
    pub row: RowNumber,
    /// The answer goes out by then, kept or not.
    pub until: MonoTime,
    /// The answer.
    pub news: News,
}

impl Answers {
    /// Lets those go that have waited long enough, or for what is kept by now. Returns whether there were any.
    fn release(&mut self) -> bool {
        if self.held.is_empty() {
            return false;
        }
        let (now, before) = (clock::now(), self.held.len());
        let may_go = |held: &mut Held| held.origin.has_kept(held.row) || held.until <= now;
        self.ready.extend(self.held.extract_if(.., may_go).map(|held| held.news));
        self.held.len() < before
    }
}

impl AnswerBox {
    /// From now on somebody fetches the answers, or nobody does: then none is kept.
    pub fn set_open(&self, is_open: bool) {
        self.is_closed.store(!is_open, Ordering::SeqCst);
        if !is_open {
            *self.lock() = Answers::default();
        }
    }

    /// Puts answers in, leaves `batch` empty, and wakes the north side once for all of them.
    pub fn put(&self, batch: &mut Vec<News>) {
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

    /// Puts an answer in that waits.
    pub fn hold(&self, held: Held) {
        if self.is_closed.load(Ordering::SeqCst) {
            return;
        }
        self.lock().held.push(held);
        // The row may be kept since, and who fetches has to know until when to wait.
        self.bell.notify_one();
    }

    /// What was waited for may be kept now. Returns whether an answer waited for it.
    pub fn release(&self) -> bool {
        let has_released = self.lock().release();
        if has_released {
            self.bell.notify_one();
        }
        has_released
    }

    /// When the next answer that waits goes out at the latest.
    #[must_use]
    pub fn next_release(&self) -> Option<MonoTime> {
        self.lock().held.iter().map(|held| held.until).min()
    }

    /// Exchanges what has come for the empty `batch`.
    pub fn take(&self, batch: &mut Vec<News>) {
        let mut answers = self.lock();
        answers.release();
        std::mem::swap(&mut answers.ready, batch);
    }

    /// Waits for answers and exchanges them for the empty `batch`; it may stay empty.
    pub async fn fetch(&self, batch: &mut Vec<News>) {
        match self.next_release() {
            None => self.bell.notified().await,
            Some(until) => {
                // Either way it is looked what may go.
                let _ = timeout(until.since(clock::now()), self.bell.notified()).await;
            }
        }
        self.take(batch);
    }

    fn lock(&self) -> MutexGuard<'_, Answers> {
        self.answers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
