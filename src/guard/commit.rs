//! The words that take over or store what was written to parameters: which one follows an order, and whether it may.

use super::review::{CommandVerdict, DriveFacts, refused};
use super::state::DriveGuard;
use crate::domain::command::{CommandRequest, GoOrder, Reason, Report, RunIntent};
use crate::domain::control::ControlSettings;
use crate::domain::time::MonoTime;
use crate::drive::steps::{self, CommandStep};
use crate::profile::model::{CommitEffect, CommitWord};

impl DriveGuard {
    /// The word that follows what a client writes to registers by `go`; `None` if it needs none.
    ///
    /// # Errors
    /// Why it may not be sent now. Then nothing is written: what was written would not act, or would be lost unseen.
    pub(super) fn commit_of(
        &self,
        go: &GoOrder,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<Option<CommitWord>, Report> {
        let effect = if control.stores_native_writes {
            CommitEffect::Store
        } else {
            CommitEffect::Apply
        };
        if go.registers().is_empty() {
            return Ok(None);
        }
        let Some(word) = self.model.commit(effect) else {
            return Ok(None);
        };
        // The drive may be deaf afterwards, and an order to move must not wait for that.
        if go.run().is_some() || go.frequency().is_some() {
            return Err(refused(Reason::Conflict));
        }
        let may_turn = !facts.at_standstill || matches!(self.intent(), RunIntent::Run(_));
        if word.at_standstill && may_turn {
            return Err(refused(Reason::Moving));
        }
        self.may_wear(word, control, now)?;
        Ok(Some(word.clone()))
    }

    /// The word that follows what a person at the host sets, at standstill.
    pub(super) fn last_commit(
        &self,
        control: &ControlSettings,
        now: MonoTime,
    ) -> Result<Option<CommitWord>, Report> {
        let Some(word) = self.model.last_commit() else {
            return Ok(None);
        };
        self.may_wear(word, control, now)?;
        Ok(Some(word.clone()))
    }

    /// Whether `go` is a word of this model that takes over or stores parameters.
    pub(super) fn commits(&self, go: &GoOrder) -> Option<CommitWord> {
        let [write] = go.registers() else { return None };
        self.model.commit_at(write.address, write.value).cloned()
    }

    /// A person at the host has restored parameters: they are taken over or stored, once for all of them.
    pub(super) fn review_commit(
        &mut self,
        command: &CommandRequest,
        word: &CommitWord,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        self.may_wear(word, &control, now)?;
        self.may_change_at_rest(command, facts, now)?;
        let mut steps = Vec::new();
        self.commit_after(&mut steps, Some(word), now);
        Ok(CommandVerdict::Go(self.approve(
            command,
            command.order.clone(),
            steps,
        )))
    }

    /// Adds `word` behind `steps`, and remembers that it wears out the drive's memory if it does.
    pub(super) fn commit_after(
        &mut self,
        steps: &mut Vec<CommandStep>,
        word: Option<&CommitWord>,
        now: MonoTime,
    ) {
        if let Some(word) = word {
            steps.push(steps::of_commit(word));
            self.interlocks.stored(word, now);
        }
    }

    fn may_wear(
        &self,
        word: &CommitWord,
        control: &ControlSettings,
        now: MonoTime,
    ) -> Result<(), Report> {
        let is_worn =
            self.interlocks
                .was_written_within(control.stored_write_interval, word.address, now);
        if is_worn {
            Err(refused(Reason::WrittenTooOften))
        } else {
            Ok(())
        }
    }
}
