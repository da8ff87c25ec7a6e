//! An order that the drive no longer follows is over: it is told once, and nothing restarts.

use crate::support::families::{accepting, each, options_of, rig_of};
use crate::support::{MQTT, Rig, RigOptions, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason, RunIntent};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::journal::{JournalEntry, WriteAttempt};
use vfd_gateway::profile::model::{IndicatedState, Model};

const SECOND: Duration = Duration::from_secs(1);

fn is_proven(model: &Model) -> bool {
    model
        .status_flag(IndicatedState::Running)
        .is_some_and(|flag| flag.confidence.is_proven())
}

/// A drive that runs at 30 Hz and is stopped by a key, 15 s later.
fn stopped_by_a_key(model: &Arc<Model>) -> Rig {
    let mut rig = Rig::new(&RigOptions {
        keeps: true,
        ..options_of(model, accepting())
    });
    let told = rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    assert!(
        matches!(told.0, Outcome::Confirmed | Outcome::Acknowledged),
        "{told:?}"
    );
    rig.live(SECOND * 8);
    assert!(rig.output(1) > 2900);
    rig.sent.clear();
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().operate(now, None);
    rig.live(SECOND * 15);
    assert_eq!(rig.output(1), 0);
    rig
}

fn told(rig: &Rig) -> usize {
    rig.notes
        .iter()
        .filter(|(_, note)| *note == DriveNote::StoppedElsewhere)
        .count()
}

#[test]
fn a_drive_that_was_stopped_elsewhere_is_no_longer_ordered_to_run() {
    each(|model| {
        if model.run.is_none() || !is_proven(model) {
            return;
        }
        let mut rig = stopped_by_a_key(model);
        let control = rig.view(0).control.unwrap();
        assert_eq!(
            (
                control.intent,
                control.start_inhibited,
                control.stopped_elsewhere
            ),
            (RunIntent::Stop, true, true)
        );
        assert_eq!(
            control.last.map(|last| last.reason),
            Some(Reason::StoppedElsewhere)
        );
        assert_eq!(told(&rig), 1);
        let of_it = |entry: &&&JournalEntry| matches!(entry, JournalEntry::Attempt(WriteAttempt { report: Some(report), .. }) if report.reason == Reason::StoppedElsewhere);
        assert_eq!(rig.entries().iter().filter(of_it).count(), 1);
        assert!(rig.writes().is_empty(), "nothing restarts it");
        rig.live(SECOND * 30);
        assert_eq!((told(&rig), rig.output(1)), (1, 0));
        let again = rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        assert!(
            matches!(again.0, Outcome::Confirmed | Outcome::Acknowledged),
            "{again:?}"
        );
        rig.live(SECOND * 8);
        assert!(rig.output(1) > 2900);
        assert!(!rig.view(0).control.unwrap().stopped_elsewhere);
    });
}

#[test]
fn a_status_that_no_document_proves_ends_no_order() {
    each(|model| {
        if model.run.is_none() || is_proven(model) {
            return;
        }
        let rig = stopped_by_a_key(model);
        assert_eq!(
            (told(&rig), rig.view(0).control.unwrap().intent),
            (0, RunIntent::Run(Direction::Forward))
        );
    });
}

#[test]
fn a_controller_that_goes_on_writing_setpoints_does_not_hide_that_the_drive_was_stopped() {
    each(|model| {
        if model.run.is_none() || !is_proven(model) {
            return;
        }
        let mut rig = rig_of(model, accepting());
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(SECOND * 8);
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().operate(now, None);
        for count in 0..60 {
            rig.command(MQTT, 0, setpoint(3000 + count % 2 * 100));
            rig.live(SECOND / 4);
        }
        assert_eq!(told(&rig), 1, "{:?}", rig.notes);
    });
}
