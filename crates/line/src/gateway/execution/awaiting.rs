//! A command that waits for the drive between two writes: a register is read until it shows what the next write needs.

use super::read_back::LOOK_EVERY;
use super::{CommandExecution, CommandStage, StepResult};
use crate::domain::address::Address;
use crate::domain::command::{Outcome, Report};
use crate::domain::time::MonoTime;
use crate::drive::steps::{AwaitStep, CommandStep, StepPart};
use std::time::Duration;

impl CommandExecution {
    /// The register that is read now because the order rests on it: the drive's identity, or a setting.
    pub(super) fn required_register(&self) -> Option<Address> {
        let CommandStage::Step(index) = self.stage else {
            return None;
        };
        match self.approved.steps().get(index)? {
            CommandStep::Require { address, .. } => Some(*address),
            CommandStep::Check { .. }
            | CommandStep::Await(_)
            | CommandStep::Skip(_)
            | CommandStep::Pause(_)
            | CommandStep::Rest(_)
            | CommandStep::Write(_) => None,
        }
    }

    /// The drive shows `word` at `now`, and the step at `index` waits for it. A drive that does not show in time what it
    /// must is sent nothing more.
    pub(super) fn awaited(&mut self, index: usize, word: Option<u16>, now: MonoTime) -> StepResult {
        let (Some(CommandStep::Await(wait)), Some(word)) = (self.approved.steps().get(index), word)
        else {
            return self.unanswered();
        };
        let AwaitStep {
            condition, reason, ..
        } = wait;
        if condition.is_met(word) {
            return self.go_on_from(index, now);
        }
        let register = condition.address;
        let until = *self.shown_until.get_or_insert(now + condition.within);
        if now < until {
            self.ready_at = now + LOOK_EVERY;
            self.in_vain = 0;
            return StepResult::Goes(None);
        }
        let failed = Report::new(Outcome::Failed, *reason);
        StepResult::Ends(Report {
            held: Some(word),
            register: Some(register),
            ..failed
        })
    }

    /// How long its steps may wait, all together.
    pub(super) fn waits(&self) -> Duration {
        let waits = self.approved.steps().iter().filter_map(|step| match step {
            CommandStep::Await(wait) => Some(wait.at_least + wait.condition.within),
            CommandStep::Pause(pause) => Some(*pause),
            _ => None,
        });
        waits.sum()
    }

    /// Whether the next request writes a word of a start, or the run word.
    #[must_use]
    pub fn starts(&self) -> bool {
        self.present_writes()
            .iter()
            .any(|write| matches!(write.part, StepPart::Start | StepPart::Run(_)))
    }

    /// Whether the run word was sent, and all that is left is to see its effect.
    #[must_use]
    pub const fn is_reading_back(&self) -> bool {
        matches!(
            self.stage,
            CommandStage::ReadBack(..) | CommandStage::Resolve(..) | CommandStage::Done
        )
    }

    /// When the step at `index`, which follows a write at `now`, may be sent.
    pub(super) fn not_before(&self, index: usize, now: MonoTime) -> MonoTime {
        match self.approved.steps().get(index) {
            Some(CommandStep::Await(wait)) => now + wait.at_least,
            _ => self.ready_at,
        }
    }
}
