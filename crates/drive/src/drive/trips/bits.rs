//! Trips by their numbers, or that each have a bit of one word, or of two.

use super::TripWatch;

impl TripWatch {
    /// Bits that this reading and the one before show cleared are no longer known, while others are still set.
    pub(super) fn forget_cleared(&mut self, bits: u32) {
        let (Some(shown), Some(places)) = (self.shown, &self.places) else {
            return;
        };
        if !places.is_bits {
            return;
        }
        let cleared = shown & !bits;
        let gone = std::mem::replace(&mut self.fading, cleared) & cleared;
        if gone != 0 {
            self.shown = Some(shown & !gone);
            self.code = self.code.map(|code| code & !gone);
        }
    }
    /// Whether the number or bits `code` are of another trip than `last`, if that is known.
    pub(super) fn is_another(&self, code: u32, last: Option<u32>) -> bool {
        self.places
            .as_ref()
            .zip(last)
            .is_some_and(|(places, last)| places.is_another(code, last))
    }
}
