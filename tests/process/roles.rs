//! `standby` and `health --active` against a gateway whose line, which it shares with another one, is played by the test.

use super::asking::served_from;
use super::rig::{Place, assert_says, vfd_gateway};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use vfd_gateway::daemon::exchange::inbox::LineMessage;
use vfd_gateway::daemon::exchange::shared::SharedLine;
use vfd_gateway::domain::report::{LineReport, LineState};
use vfd_gateway::domain::standby::{LineRole, StandbyReport, StandbyTrouble};

const ACTIVE: StandbyReport = StandbyReport {
    role: LineRole::Active,
    take_overs: 1,
    given_up: 0,
    rivals: 0,
    hears_other: false,
    listener: Some(true),
    kept: 0,
    trouble: StandbyTrouble {
        is_deaf: false,
        files_differ: false,
        unknown_station: None,
    },
};
pub const HEARS: StandbyReport = StandbyReport {
    role: LineRole::Listening,
    given_up: 1,
    hears_other: true,
    listener: None,
    ..ACTIVE
};
const BACK: StandbyReport = StandbyReport {
    take_overs: 2,
    given_up: 1,
    ..ACTIVE
};

fn show(line: &SharedLine, standby: StandbyReport) {
    line.set_report(LineReport {
        state: LineState::Up,
        standby: Some(standby),
        ..LineReport::default()
    });
}

/// Runs `done` while `line` does `then` each time that it is asked to give itself up.
fn while_played<T>(line: &Arc<SharedLine>, then: StandbyReport, done: impl FnOnce() -> T) -> T {
    let (ends, played) = (Arc::new(AtomicBool::new(false)), Arc::clone(line));
    let has_ended = Arc::clone(&ends);
    let thread = std::thread::spawn(move || {
        let mut batch = Vec::new();
        while !has_ended.load(Ordering::SeqCst) {
            played.inbox.take(&mut batch);
            for message in batch.drain(..) {
                assert!(matches!(message, LineMessage::Yield), "{message:?}");
                show(&played, then);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    let found = done();
    ends.store(true, Ordering::SeqCst);
    thread.join().unwrap();
    found
}

#[test]
fn the_role_is_told_and_a_line_is_handed_over_on_request() {
    let place = Place::new();
    let (_, state) = served_from(&place.file(""), "standby = true");
    let line = Arc::clone(&state.shared.load().lines[0]);
    let socket = place.file("vfd-gateway.sock");
    let ask =
        |words: &[&str]| vfd_gateway(&[words, &["--socket", socket.to_str().unwrap()]].concat());

    show(&line, ACTIVE);
    assert_says(&ask(&["health", "--active"]), 0, &["active on hall-1"]);
    assert_says(
        &ask(&["standby"]),
        0,
        &["line hall-1: a is active; b would take over; taken over 1"],
    );
    let handed = while_played(&line, HEARS, || ask(&["standby", "yield", "hall-1"]));
    assert_says(
        &handed,
        0,
        &["line hall-1: another gateway sends on the line now"],
    );

    assert_says(
        &ask(&["health", "--active"]),
        1,
        &["not active: it only listens on hall-1"],
    );
    assert_says(
        &ask(&["standby", "status"]),
        0,
        &["line hall-1: a is listening; b sends"],
    );
    assert_says(
        &ask(&["standby", "status", "--json"]),
        0,
        &["\"role\":\"listening\"", "\"partner\":\"b\""],
    );
    assert_says(
        &ask(&["standby", "yield", "hall-1"]),
        1,
        &["this gateway does not send on the line"],
    );
    assert_says(
        &ask(&["standby", "yield"]),
        0,
        &["this gateway does not send on the line"],
    );
    assert_says(
        &ask(&["standby", "yield", "hall-2"]),
        2,
        &["there is no line `hall-2`; the lines are hall-1"],
    );

    show(&line, ACTIVE);
    let taken_back = while_played(&line, BACK, || ask(&["standby", "yield"]));
    assert_says(
        &taken_back,
        1,
        &["no other gateway took the line over: this one takes it back; does b run?"],
    );
}

#[test]
fn a_gateway_that_is_alone_is_active_and_has_nothing_to_hand_over() {
    let place = Place::new();
    let (_, state) = served_from(&place.file(""), "");
    let line = Arc::clone(&state.shared.load().lines[0]);
    line.set_report(LineReport {
        state: LineState::Up,
        ..LineReport::default()
    });
    let socket = place.file("vfd-gateway.sock");
    let ask =
        |words: &[&str]| vfd_gateway(&[words, &["--socket", socket.to_str().unwrap()]].concat());
    assert_says(&ask(&["health", "--active"]), 0, &["active on hall-1"]);
    assert_says(&ask(&["standby"]), 0, &["line hall-1: no second gateway"]);
    assert_says(
        &ask(&["standby", "yield"]),
        0,
        &["there is nothing to hand over"],
    );
    assert_says(
        &ask(&["standby", "yield", "hall-1"]),
        1,
        &["the line has no second gateway"],
    );
    line.set_report(LineReport::default());
    assert_says(&ask(&["health", "--active"]), 1, &["no line can be used"]);
}
