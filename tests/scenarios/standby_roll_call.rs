//! What the roll call finds at a listener before it is needed.

use crate::support::pair::Pair;
use crate::support::{RigOptions, control};
use std::time::Duration;
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::link::EchoPolicy;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost};
use vfd_gateway::gateway::LineNote;

const SECOND: Duration = Duration::from_secs(1);

fn started(echo: EchoPolicy) -> Pair {
    let settings = ControlSettings {
        on_gateway_lost: Some(OnGatewayLost::Stop),
        ..control()
    };
    let mut pair = Pair::new(
        2,
        &RigOptions {
            echo,
            control: Some(settings),
            ..RigOptions::controlled()
        },
    );
    pair.halves[1].echoes = true;
    (0..2).for_each(|half| pair.start(half));
    pair.pass(SECOND * 12);
    assert_eq!(
        [pair.role(0), pair.role(1)],
        [LineRole::Active, LineRole::Listening]
    );
    pair
}

#[test]
fn a_listener_whose_adapter_echoes_is_found_before_it_is_needed() {
    let mut pair = started(EchoPolicy::Refuse);
    let told = |pair: &Pair| {
        pair.halves[1]
            .line_notes
            .iter()
            .any(|(_, note)| *note == LineNote::Down(LineFault::Echo))
    };
    assert!(told(&pair), "{:?}", pair.halves[1].line_notes);
    // It answers no more, so the other one knows that nobody could take over.
    pair.pass(SECOND * 70);
    assert_eq!(pair.core(0).report().standby.unwrap().listener, Some(false));
    // With another adapter it is as good as any.
    pair.halves[1].echoes = false;
    pair.unplug(1);
    pair.open(1);
    pair.pass(SECOND * 70);
    assert_eq!(pair.core(0).report().standby.unwrap().listener, Some(true));
    assert!(
        pair.core(1).report().fault != Some(LineFault::Echo),
        "{:?}",
        pair.core(1).report()
    );
}

#[test]
fn where_echoes_are_stripped_an_echoing_listener_is_no_trouble() {
    let mut pair = started(EchoPolicy::Strip);
    assert_eq!(pair.core(0).report().standby.unwrap().listener, Some(true));
    assert!(
        pair.halves[1]
            .line_notes
            .iter()
            .all(|(_, note)| !matches!(note, LineNote::Down(_)))
    );
    pair.kill(0);
    pair.pass(SECOND * 5);
    assert_eq!(pair.role(1), LineRole::Active);
}
