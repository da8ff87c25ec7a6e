//! Exchanges that rule out late replies, for drives whose work waits because of them.

use super::drive::{DriveOnLine, LineDrives};
use super::flight::{ExchangePurpose, PickedRequest, is_stop, poll_request};
use super::natives::ClientReads;
use super::work::DriveWish;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::line::barriers::LoopNonces;
use crate::line::echo::{EchoWatch, LocalEcho};
use crate::line::schedule::ReadKey;
use crate::wire::pdu::Request;
use std::time::Duration;

/// What decides which barriers a line can use at the moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct BarrierMeans {
    echo: LocalEcho,
    nonce: u16,
}

impl BarrierMeans {
    pub const fn of(echo: &EchoWatch, nonces: &LoopNonces) -> Self {
        Self {
            echo: echo.known(),
            nonce: nonces.peek(),
        }
    }

    /// A barrier for a drive whose waiting work cannot be sent before late replies are ruled out.
    pub fn pick(
        self,
        now: MonoTime,
        drives: &LineDrives,
        clients: &ClientReads,
    ) -> Option<(DriveIndex, Request)> {
        drives.iter().find_map(|drive| {
            let station = &drive.station;
            if !station.is_dirty(now)
                || now < station.may_be_asked_from()
                || !is_held_up(now, drive, clients)
            {
                return None;
            }
            let barrier = self
                .usable(drive)
                .find(|request| now >= station.unmistakable_at(request))?;
            Some((drive.index, barrier))
        })
    }

    /// A barrier to try for the first time, on a drive that has answered for `patience`.
    pub fn pick_trial(
        self,
        now: MonoTime,
        drives: &LineDrives,
        patience: Duration,
    ) -> Option<PickedRequest> {
        let (drive, place, request) = drives.iter().find_map(|drive| {
            let (place, request, since) = self.trial(drive)?;
            let may_go = now >= self.trial_at(drive)? && now.since(since) >= patience;
            may_go.then_some((drive.index, place, request))
        })?;
        Some((drive, request, ExchangePurpose::Trial(place)))
    }

    /// When a barrier of `drive` may be tried, if one is untried: its reply must be beyond doubt.
    pub fn trial_at(self, drive: &DriveOnLine) -> Option<MonoTime> {
        self.trial(drive).map(|_| {
            drive
                .station
                .clean_at()
                .max(drive.station.may_be_asked_from())
        })
    }

    /// When `request`, or a barrier that makes it possible, may be sent to `drive`.
    pub fn free_at(self, drive: &DriveOnLine, request: &Request) -> MonoTime {
        let station = &drive.station;
        let unmistakable = station.unmistakable_at(request);
        if unmistakable == MonoTime::ZERO {
            return station.may_be_asked_from();
        }
        let barrier = self
            .usable(drive)
            .map(|request| station.unmistakable_at(&request))
            .min();
        barrier
            .map_or(unmistakable, |barrier| unmistakable.min(barrier))
            .max(station.may_be_asked_from())
    }

    fn usable(self, drive: &DriveOnLine) -> impl Iterator<Item = Request> {
        drive.barriers.usable(self.echo, self.nonce)
    }

    fn trial(self, drive: &DriveOnLine) -> Option<(usize, Request, MonoTime)> {
        drive.barriers.to_try(self.echo, self.nonce)
    }
}

/// Whether work waits for `drive` and all of it is held up by replies that may arrive late.
fn is_held_up(now: MonoTime, drive: &DriveOnLine, clients: &ClientReads) -> bool {
    let mut waits = false;
    for request in waiting_requests(now, drive, clients) {
        if now >= drive.station.unmistakable_at(&request) {
            return false;
        }
        waits = true;
    }
    waits
}

fn waiting_requests(
    now: MonoTime,
    drive: &DriveOnLine,
    clients: &ClientReads,
) -> impl Iterator<Item = Request> {
    let reads = clients
        .keys()
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
