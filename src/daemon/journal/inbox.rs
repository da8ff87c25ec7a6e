//! The inbox of the journal's writer. Adding to it never blocks.

use crate::daemon::exchange::origin::RowOrigin;
use crate::domain::ids::Name;
use crate::domain::time::MonoTime;
use crate::journal::audit::LostCounts;
use crate::journal::words::is_stop;
use crate::journal::{EntryToKeep, JournalEntry, JournalRow, RememberedDrive, WriteAttempt};
use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::oneshot;

/// Refused attempts and other rows that may wait.
pub const ROWS_MAX: usize = 8192;
/// Further room for outcomes of commands.
pub const ENDS_MAX: usize = 4096;
/// Further room for trips, stops, leases and other rows that must not be lost.
pub const VITAL_MAX: usize = 8192;

/// A message to the writer.
#[derive(Debug)]
pub enum WriterMessage {
    /// A row of a line.
    Keep(Arc<RowOrigin>, EntryToKeep),
    /// An attempt that a north side refused: the number of that side, the drive if one was named, and when.
    Attempt(u64, Option<Name>, MonoTime, WriteAttempt),
    /// A change of availability.
    Note(JournalRow),
    /// The MQTT side has room for the events after this one.
    WantEvents(u64),
    /// The broker has this event.
    EventTaken(u64),
    /// Problems found by the check of the whole file.
    Checked(Vec<String>),
    /// Drives that no row mentions any more.
    Unused(Vec<Name>),
    /// A request for the remembered state of each drive.
    Memory(oneshot::Sender<BTreeMap<Name, RememberedDrive>>),
    /// The gateway shuts down.
    Close,
}

/// How many posts may wait before one of this kind.
fn room_for(post: &WriterMessage) -> usize {
    let attempt = |attempt: &WriteAttempt| match (is_stop(&attempt.tried), attempt.report) {
        (true, _) => ROWS_MAX + ENDS_MAX + VITAL_MAX,
        (false, None) => ROWS_MAX + ENDS_MAX,
        (false, Some(_)) => ROWS_MAX,
    };
    match post {
        WriterMessage::Attempt(_, _, _, it)
        | WriterMessage::Keep(
            _,
            EntryToKeep {
                entry: JournalEntry::Attempt(it),
                ..
            },
        ) => attempt(it),
        WriterMessage::Keep(
            _,
            EntryToKeep {
                entry: JournalEntry::Ended { .. },
                ..
            },
        ) => ROWS_MAX + ENDS_MAX,
        WriterMessage::Keep(
            _,
            EntryToKeep {
                entry: JournalEntry::Presence(_),
                ..
            },
        )
        | WriterMessage::Note(_) => ROWS_MAX,
        WriterMessage::Keep(..)
        | WriterMessage::WantEvents(_)
        | WriterMessage::EventTaken(_)
        | WriterMessage::Checked(_)
        | WriterMessage::Unused(_)
        | WriterMessage::Memory(_)
        | WriterMessage::Close => ROWS_MAX + ENDS_MAX + VITAL_MAX,
    }
}

#[derive(Debug, Default)]
struct WriterQueue {
    posts: Vec<WriterMessage>,
    lost: LostCounts,
    is_closed: bool,
}

/// A bounded inbox.
#[derive(Debug, Default)]
pub struct WriterInbox {
    queue: Mutex<WriterQueue>,
    bell: Condvar,
}

impl WriterInbox {
    /// Adds `post`, or counts it as lost if there is no room.
    pub fn put(&self, post: WriterMessage) {
        let mut queue = self.lock();
        queue.is_closed |= matches!(post, WriterMessage::Close);
        if queue.posts.len() >= room_for(&post) {
            let is_attempt = matches!(
                post,
                WriterMessage::Attempt(..)
                    | WriterMessage::Keep(
                        _,
                        EntryToKeep {
                            entry: JournalEntry::Attempt(_),
                            ..
                        }
                    )
            );
            queue.lost += LostCounts {
                attempts: is_attempt.into(),
                others: (!is_attempt).into(),
            };
            return;
        }
        queue.posts.push(post);
        let is_first = queue.posts.len() == 1;
        drop(queue);
        if is_first {
            self.bell.notify_one();
        }
    }

    /// Waits for posts, at most for `within`, and swaps them for the empty `batch`. Returns how many were lost since
    /// the last call, and whether the journal is to be closed.
    pub fn take(
        &self,
        batch: &mut Vec<WriterMessage>,
        within: Option<Duration>,
    ) -> (LostCounts, bool) {
        let queue = self.lock();
        let is_empty = |queue: &mut WriterQueue| queue.posts.is_empty() && !queue.is_closed;
        let mut queue = match within {
            None => self
                .bell
                .wait_while(queue, is_empty)
                .unwrap_or_else(PoisonError::into_inner),
            Some(within) => {
                self.bell
                    .wait_timeout_while(queue, within, is_empty)
                    .unwrap_or_else(PoisonError::into_inner)
                    .0
            }
        };
        std::mem::swap(&mut queue.posts, batch);
        (std::mem::take(&mut queue.lost), queue.is_closed)
    }

    fn lock(&self) -> MutexGuard<'_, WriterQueue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::{Order, Owner, Reason, Report};
    use crate::journal::{AttemptId, TriedWrite};

    fn refused(order: Order) -> WriterMessage {
        let tried = TriedWrite::Order(order);
        let report = Some(Report::refused(Reason::Tripped));
        let attempt = WriteAttempt {
            id: AttemptId(1),
            owner: Owner::Mqtt,
            tried,
            report,
        };
        WriterMessage::Attempt(1, None, MonoTime::ZERO, attempt)
    }

    #[test]
    fn a_flood_of_refusals_keeps_no_stop_out() {
        let inbox = WriterInbox::default();
        (0..ROWS_MAX + 5).for_each(|_| inbox.put(refused(Order::Reset)));
        inbox.put(refused(Order::Coast));
        inbox.put(WriterMessage::EventTaken(7));
        let mut batch = Vec::new();
        assert_eq!(
            inbox.take(&mut batch, None),
            (
                LostCounts {
                    attempts: 5,
                    others: 0
                },
                false
            )
        );
        assert_eq!(batch.len(), ROWS_MAX + 2);
        batch.clear();
        inbox.put(WriterMessage::Close);
        assert_eq!(inbox.take(&mut batch, None), (LostCounts::default(), true));
    }

    #[test]
    fn who_finds_nothing_waits_only_for_so_long() {
        let inbox = WriterInbox::default();
        let mut batch = Vec::new();
        assert_eq!(
            inbox.take(&mut batch, Some(Duration::from_millis(1))),
            (LostCounts::default(), false)
        );
        assert!(batch.is_empty());
    }
}
