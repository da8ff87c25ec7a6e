//! Starts and resets that wait for nothing but time: the next word goes out after its pause and not before, and a stop in a
//! pause is the last word.

use crate::support::families::{accepting, options_of};
use crate::support::{MQTT, Rig, RigOptions, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::Model;

const SECOND: Duration = Duration::from_secs(1);
const BY_TIME: &str = include_str!("../golden/models/by-time.toml");
const ORDERS: &str = include_str!("../golden/models/orders.toml");
const RUN: u16 = 0x2000;
const RESET: u16 = 0x2002;
const CAUSE: u16 = 2;

/// Also the only word of the start.
const OFF: u16 = 0x047E;
const ON: u16 = 0x047F;
const ACKNOWLEDGE: u16 = 0x04FE;

fn model() -> Arc<Model> {
    Arc::new(check::model(BY_TIME).unwrap())
}

/// Orders in registers of their own; the reset word must stand for a second.
fn apart() -> Arc<Model> {
    let reset = "reset = { register = \"fault_reset\"";
    let set = "{ register = \"fault_reset\", value = 1, wait = \"1s\" }";
    let sequence = format!(
        "reset_sequence = [0, {set}, {{ register = \"fault_reset\", value = 0 }}]\n{reset}"
    );
    Arc::new(check::model(&ORDERS.replace(reset, &sequence)).unwrap())
}

/// A rig whose drive was stopped, has a setpoint and has shown everything.
fn ready(model: &Arc<Model>, really: Option<Arc<Model>>) -> Rig {
    let mut rig = Rig::new(&RigOptions {
        really,
        ..options_of(model, accepting())
    });
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
    rig.live(SECOND * 3);
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Confirmed, Reason::None)
    );
    rig.sent.clear();
    rig
}

fn trip(rig: &mut Rig) {
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
    rig.live(SECOND * 3);
    assert_eq!(rig.view(0).run_state, RunState::Tripped);
    rig.sent.clear();
}

/// The words written so far, each with its register.
fn orders(rig: &Rig) -> Vec<(u16, u16)> {
    let word = |pdu: &[u8], at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
    rig.sent
        .iter()
        .filter(|sent| sent.pdu[0] == 6)
        .map(|sent| (word(&sent.pdu, 1), word(&sent.pdu, 3)))
        .collect()
}

/// Time between the writes with these numbers.
fn between(rig: &Rig, first: usize, second: usize) -> Duration {
    let writes: Vec<_> = rig.sent.iter().filter(|sent| sent.pdu[0] == 6).collect();
    writes[second].at.since(writes[first].at)
}

/// Lets time pass until `word` was written to `register`.
fn up_to(rig: &mut Rig, register: u16, word: u16) {
    while orders(rig).last() != Some(&(register, word)) {
        assert!(rig.step(rig.now + SECOND * 5), "{:04X?}", orders(rig));
    }
}

#[test]
fn the_run_word_follows_after_its_pause() {
    let mut rig = ready(&model(), None);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [OFF, ON]);
    let pause = between(&rig, 0, 1);
    assert!((100..200).contains(&pause.as_millis()), "{pause:?}");
    rig.live(SECOND * 4);
    assert!(rig.output(1) > 0);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [ON], "it runs already");
}

#[test]
fn a_run_during_the_ramp_of_a_stop_cuts_nothing_off() {
    let mut rig = ready(&model(), None);
    rig.bus.drive_mut(Station(1)).unwrap().show_orders();
    rig.commanded(MQTT, run(Direction::Forward, None));
    rig.live(SECOND * 8);
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    // As long as `restart_delay` asks for.
    rig.live(SECOND * 13 / 4);
    let ramping = rig.output(1);
    assert!(ramping > 0);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [OFF, ON]);
    assert!(
        rig.output(1) > ramping / 2,
        "{} of {ramping}",
        rig.output(1)
    );
}

#[test]
fn a_stop_in_the_pause_of_a_start_is_the_last_word() {
    let mut rig = ready(&model(), None);
    let start = rig.command(MQTT, 0, run(Direction::Forward, None));
    up_to(&mut rig, RUN, OFF);
    let ordered = rig.now;
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.outcome_of(start),
        (Outcome::Superseded, Reason::Stopped)
    );
    let stop = rig
        .sent
        .iter()
        .filter(|sent| sent.pdu[0] == 6)
        .nth(1)
        .unwrap();
    assert!(
        stop.at.since(ordered) < Duration::from_millis(60),
        "it waits for no pause"
    );
    rig.live(SECOND * 20);
    assert_eq!(rig.written(RUN), [OFF, OFF]);
    assert_eq!(rig.output(1), 0);
}

#[test]
fn a_drive_that_takes_longer_than_its_file_says_is_not_started_later() {
    let mut really = Model::clone(&model());
    really.run.as_mut().unwrap().start.steps[0].at_least = SECOND;
    let mut rig = ready(&model(), Some(Arc::new(really)));
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Failed, Reason::NotReadBack)
    );
    rig.live(SECOND * 20);
    assert_eq!(rig.written(RUN), [OFF, ON, OFF], "the start is taken back");
    assert_eq!(rig.output(1), 0);
}

#[test]
fn a_reset_word_stands_for_its_pause() {
    let mut rig = ready(&model(), None);
    trip(&mut rig);
    assert_eq!(
        rig.commanded(MQTT, Order::Reset),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [OFF, ACKNOWLEDGE, OFF]);
    assert!(between(&rig, 0, 1) < Duration::from_millis(150));
    let pause = between(&rig, 1, 2);
    assert!((200..300).contains(&pause.as_millis()), "{pause:?}");

    let mut rig = ready(&apart(), None);
    trip(&mut rig);
    assert_eq!(
        rig.commanded(MQTT, Order::Reset),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(orders(&rig), [(RUN, 0), (RESET, 1), (RESET, 0)]);
    assert!(between(&rig, 1, 2) >= SECOND, "{:?}", between(&rig, 1, 2));
}

#[test]
fn a_stop_in_the_pause_of_a_reset_voids_its_rest() {
    let mut rig = ready(&model(), None);
    trip(&mut rig);
    let reset = rig.command(MQTT, 0, Order::Reset);
    up_to(&mut rig, RUN, ACKNOWLEDGE);
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.outcome_of(reset),
        (Outcome::Superseded, Reason::Stopped)
    );
    rig.live(SECOND * 10);
    assert_eq!(
        rig.written(RUN),
        [OFF, ACKNOWLEDGE, OFF],
        "the stop also clears the reset word"
    );

    let mut rig = ready(&apart(), None);
    trip(&mut rig);
    rig.command(MQTT, 0, Order::Reset);
    up_to(&mut rig, RESET, 1);
    rig.commanded(MQTT, STOP);
    rig.live(SECOND * 10);
    assert_eq!(
        orders(&rig),
        [(RUN, 0), (RESET, 1), (RUN, 0), (RESET, 0)],
        "what stands is cleared"
    );
}

#[test]
fn a_reset_word_that_stands_too_short_resets_nothing() {
    let mut really = Model::clone(&model());
    really.run.as_mut().unwrap().reset_sequence[1].wait = SECOND;
    let mut rig = ready(&model(), Some(Arc::new(really)));
    trip(&mut rig);
    assert_eq!(
        rig.commanded(MQTT, Order::Reset),
        (Outcome::Failed, Reason::NotReadBack)
    );
    rig.live(SECOND * 3);
    assert_eq!(rig.view(0).run_state, RunState::Tripped);
}

#[test]
fn a_reset_word_without_an_answer_is_followed_by_the_rest_after_its_pause() {
    let mut rig = ready(&apart(), None);
    trip(&mut rig);
    rig.swallows = Some(vec![6, 0x20, 0x02, 0, 1]);
    let reset = rig.command(MQTT, 0, Order::Reset);
    up_to(&mut rig, RESET, 0);
    rig.swallows = None;
    assert!(between(&rig, 1, 2) >= SECOND, "{:?}", between(&rig, 1, 2));
    let (outcome, _) = rig.outcome_of(reset);
    assert!(
        matches!(outcome, Outcome::Failed | Outcome::Unknown),
        "{outcome:?}"
    );
}
