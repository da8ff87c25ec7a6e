//! A pause in the middle of a reply.

use super::super::exchange::{Exchange, ExchangeEnding};
use super::super::timing::ADAPTER_HOLE;
use super::LineWire;
use crate::domain::time::MonoTime;

impl LineWire {
    /// `count` bytes were read at `now`. If the pause before them is longer than any adapter inserts, the data before it
    /// is complete: a truncated reply and the end of another one long after it are not a frame, even if the CRC matches.
    /// Returns how the open exchange ended, if it did.
    pub(super) fn end_before_hole(
        &mut self,
        now: MonoTime,
        count: usize,
    ) -> Option<(Exchange, ExchangeEnding)> {
        let hole = now
            .before(self.timing.on_wire(count))
            .since(self.last_byte_at);
        if !self.is_timed
            || self.assembler.is_empty()
            || hole <= ADAPTER_HOLE.max(self.timing.silence)
        {
            return None;
        }
        let ended = self.take_frames(true);
        let is_damaged = self.holds_damaged_reply();
        self.open
            .iter_mut()
            .for_each(|open| open.was_damaged |= is_damaged);
        self.flush_idle_bytes();
        ended
    }
}
