//! Drives that are read word by word: every reply could be the late answer to every other read. The barrier is a loop
//! test, or a function that the drive refuses.

use crate::support::{MQTT, PROOF, Rig, RigOptions, STOP, control, model, n700, run};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::profile::model::{Barrier, Confidence, Fact, Model};
use vfd_gateway::sim::{BadRequest, FaultPlan};

const LOOP_TEST: u8 = 8;
/// How late a reply may be.
const MAX_LATENESS: Duration = Duration::from_millis(500);

fn fact<T>(value: T, confidence: Confidence) -> Fact<T> {
    Fact {
        value,
        confidence,
        source: "a test".to_owned(),
    }
}

/// A drive that is read word by word, with one barrier. It serves the loop test if that is it.
fn word_by_word(barrier: Barrier) -> Arc<Model> {
    let mut model = Model::clone(&n700());
    model.read.max_words.value = 1;
    if matches!(barrier, Barrier::Loop(_)) {
        model.functions.value.push(LOOP_TEST);
    }
    model.barriers = vec![barrier];
    Arc::new(model)
}

fn loop_test(confidence: Confidence) -> Arc<Model> {
    word_by_word(Barrier::Loop(fact((), confidence)))
}

fn refusing() -> Arc<Model> {
    word_by_word(Barrier::Refused(fact(LOOP_TEST, Confidence::Inferred)))
}

fn options(model: Arc<Model>, bad_request: BadRequest) -> RigOptions {
    RigOptions {
        link: model.link.played(),
        model,
        bad_request,
        ..RigOptions::default()
    }
}

/// The functions of the frames sent so far.
fn functions(rig: &Rig) -> Vec<u8> {
    rig.sent.iter().map(|sent| sent.frame[1]).collect()
}

fn loop_tests(rig: &Rig) -> usize {
    functions(rig)
        .iter()
        .filter(|function| **function == LOOP_TEST)
        .count()
}

/// Reads a word whose reply is lost, then one whose reply arrives; returns how long after the time-out the latter was
/// sent.
fn waited_after_a_lost_reply(rig: &mut Rig) -> Duration {
    rig.loses_reply_to = Some(3);
    let lost = rig.read(1, 0, PROOF, 1);
    assert_eq!(rig.answer_to(lost), NativeOutcome::NoReply);
    let timed_out = rig.now;
    let next = rig.read(1, 0, PROOF + 1, 1);
    assert!(matches!(rig.answer_to(next), NativeOutcome::Words(_)));
    rig.sent
        .last()
        .expect("the read went out")
        .at
        .since(timed_out)
}

/// Clients that never pause read proof words, whose value identifies the exchange that requested them, until `frames`
/// frames were sent. Returns how many were answered, all of them right.
fn walk(rig: &mut Rig, frames: u64) -> u64 {
    rig.keeps_sent = false;
    for asker in 0..4 {
        rig.read(asker, asker as u16 % 2, PROOF, 1);
    }
    let mut right = 0;
    let end = rig.core.counters().requests + frames;
    while rig.core.counters().requests < end {
        rig.run_until(rig.now + Duration::from_secs(10), |rig, answer| {
            if let NativeOutcome::Words(words) = &answer.outcome {
                let expected = rig.proof(answer.ticket);
                assert_eq!(
                    words[..],
                    [expected],
                    "{words:04X?} for exchange {expected:04X}"
                );
                right += 1;
            }
            let n = answer.ticket.0;
            rig.read(answer.asker.0, (n % 2) as u16, PROOF + (n % 8) as u16, 1);
        });
    }
    right
}

#[test]
fn late_replies_are_never_mixed_up_where_every_reply_is_one_word() {
    for (model, settles) in [
        (refusing(), true),
        (model("toshiba-vf-as1"), true),
        (loop_test(Confidence::Manual), true),
        (loop_test(Confidence::Inferred), true),
        // There is no barrier: the only way is to wait.
        (
            word_by_word(Barrier::Refused(fact(3, Confidence::Inferred))),
            false,
        ),
    ] {
        for seed in 0..3 {
            let options = options(Arc::clone(&model), BadRequest::Exception);
            let mut rig = Rig::new(&RigOptions {
                drives: 2,
                seed,
                ..options
            });
            rig.bus.set_faults(FaultPlan {
                late: 300,
                ..FaultPlan::NONE
            });
            let before = rig.core.counters().barriers;
            let right = walk(&mut rig, 2000);
            let counters = rig.core.counters();
            assert!(right > 500, "{}: work went on: {right}", model.id);
            // Those that arrive while the other drive is asked are foreign.
            assert!(
                counters.strays + counters.foreign > 200,
                "{}: late replies were seen: {counters:?}",
                model.id
            );
            assert_eq!(
                counters.barriers > before + 200,
                settles,
                "{}: {counters:?}",
                model.id
            );
        }
    }
}

#[test]
fn a_barrier_spares_the_wait_for_the_longest_lateness() {
    for model in [
        refusing(),
        loop_test(Confidence::Manual),
        loop_test(Confidence::Inferred),
    ] {
        let mut rig = Rig::new(&options(model, BadRequest::Exception));
        let waited = waited_after_a_lost_reply(&mut rig);
        assert_eq!(functions(&rig), [3, LOOP_TEST, 3]);
        assert!(waited < Duration::from_millis(60), "{waited:?}");
    }
}

#[test]
fn no_two_loop_tests_carry_the_same_data() {
    let mut rig = Rig::new(&options(
        loop_test(Confidence::Manual),
        BadRequest::Exception,
    ));
    for _ in 0..50 {
        waited_after_a_lost_reply(&mut rig);
    }
    let mut data: Vec<_> = rig
        .sent
        .iter()
        .filter(|sent| sent.frame[1] == LOOP_TEST)
        .map(|sent| sent.frame[4..6].to_vec())
        .collect();
    assert_eq!(data.len(), 50);
    data.sort_unstable();
    data.dedup();
    assert_eq!(data.len(), 50);
}

#[test]
fn a_loop_test_proves_nothing_on_a_line_that_echoes() {
    let mut rig = Rig::new(&options(
        loop_test(Confidence::Manual),
        BadRequest::Exception,
    ));
    rig.echoes = true;
    for _ in 0..3 {
        let waited = waited_after_a_lost_reply(&mut rig);
        assert!(waited >= MAX_LATENESS, "{waited:?}");
    }
    rig.echoes = false;
    assert!(
        waited_after_a_lost_reply(&mut rig) >= MAX_LATENESS,
        "an echo may come back"
    );
    assert_eq!(loop_tests(&rig), 0);
    // Another port may have another adapter.
    rig.core
        .handle(rig.now, LineInput::PortDown(LineFault::Gone));
    rig.core
        .handle(rig.now, LineInput::PortUp(PortKind::Serial));
    rig.settle();
    let read = rig.read(1, 0, PROOF, 1);
    assert!(matches!(rig.answer_to(read), NativeOutcome::Words(_)));
    assert!(waited_after_a_lost_reply(&mut rig) < Duration::from_millis(60));
    assert_eq!(loop_tests(&rig), 1);
}

#[test]
fn a_refusal_is_a_barrier_on_a_line_that_echoes_too() {
    let mut rig = Rig::new(&options(refusing(), BadRequest::Exception));
    rig.echoes = true;
    assert!(waited_after_a_lost_reply(&mut rig) < Duration::from_millis(60));
}

#[test]
fn what_is_not_documented_is_shown_once_when_the_drive_comes_online() {
    for (model, trials) in [
        (refusing(), 1),
        (loop_test(Confidence::Inferred), 1),
        (loop_test(Confidence::Manual), 0),
        (n700(), 0),
    ] {
        let mut rig = Rig::new(&options(model, BadRequest::Exception));
        assert_eq!(rig.core.counters().barriers, trials);
        rig.pass(Duration::from_secs(60));
        assert_eq!(rig.core.counters().barriers, trials, "and not again");
        assert_eq!(
            rig.core.counters().exceptions,
            0,
            "a refusal that was asked for is a reply"
        );
    }
}

#[test]
fn a_drive_that_stays_silent_on_it_is_left_alone_with_it_until_it_comes_back() {
    let mut rig = Rig::new(&options(refusing(), BadRequest::Silence));
    assert_eq!(
        (rig.core.counters().barriers, rig.core.counters().silent),
        (1, 1)
    );
    assert_eq!(
        rig.view(0).snapshot.presence,
        DrivePresence::Online,
        "silence on this is no absence"
    );
    assert!(
        waited_after_a_lost_reply(&mut rig) >= MAX_LATENESS,
        "nothing settles it"
    );
    assert_eq!(rig.core.counters().barriers, 1);
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    for _ in 0..3 {
        let read = rig.read(1, 0, PROOF, 1);
        assert_eq!(rig.answer_to(read), NativeOutcome::NoReply);
        rig.pass(Duration::from_secs(1));
    }
    assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Offline);
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), true);
    rig.pass(Duration::from_secs(30));
    let read = rig.read(1, 0, PROOF, 1);
    assert!(matches!(rig.answer_to(read), NativeOutcome::Words(_)));
    rig.pass(Duration::from_secs(30));
    assert_eq!(rig.core.counters().barriers, 2, "asked again, once");
    assert_eq!(rig.view(0).snapshot.presence, DrivePresence::Online);
}

#[test]
fn a_look_at_a_stop_is_not_held_up_by_a_reply_that_stayed_out() {
    let options = options(refusing(), BadRequest::Exception);
    let mut rig = Rig::new(&RigOptions {
        control: Some(control()),
        ..options
    });
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    rig.pass(Duration::from_secs(1));
    rig.sent.clear();
    let stop = rig.command(MQTT, 0, STOP);
    rig.loses_reply_to = Some(3);
    assert_eq!(rig.outcome_of(stop), (Outcome::Confirmed, Reason::None));
    assert_eq!(functions(&rig)[..4], [6, 3, LOOP_TEST, 3]);
    let looks = [rig.sent[1].at, rig.sent[3].at];
    // The reply time-out, the barrier, and the rhythm of looks.
    assert!(
        looks[1].since(looks[0]) < Duration::from_millis(320),
        "{looks:?}"
    );
}

#[test]
fn a_stop_does_not_wait_for_a_barrier() {
    let options = options(refusing(), BadRequest::Exception);
    let mut rig = Rig::new(&RigOptions {
        control: Some(control()),
        ..options
    });
    rig.loses_reply_to = Some(3);
    let lost = rig.read(1, 0, PROOF, 1);
    let next = rig.read(1, 0, PROOF + 1, 1);
    let stop = rig.command(MQTT, 0, STOP);
    assert_eq!(rig.answer_to(lost), NativeOutcome::NoReply);
    assert!(matches!(rig.answer_to(next), NativeOutcome::Words(_)));
    assert_eq!(rig.outcome_of(stop).0, Outcome::Confirmed);
    assert_eq!(functions(&rig)[..2], [3, 6], "{:?}", functions(&rig));
}
