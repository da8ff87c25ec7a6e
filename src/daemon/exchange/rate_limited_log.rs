//! A log for events that may happen thousands of times a second.

use std::cell::Cell;
use std::time::Duration;
use tokio::time::Instant;

/// At most one line in this time; the rest is counted.
const TELL_EVERY: Duration = Duration::from_secs(1);

/// Logs at most one line a second and counts the others.
#[derive(Debug, Default)]
pub struct RateLimitedLog {
    last: Cell<Option<Instant>>,
    unsaid: Cell<u64>,
}

impl RateLimitedLog {
    /// Logs `what`, or counts it as left out.
    pub fn say(&self, what: &str) {
        let now = Instant::now();
        if self
            .last
            .get()
            .is_some_and(|last| now.duration_since(last) < TELL_EVERY)
        {
            self.unsaid.set(self.unsaid.get() + 1);
            return;
        }
        self.last.set(Some(now));
        match self.unsaid.take() {
            0 => tracing::warn!("{what}"),
            more => tracing::warn!(more, "{what}"),
        }
    }
}
