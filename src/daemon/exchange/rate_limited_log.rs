//! What may happen thousands of times a second, in the log.

use std::cell::Cell;
use std::time::Duration;
use tokio::time::Instant;

/// Something is said this often; the rest is counted.
const TELL_EVERY: Duration = Duration::from_secs(1);

/// Says what may happen thousands of times a second, at most once a second.
#[derive(Debug, Default)]
pub struct RateLimitedLog {
    last: Cell<Option<Instant>>,
    unsaid: Cell<u64>,
}

impl RateLimitedLog {
    /// Says it, or counts it among what was not said.
    pub fn say(&self, what: &str) {
        let now = Instant::now();
        if self.last.get().is_some_and(|last| now.duration_since(last) < TELL_EVERY) {
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
