//! What babbles on a line of gateways: bytes that make no frame.

use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;

/// Somebody babbles.
#[derive(Clone, Debug)]
pub struct Jam {
    /// When its next bytes are over.
    pub next_at: MonoTime,
    /// When it ends.
    pub until: MonoTime,
    /// Longest pause between two of its bursts; zero if it never pauses.
    pub pause: Duration,
}

impl Jam {
    /// Whether nothing else can be said.
    pub const fn is_unbroken(&self) -> bool {
        self.pause.is_zero()
    }

    /// How many bytes come next, by a random number below 6.
    pub fn count(&self, random: u64) -> usize {
        if self.is_unbroken() {
            4
        } else {
            1 + usize::try_from(random).unwrap_or_default()
        }
    }

    /// The pause behind them, by a random number.
    pub fn pause(&self, random: u64) -> Duration {
        self.pause * u32::try_from(random % 1000).unwrap_or_default() / 1000
    }
}
