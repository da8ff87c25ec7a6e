//! A write that the drive never answers: it is sent once, and a later read shows its outcome.

use super::{CommandExecution, CommandStage, StepResult, writes_of};
use crate::domain::time::MonoTime;
use crate::drive::steps::StepPart;

impl CommandExecution {
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
