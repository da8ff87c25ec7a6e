//! What this gateway knows of a line that it shares with others, and its part in it.

use super::digest::digest;
use super::drive::LineDrives;
use super::roll_call::{GatewayFrame, LineRollCall};
use super::setup::LineSetup;
use super::work::{DriveWish, WishRank};
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::standby::{LineRole, StandbyReport, StandbyTrouble};
use crate::domain::time::MonoTime;
use crate::line::gap::MasterGaps;
use crate::line::overheard::{OverheardFrame, RequestListener};
use crate::line::standby::{ROLE_SAID_EVERY, SIGNALS_WITHIN, StandbyChange, StandbyRule};
use crate::wire::pdu::Request;
use crate::wire::signal::{self, Signal, SignalKind, SignalWord};
use std::time::Duration;

/// How long a listener hears bytes without a sound frame before its speed or polarity must be wrong.
const NOISE_ALONE: Duration = Duration::from_secs(10);
/// How long a station that this gateway lacks is reported after it was last talked to.
const STRANGER_FOR: Duration = Duration::from_secs(120);
/// How long a line that is to be handed over waits for a moment at which nothing is under way.
const YIELD_WAIT: Duration = Duration::from_secs(5);
/// Requests in a row that a station leaves unanswered before a listener shows it as offline.
const SILENT_AFTER: u8 = 3;

/// The share of this gateway in a line.
#[derive(Debug)]
pub(super) struct LineShare {
    rule: StandbyRule,
    listener: RequestListener,
    pub calls: LineRollCall,
    /// Unanswered requests of others in a row, per drive.
    unanswered: Vec<u8>,
    /// Another gateway was heard since this one was started: what it remembers of the orders then is out of date.
    has_heard_other: bool,
    /// A drive has answered since the line was taken over.
    is_confirmed: bool,
    /// Until when the line is to be handed over, as soon as nothing is under way.
    yields_until: Option<MonoTime>,
    /// Where a stop fits while another one sends.
    gap: MasterGaps,
    /// This gateway gave the line up by itself, and no other gateway was heard since.
    gave_way: bool,
    /// The signal that is on its way to the port.
    signal: Option<SignalKind>,
    /// When it last said that it is active.
    role_said_at: MonoTime,
    /// The stop of another gateway that was heard last while this one is active, and until when its answer may come.
    heard_stop: Option<(Vec<u8>, MonoTime)>,
    /// What is still to be sent before the line is handed over; `None`: that is not known yet.
    to_tell: Option<Vec<SignalWord>>,
    /// A station that is no drive of this gateway, and when it was last talked to.
    stranger: Option<(Station, MonoTime)>,
    /// When a sound frame was last heard.
    sound_at: MonoTime,
    /// When the last exchange of its own between the frames of others had ended: its bytes end no silence.
    own_bytes_at: MonoTime,
    /// The number of this start of the gateway in its signals.
    sender: u16,
    take_overs: u64,
    given_up: u64,
    rivals: u64,
    kept: u64,
}

/// A line that was taken over.
#[derive(Debug)]
pub(super) struct TakenLine {
    /// The orders of its drives go on.
    pub goes_on: bool,
    /// When another gateway was heard last.
    pub heard_at: Option<MonoTime>,
    /// No other gateway was heard since this one was started.
    pub is_first: bool,
}

impl LineShare {
    /// The share in the line of `setup`; `None` if no other gateway shares it.
    pub fn of(setup: &LineSetup) -> Option<Self> {
        Some(Self {
            rule: StandbyRule::new(setup.standby?, setup.first_epoch),
            listener: RequestListener::default(),
            calls: LineRollCall::new(digest(setup)),
            unanswered: vec![0; setup.drives.len()],
            has_heard_other: false,
            is_confirmed: false,
            yields_until: None,
            gap: MasterGaps::new(setup.standby?.answer_after, setup.first_epoch),
            gave_way: false,
            signal: None,
            role_said_at: MonoTime::ZERO,
            heard_stop: None,
            to_tell: None,
            stranger: None,
            sound_at: MonoTime::ZERO,
            own_bytes_at: MonoTime::ZERO,
            sender: sender(setup.first_epoch),
            take_overs: 0,
            given_up: 0,
            rivals: 0,
            kept: 0,
        })
    }

    /// Whether another gateway sends on the line, or may send.
    pub fn listens(&self) -> bool {
        self.rule.role() == LineRole::Listening
    }

    pub fn is_active(&self) -> bool {
        self.rule.role() == LineRole::Active
    }

    /// The role of this gateway at `now`, on a line that brought its last byte at `last_byte_at`.
    pub fn report(&self, now: MonoTime, last_byte_at: MonoTime) -> StandbyReport {
        let role = self.rule.role();
        let hears_noise = last_byte_at.since(self.sound_at) >= NOISE_ALONE;
        let stranger = self
            .stranger
            .filter(|(_, at)| now.since(*at) < STRANGER_FOR);
        StandbyReport {
            role,
            take_overs: self.take_overs,
            given_up: self.given_up,
            rivals: self.rivals,
            hears_other: self.rule.hears_other(now),
            listener: self.calls.listener(),
            kept: self.kept,
            trouble: StandbyTrouble {
                is_deaf: self.rule.is_deaf() || (self.listens() && hears_noise),
                files_differ: self.calls.files_differ(),
                unknown_station: stranger.map(|(station, _)| station),
            },
        }
    }

    pub fn may_send(&self, now: MonoTime) -> bool {
        self.rule.may_send(now)
    }

    /// Whether this gateway would have heard another one take the line.
    pub fn is_informed(&self, now: MonoTime) -> bool {
        self.rule.knowledge().is_informed(now)
    }

    /// When the signal that the line is taken may be sent, if it has to be said.
    pub const fn claims_at(&self) -> Option<MonoTime> {
        self.rule.claims_at()
    }

    /// When this gateway is to say again that it is active.
    pub fn role_said_again_at(&self) -> Option<MonoTime> {
        self.is_active()
            .then(|| self.role_said_at + ROLE_SAID_EVERY)
    }

    /// When a signal is sent for its own sake, so that the other gateways of the line hear this one.
    pub fn signal_at(&self) -> Option<MonoTime> {
        self.rule.signal_at()
    }

    /// When the share in the line changes, if nothing is heard or sent before. While an exchange of its own `is_open`, a
    /// listener takes no line.
    pub fn due_at(&self, is_open: bool) -> Option<MonoTime> {
        let looks_at = if is_open { self.rule.looks_at() } else { None };
        looks_at.or_else(|| self.rule.due_at())
    }

    /// Whether the last frame may be handed to the port at `now`, on a line on which this gateway `may_send` or not.
    pub fn may_transmit(&mut self, now: MonoTime, may_send: bool) -> bool {
        let is_answer = self.signal.is_some_and(SignalKind::is_of_listener);
        // A stop between the frames of another gateway.
        let is_between = self.gap.take_frame(now) && self.listens();
        let may = if is_answer {
            self.calls.may_answer(now)
        } else {
            may_send
        };
        let may = may || is_between;
        if !may {
            self.signal = None;
        } else if !is_answer && !is_between {
            self.rule.sent(now);
        }
        may
    }

    /// The request of a signal of this gateway, which is sent next.
    pub fn signal(&mut self, kind: SignalKind) -> Request {
        self.signal = Some(kind);
        Signal {
            kind,
            sender: self.sender,
        }
        .request()
    }

    /// The signal that was handed to the port.
    pub const fn take_signal(&mut self) -> Option<SignalKind> {
        self.signal.take()
    }

    /// A frame was handed to the port, which took until `now`.
    pub fn was_sent(&mut self, now: MonoTime) -> Option<StandbyChange> {
        self.rule.was_sent(now)
    }

    /// This gateway has said that it is active.
    pub const fn role_was_said(&mut self, now: MonoTime) {
        self.role_said_at = now;
    }

    /// Whether `signal` is a copy of one of this gateway.
    pub const fn is_own(&self, signal: Signal) -> bool {
        signal.sender == self.sender
    }

    pub fn port_opened(&mut self, now: MonoTime) {
        self.rule.port_opened(now);
        self.sound_at = now;
        self.listener.clear();
    }

    /// The port is closed. Returns whether that gives the line up.
    pub fn port_gone(&mut self) -> bool {
        (self.signal, self.gave_way) = (None, false);
        self.calls.end_answer();
        self.rule.port_gone()
    }

    pub fn jam_ended(&mut self, now: MonoTime) {
        self.rule.jam_ended(now);
    }

    /// A drive has answered this gateway.
    pub const fn was_answered(&mut self, now: MonoTime) {
        self.rule.answered(now);
        self.sound_at = now;
    }

    /// Time has passed, on a line that brought its last byte at `last_byte_at`, of an exchange of its own or not.
    pub fn pass(
        &mut self,
        now: MonoTime,
        (last_byte_at, is_own): (MonoTime, bool),
        is_free: bool,
    ) -> Option<StandbyChange> {
        if !is_own && last_byte_at > self.own_bytes_at {
            self.rule.received(last_byte_at);
        }
        self.rule.pass(now, is_free)
    }

    /// The operator wants another gateway to take the line over: it is handed over as soon as nothing is under way.
    pub fn yield_line(&mut self, now: MonoTime) {
        if !self.is_active() {
            return;
        }
        self.yields_until = Some(now + YIELD_WAIT);
        self.to_tell = None;
        self.calls.ask_again(now);
    }

    /// When the line may be handed over, if that is wanted; a line that `is_busy` is not.
    pub fn yields_at(&self, is_busy: bool) -> Option<MonoTime> {
        let until = self.yields_until?;
        let is_known = self.calls.listener().is_some();
        Some(if is_known && !is_busy {
            MonoTime::ZERO
        } else {
            until
        })
    }

    /// The next frame that hands the line over at `now`, if that is wanted, and nothing is under way. `orders`: those of the
    /// drives.
    pub fn hand_over(
        &mut self,
        now: MonoTime,
        is_busy: bool,
        orders: impl FnOnce() -> Vec<SignalWord>,
    ) -> Option<GatewayFrame> {
        let until = self.yields_until?;
        if now >= until {
            self.yields_until = None;
            return None;
        }
        match self.calls.listener() {
            Some(true) if !is_busy => {}
            // Nothing changes.
            Some(false) => {
                self.yields_until = None;
                self.kept += 1;
                return None;
            }
            Some(true) | None => return None,
        }
        // The other one may have been started after the orders that it takes over.
        if let Some(word) = self.to_tell.get_or_insert_with(orders).pop() {
            return Some(GatewayFrame::Word(word));
        }
        self.yields_until = None;
        Some(GatewayFrame::Signal(SignalKind::HandOver))
    }

    /// The frame that hands the line over is out.
    pub fn give_way(&mut self, now: MonoTime) -> Option<StandbyChange> {
        // Every rank has had its turn by then.
        let wait = self.rule.times().take_over_after;
        self.gave_way = true;
        self.rule.give_up(now, wait)
    }

    /// The line was given up.
    pub fn was_given_up(&mut self) {
        self.given_up += 1;
        self.calls.end();
        self.listener.clear();
        self.unanswered.fill(0);
    }

    /// The line was taken over at `now`.
    pub fn was_taken_over(&mut self, now: MonoTime, was_handed_over: bool) -> TakenLine {
        self.take_overs += 1;
        self.is_confirmed = false;
        self.calls.begin(now);
        // No other gateway took what this one gave: its own orders go on as those of another one would.
        let goes_on = was_handed_over || std::mem::take(&mut self.gave_way);
        // A signal that was to hand the line over, and could not be sent any more, does so no more.
        (self.yields_until, self.signal) = (None, None);
        self.listener.clear();
        TakenLine {
            goes_on,
            heard_at: self.rule.heard_at(),
            is_first: !std::mem::replace(&mut self.has_heard_other, true),
        }
    }

    /// The first exchanges since the line was taken over show whether this gateway is the only one that took it: one that
    /// is answered, or silence or something damaged instead. On a line that `is_jammed`, a silence shows nothing of its ears.
    pub fn exchange_ended(
        &mut self,
        now: MonoTime,
        is_answered: bool,
        is_damaged: bool,
        is_jammed: bool,
    ) -> Option<StandbyChange> {
        if !is_answered && !is_jammed {
            self.rule.missed();
        }
        if self.is_confirmed {
            return None;
        }
        self.is_confirmed = is_answered;
        if is_answered {
            None
        } else {
            self.rule.unanswered(now, is_damaged)
        }
    }

    /// Another master asked something while this gateway is active: there are two.
    pub fn heard_rival(&mut self, now: MonoTime) -> Option<StandbyChange> {
        let change = self.rule.heard_request(now)?;
        self.rivals += 1;
        self.has_heard_other = true;
        Some(change)
    }

    /// A sound frame was heard at `at`.
    pub const fn sound_heard(&mut self, at: MonoTime) {
        self.sound_at = at;
    }

    /// What makes no frame may have been another request: what answers it must not be taken for the answer to the last one.
    pub fn noise_heard(&mut self) {
        self.listener.clear();
        self.gap.is_over();
    }

    /// The active gateway tells something that its next frames build on.
    pub fn word_heard(&mut self, at: MonoTime, word: SignalWord) {
        self.another_leads(at);
        self.gap.exchange_ended(at);
        if let SignalWord::Digest(digest) = word {
            self.calls.digest_heard(digest);
        }
    }

    /// A listener heard at `now` a `signal` that ended at `at`. If the line is handed over, it is taken if it `may_accept` that.
    /// Returns the station that was asked before it and did not answer.
    pub fn signal_heard(
        &mut self,
        now: MonoTime,
        at: MonoTime,
        signal: Signal,
        may_accept: bool,
    ) -> Option<Station> {
        let unanswered = self.take_signal_heard(now, at, signal, may_accept);
        // Nothing answers it.
        self.gap.exchange_ended(at);
        unanswered
    }

    fn take_signal_heard(
        &mut self,
        now: MonoTime,
        at: MonoTime,
        signal: Signal,
        may_accept: bool,
    ) -> Option<Station> {
        // Another listener does not send on its own.
        if self.is_own(signal) || signal.kind.is_of_listener() {
            return None;
        }
        let is_attentive = self.rule.is_attentive(now);
        self.another_leads(at);
        match signal.kind {
            SignalKind::HandOver => {
                self.gap.led(at);
                if may_accept {
                    self.rule.handed_over(at)
                } else {
                    self.rule.refused(at)
                }
            }
            SignalKind::Question if is_attentive => {
                self.calls
                    .question_heard(now, at, self.rule.times().answer_after);
            }
            SignalKind::Active
            | SignalKind::Question
            | SignalKind::Listening
            | SignalKind::Differs => {}
        }
        self.listener.silent()
    }

    /// A listener heard a sound frame of `station` that is no signal: what it means. `is_known`: whether a station is a drive
    /// of this gateway.
    pub fn frame_heard(
        &mut self,
        at: MonoTime,
        (station, pdu): (Station, &[u8]),
        is_known: impl FnOnce(Station) -> bool,
    ) -> OverheardFrame {
        let frame = self.listener.take(station, pdu);
        match &frame {
            // It may be the late one to a request of our own.
            OverheardFrame::Alone => {
                self.gap.is_over();
                self.rule.heard_alone(at);
            }
            OverheardFrame::Request { station, .. } => {
                self.another_sends(at);
                self.gap.asked(at);
                if *station != Station(0) && *station != signal::STATION && !is_known(*station) {
                    self.stranger = Some((*station, at));
                    // No gateway asks it, and one that was active gives the line up.
                    self.gap.led(at);
                }
            }
            OverheardFrame::Answer { .. } => {
                self.another_sends(at);
                self.gap.exchange_ended(at);
            }
        }
        frame
    }

    /// Another gateway has asked the drive at `place` in vain. Returns whether that happened so often that it is offline.
    pub fn is_silent(&mut self, place: usize) -> bool {
        let Some(count) = self.unanswered.get_mut(place) else {
            return false;
        };
        *count = count.saturating_add(1);
        *count >= SILENT_AFTER
    }

    /// The drive at `place` has answered another gateway.
    pub fn has_answered(&mut self, place: usize) {
        if let Some(count) = self.unanswered.get_mut(place) {
            *count = 0;
        }
    }

    /// A listener heard another gateway say at `at` what only an active one says.
    fn another_leads(&mut self, at: MonoTime) {
        self.another_sends(at);
        self.gap.led(at + SIGNALS_WITHIN);
    }

    /// A listener heard another gateway, or its drives answer it, at `at`.
    fn another_sends(&mut self, at: MonoTime) {
        self.has_heard_other = true;
        self.gave_way = false;
        self.rule.heard(at);
    }

    /// The next stop of `drives` between the frames of another master, as known at `now`, if nothing more is received than
    /// at `last_byte_at`; or the next read that shows its effect.
    pub fn next_between(
        &self,
        drives: &LineDrives,
        last_byte_at: MonoTime,
        now: MonoTime,
    ) -> Option<(MonoTime, DriveIndex, DriveWish)> {
        let wants = drives
            .iter()
            .filter_map(|drive| Some((drive, drive.work.latch()?)))
            .flat_map(|(drive, latch)| {
                let knowledge = self.rule.knowledge();
                let from = knowledge.stops_from(latch.is_declared_alone());
                let room = self.rule.makes_room().then(|| self.rule.times().room());
                let leaves_room = move |at| room.map_or(at, |room| self.gap.in_burst(at, room));
                // Another gateway reads the drive, or is active and decides when.
                let is_seen = self.gap.is_led(now) || drive.is_read_by_others(now);
                drive.work.wants().filter_map(move |want| {
                    let due = drive.wanted_from(&want).max(from);
                    let at = match want.rank {
                        WishRank::FirstStop => self.gap.stop_at(due, last_byte_at, now),
                        WishRank::RepeatedStop => {
                            leaves_room(self.gap.again_at(due, last_byte_at, now))
                        }
                        // Another gateway reads its drives itself, and would take a read for one of a rival.
                        // One that hears nothing learns nothing by it.
                        WishRank::Look if is_seen || self.rule.is_deaf() => return None,
                        WishRank::Look => leaves_room(self.gap.look_at(due, last_byte_at, now)),
                        WishRank::Step | WishRank::Trip | WishRank::Start => return None,
                    };
                    Some((at, drive.index, want))
                })
            });
        wants
            .filter(|(at, ..)| *at < MonoTime::NEVER)
            .min_by_key(|(at, _, want)| (*at, want.rank, want.at))
    }

    /// A frame between those of another master is decided on at `now`.
    pub fn goes_between(&mut self, now: MonoTime, is_stop: bool) {
        self.gap.decided(now, is_stop);
    }

    /// The exchange of such a frame has ended. Returns whether a stop is sent again at once.
    pub fn between_ended(
        &mut self,
        now: MonoTime,
        last_byte_at: MonoTime,
        is_answered: bool,
        is_stop: bool,
    ) -> bool {
        self.own_bytes_at = last_byte_at;
        if is_answered {
            self.gap.answered();
            return false;
        }
        self.gap.unanswered();
        is_stop && self.gap.may_repeat(now)
    }

    /// The stop `frame` of another gateway was heard while this one is active: its answer may come until `until`.
    pub fn stop_heard(&mut self, frame: &[u8], until: MonoTime) {
        self.heard_stop = Some((frame.to_vec(), until));
    }

    /// Until when the answer to such a stop may come, if `frame` is its copy, which is taken for the answer once.
    pub fn take_answer_to_stop(&mut self, frame: &[u8]) -> Option<MonoTime> {
        let (_, until) = self.heard_stop.take_if(|(stop, _)| stop == frame)?;
        Some(until)
    }
}

/// The number of a start with this first epoch.
fn sender(first_epoch: u64) -> u16 {
    // Fibonacci hashing: epochs differ in some of their bits.
    u16::try_from(first_epoch.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 48).unwrap_or_default()
}
