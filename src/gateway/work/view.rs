//! What is shown of the drive's own work.

use super::DriveWork;
use crate::drive::view::{ControlView, RunState, StoppedAgain};

impl DriveWork {
    /// The run state of the drive.
    #[must_use]
    pub fn run_state(&self, is_offline: bool) -> RunState {
        if is_offline {
            RunState::Offline
        } else if self.trips.is_contradicted() {
            RunState::Unknown
        } else if self.trips.view().active == Some(true) {
            RunState::Tripped
        } else {
            self.output
                .run_state(&self.status, self.ordered(), self.is_stopping)
        }
    }

    /// Control, as shown to clients; `None` without a control section.
    #[must_use]
    pub fn control_view(&self) -> Option<ControlView> {
        let guard = &self.guard;
        guard.control()?;
        Some(ControlView {
            lease: guard.lease(),
            intent: guard.intent(),
            setpoint: guard.setpoint(),
            start_inhibited: guard.is_start_inhibited(),
            command_pending: self.has_orders(),
            stop_pending: self.latch.is_some(),
            not_effective: self
                .latch
                .as_ref()
                .is_some_and(|latch| latch.is_late() || latch.is_refused()),
            output_outside: self.outside.is_told,
            stopped_elsewhere: self.is_stopped_elsewhere,
            failsafe: guard.fail_safe(),
            epoch: guard.epoch(),
            last: self.last,
            commands: self.commands,
            stopped_again: self
                .again
                .filter(|again| again.times >= StoppedAgain::TOLD_FROM),
        })
    }
}
