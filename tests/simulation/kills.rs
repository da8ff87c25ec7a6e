//! The gateway is killed at any moment and starts again: everything in memory is lost, and rows under way to the
//! journal.

use super::checker::kept::Known;
use super::client::Client;
use super::journal::Journal;
use super::mqtt::MqttSide;
use super::plan::Plan;
use super::tally::Tally;
use super::told;
use super::trouble::Trouble;
use super::world::World;
use fastrand::Rng;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::view::DriveView;
use vfd_gateway::gateway::{LineCore, LineInput};
use vfd_gateway::journal::{EntryToKeep, JournalEntry};

/// Kills of one world.
const PER_WORLD: u64 = 20;

/// Kills that are to come.
#[derive(Clone, Copy, Debug)]
pub struct Doom {
    at: MonoTime,
    left: u64,
    /// The number of effects that are still executed in the round of the kill.
    effects: u32,
    is_now: bool,
}

/// Kills the gateway `count` times under load.
///
/// # Errors
/// The violation that was seen.
pub fn kills(seed: u64, count: u64) -> Result<Tally, String> {
    let mut rng = Rng::with_seed(seed);
    let mut plan = Plan::draw(&mut rng);
    plan.keeps = true;
    let mut world = World::with(plan, rng);
    world.doom(count.min(PER_WORLD));
    let faults_on = world.now + Duration::from_secs(5);
    let mut is_calm = true;
    while world.doom.is_some_and(|doom| doom.left > 0) && world.checker.violation().is_none() {
        world.step(MonoTime::NEVER);
        if is_calm && world.now >= faults_on {
            is_calm = false;
            world.bus.set_faults(world.plan.faults);
        }
    }
    let until = world.now + Duration::from_secs(20);
    while world.checker.violation().is_none() && world.step(until) {}
    world.end();
    match world.checker.violation() {
        None => Ok(world.tally),
        Some(it) => Err(told(seed, world.checker.wire.count(), &world, it)
            .replace("-- --seed", "-- --what kills --seed")),
    }
}

impl World {
    fn doom(&mut self, left: u64) {
        let lives = Duration::from_millis(match self.rng.u8(0..4) {
            0 => self.rng.u64(0..1_000),
            1 => self.rng.u64(1_000..5_000),
            _ => self.rng.u64(5_000..40_000),
        });
        let calm = if self.tally.kills == 0 {
            Duration::from_secs(7)
        } else {
            Duration::ZERO
        };
        let at = self.now + calm + lives;
        self.doom = Some(Doom {
            at,
            left,
            effects: self.rng.u32(0..5),
            is_now: false,
        });
        if left > 0
            && self.rng.u8(0..4) == 0
            && let Some(journal) = &mut self.journal
        {
            let before = Duration::from_millis(self.rng.u64(0..2_000)).min(lives);
            journal.gets_stuck(at.before(before));
        }
    }

    /// When something of the journal or a kill is due.
    pub fn kept_due(&self) -> MonoTime {
        let kill = self
            .doom
            .filter(|doom| doom.left > 0)
            .map_or(MonoTime::NEVER, |doom| doom.at);
        self.journal
            .as_ref()
            .map_or(MonoTime::NEVER, Journal::due)
            .min(kill)
    }

    /// The line is notified of rows that are kept by now; a due kill happens in this round.
    pub fn keep_due(&mut self) {
        let now = self.now;
        if let Some(doom) = &mut self.doom {
            doom.is_now |= doom.left > 0 && doom.at <= now;
        }
        let (Some(journal), checker) = (&mut self.journal, &mut self.checker) else {
            return;
        };
        let newest = journal.take(now, |drive, it| checker.kept(now.as_nanos(), drive, it));
        if let Some(row) = newest {
            self.core.handle(now, LineInput::Kept(row));
        }
        for drive in 0..self.plan.line.drives.len() {
            let view = self
                .core
                .view(vfd_gateway::domain::ids::DriveIndex(drive as u16));
            self.checker
                .trips_shown(drive, view.map_or(0, |view| view.trip_kept.total));
        }
    }

    /// Takes a row of the line.
    pub fn keep(&mut self, keep: EntryToKeep) {
        match &keep.entry {
            JournalEntry::Attempt(attempt) => {
                self.checker.attempt(attempt.id.0, attempt.report.is_some())
            }
            JournalEntry::Ended { attempt, .. } => self.checker.attempt_ended(attempt.0),
            _ => {}
        }
        let Some(journal) = &mut self.journal else {
            return self.checker.says("O14", "a row without a journal");
        };
        if let Err(text) = journal.say(self.now, keep) {
            self.checker.says("O14", &text);
        }
    }

    /// One more effect of this round: whether the gateway is killed before it.
    pub fn is_killed(&mut self) -> bool {
        let Some(doom) = self.doom.as_mut().filter(|doom| doom.is_now) else {
            return false;
        };
        if doom.effects > 0 {
            doom.effects -= 1;
            return false;
        }
        true
    }

    /// Whether the gateway is killed at the end of this round.
    pub fn dies(&self) -> bool {
        self.doom.is_some_and(|doom| doom.is_now)
    }

    /// The gateway is killed, and another one starts after a while.
    pub fn kill(&mut self) {
        let left = self.doom.map_or(0, |doom| doom.left - 1);
        self.tally.kills += 1;
        self.checker.killed(self.now.as_nanos());
        let remembered = self.journal.as_mut().map(Journal::kill).unwrap_or_default();
        let at = self.now.as_nanos();
        (0..self.clients.len()).for_each(|who| self.checker.client_closed(at, who, true));
        self.is_port_up = false;
        self.checker.port(at, false);
        self.sleep(Duration::from_millis(self.rng.clone().u64(1..3_000)));
        let mut setup = self.plan.setup(self.rng.u64(1 << 41..1 << 50));
        setup.asked_before = true;
        for (drive, remembered) in setup.drives.iter_mut().zip(&remembered) {
            drive.remembered = *remembered;
        }
        let known = remembered.iter().map(|it| Known {
            is_leased: it.lease.is_some(),
            stop: it.stop.map(|it| it.coast),
        });
        let known: Vec<Known> = known.collect();
        self.core = LineCore::new(setup, self.now);
        self.checker.restarted(self.now.as_nanos(), &known);
        self.views = self
            .descriptions
            .iter()
            .map(|_| Arc::new(DriveView::default()))
            .collect();
        for who in 0..self.clients.len() {
            self.askers += 1;
            self.clients[who] = Client::new(who, self.askers, self.now);
            self.checker.client_opened(self.now.as_nanos(), who);
        }
        self.again.clear();
        self.north_wake = None;
        if self.mqtt.is_some() {
            self.mqtt = Some(MqttSide::new(self));
        }
        self.open_port();
        self.doom(left);
    }

    /// There is no gateway for a while; drives and faults continue.
    fn sleep(&mut self, time: Duration) {
        let until = self.now + time;
        loop {
            let due = self.bus.next_due().unwrap_or(MonoTime::NEVER);
            let repair = self.repairs.first().map_or(MonoTime::NEVER, |(at, ..)| *at);
            if due.min(repair) > until {
                break;
            }
            self.now = self.now.max(due.min(repair));
            self.bus.take_due(self.now, |_, _| {});
            while self.repairs.first().is_some_and(|(at, ..)| *at <= self.now) {
                let (_, trouble, which) = self.repairs.remove(0);
                if trouble != Trouble::PortDown {
                    self.repair(trouble, which);
                }
            }
        }
        self.now = until;
    }
}
