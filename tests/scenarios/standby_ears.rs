//! Ears are proven before they are believed: a gateway that hears nothing, or nothing but garbage, leaves the line to the other.

use crate::support::pair::Pair;
use crate::support::{MQTT, RigOptions, STOP, control, plc, run};
use std::time::Duration;
use vfd_gateway::domain::command::Direction;
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost};
use vfd_gateway::gateway::LineInput;

const SECOND: Duration = Duration::from_secs(1);

fn running() -> Pair {
    let settings = ControlSettings {
        on_gateway_lost: Some(OnGatewayLost::Stop),
        ..control()
    };
    let poll = Duration::from_millis(250);
    let mut pair = Pair::running(&RigOptions {
        control: Some(settings),
        poll,
        ..RigOptions::controlled()
    });
    pair.command(0, MQTT, 0, run(Direction::Forward, Some(3000)));
    for _ in 0..12 {
        pair.tell(0, LineInput::PathAlive(MQTT.owner));
        pair.pass(SECOND);
    }
    assert_eq!(pair.output(1), 3000);
    pair
}

/// For how many of the next `seconds` the half is active.
fn active_for(pair: &mut Pair, half: usize, seconds: u32) -> u32 {
    let mut count = 0;
    for _ in 0..seconds {
        pair.pass(SECOND);
        count += u32::from(pair.role(half) == LineRole::Active);
    }
    count
}

#[test]
fn a_deaf_listener_leaves_the_line_to_the_healthy_one() {
    let mut pair = running();
    pair.halves[1].is_deaf = true;
    let active = active_for(&mut pair, 0, 300);
    assert!(active >= 200, "{active} of 300 s");
    assert!(pair.core(1).report().standby.unwrap().trouble.is_deaf);
    assert_eq!(pair.output(1), 0);
}

#[test]
fn the_healthy_one_takes_over_from_an_active_one_that_is_deaf() {
    let mut pair = running();
    pair.halves[0].is_deaf = true;
    let took = pair
        .until(SECOND * 20, |pair| pair.role(1) == LineRole::Active)
        .expect("it takes over");
    assert!(took <= SECOND * 8, "{took:?}");
    pair.pass(SECOND * 8);
    assert_eq!(pair.output(1), 0, "what is declared is done");
    let active = active_for(&mut pair, 1, 300);
    assert!(active >= 200, "{active} of 300 s");
}

#[test]
fn a_stop_is_sent_by_a_deaf_half_too() {
    for (deaf, half) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let mut pair = running();
        pair.halves[deaf].is_deaf = true;
        for second in 0..10 {
            pair.tell(0, LineInput::PathAlive(MQTT.owner));
            if second == 5 {
                pair.command(half, plc(1), 0, STOP);
            }
            pair.pass(SECOND);
        }
        assert!(pair.output(1) < 3000, "{deaf} is deaf, a stop at {half}");
    }
}

#[test]
fn a_listener_at_the_wrong_speed_never_breaks_in() {
    let mut pair = running();
    pair.halves[1].is_off_speed = true;
    for _ in 0..60 {
        pair.tell(0, LineInput::PathAlive(MQTT.owner));
        pair.pass(SECOND);
        assert_eq!(
            [pair.role(0), pair.role(1)],
            [LineRole::Active, LineRole::Listening]
        );
    }
    assert_eq!(pair.output(1), 3000);
    assert!(pair.core(1).report().standby.unwrap().trouble.is_deaf);
}
