//! Gateways that were given the same rank by mistake: they take a line in the same moment, and one goes on.

use crate::support::pair::{Pair, Sent};
use crate::support::{MQTT, RigOptions, control, run};
use std::time::Duration;
use vfd_gateway::domain::command::Direction;
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{LineInput, LineNote};

const SECOND: Duration = Duration::from_secs(1);
const GATEWAYS: usize = 3;
/// The stop of the drive.
const STOPS: [u8; 5] = [6, 0, 2, 0, 0];

fn three(seed: u64) -> Pair {
    let settings = ControlSettings {
        on_gateway_lost: Some(OnGatewayLost::Stop),
        ..control()
    };
    let mut pair = Pair::new(
        GATEWAYS,
        &RigOptions {
            seed,
            control: Some(settings),
            ..RigOptions::controlled()
        },
    );
    let first = pair.halves[0].setup.standby;
    pair.halves
        .iter_mut()
        .for_each(|half| half.setup.standby = first);
    // Each start has numbers of its own.
    pair.halves
        .iter_mut()
        .for_each(|half| half.setup.first_epoch += seed * 17);
    (0..GATEWAYS).for_each(|half| pair.start(half));
    pair
}

fn active(pair: &Pair) -> Vec<usize> {
    (0..GATEWAYS)
        .filter(|half| pair.role(*half) == LineRole::Active)
        .collect()
}

/// When a sound stop was first sent, since `from`.
fn stopped(pair: &Pair, from: MonoTime) -> Option<Duration> {
    let is_stop = |sent: &&Sent| sent.at >= from && sent.pdu == STOPS && !sent.is_damaged;
    pair.sent
        .iter()
        .find(is_stop)
        .map(|sent| sent.at.since(from))
}

#[test]
fn three_of_equal_rank_find_one_that_sends_and_a_drive_is_stopped_in_time() {
    let mut longest = Duration::ZERO;
    for seed in 0..20 {
        let mut pair = three(seed);
        pair.pass(SECOND * 15);
        let [first] = active(&pair)[..] else {
            panic!("seed {seed}: {:?} are active", active(&pair))
        };
        pair.command(first, MQTT, 0, run(Direction::Forward, Some(3000)));
        for _ in 0..10 {
            pair.tell(first, LineInput::PathAlive(MQTT.owner));
            pair.pass(SECOND);
        }
        assert_eq!(
            (active(&pair), pair.output(1)),
            (vec![first], 3000),
            "seed {seed}"
        );
        pair.kill(first);
        let killed = pair.now;
        pair.pass(SECOND * 20);
        let took =
            stopped(&pair, killed).unwrap_or_else(|| panic!("seed {seed}: it is not stopped"));
        longest = longest.max(took);
        assert_eq!((active(&pair).len(), pair.output(1)), (1, 0), "seed {seed}");
        // That there is another one of the same rank is told.
        let told = pair.halves.iter().flat_map(|half| &half.line_notes);
        let is_rival = |note: &LineNote| {
            matches!(
                note,
                LineNote::Rival {
                    is_gateway: true,
                    ..
                }
            )
        };
        assert!(told.clone().any(|(_, note)| is_rival(note)), "seed {seed}");
    }
    println!("the first sound stop after {longest:?} at most");
    assert!(longest <= SECOND * 8, "{longest:?}");
}
