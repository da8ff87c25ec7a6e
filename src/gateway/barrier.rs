//! Exchanges that rule out late replies, for drives whose work waits because of them.

use super::core::{ExchangePurpose, LineCore};
use super::decide::{Picked, is_stop, poll_request};
use super::drive::DriveOnLine;
use super::work::DriveWish;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::line::schedule::ReadKey;
use crate::wire::pdu::Request;
use std::time::Duration;

impl LineCore {
    /// The drive at `drive` ignores requests until `until`: only stops are sent to it, and its silence means nothing.
    pub fn rest(&mut self, drive: DriveIndex, until: MonoTime) {
        if let Some(drive) = self.drives.get_mut(drive) {
            drive.station.rest_until(until);
        }
    }

    /// A barrier for a drive whose waiting work cannot be sent before late replies are ruled out.
    pub(super) fn pick_barrier(&self, now: MonoTime) -> Option<(DriveIndex, Request)> {
        self.drives.iter().find_map(|drive| {
            let station = &drive.station;
            if !station.is_dirty(now)
                || now < station.may_be_asked_from()
                || !self.is_held_up(now, drive)
            {
                return None;
            }
            let barrier = self
                .usable_barriers(drive)
                .find(|request| now >= station.unmistakable_at(request))?;
            Some((drive.index, barrier))
        })
    }

    /// A barrier to try for the first time, on a drive that has answered for `patience`.
    pub(super) fn pick_trial(&mut self, now: MonoTime, patience: Duration) -> Option<Picked> {
        let (drive, place, request) = self.drives.iter().find_map(|drive| {
            let (place, request, since) = self.trial(drive)?;
            let may_go = now >= self.trial_at(drive)? && now.since(since) >= patience;
            may_go.then_some((drive.index, place, request))
        })?;
        self.counters.barriers += 1;
        Some((drive, request, ExchangePurpose::Trial(place)))
    }

    /// When a barrier of `drive` may be tried, if one is untried: its reply must be beyond doubt.
    pub(super) fn trial_at(&self, drive: &DriveOnLine) -> Option<MonoTime> {
        self.trial(drive).map(|_| {
            drive
                .station
                .clean_at()
                .max(drive.station.may_be_asked_from())
        })
    }

    /// When `request`, or a barrier that makes it possible, may be sent to `drive`.
    pub(super) fn free_at(&self, drive: &DriveOnLine, request: &Request) -> MonoTime {
        let station = &drive.station;
        let unmistakable = station.unmistakable_at(request);
        if unmistakable == MonoTime::ZERO {
            return station.may_be_asked_from();
        }
        let barrier = self
            .usable_barriers(drive)
            .map(|request| station.unmistakable_at(&request))
            .min();
        barrier
            .map_or(unmistakable, |barrier| unmistakable.min(barrier))
            .max(station.may_be_asked_from())
    }

    /// Whether work waits for `drive` and all of it is held up by replies that may arrive late.
    fn is_held_up(&self, now: MonoTime, drive: &DriveOnLine) -> bool {
        let mut waits = false;
        for request in self.waiting_requests(now, drive) {
            if now >= drive.station.unmistakable_at(&request) {
                return false;
            }
            waits = true;
        }
        waits
    }

    fn waiting_requests<'a>(
        &'a self,
        now: MonoTime,
        drive: &'a DriveOnLine,
    ) -> impl Iterator<Item = Request> + 'a {
        let reads = self
            .schedule
            .reads()
            .filter(|key| key.drive == drive.index)
            .map(ReadKey::request);
        let may_wait = move |want: &DriveWish| {
            want.at <= now && !is_stop(want.rank) && !drive.is_withheld(want.rank)
        };
        let wants = drive.work.wants().filter(may_wait);
        let polls = drive.plan.iter().filter(move |(_, _, due)| *due <= now);
        wants
            .map(|want| want.request)
            .chain(reads)
            .chain(polls.map(|(_, group, _)| poll_request(group)))
    }

    fn usable_barriers<'a>(
        &self,
        drive: &'a DriveOnLine,
    ) -> impl Iterator<Item = Request> + use<'a> {
        drive.barriers.usable(self.echo.known(), self.nonces.peek())
    }

    fn trial(&self, drive: &DriveOnLine) -> Option<(usize, Request, MonoTime)> {
        drive.barriers.to_try(self.echo.known(), self.nonces.peek())
    }
}
