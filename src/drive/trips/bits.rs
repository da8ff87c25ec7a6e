//! Trips that each have a bit of one word, or of two.

use super::TripWatch;

impl TripWatch {
    /// Bits that this reading and the one before show cleared are no longer known, while others are still set.
    pub(super) fn forget_cleared(&mut self, bits: u32) {
        let Some(shown) = self.shown.filter(|_| self.places.as_ref().is_some_and(|places| places.is_bits)) else {
            return;
        };
        let cleared = shown & !bits;
        let gone = std::mem::replace(&mut self.fading, cleared) & cleared;
        if gone != 0 {
            self.shown = Some(shown & !gone);
            self.code = self.code.map(|code| code & !gone);
        }
    }
}
