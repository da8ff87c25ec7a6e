//! A line that several gateways share: this one listens, takes the line over, or gives it up. A stop goes out from a gateway
//! that may not send, too: as a single frame between those of the master that does.

use super::core::LineCore;
use super::event::{LineEffect, LineWake, WakeReason};
use super::flight::ExchangePurpose;
use super::note::{DriveNote, HeardFrame, LineNote};
use super::roll_call::GatewayFrame;
use super::share::LineShare;
use super::work::{DriveWish, DriveWork, WishRank};
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::native::{NativeOutcome, NativeRefusal};
use crate::domain::standby::StandbyReport;
use crate::domain::time::MonoTime;
use crate::domain::traffic::FramePurpose;
use crate::line::echo::LocalEcho;
use crate::line::exchange::ExchangeEnding;
use crate::line::standby::StandbyChange;
use crate::wire::framing;
use crate::wire::pdu::Request;
use crate::wire::signal::{self, Signal, SignalKind, SignalWord};
use std::time::Duration;

impl LineCore {
    /// Whether another gateway sends on the line, or may send.
    pub(super) fn listens(&self) -> bool {
        self.share.as_ref().is_some_and(LineShare::listens)
    }

    /// The role of this gateway on the line; `None` if it is alone there.
    pub(super) fn standby_report(&self) -> Option<StandbyReport> {
        let now = self.effects.now();
        Some(self.share.as_ref()?.report(now, self.wire.last_byte_at()))
    }

    /// Whether a frame may be decided on at `now`. On a jammed line nothing but stops is sent, over the babble, where no
    /// other gateway can send either.
    pub(super) fn may_send(&self, now: MonoTime) -> bool {
        self.share.as_ref().is_none_or(|share| share.may_send(now)) || self.health.is_jammed()
    }

    /// Asked at `now`, right before the frame of the last [`LineEffect::Transmit`] is handed to the port: whether it may be. A
    /// process that was suspended since the decision may no longer send: another gateway may have taken the line over. The
    /// exchange then ends as if the drive were silent.
    pub fn may_transmit(&mut self, now: MonoTime) -> bool {
        let may_send = self.may_send(now);
        match &mut self.share {
            Some(share) => share.may_transmit(now, may_send),
            None => may_send,
        }
    }

    /// The frame of the last [`LineEffect::Transmit`] was handed to the port, which took until `now`.
    pub fn transmitted(&mut self, now: MonoTime) {
        self.stop_was_transmitted(now);
        let may_signal = self.may_signal();
        let signal_bytes = self.timing.adu_bytes(signal::PDU_BYTES);
        let signal_end = now + self.timing.on_wire(signal_bytes);
        let Some(share) = &mut self.share else { return };
        match share.take_signal() {
            Some(SignalKind::HandOver) => return self.give_way(now),
            Some(SignalKind::Question) => {
                share.role_was_said(now);
                share.calls.was_asked(signal_end, may_signal);
            }
            Some(SignalKind::Listening | SignalKind::Differs) => return share.calls.end_answer(),
            Some(SignalKind::Active) => share.role_was_said(now),
            None => {}
        }
        if let Some(change) = share.was_sent(now) {
            self.give_up_line(now, change, None);
        }
    }

    pub(super) fn share_port_opened(&mut self, now: MonoTime) {
        if let Some(share) = &mut self.share {
            share.port_opened(now);
        }
    }

    pub(super) fn share_port_gone(&mut self, now: MonoTime) {
        let Some(share) = &mut self.share else { return };
        if share.port_gone() {
            self.was_given_up(now);
        }
    }

    /// The operator wants another gateway to take the line over.
    pub(super) fn on_yield(&mut self, now: MonoTime) {
        if let Some(share) = &mut self.share {
            share.yield_line(now);
        }
    }

    /// Hands the line over at `now`, if that is wanted, and nothing is under way. Returns whether the frame for that is on
    /// its way.
    pub(super) fn hand_over(&mut self, now: MonoTime) -> bool {
        let is_busy = self.has_orders();
        let Some(share) = &mut self.share else {
            return false;
        };
        let drives = &self.drives;
        let orders = || {
            let running = drives
                .iter()
                .filter_map(|drive| Some((drive.setup.station, drive.work.order_to_tell()?)));
            running
                .map(|(station, order)| SignalWord::Order(station, order))
                .collect()
        };
        let frame = share.hand_over(now, is_busy, orders);
        self.send_if_any(now, frame)
    }

    fn has_orders(&self) -> bool {
        self.drives.works().any(DriveWork::has_orders)
    }

    /// Asks whether another gateway listens, if it is time for that. Returns whether nothing else may be sent at `now`: a
    /// stop may, and is more important than the answer.
    pub(super) fn call_roll(&mut self, now: MonoTime) -> bool {
        if self.has_due_stop(now) || !self.may_signal() {
            return false;
        }
        let Some(share) = &mut self.share else {
            return false;
        };
        if share.calls.waits_for_listener(now) {
            return true;
        }
        let frame = share.calls.question(now);
        self.send_if_any(now, frame)
    }

    fn has_due_stop(&self, now: MonoTime) -> bool {
        self.wanted_at(WishRank::RepeatedStop)
            .is_some_and(|at| now >= at)
    }

    /// Takes the answer of a listener, if the request `frame` of another master is one. Returns whether it is.
    pub(super) fn hears_listener(&mut self, now: MonoTime, frame: &[u8]) -> bool {
        let signal = self
            .signal_in(frame)
            .filter(|(it, is_own)| it.kind.is_of_listener() && !is_own);
        let Some((signal, _)) = signal else {
            return false;
        };
        let may_signal = self.may_signal();
        if let Some(share) = &mut self.share {
            share.calls.listener_answered(now, signal.kind, may_signal);
        }
        true
    }

    /// When the next question is due.
    pub(super) fn roll_call_at(&self) -> Option<MonoTime> {
        if !self.may_signal() {
            return None;
        }
        self.share.as_ref()?.calls.asks_at()
    }

    /// Until when the line is left silent for an answer; a stop ends that.
    pub(super) fn silent_until(&self) -> Option<MonoTime> {
        if !self.may_signal() {
            return None;
        }
        let until = self.share.as_ref()?.calls.silent_until()?;
        Some(
            self.wanted_at(WishRank::RepeatedStop)
                .map_or(until, |stop| stop.min(until)),
        )
    }

    /// Whether a signal would be heard.
    const fn may_signal(&self) -> bool {
        self.health.carries_requests()
    }

    /// Answers a question of the active gateway, if one was heard just before `now`. Returns whether it does.
    pub(super) fn answer_question(&mut self, now: MonoTime) -> bool {
        let may_answer = self.listens() && self.may_signal();
        let Some(share) = &mut self.share else {
            return false;
        };
        let answer = share.calls.due_answer(now, may_answer);
        self.send_if_any(now, answer.map(GatewayFrame::Signal))
    }

    /// When the answer to a question is due.
    pub(super) fn answer_at(&self) -> Option<MonoTime> {
        self.share.as_ref()?.calls.answers_at()
    }

    /// Says that the line is taken, if that has to be said first. Returns whether nothing else may be sent at `now`.
    pub(super) fn claim(&mut self, now: MonoTime) -> bool {
        let is_claiming = self.claims_at().is_some();
        if is_claiming {
            self.send_signal(now, SignalKind::Active);
        }
        is_claiming
    }

    /// When the signal that the line is taken may be sent, if it has to be said. Stops on a jammed line don't wait for it.
    pub(super) fn claims_at(&self) -> Option<MonoTime> {
        if self.health.is_jammed() {
            return None;
        }
        self.share.as_ref()?.claims_at()
    }

    /// Says that this gateway is active, if it has not said so for some time: a listener may have missed that, and tells a foreign
    /// master from a gateway by it. Returns whether it does. A stop goes first.
    pub(super) fn say_role(&mut self, now: MonoTime) -> bool {
        let is_due =
            !self.has_due_stop(now) && self.role_said_again_at().is_some_and(|at| now >= at);
        if is_due {
            self.send_signal(now, SignalKind::Active);
        }
        is_due
    }

    /// When this gateway is to say again that it is active.
    pub(super) fn role_said_again_at(&self) -> Option<MonoTime> {
        if !self.may_signal() {
            return None;
        }
        self.share.as_ref()?.role_said_again_at()
    }

    /// Nothing else is to be sent: the other gateways hear a signal, if it is time for one.
    pub(super) fn sign_of_life(&mut self, now: MonoTime) {
        if self.sign_of_life_at().is_some_and(|at| now >= at) {
            self.send_signal(now, SignalKind::Active);
        }
    }

    /// When a signal is sent for its own sake, so that the other gateways of the line hear this one.
    pub(super) fn sign_of_life_at(&self) -> Option<MonoTime> {
        if !self.may_signal() {
            return None;
        }
        self.share.as_ref()?.signal_at()
    }

    fn send_if_any(&mut self, now: MonoTime, frame: Option<GatewayFrame>) -> bool {
        match frame {
            Some(GatewayFrame::Word(word)) => self.send_to_gateways(now, &word.request()),
            Some(GatewayFrame::Signal(kind)) => self.send_signal(now, kind),
            None => return false,
        }
        true
    }

    fn send_signal(&mut self, now: MonoTime, kind: SignalKind) {
        let Some(request) = self.share.as_mut().map(|share| share.signal(kind)) else {
            return;
        };
        self.send_to_gateways(now, &request);
    }

    fn send_to_gateways(&mut self, now: MonoTime, request: &Request) {
        let mut frame = Vec::with_capacity(16);
        self.wire
            .broadcast(now, signal::STATION.0, request, Duration::ZERO, &mut frame);
        self.transmit(now, frame, FramePurpose::Probe);
    }

    /// Whether `frame` is a signal of this gateway, which has come back, or a word, which says not whose it is.
    pub(super) fn is_own_signal(&self, frame: &[u8]) -> bool {
        let decoded = framing::decode(self.timing.framing, frame);
        let is_word = decoded
            .is_some_and(|(station, pdu)| SignalWord::decode(Station(station), &pdu).is_some());
        is_word || self.signal_in(frame).is_some_and(|(_, is_own)| is_own)
    }

    /// The signal in `frame`, and whether it is one of this gateway.
    pub(super) fn signal_in(&self, frame: &[u8]) -> Option<(Signal, bool)> {
        let share = self.share.as_ref()?;
        let (station, pdu) = framing::decode(self.timing.framing, frame)?;
        let signal = Signal::decode(Station(station), &pdu)?;
        Some((signal, share.is_own(signal)))
    }

    /// When the line may be handed over, if that is wanted.
    pub(super) fn yields_at(&self) -> Option<MonoTime> {
        self.share.as_ref()?.yields_at(self.has_orders())
    }

    /// The frame that hands the line over is out.
    fn give_way(&mut self, now: MonoTime) {
        let Some(share) = &mut self.share else { return };
        if let Some(change) = share.give_way(now) {
            self.give_up_line(now, change, None);
            self.left_to_another();
        }
    }

    /// Time has passed: the line is taken over, or given up because nothing was sent for too long.
    pub(super) fn pass_share(&mut self, now: MonoTime) {
        let is_free = self.port.is_open()
            && !self.wire.is_busy()
            && now >= self.wire.may_send_from()
            && self.is_usable(now);
        let received = (self.wire.last_byte_at(), self.flight.is_some());
        let Some(share) = &mut self.share else { return };
        match share.pass(now, received, is_free) {
            None => {}
            Some(change @ (StandbyChange::TakenOver | StandbyChange::HandedOver)) => {
                self.take_line_over(now, change == StandbyChange::HandedOver);
            }
            Some(change) => self.give_up_line(now, change, None),
        }
    }

    /// Whether the line carries requests. One that echoes may do so again, as a read shows from time to time.
    fn is_usable(&self, now: MonoTime) -> bool {
        !self.health.is_jammed() && (!self.health.echoes() || now >= self.health.probe_at())
    }

    /// When the share in the line changes, if nothing is heard or sent before.
    pub(super) fn share_wake(&self) -> Option<LineWake> {
        if !self.port.is_open() {
            return None;
        }
        let share = self.share.as_ref()?;
        let at = share.due_at(self.wire.is_busy())?;
        let at = if share.is_active() {
            at
        } else {
            at.max(self.wire.may_send_from())
        };
        let at = if self.health.echoes() {
            at.max(self.health.probe_at())
        } else {
            at
        };
        // A jam ends with a silence, which has a wake of its own.
        let is_jammed = self.health.is_jammed() && share.listens();
        (!is_jammed).then_some(LineWake {
            at,
            reason: WakeReason::LineCheck,
        })
    }

    /// Whether `copy` of our own frame comes from another gateway: they ask the same drives the same questions, and the
    /// adapter is known not to echo.
    pub(super) fn is_no_echo(&self, copy: &[u8]) -> bool {
        let may_echo = !matches!(self.echo.known(), LocalEcho::Excluded | LocalEcho::NotSeen);
        self.share.is_some() && !may_echo && !self.is_own_signal(copy)
    }

    /// An exchange has ended: it may show whether this gateway is the only one that took the line.
    pub(super) fn confirm_share(&mut self, now: MonoTime, is_answered: bool, is_damaged: bool) {
        let is_jammed = self.health.is_jammed();
        let Some(share) = &mut self.share else { return };
        if let Some(change) = share.exchange_ended(now, is_answered, is_damaged, is_jammed) {
            self.give_up_line(now, change, None);
        }
    }

    /// Another master asked something while this gateway is active: there are two.
    pub(super) fn hears_rival(&mut self, now: MonoTime, frame: &[u8]) {
        let Some(share) = &mut self.share else { return };
        let Some(change) = share.heard_rival(now) else {
            return;
        };
        self.give_up_line(now, change, Some(frame));
        // Its request is the first that this gateway listens to.
        if let Some((station, pdu)) = framing::decode(self.timing.framing, frame) {
            self.overhear(now, now, Station(station), &pdu);
        }
    }

    /// Ends what is on the wire and what waits, without leaving the port.
    fn give_up_line(&mut self, now: MonoTime, change: StandbyChange, frame: Option<&[u8]>) {
        self.lose_exchange(now);
        self.clients.end_waiting(
            &NativeOutcome::Refused(NativeRefusal::Standby),
            &mut self.effects,
        );
        if change == StandbyChange::Deaf {
            // No other gateway was heard that might see them.
            self.lose_sight();
        }
        self.was_given_up(now);
        let note = match frame {
            Some(frame) => LineNote::Rival {
                frame: HeardFrame::of(frame),
                is_gateway: self.signal_in(frame).is_some(),
            },
            None => LineNote::GivenUp(change),
        };
        self.effects.push_back(LineEffect::LineNote(note));
    }

    fn was_given_up(&mut self, now: MonoTime) {
        if let Some(share) = &mut self.share {
            share.was_given_up();
        }
        for work in self.drives.works_mut() {
            work.give_up(now, &mut self.effects);
        }
    }

    /// Nothing was heard for long enough, or the line was handed over: this gateway sends from now on.
    fn take_line_over(&mut self, now: MonoTime, was_handed_over: bool) {
        let Some(share) = &mut self.share else { return };
        let taken = share.was_taken_over(now, was_handed_over);
        self.effects
            .push_back(LineEffect::LineNote(if was_handed_over {
                LineNote::HandedOver
            } else {
                LineNote::TakenOver {
                    silent_for: taken.heard_at.map(|at| now.since(at)),
                }
            }));
        for drive in self.drives.iter_mut() {
            if let Some(heard_at) = taken.heard_at {
                // The last request of the other gateway may have been any.
                drive.asked_before(heard_at);
            }
            let remembered = drive.setup.remembered;
            if !taken.is_first
                || !drive
                    .work
                    .remember_on_line(&remembered, now, &mut self.effects)
            {
                drive.work.take_over(now, taken.goes_on, &mut self.effects);
            }
        }
    }

    /// This gateway may not send at `now`: sends a stop that waits, if it is time for that.
    pub(super) fn stop_between(&mut self, now: MonoTime) {
        let Some((drive, want)) = self
            .next_between(now)
            .filter(|(at, ..)| *at <= now)
            .map(|(_, drive, want)| (drive, want))
        else {
            return;
        };
        let Some(share) = &mut self.share else { return };
        share.goes_between(now, want.rank != WishRank::Look);
        if want.rank == WishRank::FirstStop && self.stop_all(now) {
            return;
        }
        let is_first = self.drives[drive].work.has_new_stop();
        if !self.drives[drive]
            .work
            .send(want.rank, now, &mut self.effects)
        {
            return;
        }
        if is_first {
            self.measured.stop_sent(want.at, now);
            self.effects
                .push_back(LineEffect::Note(drive, DriveNote::StopBetween));
        }
        self.open_exchange(now, (drive, want.request, ExchangePurpose::Work(want.rank)));
    }

    /// When the next stop is sent between the frames of another master, as known at `now`, if nothing more is received.
    pub(super) fn between_at(&self, now: MonoTime) -> Option<MonoTime> {
        Some(self.next_between(now)?.0.max(self.wire.may_send_from()))
    }

    fn next_between(&self, now: MonoTime) -> Option<(MonoTime, DriveIndex, DriveWish)> {
        let share = self.share.as_ref()?;
        if !share.listens() {
            return None;
        }
        share.next_between(&self.drives, self.wire.last_byte_at(), now)
    }

    /// The exchange of such a frame has ended.
    pub(super) fn between_ended(
        &mut self,
        now: MonoTime,
        drive: DriveIndex,
        rank: WishRank,
        ending: &ExchangeEnding,
    ) {
        let last_byte_at = self.wire.last_byte_at();
        let Some(share) = &mut self.share else { return };
        if !share.listens() {
            return;
        }
        let is_answered = matches!(
            ending,
            ExchangeEnding::Reply(_) | ExchangeEnding::Exception(_)
        );
        let is_stop = rank != WishRank::Look;
        if share.between_ended(now, last_byte_at, is_answered, is_stop) {
            self.drives[drive].work.stop_again_at(now);
        }
    }

    /// The gateway shuts down while it listens. Another gateway controls the drives, unless this one would have heard it take
    /// the line, and still has control.
    pub(super) fn end_listening(&mut self, now: MonoTime) {
        let is_informed = self
            .share
            .as_ref()
            .is_some_and(|share| share.is_informed(now));
        for work in self.drives.works_mut() {
            if is_informed && work.guard().lease().is_some() {
                work.shut_down(now, &mut self.effects);
            } else {
                work.end();
            }
        }
    }

    /// Takes the `frame` of another master as a stop by that master, if it is a stop for drives of this line. Such a frame
    /// comes from a gateway that listens, and ends no role. Returns whether it is one. The reply to a single write repeats it:
    /// a late one to a stop of this gateway is none.
    pub(super) fn hears_stop(&mut self, now: MonoTime, frame: &[u8]) -> bool {
        if self.share.is_none() {
            return false;
        }
        let Some((_, pdu)) = framing::decode(self.timing.framing, frame) else {
            return false;
        };
        if self.is_answer_to_stop(now, frame) {
            return true;
        }
        let is_late = |drive: DriveIndex| {
            let mut own = Vec::new();
            if let Some((request, _)) = self.drives[drive].station.answered_late(&pdu, now) {
                request.encode(&mut own);
            }
            own == *pdu
        };
        let mut stopped = self.stops_in(frame);
        stopped.retain(|(drive, _)| !is_late(*drive));
        for (drive, coast) in &stopped {
            self.drives[*drive]
                .work
                .stopped_by_another(*coast, now, &mut self.effects);
        }
        if !stopped.is_empty() {
            self.awaits_answer(now, frame, Request::decode(&pdu));
        }
        !stopped.is_empty()
    }

    /// The drive answers the stop `frame` of another gateway first.
    fn awaits_answer(&mut self, now: MonoTime, frame: &[u8], request: Option<Request>) {
        let (Some(share), Some(request)) = (&mut self.share, request) else {
            return;
        };
        let asked = self
            .drives
            .iter()
            .map(|drive| drive.wait_for(&request, &self.timing))
            .max();
        // The other one waits no longer.
        let until = now + asked.unwrap_or_default() / 2;
        share.stop_heard(frame, until);
        self.wire.hold(until);
    }

    /// Whether `frame` is the drive's answer to such a stop, which repeats it. The line is free then.
    fn is_answer_to_stop(&mut self, now: MonoTime, frame: &[u8]) -> bool {
        let Some(share) = &mut self.share else {
            return false;
        };
        let Some(until) = share.take_answer_to_stop(frame) else {
            return false;
        };
        if now < until {
            self.wire.release(until);
        }
        now < until
    }
}
