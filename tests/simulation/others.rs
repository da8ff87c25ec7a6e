//! Other parties at the drives: people at the panel or at a terminal, another master, the drive by itself. Also the
//! state of each motor for the observer, straight from the drive.

use super::checker::motor::State;
use super::checker::tables::Run;
use super::extras::Extra;
use super::trouble::Trouble;
use super::world::World;
use fastrand::Rng;
use std::time::Duration;
use vfd_gateway::domain::command::Direction;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::sim::RefusedStops;

/// Microhertz in a hundredth of a hertz.
const CENTIHERTZ: u64 = 10_000;

/// The other parties at the drives.
#[derive(Debug)]
pub struct Others {
    rng: Rng,
    /// When they act next.
    pub at: MonoTime,
    every: Duration,
    /// A drive that refuses to stop until then.
    refuses: Option<(MonoTime, usize)>,
}

impl Others {
    pub fn new(seed: u64, from: MonoTime) -> Self {
        let mut rng = Rng::with_seed(seed);
        let every = Duration::from_millis(rng.u64(1_000..12_000));
        Self {
            rng,
            at: from,
            every,
            refuses: None,
        }
    }
}

impl World {
    /// Other parties do what is due.
    pub fn others_act(&mut self) {
        let Some(mut others) = self.others.take() else {
            return;
        };
        if let Some((_, place)) = others.refuses.take_if(|(until, _)| *until <= self.now) {
            self.refuse_stops(place, RefusedStops::None);
        }
        if others.at <= self.now {
            others.at = self.now
                + Duration::from_nanos(others.rng.u64(1..=2 * others.every.as_nanos() as u64));
            let place = others.rng.usize(0..self.plan.line.drives.len());
            if self.plan.extras.has(Extra::RefusedStops)
                && others.refuses.is_none()
                && others.rng.u8(0..6) == 0
            {
                let which = if others.rng.bool() {
                    RefusedStops::Single
                } else {
                    RefusedStops::All
                };
                self.refuse_stops(place, which);
                let lasts = Duration::from_millis(others.rng.u64(500..30_000));
                others.refuses = Some((self.now + lasts, place));
            } else if self.plan.extras.has(Extra::Others) {
                self.one_acts(&mut others.rng, place);
            }
            self.look_at_motor(place, self.now);
        }
        self.others = Some(others);
    }

    /// When other parties act next.
    pub fn others_due(&self) -> MonoTime {
        let Some(others) = &self.others else {
            return MonoTime::NEVER;
        };
        others
            .refuses
            .map_or(others.at, |(until, _)| until.min(others.at))
    }

    /// All drives stop when they are ordered to.
    pub fn others_leave(&mut self) {
        if let Some((_, place)) = self.others.take().and_then(|others| others.refuses) {
            self.refuse_stops(place, RefusedStops::None);
        }
    }

    fn refuse_stops(&mut self, place: usize, which: RefusedStops) {
        self.checker.note(
            self.now.as_nanos(),
            place,
            &format!("stops refused: {which:?}"),
        );
        if let Some(drive) = self.bus.drive_mut(self.station(place)) {
            drive.refuse_stops(which);
        }
        self.look_at_motor(place, self.now);
    }

    fn one_acts(&mut self, rng: &mut Rng, place: usize) {
        let now = self.now;
        let station = self.station(place);
        let facts = self.plan.line.drives[place].kind.facts();
        let runs = if rng.u8(0..3) == 0 {
            Direction::Reverse
        } else {
            Direction::Forward
        };
        let dice = rng.u8(0..20);
        let hertz = rng.u16(3..60);
        let Some(drive) = self
            .bus
            .drive_mut(station)
            .filter(|drive| drive.is_powered())
        else {
            return;
        };
        let text = match dice {
            0..6 => {
                if dice < 3 {
                    drive.set_frequency(now, hertz);
                }
                drive.operate(now, Some(runs));
                "another starts it"
            }
            6..9 => {
                drive.operate(now, None);
                "another stops it"
            }
            9 | 10 => {
                drive.set_frequency(now, hertz);
                "another sets its frequency"
            }
            11..14 => {
                let run = [Run::Stop, Run::Forward, Run::Reverse][rng.usize(0..3)];
                let word = facts.word_of(run).unwrap_or(0);
                let pdu = [&[6][..], &facts.run.to_be_bytes(), &word.to_be_bytes()].concat();
                drive.answer(now, &pdu, 0, &mut Vec::new());
                "another master writes its run command"
            }
            14 | 15 => {
                drive.trip(now, rng.u16(1..13));
                self.checker.tripped(place);
                "it trips"
            }
            16 => {
                drive.clear_trip(now, None);
                "another resets it"
            }
            17 | 18 => {
                drive.clear_trip(now, Some(runs));
                "it restarts on its own"
            }
            _ => {
                self.bus.set_powered(now, station, false);
                let lasts = Duration::from_millis(rng.u64(50..5_000));
                self.repair_in(lasts, Trouble::PowerOff, place as u8);
                "another switches it off"
            }
        };
        self.tally.others += 1;
        self.checker.note(now.as_nanos(), place, text);
    }

    /// The observer reads the motor of the drive at `place`, at the drive and not over the line.
    pub fn look_at_motor(&mut self, place: usize, at: MonoTime) {
        let facts = self.plan.line.drives[place].kind.facts();
        let Some(drive) = self.bus.drive(self.station(place)) else {
            return;
        };
        let state = State {
            is_on: drive.is_powered(),
            is_ordered: drive.ordered().is_some(),
            output: (drive.output(at).unsigned_abs() / CENTIHERTZ) as u32,
            is_tripped: drive.is_tripped(),
            trips: drive.trips(),
            run_word: drive.word(facts.run.into()).unwrap_or(0),
            refuses_stops: drive.refused_stops() != RefusedStops::None,
        };
        self.checker.sees_motor(at.as_nanos(), place, state);
    }
}
