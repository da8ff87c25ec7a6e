//! What characters and silences cost on one line.

use crate::domain::link::LinkSettings;
use std::time::Duration;

/// Above this speed the silence no longer follows the character time (Modbus over serial line V1.02, 2.5.1.1).
pub const FIXED_SILENCE_ABOVE_BAUD: u32 = 19_200;
/// The silence above that speed.
pub const FIXED_SILENCE: Duration = Duration::from_micros(1_750);

/// Times of one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// Speed and character format.
    pub link: LinkSettings,
    /// Silence before each of our frames.
    pub silence: Duration,
    /// Whether characters take time at all: false only for a pseudo-terminal or a network port that was
    /// given a silence of its own.
    pub paced: bool,
}

impl Timing {
    /// Times of a line whose models ask for `gap_chars` characters each and at least `min_request_gap`.
    #[must_use]
    pub fn for_models(link: LinkSettings, gap_chars: impl IntoIterator<Item = f64>, min_request_gap: Duration) -> Self {
        let chars = gap_chars.into_iter().fold(3.5, f64::max);
        let fixed = if link.baud > FIXED_SILENCE_ABOVE_BAUD { FIXED_SILENCE } else { Duration::ZERO };
        Self { link, silence: link.chars(chars).max(fixed).max(min_request_gap), paced: true }
    }

    /// Times of a line without character times, for a pseudo-terminal or a network port.
    #[must_use]
    pub const fn unpaced(link: LinkSettings, silence: Duration) -> Self {
        Self { link, silence, paced: false }
    }

    /// Time that `bytes` bytes take on the wire.
    #[must_use]
    pub fn on_wire(&self, bytes: usize) -> Duration {
        if self.paced { self.link.bytes(bytes) } else { Duration::ZERO }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_gap_of_a_line_counts() {
        let link = LinkSettings::DEFAULT;
        let timing = Timing::for_models(link, [3.5, 4.5], Duration::ZERO);
        assert_eq!(timing.silence, Duration::from_nanos(4_687_500));
        let slow = Timing::for_models(link, [4.5], Duration::from_millis(20));
        assert_eq!(slow.silence, Duration::from_millis(20));
        let fast = LinkSettings { baud: 38_400, ..link };
        assert_eq!(Timing::for_models(fast, [4.5], Duration::ZERO).silence, FIXED_SILENCE);
    }
}
