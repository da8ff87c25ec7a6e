//! Read-back of a command: each condition of its steps is read until it is met, or until its time is over.

use super::{CommandExecution, CommandStage, StepResult, writes_of};
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::steps::{RegisterCondition, StepPart};
use std::time::Duration;

/// Maximum number of attempts for a read.
pub(super) const READS_MAX: u8 = 3;
/// Time between two reads of a condition that is not met yet.
pub(super) const LOOK_EVERY: Duration = Duration::from_millis(50);

impl CommandExecution {
    /// Checks `words` against the condition `shown` of the step at `index`, and against the following ones in the same
    /// register.
    pub(super) fn shown(
        &mut self,
        index: usize,
        shown: usize,
        words: &[u16],
        now: MonoTime,
    ) -> StepResult {
        let Some(condition) = self.condition(index, shown) else {
            return self.end();
        };
        let address = condition.address;
        let within = condition.within;
        let of_register = (shown..)
            .map_while(|at| self.condition(index, at))
            .take_while(|it| it.address == address);
        let (looked_at, all_met) = of_register.fold((0, true), |(n, all), it| {
            (n + 1, all && it.is_met_by(words))
        });
        if all_met {
            return self.is_shown(index, shown + looked_at);
        }
        let until = *self.shown_until.get_or_insert(now + within);
        if now < until {
            self.ready_at = now + LOOK_EVERY;
            self.in_vain = 0;
            return StepResult::Goes(None);
        }
        let reason = if matches!(self.stage, CommandStage::Resolve(..)) {
            Reason::NoReply
        } else {
            Reason::NotReadBack
        };
        StepResult::Ends(Report {
            held: words.first().copied(),
            ..Report::new(Outcome::Failed, reason)
        })
    }

    /// The step at `index` has shown everything up to its condition `next`.
    fn is_shown(&mut self, index: usize, next: usize) -> StepResult {
        let resolves = matches!(self.stage, CommandStage::Resolve(..));
        let stage = if resolves {
            CommandStage::Resolve
        } else {
            CommandStage::ReadBack
        };
        if self.condition(index, next).is_some() {
            self.look_at(stage(index, next));
            return StepResult::Goes(None);
        }
        let mut behind = self.approved.steps().iter().skip(index + 1);
        match self.next_shown(index + 1) {
            // The writes after an unanswered one were never sent.
            _ if resolves && behind.any(|step| !writes_of(step).is_empty()) => {
                StepResult::Ends(Report::new(Outcome::Failed, Reason::NoReply))
            }
            Some(step) if !resolves => {
                self.look_at(CommandStage::ReadBack(step, 0));
                StepResult::Goes(None)
            }
            _ => self.end(),
        }
    }

    /// The step at `index` was not answered: its conditions are read, if it has any.
    pub(super) fn resolve(&mut self, index: usize) -> StepResult {
        let report = Report::new(Outcome::Unknown, Reason::NoReply);
        if self.condition(index, 0).is_none() {
            return StepResult::Ends(report);
        }
        self.look_at(CommandStage::Resolve(index, 0));
        StepResult::Goes(Some(report))
    }

    pub(super) fn look_at(&mut self, stage: CommandStage) {
        self.stage = stage;
        self.in_vain = 0;
        self.shown_until = None;
    }

    pub(super) fn read_again(&mut self) -> StepResult {
        self.in_vain += 1;
        if self.in_vain < READS_MAX {
            StepResult::Goes(None)
        } else {
            self.give_up_reading()
        }
    }

    pub(super) fn give_up_reading(&mut self) -> StepResult {
        StepResult::Ends(match self.stage {
            CommandStage::Step(_) if self.has_begun => {
                Report::new(Outcome::Failed, Reason::NoReply)
            }
            CommandStage::Step(_) => Report::refused(Reason::NoReply),
            CommandStage::ReadBack(..) if self.is_unanswered => {
                Report::new(Outcome::Unknown, Reason::NoReply)
            }
            CommandStage::ReadBack(..) | CommandStage::Done => {
                Report::new(Outcome::Acknowledged, Reason::NoReply)
            }
            CommandStage::Resolve(..) => Report::new(Outcome::Unknown, Reason::NoReply),
        })
    }

    /// The first step from `from` on with a visible effect.
    pub(super) fn next_shown(&self, from: usize) -> Option<usize> {
        (from..self.approved.steps().len()).find(|index| self.condition(*index, 0).is_some())
    }

    /// The condition `shown` of the step at `index`.
    pub(super) fn condition(&self, index: usize, shown: usize) -> Option<&RegisterCondition> {
        let step = self.approved.steps().get(index)?;
        writes_of(step)
            .iter()
            .flat_map(|write| &write.shown)
            .nth(shown)
    }

    /// The drive has said nothing to the current step. `None` if it should have answered.
    pub fn silent_as_announced(&mut self, now: MonoTime) -> Option<StepResult> {
        let CommandStage::Step(index) = self.stage else {
            return None;
        };
        let is_announced = self
            .present_writes()
            .iter()
            .any(|write| self.approved.is_silent(write));
        is_announced.then(|| {
            self.is_unanswered = true;
            self.go_on_from(index, now)
        })
    }

    /// The parts that have taken effect if the execution ends as confirmed, although the drive answered none of them.
    #[must_use]
    pub fn parts_in_question(&self) -> Vec<StepPart> {
        let steps = self.approved.steps();
        match self.stage {
            CommandStage::Resolve(index, _) => steps
                .get(index)
                .map_or(&[][..], writes_of)
                .iter()
                .map(|write| write.part)
                .collect(),
            CommandStage::ReadBack(..) if self.is_unanswered => {
                let silent = steps
                    .iter()
                    .flat_map(writes_of)
                    .filter(|write| self.approved.is_silent(write));
                silent.map(|write| write.part).collect()
            }
            CommandStage::ReadBack(..) | CommandStage::Step(_) | CommandStage::Done => Vec::new(),
        }
    }
}
