//! STOP overtakes everything, waits for at most the exchange on the wire, and stays in force until it is effective.

use crate::support::families::{accepting, listing, models, quiet, register, rig_of};
use crate::support::{MQTT, ORIGIN, PROOF, Rig, RigOptions, STOP, model, plc, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::NativeAsk;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::profile::model::{IndicatedState, Model, RegisterRole};
use vfd_gateway::sim::{FaultPlan, RefusedStops};

const RUN: u16 = 0x0002;
const STOP_FRAME: [u8; 6] = [1, 6, 0, 2, 0, 0];

fn running() -> Rig {
    let mut rig = Rig::new(&RigOptions::controlled());
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    rig.pass(Duration::from_secs(2));
    rig.sent.clear();
    rig
}

#[test]
fn a_stop_waits_for_the_exchange_on_the_wire_and_for_nothing_else() {
    for lead_ms in 0..40 {
        let mut rig = running();
        for n in 0..1000 {
            rig.ask(
                n % 60,
                0,
                NativeAsk::Read {
                    address: (PROOF + (n % 200) as u16).into(),
                    count: 1,
                },
            );
        }
        rig.run_until(rig.now + Duration::from_millis(lead_ms), |_, _| {});
        let before = rig.sent.len();
        let stopped_at = rig.now;
        let ticket = rig.command(plc(1), 0, STOP);
        while rig.written(RUN).is_empty() {
            rig.step(rig.now + Duration::from_secs(1));
        }
        let overtook = rig.sent[before..]
            .iter()
            .position(|sent| sent.frame[..6] == STOP_FRAME);
        assert_eq!(
            overtook,
            Some(0),
            "the next frame after the exchange in flight is the stop, {lead_ms} ms"
        );
        // At most a request, the turnaround, a reply and the silence: 8 + 7 characters, 2 ms, 4.5 characters.
        let waited = rig.sent[before].at.since(stopped_at);
        assert!(
            waited <= Duration::from_micros(15 * 1042 + 2000 + 4688 + 1),
            "{waited:?}"
        );
        assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
    }
}

#[test]
fn a_stop_cancels_what_was_ordered_and_nothing_moves_until_it_is_effective() {
    let mut rig = running();
    let queued = rig.command(MQTT, 0, setpoint(4000));
    let stop = rig.command(plc(1), 0, STOP);
    let refused = rig.command(MQTT, 0, run(Direction::Forward, Some(4500)));
    assert_eq!(
        rig.outcome_of(queued),
        (Outcome::Superseded, Reason::Stopped)
    );
    assert_eq!(
        rig.outcome_of(refused),
        (Outcome::Refused, Reason::StopPending)
    );
    assert_eq!(rig.outcome_of(stop), (Outcome::Confirmed, Reason::None));
    rig.pass(Duration::from_secs(40));
    assert_eq!(rig.output(1), 0);
    let writes: Vec<_> = rig
        .sent
        .iter()
        .filter(|sent| sent.frame[1] == 6)
        .map(|sent| sent.frame[..6].to_vec())
        .collect();
    let stop_at = writes
        .iter()
        .position(|frame| *frame == STOP_FRAME)
        .unwrap();
    assert_eq!(writes.len(), stop_at + 1, "{writes:02X?}");
}

#[test]
fn a_stop_is_reported_at_the_echo_and_again_when_it_is_effective() {
    let mut rig = running();
    let ticket = rig.command(MQTT, 0, STOP);
    rig.outcome_of(ticket);
    let told = rig.told(ticket);
    assert_eq!(
        told,
        [
            (Outcome::Acknowledged, Reason::None, false),
            (Outcome::Confirmed, Reason::None, true)
        ]
    );
}

#[test]
fn a_stop_without_a_reply_is_repeated_until_it_is_effective() {
    let mut rig = running();
    rig.bus.set_faults("lost=1000".parse().unwrap());
    let ticket = rig.command(MQTT, 0, STOP);
    rig.pass(Duration::from_secs(1));
    assert!(rig.written(RUN).len() >= 2 && rig.written(RUN).iter().all(|value| *value == 0));
    assert_eq!(rig.told(ticket), []);
    rig.bus.set_faults(FaultPlan::NONE);
    rig.pass(Duration::from_secs(10));
    assert_eq!(rig.told(ticket).last().unwrap().0, Outcome::Confirmed);
    assert!(!rig.view(0).control.unwrap().stop_pending);
}

#[test]
fn a_stop_that_the_drive_refuses_is_reported_repeated_and_an_alarm() {
    let mut rig = running();
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, 0x0212_u16.into(), 2);
    let ticket = rig.command(MQTT, 0, STOP);
    assert_eq!(
        rig.outcome_of(ticket),
        (Outcome::Failed, Reason::KeptOldValue)
    );
    rig.pass(Duration::from_secs(4));
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::NotEffective)
    );
    assert!(rig.view(0).control.unwrap().not_effective);
    assert!(rig.written(RUN).len() >= 3, "it goes on being repeated");
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, 0x0212_u16.into(), 3);
    rig.pass(Duration::from_secs(6));
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::EffectiveAtLast)
    );
    rig.pass(Duration::from_secs(40));
    assert_eq!(rig.output(1), 0);
}

#[test]
fn a_stop_without_effect_is_repeated_for_as_long_as_the_drive_answers() {
    let mut rig = running();
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, 0x0212_u16.into(), 2);
    rig.command(MQTT, 0, STOP);
    rig.pass(Duration::from_secs(620));
    rig.sent.clear();
    rig.pass(Duration::from_secs(10));
    assert!(!rig.written(RUN).is_empty(), "still repeated");
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    rig.pass(Duration::from_secs(590));
    assert!(
        rig.view(0).control.unwrap().stop_pending,
        "it has been away for less than 10 min"
    );
    rig.pass(Duration::from_secs(20));
    assert!(!rig.view(0).control.unwrap().stop_pending);
    let dropped = rig
        .notes
        .iter()
        .filter(|(_, note)| *note == DriveNote::StopDropped);
    assert_eq!(dropped.count(), 1);
}

#[test]
fn a_controller_that_goes_on_ordering_stop_has_a_drive_stopped_that_comes_back_after_the_stop_was_dropped()
 {
    let mut rig = Rig::new(&RigOptions {
        drives: 2,
        ..RigOptions::controlled()
    });
    rig.commanded(plc(1), STOP);
    rig.commanded(plc(1), run(Direction::Forward, Some(3000)));
    rig.pass(Duration::from_secs(2));
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    for _ in 0..66 {
        rig.command(plc(1), 0, STOP);
        rig.pass(Duration::from_secs(10));
    }
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::StopDropped)
    );
    rig.sent.clear();
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), true);
    // As a drive does that was out of reach and never stopped.
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .obey(now, &[6, 0, 2, 0, 1]);
    for _ in 0..6 {
        rig.command(plc(1), 0, STOP);
        rig.pass(Duration::from_secs(10));
    }
    assert_eq!(rig.output(1), 0);
    assert_eq!(
        rig.written(RUN).first(),
        Some(&0),
        "it did not stop by itself"
    );
}

#[test]
fn a_late_echo_is_no_proof_of_a_stop() {
    let mut rig = running();
    // The echo of the first stop arrives after its time-out and could be that of the second one.
    rig.bus.set_faults("late=1000".parse().unwrap());
    let ticket = rig.command(MQTT, 0, STOP);
    rig.pass(Duration::from_millis(300));
    rig.bus.set_faults(FaultPlan::NONE);
    assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
    rig.pass(Duration::from_secs(40));
    assert_eq!(rig.output(1), 0);
}

/// The late echo of the first stop arrives while the second one is sent, like that of a line that echoes.
#[test]
fn a_late_echo_that_looks_like_that_of_the_line_does_not_keep_a_stop_from_its_end() {
    let mut rig = running();
    rig.bus.set_faults("lost=1000".parse().unwrap());
    let ticket = rig.command(MQTT, 0, STOP);
    while rig.written(RUN).last_chunk() != Some(&[0, 0]) {
        assert!(rig.step(rig.now + Duration::from_secs(5)));
    }
    rig.bus.set_faults(FaultPlan::NONE);
    rig.pass(Duration::from_millis(2));
    let frame = rig.sent.last().unwrap().frame.clone();
    rig.core.handle(rig.now, LineInput::Bytes(&frame));
    rig.settle();
    assert_eq!(rig.core.counters().echoes, 1);
    assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
}

#[test]
fn a_stop_waits_for_a_drive_that_is_away() {
    let mut rig = running();
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    rig.pass(Duration::from_secs(3));
    let ticket = rig.command(MQTT, 0, STOP);
    assert_eq!(rig.outcome_of(ticket), (Outcome::Unknown, Reason::NoReply));
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), true);
    rig.pass(Duration::from_secs(40));
    assert!(!rig.view(0).control.unwrap().stop_pending);
    assert_eq!(rig.output(1), 0);
}

#[test]
fn a_drive_that_comes_back_is_read_before_it_is_stopped() {
    for turns in [true, false] {
        let mut rig = running();
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), false);
        rig.live(Duration::from_secs(5));
        rig.command(MQTT, 0, STOP);
        rig.live(Duration::from_secs(60));
        let while_away = rig.written(RUN).len();
        assert!(
            (6..=9).contains(&while_away),
            "{while_away} stops to a drive that is away and may hear"
        );
        let back_at = rig.now;
        rig.bus.set_powered(back_at, Station(1), true);
        if turns {
            // As a drive does that was out of reach and never stopped.
            let drive = rig.bus.drive_mut(Station(1)).unwrap();
            drive.obey(back_at, &[6, 0, 2, 0, 1]);
        }
        rig.live(Duration::from_secs(5));
        assert_eq!(
            rig.written(RUN).len() > while_away,
            turns,
            "a drive that stands still needs no stop"
        );
        assert!(!rig.view(0).control.unwrap().stop_pending);
        rig.pass(Duration::from_secs(40));
        assert_eq!(rig.output(1), 0);
    }
}

#[test]
fn moving_drives_are_stopped_first() {
    let mut rig = Rig::new(&RigOptions {
        drives: 4,
        ..RigOptions::controlled()
    });
    let ticket = rig.command(MQTT, 2, run(Direction::Forward, Some(3000)));
    rig.outcome_of(ticket);
    rig.pass(Duration::from_secs(2));
    rig.sent.clear();
    for drive in 0..4 {
        rig.command(plc(1), drive, STOP);
    }
    rig.pass(Duration::from_millis(500));
    let stops: Vec<u8> = rig
        .sent
        .iter()
        .filter(|sent| sent.frame[1] == 6)
        .map(|sent| sent.frame[0])
        .collect();
    // The first one may have left before the others were commanded.
    assert!(
        stops.iter().position(|station| *station == 3) <= Some(1),
        "{stops:?}"
    );
}

#[test]
fn many_who_stop_all_get_an_answer() {
    let mut rig = running();
    let tickets: Vec<_> = (1..=40).map(|n| rig.command(plc(n), 0, STOP)).collect();
    for ticket in tickets {
        assert_eq!(rig.outcome_of(ticket).0, Outcome::Confirmed);
    }
}

#[test]
fn a_flood_of_stops_is_one_stop_and_leaves_the_line_to_others() {
    let mut rig = running();
    let tickets: Vec<_> = (0..2000)
        .map(|n| {
            if n % 20 == 0 {
                rig.pass(Duration::from_millis(1));
            }
            rig.command(MQTT, 0, STOP)
        })
        .collect();
    for ticket in tickets {
        assert!(matches!(
            rig.outcome_of(ticket).0,
            Outcome::Confirmed | Outcome::Unknown
        ));
    }
    assert!(
        rig.written(RUN).len() <= 3,
        "{} frames",
        rig.written(RUN).len()
    );
}

#[test]
fn a_coast_while_the_stop_is_on_the_wire_is_judged_by_its_own_echo() {
    let mut rig = running();
    let stop = rig.command(MQTT, 0, STOP);
    while rig.written(RUN).is_empty() {
        rig.step(rig.now + Duration::from_secs(1));
    }
    let coast = rig.command(MQTT, 0, Order::Coast);
    assert_eq!(rig.outcome_of(coast), (Outcome::Confirmed, Reason::None));
    assert_eq!(rig.outcome_of(stop).0, Outcome::Confirmed);
    assert_eq!(rig.written(RUN), [0, 3]);
}

#[test]
fn coast_cuts_the_output_off() {
    let mut rig = running();
    let ticket = rig.command(MQTT, 0, Order::Coast);
    assert_eq!(rig.outcome_of(ticket).0, Outcome::Confirmed);
    assert_eq!((rig.output(1), rig.written(RUN)), (0, vec![3]));
}

/// A motor at standstill cannot be stopped, and a pending stop would keep the drive from being set up.
#[test]
fn a_stop_that_a_resting_drive_refuses_is_settled() {
    let model = model("frecon-fr500a");
    let mut rig = Rig::new(&RigOptions {
        model,
        proof_words: None,
        ..RigOptions::controlled()
    });
    let now = rig.now;
    // F02.00: run commands from the keypad.
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, 0x0200_u16.into(), 0);
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Failed, Reason::DriveException)
    );
    rig.pass(Duration::from_secs(2));
    let control = rig.view(0).control.unwrap();
    assert!(
        !control.stop_pending && !control.not_effective,
        "{control:?}"
    );
}

/// A drive of `id` that serves only these functions, whatever its model says, and runs.
fn serving(id: &str, functions: &[u8]) -> Rig {
    let model = model(id);
    let mut really = Model::clone(&model);
    really.functions.value = functions.to_vec();
    let control = Some(accepting());
    let really = Some(Arc::new(really));
    let proof_words = None;
    Rig::new(&RigOptions {
        model,
        really,
        proof_words,
        control,
        ..RigOptions::controlled()
    })
}

#[test]
fn a_stop_that_is_refused_in_one_form_is_tried_in_the_other_that_the_model_declares() {
    for id in ["teco-e510", "teco-e510s"] {
        let mut rig = serving(id, &[0x03, 0x08, 0x10]);
        let now = rig.now;
        let run = [0x10, 0x25, 0x01, 0, 2, 4, 0, 1, 0x0B, 0xB8];
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .answer(now, &run, 0, &mut Vec::new());
        rig.pass(Duration::from_secs(2));
        assert!(rig.output(1) > 0, "{id}");
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None),
            "{id}"
        );
        // Typed here: 06 first, and 10 hex with one word.
        assert_eq!(
            rig.writes(),
            [vec![6, 0x25, 1, 0, 0], vec![0x10, 0x25, 1, 0, 1, 2, 0, 0]],
            "{id}"
        );
        let first = rig.sent.iter().position(|sent| sent.pdu[0] == 6).unwrap();
        assert_eq!(rig.sent[first + 1].pdu[0], 0x10, "{id}: at once");
        assert!(
            !rig.notes
                .iter()
                .any(|(_, note)| *note == DriveNote::StopRefused),
            "{id}: {:?}",
            rig.notes
        );
        rig.pass(Duration::from_secs(20));
        assert_eq!(rig.output(1), 0, "{id}");
        // And where a stop takes effect it may start again.
        assert_ne!(
            rig.commanded(MQTT, crate::support::run(Direction::Forward, Some(2000)))
                .1,
            Reason::StopRefused
        );
    }
}

#[test]
fn a_drive_that_refuses_to_be_stopped_is_not_started_and_people_hear_of_it_at_once() {
    for model in models() {
        // It serves everything except the function of the stop.
        let mut functions = model.functions.value.clone();
        functions.retain(|it| ![0x06, 0x10].contains(it));
        let mut rig = serving(&model.id, &functions);
        assert_eq!(
            rig.commanded(MQTT, STOP).0,
            if model.exceptions.is_empty() {
                Outcome::Unknown
            } else {
                Outcome::Failed
            }
        );
        if model.exceptions.is_empty() {
            // Such a drive does not answer what it does not serve: its stop stays pending.
            assert_eq!(
                rig.commanded(MQTT, run(Direction::Forward, Some(2000))).1,
                Reason::StopPending,
                "{}",
                model.id
            );
            continue;
        }
        let told: Vec<_> = rig
            .notes
            .iter()
            .filter(|(_, note)| *note == DriveNote::StopRefused)
            .collect();
        assert!(
            matches!(told[..], [(at, _)] if rig.now.since(*at) < Duration::from_millis(100)),
            "{}",
            model.id
        );
        rig.pass(Duration::from_secs(5));
        assert!(
            !rig.view(0).control.unwrap().stop_pending,
            "{}: it stands still",
            model.id
        );
        for by in [MQTT, plc(1)] {
            rig.commanded(plc(1), STOP);
            rig.pass(Duration::from_secs(5));
            let told = rig.commanded(by, run(Direction::Forward, Some(2000)));
            assert_eq!(
                told,
                (Outcome::Refused, Reason::StopRefused),
                "{}",
                model.id
            );
        }
        // A controller that holds 0 stops again, at a bounded rate.
        rig.sent.clear();
        for _ in 0..300 {
            rig.command(plc(1), 0, STOP);
            rig.pass(Duration::from_millis(100));
        }
        let forms = if model.write.block.is_some() { 2 } else { 1 };
        let sent = rig.writes().len();
        assert!(
            (5 * forms..=11 * forms).contains(&sent),
            "{}: {sent} in 30 s",
            model.id
        );
        let told = rig
            .notes
            .iter()
            .filter(|(_, note)| *note == DriveNote::StopRefused)
            .count();
        assert_eq!(told, 1, "{}: told once", model.id);
    }
}

#[test]
fn a_motor_that_runs_on_after_a_refused_stop_is_an_alarm_until_it_obeys() {
    for model in models() {
        let mut rig = serving(&model.id, &model.functions.value);
        rig.commanded(MQTT, run(Direction::Forward, Some(2000)));
        rig.live(Duration::from_secs(3));
        assert!(rig.output(1) > 0, "{}", model.id);
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .refuse_stops(RefusedStops::All);
        let ticket = rig.command(MQTT, 0, STOP);
        assert_eq!(rig.outcome_of(ticket).0, Outcome::Failed, "{}", model.id);
        let control = rig.view(0).control.unwrap();
        assert!(
            control.stop_pending && control.not_effective,
            "{}: {control:?}",
            model.id
        );
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .refuse_stops(RefusedStops::None);
        rig.pass(Duration::from_secs(60));
        let control = rig.view(0).control.unwrap();
        assert!(
            !control.stop_pending && !control.not_effective,
            "{}: {control:?}",
            model.id
        );
        let told = |wanted: DriveNote| rig.notes.iter().filter(|(_, note)| *note == wanted).count();
        assert_eq!(
            (
                told(DriveNote::StopRefused),
                told(DriveNote::EffectiveAtLast)
            ),
            (1, 1),
            "{}: {:?}",
            model.id,
            rig.notes
        );
        assert_eq!(rig.output(1), 0, "{}", model.id);
    }
}

#[test]
fn a_drive_that_takes_stops_again_may_be_started() {
    let model = model("frecon-fr500a");
    let mut rig = Rig::new(&RigOptions {
        model,
        proof_words: None,
        ..RigOptions::controlled()
    });
    let set = |rig: &mut Rig, word| {
        let now = rig.now;
        // F02.00: where run commands come from.
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .set_locally(now, 0x0200_u16.into(), word);
    };
    set(&mut rig, 0);
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Failed, Reason::DriveException)
    );
    rig.pass(Duration::from_secs(5));
    assert_eq!(
        rig.commanded(plc(1), run(Direction::Forward, Some(2000))).1,
        Reason::StopRefused
    );
    set(&mut rig, 2);
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Confirmed, Reason::None)
    );
    // The control sources are polled at their own pace.
    let (_, reason) = rig.commanded(plc(1), run(Direction::Forward, Some(2000)));
    assert!(
        [Reason::None, Reason::LocalControl].contains(&reason),
        "{reason:?}"
    );
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| *note == DriveNote::EffectiveAtLast),
        "{:?}",
        rig.notes
    );
}

#[test]
fn a_stop_on_an_unplugged_line_is_reported_at_once_and_goes_out_when_it_is_back() {
    for model in models() {
        let options = RigOptions {
            model: Arc::clone(&model),
            proof_words: None,
            ..RigOptions::controlled()
        };
        let mut rig = Rig::new(&RigOptions {
            control: Some(accepting()),
            ..options
        });
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(3));
        rig.core
            .handle(rig.now, LineInput::PortDown(LineFault::Gone));
        rig.settle();
        let from = rig.now;
        let first = rig.command(MQTT, 0, STOP);
        assert_eq!(
            rig.told(first),
            [(Outcome::Unknown, Reason::LineDown, true)],
            "{}",
            model.id
        );
        let (_, answer) = rig.reports.last().unwrap();
        assert!(
            answer.report.message().contains("pending"),
            "{}",
            answer.report.message()
        );
        assert!(rig.view(0).control.unwrap().stop_pending, "{}", model.id);
        // Later ones are answered at once, too.
        let second = rig.command(plc(1), 0, STOP);
        assert_eq!(
            rig.told(second),
            [(Outcome::Unknown, Reason::LineDown, true)],
            "{}",
            model.id
        );
        assert_eq!(rig.now, from);
        rig.pass(Duration::from_secs(1));
        rig.sent.clear();
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        rig.settle();
        rig.pass(Duration::from_secs(20));
        assert_eq!(rig.output(1), 0, "{}", model.id);
    }
}

/// What the drive acknowledged before its line was lost proves nothing: other parties may have started it since.
#[test]
fn a_stop_that_joins_one_on_a_lost_line_is_no_success() {
    for model in models() {
        let options = RigOptions {
            model: Arc::clone(&model),
            proof_words: None,
            ..RigOptions::controlled()
        };
        let mut rig = Rig::new(&RigOptions {
            control: Some(accepting()),
            ..options
        });
        rig.commanded(plc(1), run(Direction::Forward, Some(5000)));
        rig.live(Duration::from_secs(6));
        let first = rig.command(plc(1), 0, STOP);
        while !rig
            .told(first)
            .iter()
            .any(|it| it.0 == Outcome::Acknowledged)
        {
            assert!(rig.step(rig.now + Duration::from_secs(5)), "{}", model.id);
        }
        assert!(
            rig.view(0).control.unwrap().stop_pending,
            "{}: not effective yet",
            model.id
        );
        rig.core
            .handle(rig.now, LineInput::PortDown(LineFault::Gone));
        rig.settle();
        for by in [plc(1), plc(2)] {
            let again = rig.command(by, 0, STOP);
            assert_eq!(
                rig.told(again),
                [(Outcome::Unknown, Reason::LineDown, true)],
                "{}",
                model.id
            );
        }
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        rig.settle();
        rig.sent.clear();
        rig.pass(Duration::from_secs(20));
        assert!(
            !rig.writes().is_empty(),
            "{}: it goes out once more",
            model.id
        );
        assert_eq!(
            (rig.output(1), rig.view(0).control.unwrap().stop_pending),
            (0, false),
            "{}",
            model.id
        );
    }
}

#[test]
fn a_register_that_was_being_written_when_a_stop_came_is_unknown_and_not_refused() {
    let mut rig = quiet("teco-e510", listing(vec![0x000E]));
    rig.loses_reply_to = Some(6);
    let write = rig.command(plc(1), 0, register(0x000E, 20));
    while rig.writes().is_empty() {
        assert!(
            rig.step(rig.now + Duration::from_secs(1)),
            "its frame goes out"
        );
    }
    rig.command(plc(1), 0, STOP);
    assert_eq!(rig.outcome_of(write), (Outcome::Unknown, Reason::Stopped));
}

/// What the drive shows of its state and its output stays as it is.
fn freeze(rig: &mut Rig, model: &Model) -> (Address, u16) {
    let output = model
        .register_for(RegisterRole::OutputFrequency)
        .expect("it shows its output")
        .address;
    let status = model
        .status_flag(IndicatedState::Running)
        .map(|flag| flag.address);
    let held = |rig: &mut Rig, at| rig.view(0).snapshot.reading(at).expect("it was read").raw;
    for address in status.into_iter().chain([output]) {
        let word = held(rig, address);
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .shows_at(address, word);
    }
    (output, held(rig, output))
}

#[test]
fn the_noise_of_a_steady_speed_is_no_effect_of_a_stop() {
    for model in models() {
        let mut rig = rig_of(&model, accepting());
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(12));
        let (output, speed) = freeze(&mut rig, &model);
        rig.sent.clear();
        let ticket = rig.command(MQTT, 0, STOP);
        for below in [0, 1, 1, 1].into_iter().cycle().take(200) {
            rig.bus
                .drive_mut(Station(1))
                .unwrap()
                .shows_at(output, speed - below);
            rig.pass(Duration::from_millis(40));
        }
        let told = rig.told(ticket);
        assert!(
            !told
                .iter()
                .any(|(outcome, ..)| *outcome == Outcome::Confirmed),
            "{}: {told:?}",
            model.id
        );
        assert!(rig.view(0).control.unwrap().not_effective, "{}", model.id);
        assert!(rig.writes().len() >= 3, "{}: it is repeated", model.id);
    }
}

#[test]
fn a_motor_that_goes_on_behind_a_stop_that_seemed_to_take_effect_is_stopped_again() {
    for model in models() {
        let mut rig = rig_of(&model, accepting());
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(12));
        let (output, speed) = freeze(&mut rig, &model);
        // It ramps to a setpoint of 10 Hz, which was given before.
        let fall = speed / 3 * 2;
        rig.sent.clear();
        let ticket = rig.command(MQTT, 0, STOP);
        for below in [0, fall / 2].into_iter().chain([fall; 8]) {
            rig.bus
                .drive_mut(Station(1))
                .unwrap()
                .shows_at(output, speed - below);
            rig.pass(Duration::from_millis(100));
        }
        assert_eq!(
            rig.told(ticket).last().unwrap().0,
            Outcome::Confirmed,
            "{}",
            model.id
        );
        let before = rig.writes().len();
        rig.pass(Duration::from_secs(10));
        assert!(rig.writes().len() > before, "{}", model.id);
        let control = rig.view(0).control.unwrap();
        assert!(
            control.stop_pending && control.not_effective,
            "{}: {control:?}",
            model.id
        );
        rig.bus.drive_mut(Station(1)).unwrap().shows_the_truth();
        rig.pass(Duration::from_secs(20));
        assert!(!rig.view(0).control.unwrap().stop_pending, "{}", model.id);
    }
}

#[test]
fn each_stop_of_a_client_goes_out_to_a_drive_that_hears_and_is_not_heard() {
    let mut rig = running();
    rig.bus.set_faults("lost=1000".parse().unwrap());
    rig.pass(Duration::from_secs(60));
    assert_eq!(rig.view(0).run_state, RunState::Offline);
    for by in [MQTT, ORIGIN, MQTT] {
        rig.sent.clear();
        rig.command(by, 0, STOP);
        rig.pass(Duration::from_secs(5));
        assert!(!rig.writes().is_empty(), "{by:?}");
        rig.pass(Duration::from_secs(10));
        let frames = rig.writes().len();
        assert!(
            frames <= 3,
            "a dead drive costs the others little: {frames}"
        );
    }
}
