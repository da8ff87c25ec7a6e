//! A line: bytes, time, clients and its port in any order. Each request ends once and in time, one exchange is open at
//! a time and none begins too early, and no motor is started without an order.
//!
//! Input: flags (1 ASCII, 2 with control), the model, then events.

use super::feed::Feed;
use super::plant;
use std::collections::{BTreeSet, HashSet};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;
use vfd_drive::journal::RememberedDrive;
use vfd_line::gateway::{DriveSetup, LineCore, LineEffect, LineInput, LineSetup, WakeReason};
use vfd_line::line::timeouts::ReplyTimeouts;
use vfd_line::line::timing::LineTiming;
use vfd_model::domain::address::DataTable;
use vfd_model::domain::command::{
    CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Owner, RegisterWrite, Rights,
};
use vfd_model::domain::frequency::Hertz;
use vfd_model::domain::ids::{AskerId, DriveIndex, Station, Ticket};
use vfd_model::domain::link::{EchoPolicy, Framing, LinkSettings, PortKind};
use vfd_model::domain::native::{NativeAsk, NativeRequest};
use vfd_model::domain::report::{LineFault, LineState};
use vfd_model::domain::time::MonoTime;
use vfd_model::profile::model::{Model, RegisterRole};
use vfd_model::wire::framing;
use vfd_model::wire::pdu::{self, Request, function};

const DRIVES: u8 = 2;
const PATIENCE: Duration = Duration::from_secs(2);
/// By then every command has its final outcome: a stop for a drive that does not answer is the last.
const ALL_HAS_ENDED: Duration = Duration::from_secs(700);
/// How often it is checked whether all has ended.
const LOOK: Duration = Duration::from_secs(10);
/// More than can end at once.
const EFFECTS_MAX: usize = 4_000;

pub fn run(bytes: &[u8]) {
    let mut feed = Feed::new(bytes);
    let flags = feed.byte();
    let framing = if flags & 1 == 0 {
        Framing::Rtu
    } else {
        Framing::Ascii
    };
    let model = Arc::new(plant::model(feed.byte()).on(framing));
    let mut watch = Watch::new(framing, &model, flags & 2 != 0);
    watch.input(LineInput::PortUp(PortKind::Serial));
    watch.decide();
    while !feed.is_empty() {
        watch.event(&mut feed);
        watch.decide();
    }
    watch.end();
}

/// What an observer knows of the line.
struct Watch {
    core: LineCore,
    framing: Framing,
    model: Arc<Model>,
    has_control: bool,
    silence: Duration,
    link: LinkSettings,
    now: MonoTime,
    /// Reads without an answer, with the asker.
    reads: HashSet<(Ticket, AskerId)>,
    /// Writes without an answer: they are commands, and a stop ends by its effect.
    writes: HashSet<(Ticket, AskerId)>,
    /// Commands without a final outcome.
    commands: BTreeSet<Ticket>,
    tickets: u64,
    last_frame: Vec<u8>,
    /// Nothing may be sent before this moment and the silence after it.
    quiet_since: MonoTime,
    /// How often RUN may still be sent.
    runs_ordered: usize,
}

impl Watch {
    fn new(framing: Framing, model: &Arc<Model>, has_control: bool) -> Self {
        let control = has_control.then(|| Arc::new(plant::control()));
        let drives = (1..=DRIVES).map(|station| DriveSetup {
            station: Station(station),
            model: Arc::clone(model),
            poll: Duration::from_millis(300),
            timeouts: ReplyTimeouts::fixed(Duration::from_millis(200)),
            max_lateness: Duration::from_millis(500),
            control: control.clone(),
            remembered: RememberedDrive::default(),
        });
        let link = LinkSettings::DEFAULT;
        let timing = LineTiming::for_models(framing, link, [model.as_ref()], Duration::ZERO);
        let setup = LineSetup {
            timing,
            drives: drives.collect(),
            echo: EchoPolicy::Strip,
            tells_traffic: true,
            first_epoch: 1,
            asked_before: false,
            joins_late: false,
            standby: None,
            keeps: false,
        };
        let now = MonoTime::from_millis(1);
        Self {
            core: LineCore::new(setup, now),
            framing,
            model: Arc::clone(model),
            has_control,
            silence: timing.silence,
            link,
            now,
            reads: HashSet::new(),
            writes: HashSet::new(),
            commands: BTreeSet::new(),
            tickets: 0,
            last_frame: Vec::new(),
            quiet_since: MonoTime::ZERO,
            runs_ordered: 0,
        }
    }

    fn event(&mut self, feed: &mut Feed<'_>) {
        match feed.byte() % 16 {
            0 => self.pass(feed.millis()),
            1 => self.pass(Duration::from_micros(feed.word().into())),
            2 => self.bytes(feed.piece()),
            3..=5 => self.reply(feed),
            6 | 7 => self.native(feed),
            8..=11 => self.command(feed),
            12 => self.input(LineInput::PathAlive(Owner::Mqtt)),
            13 => match feed.byte() % 4 {
                0 => self.input(LineInput::PathOpened(Owner::Mqtt)),
                1 => self.input(LineInput::Shutdown),
                asker => {
                    let asker = AskerId(asker.into());
                    self.input(LineInput::AskerGone(asker));
                    self.reads.retain(|(_, of)| *of != asker);
                }
            },
            14 => self.port(feed.byte()),
            _ => {
                let wake = self.core.next_wake().map_or(self.now, |wake| wake.at);
                self.pass(wake.since(self.now).min(Duration::from_secs(3600)));
            }
        }
    }

    fn input(&mut self, input: LineInput<'_>) {
        self.core.handle(self.now, input);
    }

    fn port(&mut self, what: u8) {
        let fault = [LineFault::Gone, LineFault::Failed, LineFault::Stuck]
            .get(usize::from(what % 8))
            .copied();
        self.input(fault.map_or(LineInput::PortUp(PortKind::Serial), LineInput::PortDown));
        self.quiet_since = self.now;
    }

    fn bytes(&mut self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.input(LineInput::Bytes(bytes));
            self.quiet_since = self.quiet_since.max(self.now);
        }
    }

    /// The right reply to the last frame, an exception, or either damaged.
    fn reply(&mut self, feed: &mut Feed<'_>) {
        let Some((station, pdu)) = framing::decode(self.framing, &self.last_frame) else {
            return;
        };
        let how = feed.byte();
        let word = feed.word();
        let mut reply = Vec::new();
        framing::encode(
            self.framing,
            &mut reply,
            station,
            |out| match Request::decode(&pdu) {
                _ if how & 3 == 3 => out.extend([pdu[0] | function::EXCEPTION_BIT, how >> 4]),
                Some(Request::Read { count, .. }) => {
                    pdu::encode_read_reply(out, DataTable::Holding, &vec![word; count.into()])
                }
                _ => out.extend_from_slice(&pdu[..pdu.len().min(5)]),
            },
        );
        if how & 4 != 0 {
            let at = usize::from(word) % reply.len();
            reply[at] ^= 0x10;
        }
        // Nothing is sent to us while we send.
        self.pass(self.quiet_since.since(self.now));
        self.bytes(&reply);
    }

    fn native(&mut self, feed: &mut Feed<'_>) {
        let kind = feed.byte();
        let asker = AskerId(u64::from(feed.byte() % 4));
        let drive = feed.byte() % (DRIVES + 1);
        let address = if kind & 8 == 0 {
            feed.word()
        } else {
            self.role(feed.byte())
        };
        let room = usize::from(u16::MAX - address) + 1;
        let ask = match kind % 4 {
            0 | 1 => NativeAsk::Read {
                address: address.into(),
                count: (1 + feed.word() % 125).min(room as u16),
            },
            2 => {
                let mut values = feed.words(122.min(room - 1));
                values.push(feed.word());
                NativeAsk::Write {
                    address: address.into(),
                    values,
                }
            }
            _ => NativeAsk::Loop { data: address },
        };
        let ticket = self.ticket();
        let drive = DriveIndex(drive.into());
        let origin = origin(feed.byte());
        if let NativeAsk::Write { values, .. } = &ask {
            // Each word may be one RUN.
            self.runs_ordered += values.len();
            self.writes.insert((ticket, asker));
        } else {
            self.reads.insert((ticket, asker));
        }
        let deadline = self.now + PATIENCE;
        self.input(LineInput::Native(NativeRequest {
            asker,
            ticket,
            drive,
            origin,
            ask,
            deadline,
        }));
    }

    /// The register of one of the roles by which a drive is commanded.
    fn role(&self, which: u8) -> u16 {
        let role = if which & 1 == 0 {
            RegisterRole::RunCommand
        } else {
            RegisterRole::FrequencyCommand
        };
        self.model
            .register_for(role)
            .map_or(0, |register| register.address.number())
    }

    fn command(&mut self, feed: &mut Feed<'_>) {
        let drive = feed.byte() % DRIVES;
        let who = feed.byte();
        let Some(order) = self.order(feed) else {
            return;
        };
        self.runs_ordered += usize::from(matches!(&order, Order::Go(go) if go.run().is_some()));
        let ticket = self.ticket();
        self.commands.insert(ticket);
        self.input(LineInput::Command(CommandRequest {
            asker: AskerId(u64::from(who % 4)),
            ticket,
            drive: DriveIndex(drive.into()),
            origin: origin(who),
            order,
            start_before: self.now + Duration::from_secs(1),
            issued: (who & 64 != 0).then_some(self.now),
            epoch: (who & 128 != 0).then_some(u64::from(who % 8)),
            trial: None,
        }));
    }

    fn order(&self, feed: &mut Feed<'_>) -> Option<Order> {
        let kind = feed.byte();
        let frequency = (kind & 16 != 0).then(|| Hertz::from_centihertz(feed.word()));
        Some(match kind % 16 {
            0 | 1 => Order::Stop {
                setpoint: frequency,
            },
            2 => Order::Coast,
            3 => Order::Reset,
            4 => Order::Release,
            5 => Order::Renew,
            6 => Order::Setup(
                self.model
                    .setup
                    .iter()
                    .filter_map(|item| item.address)
                    .take(16)
                    .collect(),
            ),
            rest => {
                let direction = if kind & 32 == 0 {
                    Direction::Forward
                } else {
                    Direction::Reverse
                };
                let writes = feed.words(if rest < 9 { 17 } else { 0 });
                let writes = writes
                    .into_iter()
                    .map(|address| RegisterWrite::new(address, 1));
                return GoOrder::new(writes.collect(), frequency, (rest > 7).then_some(direction))
                    .map(Order::Go);
            }
        })
    }

    fn ticket(&mut self) -> Ticket {
        self.tickets += 1;
        Ticket(self.tickets)
    }

    /// Lets time pass from wake-up to wake-up.
    fn pass(&mut self, time: Duration) {
        let until = self.now + time;
        self.decide();
        while let Some(wake) = self.core.next_wake().filter(|wake| wake.at <= until) {
            assert!(
                wake.at > self.now,
                "woken for ever: {wake:?} at {:?}",
                self.now
            );
            self.now = wake.at;
            self.decide();
        }
        self.now = until;
        self.decide();
    }

    fn decide(&mut self) {
        self.input(LineInput::Time);
        let mut effects = 0;
        let mut frames = 0;
        while let Some(effect) = self.core.next_effect() {
            effects += 1;
            assert!(effects < EFFECTS_MAX, "no end of effects");
            match effect {
                LineEffect::Transmit(frame) => {
                    frames += 1;
                    self.sent(frame);
                    self.core.transmitted(self.now);
                }
                LineEffect::Answer(answer) => {
                    let of = (answer.ticket, answer.asker);
                    assert!(
                        self.reads.remove(&of) || self.writes.remove(&of),
                        "twice, or to no client: {answer:?}"
                    );
                }
                LineEffect::Command(answer) => {
                    assert!(
                        self.commands.contains(&answer.ticket),
                        "a word after the last: {answer:?}"
                    );
                    if answer.is_final {
                        self.commands.remove(&answer.ticket);
                    }
                }
                LineEffect::Trip(..)
                | LineEffect::Note(..)
                | LineEffect::LineNote(_)
                | LineEffect::Presence(..)
                | LineEffect::Reopen(_)
                | LineEffect::Keep(_)
                | LineEffect::Traffic(_) => {}
            }
        }
        assert!(frames <= 1, "{frames} exchanges at once");
    }

    /// Every request and every command ends.
    fn end(&mut self) {
        self.pass(PATIENCE);
        assert!(self.reads.is_empty(), "without an answer: {:?}", self.reads);
        let until = self.now + ALL_HAS_ENDED;
        while self.now < until && !(self.commands.is_empty() && self.writes.is_empty()) {
            self.pass(LOOK);
        }
        assert!(
            self.commands.is_empty(),
            "without a last word: {:?}",
            self.commands
        );
        assert!(
            self.writes.is_empty(),
            "without an answer: {:?}",
            self.writes
        );
    }

    fn sent(&mut self, frame: Vec<u8>) {
        let quiet_for = self.now.since(self.quiet_since);
        let (station, pdu) =
            framing::decode(self.framing, &frame).expect("only sound frames are sent");
        let is_jammed = self.core.report().fault == Some(LineFault::Jammed);
        // On a jammed line a stop is sent over any talker, and nothing else is.
        if is_jammed && self.core.report().state == LineState::Down {
            assert_ne!(
                pdu[0],
                function::READ_HOLDING,
                "{frame:02X?} on a jammed line"
            );
        } else {
            assert!(
                self.now >= self.quiet_since && quiet_for >= self.silence,
                "{frame:02X?} after {quiet_for:?}"
            );
        }
        assert!(self.core.is_occupied(), "sent, and the wire is free");
        let reason = self.core.next_wake().map(|wake| wake.reason);
        let waits = matches!(
            reason,
            Some(WakeReason::ReplyDue | WakeReason::RequestDeadline)
        );
        // Work of a drive under control may be due earlier.
        assert!(
            waits || self.has_control,
            "no client waits for the reply: {reason:?}"
        );
        assert!(
            (1..=DRIVES).contains(&station) || to_all(&self.model) == Some(station),
            "station {station}"
        );
        self.check_run(&pdu);
        self.quiet_since = self.now + self.link.bytes(frame.len());
        self.last_frame = frame;
    }

    /// No RUN is sent more often than it was ordered.
    fn check_run(&mut self, pdu: &[u8]) {
        let (Some(run), Some(register)) = (
            &self.model.run,
            self.model.register_for(RegisterRole::RunCommand),
        ) else {
            return;
        };
        let (address, values) = match Request::decode(pdu) {
            Some(Request::WriteSingle { address, value }) => (address, vec![value]),
            Some(Request::WriteMultiple { address, values }) => (address, values),
            _ => return,
        };
        let Some(word) = register.address.word_in(address, &values) else {
            return;
        };
        let runs = [Some(&run.forward), run.reverse.as_ref()];
        if runs.iter().flatten().any(|fact| fact.value == word) {
            assert!(self.runs_ordered > 0, "nobody ordered {pdu:02X?}");
            self.runs_ordered -= 1;
        }
    }
}

/// The broadcast station for stops, if this model has one.
fn to_all(model: &Model) -> Option<u8> {
    model
        .link
        .broadcast
        .as_ref()
        .map(|broadcast| broadcast.station.value)
}

fn origin(who: u8) -> Origin {
    let rights = Rights {
        write: who & 4 == 0,
        stop: who & 8 == 0,
    };
    match who >> 4 & 3 {
        0 => Origin {
            owner: Owner::Mqtt,
            rights,
            manner: OrderManner::Once,
        },
        1 => Origin {
            owner: Owner::Local,
            rights,
            manner: OrderManner::Once,
        },
        last => Origin {
            owner: Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::new(10, 0, 0, last))),
            rights,
            manner: OrderManner::Cyclic,
        },
    }
}
