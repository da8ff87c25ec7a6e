//! A reset in execution: a word that is written and then cleared by a stop, with a rest between them on some models.

use super::{CommandExecution, CommandStage, ResetRepeats, STOPS_MAX, StepResult, writes_of};
use crate::domain::command::{Outcome, Reason, Report};
use crate::drive::steps::{CommandStep, StepPart, WriteStep};
use std::time::Duration;

impl CommandExecution {
    /// How long the drive will ignore requests although the execution is cut: its reset was sent, and the rest that follows
    /// has not begun. `is_on_the_wire`: the current step was sent.
    #[must_use]
    pub fn rest_to_come(&self, is_on_the_wire: bool) -> Option<Duration> {
        let (CommandStage::Step(index), ResetRepeats::No) = (self.stage, self.repeats) else {
            return None;
        };
        let (sent, left) = self
            .approved
            .steps()
            .split_at_checked(index + usize::from(is_on_the_wire))?;
        let rest = left.iter().find_map(|step| match step {
            CommandStep::Rest(rest) => Some(*rest),
            CommandStep::Check { .. }
            | CommandStep::Require { .. }
            | CommandStep::Await(_)
            | CommandStep::Skip(_)
            | CommandStep::Pause(_)
            | CommandStep::Write(_) => None,
        })?;
        let resets = |write: &WriteStep| matches!(write.part, StepPart::Reset { resets: true, .. });
        sent.iter().flat_map(writes_of).any(resets).then_some(rest)
    }

    /// Whether the next request only clears a reset, or writes nothing.
    pub(super) fn takes_back(&self) -> bool {
        // On some models the last word is the reset word.
        let takes_back = |write: &WriteStep| {
            let clears = matches!(
                write.part,
                StepPart::Reset {
                    ends: true,
                    resets: false,
                    ..
                }
            );
            clears || matches!(write.part, StepPart::TakesBack | StepPart::TakesStartBack)
        };
        self.present_writes().iter().all(takes_back)
    }

    /// Whether the next request writes the reset word, which a later one clears.
    #[must_use]
    pub fn leaves_a_reset_standing(&self) -> bool {
        let resets = |write: &WriteStep| {
            matches!(
                write.part,
                StepPart::Reset {
                    ends: false,
                    resets: true,
                    ..
                }
            )
        };
        self.present_writes().iter().any(resets)
    }

    /// The stop that clears the reset bit was not answered. It must not be skipped: if the drive ignores requests after a
    /// reset, it is sent again after the rest, and then until it is answered.
    pub(super) fn end_of_reset_unanswered(&mut self) -> StepResult {
        if let (Some(rest), ResetRepeats::No) = (self.rest_step(), self.repeats) {
            self.rest_before_the_end(rest);
            return StepResult::Goes(None);
        }
        self.in_vain += 1;
        if self.in_vain < STOPS_MAX {
            return StepResult::Goes(None);
        }
        StepResult::Ends(Report::new(Outcome::Unknown, Reason::NoReply))
    }

    /// Continues with the rest at `rest`, and then repeats the write before it.
    pub(super) const fn rest_before_the_end(&mut self, rest: usize) {
        self.repeats = ResetRepeats::AfterRest(rest.saturating_sub(1));
        self.stage = CommandStage::Step(rest);
    }

    pub(super) fn rest_step(&self) -> Option<usize> {
        self.approved
            .steps()
            .iter()
            .position(|step| matches!(step, CommandStep::Rest(_)))
    }
}
