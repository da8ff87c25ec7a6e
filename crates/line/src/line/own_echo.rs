//! The echo of our last frame, distinguished from a reply that looks the same.

use crate::domain::time::MonoTime;
use crate::wire::framing::FrameAssembler;

/// The echo of our last frame, as long as it may arrive.
#[derive(Debug, Default)]
pub(super) struct OwnEcho {
    frame: Vec<u8>,
    is_awaited: bool,
    /// A copy of the frame is certainly its echo: the valid reply differs from it, or the line is known to echo.
    is_sure: bool,
    /// No reply can be complete before this moment: an earlier copy of the frame is an echo.
    earliest_reply: MonoTime,
}

impl OwnEcho {
    /// `frame` is sent. A copy of it is an echo if `is_sure`, or if it arrives before `earliest_reply`.
    pub fn await_copy_of(&mut self, frame: &[u8], is_sure: bool, earliest_reply: MonoTime) {
        self.frame.clear();
        self.frame.extend_from_slice(frame);
        self.is_awaited = true;
        self.is_sure = is_sure;
        self.earliest_reply = earliest_reply;
    }

    /// Whether the echo of the last frame may still arrive.
    pub const fn is_awaited(&self) -> bool {
        self.is_awaited
    }

    /// The exchange has ended: it is no longer expected.
    pub const fn is_over(&mut self) {
        self.is_awaited = false;
    }

    /// Removes the echo from the data received until `now`; returns what preceded it and the echo.
    pub fn take_from(
        &mut self,
        assembler: &mut FrameAssembler,
        now: MonoTime,
    ) -> Option<(Vec<u8>, Vec<u8>)> {
        if !self.is_awaited || !(self.is_sure || now < self.earliest_reply) {
            return None;
        }
        let noise = assembler.take_copy(&self.frame)?;
        self.is_awaited = false;
        Some((noise, self.frame.clone()))
    }
}
