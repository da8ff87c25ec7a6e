//! What scenarios share: a rig of one line with simulated drives under a virtual clock, and configurations.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Manner, Origin, Owner, Rights};
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Station, Ticket};
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::domain::native::{NativeAnswer, NativeAsk, NativeOutcome, NativeRequest};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::domain::traffic::TrafficRecord;
use vfd_gateway::gateway::{DriveSetup, Effect, Input, LineCore, LineSetup};
use vfd_gateway::line::timing::Timing;
use vfd_gateway::profile::catalog::Catalog;
use vfd_gateway::profile::model::Model;
use vfd_gateway::sim::{BusOptions, DriveOptions, FaultPlan, SimBus, SimDrive};
use vfd_gateway::vendors;

/// Addresses whose words carry the number of the exchange that asked for them.
pub const PROOF: u16 = 0x3000;

/// A client on this machine that may do everything.
pub const ORIGIN: Origin = Origin {
    owner: Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::LOCALHOST)),
    rights: Rights { write: true, stop: true },
    manner: Manner::Cyclic,
};

/// The built-in N700.
pub fn n700() -> Arc<Model> {
    let catalog = Catalog::from_texts(vendors::texts().iter().copied()).expect("built-in models are sound");
    Arc::clone(catalog.find("hyundai-n700").expect("the model is built in"))
}

/// How a rig is set up.
pub struct RigOptions {
    /// Number of drives, at stations 1, 2, ...
    pub drives: u8,
    /// Speed and character format.
    pub link: LinkSettings,
    /// The simulated bus.
    pub bus: BusOptions,
    /// Period of the fast polls.
    pub poll: Duration,
    /// Reply time-out of every drive.
    pub reply_timeout: Duration,
    /// Seed of the faults.
    pub seed: u64,
    /// Keep what goes over the wire in `traffic`.
    pub tells_traffic: bool,
}

impl Default for RigOptions {
    fn default() -> Self {
        Self {
            drives: 1,
            link: LinkSettings::DEFAULT,
            bus: BusOptions::default(),
            // Out of the way unless a scenario asks for polls.
            poll: Duration::from_secs(3600),
            reply_timeout: Duration::from_millis(200),
            seed: 1,
            tells_traffic: false,
        }
    }
}

/// A frame of ours as an observer on the wire sees it.
#[derive(Clone, Debug)]
pub struct Sent {
    pub at: MonoTime,
    pub frame: Vec<u8>,
    /// The number that the words of its right reply carry.
    pub proof: u16,
}

/// One line, its simulated drives, and a clock that jumps from event to event.
pub struct Rig {
    pub core: LineCore,
    pub bus: SimBus,
    pub now: MonoTime,
    pub answers: Vec<(MonoTime, NativeAnswer)>,
    pub traffic: Vec<TrafficRecord>,
    pub sent: Vec<Sent>,
    /// Keep every frame in `sent`, not just the last one.
    pub keeps_sent: bool,
    last_ticket: u64,
    open: HashMap<u64, AskerId>,
}

impl Rig {
    pub fn new(options: &RigOptions) -> Self {
        let model = n700();
        let mut bus = SimBus::new(options.link, BusOptions { faults: FaultPlan::NONE, ..options.bus }, options.seed);
        let mut drives = Vec::new();
        for station in 1..=options.drives {
            let proof_words = Some(PROOF..=PROOF + 0xFF);
            let drive = DriveOptions { proof_words, ..DriveOptions::default() };
            bus.connect(Station(station), SimDrive::new(Arc::clone(&model), drive));
            drives.push(DriveSetup {
                station: Station(station),
                model: Arc::clone(&model),
                poll: options.poll,
                reply_timeout: options.reply_timeout,
                max_lateness: model.timing.max_lateness.value,
                control: None,
            });
        }
        let timing = Timing::for_models(options.link, [model.timing.gap_chars.value], Duration::ZERO);
        let now = MonoTime::from_millis(1);
        let mut core =
            LineCore::new(LineSetup { timing, drives, tells_traffic: options.tells_traffic, first_epoch: 1 }, now);
        core.handle(now, Input::PortUp);
        let mut rig = Self {
            core,
            bus,
            now,
            answers: Vec::new(),
            traffic: Vec::new(),
            sent: Vec::new(),
            keeps_sent: true,
            last_ticket: 0,
            open: HashMap::new(),
        };
        // The polls at the start are over before a scenario begins, and before anything goes wrong.
        rig.run_until(now + Duration::from_secs(10), |_, _| {});
        rig.sent.clear();
        rig.traffic.clear();
        rig.bus.set_faults(options.bus.faults);
        rig
    }

    /// Asks for `count` words from `address` of the drive at `index`, with 5 s of patience.
    pub fn read(&mut self, asker: u64, index: u16, address: u16, count: u16) -> Ticket {
        self.ask(asker, index, NativeAsk::Read { address, count })
    }

    pub fn ask(&mut self, asker: u64, index: u16, ask: NativeAsk) -> Ticket {
        self.last_ticket += 1;
        let ticket = Ticket(self.last_ticket);
        self.open.insert(ticket.0, AskerId(asker));
        let deadline = self.now + Duration::from_secs(5);
        let request =
            NativeRequest { asker: AskerId(asker), ticket, drive: DriveIndex(index), origin: ORIGIN, ask, deadline };
        self.core.handle(self.now, Input::Native(request));
        self.settle();
        ticket
    }

    /// Lets time pass until `until`; `on_answer` is told each answer and may ask anew.
    pub fn run_until(&mut self, until: MonoTime, mut on_answer: impl FnMut(&mut Self, &NativeAnswer)) {
        while self.now < until {
            for (_, answer) in std::mem::take(&mut self.answers) {
                on_answer(self, &answer);
            }
            // A client needs a moment to read an answer that came at once.
            let moment = self.now + Duration::from_micros(100);
            self.step(if self.answers.is_empty() { until } else { moment.min(until) });
        }
    }

    /// Lets time pass until the answer to `ticket` has come.
    pub fn answer_to(&mut self, ticket: Ticket) -> NativeOutcome {
        let limit = self.now + Duration::from_secs(20);
        loop {
            if let Some(at) = self.answers.iter().position(|(_, answer)| answer.ticket == ticket) {
                return self.answers.remove(at).1.outcome;
            }
            assert!(self.step(limit), "no answer to {ticket:?} within 20 s");
        }
    }

    /// Jumps to the next event, at most to `until`. Returns whether anything but the end came.
    pub fn step(&mut self, until: MonoTime) -> bool {
        let wake = self.core.next_wake().map_or(MonoTime::NEVER, |wake| wake.at);
        assert!(wake > self.now, "the core wants to be woken at once for ever: {:?}", self.core.next_wake());
        let due = self.bus.next_due().unwrap_or(MonoTime::NEVER);
        let next = wake.min(due);
        if next > until {
            self.now = until;
            return false;
        }
        self.now = self.now.max(next);
        let core = &mut self.core;
        self.bus.take_due(self.now, |at, bytes| core.handle(at, Input::Bytes(bytes)));
        self.settle();
        true
    }

    /// Lets the core decide and carries out what it says.
    pub fn settle(&mut self) {
        self.core.handle(self.now, Input::Time);
        while let Some(effect) = self.core.next_effect() {
            match effect {
                Effect::Transmit(frame) => self.transmit(frame),
                Effect::Answer(answer) => {
                    let asker = self.open.remove(&answer.ticket.0);
                    assert_eq!(asker, Some(answer.asker), "each request is answered once, to its asker");
                    self.answers.push((self.now, answer));
                }
                Effect::Traffic(record) => self.traffic.push(record),
                Effect::Presence(..) | Effect::Command(_) | Effect::Trip(..) | Effect::Note(..) => {}
            }
        }
    }

    /// The frames sent so far.
    pub fn frames(&self) -> Vec<&[u8]> {
        self.sent.iter().map(|sent| sent.frame.as_slice()).collect()
    }

    fn transmit(&mut self, frame: Vec<u8>) {
        if !self.keeps_sent {
            self.sent.clear();
        }
        let proof = (self.bus.exchange(Station(frame[0])) + 1) as u16;
        self.bus.receive(self.now, &frame);
        self.sent.push(Sent { at: self.now, frame, proof });
    }
}
