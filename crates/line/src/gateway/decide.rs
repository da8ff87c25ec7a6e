//! What is sent next, and when the next decision is due.

use super::barrier::BarrierMeans;
use super::core::LineCore;
use super::drive::DriveOnLine;
use super::event::{LineWake, WakeReason};
use super::flight::{ExchangePurpose, OpenFlight, PickedRequest, is_stop, poll_request};
use super::probe;
use super::work::{DriveWish, WishRank};
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::domain::traffic::FramePurpose;
use crate::drive::plan::{PollGroup, Urgency as PollUrgency};
use crate::line::barriers::TRY_PATIENCE;
use crate::line::budget::BROADCAST_TURNAROUND;
use crate::line::exchange::Exchange;
use crate::line::schedule::{NativeQuery, ReadKey};
use crate::wire::pdu::Request;
use std::time::Duration;

/// The least is sent first: by rank, then drives whose wait was not just cut short, then those that answer, then those
/// that move, then by time.
type Urgency = (WishRank, bool, bool, bool, MonoTime);

/// A poll that is due.
#[derive(Clone, Copy)]
struct DuePoll {
    drive: DriveIndex,
    index: usize,
    group: PollGroup,
}

impl LineCore {
    /// Opens the next exchange if the wire is free and has been silent for long enough. On a jammed line only stops
    /// are sent, over the babble.
    pub(super) fn decide(&mut self, now: MonoTime) {
        if !self.port.is_open()
            || self.port.is_parked()
            || self.wire.is_busy()
            || now < self.free_from()
        {
            return;
        }
        self.broadcast.is_over();
        if self.answer_question(now) {
            return;
        }
        if !self.may_send(now) {
            return self.stop_between(now);
        }
        if self.claim(now)
            || self.stop_all(now)
            || self.call_roll(now)
            || self.hand_over(now)
            || self.say_role(now)
        {
            return;
        }
        let Some(picked) = self.pick(now) else {
            return self.sign_of_life(now);
        };
        self.open_exchange(now, picked);
    }

    /// Sends a request, whose reply is awaited.
    pub(super) fn open_exchange(
        &mut self,
        now: MonoTime,
        (drive, request, purpose): PickedRequest,
    ) {
        self.turns.exchange_opened();
        let asked = &self.drives[drive];
        let station = asked.setup.station;
        let was_silent = asked.station.is_known_silent();
        let timeout = asked.wait_for(&request, &self.timing);
        // Between the frames of another master it may meet one: that one then waits for its reply, and leaves a gap.
        let timeout = if self.listens() { timeout / 2 } else { timeout };
        let patience = asked.patience(&request, &self.timing);
        let doubt = now < asked.station.unmistakable_at(&request);
        let in_doubt = asked.station.misses_function(request.function(), now);
        let proves_nothing = request.is_repeated_by_its_reply() && !self.echo.proves_echoes();
        if matches!(request, Request::Loopback { .. } | Request::Unserved { .. }) {
            self.nonces.advance();
        }
        let differs = !request.is_repeated_by_its_reply();
        let function = request.function();
        let doubts_refusal = in_doubt.then(|| request.clone());
        let exchange = Exchange {
            station,
            request,
            timeout,
            in_doubt,
        };
        let mut frame = Vec::with_capacity(16);
        self.measured.sent(now.since(self.wire.may_send_from()));
        self.wire.send(now, exchange, &mut frame);
        self.echo.sent(&frame, differs);
        self.health.sent(drive.get(), function);
        let request_end = now + self.timing.on_wire(frame.len());
        self.drives[drive].station.asked(request_end);
        let overdue_at = patience.map(|patience| request_end + patience);
        let why = purpose.why();
        self.flight = Some(OpenFlight {
            drive,
            purpose,
            doubt,
            doubts_refusal,
            proves_nothing,
            was_silent,
            sent_at: now,
            request_end,
            overdue_at,
            is_overdue: false,
            is_spoilt: false,
            wrong_reply: None,
            noise: 0,
        });
        self.transmit(now, frame, why);
    }

    /// The frame that was decided on last was handed to the port, which took until `now`: only now is a stop sent.
    pub(super) fn stop_was_transmitted(&mut self, now: MonoTime) {
        if self.broadcast.was_transmitted() {
            for work in self.drives.works_mut() {
                if let Some(accepted) = work.stop_was_broadcast(&mut self.effects) {
                    self.measured.stop_sent(accepted, now);
                }
            }
        } else if let Some(OpenFlight {
            drive,
            purpose: ExchangePurpose::Work(rank),
            ..
        }) = &self.flight
            && is_stop(*rank)
        {
            let DriveOnLine {
                work, deaf_until, ..
            } = &mut self.drives[*drive];
            work.stop_was_transmitted(now, *deaf_until, &mut self.effects);
        }
    }

    /// Hands `frame` to the port.
    pub(super) fn transmit(&mut self, now: MonoTime, frame: Vec<u8>, why: FramePurpose) {
        self.counters.requests += 1;
        self.traffic.transmit(
            now,
            (frame, why),
            &self.wire,
            &self.timing,
            &mut self.effects,
        );
    }

    /// Sends the stop that every drive of the line waits for as one frame, if there is such a stop. Returns whether it did.
    pub(super) fn stop_all(&mut self, now: MonoTime) -> bool {
        let Some((station, request)) = self.broadcast.common(&self.drives, now) else {
            return false;
        };
        self.measured.sent(now.since(self.wire.may_send_from()));
        let mut frame = Vec::with_capacity(16);
        self.wire
            .broadcast(now, station, &request, BROADCAST_TURNAROUND, &mut frame);
        let end = now + self.timing.on_wire(frame.len());
        for drive in self.drives.iter_mut() {
            drive
                .station
                .pause_until(end + drive.setup.model.timing.pause_after(false));
        }
        self.counters.broadcasts += 1;
        self.broadcast.is_sent();
        self.transmit(now, frame, FramePurpose::Stop);
        true
    }

    const fn means(&self) -> BarrierMeans {
        BarrierMeans::of(&self.echo, &self.nonces)
    }

    fn pick(&mut self, now: MonoTime) -> Option<PickedRequest> {
        if self.health.is_jammed() {
            self.pick_work(now, WishRank::RepeatedStop)
        } else if self.health.echoes() {
            let work = self.pick_work(now, WishRank::Look);
            work.or_else(|| self.pick_due_probe(now))
        } else {
            self.pick_any(now)
        }
    }

    /// The drives' own work, barriers, overdue polls, then native reads and polls alternately. Between the first steps of
    /// two commands, others get an exchange if they wait.
    fn pick_any(&mut self, now: MonoTime) -> Option<PickedRequest> {
        if let Some(picked) = self.pick_work(now, self.turns.last_rank_first()) {
            return Some(picked);
        }
        if let Some(drive) = probe::waited_for(&self.drives, self.echo.known(), now) {
            return Some(probe::of_drive(&self.drives, now, drive));
        }
        if let Some((drive, request)) = self.means().pick(now, &self.drives, &self.clients) {
            self.counters.barriers += 1;
            return Some((drive, request, ExchangePurpose::Barrier));
        }
        if let Some(picked) = self.pick_trial(now, TRY_PATIENCE) {
            return Some(picked);
        }
        // The remaining steps of the last command were not a turn of others.
        self.turns.others_have_theirs();
        let other = self
            .pick_other(now)
            .or_else(|| self.pick_work(now, WishRank::Start));
        other.or_else(|| self.pick_trial(now, Duration::ZERO))
    }

    fn pick_trial(&mut self, now: MonoTime, patience: Duration) -> Option<PickedRequest> {
        let picked = self.means().pick_trial(now, &self.drives, patience)?;
        self.counters.barriers += 1;
        Some(picked)
    }

    /// On an echoing line: the read that checks whether it still echoes.
    fn pick_due_probe(&mut self, now: MonoTime) -> Option<PickedRequest> {
        let is_due = self.health.takes_probe(now);
        is_due.then(|| probe::of_any(&self.drives, now))
    }

    fn pick_other(&mut self, now: MonoTime) -> Option<PickedRequest> {
        if self.turns.is_clients_share()
            && let Some(picked) = self.pick_read(now)
        {
            self.turns.no_aged_poll();
            return Some(picked);
        }
        if let Some(poll) = self.due_poll(now, true) {
            self.turns.aged_poll_was_taken();
            return Some(self.take_poll(now, poll));
        }
        self.turns.no_aged_poll();
        if self.turns.take_polls_turn()
            && let Some(poll) = self.due_poll(now, false)
        {
            return Some(self.take_poll(now, poll));
        }
        if let Some(picked) = self.pick_read(now) {
            return Some(picked);
        }
        let poll = self.due_poll(now, false)?;
        Some(self.take_poll(now, poll))
    }

    /// The most urgent wish of any drive up to `last_rank`; answering drives before silent ones, moving ones before
    /// those at rest. A stop waits for nothing; everything else waits for late replies and back-offs.
    fn pick_work(&mut self, now: MonoTime, last_rank: WishRank) -> Option<PickedRequest> {
        loop {
            let (drive, want) = self.most_urgent(now, last_rank)?;
            let is_new_stop =
                want.rank == WishRank::FirstStop && self.drives[drive].work.has_new_stop();
            if self.drives[drive]
                .work
                .send(want.rank, now, &mut self.effects)
            {
                self.turns.work_was_taken(want.rank);
                if is_new_stop {
                    self.measured.stop_sent(want.at, now);
                }
                return Some((drive, want.request, ExchangePurpose::Work(want.rank)));
            }
        }
    }

    fn most_urgent(&self, now: MonoTime, last_rank: WishRank) -> Option<(DriveIndex, DriveWish)> {
        let mut best: Option<(Urgency, DriveIndex, DriveWish)> = None;
        for drive in self.drives.iter() {
            let is_silent = drive.station.is_known_silent() || now < drive.station.rests_until();
            let rests = !drive.work.is_moving();
            for want in drive.work.wants() {
                if want.rank > last_rank
                    || now < drive.wanted_from(&want)
                    || probe::is_needed(self.echo.known(), &want)
                {
                    continue;
                }
                let key = (
                    want.rank,
                    self.turns.is_cut_short(drive.index),
                    is_silent,
                    rests,
                    want.at,
                );
                if best.as_ref().is_none_or(|(best, ..)| key < *best) {
                    best = Some((key, drive.index, want));
                }
            }
        }
        best.map(|(_, drive, want)| (drive, want))
    }

    fn pick_read(&mut self, now: MonoTime) -> Option<PickedRequest> {
        let drives = &self.drives;
        let may_go = |key: &ReadKey| drives[key.drive].may_be_asked(now, &key.request());
        let job = self.clients.take(may_go)?;
        Some((job.key.drive, job.key.request(), ExchangePurpose::Read(job)))
    }

    /// The most urgent poll that is due; if `aged`, only an overdue one.
    fn due_poll(&self, now: MonoTime, aged: bool) -> Option<DuePoll> {
        let mut best: Option<(PollUrgency, DuePoll)> = None;
        for drive in self.drives.iter() {
            let plan = &drive.plan;
            for (index, group, due) in plan.iter().filter(|(.., due)| *due <= now) {
                let urgency = plan.urgency(group, due, now);
                let is_better = best.as_ref().is_none_or(|(best, _)| urgency < *best);
                let is_old_enough = !aged || plan.is_aged(group, due, now);
                if is_better && is_old_enough && drive.may_be_asked(now, &poll_request(group)) {
                    best = Some((
                        urgency,
                        DuePoll {
                            drive: drive.index,
                            index,
                            group,
                        },
                    ));
                }
            }
        }
        best.map(|(_, poll)| poll)
    }

    fn take_poll(&mut self, now: MonoTime, poll: DuePoll) -> PickedRequest {
        let DuePoll {
            drive,
            index,
            group,
        } = poll;
        let DriveOnLine {
            station,
            plan,
            setup,
            ..
        } = &mut self.drives[drive];
        let may_go =
            |address, count| now >= station.unmistakable_at(&Request::Read { address, count });
        let taken = plan.take(index, now, &setup.model, may_go);
        let (address, count) = taken.unwrap_or((group.address, group.count));
        // A client may wait for the same words: then one exchange serves both.
        let same = ReadKey {
            drive,
            what: NativeQuery::Words { address, count },
        };
        let purpose = self
            .clients
            .take_same(&same)
            .map_or(ExchangePurpose::Poll, ExchangePurpose::Read);
        (drive, Request::Read { address, count }, purpose)
    }

    /// When a frame may be sent. During babble there is no wait for silence.
    fn free_from(&self) -> MonoTime {
        if self.health.is_jammed() {
            self.wire.held_until()
        } else {
            self.wire.may_send_from()
        }
    }

    /// When the next frame could be sent, if anything waits or will be due.
    pub(super) fn work_wake(&self) -> Option<LineWake> {
        if self.port.is_parked() {
            None
        } else {
            self.frame_wake()
        }
    }

    /// When the next frame could be sent over a connection.
    pub(super) fn frame_wake(&self) -> Option<LineWake> {
        if !self.port.is_open() {
            return None;
        }
        let silence = self.wire.may_send_from();
        if self.health.is_jammed() {
            // The first silence ends the jam; a stop does not wait for it.
            let stop = self
                .wanted_at(WishRank::RepeatedStop)
                .unwrap_or(MonoTime::NEVER);
            let at = stop.max(self.wire.held_until()).min(silence);
            return Some(LineWake {
                at,
                reason: WakeReason::SilentInterval,
            });
        }
        if self.listens() {
            let now = self.effects.now();
            let at = self
                .answer_at()
                .into_iter()
                .chain(self.between_at(now))
                .min()?
                .max(silence);
            return Some(LineWake {
                at,
                reason: WakeReason::WorkDue,
            });
        }
        let any = || {
            let others = [
                self.sign_of_life_at(),
                self.role_said_again_at(),
                self.yields_at(),
                self.roll_call_at(),
            ];
            others.into_iter().chain([self.work_at()]).flatten().min()
        };
        let work = self
            .claims_at()
            .or_else(|| self.silent_until())
            .or_else(any)?;
        Some(if work > silence {
            LineWake {
                at: work,
                reason: WakeReason::WorkDue,
            }
        } else {
            LineWake {
                at: silence,
                reason: WakeReason::SilentInterval,
            }
        })
    }

    /// When the next frame may be sent: waiting work as soon as its station's back-off is over and its reply is
    /// unambiguous, or a barrier can make it so.
    pub(super) fn work_at(&self) -> Option<MonoTime> {
        if self.health.echoes() {
            return self
                .wanted_at(WishRank::Look)
                .into_iter()
                .chain([self.health.probe_at()])
                .min();
        }
        let means = self.means();
        let wants = self.drives.iter().flat_map(|drive| {
            drive.work.wants().map(move |want| match want.rank {
                WishRank::FirstStop | WishRank::RepeatedStop => {
                    want.at.max(drive.station.pauses_until())
                }
                WishRank::Look => {
                    let unmistakable = drive.station.unmistakable_at(&want.request);
                    let free_at = unmistakable.min(means.free_at(drive, &want.request));
                    want.at
                        .max(free_at)
                        .max(drive.station.rests_until())
                        .max(drive.station.pauses_until())
                }
                rank if drive.is_withheld(rank) => MonoTime::NEVER,
                _ => want.at.max(means.free_at(drive, &want.request)),
            })
        });
        let reads = self
            .clients
            .keys()
            .map(|key| means.free_at(&self.drives[key.drive], &key.request()));
        let polls = self.drives.iter().flat_map(|drive| {
            drive
                .plan
                .iter()
                .map(move |(_, group, due)| due.max(means.free_at(drive, &poll_request(group))))
        });
        let trials = self.drives.iter().filter_map(|drive| means.trial_at(drive));
        wants.chain(reads).chain(polls).chain(trials).min()
    }

    /// When the next wish up to `last_rank` may be granted.
    pub(super) fn wanted_at(&self, last_rank: WishRank) -> Option<MonoTime> {
        let wants = self
            .drives
            .iter()
            .flat_map(|drive| drive.work.wants().map(move |want| (drive, want)));
        let urgent = wants.filter(|(_, want)| want.rank <= last_rank);
        urgent.map(|(drive, want)| drive.wanted_from(&want)).min()
    }
}
