//! What a drive does, told from what can be read of it.
//!
//! A model without a status word shows only its output frequency. The rule for such models, and its confidence:
//!
//! * output above zero: it runs. The direction is the one that was ordered here, else not known (inferred: no register
//!   shows it). After an ordered stop it is stopping.
//! * output zero twice in a row with nothing ordered: stopped (inferred: zero does not prove that the drive is not
//!   ordered to run by somebody else at 0 Hz).
//! * output zero with a run order in force: not known.

use super::view::RunState;
use crate::domain::command::{Direction, RunIntent};
use crate::domain::time::MonoTime;

/// How many readings of zero in a row count as standstill.
pub const ZEROS_FOR_STANDSTILL: u8 = 2;

/// The last readings of the output frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutputWatch {
    last: Option<(u16, MonoTime)>,
    zeros: u8,
}

impl OutputWatch {
    /// Takes a reading of the output frequency, as the drive sent it.
    pub fn take(&mut self, raw: u16, at: MonoTime) {
        self.last = Some((raw, at));
        self.zeros = if raw == 0 { self.zeros.saturating_add(1) } else { 0 };
    }

    /// Forgets everything: the drive is out of sight.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// The last reading; nothing if there is none.
    #[must_use]
    pub fn raw(&self) -> Option<u16> {
        self.last.map(|(raw, _)| raw)
    }

    /// Whether the motor is known to stand still.
    #[must_use]
    pub const fn is_at_standstill(&self) -> bool {
        self.zeros >= ZEROS_FOR_STANDSTILL
    }

    /// Whether the output is known to be active.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.raw().is_some_and(|raw| raw > 0)
    }

    /// What the drive does, if it is online and not tripped. `stopping`: a stop that was ordered here is the last
    /// order.
    #[must_use]
    pub fn run_state(&self, intent: RunIntent, stopping: bool) -> RunState {
        match (self.raw(), intent) {
            (None, _) => RunState::Unknown,
            (Some(0), RunIntent::Run(_)) => RunState::Unknown,
            (Some(0), _) if self.is_at_standstill() => RunState::Stopped,
            (Some(0), _) => RunState::Unknown,
            (Some(_), RunIntent::Run(Direction::Forward)) => RunState::Forward,
            (Some(_), RunIntent::Run(Direction::Reverse)) => RunState::Reverse,
            (Some(_), _) if stopping => RunState::Stopping,
            (Some(_), _) => RunState::Running,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_output_frequency_tells() {
        let (forward, stop) = (RunIntent::Run(Direction::Forward), RunIntent::Stop);
        let cases: [(&[u16], RunIntent, bool, RunState); 9] = [
            (&[], stop, false, RunState::Unknown),
            (&[0], stop, false, RunState::Unknown),
            (&[0, 0], stop, false, RunState::Stopped),
            (&[0, 5, 0], stop, false, RunState::Unknown),
            (&[0, 0], forward, false, RunState::Unknown),
            (&[100], forward, false, RunState::Forward),
            (&[100], RunIntent::Run(Direction::Reverse), false, RunState::Reverse),
            (&[100], stop, false, RunState::Running),
            (&[100], stop, true, RunState::Stopping),
        ];
        for (readings, intent, stopping, state) in cases {
            let mut watch = OutputWatch::default();
            for raw in readings {
                watch.take(*raw, MonoTime::ZERO);
            }
            assert_eq!(watch.run_state(intent, stopping), state, "{readings:?} {intent:?} {stopping}");
        }
    }
}
