//! Parameters that act, or outlast the drive's power, only after a word of their own: it follows them once, never an order
//! to move, and no more often than a memory lasts.

use crate::support::families::{LOCAL, listing, options_of, refused, register, write};
use crate::support::{MQTT, ORIGIN, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, GoOrder, Order, Outcome, Reason, RegisterWrite};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::ExceptionKind::Locked;

const SECOND: Duration = Duration::from_secs(1);
const CONFIRMED: (Outcome, Reason) = (Outcome::Confirmed, Reason::None);
const MODEL: &str = include_str!("../golden/models/memory.toml");
/// Typed a second time.
const SOURCE: u16 = 0x0100;
const ACCELERATION: u16 = 0x0101;
const DECELERATION: u16 = 0x0102;
const ENTER: (u16, u16) = (0x0200, 1);
const SAVE: (u16, u16) = (0x0201, 2);

fn rig_with(text: &str, stores_native_writes: bool) -> Rig {
    let model = Arc::new(check::model(text).unwrap());
    let control = ControlSettings {
        stores_native_writes,
        ..listing(vec![ACCELERATION, DECELERATION])
    };
    let mut rig = Rig::new(&options_of(&model, control));
    assert_eq!(rig.commanded(MQTT, STOP), CONFIRMED);
    rig.live(SECOND * 4);
    rig.sent.clear();
    rig
}

fn at_rest() -> Rig {
    rig_with(MODEL, false)
}

/// The same without the word that applies.
fn without_apply() -> String {
    let (before, apply) = MODEL.split_once("[commit.apply]").unwrap();
    format!(
        "{before}{}",
        &apply[apply.find("[commit.store]").unwrap()..]
    )
}

/// Address and word of all writes so far, in order.
fn writes(rig: &Rig) -> Vec<(u16, u16)> {
    let word = |bytes: &[u8]| u16::from_be_bytes([bytes[0], bytes[1]]);
    rig.writes()
        .iter()
        .map(|pdu| (word(&pdu[1..]), word(&pdu[3..])))
        .collect()
}

fn held(rig: &mut Rig, address: u16) -> u16 {
    let read = rig.read(1, 0, address, 1);
    match rig.answer_to(read) {
        NativeOutcome::Words(words) => words[0],
        other => panic!("{other:?}"),
    }
}

/// Switches the drive off and on.
fn power_cycle(rig: &mut Rig) {
    for powered in [false, true] {
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), powered);
        rig.live(SECOND * 5);
    }
}

fn commit((address, word): (u16, u16)) -> Order {
    register(address, word)
}

#[test]
fn a_native_write_is_applied_and_lost_with_the_power() {
    let mut rig = at_rest();
    assert_eq!(write(&mut rig, ACCELERATION, &[77]), NativeOutcome::Written);
    assert_eq!(writes(&rig), [(ACCELERATION, 77), ENTER]);
    assert_eq!(
        held(&mut rig, ACCELERATION),
        77,
        "without the word the drive would show what it was"
    );
    // Also while the motor turns, and as often as wished.
    rig.live(SECOND);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        CONFIRMED
    );
    rig.sent.clear();
    assert_eq!(rig.commanded(MQTT, register(ACCELERATION, 78)), CONFIRMED);
    assert_eq!(writes(&rig), [(ACCELERATION, 78), ENTER]);
    rig.sent.clear();
    power_cycle(&mut rig);
    assert_ne!(held(&mut rig, ACCELERATION), 78);
    assert_eq!(
        writes(&rig)
            .iter()
            .filter(|it| [ENTER, SAVE].contains(it))
            .count(),
        0
    );
}

#[test]
fn orders_to_move_are_never_followed_by_it_and_never_beside_it() {
    let mut rig = rig_with(MODEL, true);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        CONFIRMED
    );
    assert_eq!(rig.commanded(MQTT, setpoint(2000)), CONFIRMED);
    assert_eq!(rig.commanded(MQTT, STOP), CONFIRMED);
    rig.live(SECOND * 20);
    let sent = writes(&rig);
    assert!(
        !sent
            .iter()
            .any(|(address, _)| [ENTER.0, SAVE.0].contains(address)),
        "{sent:?}"
    );
    for stores in [false, true] {
        let mut rig = rig_with(MODEL, stores);
        let parameter = RegisterWrite::new(ACCELERATION, 77);
        let both = GoOrder::new(vec![parameter], None, Some(Direction::Forward)).unwrap();
        assert_eq!(
            rig.commanded(MQTT, Order::Go(both)),
            (Outcome::Refused, Reason::Conflict)
        );
        assert_eq!(writes(&rig), []);
    }
}

#[test]
fn a_block_of_parameters_is_followed_by_one_word() {
    let mut rig = rig_with(MODEL, true);
    assert_eq!(
        write(&mut rig, ACCELERATION, &[77, 88]),
        NativeOutcome::Written
    );
    assert_eq!(writes(&rig), [(ACCELERATION, 77), (DECELERATION, 88), SAVE]);
    power_cycle(&mut rig);
    assert_eq!(
        (held(&mut rig, ACCELERATION), held(&mut rig, DECELERATION)),
        (77, 88),
        "it outlasts the power"
    );
}

#[test]
fn what_stores_is_sent_at_standstill_alone_and_no_more_often_than_a_memory_lasts() {
    let mut rig = rig_with(MODEL, true);
    assert_eq!(write(&mut rig, ACCELERATION, &[77]), NativeOutcome::Written);
    rig.live(SECOND * 2);
    rig.sent.clear();
    assert_eq!(
        write(&mut rig, DECELERATION, &[77]),
        refused(Reason::WrittenTooOften)
    );
    assert_eq!(
        writes(&rig),
        [],
        "a parameter that would not be stored is not written"
    );
    rig.live(SECOND * 9);
    assert_eq!(write(&mut rig, DECELERATION, &[77]), NativeOutcome::Written);
    rig.live(SECOND * 11);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        CONFIRMED
    );
    rig.live(SECOND * 2);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, register(ACCELERATION, 99)),
        (Outcome::Refused, Reason::Moving)
    );
    assert_eq!(writes(&rig), []);
}

#[test]
fn what_stores_is_heard_although_the_drive_is_deaf_afterwards() {
    let mut rig = rig_with(&without_apply(), true);
    let ticket = rig.command(MQTT, 0, register(ACCELERATION, 77));
    assert_eq!(
        rig.outcome_of(ticket),
        CONFIRMED,
        "it is read back when the drive hears again"
    );
    assert_eq!(writes(&rig), [(ACCELERATION, 77), SAVE]);
    power_cycle(&mut rig);
    assert_eq!(held(&mut rig, ACCELERATION), 77);
}

#[test]
fn a_person_restores_one_after_the_other_and_stores_once() {
    let mut rig = at_rest();
    for (address, word) in [(ACCELERATION, 77), (DECELERATION, 88)] {
        assert_eq!(rig.commanded(LOCAL, register(address, word)), CONFIRMED);
    }
    assert_eq!(
        rig.commanded(LOCAL, commit(SAVE)),
        (Outcome::Acknowledged, Reason::None)
    );
    assert_eq!(
        writes(&rig),
        [(ACCELERATION, 77), ENTER, (DECELERATION, 88), ENTER, SAVE]
    );
    assert_eq!(
        rig.commanded(LOCAL, commit(SAVE)),
        (Outcome::Refused, Reason::WrittenTooOften)
    );
    power_cycle(&mut rig);
    assert_eq!(
        (held(&mut rig, ACCELERATION), held(&mut rig, DECELERATION)),
        (77, 88)
    );
    // With another word it is no commit, and no client may send any.
    assert_eq!(
        rig.commanded(LOCAL, commit((SAVE.0, 1))),
        (Outcome::Refused, Reason::NotAllowed)
    );
    assert_eq!(
        rig.commanded(ORIGIN, commit(SAVE)),
        (Outcome::Refused, Reason::NotListed)
    );
    rig.live(SECOND * 11);
    assert_eq!(rig.commanded(MQTT, STOP), CONFIRMED);
    rig.live(SECOND * 4);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
        CONFIRMED
    );
    rig.live(SECOND);
    assert_eq!(
        rig.commanded(LOCAL, commit(SAVE)),
        (Outcome::Refused, Reason::OtherOwner),
        "while somebody runs it"
    );
}

#[test]
fn what_is_enabled_is_stored() {
    let mut rig = at_rest();
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, SOURCE.into(), 0);
    rig.live(SECOND);
    assert_eq!(
        rig.commanded(LOCAL, Order::Setup(vec![SOURCE.into()])),
        CONFIRMED
    );
    assert_eq!(writes(&rig), [(SOURCE, 2), SAVE]);
    power_cycle(&mut rig);
    assert_eq!(held(&mut rig, SOURCE), 2);
}

#[test]
fn a_word_that_the_drive_does_not_take_is_told() {
    let mut rig = rig_with(MODEL, true);
    let ticket = rig.command(MQTT, 0, register(ACCELERATION, 77));
    // The write is answered well, what follows is not.
    while rig.writes().is_empty() {
        rig.step(rig.now + SECOND);
    }
    rig.bus.drive_mut(Station(1)).unwrap().object(Locked, 1);
    assert_eq!(
        rig.outcome_of(ticket),
        (Outcome::Failed, Reason::NotCommitted)
    );
    let report = rig
        .reports
        .iter()
        .rev()
        .find(|(_, answer)| answer.ticket == ticket)
        .unwrap()
        .1
        .report;
    assert_eq!(report.exception, Some(7));
    assert_eq!(
        writes(&rig),
        [(ACCELERATION, 77), SAVE],
        "it is not tried again"
    );

    let mut rig = rig_with(MODEL, true);
    rig.swallows = Some(vec![6, 0x02, 0x01, 0x00, 0x02]);
    assert_eq!(
        rig.commanded(MQTT, register(ACCELERATION, 77)),
        (Outcome::Unknown, Reason::NotCommitted)
    );
    assert_eq!(
        writes(&rig).iter().filter(|it| **it == SAVE).count(),
        1,
        "it is sent once"
    );
}

#[test]
fn a_word_that_is_unproven_is_never_sent() {
    let proven = "confidence = \"manual\"\nsource = \"IM 8\"\n\n[run]";
    let text = without_apply().replacen(proven, &proven.replace("manual", "inferred"), 1);
    let mut rig = rig_with(&text, true);
    assert_eq!(write(&mut rig, ACCELERATION, &[77]), NativeOutcome::Written);
    assert_eq!(rig.commanded(LOCAL, register(DECELERATION, 88)), CONFIRMED);
    assert_eq!(
        rig.commanded(LOCAL, commit(SAVE)),
        (Outcome::Refused, Reason::NotAllowed)
    );
    assert_eq!(writes(&rig), [(ACCELERATION, 77), (DECELERATION, 88)]);
}
