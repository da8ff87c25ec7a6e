//! How far an output is from what was ordered, and for how long.

use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use std::time::Duration;

/// How long the output may be above the limits without falling.
const ABOVE_FOR: Duration = Duration::from_secs(3);
/// How long the output may stay away from the setpoint without coming nearer: a brake or a magnetised motor holds it
/// for a while.
const AWAY_FOR: Duration = Duration::from_secs(10);
/// What slip and rounding explain, in thousandths of a hertz, and as a part of the setpoint.
const TOLERANCE_MILLIHERTZ: u32 = 1000;
const TOLERANCE_PART: u32 = 20;
/// A ramp comes nearer by more than this between two readings, or over several of them.
const NEARER_MILLIHERTZ: u32 = 20;

/// What a reading shows of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OutputFinding {
    /// The output is at its setpoint and within the limits.
    Right,
    /// The output may still be on its way to its setpoint.
    Unsure,
    /// The output has been outside the limits, or far from its setpoint, for too long.
    Outside,
}

/// A distance in thousandths of a hertz that should become shorter.
#[derive(Clone, Copy, Debug)]
struct OutputDistance {
    shortest: u32,
    /// Since when the distance has not become shorter.
    since: MonoTime,
}

impl OutputDistance {
    /// Takes the `distance` at `now`. Returns for how long it has not become shorter.
    fn take(watch: &mut Option<Self>, distance: u32, now: MonoTime) -> Duration {
        match watch {
            Some(it) if distance.saturating_add(NEARER_MILLIHERTZ) >= it.shortest => {
                now.since(it.since)
            }
            _ => {
                *watch = Some(Self {
                    shortest: distance,
                    since: now,
                });
                Duration::ZERO
            }
        }
    }
}

/// How far the output has been from what was ordered.
#[derive(Debug, Default)]
pub(super) struct OutsideWatch {
    /// The setpoint that it is compared with. One that moves by less than the tolerance is the same.
    wanted: Option<Hertz>,
    from_setpoint: Option<OutputDistance>,
    /// Whatever the setpoint is.
    above_limit: Option<OutputDistance>,
    /// The output outside its limits was reported, and was not seen right since.
    pub(super) is_reported: bool,
}

impl OutsideWatch {
    /// Nothing is ordered, or nothing is seen.
    pub(super) const fn pause(&mut self) {
        self.from_setpoint = None;
        self.above_limit = None;
    }

    /// Takes a reading of an output that should be at `wanted`, and never above `most`.
    pub(super) fn take(
        &mut self,
        output: Hertz,
        wanted: Hertz,
        most: Hertz,
        now: MonoTime,
    ) -> OutputFinding {
        let [output, most] = [output, most].map(Hertz::millihertz);
        let tolerated = tolerance(wanted.millihertz());
        if self
            .wanted
            .is_none_or(|before| before.millihertz().abs_diff(wanted.millihertz()) > tolerated)
        {
            self.wanted = Some(wanted);
            self.from_setpoint = None;
        }
        let above_for = if output > most + tolerance(most) {
            OutputDistance::take(&mut self.above_limit, output, now)
        } else {
            self.above_limit = None;
            Duration::ZERO
        };
        let distance = output.abs_diff(wanted.millihertz());
        if distance <= tolerated && self.above_limit.is_none() {
            self.from_setpoint = None;
            return OutputFinding::Right;
        }
        let away_for = OutputDistance::take(&mut self.from_setpoint, distance, now);
        if above_for >= ABOVE_FOR || away_for >= AWAY_FOR {
            OutputFinding::Outside
        } else {
            OutputFinding::Unsure
        }
    }
}

fn tolerance(millihertz: u32) -> u32 {
    (millihertz / TOLERANCE_PART).max(TOLERANCE_MILLIHERTZ)
}
