//! Stored registers that are written in RAM by another address: setpoints go there, parameters to the register itself.

use crate::support::families::{LOCAL, listing, options_of, refused, register, write};
use crate::support::{MQTT, ORIGIN, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::profile::check;

const SECOND: Duration = Duration::from_secs(1);
const CONFIRMED: (Outcome, Reason) = (Outcome::Confirmed, Reason::None);
const MODEL: &str = include_str!("../golden/models/ram-form.toml");
/// Typed a second time: the register, and its form in RAM.
const SETPOINT: (u16, u16) = (0xF002, 0x0002);
const SOURCE: (u16, u16) = (0xF100, 0x0100);
const ACCELERATION: (u16, u16) = (0xF101, 0x0101);
const TORQUE: (u16, u16) = (0xF102, 0x0102);

fn rig_of(text: &str) -> Rig {
    let model = Arc::new(check::model(text).unwrap());
    let mut rig = Rig::new(&options_of(
        &model,
        listing(vec![ACCELERATION.0, ACCELERATION.1]),
    ));
    assert_eq!(rig.commanded(ORIGIN, STOP), CONFIRMED);
    rig.live(SECOND * 4);
    rig.sent.clear();
    rig
}

fn readable() -> String {
    MODEL.replace("readable = false", "readable = true")
}

/// Address and word of all writes so far, in order.
fn writes(rig: &Rig) -> Vec<(u16, u16)> {
    let word = |bytes: &[u8]| u16::from_be_bytes([bytes[0], bytes[1]]);
    rig.writes()
        .iter()
        .map(|pdu| (word(&pdu[1..]), word(&pdu[3..])))
        .collect()
}

/// The addresses of all reads so far.
fn reads(rig: &Rig) -> Vec<u16> {
    let read = rig.sent.iter().filter(|sent| sent.pdu[0] == 3);
    read.map(|sent| u16::from_be_bytes([sent.pdu[1], sent.pdu[2]]))
        .collect()
}

fn stored_writes(rig: &mut Rig) -> u64 {
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .report()
        .stored_writes
}

fn power_cycle(rig: &mut Rig) {
    for powered in [false, true] {
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), powered);
        rig.live(SECOND * 5);
    }
}

fn held(rig: &mut Rig, address: u16) -> u16 {
    let read = rig.read(1, 0, address, 1);
    match rig.answer_to(read) {
        NativeOutcome::Words(words) => words[0],
        other => panic!("{other:?}"),
    }
}

#[test]
fn setpoints_wear_no_memory() {
    let mut rig = rig_of(MODEL);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        CONFIRMED,
        "it is read back in the register"
    );
    for centihertz in [1000, 2000, 2500] {
        assert_eq!(rig.commanded(MQTT, setpoint(centihertz)), CONFIRMED);
    }
    rig.live(SECOND * 10);
    assert_eq!(rig.output(1), 2500);
    let sent = writes(&rig);
    assert!(
        sent.iter().all(|(address, _)| *address != SETPOINT.0),
        "{sent:?}"
    );
    assert_eq!(
        sent.iter()
            .filter(|(address, _)| *address == SETPOINT.1)
            .count(),
        4
    );
    assert_eq!(stored_writes(&mut rig), 0);
    assert!(
        !reads(&rig).contains(&SETPOINT.1),
        "the form cannot be read"
    );
}

#[test]
fn a_setpoint_of_a_native_client_goes_to_ram_whichever_form_it_writes() {
    for form in [SETPOINT.0, SETPOINT.1] {
        let mut rig = rig_of(MODEL);
        assert_eq!(write(&mut rig, form, &[2000]), NativeOutcome::Written);
        assert_eq!(writes(&rig), [(SETPOINT.1, 2000)]);
        assert_eq!(
            write(&mut rig, form, &[9999]),
            refused(Reason::OutsideLimits),
            "it is an order"
        );
    }
}

#[test]
fn parameters_are_stored_by_people_and_written_in_ram_by_who_asks_for_it() {
    let mut rig = rig_of(MODEL);
    assert_eq!(
        rig.commanded(LOCAL, register(ACCELERATION.0, 77)),
        CONFIRMED
    );
    assert_eq!(
        (writes(&rig), stored_writes(&mut rig)),
        (vec![(ACCELERATION.0, 77)], 1)
    );
    rig.sent.clear();
    // As often as wished: nothing wears out.
    for word in [78, 79] {
        assert_eq!(
            rig.commanded(MQTT, register(ACCELERATION.1, word)),
            CONFIRMED
        );
    }
    assert_eq!(writes(&rig), [(ACCELERATION.1, 78), (ACCELERATION.1, 79)]);
    assert_eq!(
        (held(&mut rig, ACCELERATION.0), stored_writes(&mut rig)),
        (79, 1)
    );
    assert_eq!(
        rig.commanded(MQTT, register(ACCELERATION.0, 80)),
        (Outcome::Refused, Reason::WrittenTooOften)
    );
    power_cycle(&mut rig);
    assert_eq!(
        held(&mut rig, ACCELERATION.0),
        77,
        "what was written in RAM is lost"
    );
}

#[test]
fn a_form_that_can_be_read_is_read_back_there() {
    let mut rig = rig_of(&readable());
    assert_eq!(rig.commanded(MQTT, register(ACCELERATION.1, 78)), CONFIRMED);
    assert!(reads(&rig).contains(&ACCELERATION.1));
    assert_eq!(held(&mut rig, ACCELERATION.1), 78);
    let mut rig = rig_of(MODEL);
    let read = rig.read(1, 0, ACCELERATION.1, 1);
    let refused = NativeOutcome::DriveException {
        code: 2,
        reason: Reason::DriveException,
    };
    assert_eq!(rig.answer_to(read), refused);
}

#[test]
fn no_form_is_a_way_around_control() {
    let mut rig = rig_of(MODEL);
    for (address, _) in [(SOURCE.1, 0), (TORQUE.1, 1), (TORQUE.0, 1), (SOURCE.0, 0)] {
        assert_eq!(
            write(&mut rig, address, &[0]),
            refused(Reason::NotAllowed),
            "{address:04X}"
        );
        assert!(
            matches!(
                rig.commanded(MQTT, register(address, 0)),
                (Outcome::Refused, _)
            ),
            "{address:04X}"
        );
    }
    assert_eq!(
        rig.commanded(LOCAL, register(SOURCE.1, 0)),
        (Outcome::Refused, Reason::NotListed)
    );
    assert_eq!(writes(&rig), []);
    // What is set for bus control outlasts the power.
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, SOURCE.0.into(), 0);
    rig.live(SECOND);
    assert_eq!(
        rig.commanded(LOCAL, Order::Setup(vec![SOURCE.0.into()])),
        CONFIRMED
    );
    assert_eq!(writes(&rig), [(SOURCE.0, 2)]);
}

#[test]
fn a_setpoint_whose_answer_is_lost_is_looked_for_in_its_register() {
    let mut rig = rig_of(MODEL);
    rig.loses_reply_to = Some(6);
    assert_eq!(rig.commanded(MQTT, setpoint(2000)), CONFIRMED);
    assert_eq!(writes(&rig), [(SETPOINT.1, 2000)], "it is sent once");
}
