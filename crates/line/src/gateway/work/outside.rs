//! The output, held against what was ordered: a motor that turns faster than the configuration allows, or far from its
//! setpoint, is reported, and is neither started nor made faster.

use super::motor::MotorReadings;
use super::reports::{DriveReports, Out};
use crate::domain::command::RunIntent;
use crate::domain::control::{FailSafe, OnOutputOutside};
use crate::domain::fail_safe::FailSafeCause;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::gateway::note::DriveNote;
use crate::guard::{DriveGuard, LossAction};
use crate::profile::model::IndicatedState;
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
enum OutputFinding {
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
    is_reported: bool,
}

impl OutsideWatch {
    /// Nothing is ordered, or nothing is seen.
    pub const fn pause(&mut self) {
        self.from_setpoint = None;
        self.above_limit = None;
    }

    /// Whether the output outside its limits was reported, and was not seen right since.
    pub const fn is_reported(&self) -> bool {
        self.is_reported
    }

    /// Takes a reading of the output; a stop is in progress (`stops`), or not. Returns what falls due.
    pub fn take(
        &mut self,
        motor: &MotorReadings,
        stops: bool,
        guard: &mut DriveGuard,
        reports: &mut DriveReports,
        now: MonoTime,
        out: Out<'_>,
    ) -> Option<LossAction> {
        let is_ordered =
            !stops && guard.is_run_acknowledged() && matches!(guard.intent(), RunIntent::Run(_));
        if !is_ordered {
            // Once it stands, nothing is outside.
            self.pause();
            if self.is_reported && motor.is_at_standstill() {
                self.report(false, DriveNote::OutputRight, guard, reports, out);
            }
            return None;
        }
        let output = motor.output_frequency(guard.bases())?;
        let control = guard.control()?;
        // Where the status shows that the motor runs, it shows as well when it does not.
        if output == Hertz::ZERO && motor.model().status_flag(IndicatedState::Running).is_some() {
            return None;
        }
        let (least, most) = (control.least, control.most);
        // Where the setpoint comes from elsewhere, or is not known, the limits are all that is known.
        let ordered = if control.bus.has_frequency() {
            guard.setpoint()
        } else {
            None
        };
        let wanted = ordered.unwrap_or(output.clamp(least, most));
        match self.find(output, wanted, most, now) {
            OutputFinding::Right if self.is_reported => {
                self.report(false, DriveNote::OutputRight, guard, reports, out);
            }
            OutputFinding::Outside if !self.is_reported => {
                let is_scale_typed = motor.model().needs_full_scale();
                let note = DriveNote::OutputOutside {
                    output,
                    wanted,
                    is_scale_typed,
                };
                self.report(true, note, guard, reports, out);
                return stops_for_it(guard, now);
            }
            OutputFinding::Right | OutputFinding::Unsure | OutputFinding::Outside => {}
        }
        None
    }

    fn report(
        &mut self,
        is_outside: bool,
        note: DriveNote,
        guard: &mut DriveGuard,
        reports: &mut DriveReports,
        out: Out<'_>,
    ) {
        self.is_reported = is_outside;
        reports.mark_changed();
        guard.output_is_outside(is_outside);
        reports.note(note, out);
    }

    /// Takes a reading of an output that should be at `wanted`, and never above `most`.
    fn find(&mut self, output: Hertz, wanted: Hertz, most: Hertz, now: MonoTime) -> OutputFinding {
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

/// Ends the order because of an output outside, where that is configured.
fn stops_for_it(guard: &mut DriveGuard, now: MonoTime) -> Option<LossAction> {
    if guard.control()?.on_output_outside != OnOutputOutside::Stop {
        return None;
    }
    let owner = guard.lease().map(|(owner, _)| owner);
    Some(guard.ends(owner, FailSafe::Stop, FailSafeCause::OutputOutside, now))
}

fn tolerance(millihertz: u32) -> u32 {
    (millihertz / TOLERANCE_PART).max(TOLERANCE_MILLIHERTZ)
}
