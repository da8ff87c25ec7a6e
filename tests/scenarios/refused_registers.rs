//! A register that the drive refuses to show does not take its neighbours along: the parts of its block are asked, and it
//! alone is left out.

use crate::support::families::{accepting, rig_of};
use crate::support::{MQTT, Rig, STOP, model, run};
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::drive::plan::RefusedRegister;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::profile::model::{Model, PollClass};
use vfd_gateway::sim::SimDrive;

const SECOND: Duration = Duration::from_secs(1);
const ADDRESS: u8 = 0x02;

fn drive(rig: &mut Rig) -> &mut SimDrive {
    rig.bus.drive_mut(Station(1)).unwrap()
}

/// The polled registers that are not read, or not any more.
fn missing(rig: &Rig, model: &Model) -> Vec<Address> {
    let polled = model
        .registers
        .iter()
        .filter(|it| matches!(it.poll, Some(PollClass::Fast | PollClass::Second)));
    let is_fresh = |address| {
        let reading = rig.view(0).snapshot.reading(address);
        reading.is_some_and(|reading| rig.now.since(reading.at) < SECOND * 10)
    };
    polled
        .map(|it| it.address)
        .filter(|address| !is_fresh(*address))
        .collect()
}

fn refusals(rig: &Rig) -> u64 {
    rig.core.counters().exceptions
}

#[test]
fn its_neighbours_are_read_all_the_same() {
    for (id, number, code) in [
        ("frecon-fr500a", 0x3007, ADDRESS),
        ("teco-e510", 0x2527, 0x52),
    ] {
        let model = model(id);
        let address = Address::holding(number);
        let refused = RefusedRegister { address, code };
        let mut rig = rig_of(&model, accepting());
        rig.live(SECOND * 5);
        drive(&mut rig).refuses_at(address);
        rig.live(SECOND * 30);
        assert_eq!(missing(&rig, &model), [address], "{id}");
        assert_eq!(rig.view(0).refused, [refused], "{id}");
        let told = |rig: &Rig| {
            rig.notes
                .iter()
                .filter(|(_, note)| *note == DriveNote::RegisterRefused(refused))
                .count()
        };
        assert_eq!(told(&rig), 1, "{id}");
        let begun = refusals(&rig);
        assert!(
            (1..=20).contains(&begun),
            "{id}: {begun} exchanges were spent"
        );
        rig.live(SECOND * 3500);
        assert_eq!(
            (refusals(&rig), told(&rig)),
            (begun, 1),
            "{id}: it is left alone for an hour"
        );
        rig.live(SECOND * 200);
        assert_eq!(
            (refusals(&rig), told(&rig)),
            (begun + 1, 1),
            "{id}: and asked then"
        );
        // After an outage it is asked at once, and if it answers, it is polled again.
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), false);
        rig.live(SECOND * 30);
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), true);
        drive(&mut rig).shows_the_truth();
        rig.live(SECOND * 60);
        assert_eq!(
            (missing(&rig, &model), rig.view(0).refused.len()),
            (Vec::new(), 0),
            "{id}"
        );
    }
}

#[test]
fn a_stop_is_not_delayed_while_the_parts_are_asked() {
    let model = model("frecon-fr500a");
    for lead_ms in 0..40 {
        let mut rig = rig_of(&model, accepting());
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 5);
        drive(&mut rig).refuses_at(Address::holding(0x3007));
        rig.live(SECOND + Duration::from_millis(lead_ms * 25));
        let before = rig.sent.len();
        let ticket = rig.command(MQTT, 0, STOP);
        rig.pass(Duration::from_millis(300));
        let stop = rig.sent[before..]
            .iter()
            .position(|sent| sent.frame[1] == 6);
        assert!(stop.is_some_and(|place| place <= 1), "{lead_ms}: {stop:?}");
        assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
    }
}
