//! A drive refuses in its vendor's way, and that is reported to the client: with the value that the drive kept, or with
//! its exception code.

use crate::support::families::{accepting, quiet, rig_of, single, stopped, write};
use crate::support::{MQTT, Rig, model, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason, Report, RunIntent};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::wire::rtu;

const SECOND: Duration = Duration::from_secs(1);

/// How a drive refuses.
#[derive(Clone, Copy)]
enum No {
    KeepsOldValue,
    Exception(u8),
}
use No::{Exception, KeepsOldValue};

/// Model, address of the frequency command, and how it refuses 61 Hz, which is more than it takes.
const TOO_FAST: &[(&str, u16, No)] = &[
    ("hyundai-n700", 0x0004, KeepsOldValue),
    ("hyundai-n100plus", 0x0004, KeepsOldValue),
    ("toshiba-vf-as1", 0xFA01, Exception(3)),
    ("toshiba-vf-s15", 0xFA01, Exception(3)),
    ("teco-e510", 0x2502, Exception(0x54)),
    ("teco-e510s", 0x2502, Exception(3)),
    ("frecon-fr500a", 0x2001, Exception(3)),
];
/// Model, address of the run source, a panel there, and how the drive refuses to run.
const AT_THE_PANEL: &[(&str, u16, u16, No)] = &[
    ("hyundai-n700", 0x0212, 2, KeepsOldValue),
    ("hyundai-n100plus", 0x0302, 0, KeepsOldValue),
    ("teco-e510", 0x0002, 0, Exception(0x55)),
    ("teco-e510s", 0x0002, 0, Exception(3)),
    ("frecon-fr500a", 0x0200, 0, Exception(4)),
];
/// The codes that the manuals name.
const CODES: &[(&str, &[u8])] = &[
    ("toshiba-vf-as1", &[1, 2, 3, 4]),
    ("toshiba-vf-s15", &[1, 2, 3, 4]),
    ("teco-e510", &[0x51, 0x52, 0x53, 0x54, 0x55]),
    ("teco-e510s", &[1, 2, 3, 4, 0x51, 0x52]),
    ("frecon-fr500a", &[1, 2, 3, 4, 0x11]),
];

/// Up to 65 Hz, more than the simulated drives take.
fn wide() -> ControlSettings {
    ControlSettings {
        most: Hertz::from_centihertz(6500),
        ..accepting()
    }
}

fn report_of(no: No, held: u16) -> Report {
    match no {
        KeepsOldValue => Report {
            held: Some(held),
            ..Report::new(Outcome::Failed, Reason::KeptOldValue)
        },
        Exception(code) => Report {
            exception: Some(code),
            ..Report::new(Outcome::Failed, Reason::DriveException)
        },
    }
}

fn native_of(no: No, held: u16) -> NativeOutcome {
    match no {
        KeepsOldValue => NativeOutcome::KeptOldValue(held),
        Exception(code) => NativeOutcome::DriveException {
            code,
            reason: Reason::DriveException,
        },
    }
}

/// Commands, and returns the whole final report.
fn told(rig: &mut Rig, order: vfd_gateway::domain::command::Order) -> Report {
    let ticket = rig.command(MQTT, 0, order);
    rig.outcome_of(ticket);
    rig.reports
        .iter()
        .rfind(|(_, answer)| answer.ticket == ticket)
        .expect("it was told")
        .1
        .report
}

#[test]
fn a_setpoint_beyond_the_drive_is_reported_as_refused_and_the_old_one_stays() {
    for (id, _, no) in TOO_FAST {
        let mut rig = rig_of(&model(id), wide());
        assert_eq!(
            told(&mut rig, setpoint(2000)).outcome,
            Outcome::Confirmed,
            "{id}"
        );
        assert_eq!(told(&mut rig, setpoint(6100)), report_of(*no, 2000), "{id}");
        assert_eq!(
            told(&mut rig, setpoint(2500)).outcome,
            Outcome::Confirmed,
            "{id}: the next one is taken"
        );
        let told = told(&mut rig, run(Direction::Forward, None));
        assert!(
            matches!(told.outcome, Outcome::Confirmed | Outcome::Acknowledged),
            "{id}: {told:?}"
        );
        rig.live(SECOND * 8);
        assert_eq!(rig.output(1), 2500, "{id}");
    }
}

#[test]
fn a_run_with_a_setpoint_beyond_the_drive_starts_nothing() {
    for (id, _, no) in TOO_FAST {
        let mut rig = rig_of(&model(id), wide());
        assert_eq!(
            told(&mut rig, setpoint(2000)).outcome,
            Outcome::Confirmed,
            "{id}"
        );
        rig.sent.clear();
        assert_eq!(
            told(&mut rig, run(Direction::Forward, Some(6100))),
            report_of(*no, 2000),
            "{id}"
        );
        assert_eq!(rig.writes().len(), 1, "{id}: {:02X?}", rig.writes());
        assert_eq!(rig.view(0).control.unwrap().intent, RunIntent::Stop, "{id}");
        rig.live(SECOND * 3);
        assert_eq!(rig.output(1), 0, "{id}");
    }
}

#[test]
fn a_native_writer_gets_the_same_answer() {
    for (id, address, no) in TOO_FAST {
        let mut rig = stopped(id, wide());
        assert_eq!(
            write(&mut rig, *address, &[2000]),
            NativeOutcome::Written,
            "{id}"
        );
        rig.pass(SECOND);
        assert_eq!(
            write(&mut rig, *address, &[6100]),
            native_of(*no, 2000),
            "{id}"
        );
        assert_eq!(
            rig.writes(),
            [single(*address, 2000), single(*address, 6100)],
            "{id}"
        );
    }
}

#[test]
fn a_drive_that_its_panel_commands_refuses_to_run_and_no_intent_is_left() {
    for (id, source, panel, no) in AT_THE_PANEL {
        let mut rig = rig_of(&model(id), accepting());
        assert_eq!(
            told(&mut rig, setpoint(2000)).outcome,
            Outcome::Confirmed,
            "{id}"
        );
        let now = rig.now;
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .set_locally(now, (*source).into(), *panel);
        assert_eq!(
            told(&mut rig, run(Direction::Forward, None)),
            report_of(*no, 0),
            "{id}"
        );
        assert_eq!(rig.view(0).control.unwrap().intent, RunIntent::Stop, "{id}");
        rig.live(SECOND * 3);
        assert_eq!(rig.output(1), 0, "{id}");
    }
}

#[test]
fn every_code_of_a_vendor_is_passed_on_as_it_is() {
    for (id, codes) in CODES {
        let known: Vec<u8> = model(id)
            .exceptions
            .iter()
            .filter_map(|it| u8::try_from(it.code).ok())
            .collect();
        for code in *codes {
            assert!(known.contains(code), "{id}: {code:02X}");
            let mut rig = quiet(id, accepting());
            // The drive's answer is supplied by the test.
            let now = rig.now;
            rig.bus.set_powered(now, Station(1), false);
            let ticket = rig.command(MQTT, 0, setpoint(2000));
            while rig.writes().is_empty() {
                assert!(rig.step(rig.now + SECOND), "{id}");
            }
            let now = rig.now + Duration::from_millis(30);
            rig.pass(Duration::from_millis(30));
            let function = rig.writes()[0][0];
            let mut frame = Vec::new();
            rtu::encode(&mut frame, 1, |pdu| pdu.extend([function | 0x80, *code]));
            rig.core.handle(now, LineInput::Bytes(&frame));
            assert_eq!(
                rig.outcome_of(ticket),
                (Outcome::Failed, Reason::DriveException),
                "{id}"
            );
            assert_eq!(
                rig.reports.last().unwrap().1.report.exception,
                Some(*code),
                "{id}"
            );
        }
    }
}
