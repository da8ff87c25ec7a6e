//! History of one drive that limits how often it is started and written.

use crate::domain::address::Address;
use crate::domain::command::RegisterWrite;
use crate::domain::time::MonoTime;
use crate::profile::model::{CommitEffect, CommitWord, Model};
use std::time::Duration;

/// The last start and the last writes of stored registers.
#[derive(Debug, Default)]
pub(super) struct StartInterlocks {
    started_at: Option<MonoTime>,
    /// When each stored register was last approved; no more than are listed as writable.
    written: Vec<(Address, MonoTime)>,
}

impl StartInterlocks {
    /// The motor was ordered to start, and the drive acknowledged it or may have received it.
    pub fn started(&mut self, now: MonoTime) {
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

    pub fn remember(&mut self, address: Address, now: MonoTime) {
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
