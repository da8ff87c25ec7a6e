//! A start in several words: the run word turns the motor only after the others, in their order.

use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, RegisterRole};

/// How far a start has come.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StartReadiness {
    /// Number of words that the drive has followed.
    followed: usize,
    /// When the drive was given the last of the followed words.
    since: MonoTime,
    /// The drive follows none of them, as with an open enable terminal.
    is_held_back: bool,
    /// The drive shows `running` as long as it is ordered to run, and not while the motor still ramps down.
    shows_orders: bool,
}

impl StartReadiness {
    /// Holds the drive back, or lets it go.
    pub(super) const fn hold_back(&mut self, is_held_back: bool) {
        self.is_held_back = is_held_back;
        if is_held_back {
            self.followed = 0;
        }
    }

    /// The drive has followed all words of `model`.
    pub(super) fn complete(&mut self, model: &Model) {
        self.followed = model.start_steps().len();
    }

    /// The drive starts from the beginning again.
    pub(super) const fn begin_again(&mut self) {
        self.followed = 0;
    }

    /// Shows `running` only while the drive is ordered to run.
    pub(super) const fn show_orders(&mut self) {
        self.shows_orders = true;
    }

    /// Whether a motor that still turns is shown as running, without an order to run.
    pub(super) const fn shows_ramps(&self) -> bool {
        !self.shows_orders
    }

    /// The word of `step` was taken at `at`, by a drive that follows words of a start or not. Returns whether the drive falls
    /// back to an earlier state.
    pub(super) const fn take_step(&mut self, at: MonoTime, step: usize, follows: bool) -> bool {
        let falls_back = step + 1 < self.followed;
        if self.followed >= step && !self.is_held_back && follows {
            self.followed = step + 1;
            self.since = at;
        }
        falls_back
    }

    /// Whether the run word turns a motor that `runs` or not, written to the register at `address`, which `held` a word
    /// before. Where that register itself shows it, what counts is the word that it holds, no matter who wrote it and when: the
    /// drive obeys a change of it.
    pub(super) fn is_ready(
        &self,
        model: &Model,
        at: MonoTime,
        (address, held): (Address, u16),
        runs: bool,
    ) -> bool {
        let steps = model.start_steps();
        let by_word = steps
            .last()
            .and_then(|last| last.until.as_ref())
            .filter(|until| until.address == address);
        let Some(until) = by_word else {
            return self.followed == steps.len() && (runs || self.has_settled(model, at));
        };
        let is_before_it = self.followed + 1 >= steps.len() && !self.is_held_back;
        runs || (is_before_it && until.values.contains(&(held & until.mask)))
    }

    /// Whether the drive has had its time after the last word of the start, if time is all that it needs.
    fn has_settled(&self, model: &Model, at: MonoTime) -> bool {
        let steps = model.start_steps();
        let last = steps.last().filter(|step| step.until.is_none());
        last.is_none_or(|step| at.since(self.since) >= step.at_least)
    }

    /// `word` of the register at `address` with what a drive at rest shows of a start.
    pub(super) fn shown_in(&self, model: &Model, address: Address, word: u16) -> u16 {
        let steps = model.start_steps();
        let last = self
            .followed
            .checked_sub(1)
            .and_then(|last| steps.get(last));
        let until = last.and_then(|step| step.until.as_ref());
        // The register of run commands shows what was written there.
        let is_own = model
            .register_for(RegisterRole::RunCommand)
            .is_some_and(|run| run.address == address);
        match until {
            Some(until) if !is_own && until.address == address => {
                (word & !until.mask) | until.values.first().copied().unwrap_or_default()
            }
            _ => word,
        }
    }
}
