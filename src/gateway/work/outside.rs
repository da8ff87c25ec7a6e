//! The output, held against what was ordered: a motor that turns faster than the configuration allows, or far from its
//! setpoint, is told, and is neither started nor made faster.

use super::{DriveWork, Out};
use crate::domain::command::RunIntent;
use crate::domain::control::{FailSafe, OnOutputOutside};
use crate::domain::fail_safe::Cause;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::gateway::event::Effect;
use crate::gateway::note::Note;
use std::time::Duration;

/// How long the output may be above the limits.
const ABOVE_FOR: Duration = Duration::from_secs(3);
/// How long it may stay away from the setpoint without coming nearer: a brake or a magnetised motor holds it for a while.
const AWAY_FOR: Duration = Duration::from_secs(10);
/// What slip and rounding explain, in thousandths of a hertz, and as a part of the setpoint.
const TOLERANCE_MILLIHERTZ: u32 = 1000;
const TOLERANCE_PART: u32 = 20;
/// A ramp comes nearer by more than this between two readings, or over several of them.
const NEARER_MILLIHERTZ: u32 = 20;

impl DriveWork {
    /// Takes a reading of the output.
    pub(super) fn held_against_limits(&mut self, now: MonoTime, out: Out<'_>) {
        let frequency = self.output_frequency();
        let Some(ordered) = self.ordered_frequency() else {
            // Once it stands, nothing is outside.
            self.outside.nearest = None;
            if self.outside.is_told && self.is_at_standstill() {
                self.is_right_again(out);
            }
            return;
        };
        let Some(output) = frequency.filter(|output| *output > Hertz::ZERO) else { return };
        let Some(control) = self.guard.control() else { return };
        let (most, least) = (control.most, control.least);
        if self.outside.ordered != Some(ordered) {
            self.outside.ordered = Some(ordered);
            self.outside.nearest = None;
        }
        // Where the setpoint comes from elsewhere, the limits are all that is known.
        let wanted = if control.bus.has_frequency() { ordered } else { output.clamp(least, most) };
        let distance = output.millihertz().abs_diff(wanted.millihertz());
        if distance <= tolerance(wanted) && output.millihertz() <= most.millihertz() + tolerance(most) {
            self.outside.nearest = None;
            if self.outside.is_told {
                self.is_right_again(out);
            }
            return;
        }
        let is_above = output.millihertz() > most.millihertz() + tolerance(most);
        match self.outside.nearest {
            Some((nearest, since)) if distance.saturating_add(NEARER_MILLIHERTZ) >= nearest => {
                let limit = if is_above { ABOVE_FOR } else { AWAY_FOR };
                if now.since(since) >= limit && !self.outside.is_told {
                    self.is_outside(output, wanted, now, out);
                }
            }
            _ => self.outside.nearest = Some((distance, now)),
        }
    }

    /// The drive is out of sight.
    pub(super) const fn output_out_of_sight(&mut self) {
        self.outside.nearest = None;
    }

    /// The setpoint with which the motor was ordered to run; the highest one if it comes from elsewhere. `None` while nothing
    /// is ordered, or an order is on its way.
    fn ordered_frequency(&self) -> Option<Hertz> {
        let is_alone = self.latch.is_none() && self.current.is_none();
        let runs = matches!(self.guard.intent(), RunIntent::Run(_)) && self.guard.is_run_acknowledged();
        let control = self.guard.control().filter(|_| is_alone && runs)?;
        if control.bus.has_frequency() { self.guard.setpoint() } else { Some(control.most) }
    }

    fn is_outside(&mut self, output: Hertz, wanted: Hertz, now: MonoTime, out: Out<'_>) {
        self.outside.is_told = true;
        self.has_changed = true;
        self.guard.output_is_outside(true);
        let is_scale_typed = self.model.needs_full_scale();
        out.push_back(Effect::Note(self.drive, Note::OutputOutside { output, wanted, is_scale_typed }));
        if self.guard.control().is_some_and(|it| it.on_output_outside == OnOutputOutside::Stop) {
            let owner = self.guard.lease().map(|(owner, _)| owner);
            let lost = self.guard.ends(owner, FailSafe::Stop, Cause::OutputOutside, now);
            self.fail_safe(lost, now, out);
        }
    }

    fn is_right_again(&mut self, out: Out<'_>) {
        self.outside.is_told = false;
        self.has_changed = true;
        self.guard.output_is_outside(false);
        out.push_back(Effect::Note(self.drive, Note::OutputRight));
    }
}

fn tolerance(wanted: Hertz) -> u32 {
    (wanted.millihertz() / TOLERANCE_PART).max(TOLERANCE_MILLIHERTZ)
}
