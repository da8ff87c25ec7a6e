//! A slave on a serial port as a machine without a port or a clock: bytes and answers with their times go in; requests
//! for the gateway's units and frames for the master come out.
//!
//! A request ends with 3.5 characters of silence, or in ASCII with CR LF. Until the answer must have begun, at most one
//! request is open; what is answered later is thrown away, so that it cannot be taken for the answer to the next one. A
//! write that others followed before it was taken out comes out too: it may be a stop, which counts wherever it stands.

mod counters;
mod frames;

pub use counters::SlaveCounters;

use super::function as client;
use crate::domain::link::{Framing, LinkSettings};
use crate::domain::time::MonoTime;
use crate::wire::pdu::function;
use crate::wire::{ascii, exception, framing, rtu};
use std::collections::VecDeque;
use std::time::Duration;

/// The silence around frames in characters (Modbus over serial line V1.02, 2.5.1.1).
const SILENCE_CHARS: f64 = 3.5;
/// The silence around frames above 19200 bit/s (Modbus over serial line V1.02, 2.5.1.1).
const SILENCE_FAST: Duration = Duration::from_micros(1750);
/// Above this speed the silence is fixed.
const FAST_BAUD: u32 = 19_200;
/// The pause before a reply in ASCII, where frames mark their own ends.
const ASCII_PAUSE: Duration = Duration::from_millis(10);
/// Longest pause inside an ASCII frame.
const ASCII_HOLE: Duration = Duration::from_secs(1);
/// Longest pause that an adapter may make between bytes of one RTU frame; it also delays an echo by as much.
const HOLE: Duration = Duration::from_millis(20);
/// How much sooner than at the last moment an exception is sent: scheduling and adapters need some time.
const MARGIN: Duration = Duration::from_millis(5);
/// Most bytes that are kept: two of the longest frames. Further ones push out the oldest.
const KEPT_MAX: usize = 2 * ascii::MAX_ADU_BYTES;
/// The address that all slaves hear and none answers.
const BROADCAST: u8 = 0;

/// How the master sends, and how long it waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveSettings {
    /// Speed and character format.
    pub link: LinkSettings,
    /// How frames are delimited.
    pub framing: Framing,
    /// From the end of a request until an exception has been sent.
    pub answer_within: Duration,
    /// Whether bytes take the time on the wire that the link says: not on a pseudo-terminal or a network.
    pub is_paced: bool,
}

/// The shortest possible `answer_within` of a slave on this link.
#[must_use]
pub fn least_answer_within(link: LinkSettings, framing: Framing) -> Duration {
    silence(link, framing) + exception_time(link, framing) + 2 * MARGIN
}

fn silence(link: LinkSettings, framing: Framing) -> Duration {
    match framing {
        Framing::Ascii => ASCII_PAUSE,
        Framing::Rtu if link.baud > FAST_BAUD => SILENCE_FAST,
        Framing::Rtu => link.chars(SILENCE_CHARS),
        // No serial master has such frames.
        Framing::Mbap => Duration::ZERO,
    }
}

fn exception_time(link: LinkSettings, framing: Framing) -> Duration {
    link.bytes(framing::adu_bytes(framing, 2))
}

/// A request for one of the gateway's units.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlaveRequest {
    /// The number by which it is answered.
    pub number: u16,
    /// The addressed unit.
    pub unit: u8,
    /// Function code and data.
    pub pdu: Vec<u8>,
    /// Whether the master waits for its answer: nothing came behind it. Of the others only a stop may be executed, since
    /// the master has given them up.
    pub is_awaited: bool,
}

/// The open request.
#[derive(Debug)]
struct OpenSerialRequest {
    number: u16,
    unit: u8,
    function: u8,
    /// When an exception has to begin.
    due: MonoTime,
    /// After that nothing is sent any more: the master may ask again.
    latest: MonoTime,
    answer: Option<Vec<u8>>,
}

/// The last frame that was sent, of which an echo may arrive.
#[derive(Debug)]
struct SentFrame {
    frame: Vec<u8>,
    /// When its last bit is sent.
    until: MonoTime,
    /// How many of its bytes have come back.
    echoed: usize,
}

/// A slave. Its owner calls [`received`](Self::received) for bytes, [`tick`](Self::tick) when
/// [`next_wake`](Self::next_wake) is due, and after each of both [`next_request`](Self::next_request) and
/// [`next_frame`](Self::next_frame).
#[derive(Debug)]
pub struct SerialSlave {
    settings: SlaveSettings,
    silence: Duration,
    bytes: Vec<u8>,
    /// When the last byte arrived, or the last bit of a reply was sent.
    busy_until: MonoTime,
    /// Whether the bytes before the present silence were looked at.
    is_checked: bool,
    /// What arrives until the next silence has collided with a reply.
    is_spoilt: bool,
    /// In order of arrival: writes, and last the open request.
    requests: VecDeque<SlaveRequest>,
    open: Option<OpenSerialRequest>,
    sent: Option<SentFrame>,
    /// Whether the last reply came back as an echo; `None` before the first.
    echoes: Option<bool>,
    last_number: u16,
    counters: SlaveCounters,
}

impl SerialSlave {
    /// A slave at a port that was opened at `now`.
    #[must_use]
    pub fn new(settings: SlaveSettings, now: MonoTime) -> Self {
        Self {
            settings,
            silence: silence(settings.link, settings.framing),
            bytes: Vec::new(),
            busy_until: now,
            is_checked: true,
            is_spoilt: false,
            requests: VecDeque::new(),
            open: None,
            sent: None,
            echoes: None,
            last_number: 0,
            counters: SlaveCounters::default(),
        }
    }

    /// What happened so far.
    #[must_use]
    pub const fn counters(&self) -> &SlaveCounters {
        &self.counters
    }

    /// Takes bytes that arrived at `now`. `is_ours` tells the gateway's units.
    pub fn received(&mut self, now: MonoTime, bytes: &[u8], is_ours: &dyn Fn(u8) -> bool) {
        self.tick(now, is_ours);
        let rest = self.without_echo(now, bytes);
        self.busy_until = self.busy_until.max(now);
        if rest.is_empty() || self.is_spoilt {
            return;
        }
        self.bytes.extend_from_slice(&rest);
        self.is_checked = false;
        self.make_room(is_ours);
        if self.settings.framing == Framing::Ascii {
            self.check_ascii(now, is_ours);
        }
    }

    /// Does what is due at `now`.
    pub fn tick(&mut self, now: MonoTime, is_ours: &dyn Fn(u8) -> bool) {
        if now >= self.busy_until + self.silence {
            self.is_spoilt = false;
            if self.settings.framing == Framing::Rtu && !self.is_checked {
                self.is_checked = true;
                self.check_rtu(is_ours);
            }
        }
        if !self.bytes.is_empty() && now >= self.busy_until + self.hole() {
            self.bytes.clear();
            self.counters.damaged += 1;
        }
        if let Some(sent) = self.sent.take_if(|sent| now >= sent.until + HOLE) {
            self.echoes = Some(sent.echoed == sent.frame.len());
        }
    }

    /// The next request for a unit of the gateway.
    pub fn next_request(&mut self) -> Option<SlaveRequest> {
        self.requests.pop_front()
    }

    /// Answers the request `number` with a PDU. One that is not open any more is thrown away.
    pub fn answer(&mut self, number: u16, pdu: &[u8]) {
        match &mut self.open {
            Some(open) if open.number == number && open.answer.is_none() => {
                open.answer = Some(pdu.to_vec())
            }
            _ => self.counters.late += 1,
        }
    }

    /// The frame to send at `now`, if the silence before it has passed. Nothing is sent on top of what arrives.
    pub fn next_frame(&mut self, now: MonoTime) -> Option<Vec<u8>> {
        let open = self.open.as_ref()?;
        let is_due = now >= open.due;
        if now < self.busy_until + self.silence || (open.answer.is_none() && !is_due) {
            return None;
        }
        let open = self.open.take()?;
        // The bus was busy for so long that the master has given up.
        if now > open.latest {
            self.counters.late += u64::from(open.answer.is_some());
            return None;
        }
        let pdu = open.answer.unwrap_or_else(|| {
            self.counters.not_in_time += 1;
            vec![
                open.function | function::EXCEPTION_BIT,
                code_for(open.function),
            ]
        });
        let mut frame = Vec::new();
        framing::encode(self.settings.framing, &mut frame, open.unit, |out| {
            out.extend_from_slice(&pdu)
        });
        let until = if self.settings.is_paced {
            now + self.settings.link.bytes(frame.len())
        } else {
            now
        };
        self.busy_until = self.busy_until.max(until);
        self.sent = Some(SentFrame {
            frame: frame.clone(),
            until,
            echoed: 0,
        });
        Some(frame)
    }

    /// When [`tick`](Self::tick) or [`next_frame`](Self::next_frame) has something to do, unless something else happens.
    #[must_use]
    pub fn next_wake(&self) -> Option<MonoTime> {
        let quiet = self.busy_until + self.silence;
        let checked = (!self.is_checked || self.is_spoilt).then_some(quiet);
        let given_up = (!self.bytes.is_empty()).then(|| self.busy_until + self.hole());
        let replied = self.open.as_ref().map(|open| {
            if open.answer.is_some() {
                quiet
            } else {
                open.due.max(quiet)
            }
        });
        let echoed = self.sent.as_ref().map(|sent| sent.until + HOLE);
        [checked, given_up, replied, echoed]
            .into_iter()
            .flatten()
            .min()
    }

    const fn hole(&self) -> Duration {
        match self.settings.framing {
            Framing::Rtu | Framing::Mbap => HOLE,
            Framing::Ascii => ASCII_HOLE,
        }
    }

    /// What of `bytes` is no echo of the last reply.
    fn without_echo(&mut self, now: MonoTime, bytes: &[u8]) -> Vec<u8> {
        let echoes = self.echoes;
        let Some(sent) = &mut self.sent else {
            return bytes.to_vec();
        };
        let is_sending = now < sent.until;
        if !is_sending && sent.echoed == 0 && echoes == Some(false) {
            self.sent = None;
            return bytes.to_vec();
        }
        let expected = sent.frame.get(sent.echoed..).unwrap_or_default();
        let common = bytes
            .iter()
            .zip(expected)
            .take_while(|(one, other)| one == other)
            .count();
        let rest = bytes.get(common..).unwrap_or_default();
        if common == bytes.len() && common < expected.len() {
            sent.echoed += common;
            return Vec::new();
        }
        if common == expected.len() {
            self.echoes = Some(true);
            self.sent = None;
            return rest.to_vec();
        }
        if is_sending {
            self.is_spoilt = true;
            self.counters.collisions += 1;
            return Vec::new();
        }
        // The echo behind a glitch, of an adapter that is known to echo: a write must not count as ordered twice.
        if echoes == Some(true)
            && let Some(start) = bytes
                .windows(expected.len().max(1))
                .position(|window| window == expected)
        {
            let rest = bytes
                .get(start + expected.len()..)
                .unwrap_or_default()
                .to_vec();
            self.sent = None;
            return rest;
        }
        // It began like the reply and is something else.
        let begun = sent.frame.get(..sent.echoed).unwrap_or_default().to_vec();
        self.echoes = Some(false);
        self.sent = None;
        [begun.as_slice(), bytes].concat()
    }

    /// Looks at what has arrived before a silence. What is no frame may be a part of one, behind an adapter that delivers
    /// in pieces.
    fn check_rtu(&mut self, is_ours: &dyn Fn(u8) -> bool) {
        let end = self.busy_until;
        // An adapter, or a host that is late, delivers several frames in one piece.
        if let Some(frames) = frames::all_in(&self.bytes, is_ours) {
            self.bytes.clear();
            for (unit, pdu) in frames {
                self.take_frame(end, unit, pdu, is_ours);
            }
            return;
        }
        let whole = rtu::decode(&self.bytes).map(|(unit, pdu)| (unit, pdu.to_vec()));
        let is_of_others = whole.as_ref().is_some_and(|(unit, _)| !is_ours(*unit));
        // What drivers add that are switched on or off, directly before or behind a request, does not cost the request. A
        // zero behind a sound frame leaves the check of the whole right. What is behind may be the beginning of the next.
        if !is_of_others && self.take_requests(end, is_ours) {
            return;
        }
        // The length of some functions only silence tells, and a request may be longer than its function says.
        if let Some((unit, pdu)) = whole {
            self.bytes.clear();
            self.take_frame(end, unit, pdu, is_ours);
        }
    }

    /// Takes the requests between which there is anything else, with all before the last one's end. One that too much
    /// follows is not answered. Returns whether there was any.
    fn take_requests(&mut self, end: MonoTime, is_ours: &dyn Fn(u8) -> bool) -> bool {
        let requests = frames::requests_in(&self.bytes, is_ours);
        let mut used = 0;
        for (place, (unit, pdu)) in requests {
            self.counters.damaged += u64::from(place.start > used);
            used = place.end;
            self.take_frame(end, unit, pdu, is_ours);
        }
        if self.bytes.len() - used > frames::BEHIND_MAX {
            self.end_wait();
        }
        self.bytes.drain(..used);
        used > 0
    }

    /// Pushes out the oldest bytes if there are too many, but not the requests in them: they may have waited for seconds.
    fn make_room(&mut self, is_ours: &dyn Fn(u8) -> bool) {
        if self.settings.framing == Framing::Rtu && self.bytes.len() > KEPT_MAX {
            self.take_requests(self.busy_until, is_ours);
            self.end_wait();
        }
        let excess = self.bytes.len().saturating_sub(KEPT_MAX);
        self.bytes.drain(..excess);
    }

    fn check_ascii(&mut self, now: MonoTime, is_ours: &dyn Fn(u8) -> bool) {
        while let Some(place) = ascii::find(&self.bytes) {
            let frame = self.bytes.get(place.clone()).and_then(ascii::decode);
            self.counters.damaged += u64::from(place.start > 0);
            self.bytes.drain(..place.end);
            if let Some((unit, pdu)) = frame {
                self.take_frame(now, unit, pdu, is_ours);
            }
        }
        // An end without a sound frame before it: nothing later can repair that.
        if let Some(end) = self.bytes.windows(2).rposition(|pair| pair == b"\r\n") {
            self.bytes.drain(..end + 2);
            self.counters.damaged += 1;
        }
    }

    /// Takes a sound frame whose last byte arrived at `end`.
    fn take_frame(&mut self, end: MonoTime, unit: u8, pdu: Vec<u8>, is_ours: &dyn Fn(u8) -> bool) {
        // A master that sends no longer waits for an earlier answer.
        self.end_wait();
        if unit == BROADCAST {
            self.counters.broadcasts += 1;
            return;
        }
        if !is_ours(unit) {
            self.counters.foreign += 1;
            return;
        }
        let Some(function) = pdu.first().copied() else {
            return;
        };
        self.counters.requests += 1;
        self.last_number = self.last_number.wrapping_add(1);
        let number = self.last_number;
        let wait = self.settings.answer_within;
        let sending = exception_time(self.settings.link, self.settings.framing);
        let due = end + wait.saturating_sub(sending + MARGIN).max(self.silence);
        self.open = Some(OpenSerialRequest {
            number,
            unit,
            function,
            due,
            latest: due.max(end + wait),
            answer: None,
        });
        self.requests.push_back(SlaveRequest {
            number,
            unit,
            pdu,
            is_awaited: true,
        });
    }

    /// Answers none of the requests so far. What does not write has no use any more.
    fn end_wait(&mut self) {
        self.open = None;
        self.requests.retain_mut(|request| {
            request.is_awaited = false;
            request
                .pdu
                .first()
                .is_some_and(|function| client::writes(*function))
        });
    }
}

/// The exception for a request without an answer in time. A read may be repeated; a write may
/// still be executed.
fn code_for(code: u8) -> u8 {
    if client::writes(code) {
        exception::GATEWAY_TARGET_FAILED
    } else {
        exception::SERVER_DEVICE_BUSY
    }
}

#[cfg(test)]
mod tests;
