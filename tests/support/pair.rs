//! Gateways that share one line with simulated drives, under one virtual clock: each hears every byte of the others.

use super::noise::Jam;
use super::{ORIGIN, RigOptions};
use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{CommandAnswer, CommandRequest, Order, Origin, Outcome, Reason};
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Station, Ticket};
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::{NativeAnswer, NativeAsk, NativeRequest};
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::domain::standby::LineRole;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::view::{DriveView, TripEvent};
use vfd_gateway::gateway::{DriveNote, LineCore, LineEffect, LineInput, LineNote, LineSetup};
use vfd_gateway::journal::{EntryToKeep, RememberedDrive, RememberedLease};
use vfd_gateway::line::standby::StandbyTimes;
use vfd_gateway::line::timing::LineTiming;
use vfd_gateway::sim::{BusOptions, DriveOptions, FaultPlan, SimBus, SimDrive};
use vfd_gateway::wire::framing;
use vfd_gateway::wire::signal::{STATION, Signal};

/// In the place of a half: a master that is no gateway of the pair.
const FOREIGN: usize = usize::MAX;
/// Most bytes that the system keeps for a process that is suspended.
const KEPT_BYTES: usize = 65_536;

/// One gateway.
pub struct Half {
    /// `None`: it is not running.
    pub core: Option<LineCore>,
    pub setup: LineSetup,
    pub is_open: bool,
    /// Suspended: bytes wait in the system.
    pub is_suspended: bool,
    waiting: Vec<u8>,
    /// It is suspended as soon as its next frame has passed the check, before the frame is handed to the port.
    pub stalls_at_port: bool,
    held: Option<Vec<u8>>,
    /// It receives its own bytes.
    pub echoes: bool,
    /// Its adapter delivers each frame in two pieces, this long apart.
    pub hole: Duration,
    /// Thousandths of the frames of others that it does not hear.
    pub loses_per_mille: u64,
    /// Its receiver is dead.
    pub is_deaf: bool,
    /// Its transmitter is dead: what it sends reaches nothing.
    pub is_mute: bool,
    /// Its port has another speed than the line: it hears garbage, and is garbage to all others.
    pub is_off_speed: bool,
    /// Thousandths of the bytes of others that it hears wrongly.
    pub mishears_per_mille: u64,
    /// Thousandths of its own bytes that all others hear wrongly.
    pub misspeaks_per_mille: u64,
    /// What its journal remembers of each drive; `None`: it has no journal.
    pub memory: Option<Vec<RememberedDrive>>,
    /// How much faster its clock runs, in millionths.
    pub drift_ppm: i64,
    pub reports: Vec<(MonoTime, CommandAnswer)>,
    pub answers: Vec<NativeAnswer>,
    pub notes: Vec<(MonoTime, DriveNote)>,
    pub line_notes: Vec<(MonoTime, LineNote)>,
    pub trips: Vec<TripEvent>,
    pub kept: Vec<EntryToKeep>,
}

/// A frame of a gateway, as an observer on the line sees it.
#[derive(Clone, Debug)]
pub struct Sent {
    pub at: MonoTime,
    pub end: MonoTime,
    pub half: usize,
    pub pdu: Vec<u8>,
    /// Another transmission ran into it.
    pub is_damaged: bool,
    /// It has not left its adapter.
    pub is_lost: bool,
}

impl Half {
    /// Takes a row for its journal, which is durable at once.
    fn keep(&mut self, now: MonoTime, keep: EntryToKeep) {
        if let Some(memory) = &mut self.memory {
            memory[keep.drive.get()].take(&keep.entry);
            self.core
                .iter_mut()
                .for_each(|core| core.handle(now, LineInput::Kept(keep.row)));
        }
        self.kept.push(keep);
    }
}

impl Sent {
    /// Whether it is the answer of a gateway that only listens, to the question whether one does.
    pub fn is_of_listener(&self) -> bool {
        Signal::decode(STATION, &self.pdu).is_some_and(|signal| signal.kind.is_of_listener())
    }
}

/// A frame whose last character is not out yet.
struct OnWire {
    half: usize,
    place: usize,
    end: MonoTime,
    frame: Vec<u8>,
    is_damaged: bool,
}

pub struct Pair {
    pub halves: Vec<Half>,
    pub bus: SimBus,
    pub now: MonoTime,
    pub sent: Vec<Sent>,
    /// Keep every frame in `sent`, not just the newest ones.
    pub keeps_sent: bool,
    on_wire: Vec<OnWire>,
    /// Pieces that adapters still hold back.
    held_back: Vec<(MonoTime, usize, Vec<u8>)>,
    /// The pair of wires is cut: the first half reaches the drives, the others reach nothing.
    pub is_cut: bool,
    /// The drives have lost the pair of wires: they hear nothing and are not heard.
    pub drives_are_cut: bool,
    /// What babbles on the line.
    pub jam: Option<Jam>,
    timing: LineTiming,
    random: u64,
    last_ticket: u64,
    asked: HashSet<u64>,
}

impl Pair {
    /// Gateways of ranks 0, 1, ..., none of them running, with the drives of `options`.
    pub fn new(count: usize, options: &RigOptions) -> Self {
        let model = &Arc::new(options.model.on(options.bus.framing));
        let mut bus = SimBus::new(
            options.link,
            BusOptions {
                faults: FaultPlan::NONE,
                ..options.bus
            },
            options.seed,
        );
        let mut drives = Vec::new();
        for station in 1..=options.drives {
            bus.connect(
                Station(station),
                SimDrive::new(Arc::clone(model), DriveOptions::default()),
            );
            drives.push(options.drive(station, model));
        }
        let timing = LineTiming::for_models(
            options.bus.framing,
            options.link,
            [model.as_ref()],
            Duration::ZERO,
        );
        let shortest =
            StandbyTimes::shortest(&timing, options.reply_timeout + Duration::from_millis(100));
        let half = |rank: u8| Half {
            core: None,
            setup: LineSetup {
                timing,
                drives: drives.clone(),
                echo: options.echo,
                tells_traffic: false,
                first_epoch: 1 + u64::from(rank) * 1_000_000,
                asked_before: false,
                joins_late: false,
                keeps: options.keeps,
                standby: Some(shortest.with(None, rank)),
            },
            is_open: false,
            is_suspended: false,
            waiting: Vec::new(),
            stalls_at_port: false,
            held: None,
            echoes: false,
            hole: Duration::ZERO,
            loses_per_mille: 0,
            is_deaf: false,
            is_mute: false,
            is_off_speed: false,
            mishears_per_mille: 0,
            misspeaks_per_mille: 0,
            memory: None,
            drift_ppm: 0,
            reports: Vec::new(),
            answers: Vec::new(),
            notes: Vec::new(),
            line_notes: Vec::new(),
            trips: Vec::new(),
            kept: Vec::new(),
        };
        Self {
            halves: (0..).take(count).map(half).collect(),
            bus,
            now: MonoTime::from_millis(1000),
            sent: Vec::new(),
            keeps_sent: true,
            on_wire: Vec::new(),
            held_back: Vec::new(),
            is_cut: false,
            drives_are_cut: false,
            jam: None,
            timing,
            random: options.seed,
            last_ticket: 0,
            asked: HashSet::new(),
        }
    }

    /// The first of two is active, the second listens.
    pub fn running(options: &RigOptions) -> Self {
        let mut pair = Self::new(2, options);
        pair.start(0);
        pair.start(1);
        pair.pass(Duration::from_secs(10));
        assert_eq!(
            [pair.role(0), pair.role(1)],
            [LineRole::Active, LineRole::Listening]
        );
        pair
    }

    /// The clock of `half`.
    fn clock(&self, half: usize) -> MonoTime {
        local(self.now, self.halves[half].drift_ppm)
    }

    /// Starts the gateway, which knows nothing, and opens its port.
    pub fn start(&mut self, half: usize) {
        let now = self.clock(half);
        let it = &mut self.halves[half];
        it.setup.first_epoch += 1000;
        it.core = Some(LineCore::new(it.setup.clone(), now));
        it.is_suspended = false;
        it.held = None;
        self.open(half);
    }

    /// Starts the gateway again after a [kill](Self::kill). What its journal has of the drives is remembered if it has one.
    pub fn start_again(&mut self, half: usize) {
        let it = &mut self.halves[half];
        it.setup.asked_before = true;
        for (place, drive) in it.setup.drives.iter_mut().enumerate() {
            drive.remembered = it
                .memory
                .as_ref()
                .map_or_else(RememberedDrive::default, |memory| memory[place]);
        }
        // An owner gets its time once.
        for remembered in it.memory.iter_mut().flatten() {
            remembered.lease = remembered.lease.map(|lease| RememberedLease {
                was_orphaned: true,
                ..lease
            });
        }
        self.start(half);
    }

    /// Kills the gateway.
    pub fn kill(&mut self, half: usize) {
        let it = &mut self.halves[half];
        it.core = None;
        it.is_open = false;
        it.held = None;
        it.waiting.clear();
    }

    /// Opens its port.
    pub fn open(&mut self, half: usize) {
        let now = self.clock(half);
        let it = &mut self.halves[half];
        it.waiting.clear();
        let Some(core) = &mut it.core else { return };
        it.is_open = true;
        core.handle(now, LineInput::PortUp(PortKind::Serial));
        self.settle(half);
    }

    /// Unplugs its port.
    pub fn unplug(&mut self, half: usize) {
        let now = self.clock(half);
        let it = &mut self.halves[half];
        it.is_open = false;
        it.waiting.clear();
        it.held = None;
        if let Some(core) = &mut it.core {
            core.handle(now, LineInput::PortDown(LineFault::Gone));
            self.settle(half);
        }
    }

    /// Lets it run again. What was received meanwhile waits in the system.
    pub fn resume(&mut self, half: usize) {
        let now = self.clock(half);
        let it = &mut self.halves[half];
        it.is_suspended = false;
        let waiting = std::mem::take(&mut it.waiting);
        let held = it.held.take();
        if let Some(frame) = held {
            self.puts_out(half, frame);
            self.after_writing(half);
        }
        if let Some(core) = self.halves[half]
            .core
            .as_mut()
            .filter(|_| !waiting.is_empty())
        {
            core.handle(now, LineInput::Bytes(&waiting));
        }
        self.settle(half);
    }

    /// What it does on the line.
    pub fn role(&self, half: usize) -> LineRole {
        let report = self.halves[half]
            .core
            .as_ref()
            .and_then(|core| core.report().standby);
        report.map_or(LineRole::Listening, |report| report.role)
    }

    pub fn core(&mut self, half: usize) -> &mut LineCore {
        self.halves[half].core.as_mut().expect("it runs")
    }

    /// Its view of the drive at `index`.
    pub fn view(&self, half: usize, index: u16) -> DriveView {
        self.halves[half]
            .core
            .as_ref()
            .and_then(|core| core.view(DriveIndex(index)))
            .expect("it runs")
    }

    /// Commands a drive through `half`.
    pub fn command(&mut self, half: usize, origin: Origin, index: u16, order: Order) -> Ticket {
        self.last_ticket += 1;
        let ticket = Ticket(self.last_ticket);
        let now = self.clock(half);
        let command = CommandRequest {
            asker: AskerId::MQTT,
            ticket,
            drive: DriveIndex(index),
            origin,
            order,
            start_before: now + Duration::from_secs(1),
            issued: None,
            epoch: None,
            trial: None,
        };
        if let Some(core) = &mut self.halves[half].core {
            core.handle(now, LineInput::Command(command));
        }
        if !self.halves[half].is_suspended {
            self.settle(half);
        }
        ticket
    }

    /// Reads registers of a drive through `half`.
    pub fn read(&mut self, half: usize, index: u16, address: u16, count: u16) -> Ticket {
        self.last_ticket += 1;
        let ticket = Ticket(self.last_ticket);
        self.asked.insert(ticket.0);
        let now = self.clock(half);
        let ask = NativeAsk::Read {
            address: address.into(),
            count,
        };
        let deadline = now + Duration::from_secs(5);
        let request = NativeRequest {
            asker: AskerId(1),
            ticket,
            drive: DriveIndex(index),
            origin: ORIGIN,
            ask,
            deadline,
        };
        self.core(half).handle(now, LineInput::Native(request));
        self.settle(half);
        ticket
    }

    /// Writes one register of a drive through `half`.
    pub fn write(&mut self, half: usize, index: u16, address: Address, value: u16) -> Ticket {
        self.last_ticket += 1;
        let ticket = Ticket(self.last_ticket);
        let now = self.clock(half);
        let ask = NativeAsk::Write {
            address,
            values: vec![value],
        };
        let deadline = now + Duration::from_secs(1);
        let request = NativeRequest {
            asker: AskerId(1),
            ticket,
            drive: DriveIndex(index),
            origin: ORIGIN,
            ask,
            deadline,
        };
        self.core(half).handle(now, LineInput::Native(request));
        self.settle(half);
        ticket
    }

    /// The last report on a command so far.
    pub fn told(&self, half: usize, ticket: Ticket) -> Option<(Outcome, Reason)> {
        let mut of_ticket = self.halves[half]
            .reports
            .iter()
            .rev()
            .filter(|(_, answer)| answer.ticket == ticket);
        of_ticket
            .next()
            .map(|(_, answer)| (answer.report.outcome, answer.report.reason))
    }

    /// Passes `input` to `half`.
    pub fn tell(&mut self, half: usize, input: LineInput<'_>) {
        let now = self.clock(half);
        self.core(half).handle(now, input);
        self.settle(half);
    }

    /// The drive's true output frequency in hundredths of a hertz, negative in reverse.
    pub fn output(&mut self, station: u8) -> i64 {
        let now = self.now;
        self.bus
            .drive_mut(Station(station))
            .map_or(0, |drive| drive.output(now) / 10_000)
    }

    /// Lets `time` pass.
    pub fn pass(&mut self, time: Duration) {
        let until = self.now + time;
        while self.step(until) {}
    }

    /// Lets time pass until `found`, at most `limit`; returns how long it took.
    pub fn until(&mut self, limit: Duration, found: impl Fn(&Self) -> bool) -> Option<Duration> {
        let begin = self.now;
        let until = begin + limit;
        loop {
            if found(self) {
                return Some(self.now.since(begin));
            }
            if !self.step(until) {
                return None;
            }
        }
    }

    /// Jumps to the next event, at most to `until`. Returns whether there was an event before that.
    pub fn step(&mut self, until: MonoTime) -> bool {
        let mut next = self.bus.next_due().unwrap_or(MonoTime::NEVER);
        for half in self.halves.iter().filter(|half| !half.is_suspended) {
            let wake = half
                .core
                .as_ref()
                .and_then(LineCore::next_wake)
                .map(|wake| global(wake.at, half.drift_ppm));
            next = next.min(wake.unwrap_or(MonoTime::NEVER));
        }
        next = self
            .held_back
            .iter()
            .map(|(at, ..)| *at)
            .fold(next, MonoTime::min);
        next = self
            .on_wire
            .iter()
            .map(|it| it.end)
            .fold(next, MonoTime::min);
        next = self.jam.as_ref().map_or(next, |jam| next.min(jam.next_at));
        if next > until {
            self.now = until;
            return false;
        }
        self.now = self.now.max(next);
        while let Some(place) = self.held_back.iter().position(|(at, ..)| *at <= self.now) {
            let (_, half, rest) = self.held_back.remove(place);
            self.deliver(half, &rest);
        }
        self.babble();
        self.end_frames();
        self.take_replies();
        for half in 0..self.halves.len() {
            self.settle(half);
        }
        true
    }

    /// Frames of gateways whose last character is out reach the drives and the other gateways.
    fn end_frames(&mut self) {
        while let Some(place) = self.on_wire.iter().position(|it| it.end <= self.now) {
            let OnWire {
                half,
                place,
                mut frame,
                is_damaged,
                ..
            } = self.on_wire.swap_remove(place);
            if is_damaged {
                frame.iter_mut().for_each(|byte| *byte ^= 0x55);
            }
            if let Some(sent) = self.sent.get_mut(place).filter(|sent| sent.half == half) {
                sent.is_damaged = is_damaged;
            }
            if let Some(speaker) = self.halves.get(half) {
                let (is_off_speed, wrong) = (speaker.is_off_speed, speaker.misspeaks_per_mille);
                self.spoil(&mut frame, is_off_speed, wrong);
            }
            let is_reached = (!self.is_cut || half == 0) && !self.drives_are_cut;
            if is_reached {
                self.bus.receive(self.now, &frame);
            }
            for other in 0..self.halves.len() {
                let hears =
                    other != half && !self.is_cut || other == half && self.halves[half].echoes;
                if hears && !self.is_lost(other) {
                    let hole = self.halves[other].hole;
                    let (now, later) = frame.split_at(if hole.is_zero() {
                        frame.len()
                    } else {
                        frame.len() / 2
                    });
                    self.deliver(other, now);
                    if !later.is_empty() {
                        self.held_back
                            .push((self.now + hole, other, later.to_vec()));
                    }
                }
            }
        }
    }

    fn take_replies(&mut self) {
        let mut replies = Vec::new();
        self.bus
            .take_due(self.now, |_, bytes| replies.extend_from_slice(bytes));
        if replies.is_empty() || self.drives_are_cut {
            return;
        }
        if !self.on_wire.is_empty() || self.jam.as_ref().is_some_and(Jam::is_unbroken) {
            self.on_wire.iter_mut().for_each(|it| it.is_damaged = true);
            replies.iter_mut().for_each(|byte| *byte ^= 0x55);
        }
        for half in 0..self.halves.len() {
            if !self.is_cut || half == 0 {
                self.deliver(half, &replies);
            }
        }
    }

    fn deliver(&mut self, half: usize, bytes: &[u8]) {
        let now = self.clock(half);
        let it = &self.halves[half];
        if !it.is_open || it.is_deaf {
            return;
        }
        let (is_off_speed, wrong) = (it.is_off_speed, it.mishears_per_mille);
        let mut heard = bytes.to_vec();
        self.spoil(&mut heard, is_off_speed, wrong);
        let bytes = heard.as_slice();
        let it = &mut self.halves[half];
        // An adapter delivers in order.
        if let Some((_, _, held)) = self
            .held_back
            .iter_mut()
            .find(|(at, to, _)| *to == half && *at > self.now)
        {
            return held.extend_from_slice(bytes);
        }
        if it.is_suspended {
            let room = KEPT_BYTES.saturating_sub(it.waiting.len()).min(bytes.len());
            it.waiting.extend_from_slice(&bytes[..room]);
        } else if let Some(core) = &mut it.core {
            core.handle(now, LineInput::Bytes(bytes));
        }
    }

    /// Lets the core of `half` decide and executes its effects, unless it is suspended.
    fn settle(&mut self, half: usize) {
        let now = self.clock(half);
        if self.halves[half].is_suspended {
            return;
        }
        if let Some(core) = &mut self.halves[half].core {
            core.handle(now, LineInput::Time);
        }
        while let Some(effect) = self.halves[half]
            .core
            .as_mut()
            .and_then(LineCore::next_effect)
        {
            let it = &mut self.halves[half];
            match effect {
                LineEffect::Transmit(frame) => {
                    if !it.is_open || !it.core.as_mut().is_some_and(|core| core.may_transmit(now)) {
                        continue;
                    }
                    if std::mem::take(&mut it.stalls_at_port) {
                        it.is_suspended = true;
                        it.held = Some(frame);
                        return;
                    }
                    self.puts_out(half, frame);
                    self.after_writing(half);
                }
                LineEffect::Command(answer) => it.reports.push((self.now, answer)),
                LineEffect::Answer(answer) => it.answers.push(answer),
                LineEffect::Note(_, note) => it.notes.push((self.now, note)),
                LineEffect::LineNote(note) => it.line_notes.push((self.now, note)),
                LineEffect::Trip(_, event) => it.trips.push(event),
                LineEffect::Keep(keep) => it.keep(now, keep),
                LineEffect::Reopen(_) | LineEffect::Traffic(_) | LineEffect::Presence(..) => {}
            }
        }
    }

    fn after_writing(&mut self, half: usize) {
        let now = self.clock(half);
        if let Some(core) = &mut self.halves[half].core {
            core.transmitted(now);
        }
    }

    fn puts_out(&mut self, half: usize, frame: Vec<u8>) {
        let (_, pdu) =
            framing::decode(self.timing.framing, &frame).expect("only sound frames are sent");
        let end = self.now + self.timing.on_wire(frame.len());
        if !self.keeps_sent && self.sent.len() > 64 && self.on_wire.is_empty() {
            self.sent.drain(..32);
        }
        let is_lost = self.halves[half].is_mute;
        let is_damaged = !is_lost && self.meets_another();
        self.sent.push(Sent {
            at: self.now,
            end,
            half,
            pdu: pdu.into_owned(),
            is_damaged,
            is_lost,
        });
        if !is_lost {
            self.on_wire.push(OnWire {
                half,
                place: self.sent.len() - 1,
                end,
                frame,
                is_damaged,
            });
        }
    }

    /// A master that is no gateway of the pair sends `frame`.
    pub fn sends_foreign(&mut self, frame: Vec<u8>) {
        let end = self.now + self.timing.on_wire(frame.len());
        let is_damaged = self.meets_another();
        self.on_wire.push(OnWire {
            half: FOREIGN,
            place: FOREIGN,
            end,
            frame,
            is_damaged,
        });
    }

    /// A transmission begins. Returns whether another one is on the line, which is damaged by it.
    fn meets_another(&mut self) -> bool {
        let meets = !self.on_wire.is_empty() || self.jam.as_ref().is_some_and(Jam::is_unbroken);
        self.on_wire.iter_mut().for_each(|it| it.is_damaged = true);
        meets
    }

    /// Lets the jam babble up to now.
    fn babble(&mut self) {
        let Some(mut jam) = self.jam.take() else {
            return;
        };
        if jam.next_at <= self.now {
            let (count, random) = (jam.count(self.random_below(6)), self.random_below(u64::MAX));
            let bytes = random.to_be_bytes();
            jam.next_at = self.now + self.timing.on_wire(count) + jam.pause(random);
            self.on_wire.iter_mut().for_each(|it| it.is_damaged = true);
            (0..self.halves.len()).for_each(|half| self.deliver(half, &bytes[..count]));
        }
        self.jam = Some(jam).filter(|jam| jam.next_at < jam.until);
    }

    /// What becomes of `bytes` at another speed, and where `wrong` thousandths of them are heard wrongly.
    fn spoil(&mut self, bytes: &mut Vec<u8>, is_off_speed: bool, wrong: u64) {
        if is_off_speed {
            let count = bytes.len().div_ceil(2);
            *bytes = (0..count)
                .map(|_| u8::try_from(self.random_below(256)).unwrap_or_default())
                .collect();
        }
        if wrong > 0 {
            for byte in bytes {
                *byte ^= if self.random_below(1000) < wrong {
                    0x24
                } else {
                    0
                };
            }
        }
    }

    fn is_lost(&mut self, half: usize) -> bool {
        self.random_below(1000) < self.halves[half].loses_per_mille
    }

    /// A random number below `limit`.
    pub fn random_below(&mut self, limit: u64) -> u64 {
        self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.random ^ (self.random >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((mixed ^ (mixed >> 27)) >> 11) % limit
    }
}

/// The clock that runs faster by `drift_ppm`, when the true time is `now`.
fn local(now: MonoTime, drift_ppm: i64) -> MonoTime {
    MonoTime::from_nanos(scaled(now.as_nanos(), 1_000_000 + drift_ppm, 1_000_000))
}

/// The first true time at which that clock shows `at`.
fn global(at: MonoTime, drift_ppm: i64) -> MonoTime {
    if at == MonoTime::NEVER {
        return at;
    }
    MonoTime::from_nanos(
        scaled(at.as_nanos(), 1_000_000, 1_000_000 + drift_ppm) + u64::from(drift_ppm != 0),
    )
}

fn scaled(nanos: u64, times: i64, by: i64) -> u64 {
    u64::try_from(i128::from(nanos) * i128::from(times) / i128::from(by)).unwrap_or(u64::MAX)
}

/// `frame` with its CRC.
pub fn sealed(frame: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    vfd_gateway::wire::rtu::encode(&mut out, frame[0], |pdu| pdu.extend_from_slice(&frame[1..]));
    out
}
