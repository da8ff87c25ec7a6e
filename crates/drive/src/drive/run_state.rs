//! The run state of a drive, derived from what can be read from it.
//!
//! If the model has a status word, it shows whether the drive is ordered to run, and in which direction; the output
//! frequency shows whether it is at standstill.
//!
//! A model without a status word shows only its output frequency. The rule for such models, and its confidence:
//!
//! * output above zero: it runs. The direction is the one ordered here, or else not known (inferred: no register shows
//!   it). After an ordered stop it is stopping.
//! * output zero twice in a row with nothing ordered: stopped (inferred: zero does not prove that the drive is not
//!   ordered to run at 0 Hz from elsewhere).
//! * output zero with a run order in force: not known.

use super::status::StatusWatch;
use super::view::RunState;
use crate::domain::command::{Direction, RunIntent};
use crate::domain::time::MonoTime;
use crate::profile::model::IndicatedState;
use std::time::Duration;

/// Number of consecutive zero readings that count as standstill.
pub const ZEROS_FOR_STANDSTILL: u8 = 2;
/// A motor that turned, and reads as 0 for so long, stands. Registers that read as 0 for a second or two were seen in the field.
pub const STANDSTILL_HOLDS: Duration = Duration::from_secs(3);

/// The last readings of the output frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutputWatch {
    last: Option<(u16, MonoTime)>,
    zeros: u8,
    /// When the first of them was taken.
    zero_since: Option<MonoTime>,
    /// The readings since a stop took effect.
    ramp: Option<StopRamp>,
}

/// How the output has changed since a stop took effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct StopRamp {
    lowest: u16,
    lowest_at: MonoTime,
    /// Whether every reading was lower than the one before.
    falls: bool,
}

impl OutputWatch {
    /// Takes a raw reading of the output frequency.
    pub fn take(&mut self, raw: u16, at: MonoTime) {
        self.last = Some((raw, at));
        if raw == 0 {
            self.zeros = self.zeros.saturating_add(1);
            self.zero_since.get_or_insert(at);
        } else {
            (self.zeros, self.zero_since) = (0, None);
        }
        let Some(ramp) = &mut self.ramp else { return };
        if raw < ramp.lowest {
            ramp.lowest = raw;
            ramp.lowest_at = at;
        } else {
            ramp.falls = false;
        }
    }

    /// A stop took effect at `at`: from then on the output should fall.
    pub fn ramps_down(&mut self, at: MonoTime) {
        let (lowest, lowest_at) = self.last.unwrap_or((u16::MAX, at));
        self.ramp = Some(StopRamp {
            lowest,
            lowest_at,
            falls: true,
        });
    }

    /// Whether the output has risen by more than `rise` above its lowest reading since a stop took effect: no stop does that.
    #[must_use]
    pub fn has_risen(&self, rise: u32) -> bool {
        let (Some(ramp), Some((raw, _))) = (self.ramp, self.last) else {
            return false;
        };
        u32::from(raw) > u32::from(ramp.lowest).saturating_add(rise)
    }

    /// Whether the motor turns, and the output has not fallen for `within` since a stop took effect.
    #[must_use]
    pub fn has_settled(&self, within: Duration) -> bool {
        let (Some(ramp), Some((raw, at))) = (self.ramp, self.last) else {
            return false;
        };
        raw > 0 && at.since(ramp.lowest_at) >= within
    }

    /// Whether the output has fallen with every reading since a stop took effect. A motor that has kept its speed for
    /// one reading may have been started from elsewhere, and be falling to that setpoint.
    #[must_use]
    pub fn falls(&self) -> bool {
        self.ramp.is_some_and(|ramp| ramp.falls)
    }

    /// When the last reading arrived; `None` if there is none.
    #[must_use]
    pub fn at(&self) -> Option<MonoTime> {
        self.last.map(|(_, at)| at)
    }

    /// Discards everything: the drive is offline.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// The last reading; `None` if there is none.
    #[must_use]
    pub fn raw(&self) -> Option<u16> {
        self.last.map(|(raw, _)| raw)
    }

    /// Whether the motor is known to be at standstill.
    #[must_use]
    pub const fn is_at_standstill(&self) -> bool {
        self.zeros >= ZEROS_FOR_STANDSTILL
    }

    /// Whether every reading of the last `STANDSTILL_HOLDS` or more was 0. A motor that turned may read as 0 for a moment.
    #[must_use]
    pub fn has_stood(&self) -> bool {
        let (Some(since), Some((_, at))) = (self.zero_since, self.last) else {
            return false;
        };
        at.since(since) >= STANDSTILL_HOLDS
    }

    /// Whether the output is known to be active.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.raw().is_some_and(|raw| raw > 0)
    }

    /// The run state of a drive that is online and not tripped. `stopping`: the last order from here was a stop.
    #[must_use]
    pub fn run_state(&self, status: &StatusWatch, intent: RunIntent, stopping: bool) -> RunState {
        match status.is_running() {
            Some(running) => self.with_status(status, running, intent, stopping),
            None => self.by_output(status.get(IndicatedState::Reverse), intent, stopping),
        }
    }

    /// A drive at standstill is stopped, even while its status still shows the stop that led there.
    fn with_status(
        &self,
        status: &StatusWatch,
        running: bool,
        intent: RunIntent,
        stopping: bool,
    ) -> RunState {
        let ramps_down = status.get(IndicatedState::Stopping) == Some(true)
            || (stopping && (running || self.is_active()));
        if !running && self.is_at_standstill() {
            return RunState::Stopped;
        }
        match (
            ramps_down,
            running,
            status.get(IndicatedState::Reverse),
            intent,
        ) {
            (true, ..) => RunState::Stopping,
            (false, true, Some(false), _) => RunState::Forward,
            (false, true, Some(true), _) => RunState::Reverse,
            (false, true, None, RunIntent::Run(Direction::Forward)) => RunState::Forward,
            (false, true, None, RunIntent::Run(Direction::Reverse)) => RunState::Reverse,
            (false, true, None, _) => RunState::Running,
            (false, false, ..) if self.is_active() => RunState::Running,
            // Not ordered to run, and the output was read as zero once or not at all.
            (false, false, ..) => RunState::Stopped,
        }
    }

    fn by_output(&self, is_reverse: Option<bool>, intent: RunIntent, stopping: bool) -> RunState {
        if let Some(is_reverse) = is_reverse
            && self.is_active()
            && !(stopping && intent == RunIntent::Stop)
        {
            return if is_reverse {
                RunState::Reverse
            } else {
                RunState::Forward
            };
        }
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
    use crate::vendors::testing::with_status;

    #[test]
    fn what_the_output_frequency_tells() {
        let forward = RunIntent::Run(Direction::Forward);
        let stop = RunIntent::Stop;
        let cases: [(&[u16], RunIntent, bool, RunState); 9] = [
            (&[], stop, false, RunState::Unknown),
            (&[0], stop, false, RunState::Unknown),
            (&[0, 0], stop, false, RunState::Stopped),
            (&[0, 5, 0], stop, false, RunState::Unknown),
            (&[0, 0], forward, false, RunState::Unknown),
            (&[100], forward, false, RunState::Forward),
            (
                &[100],
                RunIntent::Run(Direction::Reverse),
                false,
                RunState::Reverse,
            ),
            (&[100], stop, false, RunState::Running),
            (&[100], stop, true, RunState::Stopping),
        ];
        for (readings, intent, stopping, state) in cases {
            let mut watch = OutputWatch::default();
            for raw in readings {
                watch.take(*raw, MonoTime::ZERO);
            }
            assert_eq!(
                watch.run_state(&StatusWatch::default(), intent, stopping),
                state,
                "{readings:?} {intent:?} {stopping}"
            );
        }
    }

    #[test]
    fn an_output_that_stays_at_zero_for_long_has_stood() {
        for (readings, has_stood) in [
            (&[(0, 3000), (1, 0), (3, 0)][..], false),
            (&[(0, 3000), (1, 0), (4, 0)], true),
            (&[(0, 0), (3, 1), (4, 0), (6, 0)], false),
            (&[(0, 0), (3, 1)], false),
            (&[], false),
        ] {
            let mut watch = OutputWatch::default();
            for (second, raw) in readings {
                watch.take(*raw, MonoTime::from_millis(second * 1000));
            }
            assert_eq!(watch.has_stood(), has_stood, "{readings:?}");
        }
    }

    #[test]
    fn a_motor_leaves_the_ramp_of_a_stop_by_rising_or_by_not_falling() {
        let rise = 100;
        let within = Duration::from_secs(3);
        for (readings, has_risen, has_settled) in [
            (&[(0, 3000), (1, 2500), (2, 2000)][..], false, false),
            (&[(0, 3000), (1, 2500), (2, 2600)], false, false),
            (&[(0, 3000), (1, 2500), (2, 2601)], true, false),
            (&[(0, 3000), (2, 3000)], false, false),
            (&[(0, 3000), (3, 3000)], false, true),
            (&[(0, 3000), (5, 2999), (7, 2999)], false, false),
            (&[(0, 3000), (5, 1000), (8, 1000)], false, true),
            (&[(0, 3000), (1, 0), (90, 0)], false, false),
        ] {
            let mut watch = OutputWatch::default();
            for (index, (second, raw)) in readings.iter().enumerate() {
                watch.take(*raw, MonoTime::from_millis(second * 1000));
                if index == 0 {
                    assert!(
                        !watch.has_risen(rise) && !watch.has_settled(within),
                        "no stop was given"
                    );
                    watch.ramps_down(MonoTime::ZERO);
                }
            }
            assert_eq!(
                (watch.has_risen(rise), watch.has_settled(within)),
                (has_risen, has_settled),
                "{readings:?}"
            );
        }
    }

    #[test]
    fn a_ramp_that_has_paused_is_none_of_a_stop_any_more() {
        for (readings, falls) in [
            (&[3000, 2500, 2000][..], true),
            (&[3000, 2500, 2500], false),
            (&[3000, 2500, 2600, 2000], false),
            (&[3000, 2500, 2500, 2000], false),
        ] {
            let mut watch = OutputWatch::default();
            watch.take(readings[0], MonoTime::ZERO);
            assert!(!watch.falls(), "no stop was given");
            watch.ramps_down(MonoTime::ZERO);
            for (second, raw) in (1..).zip(&readings[1..]) {
                watch.take(*raw, MonoTime::from_millis(second * 1000));
            }
            assert_eq!(watch.falls(), falls, "{readings:?}");
        }
    }

    #[test]
    fn what_the_status_word_tells() {
        let forward = RunIntent::Run(Direction::Forward);
        let stop = RunIntent::Stop;
        let cases: [(u16, &[u16], RunIntent, bool, RunState); 8] = [
            (0b0001, &[3000], stop, false, RunState::Forward),
            (0b0011, &[3000], forward, false, RunState::Reverse),
            (0b0001, &[0, 0], forward, false, RunState::Forward),
            (0b0001, &[3000], stop, true, RunState::Stopping),
            (0b0100, &[3000], stop, true, RunState::Stopping),
            (0b0100, &[3000], stop, false, RunState::Running),
            (0b0100, &[0], stop, true, RunState::Stopped),
            (0b0100, &[], stop, false, RunState::Stopped),
        ];
        for (word, readings, intent, stopping, state) in cases {
            let mut status = StatusWatch::new(&with_status());
            status.take(0x2100_u16.into(), &[word]);
            let mut watch = OutputWatch::default();
            for raw in readings {
                watch.take(*raw, MonoTime::ZERO);
            }
            assert_eq!(
                watch.run_state(&status, intent, stopping),
                state,
                "{word:b} {readings:?} {intent:?}"
            );
        }
    }
}
