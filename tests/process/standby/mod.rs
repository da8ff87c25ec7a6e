//! Two real gateways on one bus: when one is killed, hangs or is unplugged, the other one takes the line and does what is
//! declared; there are never two masters, and nothing starts by itself.

mod broker;
mod edge_node;
mod handing_over;
mod measure;
mod page;
mod pair;
mod trouble;
mod virtual_address;
mod watching;

use super::hub::meetings;
use super::raw::Raw;
use super::started::until;
use pair::{A, B, PATIENCE, Pair, REASON, Wish, orders, other, requests};
use std::io::Write;
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::command::Reason;

/// No listener takes a line sooner, whatever is configured.
const LISTENS_AT_LEAST: Duration = Duration::from_secs(2);
/// The uniform register with the output frequency in 0.01 Hz.
const OUTPUT: u16 = 4;
/// So many requests of the active one are a few seconds in which the other had time to speak.
const A_WHILE: usize = 60;

/// A pair whose active half, the first one, runs both drives.
fn running() -> Pair {
    let mut pair = Pair::new(9_600);
    pair.start_one_behind_the_other();
    pair.run(A, 1);
    pair.run(A, 2);
    pair
}

/// The other half stops station 1 and leaves station 2 alone, behind the first `seen` frames, and nothing else.
fn the_declared_actions_follow(pair: &Pair, seen: usize) {
    pair.wait_for_stop(B, seen);
    pair.wait_until_it_stands(1);
    pair.wait_for_requests(B, A_WHILE, seen);
    pair.assert_only_stopped_by(B, seen);
    pair.assert_turns(2);
}

/// Waits until B has taken over the line that A had; returns how many frames went over the bus until then. The last one of A
/// may still have been under way when it was lost, behind the first `seen` frames.
fn taken_over(pair: &Pair, seen: usize) -> usize {
    pair.wait_for_stop(B, seen);
    pair.hub.count()
}

#[test]
fn what_a_killed_gateway_has_left_running_is_stopped_by_the_other() {
    let mut pair = running();
    pair.kill(A);
    let seen = pair.hub.count();
    let taken = taken_over(&pair, seen);
    the_declared_actions_follow(&pair, seen);
    pair.assert_silent(A, taken..);
    // It is back, and the other one goes on.
    let back = pair.hub.count();
    pair.start(A);
    pair.wait_for_requests(B, A_WHILE, back);
    pair.assert_silent(A, back..);
    pair.assert_only_stopped_by(B, seen);
    // Commands are taken where the line is, and nowhere else.
    pair.run(B, 1);
    pair.assert_one_master();
    // And once more, in the other direction.
    pair.kill(B);
    let seen = pair.hub.count();
    pair.wait_for_stop(A, seen);
    pair.wait_until_it_stands(1);
    pair.assert_only_stopped_by(A, seen);
    pair.assert_turns(2);
    pair.assert_one_master();
}

#[test]
fn a_gateway_that_hung_for_seconds_sends_nothing_when_it_goes_on() {
    let pair = running();
    pair.program(A).signal("STOP");
    let seen = pair.hub.count();
    // It hangs for longer than the other one waits.
    let taken = taken_over(&pair, seen);
    pair.program(A).signal("CONT");
    the_declared_actions_follow(&pair, seen);
    pair.assert_silent(A, taken..);
    pair.assert_one_master();
}

#[test]
fn a_gateway_that_hung_alone_listens_before_it_sends_again() {
    let mut pair = Pair::new(38_400);
    pair.start(A);
    assert_eq!(pair.wait_for_master(0), A);
    pair.run(A, 1);
    pair.program(A).signal("STOP");
    std::thread::sleep(Duration::from_secs(4));
    let (goes_on, seen) = (clock::now(), pair.hub.count());
    pair.program(A).signal("CONT");
    pair.wait_for_requests(A, 1, seen);
    let first = pair
        .hub
        .frames(seen)
        .into_iter()
        .find(|frame| frame.from == A)
        .unwrap();
    assert!(
        first.start.since(goes_on) >= LISTENS_AT_LEAST,
        "{first:?}, it goes on at {goes_on:?}"
    );
}

#[test]
fn a_gateway_whose_adapter_is_out_has_lost_the_line() {
    let pair = running();
    pair.hub.pull_out(A);
    let seen = pair.hub.count();
    let taken = taken_over(&pair, seen);
    the_declared_actions_follow(&pair, seen);
    pair.hub.plug_in(A);
    pair.half(A).wait_until_its_line_is_up(2);
    let back = pair.hub.count();
    pair.wait_for_requests(B, A_WHILE, back);
    pair.assert_silent(A, taken..);
    pair.assert_one_master();
}

#[test]
fn of_two_that_start_at_once_one_becomes_active() {
    let mut pair = Pair::new(9_600);
    pair.hub.pull_out(A);
    pair.hub.pull_out(B);
    pair.start_without_ports();
    // Their ports come at the same moment.
    pair.hub.plug_in(A);
    pair.hub.plug_in(B);
    let active = pair.wait_for_master(0);
    let seen = pair.hub.count();
    pair.wait_for_requests(active, A_WHILE, seen);
    pair.assert_silent(other(active), seen..);
    assert_eq!(pair.orders(0), [], "a start moves nothing");
    pair.assert_one_master();
}

#[test]
fn a_listener_refuses_commands_by_its_reason_and_shows_what_it_hears() {
    let pair = running();
    let seen = pair.hub.count();
    for (register, word) in [(256, 1), (257, 4000), (256, 2)] {
        let refused = pair.write(B, 2, register, word);
        assert!(refused.is_err(), "{word} to {register}: {refused:?}");
        let mut client = Raw::connect(pair.half(B).modbus);
        let reason = client.read_unit(102, REASON, 1);
        assert_eq!(
            reason,
            Ok(vec![Reason::Standby.number()]),
            "{word} to {register}"
        );
    }
    pair.wait_for_requests(A, A_WHILE, seen);
    assert_eq!(pair.orders(seen), []);
    pair.assert_silent(B, 0..);
    pair.assert_turns(2);
    // What the drive says to the one is seen at the other.
    let output = |end: usize| Raw::connect(pair.half(end).modbus).read_unit(102, OUTPUT, 1);
    until("both show the same output", PATIENCE, || {
        (matches!(output(A).as_deref(), Ok([3000])) && output(B) == output(A)).then_some(())
    });
    // So are registers of the drive itself, after orders that were heard.
    until(
        "a native read is answered from what was heard",
        PATIENCE,
        || {
            Raw::connect(pair.half(B).modbus)
                .read_unit(2, 0x0101, 1)
                .ok()
        },
    );
}

/// Where the pair is cut between them, both are masters of their own half. Nothing is promised then, but it must end well.
#[test]
fn when_a_cut_pair_is_whole_again_one_of_the_two_masters_leaves() {
    let pair = running();
    pair.hub.cut_behind(1);
    let seen = pair.hub.count();
    pair.wait_for_requests(B, 4, seen);
    pair.wait_for_requests(A, A_WHILE, seen);
    pair.hub.repair();
    let seen = pair.hub.count();
    let active = pair.wait_for_master_for(Duration::from_secs(4), seen);
    let left = pair.hub.count();
    pair.wait_for_requests(active, A_WHILE, left);
    // A stop whose effect it has not seen goes out from the other one, too.
    let mut rest = requests(pair.hub.frames(left));
    rest.retain(|frame| frame.from == other(active));
    assert_eq!(
        orders(rest.clone()).len(),
        rest.len(),
        "stops at most: {rest:?}"
    );
    let met = meetings(&pair.hub.frames(seen), &[A, B]);
    println!("{met:?}");
    if std::env::var("TELL").is_ok() {
        println!("{}", pair.told(pair.hub.frames(seen)));
    }
    assert!(
        pair.orders(seen).iter().all(|order| order.3 == 0),
        "no motion: {:?}",
        pair.orders(seen)
    );
}

#[test]
fn adapters_that_hear_themselves_make_no_rivals() {
    let mut pair = Pair::with(Wish {
        echoes: true,
        ..Wish::at(9_600)
    });
    pair.start_one_behind_the_other();
    pair.run(A, 1);
    pair.kill(A);
    let seen = pair.hub.count();
    pair.wait_for_stop(B, seen);
    pair.wait_until_it_stands(1);
    pair.wait_for_requests(B, A_WHILE, seen);
    pair.assert_only_stopped_by(B, seen);
    pair.assert_silent(B, 0..seen);
    pair.assert_one_master();
}

/// USB adapters hand over what they have every few milliseconds, wherever a frame is then: at 9600 bit/s and 6 ms each
/// request comes in pieces, with longer holes than the silence between frames.
#[test]
fn a_listener_understands_frames_that_come_in_pieces() {
    for (baud, hold_back_ms) in [(9_600, 6), (38_400, 16)] {
        let mut pair = Pair::with(Wish {
            hold_back: Duration::from_millis(hold_back_ms),
            ..Wish::at(baud)
        });
        pair.start_one_behind_the_other();
        pair.run(A, 1);
        let seen = pair.hub.count();
        pair.wait_for_requests(A, A_WHILE, seen);
        pair.assert_silent(B, 0..);
        pair.kill(A);
        let seen = pair.hub.count();
        pair.wait_for_stop(B, seen);
        pair.wait_until_it_stands(1);
        pair.assert_only_stopped_by(B, seen);
        pair.assert_one_master();
    }
}

#[test]
fn where_no_drive_answers_there_is_one_master_at_a_time() {
    let mut pair = Pair::with(Wish {
        drives_are_off: true,
        ..Wish::at(9_600)
    });
    pair.start_one_behind_the_other();
    std::thread::sleep(Duration::from_secs(30));
    pair.assert_one_master();
}

#[test]
fn a_master_that_is_no_gateway_gets_the_line_and_is_named() {
    let pair = running();
    let mut foreign = pair.foreign();
    // A read of station 1. One that falls into a frame of the active gateway is not heard.
    let said = || pair.program(A).text().contains("rival_on_line");
    until("the rival is named", PATIENCE, || {
        foreign.write_all(&[1, 3, 1, 1, 0, 1, 0xD4, 0x36]).unwrap();
        std::thread::sleep(Duration::from_millis(97));
        said().then_some(())
    });
    let seen = pair.hub.count();
    for _ in 0..60 {
        foreign.write_all(&[1, 3, 1, 1, 0, 1, 0xD4, 0x36]).unwrap();
        std::thread::sleep(Duration::from_millis(97));
    }
    let until = pair.hub.count();
    pair.assert_silent(A, seen..until);
    pair.assert_silent(B, seen..until);
    // When it is silent, one of the two takes the line again.
    pair.wait_for_master(until);
    pair.assert_one_master();
}
