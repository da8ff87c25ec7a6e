//! The way back from the line threads to the north side.

use crate::domain::native::NativeAnswer;
use std::sync::{Mutex, PoisonError};
use tokio::sync::Notify;

/// Answers of all lines that the north side has not fetched yet. Its bound is that of the requests: each
/// connection has at most 16 without an answer.
#[derive(Debug, Default)]
pub struct AnswerBox {
    answers: Mutex<Vec<NativeAnswer>>,
    bell: Notify,
}

impl AnswerBox {
    /// Puts answers in, leaves `batch` empty, and wakes the north side once for all of them.
    pub fn put(&self, batch: &mut Vec<NativeAnswer>) {
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

    /// Waits for answers and exchanges them for the empty `batch`.
    pub async fn fetch(&self, batch: &mut Vec<NativeAnswer>) {
        self.bell.notified().await;
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::swap(&mut *answers, batch);
    }
}
