//! Commands over MQTT that are stale, retained, duplicate or out of order are not executed; valid ones are, once.

use super::checker::tables::Kind;
use super::told;
use super::trials::reads;
use super::world::World;
use fastrand::Rng;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::sim::FaultPlan;

/// Commands around each valid one that must not be executed.
const BAD: u64 = 12;
/// Valid commands that may come again later.
const OLD: usize = 50;

/// Delivers `count` commands that must not be executed, among valid ones. Returns how many they were, and how many valid
/// ones were executed.
///
/// # Errors
/// Which command was wrongly executed, or was not executed.
pub fn stale(seed: u64, count: u64) -> Result<(u64, u64), String> {
    let mut rng = Rng::with_seed(seed);
    let kind = Kind::ALL[rng.usize(0..3)];
    let mut plan = reads(1, kind, 0, FaultPlan::NONE);
    plan.has_mqtt = true;
    let mut world = World::with(plan, Rng::with_seed(rng.u64(..)));
    pass(&mut world, Duration::from_secs(7));
    let mut bad = 0;
    let mut valid = 0;
    let mut old = Vec::new();
    while bad < count {
        world.may_write = false;
        if !world.is_subscribed() {
            pass(&mut world, Duration::from_secs(1));
            continue;
        }
        let words = (
            500 + (valid * 2 % 4_400) as u16,
            501 + (valid * 2 % 4_400) as u16,
        );
        let before = world.checker.wire.count();
        let id = valid + 1;
        let command = json(&rng, &world, id, words.0);
        let place = rng.u64(0..BAD);
        for number in 0..BAD {
            if number == place {
                world.deliver("command", &command, false, false);
            }
            spoil(
                &mut world,
                &mut rng,
                words.1,
                (number >= place).then_some(&command),
                &old,
            );
            bad += 1;
        }
        pass(&mut world, Duration::from_millis(400));
        let facts = kind.facts();
        let sent = world.checker.wire.count() - before;
        let writes = (0..sent as usize)
            .filter_map(|back| world.checker.wire.back(back))
            .filter(|it| it.function == 6);
        let setpoints: Vec<u16> = writes
            .filter(|it| it.address == facts.setpoint)
            .map(|it| it.values[0])
            .collect();
        if setpoints != [words.0] {
            return Err(format!(
                "seed {seed}: {setpoints:?} were written instead of {} alone",
                words.0
            ));
        }
        valid += 1;
        old.push(command);
        if old.len() > OLD {
            old.remove(0);
        }
        if let Some(it) = world.checker.violation() {
            return Err(told(seed, world.checker.wire.count(), &world, it));
        }
    }
    Ok((bad, valid))
}

/// A valid command.
fn json(rng: &Rng, world: &World, id: u64, word: u16) -> String {
    let issued = match rng.clone().u8(0..3) {
        0 => format!(",\"issued_at\":{}", world.wall() - 200),
        1 => ",\"ttl_ms\":900".to_owned(),
        _ => String::new(),
    };
    format!(
        "{{\"id\":\"o{id}\",\"frequency_hz\":{}{issued}}}",
        hertz(word)
    )
}

fn hertz(word: u16) -> String {
    format!("{}.{:02}", word / 100, word % 100)
}

/// Delivers a command that must not be executed.
fn spoil(world: &mut World, rng: &mut Rng, word: u16, valid: Option<&String>, old: &[String]) {
    let id = 1_000_000_000 + rng.u64(0..1_000_000_000);
    let frequency = hertz(word);
    let fresh = |more: String| format!("{{\"id\":\"o{id}\",\"frequency_hz\":{frequency}{more}}}");
    match (rng.u8(0..9), valid) {
        (0, _) => world.deliver("command", &fresh(String::new()), true, false),
        (1, _) => world.deliver("frequency/set", &frequency, true, false),
        (2, _) => world.deliver("frequency/set", &frequency, false, true),
        (3, Some(valid)) => world.deliver("command", valid, false, true),
        (4, Some(valid)) => world.deliver("command", valid, false, false),
        (5, Some(_)) if !old.is_empty() => {
            world.deliver("command", &old[rng.usize(0..old.len())], rng.bool(), false)
        }
        (6, _) => {
            let issued = world.wall() - rng.i64(1_001..100_000_000);
            world.deliver(
                "command",
                &fresh(format!(",\"issued_at\":{issued}")),
                false,
                false,
            );
        }
        (7, _) => world.deliver("run/set", "forward", true, false),
        _ => world.deliver(
            "command",
            &fresh(format!(",\"epoch\":{}", rng.u64(1..1_000) << 50)),
            false,
            false,
        ),
    }
}

fn pass(world: &mut World, time: Duration) {
    let until: MonoTime = world.now + time;
    world.decide();
    while world.step(until) {}
}
