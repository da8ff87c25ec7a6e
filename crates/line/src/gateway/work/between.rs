//! Stops while another gateway, or a foreign master, has the line.

use super::{DriveWork, Out};
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::description::STALE_PERIODS;
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::gateway::stop::StopLatch;
use crate::profile::model::PollClass;
use std::time::Duration;

/// Another gateway that has not read a drive for less may have met a stop of this one.
const READ_AT_LEAST: Duration = Duration::from_secs(1);

impl DriveWork {
    /// Whether the stop that waits was declared, and no client has commanded it too.
    #[must_use]
    pub fn is_stop_declared(&self) -> bool {
        self.latch
            .as_ref()
            .is_some_and(StopLatch::is_declared_alone)
    }

    /// Another gateway or master has read the drive at `now`.
    pub const fn was_read_by_others(&mut self, now: MonoTime) {
        self.overheard_at = Some(now);
    }

    /// Whether another one reads the drive, as far as can be heard at `now`.
    #[must_use]
    pub fn is_read_by_others(&self, now: MonoTime) -> bool {
        // A frame of this gateway may have cost the other one an exchange.
        let limit = (self.pace.period(PollClass::Fast) * STALE_PERIODS).max(READ_AT_LEAST);
        self.overheard_at.is_some_and(|at| now.since(at) < limit)
    }

    /// The stop is sent for the first time, between the frames of another master.
    pub fn stops_between(&mut self, out: Out<'_>) {
        out.push_back(LineEffect::Note(self.drive, DriveNote::StopBetween));
    }

    /// The frame of the stop may have met another one: it is sent again as soon as the line allows.
    pub fn stop_again_at(&mut self, now: MonoTime) {
        self.latch
            .iter_mut()
            .for_each(|latch| latch.send_again_at(now));
    }

    /// Another gateway or master sent the drive a stop while this gateway is active: it holds like one by another client, and
    /// is sent once more to see its effect.
    pub fn stopped_by_another(&mut self, coast: bool, now: MonoTime, out: Out<'_>) {
        let Some(order) = self.guard.stop_by_another(coast, now) else {
            return;
        };
        self.has_changed = true;
        if self.latch.is_none() {
            out.push_back(LineEffect::Note(self.drive, DriveNote::StoppedByAnother));
        }
        self.cut(now, out);
        self.is_stopping = true;
        self.stop(order, None, now, out);
    }

    /// Another gateway has taken the line, and sees to what is declared: control is no longer of this gateway. If this one has
    /// not heard all that was sent (`is_informed`), a stop that it has declared itself may be older than the present orders.
    pub fn left_to_another(&mut self, is_informed: bool, out: Out<'_>) {
        self.has_changed |= self.guard.is_held();
        self.guard.give_up();
        if !is_informed && self.is_stop_declared() {
            self.drop_stop(Report::new(Outcome::Unknown, Reason::Standby), out);
        }
    }
}
