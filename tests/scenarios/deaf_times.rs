//! A drive that is deaf for a while is not taken for a dead one.

use crate::support::{MQTT, PROOF, Rig, RigOptions, STOP, control, model};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::profile::model::Model;
use vfd_gateway::sim::FaultPlan;

const SECOND: Duration = Duration::from_secs(1);

#[test]
fn a_drive_that_was_switched_on_again_is_met_soon_after_it_can_hear() {
    let model = model("toshiba-vf-as1");
    let deaf = model
        .quirks
        .deaf_after_power_up
        .as_ref()
        .expect("it is deaf for a while")
        .value;
    let options = RigOptions {
        link: model.link.played(),
        model,
        poll: SECOND / 10,
        ..RigOptions::default()
    };
    for off in [50, 200, 350] {
        let mut rig = Rig::new(&options);
        let lost = rig.now;
        let off = Duration::from_millis(off);
        rig.bus.set_powered(lost, Station(1), false);
        rig.pass(off);
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), true);
        rig.pass(deaf);
        assert_eq!(
            rig.view(0).snapshot.presence,
            DrivePresence::Offline,
            "silence is told all the same"
        );
        let hears = rig.now;
        while rig.view(0).snapshot.presence == DrivePresence::Offline {
            rig.step(rig.now + SECOND);
        }
        let met = rig.now.since(hears);
        assert!(
            met < Duration::from_millis(400),
            "{met:?} after {off:?} without power"
        );
    }
}

#[test]
fn a_drive_that_stays_away_is_asked_less_and_less_all_the_same() {
    let model = model("toshiba-vf-as1");
    let options = RigOptions {
        link: model.link.played(),
        model,
        poll: SECOND / 10,
        ..RigOptions::default()
    };
    let mut rig = Rig::new(&options);
    let now = rig.now;
    rig.bus.set_powered(now, Station(1), false);
    rig.pass(SECOND * 10);
    rig.sent.clear();
    rig.pass(SECOND * 120);
    assert!(
        (3..=8).contains(&rig.sent.len()),
        "{} frames in two minutes",
        rig.sent.len()
    );
}

#[test]
fn nothing_but_a_stop_goes_to_a_drive_that_is_known_to_be_deaf() {
    let mut rig = Rig::new(&RigOptions {
        control: Some(control()),
        poll: SECOND / 10,
        ..RigOptions::default()
    });
    let hears = rig.now + SECOND * 2;
    rig.core.rest(DriveIndex(0), hears);
    rig.bus.set_faults(FaultPlan {
        lost: 1000,
        ..FaultPlan::NONE
    });
    let read = rig.read(1, 0, PROOF, 1);
    // The exchange on the wire when the drive went deaf does not count.
    rig.run_until(rig.now + SECOND / 2, |_, _| {});
    rig.sent.clear();
    rig.command(MQTT, 0, STOP);
    rig.run_until(hears, |_, _| {});
    assert!(rig.sent.len() >= 2, "a stop is repeated");
    assert!(
        rig.sent
            .iter()
            .all(|sent| sent.frame[..6] == [1, 6, 0, 2, 0, 0]),
        "{:02X?}",
        rig.frames()
    );
    assert_eq!(
        rig.view(0).snapshot.presence,
        DrivePresence::Online,
        "its silence tells nothing"
    );
    rig.bus.set_faults(FaultPlan::NONE);
    assert!(
        matches!(rig.answer_to(read), NativeOutcome::Words(_)),
        "what waited is asked afterwards"
    );
    assert!(
        rig.now.since(hears) < SECOND / 2,
        "after the stop that is on the wire: {:?}",
        rig.now.since(hears)
    );
}

#[test]
fn other_drives_do_not_rest() {
    let mut rig = Rig::new(&RigOptions {
        drives: 2,
        ..RigOptions::default()
    });
    rig.core.rest(DriveIndex(0), rig.now + SECOND);
    let begun = rig.now;
    let deaf = rig.read(1, 0, PROOF, 1);
    let other = rig.read(1, 1, PROOF, 1);
    assert!(matches!(rig.answer_to(other), NativeOutcome::Words(_)));
    assert!(rig.now.since(begun) < SECOND / 10);
    assert!(matches!(rig.answer_to(deaf), NativeOutcome::Words(_)));
    assert!(rig.now.since(begun) >= SECOND);
}

#[test]
fn only_a_drive_that_may_be_deaf_is_asked_so_often() {
    let mut without = Model::clone(&model("toshiba-vf-as1"));
    without.quirks.deaf_after_power_up = None;
    let frames_in_two_seconds = |model: Arc<Model>| {
        let options = RigOptions {
            link: model.link.played(),
            model,
            poll: SECOND / 10,
            ..RigOptions::default()
        };
        let mut rig = Rig::new(&options);
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), false);
        rig.pass(SECOND * 2);
        rig.sent.len()
    };
    let often = frames_in_two_seconds(model("toshiba-vf-as1"));
    let seldom = frames_in_two_seconds(Arc::new(without));
    assert!(often >= 5 && seldom <= 4, "{often} and {seldom}");
}
