//! The way back from the line threads to the north side.

use crate::domain::command::CommandAnswer;
use crate::domain::ids::AskerId;
use crate::domain::native::NativeAnswer;
use crate::drive::description::DriveRef;
use crate::drive::view::TripEvent;
use crate::journal::StoredEvent;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::Notify;

/// Something that a line tells the north side.
#[derive(Clone, Debug, PartialEq)]
pub enum News {
    /// The answer to a native request.
    Native(NativeAnswer),
    /// What became of a command, so far or for good.
    Command(CommandAnswer),
    /// A drive has tripped, or its trip holds no more. Only the MQTT side is told.
    Trip(DriveRef, TripEvent),
    /// Events of the journal, which the MQTT side has asked for; none and more is a bell.
    Events {
        /// In rising order of their numbers.
        events: Vec<StoredEvent>,
        /// There are others behind these.
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

/// The north sides that lines answer to.
#[derive(Clone, Debug, Default)]
pub struct NorthSides {
    /// Modbus TCP connections.
    pub modbus: Arc<AnswerBox>,
    /// MQTT; nothing if there is none, and then nobody keeps news for it.
    pub mqtt: Option<Arc<AnswerBox>>,
    /// The program's own tools.
    pub local: Arc<AnswerBox>,
}

/// Answers of all lines that the north side has not fetched yet. Its bound is that of the requests: each
/// connection has at most 16 without an answer, MQTT and the tools have bounds of their own, and trips come no faster
/// than polls.
#[derive(Debug, Default)]
pub struct AnswerBox {
    answers: Mutex<Vec<News>>,
    bell: Notify,
    /// Nobody fetches them.
    is_closed: AtomicBool,
}

impl AnswerBox {
    /// From now on somebody fetches the answers, or nobody does: then none is kept.
    pub fn set_open(&self, is_open: bool) {
        self.is_closed.store(!is_open, Ordering::SeqCst);
        if !is_open {
            self.answers.lock().unwrap_or_else(PoisonError::into_inner).clear();
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
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        let was_empty = answers.is_empty();
        answers.append(batch);
        drop(answers);
        if was_empty {
            self.bell.notify_one();
        }
    }

    /// Exchanges what has come for the empty `batch`.
    pub fn take(&self, batch: &mut Vec<News>) {
        std::mem::swap(&mut *self.answers.lock().unwrap_or_else(PoisonError::into_inner), batch);
    }

    /// Waits for answers and exchanges them for the empty `batch`.
    pub async fn fetch(&self, batch: &mut Vec<News>) {
        self.bell.notified().await;
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::swap(&mut *answers, batch);
    }
}
