//! A STOP goes out from every half of a pair: from one that listens, and while a foreign master is heard.

use crate::support::pair::{Pair, sealed};
use crate::support::{MQTT, RigOptions, STOP, control, plc, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::LineInput;

const SECOND: Duration = Duration::from_secs(1);
const MS: fn(u64) -> Duration = Duration::from_millis;

/// A drive that runs at 30 Hz by an order through the first gateway, polled with this period.
fn running(poll: Duration) -> Pair {
    let settings = ControlSettings {
        on_gateway_lost: Some(OnGatewayLost::Stop),
        ..control()
    };
    let mut pair = Pair::running(&RigOptions {
        control: Some(settings),
        poll,
        ..RigOptions::controlled()
    });
    pair.command(0, MQTT, 0, run(Direction::Forward, Some(3000)));
    for _ in 0..12 {
        alive(&mut pair);
        pair.pass(SECOND);
    }
    assert_eq!(pair.output(1), 3000);
    pair
}

/// The client is there, at both gateways.
fn alive(pair: &mut Pair) {
    for half in [0, 1] {
        pair.tell(half, LineInput::PathAlive(MQTT.owner));
    }
}

/// A foreign master reads another drive every 0.4 s for `length`, which answers.
fn foreign(pair: &mut Pair, length: Duration, is_alive: bool) {
    let until = pair.now + length;
    while pair.now < until {
        let now = pair.now;
        pair.bus
            .speak(now, &sealed(&[0x09, 0x03, 0x00, 0x01, 0x00, 0x01]));
        pair.pass(MS(40));
        let now = pair.now;
        pair.bus
            .speak(now, &sealed(&[0x09, 0x03, 0x02, 0x00, 0x07]));
        pair.pass(MS(360));
        if is_alive {
            alive(pair);
        }
    }
}

fn writes(pair: &Pair, half: usize, from: MonoTime) -> usize {
    pair.sent
        .iter()
        .filter(|sent| sent.half == half && sent.at >= from && matches!(sent.pdu[0], 6 | 16))
        .count()
}

#[test]
fn a_stop_at_the_listener_is_carried_out() {
    for poll in [MS(20), MS(250), SECOND * 3] {
        let mut pair = running(poll);
        let begin = pair.now;
        let ticket = pair.command(1, plc(1), 0, STOP);
        let took = pair.until(SECOND * 3, |pair| writes(pair, 1, begin) > 0);
        assert!(
            took.is_some_and(|took| took <= MS(1100)),
            "{poll:?}: {took:?}, {:?}",
            pair.told(1, ticket)
        );
        for _ in 0..20 {
            alive(&mut pair);
            pair.pass(SECOND);
        }
        assert_eq!(pair.output(1), 0, "{poll:?}");
        let told = pair.told(1, ticket);
        assert!(
            matches!(
                told,
                Some((Outcome::Acknowledged | Outcome::Confirmed, Reason::None))
            ),
            "{poll:?}: {told:?}"
        );
        assert_eq!(
            [pair.role(0), pair.role(1)],
            [LineRole::Active, LineRole::Listening],
            "{poll:?}"
        );
        let of_first = pair.view(0, 0).control.unwrap();
        assert!(
            of_first.start_inhibited && of_first.lease.is_none(),
            "it is a stop by somebody else: {of_first:?}"
        );
        assert!(
            writes(&pair, 1, begin) <= 6,
            "{poll:?}: {}",
            writes(&pair, 1, begin)
        );
        let end = pair.now;
        pair.pass(SECOND * 60);
        assert_eq!(writes(&pair, 1, end), 0, "{poll:?}: it is over");
    }
}

#[test]
fn a_stop_is_carried_out_while_a_foreign_master_is_heard() {
    for (half, both) in [(0, false), (1, false), (0, true), (1, true)] {
        let mut pair = running(MS(250));
        foreign(&mut pair, SECOND * 3, true);
        assert_eq!(
            [pair.role(0), pair.role(1)],
            [LineRole::Listening, LineRole::Listening]
        );
        assert_eq!(pair.output(1), 3000);
        if both {
            pair.command(1 - half, plc(1), 0, STOP);
        }
        let ticket = pair.command(half, plc(1), 0, STOP);
        foreign(&mut pair, SECOND * 2, true);
        assert!(
            pair.output(1) < 3000,
            "{half}: {:?}",
            pair.told(half, ticket)
        );
        foreign(&mut pair, SECOND * 20, true);
        let told = pair.told(half, ticket);
        assert!(
            matches!(
                told,
                Some((Outcome::Acknowledged | Outcome::Confirmed, Reason::None))
            ),
            "{half}: {told:?}"
        );
        let end = pair.now;
        foreign(&mut pair, SECOND * 60, true);
        assert_eq!(writes(&pair, half, end), 0, "{half}: it is over");
    }
}

#[test]
fn the_active_gateway_lets_the_drive_answer_the_stop_of_the_listener() {
    let mut pair = running(MS(250));
    let begin = pair.now;
    pair.command(1, plc(1), 0, STOP);
    pair.until(SECOND * 2, |pair| writes(pair, 1, begin) > 0)
        .expect("it is sent");
    pair.pass(MS(200));
    assert_eq!(
        [writes(&pair, 0, begin), writes(&pair, 1, begin)],
        [1, 1],
        "each of them has its answer"
    );
    let damaged: Vec<_> = pair
        .sent
        .iter()
        .filter(|sent| sent.at >= begin && sent.is_damaged)
        .collect();
    assert!(damaged.is_empty(), "{damaged:?}");
}

#[test]
fn a_listener_looks_at_no_drive_that_the_active_gateway_asks_in_vain() {
    let mut pair = running(MS(250));
    pair.drives_are_cut = true;
    pair.pass(SECOND);
    let begin = pair.now;
    pair.command(1, plc(1), 0, STOP);
    pair.until(SECOND, |pair| pair.role(0) != LineRole::Active);
    let looks = pair
        .sent
        .iter()
        .filter(|sent| sent.half == 1 && sent.at >= begin && sent.pdu[0] == 3)
        .count();
    assert_eq!((pair.role(0), looks), (LineRole::Active, 0));
}

#[test]
fn a_lost_commander_is_noticed_soon_after_a_restart_beside_a_foreign_master() {
    let mut pair = running(MS(250));
    foreign(&mut pair, SECOND, true);
    pair.unplug(0);
    pair.open(0);
    foreign(&mut pair, SECOND * 9, false);
    assert!(pair.output(1) < 3000);
}

#[test]
fn a_lost_commander_stops_the_drive_while_a_foreign_master_is_heard() {
    let mut pair = running(MS(250));
    foreign(&mut pair, SECOND, true);
    foreign(&mut pair, SECOND * 5, false);
    assert!(pair.output(1) < 3000);
}

#[test]
fn a_client_that_joins_a_declared_stop_waits_for_no_signal() {
    let mut pair = running(MS(20));
    pair.unplug(0);
    pair.pass(SECOND * 8);
    assert_eq!(pair.role(1), LineRole::Active);
    pair.open(0);
    pair.pass(MS(50));
    // The lease of the half that was away has ended, and what it declared may be older than the present order.
    let begin = pair.now;
    assert!(
        pair.view(0, 0).control.unwrap().stop_pending,
        "{:?}",
        pair.view(0, 0).control
    );
    pair.command(0, plc(2), 0, STOP);
    let took = pair.until(SECOND * 3, |pair| writes(pair, 0, begin) > 0);
    assert!(took.is_some_and(|took| took <= MS(1500)), "{took:?}");
}

#[test]
fn what_a_half_saw_last_is_kept_when_its_port_is_lost() {
    for is_ours in [true, false] {
        let mut pair = running(MS(20));
        pair.kill(1);
        if !is_ours {
            // It is stopped here, and runs by its panel.
            pair.command(0, MQTT, 0, STOP);
            pair.pass(SECOND * 40);
            let now = pair.now;
            pair.bus
                .drive_mut(Station(1))
                .unwrap()
                .operate(now, Some(Direction::Forward));
            pair.pass(SECOND * 20);
        }
        assert!(pair.output(1) > 0);
        pair.unplug(0);
        pair.pass(MS(10));
        let sight = pair.view(0, 0).sight;
        assert!(sight.may_still_run, "{is_ours}: {sight:?}");
        assert!(
            sight.last_seen.is_some_and(|seen| seen.output.is_some()),
            "{is_ours}: {sight:?}"
        );
    }
}
