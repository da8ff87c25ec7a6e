//! A start in several words: each goes out once the drive has followed the one before, a stop in between is the last word,
//! and no run word is left behind that the drive would obey later.

use crate::support::families::{accepting, options_of, rig_of};
use crate::support::{MQTT, ORIGIN, Rig, RigOptions, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason, RunIntent};
use vfd_gateway::domain::ids::{Station, Ticket};
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::Model;

const SECOND: Duration = Duration::from_secs(1);
const START: &str = include_str!("../golden/models/start.toml");
const RUN: u16 = 0x2000;
const STATUS: u16 = 0x2100;
const CAUSE: u16 = 2;

const SHUT_DOWN: u16 = 0x0006;
/// Also the stop.
const SWITCH_ON: u16 = 0x0007;
const FORWARD: u16 = 0x000F;
const REVERSE: u16 = 0x080F;

fn model() -> Arc<Model> {
    Arc::new(check::model(START).unwrap())
}

/// A rig whose drive was stopped, has a setpoint and has shown everything.
fn ready_as(really: Option<Arc<Model>>) -> Rig {
    let options = RigOptions {
        really,
        ..options_of(&model(), accepting())
    };
    let mut rig = Rig::new(&options);
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
    rig.live(SECOND * 3);
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Confirmed, Reason::None)
    );
    rig.sent.clear();
    rig
}

fn ready() -> Rig {
    ready_as(None)
}

fn hold_back(rig: &mut Rig, is_held_back: bool) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .hold_back(now, is_held_back);
}

fn held(rig: &mut Rig) -> Option<u16> {
    rig.bus.drive_mut(Station(1)).unwrap().word(RUN.into())
}

/// Orders RUN, and lets time pass until `word` was sent.
fn run_up_to(rig: &mut Rig, word: u16) -> Ticket {
    let ticket = rig.command(MQTT, 0, run(Direction::Forward, None));
    while rig.written(RUN).last() != Some(&word) {
        assert!(rig.step(rig.now + SECOND * 5), "{:04X?}", rig.written(RUN));
    }
    ticket
}

/// Whatever comes later, the motor does not start.
fn stays_at_rest(rig: &mut Rig) {
    hold_back(rig, false);
    rig.live(SECOND * 20);
    assert_eq!(rig.output(1), 0, "{:04X?}", rig.written(RUN));
    assert!(!matches!(
        rig.view(0).control.unwrap().intent,
        RunIntent::Run(_)
    ));
}

#[test]
fn each_word_waits_for_the_one_before_and_a_running_drive_gets_the_run_word_only() {
    let mut rig = ready();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [SHUT_DOWN, SWITCH_ON, FORWARD]);
    let pdus: Vec<&[u8]> = rig.sent.iter().map(|sent| sent.pdu.as_slice()).collect();
    let at = pdus
        .iter()
        .position(|pdu| *pdu == [6, 0x20, 0, 0, 7])
        .unwrap();
    assert_eq!(
        pdus[at + 1],
        [3, 0x21, 0, 0, 1],
        "the status is read before the run word"
    );
    let gap = rig.sent[at + 1].at.since(rig.sent[at].at);
    assert!((100..130).contains(&gap.as_millis()), "{gap:?}");
    rig.live(SECOND * 4);
    assert!(rig.output(1) > 0);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [FORWARD]);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [SWITCH_ON], "a stop is one frame");
    rig.live(SECOND * 15);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Reverse, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.written(RUN),
        [SWITCH_ON, REVERSE],
        "it is switched on still"
    );
    rig.live(SECOND * 4);
    assert!(rig.output(1) < 0);
}

/// A drive whose `running` is off although the motor still turns: its status shows the order only. The first word of the start
/// would cut its output off.
#[test]
fn a_run_during_the_ramp_of_a_stop_cuts_nothing_off() {
    let mut rig = ready();
    rig.bus.drive_mut(Station(1)).unwrap().show_orders();
    rig.commanded(MQTT, run(Direction::Forward, None));
    rig.live(SECOND * 8);
    let speed = rig.output(1);
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    // As long as `restart_delay` asks for.
    rig.live(SECOND * 13 / 4);
    let ramping = rig.output(1);
    assert!(ramping > 0 && ramping < speed, "{ramping} of {speed}");
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.written(RUN),
        [SWITCH_ON, FORWARD],
        "the stop word changes nothing during a stop"
    );
    assert!(
        rig.output(1) > ramping / 2,
        "{} of {ramping}",
        rig.output(1)
    );
    rig.live(SECOND * 8);
    assert_eq!(rig.output(1), speed);
}

#[test]
fn a_drive_that_is_switched_on_at_standstill_is_not_switched_off_first() {
    let mut rig = ready();
    rig.commanded(MQTT, run(Direction::Forward, None));
    rig.live(SECOND * 4);
    rig.commanded(MQTT, STOP);
    rig.live(SECOND * 20);
    assert_eq!(rig.output(1), 0);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [SWITCH_ON, FORWARD]);
    rig.live(SECOND * 4);
    assert!(rig.output(1) > 0);
}

#[test]
fn the_drive_tells_its_own_state_in_its_own_words() {
    let told = |rig: &mut Rig| {
        rig.live(SECOND * 2);
        let view = rig.view(0);
        let model = model();
        let reading = view
            .snapshot
            .value(model.state_register().unwrap())
            .unwrap();
        model.drive_state(reading.raw)
    };
    let mut rig = ready();
    assert_eq!(told(&mut rig), None, "0 is no state that the model knows");
    rig.commanded(MQTT, run(Direction::Forward, None));
    assert_eq!(told(&mut rig).as_deref(), Some("operation enabled"));
    rig.commanded(MQTT, STOP);
    rig.live(SECOND * 15);
    assert_eq!(told(&mut rig).as_deref(), Some("switched on"));
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
    assert_eq!(told(&mut rig).as_deref(), Some("fault (inferred)"));
}

#[test]
fn a_drive_that_does_not_get_ready_is_not_started_now_or_later() {
    let mut rig = ready();
    hold_back(&mut rig, true);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Failed, Reason::NotReady)
    );
    let last = rig.view(0).control.unwrap().last.unwrap();
    // "Switch on disabled", in which it rests.
    assert_eq!(
        (last.register, last.held),
        (Some(STATUS.into()), Some(0x40)),
        "{}",
        last.message()
    );
    rig.live(SECOND);
    assert_eq!(
        rig.written(RUN),
        [SHUT_DOWN, SHUT_DOWN],
        "the second takes it back"
    );
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::StartTakenBack)
    );
    stays_at_rest(&mut rig);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None),
        "a new order"
    );
}

#[test]
fn a_held_run_is_not_tried_again_and_again() {
    let mut rig = rig_of(&model(), accepting());
    rig.commanded(ORIGIN, STOP);
    rig.pass(SECOND * 3);
    hold_back(&mut rig, true);
    let order = run(Direction::Forward, Some(3000));
    assert_eq!(
        rig.commanded(ORIGIN, order.clone()),
        (Outcome::Failed, Reason::NotReady)
    );
    hold_back(&mut rig, false);
    for _ in 0..5 {
        rig.pass(SECOND / 2);
        assert_eq!(
            rig.commanded(ORIGIN, order.clone()),
            (Outcome::Refused, Reason::StartInhibited)
        );
    }
    assert_eq!(rig.output(1), 0);
    rig.commanded(ORIGIN, STOP);
    rig.pass(SECOND);
    assert_eq!(
        rig.commanded(ORIGIN, order),
        (Outcome::Confirmed, Reason::None)
    );
}

#[test]
fn a_stop_between_two_words_is_the_last_word() {
    for word in [SHUT_DOWN, SWITCH_ON, FORWARD] {
        let mut rig = ready();
        let start = run_up_to(&mut rig, word);
        let sent = rig.written(RUN).len();
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None),
            "{word:04X}"
        );
        assert_eq!(
            rig.outcome_of(start),
            (Outcome::Superseded, Reason::Stopped),
            "{word:04X}"
        );
        rig.live(SECOND * 10);
        assert_eq!(
            rig.written(RUN)[sent..],
            [SWITCH_ON],
            "{word:04X}: the stop, and nothing after it"
        );
        stays_at_rest(&mut rig);
    }
}

#[test]
fn a_word_without_an_answer_ends_the_start() {
    for (word, before) in [(SHUT_DOWN, 1), (SWITCH_ON, 2), (FORWARD, 3)] {
        let mut rig = ready();
        rig.swallows = Some(vec![6, 0x20, 0, 0, word.to_be_bytes()[1]]);
        let start = rig.command(MQTT, 0, run(Direction::Forward, None));
        assert_eq!(
            rig.outcome_of(start),
            (Outcome::Failed, Reason::NoReply),
            "{word:04X}"
        );
        rig.swallows = None;
        rig.live(SECOND * 7);
        let written = rig.written(RUN);
        assert!(written[..before].ends_with(&[word]), "{written:04X?}");
        assert!(
            written[before..].iter().all(|it| *it == SHUT_DOWN),
            "{written:04X?}"
        );
        assert_eq!(held(&mut rig), Some(SHUT_DOWN), "taken back");
        stays_at_rest(&mut rig);
    }
}

#[test]
fn a_run_word_that_the_drive_does_not_follow_is_taken_back() {
    // It waits for one more word that no document tells of.
    let mut really = Model::clone(&model());
    let steps = &mut really.run.as_mut().unwrap().start.steps;
    let mut one_more = steps[1].clone();
    one_more.write.value = 0x0100;
    steps.push(one_more);
    let mut rig = ready_as(Some(Arc::new(really)));
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Failed, Reason::NotReadBack)
    );
    rig.live(SECOND);
    assert_eq!(rig.written(RUN), [SHUT_DOWN, SWITCH_ON, FORWARD, SHUT_DOWN]);
    stays_at_rest(&mut rig);
}

#[test]
fn a_trip_in_the_middle_ends_the_start() {
    let mut rig = ready();
    let start = run_up_to(&mut rig, SHUT_DOWN);
    rig.step(rig.now + SECOND);
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
    let (outcome, reason) = rig.outcome_of(start);
    assert!(
        matches!(reason, Reason::Tripped | Reason::NotReady),
        "{outcome:?} {reason:?}"
    );
    rig.live(SECOND * 3);
    assert_eq!(rig.view(0).run_state, RunState::Tripped);
    assert!(
        !rig.written(RUN).contains(&FORWARD),
        "{:04X?}",
        rig.written(RUN)
    );
    // Somebody resets it at the panel.
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().clear_trip(now, None);
    stays_at_rest(&mut rig);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)).0,
        Outcome::Confirmed
    );
}

#[test]
fn a_start_is_taken_back_once_the_drive_answers_again() {
    let mut rig = ready();
    // The run word arrives, and the drive is not heard of again for a while.
    run_up_to(&mut rig, SWITCH_ON);
    hold_back(&mut rig, true);
    rig.swallows = Some(vec![6, 0x20, 0, 0, 6]);
    rig.live(SECOND * 12);
    assert_eq!(held(&mut rig), Some(SWITCH_ON));
    rig.swallows = None;
    rig.live(SECOND * 6);
    assert_eq!(held(&mut rig), Some(SHUT_DOWN), "{:04X?}", rig.written(RUN));
    let count = rig.written(RUN).len();
    rig.live(SECOND * 20);
    assert_eq!(rig.written(RUN).len(), count, "and then no more");
}

#[test]
fn a_reset_and_a_start_after_it_are_whole() {
    let mut rig = ready();
    rig.commanded(MQTT, run(Direction::Forward, None));
    rig.live(SECOND * 3);
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
    rig.live(SECOND * 3);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, Order::Reset),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [SWITCH_ON, 0x0080, SWITCH_ON]);
    rig.live(SECOND * 3);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [SHUT_DOWN, SWITCH_ON, FORWARD]);
}

/// A start whose word is seen in the register that it was written to.
fn by_its_own_word() -> Arc<Model> {
    let (begin, end) = (
        START.find("[[run.start]]").unwrap(),
        START.find("[[run.state]]").unwrap(),
    );
    let step = "[[run.start]]\nwrite = 0x0006\nuntil = { register = \"run\", values = [0x0006] }\nwithin = \"2s\"\n\
                confidence = \"manual\"\nsource = \"IM 5\"\n\n";
    Arc::new(check::model(&[&START[..begin], step, &START[end..]].concat()).unwrap())
}

#[test]
fn a_start_that_is_seen_in_its_own_register_goes_by_what_that_holds() {
    let mut rig = rig_of(&by_its_own_word(), accepting());
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
    rig.live(SECOND * 3);
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Confirmed, Reason::None)
    );
    // Somebody else wrote the word, before the gateway was there.
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, RUN.into(), SHUT_DOWN);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, None)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.written(RUN),
        [FORWARD],
        "the run word is a change already"
    );
    rig.live(SECOND * 4);
    assert!(rig.output(1) > 0);
}

#[test]
fn a_word_that_was_followed_once_does_not_count_when_another_stands_in_its_register() {
    let mut rig = rig_of(&by_its_own_word(), accepting());
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Confirmed, Reason::None)
    );
    for before in ["a first start", "a stop", "a trip"] {
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, None)),
            (Outcome::Confirmed, Reason::None),
            "{before}"
        );
        assert_eq!(rig.written(RUN), [SHUT_DOWN, FORWARD], "after {before}");
        rig.live(SECOND * 4);
        assert!(rig.output(1) > 0, "after {before}");
        let now = rig.now;
        if before == "a stop" {
            rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
            rig.live(SECOND * 3);
            let now = rig.now;
            // Reset at the panel, and the run word stands.
            rig.bus.drive_mut(Station(1)).unwrap().clear_trip(now, None);
            rig.bus
                .drive_mut(Station(1))
                .unwrap()
                .set_locally(now, RUN.into(), FORWARD);
            rig.live(SECOND * 3);
            assert_eq!(rig.output(1), 0);
            assert_eq!(rig.view(0).run_state, RunState::Stopped);
        } else {
            assert_eq!(
                rig.commanded(MQTT, STOP),
                (Outcome::Confirmed, Reason::None)
            );
            rig.live(SECOND * 15);
        }
    }
}
