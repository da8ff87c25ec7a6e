//! The copy of our last frame that a line may send back, told from a reply that looks the same.

use crate::domain::time::MonoTime;
use crate::wire::framing::Assembler;

/// The copy of our last frame, as long as it may come.
#[derive(Debug, Default)]
pub(super) struct OwnEcho {
    frame: Vec<u8>,
    is_awaited: bool,
    /// A copy of the frame is its echo: the right reply differs from it, or the line is known to echo.
    is_sure: bool,
    /// No drive's reply can have ended before this moment: a copy of the frame that has is an echo.
    earliest_reply: MonoTime,
}

impl OwnEcho {
    /// `frame` goes out. A copy of it is an echo if that `is_sure`, or if it comes before `earliest_reply`.
    pub fn await_copy_of(&mut self, frame: &[u8], is_sure: bool, earliest_reply: MonoTime) {
        self.frame.clear();
        self.frame.extend_from_slice(frame);
        (self.is_awaited, self.is_sure, self.earliest_reply) = (true, is_sure, earliest_reply);
    }

    /// Whether it may still come.
    pub const fn is_awaited(&self) -> bool {
        self.is_awaited
    }

    /// It comes no more: the exchange has ended.
    pub const fn is_over(&mut self) {
        self.is_awaited = false;
    }

    /// Takes the echo out of what was received until `now`, with what came before it.
    pub fn take_from(&mut self, assembler: &mut Assembler, now: MonoTime) -> Option<(Vec<u8>, Vec<u8>)> {
        if !self.is_awaited || !(self.is_sure || now < self.earliest_reply) {
            return None;
        }
        let noise = assembler.take_copy(&self.frame)?;
        self.is_awaited = false;
        Some((noise, self.frame.clone()))
    }
}
