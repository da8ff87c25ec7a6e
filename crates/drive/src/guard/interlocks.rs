//! What keeps a motor from being moved: how often it was started and written, and an output that is not what was ordered.

use crate::domain::address::Address;
use crate::domain::command::RegisterWrite;
use crate::domain::time::MonoTime;
use crate::profile::model::{CommitEffect, CommitWord, Model};
use std::time::Duration;

/// The last start, the last writes of stored registers, and whether the output is right.
#[derive(Debug, Default)]
pub(super) struct StartInterlocks {
    started_at: Option<MonoTime>,
    /// When each stored register was last approved; no more than are listed as writable.
    written: Vec<(Address, MonoTime)>,
    /// The output was seen outside the limits or far from the setpoint, and not right since.
    is_output_outside: bool,
}

impl StartInterlocks {
    pub const fn output_is_outside(&mut self, is_outside: bool) {
        self.is_output_outside = is_outside;
    }

    pub const fn is_output_outside(&self) -> bool {
        self.is_output_outside
    }

    /// The motor was ordered to start, and the drive acknowledged it or may have received it.
    pub const fn started(&mut self, now: MonoTime) {
        self.started_at = Some(now);
    }

    /// Whether a start now would follow the last one within `interval`.
    pub fn is_too_soon(&self, interval: Duration, now: MonoTime) -> bool {
        self.started_at.is_some_and(|at| now.since(at) < interval)
    }

    /// `writes` were approved: remembers those to stored registers.
    pub fn approved(&mut self, model: &Model, writes: &[RegisterWrite], now: MonoTime) {
        for RegisterWrite { address, .. } in
            writes.iter().filter(|write| model.is_stored(write.address))
        {
            self.remember(*address, now);
        }
    }

    /// The drive was ordered to store what was written before.
    pub fn stored(&mut self, word: &CommitWord, now: MonoTime) {
        if word.effect == CommitEffect::Store {
            self.remember(word.address, now);
        }
    }

    fn remember(&mut self, address: Address, now: MonoTime) {
        match self
            .written
            .iter_mut()
            .find(|(written, _)| *written == address)
        {
            Some((_, at)) => *at = now,
            None => self.written.push((address, now)),
        }
    }

    /// Whether the stored register at `address` was written within `interval`.
    pub fn was_written_within(&self, interval: Duration, address: Address, now: MonoTime) -> bool {
        self.written
            .iter()
            .any(|(written, at)| *written == address && now.since(*at) < interval)
    }
}
