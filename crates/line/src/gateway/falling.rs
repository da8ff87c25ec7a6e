//! Detects a falling output frequency.

use crate::drive::run_state::ZEROS_FOR_STANDSTILL;

/// Number of consecutive readings that must not rise.
const FALLS: u8 = 2;

/// Readings of an output frequency that should fall.
#[derive(Debug, Default)]
pub struct OutputFallWatch {
    first: Option<u16>,
    last: Option<u16>,
    not_risen: u8,
    zeros: u8,
}

impl OutputFallWatch {
    /// Adds a reading.
    pub fn take(&mut self, raw: u16) {
        match self.last {
            Some(last) if raw <= last => self.not_risen = self.not_risen.saturating_add(1),
            Some(_) => {
                // It rises: earlier readings no longer count as a fall.
                self.first = Some(raw);
                self.not_risen = 0;
            }
            None => self.first = Some(raw),
        }
        self.last = Some(raw);
        self.zeros = if raw == 0 {
            self.zeros.saturating_add(1)
        } else {
            0
        };
    }

    /// Whether it is known to be at zero.
    pub const fn is_at_zero(&self) -> bool {
        self.zeros >= ZEROS_FOR_STANDSTILL
    }

    /// Whether it falls, by at least `least` steps so far, or is at zero. Less may be the noise of a steady speed.
    pub fn is_falling(&self, least: u16) -> bool {
        let (Some(first), Some(last)) = (self.first, self.last) else {
            return false;
        };
        self.is_at_zero()
            || (last > 0 && first.saturating_sub(last) >= least && self.not_risen >= FALLS)
    }
}
