//! What goes on the wire next, and when there is something to decide again.

use super::core::{Flight, LineCore, Purpose};
use super::event::{Effect, Wake, WakeReason};
use super::work::{Rank, Want};
use crate::domain::ids::DriveIndex;
use crate::domain::report::LineState;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{TrafficKind, TrafficRecord};
use crate::drive::plan::{PollGroup, Urgency as PollUrgency};
use crate::line::barriers::TRY_PATIENCE;
use crate::line::schedule::ReadKey;
use crate::line::station::PROBE_TIMEOUT;
use crate::line::transaction::Exchange;
use crate::wire::pdu::Request;
use std::time::Duration;

/// Polls that have grown too old to wait go before native reads at most so often in a row: a plan that fills the line
/// stretches, and clients keep a share.
const AGED_POLLS_MAX: u8 = 3;

/// What goes on the wire next.
pub(super) type Picked = (DriveIndex, Request, Purpose);

/// What is least goes first: by rank, then drives that answer, then those that move, then in order of time.
type Urgency = (Rank, bool, bool, MonoTime);

/// A poll that is due.
#[derive(Clone, Copy)]
struct DuePoll {
    drive: DriveIndex,
    index: usize,
    group: PollGroup,
}

impl LineCore {
    /// Opens the next exchange if the wire is free and has been silent for long enough.
    pub(super) fn decide(&mut self, now: MonoTime) {
        if self.state == LineState::Down || self.wire.is_busy() || now < self.wire.may_send_from() {
            return;
        }
        let Some((drive, request, purpose)) = self.pick(now) else { return };
        let setup = &self.setup.drives[drive.get()];
        let station = &self.stations[drive.get()];
        let at_most = if station.is_known_silent() { PROBE_TIMEOUT } else { Duration::MAX };
        let timeout = setup.wait_for(&request, &self.setup.timing, at_most);
        let doubt = now < station.unmistakable_at(&request);
        let in_doubt = station.misses_function(request.function(), now);
        let line_is_clean = !self.stations.iter().any(|station| station.is_dirty(now));
        let is_read = matches!(request, Request::ReadHolding { .. });
        if matches!(request, Request::Loopback { .. } | Request::Unserved { .. }) {
            self.nonces.advance();
        }
        let exchange = Exchange { station: setup.station, request, timeout, in_doubt, line_is_clean };
        let mut frame = Vec::with_capacity(16);
        self.wire.send(now, exchange, &mut frame);
        self.echo.sent(&frame, is_read);
        self.flight = Some(Flight { drive, purpose, doubt, sent_at: now });
        self.counters.requests += 1;
        if self.setup.tells_traffic {
            let record = TrafficRecord { at: now, kind: TrafficKind::Request, bytes: frame.clone() };
            self.effects.push_back(Effect::Traffic(record));
        }
        self.effects.push_back(Effect::Transmit(frame));
    }

    /// What drives want for themselves, barriers, polls that have aged, then native reads and polls in turn. The first
    /// step of a command goes at most in every second exchange if others wait.
    fn pick(&mut self, now: MonoTime) -> Option<Picked> {
        let spared = std::mem::replace(&mut self.others_turn, false);
        let last_rank = if spared { Rank::Trip } else { Rank::Start };
        if let Some(picked) = self.pick_work(now, last_rank) {
            return Some(picked);
        }
        if let Some((drive, request)) = self.pick_barrier(now) {
            self.counters.barriers += 1;
            return Some((drive, request, Purpose::Barrier));
        }
        if let Some(picked) = self.pick_trial(now, TRY_PATIENCE) {
            return Some(picked);
        }
        let other = self.pick_other(now).or_else(|| self.pick_work(now, Rank::Start));
        other.or_else(|| self.pick_trial(now, Duration::ZERO))
    }

    fn pick_other(&mut self, now: MonoTime) -> Option<Picked> {
        if self.aged_polls >= AGED_POLLS_MAX
            && let Some(picked) = self.pick_read(now)
        {
            self.aged_polls = 0;
            return Some(picked);
        }
        if let Some(poll) = self.due_poll(now, true) {
            self.aged_polls = self.aged_polls.saturating_add(1);
            return Some(self.take_poll(now, poll));
        }
        self.aged_polls = 0;
        let polls_first = self.polls_turn;
        self.polls_turn = !polls_first;
        if polls_first && let Some(poll) = self.due_poll(now, false) {
            return Some(self.take_poll(now, poll));
        }
        if let Some(picked) = self.pick_read(now) {
            return Some(picked);
        }
        let poll = self.due_poll(now, false)?;
        Some(self.take_poll(now, poll))
    }

    /// The most urgent wish of any drive up to `last_rank`; drives that answer before silent ones, moving ones before
    /// those at rest. A stop waits for nothing, everything else for late replies and back-offs.
    fn pick_work(&mut self, now: MonoTime, last_rank: Rank) -> Option<Picked> {
        loop {
            let (drive, want) = self.most_urgent(now, last_rank)?;
            if self.works[drive.get()].send(want.rank, now, &mut self.effects) {
                self.others_turn = want.rank == Rank::Start;
                return Some((drive, want.request, Purpose::Work(want.rank)));
            }
        }
    }

    fn most_urgent(&self, now: MonoTime, last_rank: Rank) -> Option<(DriveIndex, Want)> {
        let mut best: Option<(Urgency, DriveIndex, Want)> = None;
        for drive in self.drives() {
            let is_silent = self.stations[drive.get()].is_known_silent();
            let rests = !self.works[drive.get()].is_moving();
            for want in self.works[drive.get()].wants() {
                if want.rank > last_rank || now < self.wanted_from(drive, &want) {
                    continue;
                }
                let key = (want.rank, is_silent, rests, want.at);
                if best.as_ref().is_none_or(|(best, ..)| key < *best) {
                    best = Some((key, drive, want));
                }
            }
        }
        best.map(|(_, drive, want)| (drive, want))
    }

    /// From when a wish may be granted, as far as the drive is concerned.
    fn wanted_from(&self, drive: DriveIndex, want: &Want) -> MonoTime {
        match want.rank {
            Rank::FirstStop | Rank::RepeatedStop => want.at,
            // A look has a rhythm of its own: a stop waits behind it.
            Rank::Look => {
                let station = &self.stations[drive.get()];
                want.at.max(station.rests_until()).max(station.unmistakable_at(&want.request))
            }
            Rank::Step | Rank::Trip | Rank::Start => {
                let station = &self.stations[drive.get()];
                want.at.max(station.may_be_asked_from()).max(station.unmistakable_at(&want.request))
            }
        }
    }

    fn pick_read(&mut self, now: MonoTime) -> Option<Picked> {
        let stations = &self.stations;
        let may_go = |key: &ReadKey| {
            let station = &stations[key.drive.get()];
            now >= station.may_be_asked_from() && now >= station.unmistakable_at(&key.request())
        };
        let job = self.schedule.take_read(may_go)?;
        Some((job.key.drive, job.key.request(), Purpose::Read(job)))
    }

    /// The most urgent poll that is due; if `aged`, only one that has grown too old to wait for others.
    fn due_poll(&self, now: MonoTime, aged: bool) -> Option<DuePoll> {
        let mut best: Option<(PollUrgency, DuePoll)> = None;
        for (drive, plan) in self.drives().zip(&self.plans) {
            for (index, group, due) in plan.iter().filter(|(.., due)| *due <= now) {
                let urgency = plan.urgency(group, due, now);
                let is_better = best.as_ref().is_none_or(|(best, _)| urgency < *best);
                if is_better && (!aged || plan.is_aged(group, due, now)) && self.may_poll(now, drive, group) {
                    best = Some((urgency, DuePoll { drive, index, group }));
                }
            }
        }
        best.map(|(_, poll)| poll)
    }

    fn may_poll(&self, now: MonoTime, drive: DriveIndex, group: PollGroup) -> bool {
        let station = &self.stations[drive.get()];
        now >= station.may_be_asked_from() && now >= station.unmistakable_at(&poll_request(group))
    }

    fn take_poll(&mut self, now: MonoTime, poll: DuePoll) -> Picked {
        let DuePoll { drive, index, group } = poll;
        let station = &self.stations[drive.get()];
        let may_go = |address, count| now >= station.unmistakable_at(&Request::ReadHolding { address, count });
        let taken = self.plans[drive.get()].take(index, now, &self.setup.drives[drive.get()].model, may_go);
        let (address, count) = taken.unwrap_or((group.address, group.count));
        (drive, Request::ReadHolding { address, count }, Purpose::Poll { address })
    }

    /// When the next frame could go, if anything waits or will be due.
    pub(super) fn work_wake(&self) -> Option<Wake> {
        if self.state == LineState::Down {
            return None;
        }
        let work = self.work_at()?;
        let silence = self.wire.may_send_from();
        Some(if work > silence {
            Wake { at: work, reason: WakeReason::WorkDue }
        } else {
            Wake { at: silence, reason: WakeReason::SilentInterval }
        })
    }

    /// When the next frame may go: what waits, as soon as its station is asked again and its answer cannot be
    /// mistaken or a barrier can settle that.
    fn work_at(&self) -> Option<MonoTime> {
        let wants = self.drives().flat_map(|drive| {
            self.works[drive.get()].wants().map(move |want| match want.rank {
                Rank::FirstStop | Rank::RepeatedStop => want.at,
                Rank::Look => {
                    let unmistakable = self.stations[drive.get()].unmistakable_at(&want.request);
                    let rests_until = self.stations[drive.get()].rests_until();
                    want.at.max(unmistakable.min(self.free_at(drive, &want.request))).max(rests_until)
                }
                _ => want.at.max(self.free_at(drive, &want.request)),
            })
        });
        let reads = self.schedule.reads().map(|key| self.free_at(key.drive, &key.request()));
        let polls = self.drives().zip(&self.plans).flat_map(|(drive, plan)| {
            plan.iter().map(move |(_, group, due)| due.max(self.free_at(drive, &poll_request(group))))
        });
        let trials = self.drives().filter_map(|drive| self.trial_at(drive));
        wants.chain(reads).chain(polls).chain(trials).min()
    }

    pub(super) fn drives(&self) -> impl Iterator<Item = DriveIndex> + use<> {
        (0..self.setup.drives.len() as u16).map(DriveIndex)
    }
}

pub(super) const fn is_stop(rank: Rank) -> bool {
    matches!(rank, Rank::FirstStop | Rank::RepeatedStop)
}

pub(super) fn poll_request(group: PollGroup) -> Request {
    Request::ReadHolding { address: group.address, count: group.count }
}
