//! Detects that this process did not run for a while: it was stopped, or the machine was suspended.
//!
//! What arrived meanwhile waited in sockets, and its senders have long given up: only a stop is valid at any age.

use crate::daemon::host::clock;
use crate::domain::time::MonoTime;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often a waiting task reads the clock.
pub const LOOK_EVERY: Duration = Duration::from_millis(250);
/// Even a busy machine does not delay a turn for this long.
const STALLED_AFTER: Duration = Duration::from_secs(1);
/// For this long after a stall, what arrived meanwhile is still being read.
const READ_WITHIN: Duration = Duration::from_secs(1);

/// The turns of a task that waits repeatedly.
#[derive(Debug)]
pub struct StallDetector(MonoTime);

impl StallDetector {
    /// The first turn.
    pub const fn new(now: MonoTime) -> Self {
        Self(now)
    }

    /// Notes another turn. Returns the time since the one before, if that is too long.
    pub fn turn(&mut self, now: MonoTime) -> Option<Duration> {
        let stood = now.since(std::mem::replace(&mut self.0, now));
        (stood >= STALLED_AFTER).then_some(stood)
    }
}

/// The last stall, for all tasks that serve connections. Without [`watch`](Self::watch) none is found.
#[derive(Debug, Default)]
pub struct LastStalls(Mutex<LastStall>);

#[derive(Debug, Default)]
struct LastStall {
    turns: Option<StallDetector>,
    /// When the last stall was over.
    ended: Option<MonoTime>,
}

impl LastStalls {
    /// A stall that has just ended, however long a test takes.
    #[cfg(test)]
    pub fn just_ended() -> Self {
        Self(Mutex::new(LastStall {
            turns: None,
            ended: Some(clock::now() + Duration::from_secs(3600)),
        }))
    }

    /// Watches the clock until the task is dropped.
    pub async fn watch(self: Arc<Self>) {
        self.lock().turns = Some(StallDetector::new(clock::now()));
        loop {
            tokio::time::sleep(LOOK_EVERY).await;
            self.find_stall(clock::now());
        }
    }

    /// Whether what is read `now` may have waited for the end of a stall, if the socket was read empty at `emptied`.
    pub fn may_have_waited(&self, now: MonoTime, emptied: MonoTime) -> bool {
        self.find_stall(now)
            .is_some_and(|ended| emptied < ended && now.since(ended) < READ_WITHIN)
    }

    /// The first call after a stall finds it. Returns when the last one was over.
    fn find_stall(&self, now: MonoTime) -> Option<MonoTime> {
        let mut seen = self.lock();
        if let Some(stood) = seen.turns.as_mut().and_then(|turns| turns.turn(now)) {
            tracing::warn!(
                ?stood,
                "process was suspended; executing only STOPs received meanwhile"
            );
            seen.ended = Some(now);
        }
        seen.ended
    }

    fn lock(&self) -> MutexGuard<'_, LastStall> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> MonoTime {
        MonoTime::ZERO + Duration::from_millis(ms)
    }

    fn watched_at(ms: u64) -> LastStalls {
        LastStalls(Mutex::new(LastStall {
            turns: Some(StallDetector::new(at(ms))),
            ended: None,
        }))
    }

    #[test]
    fn what_was_there_at_the_end_of_a_stall_may_have_waited_until_all_of_it_is_read() {
        let stalls = watched_at(0);
        assert!(!stalls.may_have_waited(at(999), at(0)), "a busy machine");
        assert!(
            stalls.may_have_waited(at(1_999), at(999)),
            "whoever reads first sees the stall"
        );
        assert!(stalls.may_have_waited(at(2_500), at(999)));
        assert!(
            !stalls.may_have_waited(at(2_500), at(1_999)),
            "it was read empty since"
        );
        assert!(
            !stalls.may_have_waited(at(2_999), at(999)),
            "nobody is read so late"
        );
    }

    #[test]
    fn nothing_has_waited_where_nobody_watches() {
        let stalls = LastStalls::default();
        assert!(!stalls.may_have_waited(at(0), at(0)) && !stalls.may_have_waited(at(9_000), at(0)));
    }
}
