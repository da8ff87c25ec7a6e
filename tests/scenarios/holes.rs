//! Reads over addresses without a register, and areas with limits of their own.

use crate::support::families::{accepting, options_of};
use crate::support::{MQTT, Rig, RigOptions, STOP};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Outcome, Reason};
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::Model;

const MODEL: &str = include_str!("../golden/models/exchange.toml");
const STATUS: u16 = 0x0020;

fn model() -> Model {
    check::model(MODEL).unwrap()
}

/// A drive that is what `really` says, behind a gateway that takes it for what its model says.
fn rig_of_really(really: Model) -> Rig {
    let options = options_of(&Arc::new(model()), accepting());
    Rig::new(&RigOptions {
        really: Some(Arc::new(really)),
        ..options
    })
}

fn shown(rig: &Rig, name: &str) -> Option<String> {
    let snapshot = rig.core.snapshot(DriveIndex(0)).unwrap();
    Some(
        snapshot
            .value(model().register_named(name).unwrap())?
            .value
            .to_string(),
    )
}

/// First address and number of words of each read.
fn reads(rig: &Rig) -> Vec<(u16, u16)> {
    let word = |pdu: &[u8], at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
    let reads = rig.sent.iter().filter(|sent| sent.pdu[0] == 3);
    reads
        .map(|sent| (word(&sent.pdu, 1), word(&sent.pdu, 3)))
        .collect()
}

#[test]
fn polls_run_over_holes_that_can_be_read() {
    let mut rig = rig_of_really(model());
    rig.pass(Duration::from_secs(1));
    assert!(reads(&rig).len() >= 2, "it is polled");
    assert!(
        reads(&rig).iter().all(|read| *read == (STATUS, 5)),
        "{:?}",
        reads(&rig)
    );
    assert_eq!(shown(&rig, "dc_link_voltage").as_deref(), Some("540"));
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    let words = rig.read(1, 0, 0x0050, 2);
    assert_eq!(
        rig.answer_to(words),
        NativeOutcome::Words(Arc::from([0, 0])),
        "nothing is there, and nothing says so"
    );
}

#[test]
fn a_drive_that_refuses_them_after_all_is_read_around_them() {
    let mut really = model();
    really.read.holes = None;
    let mut rig = rig_of_really(really);
    rig.pass(Duration::from_secs(2));
    let later = reads(&rig);
    assert!(
        later.contains(&(STATUS, 2)) && later.contains(&(STATUS + 4, 1)),
        "{later:?}"
    );
    assert!(
        !later.contains(&(STATUS, 5)),
        "it is not tried again and again: {later:?}"
    );
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 1);
    rig.pass(Duration::from_secs(2));
    assert_eq!(rig.view(0).trip.active, Some(true), "all values are fresh");
}

#[test]
fn no_read_crosses_the_edge_of_an_area() {
    let mut rig = rig_of_really(model());
    rig.pass(Duration::from_secs(1));
    for (from, count, parts) in [
        (0x00FE, 5, vec![(0x00FE, 2), (0x0100, 2), (0x0102, 1)]),
        (0x01FD, 5, vec![(0x01FD, 2), (0x01FF, 1), (0x0200, 2)]),
        (0x0200, 10, vec![(0x0200, 8), (0x0208, 2)]),
    ] {
        rig.sent.clear();
        let ticket = rig.read(1, 0, from, count);
        let NativeOutcome::Words(words) = rig.answer_to(ticket) else {
            panic!("it is read in parts")
        };
        assert_eq!(words.len(), usize::from(count));
        let native: Vec<_> = reads(&rig)
            .into_iter()
            .filter(|(address, _)| *address >= 0x0080)
            .collect();
        assert_eq!(native, parts);
    }
}
