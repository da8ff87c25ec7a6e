//! One world: a line with its gateway and drives, clients on the north sides, and one clock that jumps from event to
//! event. Everything that happens comes from one seed.

use super::checker::Checker;
use super::checker::Violation;
use super::client::Client;
use super::journal::Journal;
use super::kills::Doom;
use super::mqtt::MqttSide;
use super::plan::Plan;
use super::trouble::Trouble;
use fastrand::Rng;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::description::DriveDescription;
use vfd_gateway::drive::view::DriveView;
use vfd_gateway::gateway::{Effect, Input, LineCore};
use vfd_gateway::north::modbus::Uniform;
use vfd_gateway::sim::{FaultPlan, SimBus};

/// How long a gateway that ends is given, and its clients after it.
const ENDING: Duration = Duration::from_secs(6);
/// How long it takes until the drives are known and things begin to go wrong.
const CALM: Duration = Duration::from_secs(5);

/// What has happened.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub worlds: u64,
    pub exchanges: u64,
    pub virtual_ns: u64,
    pub client_events: u64,
    pub clients_gone: u64,
    pub messages: u64,
    pub kills: u64,
    pub troubles: [u64; Trouble::COUNT],
    pub late: u64,
    pub lost: u64,
    pub collisions: u64,
    pub checked: super::checker::Counts,
    /// How much longer than asked for the shortest silence was, in ns.
    pub shortest_excess: u64,
}

/// One world.
pub struct World {
    pub plan: Plan,
    pub rng: Rng,
    pub core: LineCore,
    pub bus: SimBus,
    pub checker: Checker,
    pub now: MonoTime,
    pub clients: Vec<Client>,
    pub descriptions: Vec<DriveDescription>,
    pub uniform: Vec<Uniform>,
    pub views: Vec<Arc<DriveView>>,
    pub mqtt: Option<MqttSide>,
    pub askers: u64,
    pub north_wake: Option<MonoTime>,
    /// When clients do something next, and when there is trouble.
    pub client_at: MonoTime,
    pub trouble_at: MonoTime,
    /// What was done to the world and is to be taken back, in order of time.
    pub repairs: Vec<(MonoTime, Trouble, u8)>,
    /// Clients command at present.
    pub may_write: bool,
    mood_until: MonoTime,
    pub is_port_up: bool,
    is_over: bool,
    pub tally: Tally,
    /// Clients that got their answer and ask again at once.
    pub again: Vec<usize>,
    /// Clients that were refused and ask again in a moment.
    refused: Vec<usize>,
    /// The core wants the port opened anew.
    to_reopen: Option<LineFault>,
    /// What outlives the gateway, where it has a journal.
    pub journal: Option<Journal>,
    pub doom: Option<Doom>,
}

impl Tally {
    /// Adds what happened in another world.
    pub fn add(&mut self, other: &Self) {
        let (mine, its) = (&mut self.checked, &other.checked);
        for (to, from) in [
            (&mut self.worlds, other.worlds),
            (&mut self.exchanges, other.exchanges),
            (&mut self.virtual_ns, other.virtual_ns),
            (&mut self.client_events, other.client_events),
            (&mut self.clients_gone, other.clients_gone),
            (&mut self.messages, other.messages),
            (&mut self.kills, other.kills),
            (&mut self.late, other.late),
            (&mut self.lost, other.lost),
            (&mut self.collisions, other.collisions),
            (&mut mine.requests, its.requests),
            (&mut mine.answers, its.answers),
            (&mut mine.exceptions, its.exceptions),
            (&mut mine.words_checked, its.words_checked),
            (&mut mine.pictures, its.pictures),
            (&mut mine.writes, its.writes),
            (&mut mine.replies, its.replies),
            (&mut mine.mistakable, its.mistakable),
            (&mut mine.results, its.results),
        ] {
            *to += from;
        }
        self.troubles.iter_mut().zip(other.troubles).for_each(|(to, from)| *to += from);
        self.shortest_excess = self.shortest_excess.min(other.shortest_excess);
    }
}

impl World {
    /// The world of `seed`.
    pub fn new(seed: u64) -> Self {
        let mut rng = Rng::with_seed(seed);
        let plan = Plan::draw(&mut rng);
        Self::with(plan, rng)
    }

    /// The world of a plan.
    pub fn with(plan: Plan, mut rng: Rng) -> Self {
        let now = MonoTime::from_millis(1_000);
        let bus = plan.bus(&mut rng);
        let core = LineCore::new(plan.setup(rng.u64(1..1 << 40)), now);
        let descriptions = plan.descriptions();
        let mut checker = Checker::new(plan.line.clone(), plan.clients);
        checker.keeps = plan.keeps;
        let journal = plan.keeps.then(|| Journal::new(plan.line.drives.len(), rng.u64(..)));
        let mut world = Self {
            uniform: descriptions.iter().map(Uniform::new).collect(),
            views: descriptions.iter().map(|_| Arc::new(DriveView::default())).collect(),
            mqtt: None,
            clients: (0..plan.clients).map(|who| Client::new(who, who as u64 + 1, now)).collect(),
            askers: plan.clients as u64,
            north_wake: None,
            client_at: now + CALM,
            trouble_at: now + CALM,
            repairs: Vec::new(),
            may_write: true,
            mood_until: now,
            is_port_up: false,
            is_over: false,
            tally: Tally { worlds: 1, ..Tally::default() },
            again: Vec::new(),
            refused: if plan.only_reads { (0..plan.clients).collect() } else { Vec::new() },
            to_reopen: None,
            journal,
            doom: None,
            core,
            bus,
            checker,
            now,
            descriptions,
            rng,
            plan,
        };
        (0..world.clients.len()).for_each(|who| world.checker.client_opened(now.as_nanos(), who));
        if world.plan.has_mqtt {
            world.mqtt = Some(MqttSide::new(&world));
        }
        world.open_port();
        world.decide();
        world
    }

    /// Lets `exchanges` exchanges happen, then ends the gateway. What was seen that must not be, if anything.
    pub fn run(&mut self, exchanges: u64) -> Option<Violation> {
        let mut faults_on = self.now + CALM;
        while self.checker.wire.count() < exchanges {
            self.step(MonoTime::NEVER);
            if self.now >= faults_on {
                faults_on = MonoTime::NEVER;
                self.bus.set_faults(self.plan.faults);
            }
            if self.checker.violation().is_some() {
                break;
            }
        }
        self.end();
        self.checker.violation().cloned()
    }

    /// The gateway is told to end; what goes wrong stops.
    pub fn end(&mut self) {
        self.is_over = true;
        if !self.is_port_up {
            self.open_port();
        }
        self.bus.set_faults(FaultPlan::NONE);
        self.checker.ending(self.now.as_nanos());
        self.core.handle(self.now, Input::Shutdown);
        self.decide();
        let until = self.now + ENDING;
        while self.step(until) {}
        self.core.end_attempts(self.now);
        self.decide();
        self.checker.ended(self.now.as_nanos());
        self.tally.exchanges = self.checker.wire.count();
        self.tally.virtual_ns = self.now.as_nanos();
        self.tally.checked = self.checker.counts;
        self.tally.shortest_excess = self.checker.wire.shortest_excess;
        let report = self.bus.report();
        (self.tally.late, self.tally.lost, self.tally.collisions) =
            (report.replies_late, report.replies_lost, report.collisions);
    }

    /// Jumps to the next event, at most to `until`; false if that is where it ends.
    pub fn step(&mut self, until: MonoTime) -> bool {
        let never = MonoTime::NEVER;
        let wake = self.core.next_wake().map_or(never, |wake| wake.at);
        let due = self.bus.next_due().unwrap_or(never);
        let north = self.north_wake.unwrap_or(never);
        let mqtt = self.mqtt.as_ref().map_or(never, |mqtt| mqtt.wake_at);
        let repair = self.repairs.first().map_or(never, |(at, ..)| *at);
        let world = if self.is_over { never } else { self.client_at.min(self.trouble_at) };
        let next = wake.min(due).min(north).min(world).min(repair).min(mqtt).min(self.kept_due());
        if next > until {
            self.now = until;
            return false;
        }
        self.now = self.now.max(next);
        if due <= self.now {
            let (core, checker, is_up) = (&mut self.core, &mut self.checker, self.is_port_up);
            self.bus.take_due(self.now, |at, bytes| {
                if is_up {
                    checker.heard(at.as_nanos(), bytes);
                    core.handle(at, Input::Bytes(bytes));
                }
            });
        }
        self.keep_due();
        if north.min(world).min(repair).min(mqtt) <= self.now {
            self.happen();
        }
        self.decide();
        true
    }

    /// What clients and troubles do now.
    fn happen(&mut self) {
        self.checker.time(self.now.as_nanos());
        if self.north_wake.is_some_and(|at| at <= self.now) {
            self.tick_clients();
        }
        while self.repairs.first().is_some_and(|(at, ..)| *at <= self.now) {
            let (_, trouble, which) = self.repairs.remove(0);
            self.repair(trouble, which);
        }
        if self.is_over {
            return self.mqtt_turn();
        }
        if self.client_at <= self.now {
            self.client_at = self.now + self.about(self.plan.ask_every);
            self.change_mood();
            if self.plan.only_reads {
                self.client_at = MonoTime::NEVER;
                let again = std::mem::take(&mut self.refused);
                again.into_iter().for_each(|who| self.client_reads(who));
            } else {
                self.client_acts();
            }
        }
        if self.trouble_at <= self.now {
            self.trouble_at = self.now + self.about(self.plan.trouble_every);
            self.make_trouble();
        }
        self.mqtt_turn();
    }

    /// Commanders fall silent together now and then, so that leases run out.
    fn change_mood(&mut self) {
        if self.now >= self.mood_until {
            self.may_write = !self.may_write;
            self.mood_until = self.now + Duration::from_millis(self.rng.u64(3_000..25_000));
        }
    }

    /// A random time with the mean `mean`.
    pub fn about(&mut self, mean: Duration) -> Duration {
        Duration::from_nanos(self.rng.u64(1..=2 * mean.as_nanos() as u64))
    }

    /// Lets the core decide and carries out what it says. Who reads without a pause asks again in the same moment.
    pub fn decide(&mut self) {
        loop {
            self.core.handle(self.now, Input::Time);
            while let Some(effect) = self.core.next_effect() {
                if self.is_killed() {
                    return self.kill();
                }
                self.carry_out(effect);
            }
            if self.dies() {
                return self.kill();
            }
            if let Some(fault) = self.to_reopen.take() {
                self.reopen_port(fault);
                continue;
            }
            if self.again.is_empty() || self.is_over {
                return;
            }
            while let Some(who) = self.again.pop() {
                self.client_reads(who);
            }
        }
    }

    fn carry_out(&mut self, effect: Effect) {
        match effect {
            Effect::Transmit(frame) => {
                self.bus.receive(self.now, &frame);
                self.checker.request(self.now.as_nanos(), &frame, self.bus.newest_reply());
            }
            Effect::Answer(answer) => {
                self.hear_native(&answer);
                self.mqtt_reads(&answer);
                if self.plan.only_reads && matches!(answer.outcome, NativeOutcome::Words(_)) {
                    self.again.extend(self.clients.iter().position(|client| client.asker == answer.asker));
                } else if self.plan.only_reads {
                    // A client takes a moment to ask again what was refused.
                    let again_at = self.now + Duration::from_millis(20);
                    self.refused.extend(self.clients.iter().position(|client| client.asker == answer.asker));
                    self.client_at = self.client_at.min(again_at);
                }
            }
            Effect::Command(answer) => {
                self.hear_command(&answer);
                self.mqtt_hears(&answer);
            }
            Effect::Trip(drive, event) => self.mqtt_trip(drive, &event),
            // As a line's thread does: once all that was said in this round is done.
            Effect::Reopen(fault) => self.to_reopen = Some(fault),
            Effect::Keep(keep) => self.keep(keep),
            Effect::Note(..) | Effect::LineNote(_) | Effect::Presence(..) | Effect::Traffic(_) => {}
        }
    }

    /// The port is closed and opened again after the shortest wait.
    fn reopen_port(&mut self, fault: LineFault) {
        self.is_port_up = false;
        self.checker.port(self.now.as_nanos(), false);
        self.core.handle(self.now, Input::PortDown(fault));
        self.repair_in(Duration::from_millis(100), Trouble::PortDown, 0);
    }

    /// The port opens.
    pub fn open_port(&mut self) {
        self.is_port_up = true;
        self.checker.port(self.now.as_nanos(), true);
        self.core.handle(self.now, Input::PortUp(PortKind::Serial));
    }

    /// Takes the pictures that have changed.
    pub fn look_at_views(&mut self) {
        for (drive, view) in self.core.changed_views() {
            self.views[drive.get()] = view;
        }
    }

    /// The station of the drive at `place`.
    pub fn station(&self, place: usize) -> Station {
        Station(self.plan.line.drives[place].station)
    }
}
