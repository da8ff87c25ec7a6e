//! Plays a plan with one gateway or with a pair, and says what was seen of the drives and on the line.

use super::plan::{End, Form, Kind, Plan, Trouble};
use super::watch::Watch;
use crate::support::families::{accepting, options_of};
use crate::support::noise::Jam;
use crate::support::pair::{Pair, sealed};
use crate::support::{MQTT, ORIGIN, RigOptions, STOP, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Origin};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::standby::LineRole;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::line::standby::StandbyTimes;
use vfd_gateway::profile::model::OrderKind;
use vfd_gateway::sim::{FaultPlan, SimDrive};

const MS: fn(u64) -> Duration = Duration::from_millis;
const DRIVES: u8 = 2;
/// How often the client repeats its order, or its connection says that it is alive.
const CYCLE: Duration = Duration::from_millis(500);
/// How long a play goes on when the client has ended it and nothing temporary goes wrong any more.
const REST: Duration = Duration::from_secs(35);
/// Steps at one moment after which a gateway spins.
const STEPS_MAX: u32 = 10_000;
/// A drive that only the foreign master asks.
const FOREIGN_DRIVE: Station = Station(9);

/// What was seen.
#[derive(Debug)]
pub struct Seen {
    /// When each drive got its last order to stop; `None`: it runs at the end.
    pub stopped_at: Vec<Option<Duration>>,
    /// How often each drive was started.
    pub starts: Vec<usize>,
    /// Most frames in a row of one half while the other one had taken the line, but for single stops.
    pub doubled: usize,
    /// For how long each half had the line behind the order that ended it all, of `rest`.
    pub active: [Duration; 2],
    pub rest: Duration,
    /// From the end of what the client did, how much longer than one gateway a pair may need.
    pub bound: Duration,
    /// What was told and written when, and by which half.
    pub told: Vec<String>,
}

/// A play under way.
struct Play<'a> {
    plan: &'a Plan,
    pair: Pair,
    count: usize,
    /// The order to run.
    begin: MonoTime,
    ran: Vec<bool>,
    seen: Seen,
    watch: Watch,
    is_over: bool,
    foreign_at: MonoTime,
    /// When the client repeats its order next.
    repeats_at: MonoTime,
    looked_at: Duration,
}

/// Plays `plan` with `count` gateways. Faults of halves that are not there are left out.
pub fn play(plan: &Plan, count: usize) -> Seen {
    let mut play = Play::new(plan, count);
    play.starts_drives();
    play.goes_wrong();
    play.watch.look(&play.pair);
    play.seen.doubled = play.watch.longest();
    play.seen.told = play.told();
    play.seen
}

fn options(plan: &Plan) -> RigOptions {
    let settings = ControlSettings {
        on_gateway_lost: Some(plan.action),
        lost_after: plan.lost_after,
        ..accepting()
    };
    RigOptions {
        drives: DRIVES,
        seed: plan.seed,
        keeps: plan.remembers,
        ..options_of(&plan.model, settings)
    }
}

impl<'a> Play<'a> {
    fn new(plan: &'a Plan, count: usize) -> Self {
        let mut pair = Pair::new(count, &options(plan));
        pair.bus.connect(
            FOREIGN_DRIVE,
            SimDrive::new(std::sync::Arc::clone(&plan.model), Default::default()),
        );
        let bounds = pair.halves[0].setup.stop_bounds();
        let exchange = bounds.all_healthy.max(bounds.one_silent);
        let shortest = StandbyTimes::shortest(&pair.halves[0].setup.timing, exchange);
        for (rank, half) in (0..).zip(&mut pair.halves) {
            half.setup.standby = (count > 1).then(|| shortest.with(None, rank));
            half.memory = plan
                .remembers
                .then(|| vec![Default::default(); usize::from(DRIVES)]);
        }
        // Whoever takes the line over has waited for the longest of the ranks.
        let take_over = shortest.with(None, 1).worst_take_over();
        let first_stop = exchange + take_over + exchange;
        let bound =
            first_stop + bounds.each_further + StandbyTimes::waits_after_silence() + MS(200);
        for half in 0..count {
            if half == 0 || plan.listens_from.is_none() {
                pair.start(half);
            }
        }
        pair.pass(MS(12_000));
        let seen = Seen {
            stopped_at: vec![None; usize::from(DRIVES)],
            starts: vec![0; usize::from(DRIVES)],
            doubled: 0,
            active: [Duration::ZERO; 2],
            rest: Duration::ZERO,
            bound,
            told: Vec::new(),
        };
        let begin = pair.now;
        let watch = Watch::new(&plan.model);
        Self {
            plan,
            pair,
            count,
            begin,
            ran: vec![false; usize::from(DRIVES)],
            seen,
            watch,
            is_over: false,
            foreign_at: MonoTime::NEVER,
            repeats_at: begin,
            looked_at: Duration::ZERO,
        }
    }

    /// The client orders both drives to run, long before anything goes wrong.
    fn starts_drives(&mut self) {
        for index in 0..u16::from(DRIVES) {
            let origin = self.origin();
            match self.plan.form {
                Form::Once | Form::Cyclic => {
                    self.pair.command(0, origin, index, STOP);
                }
                Form::Native => {
                    self.pair.command(0, origin, index, STOP);
                    self.pair.pass(MS(300));
                    self.pair.command(0, origin, index, setpoint(3000));
                }
            }
        }
        // A single order to run is taken some time after the start of the gateway, or after a stop.
        self.pass(MS(6_000));
        self.begin = self.pair.now;
        self.orders_run(true);
        self.pass(MS(2_000));
        self.repeats_at = self.pair.now;
        assert_eq!(
            self.ran,
            vec![true; usize::from(DRIVES)],
            "seed {}: the drives run",
            self.plan.seed
        );
    }

    const fn origin(&self) -> Origin {
        match self.plan.form {
            Form::Once => MQTT,
            Form::Cyclic | Form::Native => ORIGIN,
        }
    }

    /// The client's order to run, given to each half that runs; `is_first` for the one that is not repeated.
    fn orders_run(&mut self, is_first: bool) {
        for half in 0..self.count {
            if self.pair.halves[half].core.is_none() || self.pair.halves[half].is_suspended {
                continue;
            }
            if self.plan.form == Form::Once {
                self.pair.tell(half, LineInput::PathAlive(MQTT.owner));
            }
            for index in 0..u16::from(DRIVES) {
                match self.plan.form {
                    Form::Once if !is_first => {}
                    Form::Once | Form::Cyclic => {
                        let origin = self.origin();
                        self.pair
                            .command(half, origin, index, run(Direction::Forward, Some(3000)));
                    }
                    Form::Native => self.writes(half, index, OrderKind::Forward),
                }
            }
        }
    }

    /// The client writes the word of an order.
    fn writes(&mut self, half: usize, index: u16, kind: OrderKind) {
        let (address, word) = self
            .plan
            .model
            .order(kind)
            .map(|(at, fact)| (at, fact.value))
            .expect("it has the order");
        self.pair.write(half, index, address, word);
    }

    /// The client ends it: it stops the drives, or is gone.
    fn ends(&mut self) {
        self.is_over = true;
        if self.plan.end == End::Gone {
            return;
        }
        for index in 0..u16::from(DRIVES) {
            for half in 0..self.count {
                if self.pair.halves[half].core.is_none() || self.pair.halves[half].is_suspended {
                    continue;
                }
                if self.plan.form == Form::Native {
                    self.writes(half, index, OrderKind::Stop);
                } else {
                    let origin = self.origin();
                    self.pair.command(half, origin, index, STOP);
                }
            }
            if self.plan.end == End::Stop {
                self.pass(MS(300));
            }
        }
    }

    fn goes_wrong(&mut self) {
        let plan = self.plan;
        let mut events = Vec::new();
        for (number, trouble) in plan.troubles.iter().enumerate() {
            if trouble.kind.half().is_none_or(|half| half < self.count) {
                events.push((trouble.from, number, true));
                events.extend(trouble.until.map(|until| (until, number, false)));
            }
        }
        let (listens, ends) = (usize::MAX, usize::MAX - 1);
        events.extend(
            plan.listens_from
                .filter(|_| self.count > 1)
                .map(|from| (from, listens, true)),
        );
        events.push((plan.end_at, ends, true));
        events.sort_by_key(|(at, ..)| *at);
        let mut going_on: Vec<Trouble> = Vec::new();
        for (at, number, begins) in events {
            self.until(self.begin + at);
            if number == listens {
                self.pair.start(1);
            } else if number == ends {
                self.ends();
            } else if begins {
                going_on.push(plan.troubles[number]);
                self.begins(plan.troubles[number]);
            } else {
                going_on.retain(|it| it.kind != plan.troubles[number].kind);
                self.is_over_with(plan.troubles[number].kind);
            }
            self.sets_faults(&going_on);
        }
        let last = plan
            .troubles
            .iter()
            .filter_map(|it| it.until)
            .chain([plan.end_at])
            .max()
            .unwrap_or_default();
        self.until(self.begin + last.max(plan.end_at + plan.lost_after) + REST);
    }

    fn begins(&mut self, trouble: Trouble) {
        let until = self.begin + trouble.until.unwrap_or_default();
        match trouble.kind {
            Kind::Jam(pause) => {
                self.pair.jam = Some(Jam {
                    next_at: self.pair.now,
                    until,
                    pause,
                })
            }
            Kind::Kill(half) => self.pair.kill(half),
            Kind::Suspend(half) => self.pair.halves[half].is_suspended = true,
            Kind::Unplug(half) => self.pair.unplug(half),
            Kind::Foreign(_) => self.foreign_at = self.pair.now,
            _ => {}
        }
    }

    fn is_over_with(&mut self, kind: Kind) {
        match kind {
            Kind::Kill(half) => self.pair.start_again(half),
            Kind::Suspend(half) if self.pair.halves[half].is_suspended => self.pair.resume(half),
            Kind::Unplug(half) if !self.pair.halves[half].is_open => self.pair.open(half),
            Kind::Foreign(_) => self.foreign_at = MonoTime::NEVER,
            _ => {}
        }
    }

    /// Faults that last as long as their trouble.
    fn sets_faults(&mut self, going_on: &[Trouble]) {
        let goes_on = |kind: Kind| going_on.iter().any(|it| it.kind == kind);
        self.pair.drives_are_cut = goes_on(Kind::DrivesAway);
        let noise = FaultPlan {
            noise: 100,
            lost: 150,
            cut: 100,
            flip: 250,
            ..FaultPlan::NONE
        };
        self.pair.bus.set_faults(if goes_on(Kind::Noisy) {
            noise
        } else {
            FaultPlan::NONE
        });
        for (number, half) in self.pair.halves.iter_mut().enumerate() {
            half.is_deaf = goes_on(Kind::Deaf(number));
            half.is_mute = goes_on(Kind::Mute(number));
            half.is_off_speed = goes_on(Kind::OffSpeed(number));
            let rates = going_on.iter().map(|it| it.kind);
            half.mishears_per_mille = rates
                .clone()
                .find_map(|kind| {
                    if let Kind::Mishears(of, rate) = kind {
                        (of == number).then_some(rate)
                    } else {
                        None
                    }
                })
                .unwrap_or_default();
            half.misspeaks_per_mille = rates
                .clone()
                .find_map(|kind| {
                    if let Kind::Misspeaks(of, rate) = kind {
                        (of == number).then_some(rate)
                    } else {
                        None
                    }
                })
                .unwrap_or_default();
        }
    }

    /// Lets the client and the foreign master go on until `at`.
    fn until(&mut self, at: MonoTime) {
        while self.pair.now < at {
            let next = at.min(self.repeats_at).min(self.foreign_at);
            self.look_until(next);
            if self.pair.now >= self.foreign_at {
                self.asks_foreign();
            }
            if self.pair.now >= self.repeats_at {
                self.repeats_at = self.pair.now + CYCLE;
                let is_there = !self.is_over || self.plan.end != End::Gone;
                if !self.is_over || (is_there && self.plan.form == Form::Once) {
                    self.orders_run(false);
                }
            }
        }
    }

    fn pass(&mut self, time: Duration) {
        let until = self.pair.now + time;
        self.look_until(until);
    }

    /// Time passes, and the drives are looked at.
    fn look_until(&mut self, until: MonoTime) {
        let (mut steps, mut before) = (0, self.pair.now);
        loop {
            let goes_on = self.pair.step(until);
            self.look();
            steps = if self.pair.now == before {
                steps + 1
            } else {
                0
            };
            before = self.pair.now;
            let wakes = || {
                self.pair
                    .halves
                    .iter()
                    .map(|half| half.core.as_ref().and_then(|core| core.next_wake()))
            };
            assert!(
                steps < STEPS_MAX,
                "seed {}: it spins: {:?}",
                self.plan.seed,
                wakes().collect::<Vec<_>>()
            );
            if !goes_on {
                return;
            }
        }
    }

    fn look(&mut self) {
        let now = self.pair.now.since(self.begin);
        for (place, ran) in self.ran.iter_mut().enumerate() {
            let station = Station(u8::try_from(place + 1).unwrap_or(1));
            let runs = self
                .pair
                .bus
                .drive(station)
                .is_some_and(|drive| drive.ordered().is_some());
            if runs != *ran {
                *ran = runs;
                self.seen.starts[place] += usize::from(runs);
                self.seen.stopped_at[place] = (!runs).then_some(now);
            }
        }
        self.watch.look(&self.pair);
        let passed = now.saturating_sub(self.looked_at);
        self.looked_at = now;
        if self.is_over {
            self.seen.rest += passed;
            for half in (0..self.count).filter(|half| self.pair.role(*half) == LineRole::Active) {
                self.seen.active[half] += passed;
            }
        }
    }

    fn told(&self) -> Vec<String> {
        let mut told = Vec::new();
        for (number, half) in self.pair.halves.iter().enumerate() {
            told.extend(
                half.line_notes
                    .iter()
                    .map(|(at, note)| (*at, number, note.to_string())),
            );
            told.extend(
                half.notes
                    .iter()
                    .map(|(at, note)| (*at, number, format!("{note:?}"))),
            );
        }
        for sent in self
            .pair
            .sent
            .iter()
            .filter(|sent| sent.pdu.first().is_some_and(|function| *function != 3))
        {
            let how = if sent.is_damaged {
                ", damaged"
            } else if sent.is_lost {
                ", not heard"
            } else {
                ""
            };
            told.push((sent.at, sent.half, format!("writes {:02X?}{how}", sent.pdu)));
        }
        told.sort_by_key(|(at, ..)| *at);
        let told = told.into_iter().filter(|(at, ..)| *at >= self.begin);
        told.map(|(at, half, what)| {
            format!("{:.3} {half}: {what}", at.since(self.begin).as_secs_f64())
        })
        .collect()
    }

    /// One read of a drive that is no other one's.
    fn asks_foreign(&mut self) {
        let period = self.plan.troubles.iter().find_map(|it| match it.kind {
            Kind::Foreign(period) => Some(period),
            _ => None,
        });
        self.foreign_at = self.pair.now + period.unwrap_or(CYCLE);
        let address = self
            .plan
            .model
            .registers
            .first()
            .map_or(0, |register| register.address.number());
        let [high, low] = address.to_be_bytes();
        self.pair
            .sends_foreign(sealed(&[FOREIGN_DRIVE.0, 3, high, low, 0, 1]));
    }
}
