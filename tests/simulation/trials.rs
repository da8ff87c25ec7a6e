//! Single properties, counted: late replies, silences, and stops under many reads.

use super::checker::messages::Inbound;
use super::checker::tables::{Action, Drive, Kind, Line};
use super::extras::Extras;
use super::plan::Plan;
use super::tally::Tally;
use super::told;
use super::world::World;
use fastrand::Rng;
use std::time::Duration;
use vfd_gateway::domain::command::{CommandRequest, Order, OrderManner, Origin, Owner, Rights};
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Ticket};
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::sim::FaultPlan;

/// A line of `drives` of `kind` whose clients read without a pause.
pub(super) fn reads(drives: u8, kind: Kind, clients: usize, faults: FaultPlan) -> Plan {
    let drive = |place: u8| Drive {
        kind,
        station: place + 1,
        unit: place,
        uniform: 100 + place,
        poll: 1_000_000_000,
        timeout: 200_000_000,
        has_control: true,
        least: 500,
        most: 5_000,
        lost_after: 5_000_000_000,
        on_lost: Action::Stop,
        on_shutdown: Action::Stop,
    };
    Plan {
        line: Line {
            baud: 9_600,
            char_bits: 10,
            drives: (1..=drives).map(drive).collect(),
        },
        link: LinkSettings::DEFAULT,
        faults,
        clients,
        has_mqtt: false,
        ask_every: Duration::from_millis(1),
        trouble_every: Duration::from_secs(3_600),
        only_reads: true,
        keeps: false,
        extras: Extras::NONE,
    }
}

/// Delays `count` replies on a line of several drives. None may be taken for another request.
///
/// # Errors
/// The violation that was seen.
pub fn late(seed: u64, count: u64) -> Result<Tally, String> {
    let mut rng = Rng::with_seed(seed);
    let kind = Kind::ALL[rng.usize(0..3)];
    let faults = FaultPlan {
        late: rng.u16(100..700),
        ..FaultPlan::NONE
    };
    let plan = reads(rng.u8(1..=4), kind, rng.usize(2..8), faults);
    let mut world = World::with(plan, rng);
    let calm_until = MonoTime::from_millis(7_000);
    while world.now < calm_until {
        world.step(calm_until);
    }
    world.bus.set_faults(faults);
    while world.bus.report().replies_late < count && world.checker.violation().is_none() {
        world.step(MonoTime::NEVER);
    }
    finished(seed, world)
}

/// `count` exchanges without a fault and without a pause: no silence before a frame may be too short.
///
/// # Errors
/// The violation that was seen.
pub fn gaps(seed: u64, count: u64) -> Result<Tally, String> {
    let mut rng = Rng::with_seed(seed);
    let mut plan = Plan::draw(&mut rng);
    plan.only_reads = true;
    plan.faults = FaultPlan::NONE;
    plan.has_mqtt = false;
    let mut world = World::with(plan, rng);
    while world.checker.wire.count() < count && world.checker.violation().is_none() {
        world.step(MonoTime::NEVER);
    }
    finished(seed, world)
}

fn finished(seed: u64, mut world: World) -> Result<Tally, String> {
    world.end();
    match world.checker.violation() {
        None => Ok(world.tally),
        Some(it) => Err(told(seed, world.checker.wire.count(), &world, it)),
    }
}

/// Stops a drive `count` times while clients read without a pause, at random moments. Each stop must start exactly when
/// the exchange in flight is over and the silence has passed, and no frame may be sent before it. Returns the longest
/// wait and how many reads were on offer.
///
/// # Errors
/// The violation that was seen.
pub fn stops(seed: u64, count: u64) -> Result<(Duration, u64), String> {
    let mut rng = Rng::with_seed(seed);
    let plan = reads(4, Kind::N700, 64, FaultPlan::NONE);
    let silence = plan.line.silence();
    let draws = Rng::with_seed(rng.u64(..));
    let mut world = World::with(plan, rng);
    let mut draws = draws;
    let mut worst = Duration::ZERO;
    let mut pool = 0;
    for trial in 0..count {
        let until = world.now + Duration::from_micros(draws.u64(800_000..1_200_000));
        while world.now < until {
            world.step(until);
        }
        // Each client has 16 requests in flight, and repeats each that is answered.
        (0..world.clients.len()).for_each(|who| (0..16).for_each(|_| world.client_reads(who)));
        world.decide();
        pool = world.checker.counts.requests;
        let accepted = world.now;
        let frames = world.checker.wire.count();
        stop_one(&mut world, trial, draws.u16(0..4));
        while world.checker.wire.count() == frames {
            world.step(MonoTime::NEVER);
        }
        let newest = *world.checker.wire.newest().expect("a frame");
        if newest.function != 6 || newest.address != 2 || newest.values[0] != 0 {
            return Err(format!(
                "seed {seed}, trial {trial}: something went before the stop: {newest:?}"
            ));
        }
        let before = world.checker.wire.back(1).expect("an exchange before");
        let over = before
            .heard_at
            .ok_or_else(|| format!("seed {seed}, trial {trial}: not answered: {before:?}"))?;
        let right = accepted.as_nanos().max(over + silence);
        if newest.at.abs_diff(right) > 1 {
            return Err(format!(
                "seed {seed}, trial {trial}: at {} ns instead of {right} ns",
                newest.at
            ));
        }
        worst = worst.max(Duration::from_nanos(newest.at - accepted.as_nanos()));
    }
    finished(seed, world).map(|_| (worst, pool))
}

fn stop_one(world: &mut World, trial: u64, drive: u16) {
    let topic = format!("vfd/plant/drive/d{drive}/run/set");
    let message = Inbound {
        topic: &topic,
        payload: "stop",
        retain: false,
        duplicate: false,
        wall_ms: 0,
        issued: world.now.as_nanos(),
    };
    world.checker.message(world.now.as_nanos(), message);
    let rights = Rights {
        write: true,
        stop: true,
    };
    let command = CommandRequest {
        asker: AskerId::MQTT,
        ticket: Ticket(trial),
        drive: DriveIndex(drive),
        origin: Origin {
            owner: Owner::Mqtt,
            rights,
            manner: OrderManner::Once,
        },
        order: Order::Stop { setpoint: None },
        start_before: MonoTime::NEVER,
        issued: None,
        epoch: None,
        trial: None,
    };
    world.core.handle(world.now, LineInput::Command(command));
    world.decide();
}
