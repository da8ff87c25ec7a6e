//! Whether this process stood still: it was stopped, or its machine was suspended.

use crate::domain::time::MonoTime;
use std::time::Duration;

/// How often the clock is looked at by whoever waits.
pub const LOOK_EVERY: Duration = Duration::from_millis(250);
/// A busy machine does not let anybody wait so long for a turn.
const STALLED_AFTER: Duration = Duration::from_secs(1);

/// The turns of somebody who waits again and again.
#[derive(Debug)]
pub struct Turns(MonoTime);

impl Turns {
    /// The first turn.
    pub const fn new(now: MonoTime) -> Self {
        Self(now)
    }

    /// Another turn. Says how long ago the one before was, if that is too long.
    pub fn turn(&mut self, now: MonoTime) -> Option<Duration> {
        let stood = now.since(std::mem::replace(&mut self.0, now));
        (stood >= STALLED_AFTER).then_some(stood)
    }
}
