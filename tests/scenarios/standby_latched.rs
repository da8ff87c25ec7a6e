//! A stop that a listener took while its partner was not heard: it is carried out at once or ends, and never runs later.

use crate::support::pair::{Pair, Sent};
use crate::support::{MQTT, RigOptions, STOP, control, plc, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{DriveNote, LineInput};

const SECOND: Duration = Duration::from_secs(1);
const MS: fn(u64) -> Duration = Duration::from_millis;

/// A drive that runs at 30 Hz by an order through the first gateway, which is not heard for a while. Meanwhile the other one
/// takes a stop; returns when.
fn latched() -> (Pair, vfd_gateway::domain::ids::Ticket, MonoTime) {
    let settings = ControlSettings {
        on_gateway_lost: Some(OnGatewayLost::Hold),
        lost_after: SECOND * 600,
        ..control()
    };
    let mut pair = Pair::running(&RigOptions {
        control: Some(settings),
        poll: MS(250),
        ..RigOptions::controlled()
    });
    pair.command(0, MQTT, 0, run(Direction::Forward, Some(3000)));
    for _ in 0..12 {
        alive(&mut pair);
        pair.pass(SECOND);
    }
    assert_eq!(pair.output(1), 3000);
    pair.halves[0].is_mute = true;
    pair.pass(MS(1_900));
    let ticket = pair.command(1, plc(1), 0, STOP);
    let taken = pair.now;
    pair.pass(MS(200));
    assert_eq!(
        pair.told(1, ticket),
        None,
        "the partner is not heard: the stop waits"
    );
    pair.halves[0].is_mute = false;
    (pair, ticket, taken)
}

fn alive(pair: &mut Pair) {
    (0..2).for_each(|half| pair.tell(half, LineInput::PathAlive(MQTT.owner)));
}

fn stops(pair: &Pair, half: usize, from: MonoTime) -> usize {
    let is_stop =
        |sent: &&Sent| sent.half == half && sent.at >= from && sent.pdu == [6, 0, 2, 0, 0];
    pair.sent.iter().filter(is_stop).count()
}

fn assert_no_alarm(pair: &Pair) {
    let notes: Vec<_> = pair.halves[1].notes.iter().map(|(_, note)| *note).collect();
    assert!(
        !notes
            .iter()
            .any(|note| matches!(note, DriveNote::NotEffective | DriveNote::StopDropped)),
        "{notes:?}"
    );
}

#[test]
fn it_is_carried_out_when_the_partner_is_heard_again_and_never_later() {
    let (mut pair, ticket, taken) = latched();
    for _ in 0..20 {
        alive(&mut pair);
        pair.pass(SECOND);
    }
    assert_eq!(
        [pair.role(0), pair.role(1)],
        [LineRole::Active, LineRole::Listening]
    );
    assert!(stops(&pair, 1, taken) > 0);
    assert_eq!(pair.output(1), 0);
    let told = pair.told(1, ticket);
    assert!(
        matches!(
            told,
            Some((Outcome::Acknowledged | Outcome::Confirmed, Reason::None))
        ),
        "{told:?}"
    );
    assert_no_alarm(&pair);
    // The drive is started again, minutes pass, and the line changes hands: the stop is not sent once more.
    pair.command(0, MQTT, 0, STOP);
    pair.pass(SECOND * 5);
    let started = pair.command(0, MQTT, 0, run(Direction::Forward, Some(3000)));
    let again = pair.now;
    for _ in 0..120 {
        alive(&mut pair);
        pair.pass(SECOND);
    }
    assert_eq!(
        (pair.told(0, started).map(|told| told.0), pair.output(1)),
        (Some(Outcome::Acknowledged), 3000)
    );
    pair.kill(0);
    pair.pass(SECOND * 30);
    assert_eq!(
        (pair.role(1), pair.output(1)),
        (LineRole::Active, 3000),
        "it is held, as declared"
    );
    assert_eq!(stops(&pair, 1, again), 0);
    assert_no_alarm(&pair);
}

#[test]
fn it_ends_where_the_partner_has_stopped_the_drive_meanwhile() {
    let (mut pair, _, taken) = latched();
    pair.command(0, MQTT, 0, STOP);
    for _ in 0..20 {
        alive(&mut pair);
        pair.pass(SECOND);
    }
    assert_eq!((pair.output(1), pair.role(0)), (0, LineRole::Active));
    assert!(stops(&pair, 1, taken) <= 6, "{}", stops(&pair, 1, taken));
    let end = pair.now;
    pair.pass(SECOND * 120);
    assert_eq!(stops(&pair, 1, end), 0);
    assert_no_alarm(&pair);
}
