//! A drive that serves no function 06 takes everything by function 10 hex, one register at a time.

use crate::support::families::{accepting, listing, model_with, register, rig_of, write};
use crate::support::{MQTT, Rig, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::profile::model::Model;

const SECOND: Duration = Duration::from_secs(1);

/// The models whose drives refuse a write by an exception, as one without 06 must.
fn without_06() -> Vec<Arc<Model>> {
    let change = |model: &mut Model| {
        model.functions.value.retain(|function| *function != 0x06);
        model.functions.value.push(0x10);
        model.link.broadcast = None;
    };
    ["teco-e510", "frecon-fr500a", "toshiba-vf-as1"]
        .map(|id| model_with(id, change))
        .to_vec()
}

fn is_taken(rig: &mut Rig, order: Order) {
    let (outcome, reason) = rig.commanded(MQTT, order);
    assert!(
        matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
        "{outcome:?} {reason:?}"
    );
}

fn functions(rig: &Rig) -> Vec<u8> {
    let mut functions: Vec<u8> = rig.sent.iter().map(|sent| sent.pdu[0]).collect();
    functions.sort_unstable();
    functions.dedup();
    functions
}

#[test]
fn it_is_set_started_stopped_and_reset_by_blocks_of_one() {
    for model in without_06() {
        let mut rig = rig_of(&model, accepting());
        rig.sent.clear();
        is_taken(&mut rig, setpoint(3000));
        is_taken(&mut rig, run(Direction::Forward, None));
        rig.live(SECOND * 6);
        assert!(rig.output(1) > 0, "{}", model.id);
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None),
            "{}",
            model.id
        );
        rig.live(SECOND * 15);
        assert_eq!(rig.output(1), 0, "{}", model.id);
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 2);
        rig.live(SECOND * 3);
        is_taken(&mut rig, Order::Reset);
        assert!(
            !functions(&rig).contains(&6),
            "{}: {:?}",
            model.id,
            functions(&rig)
        );
        assert!(functions(&rig).contains(&0x10), "{}", model.id);
    }
}

#[test]
fn its_parameters_are_written_and_read_back_and_a_native_06_is_served() {
    let [e510, ..] = &without_06()[..] else {
        panic!("three models")
    };
    let parameter = e510
        .registers
        .iter()
        .find(|it| it.name == "acceleration_time")
        .expect("it is described");
    let address = parameter.address.number();
    let mut rig = rig_of(e510, listing(vec![address]));
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, register(address, 77)),
        (Outcome::Confirmed, Reason::None)
    );
    rig.live(SECOND * 11);
    assert_eq!(write(&mut rig, address, &[78]), NativeOutcome::Written);
    assert!(!functions(&rig).contains(&6), "{:?}", functions(&rig));
}

#[test]
fn a_lost_reply_is_resolved_by_reading_and_the_write_is_not_repeated() {
    for model in without_06() {
        let mut rig = rig_of(&model, accepting());
        rig.sent.clear();
        rig.loses_reply_to = Some(0x10);
        is_taken(&mut rig, setpoint(3000));
        let writes = rig.sent.iter().filter(|sent| sent.pdu[0] == 0x10).count();
        assert_eq!(writes, 1, "{}", model.id);
    }
}
