//! A reset in execution: a word that is written and then cleared by a stop, with a rest between them on some models.

use super::{Execution, Next, Repeats, STOPS_MAX, Stage, writes_of};
use crate::domain::command::{Outcome, Reason, Report};
use crate::drive::steps::{Step, StepPart, Write};
use std::time::Duration;

impl Execution {
    /// How long the drive will ignore requests although the execution is cut: its reset was sent, and the rest that follows
    /// has not begun. `is_on_the_wire`: the current step was sent.
    #[must_use]
    pub fn rest_to_come(&self, is_on_the_wire: bool) -> Option<Duration> {
        let (Stage::Step(index), Repeats::No) = (self.stage, self.repeats) else {
            return None;
        };
        let (sent, left) = self
            .approved
            .steps()
            .split_at_checked(index + usize::from(is_on_the_wire))?;
        let rest = left.iter().find_map(|step| match step {
            Step::Rest(rest) => Some(*rest),
            Step::Check { .. }
            | Step::Require { .. }
            | Step::Await(_)
            | Step::Skip(_)
            | Step::Pause(_)
            | Step::Write(_) => None,
        })?;
        let resets = |write: &Write| matches!(write.part, StepPart::Reset { resets: true, .. });
        sent.iter().flat_map(writes_of).any(resets).then_some(rest)
    }

    /// Whether the next request only clears a reset, or writes nothing.
    pub(super) fn takes_back(&self) -> bool {
        // On some models the last word is the reset word.
        let takes_back = |write: &Write| {
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
        let resets = |write: &Write| {
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
    pub(super) fn end_of_reset_unanswered(&mut self) -> Next {
        if let (Some(rest), Repeats::No) = (self.rest_step(), self.repeats) {
            self.rest_before_the_end(rest);
            return Next::Goes(None);
        }
        self.in_vain += 1;
        if self.in_vain < STOPS_MAX {
            return Next::Goes(None);
        }
        Next::Ends(Report::new(Outcome::Unknown, Reason::NoReply))
    }

    /// Continues with the rest at `rest`, and then repeats the write before it.
    pub(super) const fn rest_before_the_end(&mut self, rest: usize) {
        self.repeats = Repeats::AfterRest(rest.saturating_sub(1));
        self.stage = Stage::Step(rest);
    }

    pub(super) fn rest_step(&self) -> Option<usize> {
        self.approved
            .steps()
            .iter()
            .position(|step| matches!(step, Step::Rest(_)))
    }
}
