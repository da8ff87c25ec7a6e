//! Orders with registers of their own, holding registers or coils: the direction goes before the run word and is never
//! given by half, a reset is cleared whatever happens, and no write reaches such a register by another way.

use crate::support::families::{accepting, listing, options_of, ready, refused, rig_of, write};
use crate::support::{MQTT, Rig, RigOptions, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::{Address, DataTable};
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::{Model, ParameterKind};

const SECOND: Duration = Duration::from_secs(1);
const ORDERS: &str = include_str!("../golden/models/orders.toml");
const RUN: u16 = 0x2000;
const DIRECTION: u16 = 0x2001;
const RESET: u16 = 0x2002;
const CAUSE: u16 = 2;

/// The functions by which one word is written: holding register, coil.
const SINGLE: [u8; 2] = [6, 5];

fn words() -> Arc<Model> {
    Arc::new(check::model(ORDERS).unwrap())
}

/// The same drive with coils in the place of the three registers.
fn coils() -> Arc<Model> {
    let mut model = check::model(ORDERS).unwrap();
    let coil = |address: &mut Address| *address = Address::new(DataTable::Coil, address.number());
    model.functions.value.extend([0x01, 0x05]);
    model.write.block = None;
    let run = model.run.as_mut().unwrap();
    // A coil has two states.
    run.coast = None;
    run.never.clear();
    run.places.never.clear();
    run.places
        .registers
        .iter_mut()
        .for_each(|(_, address)| coil(address));
    coil(&mut run.places.direction.as_mut().unwrap().value.address);
    let of_orders = model
        .registers
        .iter_mut()
        .filter(|it| (RUN..=RESET).contains(&it.address.number()));
    of_orders.for_each(|register| coil(&mut register.address));
    model.registers.sort_by_key(|register| register.address);
    Arc::new(model)
}

fn both() -> [(Arc<Model>, DataTable); 2] {
    [(words(), DataTable::Holding), (coils(), DataTable::Coil)]
}

/// The words written so far, each with its register.
fn orders(rig: &Rig) -> Vec<(u16, u16)> {
    let writes = rig.sent.iter().filter(|sent| SINGLE.contains(&sent.pdu[0]));
    let word = |pdu: &[u8], at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
    let value = |pdu: &[u8]| {
        if pdu[0] == 5 {
            u16::from(word(pdu, 3) == 0xFF00)
        } else {
            word(pdu, 3)
        }
    };
    writes
        .map(|sent| (word(&sent.pdu, 1), value(&sent.pdu)))
        .collect()
}

/// The PDU of a write of one word.
fn pdu(table: DataTable, register: u16, word: u16) -> Vec<u8> {
    let function = if table == DataTable::Coil { 5 } else { 6 };
    let word = if table == DataTable::Coil {
        word * 0xFF00
    } else {
        word
    };
    [
        vec![function],
        register.to_be_bytes().to_vec(),
        word.to_be_bytes().to_vec(),
    ]
    .concat()
}

fn held(rig: &mut Rig, table: DataTable, register: u16) -> Option<u16> {
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .word(Address::new(table, register))
}

fn trip(rig: &mut Rig) {
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
    rig.live(SECOND * 4);
    assert_eq!(rig.view(0).run_state, RunState::Tripped);
    rig.sent.clear();
}

#[test]
fn the_direction_goes_before_the_run_word_and_a_stop_is_one_frame() {
    for (model, _) in both() {
        let mut rig = ready(&model);
        rig.commanded(MQTT, setpoint(3000));
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Reverse, None)),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(orders(&rig), [(DIRECTION, 1), (RUN, 1)]);
        rig.live(SECOND * 5);
        assert!(rig.output(1) < 0, "{}", rig.output(1));
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(orders(&rig), [(RUN, 0)]);
        rig.live(SECOND * 15);
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, None)),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(orders(&rig), [(DIRECTION, 0), (RUN, 1)]);
        rig.live(SECOND * 5);
        assert!(rig.output(1) > 0, "{}", rig.output(1));
    }
}

#[test]
fn without_the_direction_no_run_word_is_sent() {
    for (model, table) in both() {
        let mut rig = ready(&model);
        rig.swallows = Some(pdu(table, DIRECTION, 1));
        let order = run(Direction::Reverse, Some(3000));
        assert_eq!(
            rig.commanded(MQTT, order.clone()),
            (Outcome::Failed, Reason::NoReply)
        );
        rig.live(SECOND * 10);
        assert_eq!(
            orders(&rig)
                .iter()
                .filter(|(register, _)| *register == RUN)
                .count(),
            0,
            "{:?}",
            orders(&rig)
        );
        assert_eq!(rig.output(1), 0);
        let shown = rig.view(0).control.unwrap();
        assert!(
            !matches!(
                shown.intent,
                vfd_gateway::domain::command::RunIntent::Run(_)
            ),
            "{shown:?}"
        );
        rig.swallows = None;
        assert_eq!(
            rig.commanded(MQTT, order),
            (Outcome::Confirmed, Reason::None),
            "the next order is whole"
        );
    }
}

#[test]
fn a_direction_that_the_drive_does_not_hold_runs_nothing() {
    for (model, table) in both() {
        // The drive acknowledges the direction, and keeps its own.
        let mut really = Model::clone(&model);
        let shown = really
            .registers
            .iter_mut()
            .find(|it| it.address.number() == DIRECTION)
            .unwrap();
        shown.name = "something_else".to_owned();
        shown.role = None;
        let words = &mut really.run.as_mut().unwrap().places.direction;
        words.as_mut().unwrap().value.address = Address::new(table, 0x2FFF);
        let options = options_of(&model, accepting());
        let mut rig = Rig::new(&RigOptions {
            really: Some(Arc::new(really)),
            ..options
        });
        rig.commanded(MQTT, STOP);
        rig.live(SECOND * 3);
        rig.sent.clear();
        let ticket = rig.command(MQTT, 0, run(Direction::Reverse, Some(3000)));
        while !orders(&rig).contains(&(DIRECTION, 1)) {
            rig.step(rig.now + SECOND);
        }
        rig.step(rig.now + SECOND);
        // A terminal sets it back before it is read.
        let now = rig.now;
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .set_locally(now, Address::new(table, DIRECTION), 0);
        assert_eq!(
            rig.outcome_of(ticket),
            (Outcome::Failed, Reason::KeptOldValue)
        );
        let last = rig.view(0).control.unwrap().last.unwrap();
        assert_eq!(
            (last.held, last.register),
            (Some(0), Some(Address::new(table, DIRECTION)))
        );
        assert!(!orders(&rig).contains(&(RUN, 1)), "{:?}", orders(&rig));
    }
}

#[test]
fn a_reset_is_cleared_in_the_same_list() {
    for (model, table) in both() {
        let mut rig = ready(&model);
        trip(&mut rig);
        assert_eq!(
            rig.commanded(MQTT, Order::Reset),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(orders(&rig), [(RUN, 0), (RESET, 1), (RESET, 0)]);
        assert_eq!(held(&mut rig, table, RESET), Some(0));
        rig.live(SECOND * 3);
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, Some(3000))),
            (Outcome::Confirmed, Reason::None)
        );
    }
}

#[test]
fn a_stop_between_reset_and_clear_leaves_no_reset_standing() {
    for (model, table) in both() {
        let mut rig = ready(&model);
        trip(&mut rig);
        let reset = rig.command(MQTT, 0, Order::Reset);
        while !orders(&rig).contains(&(RESET, 1)) {
            rig.step(rig.now + SECOND);
        }
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(
            rig.outcome_of(reset),
            (Outcome::Superseded, Reason::Stopped)
        );
        // At once: the next trip would be reset by it.
        rig.live(SECOND / 4);
        assert_eq!(orders(&rig), [(RUN, 0), (RESET, 1), (RUN, 0), (RESET, 0)]);
        assert_eq!(held(&mut rig, table, RESET), Some(0));
        assert!(
            rig.notes
                .iter()
                .any(|(_, note)| *note == DriveNote::ResetTakenBack)
        );
    }
}

#[test]
fn a_clear_without_an_answer_is_sent_again() {
    for (model, table) in both() {
        let mut rig = ready(&model);
        trip(&mut rig);
        rig.swallows = Some(pdu(table, RESET, 0));
        let reset = rig.command(MQTT, 0, Order::Reset);
        assert_eq!(rig.outcome_of(reset), (Outcome::Unknown, Reason::NoReply));
        assert_eq!(held(&mut rig, table, RESET), Some(1));
        rig.swallows = None;
        rig.live(SECOND * 12);
        assert_eq!(held(&mut rig, table, RESET), Some(0), "{:?}", orders(&rig));
    }
}

#[test]
fn a_native_write_to_such_a_register_is_an_order_or_refused() {
    let model = words();
    let mut rig = rig_of(&model, listing(vec![]));
    assert_eq!(
        write(&mut rig, RUN, &[0]),
        NativeOutcome::Written,
        "a stop is a stop"
    );
    rig.pass(SECOND * 3);
    rig.sent.clear();
    // Half an order, and words that order nothing.
    for (register, word) in [
        (RUN, 1),
        (DIRECTION, 0),
        (DIRECTION, 1),
        (RESET, 7),
        (RESET, 9),
        (DIRECTION, 2),
    ] {
        assert_eq!(
            write(&mut rig, register, &[word]),
            refused(Reason::NotUnderstood),
            "{register:04X} {word}"
        );
    }
    assert_eq!(
        write(&mut rig, RESET, &[1]),
        NativeOutcome::Written,
        "a reset without a trip changes nothing"
    );
    assert_eq!(
        write(&mut rig, RESET, &[0]),
        NativeOutcome::Written,
        "the end of a reset orders nothing"
    );
    assert_eq!(orders(&rig), [], "none of them reached the wire");
    // Both halves in one frame.
    write(&mut rig, 0x2004, &[3000]);
    rig.sent.clear();
    assert_eq!(write(&mut rig, RUN, &[1, 1]), NativeOutcome::Written);
    assert_eq!(orders(&rig), [(DIRECTION, 1), (RUN, 1)]);
    let kind = |register: u16| model.register_at(register).unwrap().parameter_kind();
    assert_eq!(
        [RUN, DIRECTION, RESET].map(kind),
        [ParameterKind::Command; 3],
        "none is a parameter"
    );
    assert!(
        [RUN, DIRECTION, RESET]
            .into_iter()
            .all(|it| !model.is_stored(it))
    );
}
