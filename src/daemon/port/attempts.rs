//! How soon a port is opened again that could not be opened or was lost.

use std::time::Duration;

/// First wait before a port that could not be opened is retried; it doubles up to the longest.
const REOPEN_FIRST: Duration = Duration::from_millis(100);
/// Longest such wait: a replugged adapter is back within a second, including the first exchanges over it.
const REOPEN_MAX: Duration = Duration::from_millis(400);

/// How long to wait before a port is retried: longer each time, until it proves good.
#[derive(Debug)]
pub struct OpenBackoff {
    wait: Duration,
}

impl Default for OpenBackoff {
    fn default() -> Self {
        Self { wait: REOPEN_FIRST }
    }
}

impl OpenBackoff {
    /// How long to wait before the next attempt.
    pub fn next_wait(&mut self) -> Duration {
        let longer = (self.wait * 2).min(REOPEN_MAX);
        std::mem::replace(&mut self.wait, longer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_to_less_than_a_second() {
        let mut attempts = OpenBackoff::default();
        let waits: Vec<_> = (0..6).map(|_| attempts.next_wait().as_millis()).collect();
        assert_eq!(waits, [100, 200, 400, 400, 400, 400]);
    }
}
