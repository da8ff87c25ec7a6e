//! A drive that goes out of sight: what was last seen of it is kept, and reported if its motor may still run.

use super::heard_order::HeardOrder;
use super::{DriveWork, Out};
use crate::domain::address::Address;
use crate::domain::command::{Owner, Reason};
use crate::domain::time::MonoTime;
use crate::drive::sight::{LastSeen, SeenAt, SightView};
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::gateway::stop::StopLatch;
use crate::journal::{JournalEntry, RememberedDrive};
use crate::profile::model::IndicatedState;
use std::time::Duration;

/// What was read of the motor is shown for this time at least.
const READINGS_LAST: Duration = Duration::from_secs(10);

/// The age of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Age {
    Fresh,
    Stale,
    Old,
}

impl DriveWork {
    /// What was last seen of it, until it is seen again.
    #[must_use]
    pub const fn sight_view(&self) -> SightView {
        self.sight.view()
    }

    /// A person, `owner`, confirms that the motor stands.
    pub fn confirm_standstill(&mut self, owner: Owner, out: Out<'_>) {
        if self.sight.confirmed() {
            self.has_changed = true;
            out.push_back(LineEffect::Note(
                self.drive,
                DriveNote::StandstillConfirmed { by: owner },
            ));
            out.keep(
                self.drive,
                JournalEntry::InSight {
                    confirmed_by: Some(owner),
                },
            );
        }
    }

    /// The drive has stopped answering.
    pub fn out_of_sight(&mut self, out: Out<'_>) {
        self.lose_sight(out);
        self.forget_readings(out);
    }

    /// Nothing that was read of the drive holds any more: it has stopped answering, or its line is down or another's.
    pub(super) fn forget_readings(&mut self, out: Out<'_>) {
        self.usage_out_of_sight(out);
        self.forget_output();
        self.forget_status();
        self.guard.forget_bases();
        self.motion_out_of_sight(out.now());
        self.latch.iter_mut().for_each(StopLatch::out_of_sight);
        self.watchdog.forget();
        let unread = self.trips.lost_sight();
        self.trip(unread, out);
        self.guard.lost_touch(out.now());
        self.guard.may_be_another();
        self.cut_motion(Reason::Offline, out);
    }

    fn forget_output(&mut self) {
        self.has_changed = true;
        self.output.forget();
        self.output_out_of_sight();
    }

    fn forget_status(&mut self) {
        self.has_changed = true;
        self.status.forget();
        self.status_at = None;
    }

    /// What the motor does is not known from `now` on: no ramp of a stop from here explains what is seen of it later.
    fn motion_out_of_sight(&mut self, now: MonoTime) {
        self.is_stopping &= self.latch.is_some();
        if let Some(answered) = &mut self.answered {
            answered.out_of_sight(now);
        }
    }

    /// The drive cannot be asked any more. To be called before readings and orders are forgotten.
    pub fn lose_sight(&mut self, out: Out<'_>) {
        let read_at = self.output.at().max(self.status_at);
        let last_seen = read_at.map(|at| LastSeen {
            run_state: self.run_state(false),
            output: self.output_frequency(),
            at: SeenAt::Here(at),
        });
        let is_heard = matches!(self.heard, HeardOrder::Run(..));
        // What was read before an order says nothing of what it does.
        let is_ordered = self.guard.may_be_obeyed() || is_heard || self.latch.is_some();
        let may_run = is_ordered || (last_seen.is_some() && !self.stands());
        if self.sight.lost(last_seen, may_run) {
            self.may_still_run(out);
        }
    }

    /// The drive was ordered to run, or may have been. Out of sight it may do so from now on, whatever a person confirmed before.
    pub(super) fn ordered_out_of_sight(&mut self, out: Out<'_>) {
        if self.sight.ordered() {
            self.may_still_run(out);
        }
    }

    fn may_still_run(&self, out: Out<'_>) {
        let last_seen = self.sight.last_seen();
        out.push_back(LineEffect::Note(
            self.drive,
            DriveNote::MayStillRun(last_seen),
        ));
        out.keep(self.drive, JournalEntry::OutOfSight { last_seen });
    }

    /// What was read of the motor too long ago shows nothing any more: the drive answers, but not what it is asked.
    pub fn forget_old(&mut self, now: MonoTime, out: Out<'_>) {
        let lasts = |at: Option<MonoTime>| at.is_none_or(|at| now.since(at) < READINGS_LAST);
        // By far the most calls end here.
        if lasts(self.output.at()) && lasts(self.status_at) {
            return;
        }
        let output = self
            .output_register
            .as_ref()
            .and_then(|it| self.age(it.address(), self.output.at(), now));
        let status = self
            .model
            .status_flag(IndicatedState::Running)
            .and_then(|it| self.age(it.address, self.status_at, now));
        let ages = [output, status];
        let is_seen = ages.contains(&Some(Age::Fresh));
        // What is not fresh may become old in a moment: nothing is reported of one part before the other is known.
        if !ages.contains(&Some(Age::Old)) || (!is_seen && ages.contains(&Some(Age::Stale))) {
            return;
        }
        if !is_seen {
            self.lose_sight(out);
            self.usage_out_of_sight(out);
        }
        self.motion_out_of_sight(now);
        if output == Some(Age::Old) {
            self.forget_output();
        }
        if status == Some(Age::Old) {
            self.forget_status();
        }
    }

    /// The age at `now` of what was read of the register at `address` at a moment, if it was.
    fn age(&self, address: Address, at: Option<MonoTime>, now: MonoTime) -> Option<Age> {
        let stale_after = self.stale_after(address);
        Some(match now.since(at?) {
            age if age < stale_after => Age::Fresh,
            age if age < READINGS_LAST => Age::Stale,
            _ => Age::Old,
        })
    }

    /// A reading shows what the drive does.
    pub(super) fn is_seen(&mut self, out: Out<'_>) {
        if self.sight.seen() {
            out.keep(self.drive, JournalEntry::InSight { confirmed_by: None });
        }
    }

    /// Restores what an earlier process last saw of a drive that it could not see at standstill.
    pub(super) fn remember_sight(&mut self, remembered: &RememberedDrive) {
        if remembered.may_still_run || remembered.lease.is_some() || remembered.stop.is_some() {
            self.has_turned = true;
            self.sight.remember(remembered.last_seen);
        }
    }
}
