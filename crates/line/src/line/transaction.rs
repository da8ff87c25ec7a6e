//! One exchange after the other on a half-duplex wire: wait for silence, send, wait for the valid reply.

mod frames;
mod hole;
mod ids;
#[cfg(test)]
mod tests;

use super::arrivals::PortArrivals;
use super::exchange::{Exchange, ExchangeEnding, HeardData};
use super::occupancy::LineOccupancy;
use super::own_echo::OwnEcho;
use super::timing::LineTiming;
use crate::domain::ids::Station;
use crate::domain::link::PortKind;
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficKind;
use crate::wire::frame::ExpectedFrame;
use crate::wire::framing::{self, FrameAssembler};
use crate::wire::pdu::{self, Request};
use ids::TransactionIds;
use std::time::Duration;

/// Longest pause inside a frame of others that is still put together: what any adapter leaves, on a busy machine.
const LISTENED_HOLE: Duration = Duration::from_millis(50);

/// The exchange that is on the wire.
#[derive(Debug)]
struct OpenExchange {
    exchange: Exchange,
    expected: ExpectedFrame,
    /// The number that its reply must carry, where frames have one.
    transaction: Option<u16>,
    /// The computed end of our own transmission, where characters take their time.
    sent_until: MonoTime,
    reply_due: MonoTime,
    /// At this moment the exchange ends even if data is still arriving.
    give_up: MonoTime,
    /// An exception that counts once silence follows it, where frames have no end mark: one flipped bit can turn a
    /// read's reply into an exception frame with bytes after it, so the frame alone is no proof.
    exception: Option<u8>,
    /// An exception was followed by more bytes, so it was not one.
    was_damaged: bool,
}

/// The wire of one line. At most one exchange is open on it.
#[derive(Debug)]
pub struct LineWire {
    timing: LineTiming,
    assembler: FrameAssembler,
    /// The later of the last byte read and the computed end of our own transmission.
    quiet_from: MonoTime,
    last_byte_at: MonoTime,
    /// Until this moment the drives are busy with a broadcast, or with what others asked.
    held_until: MonoTime,
    /// Since when bytes have been arriving without a silence long enough for one of our frames.
    occupancy: LineOccupancy,
    /// Whether replies take time on the wire, so that one can be too early.
    is_timed: bool,
    /// Whether the first copy of each of our frames is removed from the received data.
    strips_echo: bool,
    own_echo: OwnEcho,
    arrivals: PortArrivals,
    transactions: TransactionIds,
    /// Frames of others matter: one that an adapter delivers in pieces is put together.
    listens: bool,
    /// What was received is no stream of frames: nothing that follows can be understood.
    is_out_of_step: bool,
    open: Option<OpenExchange>,
    heard: Vec<HeardData>,
}

impl LineWire {
    /// A wire on which nothing has been received up to `now`.
    #[must_use]
    pub fn new(timing: LineTiming, now: MonoTime) -> Self {
        Self {
            assembler: FrameAssembler::new(timing.framing),
            timing,
            quiet_from: now,
            last_byte_at: now,
            held_until: MonoTime::ZERO,
            occupancy: LineOccupancy::new(now),
            is_timed: false,
            strips_echo: false,
            own_echo: OwnEcho::default(),
            arrivals: PortArrivals::default(),
            transactions: TransactionIds::default(),
            listens: false,
            is_out_of_step: false,
            open: None,
            heard: Vec::new(),
        }
    }

    /// Where requests are numbered, the next one gets the number `first`.
    pub const fn number_from(&mut self, first: u16) {
        self.transactions.begin_with(first);
    }

    /// From now on frames between others are put together like replies, across the holes that adapters leave.
    pub const fn listen(&mut self) {
        self.listens = true;
    }

    /// Whether something was received that is no stream of frames: only a new connection helps.
    #[must_use]
    pub const fn is_out_of_step(&self) -> bool {
        self.is_out_of_step
    }

    /// Whether an exchange is open.
    #[must_use]
    pub const fn is_busy(&self) -> bool {
        self.open.is_some()
    }

    /// The first moment at which the silence before one of our frames is long enough.
    #[must_use]
    pub fn may_send_from(&self) -> MonoTime {
        (self.quiet_from + self.timing.silence).max(self.held_until)
    }

    /// When the turnaround after a broadcast ends, or the time for an answer to others, whatever else is on the line.
    #[must_use]
    pub const fn held_until(&self) -> MonoTime {
        self.held_until
    }

    /// Nothing is sent before `until`: another one has asked, and its answer comes first.
    pub fn hold(&mut self, until: MonoTime) {
        self.held_until = self.held_until.max(until);
    }

    /// What was awaited `until` then has come.
    pub fn release(&mut self, until: MonoTime) {
        if self.held_until == until {
            self.held_until = MonoTime::ZERO;
        }
    }

    /// When the last byte was received; when the port was opened if none was.
    #[must_use]
    pub const fn last_byte_at(&self) -> MonoTime {
        self.last_byte_at
    }

    /// Since when others have been sending without a silence long enough for a frame; `None` if that is over at `now`.
    #[must_use]
    pub fn talks_since(&self, now: MonoTime) -> Option<MonoTime> {
        (now < self.pause_at() && self.occupancy.since() < self.last_byte_at)
            .then_some(self.occupancy.since())
    }

    /// A port of this `kind` was opened at `now`: whatever was on the wire is over.
    pub fn port_opened(&mut self, now: MonoTime, kind: PortKind) {
        self.abandon(now);
        self.last_byte_at = now;
        self.occupancy = LineOccupancy::new(now);
        self.is_timed = kind == PortKind::Serial;
    }

    /// Sets whether the line is known to echo: then the first copy of each frame sent from now on is removed.
    pub const fn strip_echo(&mut self, strips: bool) {
        self.strips_echo = strips;
    }

    /// Hands the frame of `exchange` to the port at `now`: appends it to `out`. The caller has waited until
    /// [`LineWire::may_send_from`], and no exchange is open.
    pub fn send(&mut self, now: MonoTime, exchange: Exchange, out: &mut Vec<u8>) {
        let start = out.len();
        framing::encode(self.timing.framing, out, exchange.station.0, |pdu| {
            exchange.request.encode(pdu)
        });
        let framing = self.timing.framing;
        let transaction = framing
            .identifies_replies()
            .then(|| self.transactions.take());
        if let Some(id) = transaction {
            framing::set_transaction(framing, &mut out[start..], id);
        }
        let sent_bytes = out.len() - start;
        let reply_bytes = self.timing.adu_bytes(exchange.request.reply_pdu_bytes());
        let expected = ExpectedFrame {
            station: exchange.station.0,
            function: exchange.request.function(),
            adu_bytes: reply_bytes,
        };
        self.quiet_from = now + self.timing.on_wire(sent_bytes);
        let reply_due = self.quiet_from + exchange.timeout + self.timing.on_wire(reply_bytes);
        self.occupancy.sent(now, self.pause_at(), reply_due);
        // A reply that began in time is complete by then; anything longer is not a reply.
        let give_up = reply_due + self.timing.on_wire(reply_bytes) + self.timing.silence;
        self.flush_idle_bytes();
        // The drive's clock may be some per cent fast.
        let on_wire = self.timing.on_wire(sent_bytes) + self.timing.on_wire(reply_bytes);
        let earliest = if self.is_timed {
            now + on_wire * 9 / 10
        } else {
            now
        };
        let may_echo = !framing.identifies_replies();
        let is_sure =
            may_echo && (self.strips_echo || !exchange.request.is_repeated_by_its_reply());
        self.own_echo
            .await_copy_of(&out[start..], is_sure, earliest);
        let sent_until = if self.is_timed { self.quiet_from } else { now };
        let exception = None;
        let was_damaged = false;
        self.open = Some(OpenExchange {
            exchange,
            expected,
            transaction,
            sent_until,
            reply_due,
            give_up,
            exception,
            was_damaged,
        });
    }

    /// Hands a frame for `station`, from which no reply follows, to the port at `now`: puts it into the empty `out`. The
    /// drives are left alone for `turnaround`. As for [`LineWire::send`], the caller has waited.
    pub fn broadcast(
        &mut self,
        now: MonoTime,
        station: u8,
        request: &Request,
        turnaround: Duration,
        out: &mut Vec<u8>,
    ) {
        framing::encode(self.timing.framing, out, station, |pdu| request.encode(pdu));
        self.flush_idle_bytes();
        self.quiet_from = now + self.timing.on_wire(out.len());
        self.held_until = self.quiet_from + turnaround;
        self.occupancy.sent(now, self.pause_at(), self.held_until);
        self.own_echo.await_copy_of(out, true, now);
    }

    /// Takes bytes that were read at `now`. Returns how the open exchange ended, if it did.
    pub fn receive(&mut self, now: MonoTime, bytes: &[u8]) -> Option<(Exchange, ExchangeEnding)> {
        // Where only silence ends frames, a short hole may be an adapter's, and the reply continues after it.
        let ended = if self.open.is_none() || self.assembler.sees_ends() {
            self.flush_if_silent(now);
            None
        } else {
            self.end_before_hole(now, bytes.len())
        };
        self.occupancy.heard(now, self.pause_at());
        self.last_byte_at = now;
        self.quiet_from = self.quiet_from.max(now);
        self.arrivals.read(bytes.len(), now);
        let pushed_out = self.assembler.push(bytes);
        self.note(TrafficKind::Noise, pushed_out);
        self.take_echo(now);
        let later = self.take_frames(false);
        ended.or(later)
    }

    /// Lets time pass up to `now`. Returns how the open exchange ended, if it did.
    pub fn pass(&mut self, now: MonoTime) -> Option<(Exchange, ExchangeEnding)> {
        let Some(open) = &self.open else {
            self.flush_if_silent(now);
            return None;
        };
        let silent_since_frame = now >= self.pause_at();
        if let (true, Some(code)) = (silent_since_frame, open.exception) {
            if self.assembler.is_empty() {
                return self.finish(ExchangeEnding::Exception(code));
            }
            if let Some(open) = &mut self.open {
                open.exception = None;
                open.was_damaged = true;
            }
        }
        if silent_since_frame && let Some(ended) = self.take_frames(true) {
            return Some(ended);
        }
        let open = self.open.as_ref()?;
        let is_due = now >= open.reply_due && (silent_since_frame || self.assembler.is_empty());
        if !is_due && now < open.give_up {
            return None;
        }
        // Bytes that look like the reply prove nothing before its time is over, and little then.
        let is_damaged = open.was_damaged || self.holds_damaged_reply();
        self.finish(if is_damaged {
            ExchangeEnding::Garbled
        } else {
            ExchangeEnding::Silent
        })
    }

    /// From when on the received data may be treated as the damaged reply, because silence has followed it.
    #[must_use]
    pub fn damaged_from(&self) -> Option<MonoTime> {
        let was_damaged = self.open.as_ref().is_some_and(|open| open.was_damaged);
        (was_damaged || self.holds_damaged_reply()).then(|| self.pause_at())
    }

    /// Ends the open exchange early, with a damaged reply.
    pub fn cut_damaged(&mut self) -> Option<(Exchange, ExchangeEnding)> {
        self.finish(ExchangeEnding::Garbled)
    }

    /// Whether a byte has arrived after `moment`.
    #[must_use]
    pub fn has_heard_after(&self, moment: MonoTime) -> bool {
        self.last_byte_at > moment
    }

    /// Ends the open exchange early, without an answer.
    pub fn cut_short(&mut self) -> Option<(Exchange, ExchangeEnding)> {
        self.finish(ExchangeEnding::Silent)
    }

    /// Ends the open exchange without an answer because the port is gone, and discards received data.
    pub fn abandon(&mut self, now: MonoTime) -> Option<Exchange> {
        self.assembler.clear();
        self.is_out_of_step = false;
        self.transactions.connection_is_over();
        self.arrivals.clear();
        self.own_echo.is_over();
        self.quiet_from = now;
        self.open.take().map(|open| open.exchange)
    }

    /// When [`LineWire::pass`] has something to do without new bytes, if ever.
    #[must_use]
    pub fn wake_at(&self) -> Option<MonoTime> {
        let has_bytes = !self.assembler.is_empty();
        match &self.open {
            None if has_bytes => self.frame_end_at(),
            None => None,
            Some(open) if open.exception.is_some() => Some(self.pause_at()),
            Some(open) => match has_bytes.then(|| self.pause_at()) {
                // After the due time a reply may still be arriving: check again when the bytes pause.
                Some(pause) if pause > open.reply_due => Some(pause.min(open.give_up)),
                Some(pause) if self.assembler.waits_for_silence(&open.expected) => Some(pause),
                _ => Some(open.reply_due),
            },
        }
    }

    /// What was received and not taken yet, in order.
    #[must_use]
    pub fn heard(&self) -> &[HeardData] {
        &self.heard
    }

    /// Takes what was received since the last call, in order.
    pub fn take_heard(&mut self) -> Vec<HeardData> {
        std::mem::take(&mut self.heard)
    }

    /// When the bytes have paused for the silence between two frames.
    fn pause_at(&self) -> MonoTime {
        self.last_byte_at + self.timing.silence
    }

    /// When an incomplete frame can no longer continue, if ever.
    fn frame_end_at(&self) -> Option<MonoTime> {
        let adapters = if self.listens {
            LISTENED_HOLE
        } else {
            Duration::ZERO
        };
        self.timing
            .longest_hole()
            .map(|hole| self.last_byte_at + hole.max(adapters))
    }

    fn finish(&mut self, ending: ExchangeEnding) -> Option<(Exchange, ExchangeEnding)> {
        let open = self.open.take()?;
        self.own_echo.is_over();
        let rest = self.assembler.end();
        self.note_noise(rest);
        Some((open.exchange, ending))
    }

    /// Removes the echo of our own frame from the received data, with what preceded it.
    fn take_echo(&mut self, now: MonoTime) {
        if let Some((noise, echo)) = self.own_echo.take_from(&mut self.assembler, now) {
            self.note(TrafficKind::Noise, noise);
            self.note(TrafficKind::Echo, echo);
        }
    }

    /// Whether the received data begins like the reply and has its length, but is not sound.
    fn holds_damaged_reply(&self) -> bool {
        // Data with the length of the reply may also be a damaged echo, and the reply is still to come.
        let may_be_echo = self.strips_echo && self.own_echo.is_awaited();
        let Some(open) = &self.open else {
            return false;
        };
        !may_be_echo && self.assembler.holds_damaged(&open.expected)
    }

    fn flush_if_silent(&mut self, now: MonoTime) {
        if self.frame_end_at().is_some_and(|end| now >= end) {
            self.flush_idle_bytes();
        }
    }

    fn flush_idle_bytes(&mut self) {
        let rest = self.assembler.end();
        let kind = match framing::decode(self.timing.framing, &rest) {
            Some((station, pdu)) if pdu::is_request(&pdu) => {
                TrafficKind::OtherMaster(Station(station))
            }
            Some((station, _)) => TrafficKind::Stray(Station(station)),
            None => TrafficKind::Noise,
        };
        self.note(kind, rest);
    }

    fn note(&mut self, kind: TrafficKind, bytes: Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        let (first, end) = self
            .arrivals
            .take(bytes.len())
            .unwrap_or((self.last_byte_at, self.last_byte_at));
        // Bytes that are read at once arrived one after the other.
        let begin = if self.is_timed {
            first.min(end.before(self.timing.on_wire(bytes.len())))
        } else {
            first
        };
        self.heard.push(HeardData {
            kind,
            bytes,
            begin,
            end,
        });
    }
}
