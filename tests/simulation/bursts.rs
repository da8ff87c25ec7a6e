//! Stray bytes in the shape of requests and replies, on lines of all built-in models: no read may be answered with the
//! words of another exchange. Also the cost of such bursts.

use super::plan::PROOF;
use fastrand::Rng;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{OrderManner, Origin, Owner, Rights};
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Station, Ticket};
use vfd_gateway::domain::link::{EchoPolicy, Framing, LinkSettings, PortKind};
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, NativeRequest};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{DriveSetup, LineCore, LineEffect, LineInput, LineSetup};
use vfd_gateway::journal::RememberedDrive;
use vfd_gateway::line::timeouts::ReplyTimeouts;
use vfd_gateway::line::timing::LineTiming;
use vfd_gateway::profile::model::Model;
use vfd_gateway::sim::{BusDelivery, BusOptions, DriveOptions, FaultPlan, SimBus, SimDrive};
use vfd_gateway::vendors;

/// How long a client waits before it repeats a read that was not answered with words.
const PAUSE: Duration = Duration::from_millis(20);
/// How long it takes until the drives are known and things begin to go wrong.
const CALM: Duration = Duration::from_secs(5);

/// The parameters of one line.
#[derive(Clone, Debug)]
pub struct BurstPlan {
    pub model: Arc<Model>,
    pub drives: u8,
    pub clients: u64,
    /// The adapter receives its own bytes: half duplex. Otherwise full duplex, or half duplex without an echo.
    pub echoes: bool,
    pub turnaround: Duration,
    /// Time-outs are learned.
    pub learns: bool,
    pub poll: Duration,
    pub faults: FaultPlan,
}

/// The events of one line, or of several, counted.
#[derive(Clone, Copy, Debug, Default)]
pub struct BurstTally {
    pub reads: u64,
    pub right: u64,
    pub bursts: u64,
    pub late: u64,
    /// Sound frames that answered nothing.
    pub strays: u64,
    pub requests: u64,
    pub virtual_ns: u64,
    /// The longest wait of a read for its words.
    pub longest: Duration,
}

impl BurstTally {
    /// Adds the counts of another line.
    pub fn add(&mut self, other: &Self) {
        self.reads += other.reads;
        self.right += other.right;
        self.bursts += other.bursts;
        self.late += other.late;
        self.strays += other.strays;
        self.requests += other.requests;
        self.virtual_ns += other.virtual_ns;
        self.longest = self.longest.max(other.longest);
    }

    /// Reads with words in a second.
    pub fn rate(&self) -> f64 {
        self.right as f64 / (self.virtual_ns as f64 / 1e9)
    }
}

/// The built-in models.
pub fn models() -> Vec<Arc<Model>> {
    let catalog = vendors::catalog();
    catalog
        .ids()
        .filter_map(|id| catalog.find(id))
        .cloned()
        .collect()
}

impl BurstPlan {
    /// The plan of a seed: each model with and without an echo in turn.
    pub fn draw(seed: u64) -> Self {
        let mut rng = Rng::with_seed(seed);
        let models = models();
        let count = models.len() as u64;
        let faults = FaultPlan {
            burst: rng.u16(10..400),
            ..FaultPlan::NONE
        };
        let late = if rng.bool() { rng.u16(0..200) } else { 0 };
        Self {
            model: Arc::clone(&models[(seed % count) as usize]),
            drives: rng.u8(1..=3),
            clients: rng.u64(2..6),
            echoes: (seed / count).is_multiple_of(2),
            turnaround: Duration::from_micros(rng.u64(500..30_000)),
            learns: rng.bool(),
            poll: Duration::from_millis(rng.u64(300..3_000)),
            faults: FaultPlan {
                late,
                lost: rng.u16(0..20),
                cut: rng.u16(0..20),
                ..faults
            },
        }
    }
}

/// One line whose clients read without a pause.
struct Walk {
    core: LineCore,
    bus: SimBus,
    rng: Rng,
    now: MonoTime,
    /// Most words of one read.
    most: u16,
    drives: u16,
    /// The proof number of the newest exchange.
    proof: u16,
    ticket: u64,
    asked: HashMap<u64, (u64, MonoTime)>,
    /// The clients with the next requests, and when.
    next: Vec<(MonoTime, u64)>,
    wrong: Option<String>,
    tally: BurstTally,
}

impl Walk {
    fn new(seed: u64, plan: &BurstPlan) -> Self {
        let mut rng = Rng::with_seed(seed ^ 0xB0B5);
        let link = LinkSettings {
            ..plan.model.link.played()
        };
        let options = BusOptions {
            turnaround: plan.turnaround,
            delivery: BusDelivery::Replies,
            ..BusOptions::default()
        };
        let mut bus = SimBus::new(link, options, rng.u64(..));
        bus.set_echoes(plan.echoes);
        let model = Arc::new(plan.model.on(Framing::Rtu));
        let stations = 1..=plan.drives;
        for station in stations.clone() {
            let options = DriveOptions {
                proof_words: Some(PROOF..=PROOF + 0xFF),
                ..DriveOptions::default()
            };
            bus.connect(Station(station), SimDrive::new(Arc::clone(&model), options));
        }
        let drive = |station| DriveSetup {
            station: Station(station),
            model: Arc::clone(&model),
            poll: plan.poll,
            timeouts: ReplyTimeouts {
                learns: plan.learns,
                ..ReplyTimeouts::fixed(Duration::from_millis(200))
            },
            max_lateness: model.timing.max_lateness.value,
            control: None,
            remembered: RememberedDrive::default(),
        };
        let setup = LineSetup {
            timing: LineTiming::for_models(Framing::Rtu, link, [model.as_ref()], Duration::ZERO),
            drives: stations.map(drive).collect(),
            echo: EchoPolicy::Strip,
            tells_traffic: false,
            first_epoch: rng.u64(1..1 << 40),
            asked_before: false,
            joins_late: false,
            standby: None,
            keeps: false,
        };
        let now = MonoTime::from_millis(1_000);
        let mut core = LineCore::new(setup, now);
        core.handle(now, LineInput::PortUp(PortKind::Serial));
        Self {
            core,
            bus,
            rng,
            now,
            most: model.read.max_words.value.min(8),
            drives: plan.drives.into(),
            proof: 0,
            ticket: 0,
            asked: HashMap::new(),
            next: (0..plan.clients)
                .map(|client| (now + CALM, client))
                .collect(),
            wrong: None,
            tally: BurstTally::default(),
        }
    }

    fn ask(&mut self, client: u64) {
        self.ticket += 1;
        self.asked.insert(self.ticket, (client, self.now));
        let rights = Rights {
            write: false,
            stop: false,
        };
        let request = NativeRequest {
            asker: AskerId(client + 1),
            ticket: Ticket(self.ticket),
            drive: DriveIndex(self.rng.u16(0..self.drives)),
            origin: Origin {
                owner: Owner::Local,
                rights,
                manner: OrderManner::Once,
            },
            ask: NativeAsk::Read {
                address: (PROOF + self.rng.u16(0..8)).into(),
                count: self.rng.u16(1..=self.most),
            },
            deadline: self.now + Duration::from_secs(5),
        };
        self.core.handle(self.now, LineInput::Native(request));
    }

    /// Jumps to the next event.
    fn step(&mut self) {
        let wake = self
            .core
            .next_wake()
            .map_or(MonoTime::NEVER, |wake| wake.at);
        let due = self.bus.next_due().unwrap_or(MonoTime::NEVER);
        let ask = self
            .next
            .iter()
            .map(|(at, _)| *at)
            .min()
            .unwrap_or(MonoTime::NEVER);
        self.now = self.now.max(wake.min(due).min(ask));
        let core = &mut self.core;
        self.bus.take_due(self.now, |at, bytes| {
            core.handle(at, LineInput::Bytes(bytes))
        });
        let now = self.now;
        let (due, later): (Vec<_>, Vec<_>) = self.next.drain(..).partition(|(at, _)| *at <= now);
        self.next = later;
        due.into_iter().for_each(|(_, client)| self.ask(client));
        self.settle();
    }

    fn settle(&mut self) {
        self.core.handle(self.now, LineInput::Time);
        while let Some(effect) = self.core.next_effect() {
            match effect {
                LineEffect::Transmit(frame) => {
                    self.proof = (self.bus.exchange(Station(frame[0])) + 1) as u16;
                    self.bus.receive(self.now, &frame);
                    self.core.transmitted(self.now);
                }
                LineEffect::Answer(answer) => self.answered(answer.ticket.0, &answer.outcome),
                LineEffect::Reopen(fault) => {
                    self.core.handle(self.now, LineInput::PortDown(fault));
                    self.core
                        .handle(self.now, LineInput::PortUp(PortKind::Serial));
                }
                _ => {}
            }
        }
    }

    fn answered(&mut self, ticket: u64, outcome: &NativeOutcome) {
        let (client, since) = self
            .asked
            .remove(&ticket)
            .expect("each request is answered once");
        self.tally.reads += 1;
        let NativeOutcome::Words(words) = outcome else {
            return self.next.push((self.now + PAUSE, client));
        };
        if words.iter().any(|word| *word != self.proof) {
            let proof = self.proof;
            let reads = self.tally.reads;
            self.wrong.get_or_insert_with(|| {
                format!("read {reads}: {words:04X?} in exchange {proof:04X}")
            });
        }
        self.tally.right += 1;
        self.tally.longest = self.tally.longest.max(self.now.since(since));
        // A client needs a moment to read an answer.
        self.next
            .push((self.now + Duration::from_micros(100), client));
    }
}

/// Lets clients read `reads` times on the line of `plan`.
///
/// # Errors
/// A read that was answered with the words of another exchange.
pub fn walk(seed: u64, plan: &BurstPlan, reads: u64) -> Result<BurstTally, String> {
    let mut walk = Walk::new(seed, plan);
    let calm_until = walk.now + CALM;
    while walk.now < calm_until {
        walk.step();
    }
    walk.bus.set_faults(plan.faults);
    while walk.tally.reads < reads && walk.wrong.is_none() {
        walk.step();
    }
    let report = walk.bus.report();
    let counters = walk.core.counters();
    let virtual_ns = walk.now.since(calm_until).as_nanos() as u64;
    let tally = BurstTally {
        bursts: report.bursts,
        late: report.replies_late,
        strays: counters.strays,
        requests: counters.requests,
        virtual_ns,
        ..walk.tally
    };
    match walk.wrong {
        None => Ok(tally),
        Some(text) => Err(format!(
            "seed {seed}: {text}\n{plan:?}\nagain: --what bursts --seed {seed} --shards 1"
        )),
    }
}

/// Lets clients read `reads` times on the line of `seed`.
///
/// # Errors
/// A read that was answered with the words of another exchange.
pub fn bursts(seed: u64, reads: u64) -> Result<BurstTally, String> {
    walk(seed, &BurstPlan::draw(seed), reads)
}

/// What bursts at one exchange in a hundred cost: for each model and both kinds of line the reads in a second without and
/// with them, and the longest wait with them.
///
/// # Errors
/// A read that was answered with the words of another exchange.
pub fn costs(reads: u64) -> Result<Vec<(String, f64, f64, Duration)>, String> {
    let mut rows = Vec::new();
    for model in models() {
        for echoes in [false, true] {
            let faults = FaultPlan {
                burst: 10,
                ..FaultPlan::NONE
            };
            let plan = BurstPlan {
                model: Arc::clone(&model),
                drives: 1,
                clients: 4,
                echoes,
                turnaround: Duration::from_millis(5),
                learns: true,
                poll: Duration::from_secs(1),
                faults,
            };
            let clean = walk(
                1,
                &BurstPlan {
                    faults: FaultPlan::NONE,
                    ..plan.clone()
                },
                reads,
            )?;
            let noisy = walk(1, &plan, reads)?;
            let name = format!(
                "{}, {}",
                model.id,
                if echoes { "with echo" } else { "without echo" }
            );
            rows.push((name, clean.rate(), noisy.rate(), noisy.longest));
        }
    }
    Ok(rows)
}
