//! Reverse by the sign of the setpoint: RUN gives it, a setpoint alone keeps it, and nothing else turns the motor round.

use crate::support::families::{accepting, options_of, ready, refused, rig_of, single, write};
use crate::support::{MQTT, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason, RunIntent};
use vfd_gateway::domain::control::{BusFunctions, ControlSettings};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::Model;

const SECOND: Duration = Duration::from_secs(1);
const SIGNED: &str = include_str!("../golden/models/signed.toml");
const RUN: u16 = 0x2000;
const SETPOINT: u16 = 0x2001;
const DONE: (Outcome, Reason) = (Outcome::Confirmed, Reason::None);

fn signed() -> Arc<Model> {
    Arc::new(check::model(SIGNED).unwrap())
}

/// The word for this many hundredths of a hertz.
const fn word(centihertz: i16) -> u16 {
    centihertz.cast_unsigned()
}

/// A drive that has been ordered to run and turns at its setpoint.
fn running(direction: Direction) -> Rig {
    let mut rig = ready(&signed());
    assert_eq!(rig.commanded(MQTT, run(direction, Some(3000))), DONE);
    rig.live(SECOND * 15);
    rig.sent.clear();
    rig
}

#[test]
fn run_sends_the_setpoint_with_its_sign_before_the_run_word() {
    let mut rig = ready(&signed());
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Reverse, Some(3000))),
        DONE
    );
    assert_eq!(
        rig.writes(),
        [single(SETPOINT, word(-3000)), single(RUN, 1)]
    );
    rig.live(SECOND * 15);
    let view = rig.view(0);
    assert_eq!((rig.output(1), view.run_state), (-3000, RunState::Reverse));
    let model = signed();
    let shown = |name: &str| {
        let register = model.registers.iter().find(|it| it.name == name).unwrap();
        view.snapshot.value(register).map(|it| it.value.to_string())
    };
    assert_eq!(
        shown("output_frequency").as_deref(),
        Some("30.00"),
        "a magnitude"
    );
    assert_eq!(view.control.unwrap().setpoint.unwrap().to_string(), "30.00");
    rig.sent.clear();
    assert_eq!(rig.commanded(MQTT, STOP), DONE);
    assert_eq!(rig.writes(), [single(RUN, 0)], "a stop is one frame");
    rig.live(SECOND * 15);
    rig.sent.clear();
    // The drive holds the setpoint of the last run, which has the other sign.
    assert_eq!(rig.commanded(MQTT, run(Direction::Forward, None)), DONE);
    assert_eq!(rig.writes(), [single(SETPOINT, word(3000)), single(RUN, 1)]);
    rig.live(SECOND * 15);
    assert_eq!(
        (rig.output(1), rig.view(0).run_state),
        (3000, RunState::Forward)
    );
}

#[test]
fn a_setpoint_alone_keeps_the_direction() {
    for (direction, sign) in [(Direction::Forward, 1), (Direction::Reverse, -1)] {
        let mut rig = running(direction);
        assert_eq!(rig.commanded(MQTT, setpoint(2000)), DONE);
        assert_eq!(rig.writes(), [single(SETPOINT, word(sign * 2000))]);
        rig.live(SECOND * 15);
        assert_eq!(rig.output(1), i64::from(sign) * 2000);
        assert_eq!(
            rig.commanded(MQTT, setpoint(6500)),
            (Outcome::Refused, Reason::OutsideLimits)
        );
    }
}

#[test]
fn a_reversal_is_refused_while_the_motor_turns_and_writes_nothing() {
    for (direction, other) in [
        (Direction::Forward, Direction::Reverse),
        (Direction::Reverse, Direction::Forward),
    ] {
        let mut rig = running(direction);
        assert_eq!(
            rig.commanded(MQTT, run(other, Some(2000))),
            (Outcome::Refused, Reason::Reversal)
        );
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    }
    let forward = ControlSettings {
        directions: vec![Direction::Forward],
        ..accepting()
    };
    let mut rig = rig_of(&signed(), forward);
    rig.commanded(MQTT, STOP);
    rig.live(SECOND * 3);
    rig.sent.clear();
    let order = run(Direction::Reverse, Some(2000));
    assert_eq!(
        rig.commanded(MQTT, order),
        (Outcome::Refused, Reason::DirectionNotAllowed)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
}

#[test]
fn a_native_word_is_an_order_only_with_the_sign_in_force() {
    let mut rig = ready(&signed());
    let cases = [
        (RUN, &[1][..], Reason::NotUnderstood),
        (SETPOINT, &[word(-3000)][..], Reason::SignUnknown),
        (SETPOINT, &[0x8000][..], Reason::NotUnderstood),
        (SETPOINT, &[word(-6500)][..], Reason::OutsideLimits),
        (RUN, &[1, word(-6500)][..], Reason::OutsideLimits),
    ];
    for (address, values, reason) in cases {
        assert_eq!(
            write(&mut rig, address, values),
            refused(reason),
            "{address:04X} {values:?}"
        );
    }
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    assert_eq!(
        write(&mut rig, RUN, &[0, word(-3000)]),
        NativeOutcome::Written,
        "a stop"
    );
    rig.live(SECOND * 3);
    rig.sent.clear();
    assert_eq!(
        write(&mut rig, RUN, &[1, word(-3000)]),
        NativeOutcome::Written
    );
    assert_eq!(
        rig.writes(),
        [single(SETPOINT, word(-3000)), single(RUN, 1)]
    );
    // Within the lease of the order: its end would stop the motor.
    rig.pass(SECOND * 2);
    assert!(rig.output(1) < 0, "{}", rig.output(1));
    rig.sent.clear();
    assert_eq!(
        write(&mut rig, SETPOINT, &[word(3000)]),
        refused(Reason::SignUnknown),
        "it would turn the motor round"
    );
    assert_eq!(
        write(&mut rig, RUN, &[1, word(3000)]),
        refused(Reason::Reversal)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    assert_eq!(
        write(&mut rig, SETPOINT, &[word(-2000)]),
        NativeOutcome::Written
    );
    assert_eq!(rig.writes(), [single(SETPOINT, word(-2000))]);
}

#[test]
fn a_motor_that_was_started_elsewhere_gets_no_setpoint_without_a_direction() {
    let mut rig = rig_of(&signed(), accepting());
    let now = rig.now;
    let drive = rig.bus.drive_mut(Station(1)).unwrap();
    for request in [single(SETPOINT, word(-3000)), single(RUN, 1)] {
        assert!(drive.answer(now, &request, 0, &mut Vec::new()));
    }
    rig.live(SECOND * 15);
    assert_eq!(
        (rig.output(1), rig.view(0).run_state),
        (-3000, RunState::Reverse)
    );
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, setpoint(2000)),
        (Outcome::Refused, Reason::SignUnknown)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
}

#[test]
fn a_setpoint_beside_a_wired_run_leaves_the_direction_to_the_wiring() {
    let control = ControlSettings {
        bus: BusFunctions::Frequency,
        ..accepting()
    };
    let mut rig = rig_of(&signed(), control);
    rig.live(SECOND * 3);
    rig.sent.clear();
    assert_eq!(rig.commanded(MQTT, setpoint(2000)), DONE);
    assert_eq!(rig.writes(), [single(SETPOINT, word(2000))]);
}

#[test]
fn a_reversal_whose_setpoint_was_not_answered_is_no_run_forward() {
    let control = ControlSettings {
        reverse_below: vfd_gateway::domain::frequency::Hertz::from_centihertz(6000),
        ..accepting()
    };
    let mut rig = Rig::new(&options_of(&signed(), control));
    rig.commanded(MQTT, STOP);
    rig.live(SECOND * 3);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        DONE
    );
    rig.live(SECOND * 15);
    rig.sent.clear();
    // The setpoint is lost on its way: the drive goes on forward, which nobody knows yet.
    rig.swallows = Some(single(SETPOINT, word(-2000)));
    let (outcome, _) = rig.commanded(MQTT, run(Direction::Reverse, Some(2000)));
    assert_eq!(outcome, Outcome::Failed);
    assert!(
        rig.writes()
            .iter()
            .all(|pdu| *pdu == single(SETPOINT, word(-2000))),
        "no run word: {:?}",
        rig.writes()
    );
    let intent = rig.view(0).control.unwrap().intent;
    assert_eq!(
        intent,
        RunIntent::Run(Direction::Reverse),
        "the drive may have taken it"
    );
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, setpoint(2500)),
        (Outcome::Refused, Reason::SignUnknown),
        "it turns forward"
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    rig.swallows = None;
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(2500))),
        DONE,
        "the next order is whole"
    );
    assert_eq!(rig.writes(), [single(SETPOINT, word(2500)), single(RUN, 1)]);
}
