//! A Modbus TCP client: any bytes in any chunks, with drives behind it that answer anything at any time.
//!
//! Input: the model, the words of the drive's view, then events.

use super::feed::{Feed, chunks};
use super::plant;
use std::sync::Arc;
use std::time::Duration;
use vfd_drive::drive::description::DriveDescription;
use vfd_drive::drive::snapshot::DrivePresence;
use vfd_drive::drive::view::{ControlView, DriveView, RunState};
use vfd_model::domain::command::{CommandAnswer, Order, Outcome, Owner, Reason, Report};
use vfd_model::domain::ids::{AskerId, DriveIndex, Ticket};
use vfd_model::domain::native::{NativeOutcome, NativeRefusal};
use vfd_model::domain::report::LineReport;
use vfd_model::domain::standby::LineRole;
use vfd_model::domain::time::MonoTime;
use vfd_model::wire::{exception, mbap};
use vfd_north::north::modbus::own::{self, ServedGateway};
use vfd_north::north::modbus::{
    CallCommands, ConnectionLimits, EndedCall, ModbusAnswer, ModbusConnection, ModbusRequest,
    ReadBehind, RequestAction, RequestContext, RequestedOrder, UniformUnit, UnitCall, WordBuffer,
    native,
};

const NATIVE: u8 = 1;
const UNIFORM: u8 = 101;
const UNITS: [u8; 6] = [NATIVE, UNIFORM, UNIFORM, own::UNIT, own::BROADCAST, 9];
/// Bound of the output: what closes the connection, one piece of requests that are refused at once, and a full answer
/// for each place and each unit.
const OUTPUT_MAX: usize =
    ModbusConnection::OUTPUT_MAX + 2 * Feed::PIECE_MAX + (16 + 256) * mbap::MAX_ADU_BYTES;

pub fn run(bytes: &[u8]) {
    let mut feed = Feed::new(bytes);
    let drive = plant::drive(&plant::model(feed.byte()), 0, "pump", feed.flag());
    let mut client = Client::new(drive, &mut feed);
    while !feed.is_empty() && client.connection.close_reason().is_none() {
        client.event(&mut feed);
    }
    client.end();
}

/// The units behind the connection.
struct Units {
    drive: DriveDescription,
    uniform: UniformUnit,
    view: Arc<DriveView>,
}

impl Units {
    fn new(drive: DriveDescription, feed: &mut Feed<'_>) -> Self {
        let mut view = DriveView {
            line_is_up: true,
            run_state: RunState::Forward,
            ..DriveView::default()
        };
        view.snapshot.presence = DrivePresence::Online;
        let words = feed.words(32);
        let addresses = drive
            .model
            .registers
            .iter()
            .filter(|it| it.poll.is_some())
            .map(|it| it.address);
        addresses
            .zip(words)
            .for_each(|(address, word)| view.snapshot.take(address, &[word], MonoTime::ZERO));
        view.control = drive.control.is_some().then(ControlView::default);
        Self {
            uniform: UniformUnit::new(&drive),
            drive,
            view: Arc::new(view),
        }
    }

    fn is_stop(&self, unit: u8, ask: &ModbusRequest) -> bool {
        match unit {
            NATIVE => native::is_stop(&self.drive.model, ask),
            UNIFORM => self.uniform.is_stop(ask, &self.view),
            own::UNIT | own::BROADCAST => own::is_stop(unit, ask),
            _ => false,
        }
    }
}

impl ServedGateway for Units {
    fn lines(&self) -> usize {
        2
    }

    fn line(&self, place: usize) -> Option<LineReport> {
        (place == 0).then(LineReport::default)
    }

    fn drives(&self) -> usize {
        2
    }

    fn drive(&self, place: usize) -> Option<(&UniformUnit, Arc<DriveView>)> {
        (place == 0).then(|| (&self.uniform, Arc::clone(&self.view)))
    }

    fn standby(&self, _: usize) -> Option<LineRole> {
        None
    }
}

/// What an observer of the socket knows.
#[derive(Default)]
struct Observer {
    /// Sent, but not a complete message yet.
    sent: Vec<u8>,
    is_broken: bool,
    /// Requests without an answer: transaction, unit, function.
    open: Vec<(u16, u8, u8)>,
    /// Received, but not a complete message yet.
    received: Vec<u8>,
}

/// Removes the message that `stream` begins with. Returns transaction, unit and PDU; an error if no message can follow.
fn cut(stream: &mut Vec<u8>) -> Result<Option<(u16, u8, Vec<u8>)>, ()> {
    if stream.len() >= 4 && stream[2..4] != [0, 0] {
        return Err(());
    }
    if stream.len() < 6 {
        return Ok(None);
    }
    let length = usize::from(stream[4]) << 8 | usize::from(stream[5]);
    if !(2..=254).contains(&length) {
        return Err(());
    }
    if stream.len() < 6 + length {
        return Ok(None);
    }
    let message: Vec<u8> = stream.drain(..6 + length).collect();
    Ok(Some((
        u16::from_be_bytes([message[0], message[1]]),
        message[6],
        message[7..].to_vec(),
    )))
}

impl Observer {
    fn sends(&mut self, bytes: &[u8]) {
        self.sent.extend_from_slice(bytes);
        while !self.is_broken {
            match cut(&mut self.sent) {
                Ok(Some((transaction, unit, pdu))) => self.open.push((transaction, unit, pdu[0])),
                Ok(None) => return,
                Err(()) => self.is_broken = true,
            }
        }
    }

    fn receives(&mut self, bytes: &[u8]) {
        self.received.extend_from_slice(bytes);
        while let Some((transaction, unit, pdu)) =
            cut(&mut self.received).expect("only sound messages go out")
        {
            let is_it = |it: &(u16, u8, u8)| {
                (it.0, it.1, it.2 | 0x80) == (transaction, unit, pdu[0] | 0x80)
            };
            // The oldest: equal ones cannot be told apart.
            let place = self.open.iter().position(is_it);
            self.open.remove(
                place.unwrap_or_else(|| {
                    panic!("no client asked for {transaction} {unit} {pdu:02X?}")
                }),
            );
        }
    }
}

struct Client {
    connection: ModbusConnection,
    observer: Observer,
    units: Units,
    commands: CallCommands,
    /// Calls of the native unit that the drive has not answered.
    native: Vec<UnitCall>,
    /// Orders that the drive has not answered.
    orders: Vec<Ticket>,
    now: MonoTime,
    transaction: u16,
}

impl Client {
    fn new(drive: DriveDescription, feed: &mut Feed<'_>) -> Self {
        let now = MonoTime::from_millis(1_000);
        Self {
            connection: ModbusConnection::new(ConnectionLimits::default(), now),
            observer: Observer::default(),
            units: Units::new(drive, feed),
            commands: CallCommands::default(),
            native: Vec::new(),
            orders: Vec::new(),
            now,
            transaction: 0,
        }
    }

    fn event(&mut self, feed: &mut Feed<'_>) {
        match feed.byte() % 9 {
            0 => self.send(feed.piece(), None),
            1..=3 => self.request(feed),
            4 => self.drive_answers(feed),
            5 => self.order_ends(feed),
            6 => self.read(usize::from(feed.word())),
            7 => self.pass(feed.millis()),
            _ => {
                let piece = feed.piece();
                self.send(&piece.repeat(Feed::PIECE_MAX / piece.len().max(1)), None);
            }
        }
        assert!(
            self.connection.output().len() <= OUTPUT_MAX,
            "{} bytes wait",
            self.connection.output().len()
        );
    }

    /// A complete message, in chunks.
    fn request(&mut self, feed: &mut Feed<'_>) {
        let unit = feed.one_of(&UNITS);
        let seed = feed.byte();
        let pdu = feed.piece();
        let mut message = Vec::new();
        self.transaction = self.transaction.wrapping_add(1);
        mbap::encode(&mut message, self.transaction, unit, |out| {
            out.extend_from_slice(if pdu.is_empty() {
                &[0]
            } else {
                &pdu[..pdu.len().min(253)]
            });
        });
        self.send(&message, Some(seed));
    }

    fn send(&mut self, bytes: &[u8], seed: Option<u8>) {
        let pieces: Vec<&[u8]> =
            seed.map_or_else(|| vec![bytes], |seed| chunks(bytes, seed).collect());
        for piece in pieces {
            let units = &self.units;
            self.connection
                .receive(self.now, piece, &|unit, ask| units.is_stop(unit, ask));
            self.observer.sends(piece);
            while let Some(call) = self.connection.next_call() {
                self.serve(call);
            }
            if self.connection.close_reason().is_some() {
                return;
            }
            assert!(!self.observer.is_broken, "what is no Modbus TCP was taken");
        }
    }

    fn serve(&mut self, call: UnitCall) {
        let mut words = WordBuffer::default();
        let owner = Owner::Mqtt;
        let present = RequestContext {
            now: self.now,
            uptime_s: 7,
            owner,
            standby: None,
        };
        let is_stop = self.units.is_stop(call.unit, &call.ask);
        let taken = match call.unit {
            NATIVE => match native::ask_of(&self.units.drive.model, call.ask.clone()) {
                Ok(_) => return self.native.push(call),
                Err(code) => RequestAction::Exception(code),
            },
            UNIFORM => self
                .units
                .uniform
                .take(&call.ask, &self.units.view, &present, &mut words),
            own::UNIT | own::BROADCAST => {
                own::take(call.unit, &call.ask, &self.units, &present, &mut words)
            }
            _ => RequestAction::Exception(exception::GATEWAY_PATH_UNAVAILABLE),
        };
        let now = self.now;
        let connection = &mut self.connection;
        let ordered = taken.at_once(&words, |answer| connection.answer(now, call.ticket, answer));
        assert!(
            call.ask.writes() || ordered.is_ok(),
            "a read orders: {:?}",
            call.ask
        );
        let stops = matches!(
            &ordered,
            Err(RequestedOrder::StopAll | RequestedOrder::One(Order::Stop { .. } | Order::Coast))
        );
        assert!(
            is_stop || !stops,
            "a stop that finds no place: {:?}",
            call.ask
        );
        if ordered.is_err() {
            let order = connection.fresh_ticket();
            self.orders.push(order);
            self.commands.expect(
                now,
                call.ticket,
                call.deadline,
                vec![order],
                None,
                read_behind(&call),
            );
        }
    }

    /// Answers with or without sense.
    fn drive_answers(&mut self, feed: &mut Feed<'_>) {
        let kind = feed.byte();
        let place = usize::from(feed.byte());
        if self.native.is_empty() {
            return;
        }
        let call = self.native.remove(place % self.native.len());
        let outcome = match kind % 8 {
            0 => NativeOutcome::Words(feed.words(130).into()),
            1 => NativeOutcome::Written,
            2 => NativeOutcome::KeptOldValue(feed.word()),
            3 => NativeOutcome::DriveException {
                code: feed.byte(),
                reason: Reason::DriveException,
            },
            4 => NativeOutcome::Refused(NativeRefusal::LineDown),
            5 => NativeOutcome::NoReply,
            6 => NativeOutcome::Superseded,
            _ => {
                let count = if let ModbusRequest::ReadWords { count, .. } = call.ask {
                    count
                } else {
                    1
                };
                NativeOutcome::Words(vec![feed.word(); count.into()].into())
            }
        };
        self.connection
            .answer(self.now, call.ticket, native::answer_of(&outcome));
    }

    fn order_ends(&mut self, feed: &mut Feed<'_>) {
        const OUTCOMES: [Outcome; 4] = [
            Outcome::Acknowledged,
            Outcome::Confirmed,
            Outcome::Failed,
            Outcome::Refused,
        ];
        let outcome = feed.one_of(&OUTCOMES);
        let place = usize::from(feed.byte());
        let is_final = feed.flag();
        if self.orders.is_empty() {
            return;
        }
        let ticket = self.orders.remove(place % self.orders.len());
        let report = Report {
            exception: Some(feed.byte()),
            ..Report::new(outcome, Reason::NoReply)
        };
        let answer = CommandAnswer {
            asker: AskerId(1),
            ticket,
            drive: DriveIndex(0),
            report,
            is_final,
        };
        let Some(EndedCall {
            call,
            exception,
            read,
        }) = self.commands.take(&answer)
        else {
            return;
        };
        let Some(read) = read else {
            return self.connection.answer(
                self.now,
                call,
                exception.map_or(ModbusAnswer::Written, ModbusAnswer::Exception),
            );
        };
        let mut words = WordBuffer::default();
        let present = RequestContext {
            now: self.now,
            uptime_s: 7,
            owner: Owner::Mqtt,
            standby: None,
        };
        let taken = self.units.uniform.read(
            read.address,
            read.count,
            &self.units.view,
            &present,
            &mut words,
        );
        let now = self.now;
        let connection = &mut self.connection;
        taken
            .at_once(&words, |answer| connection.answer(now, call, answer))
            .expect("a read orders nothing");
    }

    /// The client reads at most `bytes` bytes of its answers.
    fn read(&mut self, bytes: usize) {
        let bytes = bytes.min(self.connection.output().len());
        self.observer.receives(&self.connection.output()[..bytes]);
        self.connection.wrote(bytes);
    }

    fn pass(&mut self, time: Duration) {
        let until = self.now + time;
        while let Some(wake) = self.connection.next_wake().filter(|wake| *wake <= until) {
            self.now = self.now.max(wake);
            self.connection.tick(self.now);
            assert!(
                self.connection
                    .next_wake()
                    .is_none_or(|next| next > self.now),
                "woken for ever"
            );
        }
        self.now = until;
    }

    /// Every request is answered in time, unless the connection was closed.
    fn end(&mut self) {
        self.read(usize::MAX);
        if self.connection.close_reason().is_none() {
            self.pass(ConnectionLimits::default().answer_within);
            self.read(usize::MAX);
            assert!(
                self.observer.open.is_empty(),
                "without an answer: {:?}",
                self.observer.open
            );
        }
        assert!(
            self.observer.received.is_empty(),
            "half an answer: {:02X?}",
            self.observer.received
        );
    }
}

fn read_behind(call: &UnitCall) -> Option<ReadBehind> {
    match call.ask {
        ModbusRequest::ReadWriteWords {
            read_address,
            read_count,
            ..
        } => Some(ReadBehind {
            unit: call.unit,
            address: read_address,
            count: read_count,
        }),
        _ => None,
    }
}
