//! Exchanges that settle whether a late reply can still come, for drives whose work is held up by that.

use super::core::{LineCore, Purpose};
use super::decide::{Picked, is_stop, poll_request};
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::line::schedule::ReadKey;
use crate::wire::pdu::Request;
use std::time::Duration;

impl LineCore {
    /// The drive at `drive` is known to hear nothing until `until`: only stops go to it, and its silence tells nothing.
    pub fn rest(&mut self, drive: DriveIndex, until: MonoTime) {
        if let Some(station) = self.stations.get_mut(drive.get()) {
            station.rest_until(until);
        }
    }

    /// A barrier for a drive whose waiting work cannot go before that is settled.
    pub(super) fn pick_barrier(&self, now: MonoTime) -> Option<(DriveIndex, Request)> {
        self.drives().find_map(|drive| {
            let station = &self.stations[drive.get()];
            if !station.is_dirty(now) || now < station.may_be_asked_from() || !self.is_held_up(now, drive) {
                return None;
            }
            let barrier = self.usable_barriers(drive).find(|request| now >= station.unmistakable_at(request))?;
            Some((drive, barrier))
        })
    }

    /// A barrier that is tried for the first time, on a drive that has answered for `patience`.
    pub(super) fn pick_trial(&mut self, now: MonoTime, patience: Duration) -> Option<Picked> {
        let (drive, place, request) = self.drives().find_map(|drive| {
            let (place, request, since) = self.trial(drive)?;
            let may_go = now >= self.trial_at(drive)? && now.since(since) >= patience;
            may_go.then_some((drive, place, request))
        })?;
        self.counters.barriers += 1;
        Some((drive, request, Purpose::Trial(place)))
    }

    /// From when a barrier of `drive` may be tried, if one has to be: its answer shall be in no doubt.
    pub(super) fn trial_at(&self, drive: DriveIndex) -> Option<MonoTime> {
        let station = &self.stations[drive.get()];
        self.trial(drive).map(|_| station.clean_at().max(station.may_be_asked_from()))
    }

    /// From when `request` may go to `drive`, or a barrier that clears its way.
    pub(super) fn free_at(&self, drive: DriveIndex, request: &Request) -> MonoTime {
        let station = &self.stations[drive.get()];
        let unmistakable = station.unmistakable_at(request);
        if unmistakable == MonoTime::ZERO {
            return station.may_be_asked_from();
        }
        let barrier = self.usable_barriers(drive).map(|request| station.unmistakable_at(&request)).min();
        barrier.map_or(unmistakable, |barrier| unmistakable.min(barrier)).max(station.may_be_asked_from())
    }

    /// Whether work waits for `drive` and none of it may go because of replies that may come late.
    fn is_held_up(&self, now: MonoTime, drive: DriveIndex) -> bool {
        let station = &self.stations[drive.get()];
        let mut waits = false;
        for request in self.waiting_requests(now, drive) {
            if now >= station.unmistakable_at(&request) {
                return false;
            }
            waits = true;
        }
        waits
    }

    fn waiting_requests(&self, now: MonoTime, drive: DriveIndex) -> impl Iterator<Item = Request> + '_ {
        let reads = self.schedule.reads().filter(move |key| key.drive == drive).map(ReadKey::request);
        let wants = self.works[drive.get()]
            .wants()
            .filter(move |want| want.at <= now && !is_stop(want.rank) && !self.is_withheld(drive, want.rank));
        let polls = self.plans[drive.get()].iter().filter(move |(_, _, due)| *due <= now);
        wants.map(|want| want.request).chain(reads).chain(polls.map(|(_, group, _)| poll_request(group)))
    }

    fn usable_barriers(&self, drive: DriveIndex) -> impl Iterator<Item = Request> + '_ {
        self.barriers[drive.get()].usable(self.echo.known(), self.nonces.peek())
    }

    fn trial(&self, drive: DriveIndex) -> Option<(usize, Request, MonoTime)> {
        self.barriers[drive.get()].to_try(self.echo.known(), self.nonces.peek())
    }
}
