//! A drive whose reply to a write may carry the old value, and registers that show something else than what was written
//! there: only reading back the right register proves a write.

use crate::support::families::{listing, options_of, register};
use crate::support::{MQTT, Rig, RigOptions, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::{Model, RefusedWrite};

const SECOND: Duration = Duration::from_secs(1);
const CONFIRMED: (Outcome, Reason) = (Outcome::Confirmed, Reason::None);
const MODEL: &str = include_str!("../golden/models/exchange.toml");
const RAMP: u16 = 0x0100;
/// Written, it stores parameters; read, it is the version.
const ENTER: u16 = 0x0110;

fn model() -> Model {
    check::model(MODEL).unwrap()
}

fn rig_of_really(really: Model) -> Rig {
    let options = options_of(&Arc::new(model()), listing(vec![RAMP, ENTER]));
    Rig::new(&RigOptions {
        really: Some(Arc::new(really)),
        ..options
    })
}

#[test]
fn an_old_value_in_a_reply_is_no_refusal() {
    let mut rig = rig_of_really(model());
    assert_eq!(rig.commanded(MQTT, setpoint(3000)), CONFIRMED);
    assert_eq!(rig.commanded(MQTT, register(RAMP, 77)), CONFIRMED);
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(4000))),
        CONFIRMED
    );
    rig.live(SECOND * 4);
    assert!(rig.output(1) > 3000, "{}", rig.output(1));
    let stop = rig.command(MQTT, 0, STOP);
    assert_eq!(rig.outcome_of(stop), CONFIRMED);
    assert!(
        rig.told(stop)
            .iter()
            .all(|(outcome, ..)| *outcome != Outcome::Failed),
        "{:?}",
        rig.told(stop)
    );
    rig.live(SECOND * 15);
    assert_eq!(rig.output(1), 0);
}

#[test]
fn one_that_was_not_taken_is_found_by_reading_it_back() {
    let mut really = model();
    // It answers with the value that it keeps, as the other one may do although it takes the new one.
    really.write.refused.value = RefusedWrite::KeepsOldValue;
    let ramp = really
        .registers
        .iter_mut()
        .find(|it| it.name == "acceleration_time")
        .unwrap();
    ramp.range = Some(1..=100);
    let mut rig = rig_of_really(really);
    let ticket = rig.command(MQTT, 0, register(RAMP, 777));
    assert_eq!(
        rig.outcome_of(ticket),
        (Outcome::Failed, Reason::NotReadBack)
    );
    let report = rig
        .reports
        .iter()
        .rev()
        .find(|(_, answer)| answer.ticket == ticket)
        .unwrap()
        .1
        .report;
    assert!(report.held.is_some_and(|held| held <= 100), "{report:?}");
    assert_eq!(rig.written(RAMP), [777], "once");
}

#[test]
fn nothing_is_read_back_from_a_register_that_shows_something_else() {
    let mut rig = rig_of_really(model());
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, ENTER.into(), 5);
    rig.sent.clear();
    assert_eq!(
        rig.commanded(MQTT, register(ENTER, 9)),
        (Outcome::Acknowledged, Reason::None)
    );
    assert_eq!(rig.written(ENTER), [9]);
    rig.live(SECOND * 2);
    let reads = rig
        .sent
        .iter()
        .filter(|sent| sent.pdu[..3] == [3, 0x01, 0x10]);
    assert_eq!(reads.count(), 0, "what is read there proves nothing");
    let version = rig.read(1, 0, ENTER, 1);
    assert_eq!(
        rig.answer_to(version),
        NativeOutcome::Words(Arc::from([5])),
        "the one that is read"
    );
    // The range of the one that is read is not that of the other.
    assert_eq!(
        rig.commanded(MQTT, register(ENTER, 10)),
        (Outcome::Acknowledged, Reason::None)
    );
}
