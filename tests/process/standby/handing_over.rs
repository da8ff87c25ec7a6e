//! A line is handed over on request and by a reload, and no motor stops. Where no other gateway answers, nothing changes.

use super::super::raw::Raw;
use super::super::rig::{assert_says, vfd_gateway};
use super::super::started::until;
use super::pair::{A, B, PATIENCE, Pair};
use super::{A_WHILE, running};
use std::process::Output;

/// The uniform register with the run state, and its numbers for a drive that runs forward, and one that others let run.
const RUN_STATE: u16 = 2;
const RUNS: [u16; 2] = [2, 6];

/// A command for the half at `end`.
fn ask(pair: &Pair, end: usize, words: &[&str]) -> Output {
    vfd_gateway(&[words, &["-c", pair.half(end).file.to_str().unwrap()]].concat())
}

/// Writes that went over the bus behind the first `seen` frames.
fn writes(pair: &Pair, seen: usize) -> usize {
    pair.orders(seen)
        .iter()
        .filter(|(_, station, ..)| (1..=2).contains(station))
        .count()
}

#[test]
fn a_line_is_handed_over_and_no_motor_stops() {
    let mut pair = running();
    assert_says(
        &ask(&pair, A, &["health", "--active"]),
        0,
        &["active on hall-1"],
    );
    assert_says(
        &ask(&pair, B, &["health", "--active"]),
        1,
        &["not active: it only listens on hall-1"],
    );
    assert_says(
        &ask(&pair, B, &["standby", "yield", "hall-1"]),
        1,
        &["this gateway does not send on the line"],
    );
    for unit in [101, 102] {
        until("the listener has seen that it runs", PATIENCE, || {
            let state = Raw::connect(pair.half(B).modbus).read_unit(unit, RUN_STATE, 1);
            RUNS.iter()
                .any(|runs| state == Ok(vec![*runs]))
                .then_some(())
        });
    }
    let seen = pair.hub.count();
    assert_says(
        &ask(&pair, A, &["standby", "yield"]),
        0,
        &["line hall-1: another gateway sends on the line now"],
    );
    pair.wait_for_requests(B, A_WHILE, seen);
    assert_eq!(writes(&pair, seen), 0, "{:?}", pair.orders(seen));
    pair.assert_turns(1);
    pair.assert_turns(2);
    assert_says(
        &ask(&pair, A, &["standby"]),
        0,
        &["a is listening; b sends; taken over 1, given up 1, rivals 0"],
    );
    let told = until("it knows that the other one listens", PATIENCE, || {
        let told = String::from_utf8(ask(&pair, B, &["standby"]).stdout).unwrap();
        (!told.contains("not known yet")).then_some(told)
    });
    assert!(
        told.contains("b is active; a would take over; taken over 1, given up 0, rivals 0"),
        "{told}"
    );
    assert_says(
        &ask(&pair, B, &["health", "--active"]),
        0,
        &["active on hall-1"],
    );
    let audit = ask(&pair, A, &["journal", "audit"]);
    assert_says(&audit, 0, &["standby yield hall-1", "confirmed"]);

    // A reload that restarts the line does the same.
    let file = pair.half(B).file.clone();
    let changed = std::fs::read_to_string(&file)
        .unwrap()
        .replace("poll = \"250ms\"", "poll = \"300ms\"");
    std::fs::write(&file, changed).unwrap();
    let seen = pair.hub.count();
    assert_says(&ask(&pair, B, &["reload"]), 0, &["hall-1"]);
    pair.wait_for_requests(A, A_WHILE, seen);
    assert_eq!(writes(&pair, seen), 0, "{:?}", pair.orders(seen));
    pair.assert_turns(1);
    pair.assert_turns(2);

    // Now the one that would be asked for an upgrade is alone: it goes on.
    pair.kill(B);
    let seen = pair.hub.count();
    let kept = "no other gateway answers on the line: nothing has changed; does b run, and listen?";
    assert_says(&ask(&pair, A, &["standby", "yield"]), 1, &[kept]);
    pair.wait_for_requests(A, A_WHILE, seen);
    assert_eq!(writes(&pair, seen), 0, "{:?}", pair.orders(seen));
    pair.assert_turns(1);
    pair.assert_one_master();
}
