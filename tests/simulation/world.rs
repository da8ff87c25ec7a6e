//! One world: a line with its gateway and drives, clients on the north sides, and one clock that jumps from event to
//! event. Everything that happens comes from one seed.

use super::checker::Checker;
use super::checker::Violation;
use super::client::Client;
use super::extras::Extras;
use super::journal::Journal;
use super::kills::Doom;
use super::mqtt::MqttSide;
use super::others::Others;
use super::plan::Plan;
use super::stalls::Stalls;
use super::tally::Tally;
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
use vfd_gateway::drive::view::{DriveView, TripEventKind};
use vfd_gateway::gateway::{LineCore, LineEffect, LineInput};
use vfd_gateway::north::modbus::UniformUnit;
use vfd_gateway::sim::{FaultPlan, SimBus};

/// Time for the shutdown of a gateway, and for its clients after it.
const ENDING: Duration = Duration::from_secs(6);
/// How long it takes until the drives are known and things begin to go wrong.
const CALM: Duration = Duration::from_secs(5);

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
    pub uniform: Vec<UniformUnit>,
    pub views: Vec<Arc<DriveView>>,
    pub mqtt: Option<MqttSide>,
    pub askers: u64,
    pub north_wake: Option<MonoTime>,
    /// When clients act next, and when the next fault happens.
    pub client_at: MonoTime,
    pub trouble_at: MonoTime,
    /// Faults that are to be undone, in order of time.
    pub repairs: Vec<(MonoTime, Trouble, u8)>,
    /// Whether clients command at present.
    pub may_write: bool,
    mood_until: MonoTime,
    pub is_port_up: bool,
    is_over: bool,
    pub tally: Tally,
    /// Clients that received their answer and send the next request at once.
    pub again: Vec<usize>,
    /// Clients that were refused and repeat the request in a moment.
    refused: Vec<usize>,
    /// The core wants the port reopened.
    to_reopen: Option<LineFault>,
    /// What outlives the gateway, if it has a journal.
    pub journal: Option<Journal>,
    pub doom: Option<Doom>,
    /// Other parties at the drives, and stalls of clients and of the gateway itself.
    pub others: Option<Others>,
    pub stalls: Option<Stalls>,
    /// What clients send now has waited for a suspended process.
    pub has_waited: bool,
}

impl World {
    /// The world of `seed`, with those of `extras` that it draws.
    pub fn new(seed: u64, extras: Extras) -> Self {
        let mut rng = Rng::with_seed(seed);
        let mut plan = Plan::draw(&mut rng);
        plan.extras = extras.drawn(&mut Rng::with_seed(!seed));
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
        let journal = plan
            .keeps
            .then(|| Journal::new(plan.line.drives.len(), rng.u64(..)));
        let mut world = Self {
            uniform: descriptions.iter().map(UniformUnit::new).collect(),
            views: descriptions
                .iter()
                .map(|_| Arc::new(DriveView::default()))
                .collect(),
            mqtt: None,
            clients: (0..plan.clients)
                .map(|who| Client::new(who, who as u64 + 1, now))
                .collect(),
            askers: plan.clients as u64,
            north_wake: None,
            client_at: now + CALM,
            trouble_at: now + CALM,
            repairs: Vec::new(),
            may_write: true,
            mood_until: now,
            is_port_up: false,
            is_over: false,
            tally: Tally {
                worlds: 1,
                ..Tally::default()
            },
            again: Vec::new(),
            refused: if plan.only_reads {
                (0..plan.clients).collect()
            } else {
                Vec::new()
            },
            to_reopen: None,
            journal,
            doom: None,
            others: None,
            stalls: None,
            has_waited: false,
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
        if !world.plan.extras.is_none() {
            let seed = world.rng.u64(..);
            world.others = Some(Others::new(seed, now + CALM));
            world.stalls = Some(Stalls::new(!seed, world.plan.extras, now + CALM));
        }
        world.open_port();
        world.decide();
        world
    }

    /// Runs `exchanges` exchanges, then shuts down the gateway. Returns the violation, if there was one.
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

    /// The gateway shuts down; faults stop.
    pub fn end(&mut self) {
        self.is_over = true;
        self.others_leave();
        self.stalls_end();
        if !self.is_port_up {
            self.open_port();
        }
        self.bus.set_faults(FaultPlan::NONE);
        self.checker.ending(self.now.as_nanos());
        self.core.handle(self.now, LineInput::Shutdown);
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

    /// Jumps to the next event, at most to `until`; returns false if there is none before that.
    pub fn step(&mut self, until: MonoTime) -> bool {
        let never = MonoTime::NEVER;
        let wake = self.core.next_wake().map_or(never, |wake| wake.at);
        let due = self.bus.next_due().unwrap_or(never);
        let north = self.north_wake.unwrap_or(never);
        let mqtt = self.mqtt.as_ref().map_or(never, |mqtt| mqtt.wake_at);
        let repair = self.repairs.first().map_or(never, |(at, ..)| *at);
        let world = if self.is_over {
            never
        } else {
            self.client_at.min(self.trouble_at)
        };
        let extra = if self.is_over {
            never
        } else {
            self.others_due().min(self.stalls_due())
        };
        let next = wake
            .min(due)
            .min(north)
            .min(world)
            .min(repair)
            .min(mqtt)
            .min(self.kept_due())
            .min(extra);
        if next > until {
            self.now = until;
            return false;
        }
        self.now = self.now.max(next);
        if due <= self.now {
            let core = &mut self.core;
            let checker = &mut self.checker;
            let is_up = self.is_port_up;
            self.bus.take_due(self.now, |at, bytes| {
                if is_up {
                    checker.heard(at.as_nanos(), bytes);
                    core.handle(at, LineInput::Bytes(bytes));
                }
            });
        }
        self.keep_due();
        if extra <= self.now {
            self.checker.time(self.now.as_nanos());
            self.others_act();
            self.stalls_act();
        }
        if north.min(world).min(repair).min(mqtt) <= self.now {
            self.happen();
        }
        self.decide();
        true
    }

    /// The actions of clients and faults that are due.
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

    /// Clients stop responding together now and then, so that leases expire.
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

    /// Lets the core decide and executes its effects. A client that reads without a pause sends the next request at the
    /// same moment.
    pub fn decide(&mut self) {
        loop {
            self.core.handle(self.now, LineInput::Time);
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

    fn carry_out(&mut self, effect: LineEffect) {
        match effect {
            LineEffect::Transmit(frame) => {
                self.bus.receive(self.now, &frame);
                self.core.transmitted(self.now);
                self.checker
                    .request(self.now.as_nanos(), &frame, self.bus.newest_reply());
                self.look_after(&frame);
            }
            LineEffect::Answer(answer) => {
                self.hear_native(&answer);
                self.mqtt_reads(&answer);
                if self.plan.only_reads && matches!(answer.outcome, NativeOutcome::Words(_)) {
                    self.again.extend(
                        self.clients
                            .iter()
                            .position(|client| client.asker == answer.asker),
                    );
                } else if self.plan.only_reads {
                    // A client takes a moment to repeat a refused request.
                    let again_at = self.now + Duration::from_millis(20);
                    self.refused.extend(
                        self.clients
                            .iter()
                            .position(|client| client.asker == answer.asker),
                    );
                    self.client_at = self.client_at.min(again_at);
                }
            }
            LineEffect::Command(answer) => {
                self.hear_command(&answer);
                self.mqtt_hears(&answer);
            }
            LineEffect::Trip(drive, event) => {
                if let TripEventKind::Tripped { trips, .. } = event.kind {
                    self.look_at_motor(drive.get(), self.now);
                    self.checker.trips_told(drive.get(), trips);
                }
                self.mqtt_trip(drive, &event);
            }
            // As a line's thread does: after all effects of this round.
            LineEffect::Reopen(fault) => self.to_reopen = Some(fault),
            LineEffect::Keep(keep) => self.keep(keep),
            LineEffect::Note(..)
            | LineEffect::LineNote(_)
            | LineEffect::Presence(..)
            | LineEffect::Traffic(_) => {}
        }
    }

    /// The observer reads the motors that `frame` was for, once it has been sent.
    fn look_after(&mut self, frame: &[u8]) {
        let at = self.now + Duration::from_nanos(self.plan.line.on_wire(frame.len()));
        for place in 0..self.plan.line.drives.len() {
            let station = self.plan.line.drives[place].station;
            if frame[0] == station || Some(frame[0]) == self.plan.line.broadcast() {
                self.look_at_motor(place, at);
            }
        }
    }

    /// The port is closed and opened again after the shortest wait.
    fn reopen_port(&mut self, fault: LineFault) {
        self.is_port_up = false;
        self.checker.port(self.now.as_nanos(), false);
        self.core.handle(self.now, LineInput::PortDown(fault));
        self.repair_in(Duration::from_millis(100), Trouble::PortDown, 0);
    }

    /// The port opens.
    pub fn open_port(&mut self) {
        self.is_port_up = true;
        self.checker.port(self.now.as_nanos(), true);
        self.core
            .handle(self.now, LineInput::PortUp(PortKind::Serial));
    }

    /// Takes the views that have changed.
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
