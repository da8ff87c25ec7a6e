//! What drives have used is counted once, shown when it is durable, and goes on where it was after a restart.

use crate::support::{MQTT, Rig, RigOptions, STOP, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Owner};
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::drive::usage::UsageTotals;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::journal::{JournalEntry, KeptUsage, RememberedDrive};

/// Polls come this often, and each start and stop is seen by one of them.
const POLL: Duration = Duration::from_millis(200);

fn rig(keeps: bool) -> Rig {
    Rig::new(&RigOptions {
        keeps,
        ..RigOptions::controlled()
    })
}

/// Runs the drive for `time`, and lets it come to rest.
fn run_for(rig: &mut Rig, time: Duration) {
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.all_is_kept();
    rig.live(time);
    rig.command(MQTT, 0, STOP);
    rig.all_is_kept();
    rig.live(Duration::from_secs(30));
    assert_eq!(rig.output(1), 0);
}

fn sums(rig: &Rig) -> UsageTotals {
    rig.view(0).usage.totals
}

/// What was returned to be kept.
fn kept(rig: &Rig) -> Vec<KeptUsage> {
    let usage = |entry: &&JournalEntry| {
        if let JournalEntry::Usage(usage) = entry {
            Some(*usage)
        } else {
            None
        }
    };
    rig.entries().iter().filter_map(usage).collect()
}

#[test]
fn running_time_starts_and_trips_are_counted_once() {
    let mut rig = rig(false);
    run_for(&mut rig, Duration::from_secs(20));
    run_for(&mut rig, Duration::from_secs(10));
    let used = sums(&rig);
    assert_eq!((used.starts, used.trips), (2, 0));
    // Each run lasts as long as it was ordered, and its ramp down.
    let least = Duration::from_secs(30) - 4 * POLL;
    assert!(
        used.running >= least && used.running < Duration::from_secs(90),
        "{used:?}"
    );
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 7);
    rig.pass(Duration::from_secs(60));
    assert_eq!(
        sums(&rig),
        UsageTotals { trips: 1, ..used },
        "nothing else goes on at rest"
    );
}

#[test]
fn a_sum_is_shown_when_it_is_in_the_journal_and_never_falls_after_a_kill() {
    let mut rig = rig(true);
    run_for(&mut rig, Duration::from_secs(20));
    rig.all_is_kept();
    let shown = sums(&rig);
    assert_eq!(shown, kept(&rig).last().unwrap().totals);
    assert_eq!(shown.starts, 1);
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.all_is_kept();
    let before = kept(&rig).len();
    rig.live(Duration::from_secs(20));
    let unkept = kept(&rig).len() - before;
    assert!((5..=7).contains(&unkept), "every three seconds: {unkept}");
    assert_eq!(
        sums(&rig).running,
        shown.running,
        "what is not durable is not shown"
    );
    // The process is killed, and the newest row was not written.
    let written = kept(&rig)[before + 3];
    rig.restart(RememberedDrive {
        usage: written,
        ..RememberedDrive::default()
    });
    assert_eq!(sums(&rig), written.totals, "before the drive is seen");
    rig.pass(Duration::from_secs(10));
    rig.all_is_kept();
    let after = sums(&rig);
    assert_eq!(after.starts, written.totals.starts, "it is found running");
    assert!(after.running > written.totals.running && after.running >= shown.running);
}

#[test]
fn the_running_time_of_a_trip_is_kept_before_the_trip() {
    let mut rig = rig(true);
    rig.command(MQTT, 0, run(Direction::Forward, Some(3000)));
    rig.all_is_kept();
    rig.live(Duration::from_secs(10));
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, 7);
    rig.pass(Duration::from_secs(2));
    let entries = rig.entries();
    let trip = entries
        .iter()
        .position(|entry| matches!(entry, JournalEntry::Trip(..)))
        .unwrap();
    let usage = entries[..trip].iter().rev().find_map(|entry| match entry {
        JournalEntry::Usage(usage) => Some(usage.totals),
        _ => None,
    });
    let usage = usage.unwrap();
    assert_eq!(usage.trips, 1);
    assert!(usage.running >= Duration::from_secs(9), "{usage:?}");
}

#[test]
fn a_reset_is_recorded_with_who_asked_for_it_and_everything_begins_at_0() {
    let mut rig = rig(true);
    run_for(&mut rig, Duration::from_secs(10));
    rig.core
        .handle(rig.now, LineInput::ResetUsage(DriveIndex(0), Owner::Local));
    rig.settle();
    let entries = rig.entries();
    let reset = entries
        .iter()
        .position(|entry| {
            **entry
                == JournalEntry::UsageReset {
                    owner: Owner::Local,
                }
        })
        .unwrap();
    assert_eq!(
        *entries[reset + 1],
        JournalEntry::Usage(KeptUsage {
            totals: UsageTotals::default(),
            ..*kept(&rig).last().unwrap()
        })
    );
    assert_ne!(sums(&rig), UsageTotals::default(), "it is not durable yet");
    rig.all_is_kept();
    assert_eq!(sums(&rig), UsageTotals::default());
    run_for(&mut rig, Duration::from_secs(10));
    rig.all_is_kept();
    assert_eq!(sums(&rig).starts, 1);
}
