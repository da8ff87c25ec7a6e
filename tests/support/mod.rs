//! Shared by scenarios: a rig of one line with simulated drives under a virtual clock, and configurations.

pub mod families;
pub mod mixed;
pub mod noise;
pub mod pair;
pub mod sheet;

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use vfd_gateway::domain::command::{
    CommandAnswer, CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Outcome, Owner,
    Reason, Rights,
};
use vfd_gateway::domain::control::{ControlSettings, FailSafe};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Station, Ticket};
use vfd_gateway::domain::link::{EchoPolicy, Framing, LinkSettings, Parity, PortKind};
use vfd_gateway::domain::native::{NativeAnswer, NativeAsk, NativeOutcome, NativeRequest};
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::domain::traffic::TrafficRecord;
use vfd_gateway::drive::view::{DriveView, TripEvent};
use vfd_gateway::gateway::{
    DriveNote, DriveSetup, LineCore, LineEffect, LineInput, LineNote, LineSetup,
};
use vfd_gateway::journal::{EntryToKeep, JournalEntry, RememberedDrive};
use vfd_gateway::line::timeouts::ReplyTimeouts;
use vfd_gateway::line::timing::LineTiming;
use vfd_gateway::profile::catalog::Catalog;
use vfd_gateway::profile::model::{Confidence, Fact, Model};
use vfd_gateway::sim::{
    BadRequest, BusOptions, BusPacing, DriveOptions, FaultPlan, SimBus, SimDrive,
};
use vfd_gateway::vendors;
use vfd_gateway::wire::framing;

/// Addresses whose words carry the number of the exchange that asked for them.
pub const PROOF: u16 = 0x3000;

/// A client on this machine that may do everything.
pub const ORIGIN: Origin = Origin {
    owner: Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::LOCALHOST)),
    rights: Rights {
        write: true,
        stop: true,
    },
    manner: OrderManner::Cyclic,
};

/// A client that publishes to the command topics.
pub const MQTT: Origin = Origin {
    owner: Owner::Mqtt,
    rights: Rights {
        write: true,
        stop: true,
    },
    manner: OrderManner::Once,
};

/// Another client that writes registers, at 10.0.0.`last`.
pub fn plc(last: u8) -> Origin {
    Origin {
        owner: Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::new(10, 0, 0, last))),
        ..ORIGIN
    }
}

/// Run, with a setpoint in hundredths of a hertz if there is one.
pub fn run(direction: Direction, setpoint: Option<u16>) -> Order {
    go(setpoint, Some(direction))
}

/// A setpoint in hundredths of a hertz.
pub fn setpoint(centihertz: u16) -> Order {
    go(Some(centihertz), None)
}

fn go(setpoint: Option<u16>, direction: Option<Direction>) -> Order {
    Order::Go(
        GoOrder::new(Vec::new(), setpoint.map(Hertz::from_centihertz), direction)
            .expect("not empty"),
    )
}

pub const STOP: Order = Order::Stop { setpoint: None };

/// The built-in N700.
pub fn n700() -> Arc<Model> {
    model("hyundai-n700")
}

/// All built-in models, and those in the directory that `VFD_MODEL_DIR` names: whoever writes a model file plays it with
/// every scenario that is for all models.
pub fn catalog() -> Catalog {
    static CATALOG: LazyLock<Catalog> = LazyLock::new(|| {
        let own = std::env::var_os("VFD_MODEL_DIR");
        vendors::catalog()
            .with_texts(own.iter().flat_map(|dir| texts_in(Path::new(dir))))
            .expect("sound models")
    });
    CATALOG.clone()
}

/// Name and text of the model files in `dir`.
fn texts_in(dir: &Path) -> Vec<(String, String)> {
    let paths = std::fs::read_dir(dir)
        .expect("a directory")
        .map(|entry| entry.expect("an entry").path());
    let files = paths.filter(|path| path.extension().is_some_and(|it| it == "toml"));
    files
        .map(|path| {
            (
                path.display().to_string(),
                std::fs::read_to_string(&path).expect("a text"),
            )
        })
        .collect()
}

/// The built-in model called `id`.
pub fn model(id: &str) -> Arc<Model> {
    Arc::clone(catalog().find(id).expect("the model is built in"))
}

/// Most words that the model of [`on`] an ASCII line gives in one frame.
pub const ASCII_WORDS: u16 = 6;

/// The N700 on a line with `framing`, as if it had both.
pub fn on(framing: Framing) -> Arc<Model> {
    let mut model = Model::clone(&n700());
    model.link.framings.value = vec![Framing::Rtu, Framing::Ascii];
    model.link.data_bits.value = vec![7, 8];
    let source = "made up for tests".to_owned();
    model.read.max_words_ascii = Some(Fact {
        value: ASCII_WORDS,
        confidence: Confidence::Default,
        source,
    });
    Arc::new(model.on(framing))
}

/// How a rig is set up. The bus says which framing its line has.
pub struct RigOptions {
    /// Number of drives, at stations 1, 2, ...
    pub drives: u8,
    /// Speed and character format.
    pub link: LinkSettings,
    /// The simulated bus.
    pub bus: BusOptions,
    /// Period of the fast polls.
    pub poll: Duration,
    /// Reply time-out of every drive, or the longest one if it is learned.
    pub reply_timeout: Duration,
    /// Whether time-outs are shortened by what was seen.
    pub learns: bool,
    /// Seed of the faults.
    pub seed: u64,
    /// What the line does with an echo of its own bytes.
    pub echo: EchoPolicy,
    /// Whether the adapter receives its own bytes from the start.
    pub echoes: bool,
    /// Keep the traffic of the wire in `traffic`.
    pub tells_traffic: bool,
    /// What may be commanded of every drive.
    pub control: Option<ControlSettings>,
    /// There is a journal.
    pub keeps: bool,
    /// What every drive is.
    pub model: Arc<Model>,
    /// The actual model of every drive, if it differs.
    pub really: Option<Arc<Model>>,
    /// What every drive does with a request that it cannot serve.
    pub bad_request: BadRequest,
    /// Addresses whose words carry the number of the exchange that asked for them.
    pub proof_words: Option<RangeInclusive<u16>>,
}

/// Everything allowed from everywhere, 5 to 50 Hz, 3 s of lease, stops at the end.
pub fn control() -> ControlSettings {
    let limits = (Hertz::from_centihertz(500), Hertz::from_centihertz(5000));
    let lost = (FailSafe::Stop, Duration::from_secs(3));
    ControlSettings {
        from_mqtt: true,
        from_modbus_tcp: true,
        from_page: true,
        from_sparkplug: true,
        directions: vec![Direction::Forward, Direction::Reverse],
        native_write: vec![0x020C, 0x020E],
        ..ControlSettings::new(limits, lost, FailSafe::Stop)
    }
}

impl RigOptions {
    /// One drive under control, polled every 100 ms.
    pub fn controlled() -> Self {
        Self {
            control: Some(control()),
            poll: Duration::from_millis(100),
            ..Self::default()
        }
    }

    /// The same on an ASCII line of 9600 bit/s with 7 data bits and even parity.
    pub fn ascii(self) -> Self {
        let bus = BusOptions {
            framing: Framing::Ascii,
            ..self.bus
        };
        let link = LinkSettings {
            data_bits: 7,
            parity: Parity::Even,
            ..LinkSettings::DEFAULT
        };
        Self {
            bus,
            link,
            model: on(Framing::Ascii),
            ..self
        }
    }
}

impl RigOptions {
    /// A drive that is set up so, which is a `model`.
    fn drive(&self, station: u8, model: &Arc<Model>) -> DriveSetup {
        DriveSetup {
            station: Station(station),
            model: Arc::clone(model),
            poll: self.poll,
            timeouts: ReplyTimeouts {
                learns: self.learns,
                ..ReplyTimeouts::fixed(self.reply_timeout)
            },
            max_lateness: model.timing.max_lateness.value,
            control: self.control.clone().map(Arc::new),
            remembered: RememberedDrive::default(),
        }
    }

    /// The same over a Modbus TCP connection.
    pub fn modbus_tcp(self) -> Self {
        let bus = BusOptions {
            framing: Framing::Mbap,
            pacing: BusPacing::None,
            ..self.bus
        };
        Self { bus, ..self }
    }
}

/// A bus without character times is not a serial port.
fn port_kind(options: &RigOptions) -> PortKind {
    match options.bus.pacing {
        BusPacing::CharacterTimes => PortKind::Serial,
        BusPacing::None => PortKind::Virtual,
    }
}

impl Default for RigOptions {
    fn default() -> Self {
        Self {
            drives: 1,
            link: LinkSettings::DEFAULT,
            bus: BusOptions::default(),
            // No polls unless a scenario requests them.
            poll: Duration::from_secs(3600),
            reply_timeout: Duration::from_millis(200),
            learns: false,
            seed: 1,
            echo: EchoPolicy::Strip,
            echoes: false,
            tells_traffic: false,
            control: None,
            keeps: false,
            model: n700(),
            really: None,
            bad_request: BadRequest::default(),
            proof_words: Some(PROOF..=PROOF + 0xFF),
        }
    }
}

/// A frame of ours as an observer on the wire sees it.
#[derive(Clone, Debug)]
pub struct Sent {
    pub at: MonoTime,
    /// Its bytes on the wire.
    pub frame: Vec<u8>,
    pub pdu: Vec<u8>,
    /// The number that the words of its right reply carry.
    pub proof: u16,
}

/// One line, its simulated drives, and a clock that jumps from event to event.
pub struct Rig {
    pub core: LineCore,
    pub setup: LineSetup,
    pub bus: SimBus,
    pub now: MonoTime,
    pub answers: Vec<(MonoTime, NativeAnswer)>,
    pub traffic: Vec<TrafficRecord>,
    /// Reports to clients.
    pub reports: Vec<(MonoTime, CommandAnswer)>,
    /// Trips and their clearings.
    pub trips: Vec<(MonoTime, TripEvent)>,
    /// Notes about drives.
    pub notes: Vec<(MonoTime, DriveNote)>,
    /// Notes about the line.
    pub line_notes: Vec<(MonoTime, LineNote)>,
    /// When the core wanted the port reopened, and why.
    pub reopens: Vec<(MonoTime, LineFault)>,
    /// What the line wants kept.
    pub kept: Vec<EntryToKeep>,
    pub sent: Vec<Sent>,
    /// The proof numbers of the exchanges that gave the newest answers, by ticket.
    proofs: Vec<(Ticket, u16)>,
    /// Keep every frame in `sent`, not just the last one.
    pub keeps_sent: bool,
    /// The next reply to a request of this function is lost.
    pub loses_reply_to: Option<u8>,
    /// Frames with this PDU reach no drive.
    pub swallows: Option<Vec<u8>>,
    /// The port takes no frame.
    pub port_is_stuck: bool,
    framing: Framing,
    port_kind: PortKind,
    /// Sent bytes come back at once, as from an adapter that receives its own bytes.
    pub echoes: bool,
    last_ticket: u64,
    open: HashMap<u64, AskerId>,
}

impl Rig {
    pub fn new(options: &RigOptions) -> Self {
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
            let proof_words = options.proof_words.clone();
            let drive = DriveOptions {
                proof_words,
                bad_request: options.bad_request,
                ..DriveOptions::default()
            };
            let really = options.really.as_ref().unwrap_or(model);
            bus.connect(Station(station), SimDrive::new(Arc::clone(really), drive));
            drives.push(options.drive(station, model));
        }
        let timing = LineTiming::for_models(
            options.bus.framing,
            options.link,
            [model.as_ref()],
            Duration::ZERO,
        );
        let now = MonoTime::from_millis(1);
        let setup = LineSetup {
            timing,
            drives,
            echo: options.echo,
            tells_traffic: options.tells_traffic,
            first_epoch: 1,
            asked_before: false,
            joins_late: false,
            standby: None,
            keeps: options.keeps,
        };
        let mut core = LineCore::new(setup.clone(), now);
        core.handle(now, LineInput::PortUp(port_kind(options)));
        let mut rig = Self {
            core,
            setup,
            bus,
            now,
            answers: Vec::new(),
            traffic: Vec::new(),
            reports: Vec::new(),
            trips: Vec::new(),
            notes: Vec::new(),
            line_notes: Vec::new(),
            reopens: Vec::new(),
            kept: Vec::new(),
            sent: Vec::new(),
            proofs: Vec::new(),
            keeps_sent: true,
            loses_reply_to: None,
            swallows: None,
            port_is_stuck: false,
            framing: options.bus.framing,
            port_kind: port_kind(options),
            echoes: options.echoes,
            last_ticket: 0,
            open: HashMap::new(),
        };
        if !options.bus.framing.has_characters() {
            // No silence has to pass first.
            rig.settle();
        }
        // The polls at the start are over before a scenario begins, and before anything goes wrong.
        rig.run_until(now + Duration::from_secs(10), |_, _| {});
        rig.sent.clear();
        rig.traffic.clear();
        rig.bus.set_faults(options.bus.faults);
        rig
    }

    /// Reads `count` words from `address` of the drive at `index`, with a deadline of 5 s.
    pub fn read(&mut self, asker: u64, index: u16, address: u16, count: u16) -> Ticket {
        self.ask(
            asker,
            index,
            NativeAsk::Read {
                address: address.into(),
                count,
            },
        )
    }

    pub fn ask(&mut self, asker: u64, index: u16, ask: NativeAsk) -> Ticket {
        self.last_ticket += 1;
        let ticket = Ticket(self.last_ticket);
        self.open.insert(ticket.0, AskerId(asker));
        let deadline = self.now + Duration::from_secs(5);
        let request = NativeRequest {
            asker: AskerId(asker),
            ticket,
            drive: DriveIndex(index),
            origin: ORIGIN,
            ask,
            deadline,
        };
        self.core.handle(self.now, LineInput::Native(request));
        self.settle();
        ticket
    }

    /// Commands the drive at `index`; the first frame must be sent within a second.
    pub fn command(&mut self, origin: Origin, index: u16, order: Order) -> Ticket {
        self.command_with(origin, index, order, |_| {})
    }

    /// The same, modified by `change` before it is sent.
    pub fn command_with(
        &mut self,
        origin: Origin,
        index: u16,
        order: Order,
        change: impl FnOnce(&mut CommandRequest),
    ) -> Ticket {
        let ticket = self.give(origin, index, order, change);
        self.settle();
        ticket
    }

    /// Commands without letting the core decide yet: more may follow in the same round.
    pub fn command_unsettled(&mut self, origin: Origin, index: u16, order: Order) -> Ticket {
        self.give(origin, index, order, |_| {})
    }

    fn give(
        &mut self,
        origin: Origin,
        index: u16,
        order: Order,
        change: impl FnOnce(&mut CommandRequest),
    ) -> Ticket {
        self.last_ticket += 1;
        let ticket = Ticket(self.last_ticket);
        let mut command = CommandRequest {
            asker: AskerId::MQTT,
            ticket,
            drive: DriveIndex(index),
            origin,
            order,
            start_before: self.now + Duration::from_secs(1),
            issued: None,
            epoch: None,
            trial: None,
        };
        change(&mut command);
        self.core.handle(self.now, LineInput::Command(command));
        ticket
    }

    /// The reports on a command so far: outcome, reason, and whether it was final.
    pub fn told(&self, ticket: Ticket) -> Vec<(Outcome, Reason, bool)> {
        let of_ticket = self
            .reports
            .iter()
            .filter(|(_, answer)| answer.ticket == ticket);
        of_ticket
            .map(|(_, answer)| (answer.report.outcome, answer.report.reason, answer.is_final))
            .collect()
    }

    /// Lets time pass until a command has its final outcome, at most 20 s, and returns that.
    pub fn outcome_of(&mut self, ticket: Ticket) -> (Outcome, Reason) {
        let limit = self.now + Duration::from_secs(20);
        loop {
            if let Some((outcome, reason, true)) = self.told(ticket).last() {
                return (*outcome, *reason);
            }
            assert!(
                self.step(limit),
                "no outcome of {ticket:?} within 20 s: {:?}",
                self.told(ticket)
            );
        }
    }

    /// Commands and waits for the final outcome.
    pub fn commanded(&mut self, origin: Origin, order: Order) -> (Outcome, Reason) {
        let ticket = self.command(origin, 0, order);
        self.outcome_of(ticket)
    }

    /// Lets `time` pass while the MQTT side sends a heartbeat every second.
    pub fn live(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.core
                .handle(self.now, LineInput::PathAlive(Owner::Mqtt));
            self.run_until(end.min(self.now + Duration::from_secs(1)), |_, _| {});
        }
    }

    /// Unplugs the port and plugs it in again.
    pub fn reopen(&mut self) {
        self.close(LineFault::Gone);
        self.open();
    }

    /// Loses the port.
    pub fn close(&mut self, fault: LineFault) {
        self.core.handle(self.now, LineInput::PortDown(fault));
        if !self.framing.has_characters() {
            self.bus.hang_up(self.now);
        }
        self.settle();
    }

    /// Opens the port again.
    pub fn open(&mut self) {
        self.core
            .handle(self.now, LineInput::PortUp(self.port_kind));
        self.settle();
    }

    /// Kills the gateway and starts it again at once. It knows only `remembered` of each drive.
    pub fn restart(&mut self, remembered: RememberedDrive) {
        self.setup.first_epoch += 1_000;
        self.setup.asked_before = true;
        self.setup
            .drives
            .iter_mut()
            .for_each(|drive| drive.remembered = remembered);
        self.core = LineCore::new(self.setup.clone(), self.now);
        if !self.framing.has_characters() {
            self.bus.hang_up(self.now);
        }
        self.core
            .handle(self.now, LineInput::PortUp(self.port_kind));
        self.kept.clear();
        self.notes.clear();
        self.trips.clear();
        self.sent.clear();
        self.settle();
    }

    /// What the line wants kept, except changes of availability.
    pub fn entries(&self) -> Vec<&JournalEntry> {
        self.kept
            .iter()
            .map(|keep| &keep.entry)
            .filter(|it| !matches!(it, JournalEntry::Presence(_)))
            .collect()
    }

    /// Confirms that everything so far is kept.
    pub fn all_is_kept(&mut self) {
        if let Some(newest) = self.kept.last() {
            let row = newest.row;
            self.core.handle(self.now, LineInput::Kept(row));
            self.settle();
        }
    }

    /// Keeps the traffic of the wire in `traffic` from now on.
    pub fn tells_traffic(&mut self) {
        self.traffic.clear();
        self.core.tell_traffic(true);
    }

    /// Lets `time` pass.
    pub fn pass(&mut self, time: Duration) {
        self.run_until(self.now + time, |_, _| {});
    }

    /// The drive's true output frequency in hundredths of a hertz, negative in reverse.
    pub fn output(&mut self, station: u8) -> i64 {
        self.bus
            .drive_mut(Station(station))
            .map_or(0, |drive| drive.output(self.now) / 10_000)
    }

    /// The present view of the drive at `index`.
    pub fn view(&self, index: u16) -> DriveView {
        self.core
            .view(DriveIndex(index))
            .expect("there is such a drive")
    }

    /// The values that were written to `address`, oldest first.
    pub fn written(&self, address: u16) -> Vec<u16> {
        let place = address.to_be_bytes();
        let writes = self
            .sent
            .iter()
            .filter(|sent| sent.pdu[0] == 6 && sent.pdu[1..3] == place);
        writes
            .map(|sent| u16::from_be_bytes([sent.pdu[3], sent.pdu[4]]))
            .collect()
    }

    /// The PDUs of all writes so far.
    pub fn writes(&self) -> Vec<Vec<u8>> {
        let writes = self
            .sent
            .iter()
            .filter(|sent| matches!(sent.pdu.first(), Some(5 | 6 | 0x0F | 0x10)));
        writes.map(|sent| sent.pdu.clone()).collect()
    }

    /// Lets time pass until `until`; `on_answer` gets each answer and may send further requests.
    pub fn run_until(
        &mut self,
        until: MonoTime,
        mut on_answer: impl FnMut(&mut Self, &NativeAnswer),
    ) {
        while self.now < until {
            for (_, answer) in std::mem::take(&mut self.answers) {
                on_answer(self, &answer);
            }
            // A client needs a moment to read an answer that arrived at once.
            let moment = self.now + Duration::from_micros(100);
            self.step(if self.answers.is_empty() {
                until
            } else {
                moment.min(until)
            });
        }
    }

    /// Loses the reply to a read of one drive, and shows that another read of as many words is sent only after a
    /// barrier: an exchange whose answer cannot be confused with a late one.
    pub fn shows_that_a_missing_reply_is_waited_out(&mut self) {
        self.bus.set_faults(FaultPlan {
            lost: 1000,
            ..FaultPlan::NONE
        });
        let first = self.read(1, 0, PROOF, 1);
        // The reply to what is on the wire is lost already; nothing else will be.
        self.bus.set_faults(FaultPlan::NONE);
        let same_count = self.read(1, 0, 0x0201, 1);
        assert_eq!(self.answer_to(first), NativeOutcome::NoReply);
        assert!(matches!(
            self.answer_to(same_count),
            NativeOutcome::Words(_)
        ));
        // A barrier with another word count went in between; only its answer let the equal count through.
        let counts: Vec<u8> = self.sent.iter().map(|sent| sent.pdu[4]).collect();
        assert!(
            matches!(counts[..], [1, barrier, 1] if barrier != 1),
            "{counts:?}"
        );
        assert_eq!(self.core.counters().barriers, 1);
    }

    /// Lets time pass until the answer to `ticket` has arrived.
    pub fn answer_to(&mut self, ticket: Ticket) -> NativeOutcome {
        let limit = self.now + Duration::from_secs(20);
        loop {
            if let Some(at) = self
                .answers
                .iter()
                .position(|(_, answer)| answer.ticket == ticket)
            {
                return self.answers.remove(at).1.outcome;
            }
            assert!(self.step(limit), "no answer to {ticket:?} within 20 s");
        }
    }

    /// Jumps to the next event, at most to `until`. Returns whether there was an event before that.
    pub fn step(&mut self, until: MonoTime) -> bool {
        let wake = self
            .core
            .next_wake()
            .map_or(MonoTime::NEVER, |wake| wake.at);
        assert!(
            wake > self.now,
            "the core wants to be woken at once for ever: {:?}",
            self.core.next_wake()
        );
        let due = self.bus.next_due().unwrap_or(MonoTime::NEVER);
        let next = wake.min(due);
        if next > until {
            self.now = until;
            return false;
        }
        self.now = self.now.max(next);
        let core = &mut self.core;
        self.bus.take_due(self.now, |at, bytes| {
            core.handle(at, LineInput::Bytes(bytes))
        });
        self.settle();
        true
    }

    /// Lets the core decide and executes its effects.
    pub fn settle(&mut self) {
        self.core.handle(self.now, LineInput::Time);
        while let Some(effect) = self.core.next_effect() {
            match effect {
                LineEffect::Transmit(frame) => self.transmit(frame),
                LineEffect::Answer(answer) => {
                    let asker = self.open.remove(&answer.ticket.0);
                    assert_eq!(
                        asker,
                        Some(answer.asker),
                        "each request is answered once, to its asker"
                    );
                    let proof = self.sent.last().map_or(0, |sent| sent.proof);
                    if matches!(answer.outcome, NativeOutcome::Words(_)) {
                        self.proofs.push((answer.ticket, proof));
                    }
                    self.answers.push((self.now, answer));
                }
                LineEffect::Traffic(record) => self.traffic.push(record),
                LineEffect::Command(answer) => self.reports.push((self.now, answer)),
                LineEffect::Trip(_, event) => self.trips.push((self.now, event)),
                LineEffect::Note(_, note) => self.notes.push((self.now, note)),
                LineEffect::LineNote(note) => self.line_notes.push((self.now, note)),
                LineEffect::Reopen(fault) => self.reopens.push((self.now, fault)),
                LineEffect::Keep(keep) => self.kept.push(keep),
                LineEffect::Presence(..) => {}
            }
        }
    }

    /// The proof number of the exchange that answered `ticket`.
    pub fn proof(&mut self, ticket: Ticket) -> u16 {
        let place = self
            .proofs
            .iter()
            .position(|(known, _)| *known == ticket)
            .expect("it was answered");
        self.proofs.swap_remove(place).1
    }

    /// The frames sent so far.
    pub fn frames(&self) -> Vec<&[u8]> {
        self.sent.iter().map(|sent| sent.frame.as_slice()).collect()
    }

    fn transmit(&mut self, frame: Vec<u8>) {
        if self.port_is_stuck {
            return;
        }
        if !self.keeps_sent {
            self.sent.clear();
        }
        let (station, pdu) =
            framing::decode(self.framing, &frame).expect("only sound frames are sent");
        let pdu = pdu.into_owned();
        let proof = (self.bus.exchange(Station(station)) + 1) as u16;
        if self.loses_reply_to == Some(pdu[0]) {
            self.loses_reply_to = None;
            self.bus.set_faults("lost=1000".parse().expect("a plan"));
            self.bus.receive(self.now, &frame);
            self.bus.set_faults(FaultPlan::NONE);
        } else if self.swallows.as_ref() != Some(&pdu) {
            self.bus.receive(self.now, &frame);
        }
        self.core.transmitted(self.now);
        if self.echoes {
            self.core.handle(self.now, LineInput::Bytes(&frame));
        }
        self.sent.push(Sent {
            at: self.now,
            frame,
            pdu,
            proof,
        });
    }
}
