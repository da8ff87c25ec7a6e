//! One Modbus TCP client as a machine without a socket or a clock: bytes, answers and time go in; calls
//! for units and bytes for the client come out.

use super::answer::{self, ModbusAnswer, ResponseForm};
use super::ask::ModbusRequest;
use super::attempts::{self, UnsentAttempt};
use super::counters::ConnectionCounters;
use super::limits::{CloseReason, ConnectionLimits};
use super::{refusal, request};
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::ids::Ticket;
use crate::domain::time::MonoTime;
use crate::journal::TriedWrite;
use crate::wire::exception;
use crate::wire::mbap;
use std::collections::VecDeque;
use std::time::Duration;

/// A request for a unit. It is finished by one [`ModbusConnection::answer`], or by exception 0B at its deadline.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnitCall {
    /// This connection's number for it; never reused.
    pub ticket: Ticket,
    /// The unit that the client addressed, not checked.
    pub unit: u8,
    /// The request.
    pub ask: ModbusRequest,
    /// When the client gets exception 0B if there is no answer yet; for a read maybe sooner, see [`ConnectionLimits`].
    pub deadline: MonoTime,
}

/// Whether a request to a unit orders a stop. This depends on the unit, so the owner supplies it.
pub type IsStop<'a> = &'a dyn Fn(u8, &ModbusRequest) -> bool;

/// One client connection. Its owner moves bytes between it and the socket:
///
/// * bytes from the socket go to [`receive`](Self::receive), as long as [`wants_input`](Self::wants_input);
///   then [`next_call`](Self::next_call) is called until it returns `None`;
/// * the outcome of a call goes to [`answer`](Self::answer);
/// * [`output`](Self::output) goes to the socket, and the number of bytes written to [`wrote`](Self::wrote);
/// * [`tick`](Self::tick) is called when [`next_wake`](Self::next_wake) is due;
/// * once there is a [`close_reason`](Self::close_reason), what is left of the output may still be written,
///   and the socket is closed.
///
/// Answers are sent in the order in which they become available, each with the transaction and the unit of its request.
/// Received bytes are parsed at once, so only the beginning of one message is ever kept. Bytes that arrive against
/// `wants_input` are served too, until the output passes [`OUTPUT_MAX`](Self::OUTPUT_MAX).
#[derive(Debug)]
pub struct ModbusConnection {
    limits: ConnectionLimits,
    /// The beginning of one message.
    input: Vec<u8>,
    /// When the first byte of `input` arrived.
    begun: Option<MonoTime>,
    calls: VecDeque<UnitCall>,
    /// Requests in flight, oldest first.
    pending: Vec<PendingCall>,
    output: Vec<u8>,
    next_ticket: u64,
    /// When the last request arrived or the last call was finished.
    active: MonoTime,
    close: Option<CloseReason>,
    counters: ConnectionCounters,
    /// Attempts to write that reach no line, oldest first.
    kept: VecDeque<UnsentAttempt>,
}

/// What the answer to a call needs.
#[derive(Debug)]
struct PendingCall {
    ticket: Ticket,
    deadline: MonoTime,
    transaction: u16,
    unit: u8,
    form: ResponseForm,
    /// The call is a stop that arrived while all places were taken.
    is_extra: bool,
}

impl ModbusConnection {
    /// No more input is read while more bytes than this are waiting to be written: the full answers to 16 requests.
    pub const OUTPUT_HIGH: usize = 16 * mbap::MAX_ADU_BYTES;
    /// Input that arrives while more bytes than this are waiting to be written closes the connection. It leaves room
    /// for the exceptions to some socket reads already in progress.
    pub const OUTPUT_MAX: usize = 64 * 1024;
    /// Most attempts waiting to be fetched: as many requests as some reads of the socket bring.
    pub const KEPT_MAX: usize = 256;
    /// Most capacity that an empty buffer keeps, so that thousands of idle connections stay small.
    const KEEP_BYTES: usize = 512;

    /// A connection that was accepted at `now`. It allocates nothing before the first request.
    #[must_use]
    pub fn new(limits: ConnectionLimits, now: MonoTime) -> Self {
        Self {
            limits,
            input: Vec::new(),
            begun: None,
            calls: VecDeque::new(),
            pending: Vec::new(),
            output: Vec::new(),
            next_ticket: 0,
            active: now,
            close: None,
            counters: ConnectionCounters::default(),
            kept: VecDeque::new(),
        }
    }

    /// Takes bytes that the client sent. Exceptions that need no unit are answered at once. Calls are returned in the
    /// order in which they were sent, stops included: one that overtook a run order of the same client would be undone
    /// by it.
    pub fn receive(&mut self, now: MonoTime, bytes: &[u8], is_stop: IsStop<'_>) {
        if self.close.is_some() || bytes.is_empty() {
            return;
        }
        if self.output.len() > Self::OUTPUT_MAX {
            return self.end(CloseReason::NotReading);
        }
        let mut held = std::mem::take(&mut self.input);
        let joined = !held.is_empty();
        if joined {
            held.extend_from_slice(bytes);
        }
        let used = self.read_messages(now, if joined { &held } else { bytes }, is_stop);
        if joined {
            held.drain(..used);
        } else {
            held.extend_from_slice(&bytes[used..]);
        }
        release(&mut held);
        if held.is_empty() {
            self.begun = None;
        } else if used > 0 || self.begun.is_none() {
            self.begun = Some(now);
        }
        self.input = held;
    }

    /// How many of `bytes` reach to the end of the next message; all of them if none ends there. An owner that passes
    /// them to [`receive`](Self::receive) in such pieces, and answers immediate requests in between, has only those
    /// requests in flight that wait for something.
    #[must_use]
    pub fn next_piece(&self, bytes: &[u8]) -> usize {
        let held = self.input.len();
        let byte = |at: usize| {
            at.checked_sub(held)
                .map_or_else(|| self.input.get(at), |at| bytes.get(at))
                .copied()
        };
        let (Some(high), Some(low)) = (byte(4), byte(5)) else {
            return bytes.len();
        };
        let whole = mbap::HEADER_BYTES - 1 + usize::from(u16::from_be_bytes([high, low]));
        whole.saturating_sub(held).max(1).min(bytes.len())
    }

    /// An unused number, for orders that belong to no call.
    pub fn fresh_ticket(&mut self) -> Ticket {
        self.next_ticket += 1;
        Ticket(self.next_ticket - 1)
    }

    /// The next request for a unit, in order of arrival.
    pub fn next_call(&mut self) -> Option<UnitCall> {
        self.calls.pop_front()
    }

    /// Answers a call. A ticket that is not pending (answered, expired, never issued) is ignored.
    pub fn answer(&mut self, now: MonoTime, ticket: Ticket, answer: ModbusAnswer<'_>) {
        let Some(place) = self
            .pending
            .iter()
            .position(|pending| pending.ticket == ticket)
        else {
            return;
        };
        let pending = self.pending.remove(place);
        self.finish(now, &pending, answer);
    }

    /// Refuses a call before it reaches a line: it is answered with the exception for `report`, and kept if it `tried`
    /// to write something.
    pub fn refuse(
        &mut self,
        now: MonoTime,
        call: &UnitCall,
        tried: Option<TriedWrite>,
        report: Report,
    ) {
        if let Some(tried) = tried {
            self.keep_attempt(call.unit, tried, report);
        }
        let code = refusal::exception_for(&report).unwrap_or(exception::SERVER_DEVICE_FAILURE);
        self.answer(now, call.ticket, ModbusAnswer::Exception(code));
    }

    /// The next attempt to write that reached no line. Each is returned once; at most [`KEPT_MAX`](Self::KEPT_MAX) are
    /// queued.
    pub fn next_kept(&mut self) -> Option<UnsentAttempt> {
        self.kept.pop_front()
    }

    fn keep_attempt(&mut self, unit: u8, tried: TriedWrite, report: Report) {
        if self.kept.len() < Self::KEPT_MAX {
            self.kept.push_back(UnsentAttempt {
                unit,
                tried,
                report,
            });
        } else {
            self.counters.attempts_lost += 1;
        }
    }

    /// Keeps a request that was never handed out, if it writes.
    fn keep_calls(&mut self, calls: impl Iterator<Item = UnitCall>, report: Report) {
        for call in calls.filter(|call| call.ask.writes()) {
            self.keep_attempt(call.unit, call.ask.tried(call.unit), report);
        }
    }

    /// Sets the idle time-out; `None`: never close.
    pub const fn set_idle_timeout(&mut self, idle_timeout: Option<Duration>) {
        self.limits.idle_timeout = idle_timeout;
    }

    /// Whether the client is waiting for an answer.
    #[must_use]
    pub const fn is_busy(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Whether the socket should be read: not while too much output is pending, and not after the connection is
    /// closing.
    #[must_use]
    pub fn wants_input(&self) -> bool {
        self.close.is_none() && self.output.len() <= Self::OUTPUT_HIGH
    }

    /// Bytes for the client, oldest first.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        &self.output
    }

    /// Removes the first `bytes` of the output, which were written.
    pub fn wrote(&mut self, bytes: usize) {
        self.output.drain(..bytes.min(self.output.len()));
        release(&mut self.output);
    }

    /// Why the connection is to be closed, once it is. From then on nothing is received or answered.
    #[must_use]
    pub const fn close_reason(&self) -> Option<CloseReason> {
        self.close
    }

    /// Does what is due at `now`: answers calls past their deadline, closes on an expired time-out.
    pub fn tick(&mut self, now: MonoTime) {
        while let Some(oldest) = self.pending.first()
            && oldest.deadline <= now
        {
            let expired = self.pending.remove(0);
            let calls = std::mem::take(&mut self.calls).into_iter();
            let (late, calls): (VecDeque<_>, _) =
                calls.partition(|call| call.ticket == expired.ticket);
            self.calls = calls;
            self.keep_calls(
                late.into_iter(),
                Report::new(Outcome::Expired, Reason::TooLate),
            );
            self.finish(
                now,
                &expired,
                ModbusAnswer::Exception(exception::GATEWAY_TARGET_FAILED),
            );
        }
        if self.body_due().is_some_and(|due| due <= now) {
            self.end(CloseReason::BodyTimeout);
        } else if self.idle_due().is_some_and(|due| due <= now) {
            self.end(CloseReason::Idle);
        }
    }

    /// When [`tick`](Self::tick) has something to do, unless another event occurs first.
    #[must_use]
    pub fn next_wake(&self) -> Option<MonoTime> {
        let answer_due = self.pending.first().map(|oldest| oldest.deadline);
        [answer_due, self.body_due(), self.idle_due()]
            .into_iter()
            .flatten()
            .min()
    }

    /// What happened so far.
    #[must_use]
    pub const fn counters(&self) -> &ConnectionCounters {
        &self.counters
    }

    /// Takes all whole messages at the start of `stream`; returns how many bytes were consumed.
    fn read_messages(&mut self, now: MonoTime, stream: &[u8], is_stop: IsStop<'_>) -> usize {
        let mut used = 0;
        loop {
            match mbap::decode(&stream[used..]) {
                Ok(Some(message)) => {
                    self.take_request(now, &message, is_stop);
                    used += message.adu_bytes;
                }
                Ok(None) => return used,
                Err(malformed) => {
                    // That both arrived in one segment is chance: a stop that was whole before it is not lost because
                    // of it.
                    let calls = std::mem::take(&mut self.calls).into_iter();
                    let (stops, others) = calls.partition(|call| is_stop(call.unit, &call.ask));
                    self.calls = others;
                    self.end(CloseReason::Malformed(malformed));
                    self.calls = stops;
                    return stream.len();
                }
            }
        }
    }

    fn take_request(
        &mut self,
        now: MonoTime,
        message: &mbap::MbapMessage<'_>,
        is_stop: IsStop<'_>,
    ) {
        self.counters.requests += 1;
        self.active = now;
        match request::parse(message.pdu) {
            Ok(ask) if self.pending.len() < self.limits.pending_max => {
                self.call(now, message, ask, false)
            }
            Ok(ask) if self.may_stop(message.unit) && is_stop(message.unit, &ask) => {
                self.call(now, message, ask, true)
            }
            Ok(ask) => {
                if ask.writes() {
                    self.keep_attempt(
                        message.unit,
                        ask.tried(message.unit),
                        Report::refused(Reason::QueueFull),
                    );
                }
                self.refuse_at_once(message, exception::SERVER_DEVICE_BUSY);
            }
            Err(code) => {
                if let Some(tried) = attempts::of_pdu(message.unit, message.pdu) {
                    self.keep_attempt(
                        message.unit,
                        tried,
                        Report::refused(attempts::reason_of(code)),
                    );
                }
                self.refuse_at_once(message, code);
            }
        }
    }

    /// Whether the place reserved for a stop of `unit` is free. If not, such a stop is already in flight.
    fn may_stop(&self, unit: u8) -> bool {
        !self
            .pending
            .iter()
            .any(|pending| pending.is_extra && pending.unit == unit)
    }

    fn call(
        &mut self,
        now: MonoTime,
        message: &mbap::MbapMessage<'_>,
        ask: ModbusRequest,
        is_extra: bool,
    ) {
        let ticket = self.fresh_ticket();
        let deadline = now + self.limits.answer_within;
        let unit = message.unit;
        let form = ResponseForm::of(&ask);
        self.pending.push(PendingCall {
            ticket,
            deadline,
            transaction: message.transaction,
            unit,
            form,
            is_extra,
        });
        let for_read = now + self.limits.read_within;
        let deadline = if ask.writes() {
            deadline
        } else {
            deadline.min(for_read)
        };
        self.calls.push_back(UnitCall {
            ticket,
            unit,
            ask,
            deadline,
        });
    }

    fn refuse_at_once(&mut self, message: &mbap::MbapMessage<'_>, code: u8) {
        self.counters.count_exception(code);
        mbap::encode(&mut self.output, message.transaction, message.unit, |out| {
            answer::encode_exception(out, message.pdu[0], code);
        });
    }

    fn finish(&mut self, now: MonoTime, pending: &PendingCall, answer: ModbusAnswer<'_>) {
        self.active = now;
        let result = pending.form.judge(answer);
        match result {
            Ok(_) => self.counters.replies += 1,
            Err(code) => self.counters.count_exception(code),
        }
        mbap::encode(&mut self.output, pending.transaction, pending.unit, |out| {
            pending.form.encode(out, result)
        });
    }

    /// Nothing more is received or answered; pending output may still be written.
    fn end(&mut self, reason: CloseReason) {
        self.close = Some(reason);
        self.input = Vec::new();
        self.begun = None;
        let calls = std::mem::take(&mut self.calls);
        self.keep_calls(calls.into_iter(), Report::refused(Reason::CommanderLost));
        self.pending = Vec::new();
    }

    fn body_due(&self) -> Option<MonoTime> {
        self.begun.map(|begun| begun + self.limits.body_timeout)
    }

    fn idle_due(&self) -> Option<MonoTime> {
        let idle = self.close.is_none() && self.begun.is_none() && self.pending.is_empty();
        match self.limits.idle_timeout {
            Some(timeout) if idle => Some(self.active + timeout),
            _ => None,
        }
    }
}

fn release(buffer: &mut Vec<u8>) {
    if buffer.capacity() > ModbusConnection::KEEP_BYTES
        && buffer.len() <= ModbusConnection::KEEP_BYTES
    {
        buffer.shrink_to(ModbusConnection::KEEP_BYTES);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::north::modbus::ask::WordTable;
    use crate::wire::mbap::MalformedStream;
    use proptest::prelude::*;

    const T0: MonoTime = MonoTime::from_millis(1_000);

    fn connection() -> ModbusConnection {
        ModbusConnection::new(ConnectionLimits::default(), T0)
    }

    fn message(transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        mbap::encode(&mut out, transaction, unit, |out| {
            out.extend_from_slice(pdu)
        });
        out
    }

    fn read(transaction: u16) -> Vec<u8> {
        message(transaction, 7, &[3, 1, 1, 0, 1])
    }

    fn after(millis: u64) -> MonoTime {
        T0 + Duration::from_millis(millis)
    }

    const ONE: ModbusAnswer<'_> = ModbusAnswer::Words(&[1]);

    fn never(_: u8, _: &ModbusRequest) -> bool {
        false
    }

    /// Any write of 0 stops.
    fn zero(_: u8, ask: &ModbusRequest) -> bool {
        matches!(ask, ModbusRequest::WriteWord { value: 0, .. })
    }

    #[test]
    fn a_stop_in_front_of_what_is_no_modbus_is_not_lost() {
        let run = message(1, 7, &[6, 0, 2, 0, 1]);
        let stop = message(2, 7, &[6, 0, 2, 0, 0]);
        let mut connection = connection();
        connection.receive(T0, &[run, stop, vec![0, 3, 0, 7, 0, 2, 9]].concat(), &zero);
        assert_eq!(
            connection.close_reason(),
            Some(CloseReason::Malformed(MalformedStream::Protocol(7)))
        );
        assert_eq!(
            connection.next_call().map(|call| call.ask),
            Some(ModbusRequest::WriteWord {
                address: 2,
                value: 0
            })
        );
        assert_eq!(connection.next_call(), None);
        assert!(
            connection.output().is_empty(),
            "no client is there to read it"
        );
    }

    #[test]
    fn a_read_becomes_a_call_and_its_words_the_answer() {
        let mut connection = connection();
        connection.receive(T0, &message(0x1234, 7, &[4, 1, 1, 0, 2]), &never);
        let call = connection.next_call().unwrap();
        assert_eq!((call.unit, call.deadline), (7, after(5_000)));
        assert_eq!(
            call.ask,
            ModbusRequest::ReadWords {
                table: WordTable::Input,
                address: 0x0101,
                count: 2
            }
        );
        assert_eq!(connection.next_call(), None);
        connection.answer(after(10), call.ticket, ModbusAnswer::Words(&[6000, 1]));
        assert_eq!(
            connection.output(),
            message(0x1234, 7, &[4, 4, 0x17, 0x70, 0, 1])
        );
        assert_eq!(
            connection.counters(),
            &ConnectionCounters {
                requests: 1,
                replies: 1,
                ..ConnectionCounters::default()
            }
        );
    }

    #[test]
    fn answers_go_out_as_they_come_each_with_its_own_transaction_and_unit() {
        let mut connection = connection();
        connection.receive(
            T0,
            &[read(1), message(1, 8, &[6, 0, 2, 0, 1]), read(0xFFFF)].concat(),
            &never,
        );
        let calls: Vec<UnitCall> = std::iter::from_fn(|| connection.next_call()).collect();
        assert_eq!(
            calls[1].ask,
            ModbusRequest::WriteWord {
                address: 2,
                value: 1
            }
        );
        connection.answer(T0, calls[2].ticket, ModbusAnswer::Words(&[3]));
        connection.answer(T0, calls[1].ticket, ModbusAnswer::Written);
        connection.answer(T0, calls[0].ticket, ModbusAnswer::Exception(0x0A));
        let answers = [
            message(0xFFFF, 7, &[3, 2, 0, 3]),
            message(1, 8, &[6, 0, 2, 0, 1]),
            message(1, 7, &[0x83, 0x0A]),
        ];
        assert_eq!(connection.output(), answers.concat());
    }

    #[test]
    fn what_needs_no_drive_is_answered_at_once() {
        for (pdu, answer) in [
            (&[0][..], [0x80, 1]),
            (&[0x83, 0, 0, 0, 1], [0x83, 1]),
            (&[0xFF], [0xFF, 1]),
            (&[7], [0x87, 1]),
            (&[5, 0, 0, 0xFF, 1], [0x85, 3]),
            (&[3, 0, 0, 0, 126], [0x83, 3]),
            (&[4, 0xFF, 0xFF, 0, 2], [0x84, 2]),
            (&[0x10, 0, 0, 0, 1, 2, 0], [0x90, 3]),
        ] {
            let mut connection = connection();
            connection.receive(T0, &message(9, 255, pdu), &never);
            assert_eq!(connection.next_call(), None);
            assert_eq!(connection.output(), message(9, 255, &answer));
            assert_eq!(connection.counters().exceptions[usize::from(answer[1])], 1);
        }
    }

    #[test]
    fn a_stream_falls_into_pieces_of_one_message_each() {
        let mut connection = connection();
        let stream: Vec<u8> = (0..3).flat_map(read).collect();
        let length = stream.len() / 3;
        for (from, to) in [
            (0, 3),
            (3, length),
            (length, 2 * length),
            (2 * length, 3 * length - 1),
        ] {
            assert_eq!(
                connection.next_piece(&stream[from..]).min(to - from),
                to - from,
                "from {from}"
            );
            connection.receive(T0, &stream[from..to], &never);
        }
        assert_eq!(connection.next_piece(&stream[3 * length - 1..]), 1);
        assert_eq!(
            connection.next_piece(&stream[3 * length - 1..].repeat(9)),
            1
        );
        assert_eq!(connection.next_piece(&[]), 0);
    }

    #[test]
    fn the_17th_request_in_flight_is_busy_and_makes_no_call() {
        let mut connection = connection();
        let stream: Vec<u8> = (0..17).flat_map(read).collect();
        connection.receive(T0, &stream, &never);
        let calls: Vec<UnitCall> = std::iter::from_fn(|| connection.next_call()).collect();
        assert_eq!(calls.len(), 16);
        assert_eq!(connection.output(), message(16, 7, &[0x83, 6]));
        connection.answer(T0, calls[3].ticket, ONE);
        connection.receive(T0, &read(17), &never);
        assert!(connection.next_call().is_some());
    }

    #[test]
    fn a_stop_finds_a_place_although_all_are_taken() {
        let stop = message(40, 7, &[6, 0, 2, 0, 0]);
        let other = message(41, 7, &[6, 0, 2, 0, 1]);
        let mut connection = connection();
        let stream: Vec<u8> = (0..16).flat_map(read).collect();
        connection.receive(T0, &[stream, other, stop.clone()].concat(), &zero);
        let calls: Vec<UnitCall> = std::iter::from_fn(|| connection.next_call()).collect();
        assert_eq!((calls.len(), calls[16].unit), (17, 7));
        assert_eq!(
            connection.output(),
            message(41, 7, &[0x86, 6]),
            "what is no stop is busy"
        );
        connection.wrote(usize::MAX);
        connection.receive(T0, &stop, &zero);
        assert_eq!(
            connection.output(),
            message(40, 7, &[0x86, 6]),
            "that very stop is under way"
        );
        connection.wrote(usize::MAX);
        connection.receive(T0, &message(42, 8, &[6, 0, 2, 0, 0]), &zero);
        assert_eq!(
            connection.next_call().map(|call| call.unit),
            Some(8),
            "each unit has a place"
        );
        connection.answer(T0, calls[16].ticket, ModbusAnswer::Written);
        assert_eq!(connection.output(), stop);
        connection.receive(T0, &stop, &zero);
        assert!(connection.next_call().is_some(), "the place is free again");
    }

    #[test]
    fn a_stop_never_overtakes_what_the_same_client_sent_before_it() {
        let mut connection = connection();
        let run = message(1, 7, &[6, 0, 2, 0, 1]);
        let stop = message(2, 7, &[6, 0, 2, 0, 0]);
        connection.receive(T0, &[run, stop].concat(), &zero);
        let asks: Vec<ModbusRequest> = std::iter::from_fn(|| connection.next_call())
            .map(|call| call.ask)
            .collect();
        assert_eq!(
            asks,
            [1, 0].map(|value| ModbusRequest::WriteWord { address: 2, value })
        );
    }

    #[test]
    fn a_fresh_ticket_belongs_to_no_call() {
        let mut connection = connection();
        let fresh = connection.fresh_ticket();
        connection.receive(T0, &read(1), &never);
        assert_ne!(connection.next_call().unwrap().ticket, fresh);
        assert_ne!(connection.fresh_ticket(), fresh);
        connection.answer(T0, fresh, ONE);
        assert!(connection.output().is_empty());
    }

    #[test]
    fn only_a_pending_ticket_is_answered() {
        let mut connection = connection();
        connection.receive(T0, &read(1), &never);
        let ticket = connection.next_call().unwrap().ticket;
        connection.answer(T0, Ticket(77), ONE);
        assert!(connection.output().is_empty());
        connection.answer(T0, ticket, ONE);
        let once = connection.output().to_vec();
        connection.answer(T0, ticket, ModbusAnswer::Words(&[2]));
        assert_eq!(connection.output(), once);
    }

    #[test]
    fn a_call_without_an_answer_ends_at_its_deadline() {
        let mut connection = connection();
        connection.receive(T0, &read(1), &never);
        connection.receive(after(100), &read(2), &never);
        let call = connection.next_call().unwrap();
        assert_eq!(connection.next_wake(), Some(after(5_000)));
        connection.tick(after(4_999));
        assert!(connection.output().is_empty());
        connection.tick(after(5_000));
        assert_eq!(connection.output(), message(1, 7, &[0x83, 0x0B]));
        assert_eq!(connection.next_wake(), Some(after(5_100)));
        connection.answer(after(5_001), call.ticket, ONE);
        assert_eq!(connection.output(), message(1, 7, &[0x83, 0x0B]));
        connection.tick(after(5_100));
        assert_eq!(
            connection.next_call(),
            None,
            "an expired call is not given out"
        );
    }

    #[test]
    fn deadlines_are_kept_in_order_when_an_older_call_is_answered() {
        let mut connection = connection();
        for n in 0..3 {
            connection.receive(after(100 * u64::from(n)), &read(n), &never);
        }
        connection.answer(after(300), Ticket(0), ONE);
        connection.wrote(usize::MAX);
        assert_eq!(connection.next_wake(), Some(after(5_100)));
        connection.tick(after(5_100));
        assert_eq!(connection.output(), message(1, 7, &[0x83, 0x0B]));
    }

    #[test]
    fn what_is_no_modbus_ends_the_connection_behind_the_answers_that_are_due() {
        for (bad, reason) in [
            (&[0, 9, 0, 1, 0, 2, 7, 3][..], MalformedStream::Protocol(1)),
            (&[0, 9, 0, 0, 0, 1, 7], MalformedStream::Length(1)),
            (&[0, 9, 0, 0, 0xEA, 0x60], MalformedStream::Length(60_000)),
        ] {
            let mut connection = connection();
            connection.receive(
                T0,
                &[&message(1, 7, &[7]), &read(2), bad, &read(3)].concat(),
                &never,
            );
            assert_eq!(
                connection.close_reason(),
                Some(CloseReason::Malformed(reason))
            );
            assert_eq!(connection.output(), message(1, 7, &[0x87, 1]));
            assert!(!connection.wants_input() && connection.next_call().is_none());
            connection.receive(T0, &read(4), &never);
            connection.answer(T0, Ticket(0), ONE);
            connection.wrote(9);
            assert!(connection.output().is_empty());
            assert_eq!(
                (connection.next_wake(), connection.counters().requests),
                (None, 2)
            );
        }
    }

    #[test]
    fn a_message_begun_must_be_whole_in_time() {
        let mut connection = connection();
        let stream = [read(1), read(2)].concat();
        connection.receive(T0, &stream[..10], &never);
        connection.receive(after(4_000), &stream[10..11], &never);
        assert_eq!(connection.next_wake(), Some(after(5_000)));
        connection.receive(after(4_500), &stream[11..13], &never);
        connection.tick(after(5_000));
        assert_eq!(
            connection.close_reason(),
            None,
            "the second message began later"
        );
        connection.receive(after(9_499), &stream[13..23], &never);
        connection.tick(after(9_499));
        assert_eq!(connection.close_reason(), None);
        connection.tick(after(9_500));
        assert_eq!(connection.close_reason(), Some(CloseReason::BodyTimeout));
        assert_eq!(
            connection.output(),
            message(1, 7, &[0x83, 0x0B]),
            "what was due before still goes"
        );
    }

    #[test]
    fn a_connection_is_idle_from_its_last_request_or_answer() {
        let mut connection = ModbusConnection::new(
            ConnectionLimits {
                answer_within: Duration::MAX,
                ..ConnectionLimits::default()
            },
            T0,
        );
        assert_eq!(connection.next_wake(), Some(after(600_000)));
        connection.receive(after(599_999), &read(1), &never);
        let ticket = connection.next_call().unwrap().ticket;
        connection.tick(after(10_000_000));
        assert_eq!(connection.close_reason(), None, "a request is pending");
        connection.answer(after(20_000_000), ticket, ONE);
        connection.tick(after(20_599_999));
        assert_eq!(connection.close_reason(), None);
        connection.tick(after(20_600_000));
        assert_eq!(connection.close_reason(), Some(CloseReason::Idle));
    }

    #[test]
    fn the_idle_timeout_may_change_and_may_be_none() {
        let mut connection = connection();
        connection.set_idle_timeout(None);
        assert_eq!(connection.next_wake(), None);
        connection.tick(MonoTime::NEVER);
        assert_eq!(connection.close_reason(), None);
        connection.receive(after(1_000), &read(1), &never);
        assert!(connection.is_busy());
        connection.answer(after(2_000), Ticket(0), ONE);
        assert!(!connection.is_busy(), "though the answer is not read yet");
        connection.set_idle_timeout(Some(Duration::from_secs(3)));
        assert_eq!(connection.next_wake(), Some(after(5_000)));
        connection.tick(after(5_000));
        assert_eq!(connection.close_reason(), Some(CloseReason::Idle));
    }

    #[test]
    fn a_client_that_does_not_read_is_not_read_from_and_then_closed() {
        let mut connection = connection();
        let chunk: Vec<u8> = (0..500).flat_map(|n| message(n, 7, &[1])).collect();
        connection.receive(T0, &chunk, &never);
        assert!(!connection.wants_input());
        connection.wrote(400);
        assert!(connection.wants_input());
        while connection.output().len() <= ModbusConnection::OUTPUT_MAX {
            connection.receive(T0, &chunk, &never);
        }
        assert_eq!(connection.close_reason(), None);
        connection.receive(T0, &chunk, &never);
        assert_eq!(connection.close_reason(), Some(CloseReason::NotReading));
    }

    #[test]
    fn buffers_are_given_back() {
        let mut connection = connection();
        assert_eq!(
            connection.input.capacity()
                + connection.output.capacity()
                + connection.calls.capacity(),
            0
        );
        let stream: Vec<u8> = (0..2_000).flat_map(|n| message(n, 7, &[1])).collect();
        connection.receive(T0, &stream[..1], &never);
        connection.receive(T0, &stream[1..], &never);
        connection.wrote(usize::MAX);
        assert!(connection.input.capacity() <= ModbusConnection::KEEP_BYTES);
        assert!(connection.output.capacity() <= ModbusConnection::KEEP_BYTES);
        assert!(
            std::mem::size_of::<ModbusConnection>() <= 512,
            "10,000 idle connections must be small"
        );
    }

    #[test]
    fn close_reasons_can_be_read() {
        let reason = CloseReason::Malformed(MalformedStream::Length(1));
        assert_eq!(
            reason.to_string(),
            "not Modbus TCP: length 1 is outside 2 to 254"
        );
    }

    proptest! {
        /// Half of the chunks begin like a header; otherwise nearly all would end at the protocol identifier.
        #[test]
        fn no_bytes_grow_the_buffers_past_their_bounds(
            chunks in prop::collection::vec((any::<bool>(), prop::collection::vec(any::<u8>(), 0..600)), 0..40),
        ) {
            let mut connection = connection();
            for (header, bytes) in &chunks {
                let mut chunk = if *header { vec![0, 1, 0, 0, 0, 2, 1] } else { vec![] };
                chunk.extend(bytes);
                connection.receive(T0, &chunk, &never);
                prop_assert!(connection.kept.len() <= ModbusConnection::KEPT_MAX);
                prop_assert!(connection.input.len() < mbap::MAX_ADU_BYTES);
                prop_assert!(connection.input.capacity() <= ModbusConnection::KEEP_BYTES);
                prop_assert!(connection.pending.len() <= 16 && connection.calls.len() <= 16);
                prop_assert!(connection.output.len() <= ModbusConnection::OUTPUT_MAX + 2 * chunk.len());
                prop_assert_eq!(connection.begun.is_some(), !connection.input.is_empty());
            }
        }
    }
}
