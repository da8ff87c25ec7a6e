//! Whether the drive still follows its order to run. One that was seen running and then shows for a while that it neither
//! runs nor ramps was stopped elsewhere: by its panel, a terminal, another master, or a dip of its supply.

use super::motor::MotorReadings;
use crate::domain::command::{Direction, RunIntent};
use crate::domain::time::MonoTime;
use crate::guard::DriveGuard;
use crate::profile::model::IndicatedState;
use std::time::Duration;

/// Number of readings in a row after which the order is over.
const READINGS: u8 = 3;
/// The least time between the first and the last of them.
const LASTS: Duration = Duration::from_secs(2);

/// What the drive has shown since it was ordered to run.
#[derive(Debug, Default)]
pub(super) struct FollowWatch {
    /// It was seen running.
    has_run: bool,
    /// The last readings in a row that show it at rest, and when the first of them arrived.
    at_rest: u8,
    since: MonoTime,
    /// The drive has stopped following its last order to run.
    is_stopped_elsewhere: bool,
}

impl FollowWatch {
    /// Whether the drive has stopped following its last order to run.
    pub const fn is_stopped_elsewhere(&self) -> bool {
        self.is_stopped_elsewhere
    }

    /// Takes a reading of the status at `now`: the drive shows whether it is ordered to run (`running`). Returns the direction
    /// of an order that it has stopped following.
    pub fn take(
        &mut self,
        running: bool,
        motor: &MotorReadings,
        stops: bool,
        guard: &DriveGuard,
        now: MonoTime,
    ) -> Option<Direction> {
        let status = motor.model().status_flag(IndicatedState::Running);
        let is_proven = status.is_some_and(|flag| flag.confidence.is_proven());
        // What else is on its way does not change the order that the drive has acknowledged.
        let direction = match guard.intent() {
            RunIntent::Run(direction) if !stops && guard.is_run_acknowledged() && is_proven => {
                direction
            }
            _ => {
                self.restart(self.is_stopped_elsewhere);
                return None;
            }
        };
        self.has_run |= running;
        if running || motor.ramps_or_shows_output() {
            self.at_rest = 0;
            return None;
        }
        if self.at_rest == 0 {
            self.since = now;
        }
        self.at_rest = self.at_rest.saturating_add(1);
        if !self.has_run || self.at_rest < READINGS || now.since(self.since) < LASTS {
            return None;
        }
        self.restart(true);
        Some(direction)
    }

    fn restart(&mut self, is_stopped_elsewhere: bool) {
        *self = Self {
            is_stopped_elsewhere,
            ..Self::default()
        };
    }
}
