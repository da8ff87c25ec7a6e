//! The drive's own communication watchdog.

use super::memory::{SimMemory, index_of, time};
use crate::domain::time::MonoTime;
use crate::profile::model::Model;

/// The watchdog of one drive.
#[derive(Clone, Copy, Debug)]
pub(super) struct SimWatchdog {
    /// When the drive last received a request that it could serve.
    last_heard: MonoTime,
    /// The watchdog has acted since `last_heard`.
    has_expired: bool,
}

/// The reaction of a drive to a bus that has been silent for too long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WatchdogReaction {
    Decelerate,
    Coast,
    /// Trips with the number for a lost communication.
    Trip(u16),
    Keep,
}

impl SimWatchdog {
    pub(super) const fn new() -> Self {
        Self {
            last_heard: MonoTime::ZERO,
            has_expired: false,
        }
    }

    /// A request was received that could be served, or the drive was switched on.
    pub(super) const fn heard(&mut self, at: MonoTime) {
        self.last_heard = at;
        self.has_expired = false;
    }

    /// The watchdog acts.
    pub(super) const fn expire(&mut self) {
        self.has_expired = true;
    }

    /// When it acts on a motor that the bus moves, if the bus stays silent; `None` if it is off, or has acted.
    pub(super) fn due(&self, model: &Model, memory: &SimMemory) -> Option<MonoTime> {
        let watchdog = model.watchdog.as_ref()?;
        let index = index_of(model, watchdog.time)?;
        let word = memory.word(index);
        (!self.has_expired && word != watchdog.off.value)
            .then(|| self.last_heard + time(&model.registers[index], word))
    }
}

impl WatchdogReaction {
    /// The reaction in the action register, from the meaning of its word. Without a meaning, the drive trips if it has a
    /// number for that, else it stops.
    pub(super) fn of(model: &Model, memory: &SimMemory) -> Self {
        let action = model.watchdog.as_ref().and_then(|watchdog| watchdog.action);
        let index = action.and_then(|address| index_of(model, address));
        let text = index.and_then(|index| model.registers[index].meaning(memory.word(index)));
        let is_lost = |text: &str| text.to_lowercase().contains("communication");
        let code = model
            .trip_codes
            .iter()
            .find(|it| is_lost(&it.text))
            .map(|it| it.code);
        let Some(text) = text.map(str::to_lowercase) else {
            return code.map_or(Self::Decelerate, Self::Trip);
        };
        let says = |parts: &[&str]| parts.iter().any(|part| text.contains(part));
        match code {
            _ if says(&["keep", "continu"]) => Self::Keep,
            Some(code) if says(&["trip", "fault"]) => Self::Trip(code),
            _ if says(&["trip", "fault", "coast"]) => Self::Coast,
            _ => Self::Decelerate,
        }
    }
}
