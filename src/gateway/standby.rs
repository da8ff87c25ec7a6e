//! A line that several gateways share: this one listens, takes the line over, or gives it up.

use super::core::LineCore;
use super::event::{LineEffect, LineWake, WakeReason};
use super::note::{HeardFrame, LineNote};
use super::share::LineShare;
use super::work::{DriveWork, WishRank};
use crate::domain::ids::Station;
use crate::domain::native::{NativeOutcome, NativeRefusal};
use crate::domain::report::LineFault;
use crate::domain::standby::{LineRole, StandbyReport, StandbyTrouble};
use crate::domain::time::MonoTime;
use crate::domain::traffic::FramePurpose;
use crate::line::echo::LocalEcho;
use crate::line::roll_call::RollCall;
use crate::line::standby::{ROLE_SAID_EVERY, StandbyChange};
use crate::wire::framing;
use crate::wire::pdu::Request;
use crate::wire::signal::{self, Signal, SignalKind, SignalWord};
use std::time::Duration;

/// How long a listener hears bytes without a sound frame before its speed or polarity must be wrong.
const NOISE_ALONE: Duration = Duration::from_secs(10);
/// How long a station that this gateway lacks is reported after it was last talked to.
const STRANGER_FOR: Duration = Duration::from_secs(120);
/// How long a line that is to be handed over waits for a moment at which nothing is under way.
const YIELD_WAIT: Duration = Duration::from_secs(5);

impl LineCore {
    /// Whether another gateway sends on the line, or may send.
    pub(super) fn listens(&self) -> bool {
        self.share
            .as_ref()
            .is_some_and(|share| share.rule.role() == LineRole::Listening)
    }

    /// The role of this gateway on the line; `None` if it is alone there.
    pub(super) fn standby_report(&self) -> Option<StandbyReport> {
        let share = self.share.as_ref()?;
        let LineShare {
            take_overs,
            given_up,
            rivals,
            kept,
            ..
        } = *share;
        let now = self.effects.now();
        let (role, hears_other) = (share.rule.role(), share.rule.hears_other(now));
        let listener = share.roll_call.and_then(|call| call.listener());
        let hears_noise = self.wire.last_byte_at().since(share.sound_at) >= NOISE_ALONE;
        let stranger = share
            .stranger
            .filter(|(_, at)| now.since(*at) < STRANGER_FOR);
        let trouble = StandbyTrouble {
            is_deaf: share.rule.is_deaf() || (role == LineRole::Listening && hears_noise),
            files_differ: share.differs == Some(true),
            unknown_station: stranger.map(|(station, _)| station),
        };
        Some(StandbyReport {
            role,
            take_overs,
            given_up,
            rivals,
            hears_other,
            listener,
            kept,
            trouble,
        })
    }

    /// Whether a frame may be decided on at `now`. On a jammed line nothing but stops is sent, over the babble, where no
    /// other gateway can send either.
    pub(super) fn may_send(&self, now: MonoTime) -> bool {
        self.share
            .as_ref()
            .is_none_or(|share| share.rule.may_send(now))
            || self.health.is_jammed()
    }

    /// Asked at `now`, right before the frame of the last [`LineEffect::Transmit`] is handed to the port: whether it may be. A
    /// process that was suspended since the decision may no longer send: another gateway may have taken the line over. The
    /// exchange then ends as if the drive were silent.
    pub fn may_transmit(&mut self, now: MonoTime) -> bool {
        let may_send = self.may_send(now);
        let Some(share) = &mut self.share else {
            return may_send;
        };
        let is_answer = share.signal.is_some_and(SignalKind::is_of_listener);
        // A stop between the frames of another gateway.
        let is_between = share.gap.take_frame(now) && share.rule.role() == LineRole::Listening;
        let may = if is_answer {
            share.answer.is_some_and(|answer| answer.may_be_sent(now))
        } else {
            may_send
        };
        let may = may || is_between;
        if !may {
            share.signal = None;
        } else if !is_answer && !is_between {
            share.rule.sent(now);
        }
        may
    }

    /// The frame of the last [`LineEffect::Transmit`] was handed to the port, which took until `now`.
    pub fn transmitted(&mut self, now: MonoTime) {
        self.stop_was_transmitted(now);
        match self.share.as_mut().and_then(|share| share.signal.take()) {
            Some(SignalKind::HandOver) => return self.give_way(now),
            Some(SignalKind::Question) => {
                self.role_was_said(now);
                self.roll_was_called(now);
            }
            Some(SignalKind::Listening | SignalKind::Differs) => {
                return self.share.iter_mut().for_each(|share| share.answer = None);
            }
            Some(SignalKind::Active) => self.role_was_said(now),
            None => {}
        }
        if let Some(change) = self
            .share
            .as_mut()
            .and_then(|share| share.rule.was_sent(now))
        {
            self.give_up_line(now, change, None);
        }
    }

    pub(super) fn share_port_opened(&mut self, now: MonoTime) {
        if let Some(share) = &mut self.share {
            share.rule.port_opened(now);
            share.sound_at = now;
            share.listener.clear();
        }
    }

    pub(super) fn share_port_gone(&mut self, now: MonoTime) {
        let Some(share) = &mut self.share else { return };
        (share.signal, share.answer, share.gave_way) = (None, None, false);
        if share.rule.port_gone() {
            self.count_given_up(now);
        }
    }

    /// The operator wants another gateway to take the line over: it is handed over as soon as nothing is under way.
    pub(super) fn on_yield(&mut self, now: MonoTime) {
        if let Some(share) = self
            .share
            .as_mut()
            .filter(|share| share.rule.role() == LineRole::Active)
        {
            share.yields_until = Some(now + YIELD_WAIT);
            share.to_tell = None;
            share
                .roll_call
                .iter_mut()
                .for_each(|call| call.ask_again(now));
        }
    }

    /// Hands the line over at `now`, if that is wanted, and nothing is under way. Returns whether the frame for that is on
    /// its way.
    pub(super) fn hand_over(&mut self, now: MonoTime) -> bool {
        let is_busy = self.drives.works().any(DriveWork::has_orders);
        let Some(share) = self
            .share
            .as_mut()
            .filter(|share| share.yields_until.is_some())
        else {
            return false;
        };
        if share.yields_until.is_some_and(|until| now >= until) {
            share.yields_until = None;
            return false;
        }
        match share.roll_call.and_then(|call| call.listener()) {
            Some(true) if !is_busy => {}
            // Nothing changes.
            Some(false) => {
                share.yields_until = None;
                share.kept += 1;
                return false;
            }
            Some(true) | None => return false,
        }
        // The other one may have been started after the orders that it takes over.
        let drives = &self.drives;
        let to_tell = share.to_tell.get_or_insert_with(|| {
            let told = drives
                .iter()
                .filter_map(|drive| Some((drive.setup.station, drive.work.order_to_tell()?)));
            told.map(|(station, order)| SignalWord::Order(station, order))
                .collect()
        });
        if let Some(word) = to_tell.pop() {
            self.send_word(now, word);
            return true;
        }
        share.yields_until = None;
        self.send_signal(now, SignalKind::HandOver);
        true
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
        self.share.as_ref()?.rule.claims_at()
    }

    /// Says that this gateway is active, if it has not said so for some time: a listener may have missed that, and tells a foreign
    /// master from a gateway by it. Returns whether it does. A stop goes first.
    pub(super) fn say_role(&mut self, now: MonoTime) -> bool {
        let has_stop = self
            .wanted_at(WishRank::RepeatedStop)
            .is_some_and(|at| now >= at);
        let is_due = !has_stop && self.role_said_again_at().is_some_and(|at| now >= at);
        if is_due {
            self.send_signal(now, SignalKind::Active);
        }
        is_due
    }

    /// When this gateway is to say again that it is active.
    pub(super) fn role_said_again_at(&self) -> Option<MonoTime> {
        let share = self.share.as_ref()?;
        let is_active = share.rule.role() == LineRole::Active && self.may_signal();
        is_active.then(|| share.role_said_at + ROLE_SAID_EVERY)
    }

    fn role_was_said(&mut self, now: MonoTime) {
        self.share
            .iter_mut()
            .for_each(|share| share.role_said_at = now);
    }

    /// Nothing else is to be sent: the other gateways hear a signal, if it is time for one.
    pub(super) fn sign_of_life(&mut self, now: MonoTime) {
        if self.sign_of_life_at().is_some_and(|at| now >= at) {
            self.send_signal(now, SignalKind::Active);
        }
    }

    pub(super) fn send_signal(&mut self, now: MonoTime, kind: SignalKind) {
        let Some(request) = self.share.as_mut().map(|share| share.signal(kind)) else {
            return;
        };
        self.send_to_gateways(now, &request);
    }

    /// Tells the other gateways something.
    pub(super) fn send_word(&mut self, now: MonoTime, word: SignalWord) {
        self.send_to_gateways(now, &word.request());
    }

    fn send_to_gateways(&mut self, now: MonoTime, request: &Request) {
        let mut frame = Vec::with_capacity(16);
        self.wire
            .broadcast(now, signal::STATION.0, request, Duration::ZERO, &mut frame);
        self.counters.requests += 1;
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
        let share = self.share.as_ref()?;
        let until = share.yields_until?;
        let is_known = share
            .roll_call
            .is_some_and(|call| call.listener().is_some());
        Some(
            if is_known && !self.drives.works().any(DriveWork::has_orders) {
                MonoTime::ZERO
            } else {
                until
            },
        )
    }

    /// The frame that hands the line over is out.
    fn give_way(&mut self, now: MonoTime) {
        let Some(share) = &mut self.share else { return };
        // Every rank has had its turn by then.
        let wait = share.rule.times().take_over_after;
        share.gave_way = true;
        if let Some(change) = share.rule.give_up(now, wait) {
            self.give_up_line(now, change, None);
            self.left_to_another();
        }
    }

    /// Time has passed: the line is taken over, or given up because nothing was sent for too long.
    pub(super) fn pass_share(&mut self, now: MonoTime) {
        let is_free = self.is_open
            && !self.wire.is_busy()
            && now >= self.wire.may_send_from()
            && self.is_usable(now);
        let last_byte_at = self.wire.last_byte_at();
        let is_own = self.flight.is_some();
        let change = self.share.as_mut().and_then(|share| {
            if !is_own && last_byte_at > share.own_bytes_at {
                share.rule.received(last_byte_at);
            }
            share.rule.pass(now, is_free)
        });
        match change {
            None => {}
            Some(change @ (StandbyChange::TakenOver | StandbyChange::HandedOver)) => {
                self.take_line_over(now, change == StandbyChange::HandedOver);
            }
            Some(change) => self.give_up_line(now, change, None),
        }
    }

    /// Whether the line carries requests. One that echoes may do so again, as a read shows from time to time.
    fn is_usable(&self, now: MonoTime) -> bool {
        match self.health.trouble {
            Some(LineFault::Jammed) => false,
            Some(LineFault::Echo) => now >= self.health.probe_at,
            _ => true,
        }
    }

    /// When the share in the line changes, if nothing is heard or sent before.
    pub(super) fn share_wake(&self) -> Option<LineWake> {
        if !self.is_open {
            return None;
        }
        let share = self.share.as_ref()?;
        // While a stop of its own is on the wire, a listener takes no line.
        let looks_at = if self.wire.is_busy() {
            share.rule.looks_at()
        } else {
            None
        };
        let at = looks_at.or_else(|| share.rule.due_at())?;
        let at = if share.rule.role() == LineRole::Active {
            at
        } else {
            at.max(self.wire.may_send_from())
        };
        let at = if self.health.trouble == Some(LineFault::Echo) {
            at.max(self.health.probe_at)
        } else {
            at
        };
        // A jam ends with a silence, which has a wake of its own.
        let is_jammed = self.health.is_jammed() && share.rule.role() == LineRole::Listening;
        (!is_jammed).then_some(LineWake {
            at,
            reason: WakeReason::LineCheck,
        })
    }

    /// When a signal is sent for its own sake, so that the other gateways of the line hear this one.
    pub(super) fn sign_of_life_at(&self) -> Option<MonoTime> {
        if !self.may_signal() {
            return None;
        }
        self.share.as_ref()?.rule.signal_at()
    }

    /// Whether `copy` of our own frame comes from another gateway: they ask the same drives the same questions, and the
    /// adapter is known not to echo.
    pub(super) fn is_no_echo(&self, copy: &[u8]) -> bool {
        let may_echo = !matches!(self.echo.known(), LocalEcho::Excluded | LocalEcho::NotSeen);
        self.share.is_some() && !may_echo && !self.is_own_signal(copy)
    }

    /// The first exchanges since the line was taken over show whether this gateway is the only one that took it: one that
    /// is answered, or silence or something damaged instead.
    pub(super) fn confirm_share(&mut self, now: MonoTime, is_answered: bool, is_damaged: bool) {
        if let Some(share) = &mut self.share
            && !is_answered
            && !self.health.is_jammed()
        {
            share.rule.missed();
        }
        let Some(share) = self.share.as_mut().filter(|share| !share.is_confirmed) else {
            return;
        };
        share.is_confirmed = is_answered;
        let collided = if is_answered {
            None
        } else {
            share.rule.unanswered(now, is_damaged)
        };
        if let Some(change) = collided {
            self.give_up_line(now, change, None);
        }
    }

    /// Another master asked something while this gateway is active: there are two.
    pub(super) fn hears_rival(&mut self, now: MonoTime, frame: &[u8]) {
        let Some(share) = &mut self.share else { return };
        let Some(change) = share.rule.heard_request(now) else {
            return;
        };
        share.rivals += 1;
        share.has_heard_other = true;
        self.give_up_line(now, change, Some(frame));
        // Its request is the first that this gateway listens to.
        if let Some((station, pdu)) = framing::decode(self.timing.framing, frame) {
            self.overhear(now, now, Station(station), &pdu);
        }
    }

    /// Ends what is on the wire and what waits, without leaving the port.
    fn give_up_line(&mut self, now: MonoTime, change: StandbyChange, frame: Option<&[u8]>) {
        self.lose_exchange(now);
        let waiting = self.schedule.clear();
        self.end_all(waiting, &NativeOutcome::Refused(NativeRefusal::Standby));
        if change == StandbyChange::Deaf {
            // No other gateway was heard that might see them.
            self.lose_sight();
        }
        self.count_given_up(now);
        let note = match frame {
            Some(frame) => LineNote::Rival {
                frame: HeardFrame::of(frame),
                is_gateway: self.signal_in(frame).is_some(),
            },
            None => LineNote::GivenUp(change),
        };
        self.effects.push_back(LineEffect::LineNote(note));
    }

    fn count_given_up(&mut self, now: MonoTime) {
        if let Some(share) = &mut self.share {
            share.given_up += 1;
            (share.roll_call, share.differs) = (None, None);
            share.listener.clear();
            share.unanswered.fill(0);
        }
        for work in self.drives.works_mut() {
            work.give_up(now, &mut self.effects);
        }
    }

    /// Nothing was heard for long enough, or the line was handed over: this gateway sends from now on.
    fn take_line_over(&mut self, now: MonoTime, was_handed_over: bool) {
        let Some(share) = &mut self.share else { return };
        share.take_overs += 1;
        share.is_confirmed = false;
        (share.roll_call, share.answer) = (Some(RollCall::new(now)), None);
        // No other gateway took what this one gave: its own orders go on as those of another one would.
        let goes_on = was_handed_over || std::mem::take(&mut share.gave_way);
        // A signal that was to hand the line over, and could not be sent any more, does so no more.
        (share.yields_until, share.signal, share.differs) = (None, None, None);
        share.listener.clear();
        let heard_at = share.rule.heard_at();
        let is_first = !share.has_heard_other;
        self.effects
            .push_back(LineEffect::LineNote(if was_handed_over {
                LineNote::HandedOver
            } else {
                LineNote::TakenOver {
                    silent_for: heard_at.map(|at| now.since(at)),
                }
            }));
        for drive in self.drives.iter_mut() {
            if let Some(heard_at) = heard_at {
                // The last request of the other gateway may have been any.
                drive.asked_before(heard_at);
            }
            let remembered = drive.setup.remembered;
            if !is_first
                || !drive
                    .work
                    .remember_on_line(&remembered, now, &mut self.effects)
            {
                drive.work.take_over(now, goes_on, &mut self.effects);
            }
        }
        if let Some(share) = &mut self.share {
            share.has_heard_other = true;
        }
    }
}
