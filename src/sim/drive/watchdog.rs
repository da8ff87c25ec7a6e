//! The drive's own communication watchdog.

use super::SimDrive;
use super::memory::{index_of, time};
use crate::domain::time::MonoTime;
use crate::sim::motor::Motor;

/// The reaction of a drive to a bus that has been silent for too long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WatchdogReaction {
    Decelerate,
    Coast,
    /// Trips with the number for a lost communication.
    Trip(u16),
    Keep,
}

impl SimDrive {
    /// Lets time pass until `at`: the watchdog may act.
    pub fn advance(&mut self, at: MonoTime) {
        self.follow_reset(at);
        let Some(due) = self.watchdog_due().filter(|due| *due <= at) else {
            return;
        };
        self.has_expired = true;
        self.report.watchdog_expiries += 1;
        match self.reaction() {
            WatchdogReaction::Decelerate => self.run(due, 0, false),
            WatchdogReaction::Coast => self.cut_off(due),
            WatchdogReaction::Trip(code) => self.trip(due, code),
            WatchdogReaction::Keep => {}
        }
    }

    /// The motor at `at` if the bus stays silent until then.
    pub(super) fn motor_at(&self, at: MonoTime) -> Motor {
        let mut motor = self.motor.clone();
        if let Some(due) = self.watchdog_due().filter(|due| *due <= at) {
            match self.reaction() {
                WatchdogReaction::Decelerate => motor.ramp_to(due, 0),
                WatchdogReaction::Coast | WatchdogReaction::Trip(_) => motor.cut_off(due),
                WatchdogReaction::Keep => {}
            }
        }
        motor
    }

    /// When the watchdog acts if the bus stays silent; `None` if it is off, or there is nothing to stop.
    fn watchdog_due(&self) -> Option<MonoTime> {
        let watchdog = self.model.watchdog.as_ref()?;
        let index = index_of(&self.model, watchdog.time)?;
        let word = self.memory.word(index);
        let watches = self.powered
            && self.control.direction != 0
            && self.is_run_from_bus()
            && !self.has_expired;
        (watches && word != watchdog.off.value)
            .then(|| self.last_heard + time(&self.model.registers[index], word))
    }

    /// The reaction in the action register, from the meaning of its word. Without a meaning, the drive trips if it has a
    /// number for that, else it stops.
    fn reaction(&self) -> WatchdogReaction {
        let action = self
            .model
            .watchdog
            .as_ref()
            .and_then(|watchdog| watchdog.action);
        let index = action.and_then(|address| index_of(&self.model, address));
        let text =
            index.and_then(|index| self.model.registers[index].meaning(self.memory.word(index)));
        let is_lost = |text: &str| text.to_lowercase().contains("communication");
        let code = self
            .model
            .trip_codes
            .iter()
            .find(|it| is_lost(&it.text))
            .map(|it| it.code);
        let Some(text) = text.map(str::to_lowercase) else {
            return code.map_or(WatchdogReaction::Decelerate, WatchdogReaction::Trip);
        };
        let says = |parts: &[&str]| parts.iter().any(|part| text.contains(part));
        match code {
            _ if says(&["keep", "continu"]) => WatchdogReaction::Keep,
            Some(code) if says(&["trip", "fault"]) => WatchdogReaction::Trip(code),
            _ if says(&["trip", "fault", "coast"]) => WatchdogReaction::Coast,
            _ => WatchdogReaction::Decelerate,
        }
    }
}
