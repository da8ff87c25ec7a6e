//! The output, held against what was ordered: a motor that turns faster than the configuration allows, or far from its
//! setpoint, is reported, and is neither started nor made faster.

use super::outside_watch::OutputFinding;
use super::{DriveWork, Out};
use crate::domain::command::RunIntent;
use crate::domain::control::{FailSafe, OnOutputOutside};
use crate::domain::fail_safe::FailSafeCause;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::profile::model::IndicatedState;

impl DriveWork {
    /// Takes a reading of the output.
    pub(super) fn held_against_limits(&mut self, now: MonoTime, out: Out<'_>) {
        let is_ordered = self.latch.is_none()
            && self.guard.is_run_acknowledged()
            && matches!(self.guard.intent(), RunIntent::Run(_));
        if !is_ordered {
            // Once it stands, nothing is outside.
            self.outside.pause();
            if self.outside.is_reported && self.is_at_standstill() {
                self.is_right_again(out);
            }
            return;
        }
        let (Some(output), Some(control)) = (self.output_frequency(), self.guard.control()) else {
            return;
        };
        // Where the status shows that the motor runs, it shows as well when it does not.
        if output == Hertz::ZERO && self.model.status_flag(IndicatedState::Running).is_some() {
            return;
        }
        let (least, most) = (control.least, control.most);
        // Where the setpoint comes from elsewhere, or is not known, the limits are all that is known.
        let ordered = if control.bus.has_frequency() {
            self.guard.setpoint()
        } else {
            None
        };
        let wanted = ordered.unwrap_or(output.clamp(least, most));
        match self.outside.take(output, wanted, most, now) {
            OutputFinding::Right if self.outside.is_reported => self.is_right_again(out),
            OutputFinding::Outside if !self.outside.is_reported => {
                self.is_outside(output, wanted, now, out)
            }
            OutputFinding::Right | OutputFinding::Unsure | OutputFinding::Outside => {}
        }
    }

    /// The drive is out of sight.
    pub(super) const fn output_out_of_sight(&mut self) {
        self.outside.pause();
    }

    fn is_outside(&mut self, output: Hertz, wanted: Hertz, now: MonoTime, out: Out<'_>) {
        self.outside.is_reported = true;
        self.has_changed = true;
        self.guard.output_is_outside(true);
        let is_scale_typed = self.model.needs_full_scale();
        out.push_back(LineEffect::Note(
            self.drive,
            DriveNote::OutputOutside {
                output,
                wanted,
                is_scale_typed,
            },
        ));
        if self
            .guard
            .control()
            .is_some_and(|it| it.on_output_outside == OnOutputOutside::Stop)
        {
            let owner = self.guard.lease().map(|(owner, _)| owner);
            let lost = self
                .guard
                .ends(owner, FailSafe::Stop, FailSafeCause::OutputOutside, now);
            self.fail_safe(lost, now, out);
        }
    }

    fn is_right_again(&mut self, out: Out<'_>) {
        self.outside.is_reported = false;
        self.has_changed = true;
        self.guard.output_is_outside(false);
        out.push_back(LineEffect::Note(self.drive, DriveNote::OutputRight));
    }
}
