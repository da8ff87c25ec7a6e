//! What a run word means is the same for everybody: a 0 stops the motor whoever writes it, also where the drive itself
//! would ignore it, run on or coast, and it never reaches the line as 0.

use crate::support::families::{accepting, model_with, options_of, refused, rig_of, single, write};
use crate::support::{MQTT, ORIGIN, Rig, RigOptions, STOP, run};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome};
use vfd_gateway::drive::view::RunState;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::{Confidence, Fact, Model};

const SECOND: Duration = Duration::from_secs(1);
const RUN: u16 = 0x2000;
const FREQUENCY: u16 = 0x2001;

/// A drive, typed from its manual: its words, and what it does with a 0.
struct Kind {
    text: &'static str,
    stop: u16,
    forward: u16,
    reverse: u16,
    /// What the gateway writes for the 0 of a native client.
    zero: u16,
    /// The motor runs on when another master writes 0 straight to the drive.
    runs_on: bool,
}

const KINDS: [Kind; 3] = [
    Kind {
        text: include_str!("../golden/models/zero-ignored.toml"),
        stop: 0x043C,
        forward: 0x047C,
        reverse: 0x847C,
        zero: 0x043C,
        runs_on: true,
    },
    Kind {
        text: include_str!("../golden/models/zero-nothing.toml"),
        stop: 0x0001,
        forward: 0x0012,
        reverse: 0x0022,
        zero: 0x0001,
        runs_on: true,
    },
    Kind {
        text: include_str!("../golden/models/zero-coast.toml"),
        stop: 0x0006,
        forward: 0x0007,
        reverse: 0x0003,
        zero: 0x0004,
        runs_on: false,
    },
];

impl Kind {
    fn model(&self) -> Arc<Model> {
        Arc::new(check::model(self.text).unwrap())
    }

    /// A rig of it whose motor runs by an order over MQTT.
    fn running(&self, direction: Direction) -> Rig {
        let model = self.model();
        let mut rig = Rig::new(&RigOptions {
            poll: SECOND / 5,
            ..options_of(&model, accepting())
        });
        assert_eq!(
            rig.commanded(MQTT, run(direction, Some(3000))),
            (Outcome::Confirmed, Reason::None),
            "{}",
            model.id
        );
        rig.live(SECOND * 8);
        assert_eq!(rig.output(1).abs(), 3000, "{}", model.id);
        rig.sent.clear();
        rig
    }
}

/// Another master writes `word` straight to the drive.
fn other_master(rig: &mut Rig, word: u16) {
    let now = rig.now;
    let mut reply = Vec::new();
    assert!(
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .answer(now, &single(RUN, word), 0, &mut reply)
    );
    assert_eq!(
        reply,
        single(RUN, word),
        "the drive answers as if it had taken the word"
    );
}

#[test]
fn both_directions_run_as_they_are_called() {
    for kind in KINDS {
        for (direction, word, sign) in [
            (Direction::Forward, kind.forward, 1),
            (Direction::Reverse, kind.reverse, -1),
        ] {
            let model = kind.model();
            let mut rig = rig_of(&model, accepting());
            rig.sent.clear();
            assert_eq!(
                rig.commanded(MQTT, run(direction, Some(3000))).0,
                Outcome::Confirmed,
                "{}",
                model.id
            );
            assert_eq!(rig.written(RUN), [word], "{}", model.id);
            rig.live(SECOND * 8);
            assert_eq!(rig.output(1), sign * 3000, "{}", model.id);
        }
    }
}

#[test]
fn a_uniform_stop_is_the_stop_word_of_the_drive() {
    for kind in KINDS {
        for direction in [Direction::Forward, Direction::Reverse] {
            let mut rig = kind.running(direction);
            assert_eq!(
                rig.commanded(ORIGIN, STOP),
                (Outcome::Confirmed, Reason::None)
            );
            assert_eq!(rig.written(RUN), [kind.stop]);
            assert!(rig.output(1).abs() > 1000, "it ramps down");
            rig.live(SECOND * 8);
            assert_eq!(rig.output(1), 0);
        }
    }
}

#[test]
fn the_end_of_the_lease_is_the_stop_word_of_the_drive() {
    for kind in KINDS {
        let mut rig = kind.running(Direction::Forward);
        // Its commander has gone silent.
        rig.pass(SECOND * 20);
        assert_eq!(rig.written(RUN), [kind.stop]);
        assert_eq!(rig.output(1), 0);
    }
}

#[test]
fn a_native_zero_stops_the_motor_and_is_never_sent() {
    for kind in KINDS {
        // Alone, and in a block in front of a setpoint, which is not taken then.
        for values in [&[0][..], &[0, 2500]] {
            let mut rig = kind.running(Direction::Forward);
            let answer = write(&mut rig, RUN, values);
            // A coast takes no setpoint.
            let coasts = kind.zero != kind.stop;
            assert_eq!(answer, NativeOutcome::Written, "{}", kind.model().id);
            assert_eq!(rig.written(RUN), [kind.zero], "{}", kind.model().id);
            assert_eq!(rig.written(FREQUENCY), [0; 0]);
            assert_eq!(
                rig.output(1) == 0,
                coasts,
                "a coast at once, a stop by the ramp"
            );
            rig.live(SECOND * 8);
            assert_eq!(rig.output(1), 0, "{}", kind.model().id);
            let control = rig.view(0).control.unwrap();
            assert!(!control.stop_pending, "the drive has shown it");
        }
    }
}

/// The first stop word is lost, or the reply to it: the stop word is sent again, and no other word takes its place.
#[test]
fn a_native_zero_stops_the_motor_over_a_bad_line_as_well() {
    for kind in KINDS {
        let mut rig = kind.running(Direction::Forward);
        rig.loses_reply_to = Some(6);
        let ask = NativeAsk::Write {
            address: RUN.into(),
            values: vec![0],
        };
        rig.ask(1, 0, ask);
        rig.live(SECOND * 8);
        assert_eq!(rig.output(1), 0, "{}", kind.model().id);
        assert!(
            rig.written(RUN).iter().all(|word| *word == kind.zero),
            "{:?}",
            rig.written(RUN)
        );
        let mut rig = kind.running(Direction::Forward);
        rig.swallows = Some(single(RUN, kind.zero));
        let ask = NativeAsk::Write {
            address: RUN.into(),
            values: vec![0],
        };
        rig.ask(1, 0, ask);
        rig.live(SECOND * 2);
        assert_eq!(rig.output(1), 3000, "no stop has reached the drive");
        assert!(
            rig.view(0).control.unwrap().stop_pending,
            "and none is believed to have"
        );
        rig.swallows = None;
        rig.live(SECOND * 12);
        assert_eq!(rig.output(1), 0, "{}", kind.model().id);
        assert!(
            rig.written(RUN).len() > 1 && rig.written(RUN).iter().all(|word| *word == kind.zero)
        );
    }
}

/// A controller that writes 0 natively in every cycle holds the drive stopped, however the motor is started.
#[test]
fn a_native_zero_in_every_cycle_holds_the_drive_stopped() {
    for kind in KINDS {
        let mut rig = kind.running(Direction::Forward);
        for _ in 0..4 {
            other_master(&mut rig, kind.forward);
            rig.live(SECOND);
            for _ in 0..80 {
                write(&mut rig, RUN, &[0]);
                rig.live(SECOND / 10);
            }
            assert_eq!(rig.output(1), 0, "{}", kind.model().id);
        }
        let written = rig.written(RUN);
        assert!(written.iter().all(|word| *word == kind.zero), "{written:?}");
        assert!(
            (4..=12).contains(&written.len()),
            "{}: {} frames",
            kind.model().id,
            written.len()
        );
    }
}

#[test]
fn a_zero_of_another_master_is_believed_to_do_what_the_drive_does_with_it() {
    for kind in KINDS {
        let mut rig = kind.running(Direction::Forward);
        other_master(&mut rig, 0);
        rig.live(SECOND * 3);
        assert_eq!(
            rig.output(1),
            if kind.runs_on { 3000 } else { 0 },
            "{}",
            kind.model().id
        );
        let seen = if kind.runs_on {
            RunState::Forward
        } else {
            RunState::Stopped
        };
        assert_eq!(rig.view(0).run_state, seen, "{}", kind.model().id);
        // Whatever the 0 of the other one did, a stop is one.
        assert_eq!(rig.commanded(ORIGIN, STOP).0, Outcome::Confirmed);
        assert_eq!(rig.written(RUN), [kind.stop]);
    }
}

#[test]
fn other_words_are_exactly_one_command_or_refused() {
    for kind in KINDS {
        let mut rig = kind.running(Direction::Forward);
        // Quick stop, reverse by toggle, and two commands at once.
        for word in [0x042C, 0x0032, 0x0030, kind.stop | kind.forward, 0xFFFF] {
            let is_command = [kind.stop, kind.forward, kind.reverse].contains(&word);
            if !is_command {
                assert_eq!(
                    write(&mut rig, RUN, &[word]),
                    refused(Reason::NotUnderstood),
                    "{word:04X}"
                );
            }
        }
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
        assert_eq!(write(&mut rig, RUN, &[kind.stop]), NativeOutcome::Written);
        assert_eq!(rig.written(RUN), [kind.stop]);
    }
}

/// A 0 that coasts is no reason to leave a motor running because coasting is unproven.
#[test]
fn a_zero_that_would_coast_is_a_stop_where_the_coast_is_unproven() {
    let mut model = check::model(KINDS[2].text).unwrap();
    model
        .run
        .as_mut()
        .unwrap()
        .coast
        .as_mut()
        .unwrap()
        .confidence = Confidence::Inferred;
    for accept_unverified in [Vec::new(), accepting().accept_unverified] {
        let control = vfd_gateway::domain::control::ControlSettings {
            accept_unverified,
            ..accepting()
        };
        let mut rig = rig_of(&Arc::new(model.clone()), control);
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
            Outcome::Confirmed
        );
        rig.live(SECOND * 8);
        rig.sent.clear();
        assert_eq!(write(&mut rig, RUN, &[0]), NativeOutcome::Written);
        assert_eq!(rig.written(RUN), [KINDS[2].stop]);
        rig.live(SECOND * 8);
        assert_eq!(rig.output(1), 0);
    }
}

/// That 0 must never be written to the drive is one more reason to send its stop word.
#[test]
fn a_zero_that_must_never_be_written_is_a_stop_as_well() {
    for kind in KINDS {
        let mut model = check::model(kind.text).unwrap();
        let never = Fact {
            value: 0,
            confidence: Confidence::Manual,
            source: "UM 4".to_owned(),
        };
        model.run.as_mut().unwrap().never.push(never);
        let mut rig = rig_of(&Arc::new(model), accepting());
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
            Outcome::Confirmed
        );
        rig.sent.clear();
        assert_eq!(write(&mut rig, RUN, &[0]), NativeOutcome::Written);
        rig.live(SECOND * 8);
        assert_eq!((rig.output(1), rig.written(RUN)), (0, vec![kind.zero]));
        assert_eq!(
            rig.bus.drive(Station(1)).unwrap().report().forbidden_words,
            0
        );
    }
}

/// A model that does not say what a 0 does refuses it, as before.
#[test]
fn a_zero_of_unknown_meaning_is_refused() {
    let mut rig = rig_of(&model_with("frecon-fr500a", |_| {}), accepting());
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
        Outcome::Confirmed
    );
    rig.sent.clear();
    assert_eq!(
        write(&mut rig, 0x2000, &[0]),
        refused(Reason::NotUnderstood)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
}

#[test]
fn a_reset_starts_no_motor_and_leaves_the_stop_word() {
    for kind in KINDS {
        let mut rig = kind.running(Direction::Forward);
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 2);
        rig.live(SECOND * 3);
        assert_eq!(
            rig.commanded(MQTT, Order::Reset).0,
            Outcome::Confirmed,
            "{}",
            kind.model().id
        );
        rig.live(SECOND * 8);
        assert!(!rig.bus.drive(Station(1)).unwrap().is_tripped());
        assert_eq!(rig.output(1), 0);
        assert_eq!(rig.written(RUN).last(), Some(&kind.stop));
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
            Outcome::Confirmed,
            "and it runs again"
        );
    }
}
