//! An order to run outlives everything but a seen standstill: what two gateways of a line do with a drive that runs on after
//! one of them, both, or the line was away.

use crate::support::pair::{Pair, Sent};
use crate::support::{MQTT, RigOptions, control, model, run};
use std::time::Duration;
use vfd_gateway::domain::command::Direction;
use vfd_gateway::domain::control::{ControlAction, ControlSettings};
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::sim::FaultPlan;

const SECOND: Duration = Duration::from_secs(1);
const MS: fn(u64) -> Duration = Duration::from_millis;

/// Of models with a status word that tells the direction, with one that does not, and with none.
const MODELS: [&str; 4] = [
    "hyundai-n700",
    "teco-e510",
    "frecon-fr500a",
    "toshiba-vf-as1",
];

fn options(id: &str) -> RigOptions {
    let settings = ControlSettings {
        on_gateway_lost: Some(OnGatewayLost::Stop),
        lost_after: SECOND * 3,
        accept_unverified: ControlAction::ALL.to_vec(),
        ..control()
    };
    RigOptions {
        control: Some(settings),
        poll: MS(250),
        model: model(id),
        ..RigOptions::controlled()
    }
}

/// A drive of this model that runs by an order through the first gateway; the second one listens.
fn running(id: &str) -> Pair {
    let mut pair = Pair::running(&options(id));
    start(&mut pair, 0, id);
    pair
}

fn start(pair: &mut Pair, half: usize, id: &str) {
    pair.command(half, MQTT, 0, run(Direction::Forward, Some(3000)));
    for _ in 0..12 {
        pair.tell(half, LineInput::PathAlive(MQTT.owner));
        pair.pass(SECOND);
    }
    assert_eq!(pair.output(1), 3000, "{id}");
}

/// Lets time pass until the motor stands still.
fn stops(pair: &mut Pair, within: Duration) -> Option<Duration> {
    let begin = pair.now;
    while pair.now < begin + within {
        pair.pass(MS(50));
        if pair.output(1) < 3000 {
            return Some(pair.now.since(begin));
        }
    }
    None
}

/// Bytes of no frame fill the line for `length`.
fn jam(pair: &mut Pair, length: Duration) {
    let until = pair.now + length;
    while pair.now < until {
        let now = pair.now;
        pair.bus.speak(now, &[0x5A, 0xA5, 0x3C, 0xC3, 0x69, 0x96]);
        pair.pass(MS(5));
    }
}

#[test]
fn an_order_is_not_forgotten_where_the_drive_and_the_line_were_out_of_sight() {
    for id in MODELS {
        for has_partner in [false, true] {
            let mut pair = running(id);
            if !has_partner {
                pair.kill(1);
            }
            pair.bus.set_faults(FaultPlan {
                lost: 1000,
                ..FaultPlan::NONE
            });
            for _ in 0..8 {
                pair.tell(0, LineInput::PathAlive(MQTT.owner));
                pair.pass(MS(500));
            }
            for half in [0, 1] {
                pair.unplug(half);
            }
            pair.pass(SECOND);
            pair.bus.set_faults(FaultPlan::NONE);
            for half in [0, 1] {
                pair.open(half);
            }
            let took = stops(&mut pair, SECOND * 10);
            assert!(
                took.is_some_and(|took| took <= MS(4500)),
                "{id}, {has_partner}: {took:?}"
            );
        }
    }
}

#[test]
fn where_both_gateways_restart_a_drive_that_runs_is_stopped() {
    for id in MODELS {
        for first in [0, 1] {
            let mut pair = running(id);
            pair.kill(0);
            pair.kill(1);
            pair.pass(MS(300));
            pair.start(first);
            pair.pass(MS(700));
            pair.start(1 - first);
            let took = stops(&mut pair, SECOND * 10);
            assert!(
                took.is_some_and(|took| took <= MS(4500)),
                "{id}, {first} first: {took:?}"
            );
        }
    }
}

#[test]
fn a_listener_that_was_started_just_before_the_loss_stops_a_drive_that_runs() {
    for id in MODELS {
        for (poll, age) in [
            (250, 0),
            (250, 5),
            (250, 60),
            (250, 400),
            (3000, 400),
            (3000, 1000),
        ] {
            let mut pair = Pair::running(&RigOptions {
                poll: MS(poll),
                ..options(id)
            });
            start(&mut pair, 0, id);
            pair.kill(1);
            pair.pass(SECOND);
            pair.start(1);
            pair.pass(MS(age));
            pair.kill(0);
            let took = stops(&mut pair, SECOND * 10);
            assert!(
                took.is_some_and(|took| took <= MS(4500)),
                "{id}, {poll} ms, {age} ms: {took:?}"
            );
        }
    }
}

#[test]
fn where_both_gateways_restart_a_drive_that_stands_still_is_left_alone() {
    for id in MODELS {
        let mut pair = Pair::running(&options(id));
        pair.kill(0);
        pair.kill(1);
        pair.start(0);
        let begin = pair.now;
        pair.pass(SECOND * 10);
        let writes = |sent: &&Sent| sent.at >= begin && matches!(sent.pdu[0], 5 | 6 | 15 | 16);
        assert_eq!(pair.sent.iter().filter(writes).count(), 0, "{id}");
    }
}

#[test]
fn a_jam_is_no_silence() {
    for length in [600, 1700, 3000, 5000, 9000] {
        let mut pair = Pair::running(&options("hyundai-n700"));
        jam(&mut pair, MS(length));
        let end = pair.now;
        let first = pair
            .until(SECOND * 10, |pair| sends(pair, end))
            .expect("the line is taken again");
        // Whoever is active sends at once; a line that was given up is free again after its silence.
        assert!(
            first <= MS(100) || first >= MS(2300),
            "{length} ms: {first:?}"
        );
        pair.pass(SECOND * 10);
        assert_eq!(
            pair.sent
                .iter()
                .filter(|sent| sent.at >= end && sent.is_damaged)
                .count(),
            0,
            "{length} ms"
        );
        let active = [0, 1]
            .into_iter()
            .filter(|half| pair.role(*half) == LineRole::Active)
            .count();
        assert_eq!(active, 1, "{length} ms");
    }
}

#[test]
fn after_a_jam_a_drive_that_runs_is_stopped() {
    for length in [600, 1700, 3000, 5000, 9000] {
        let mut pair = running("hyundai-n700");
        jam(&mut pair, MS(length));
        let took = stops(&mut pair, SECOND * 10);
        assert!(
            took.is_some_and(|took| took <= MS(6000)),
            "{length} ms: {took:?}"
        );
    }
}

fn sends(pair: &Pair, from: MonoTime) -> bool {
    pair.sent
        .iter()
        .any(|sent| sent.at >= from && !sent.is_of_listener())
}
