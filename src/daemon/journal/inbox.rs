//! The inbox of the journal's writer. Adding to it never blocks.

use crate::daemon::exchange::origin::Origin;
use crate::domain::ids::Name;
use crate::domain::time::MonoTime;
use crate::journal::audit::Lost;
use crate::journal::words::is_stop;
use crate::journal::{Attempt, Entry, Keep, Remembered, Row};
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
pub enum Post {
    /// A row of a line.
    Keep(Arc<Origin>, Keep),
    /// An attempt that a north side refused: the number of that side, the drive if one was named, and when.
    Attempt(u64, Option<Name>, MonoTime, Attempt),
    /// A change of availability.
    Note(Row),
    /// The MQTT side has room for the events after this one.
    WantEvents(u64),
    /// The broker has this event.
    EventTaken(u64),
    /// Problems found by the check of the whole file.
    Checked(Vec<String>),
    /// Drives that no row mentions any more.
    Unused(Vec<Name>),
    /// A request for the remembered state of each drive.
    Memory(oneshot::Sender<BTreeMap<Name, Remembered>>),
    /// The gateway shuts down.
    Close,
}

/// How many posts may wait before one of this kind.
fn room_for(post: &Post) -> usize {
    let attempt = |attempt: &Attempt| match (is_stop(&attempt.tried), attempt.report) {
        (true, _) => ROWS_MAX + ENDS_MAX + VITAL_MAX,
        (false, None) => ROWS_MAX + ENDS_MAX,
        (false, Some(_)) => ROWS_MAX,
    };
    match post {
        Post::Attempt(_, _, _, it)
        | Post::Keep(
            _,
            Keep {
                entry: Entry::Attempt(it),
                ..
            },
        ) => attempt(it),
        Post::Keep(
            _,
            Keep {
                entry: Entry::Ended { .. },
                ..
            },
        ) => ROWS_MAX + ENDS_MAX,
        Post::Keep(
            _,
            Keep {
                entry: Entry::Presence(_),
                ..
            },
        )
        | Post::Note(_) => ROWS_MAX,
        Post::Keep(..)
        | Post::WantEvents(_)
        | Post::EventTaken(_)
        | Post::Checked(_)
        | Post::Unused(_)
        | Post::Memory(_)
        | Post::Close => ROWS_MAX + ENDS_MAX + VITAL_MAX,
    }
}

#[derive(Debug, Default)]
struct Queue {
    posts: Vec<Post>,
    lost: Lost,
    is_closed: bool,
}

/// A bounded inbox.
#[derive(Debug, Default)]
pub struct Inbox {
    queue: Mutex<Queue>,
    bell: Condvar,
}

impl Inbox {
    /// Adds `post`, or counts it as lost if there is no room.
    pub fn put(&self, post: Post) {
        let mut queue = self.lock();
        queue.is_closed |= matches!(post, Post::Close);
        if queue.posts.len() >= room_for(&post) {
            let is_attempt = matches!(
                post,
                Post::Attempt(..)
                    | Post::Keep(
                        _,
                        Keep {
                            entry: Entry::Attempt(_),
                            ..
                        }
                    )
            );
            queue.lost += Lost {
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
    pub fn take(&self, batch: &mut Vec<Post>, within: Option<Duration>) -> (Lost, bool) {
        let queue = self.lock();
        let is_empty = |queue: &mut Queue| queue.posts.is_empty() && !queue.is_closed;
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

    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::{Order, Owner, Reason, Report};
    use crate::journal::{AttemptId, Tried};

    fn refused(order: Order) -> Post {
        let tried = Tried::Order(order);
        let report = Some(Report::refused(Reason::Tripped));
        let attempt = Attempt {
            id: AttemptId(1),
            owner: Owner::Mqtt,
            tried,
            report,
        };
        Post::Attempt(1, None, MonoTime::ZERO, attempt)
    }

    #[test]
    fn a_flood_of_refusals_keeps_no_stop_out() {
        let inbox = Inbox::default();
        (0..ROWS_MAX + 5).for_each(|_| inbox.put(refused(Order::Reset)));
        inbox.put(refused(Order::Coast));
        inbox.put(Post::EventTaken(7));
        let mut batch = Vec::new();
        assert_eq!(
            inbox.take(&mut batch, None),
            (
                Lost {
                    attempts: 5,
                    others: 0
                },
                false
            )
        );
        assert_eq!(batch.len(), ROWS_MAX + 2);
        batch.clear();
        inbox.put(Post::Close);
        assert_eq!(inbox.take(&mut batch, None), (Lost::default(), true));
    }

    #[test]
    fn who_finds_nothing_waits_only_for_so_long() {
        let inbox = Inbox::default();
        let mut batch = Vec::new();
        assert_eq!(
            inbox.take(&mut batch, Some(Duration::from_millis(1))),
            (Lost::default(), false)
        );
        assert!(batch.is_empty());
    }
}
