//! A plain RUN may have been queued before the gateway: after anything that inhibits the start it is refused for a time.

use super::tests::{NOW, RESTING, STOP, command, guard_of, mqtt, reviewed, run};
use super::*;
use crate::domain::command::{CommandRequest, Direction, Origin, Outcome, Owner, Reason};
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::ids::CommanderName;
use crate::domain::time::MonoTime;
use crate::vendors::testing::{control, model};
use std::time::Duration;

const DELAY: Duration = ControlSettings::RESTART_DELAY;
const SHORT: Duration = Duration::from_millis(1);

fn page() -> Origin {
    Origin {
        owner: Owner::Page(CommanderName::new("anna").unwrap()),
        ..mqtt()
    }
}

/// Name and event.
type Ending = (&'static str, fn(&mut DriveGuard));

/// Events that end the right to start, at [`NOW`].
const ENDINGS: [Ending; 6] = [
    ("a stop", |guard| {
        reviewed(guard, &command(mqtt(), STOP)).unwrap()
    }),
    ("a trip, or a drive that is offline", |guard| {
        guard.lost_touch(NOW)
    }),
    ("a stop that was given up", |guard| guard.inhibit(NOW)),
    ("a lost lease with hold", |guard| {
        let (_, until) = guard.lease().unwrap();
        let lost = guard.expire(until, false).unwrap();
        assert_eq!((until, lost.action), (NOW, FailSafe::Hold));
    }),
    ("a lease that is lost at standstill", |guard| {
        guard.inhibit(NOW.before(DELAY));
        assert_eq!(guard.expire(NOW, true), None);
    }),
    ("a release", |guard| guard.released(NOW)),
];

/// A drive started by `owner`, with a lease that ends at [`NOW`].
fn running(owner: Origin) -> DriveGuard {
    let settings = ControlSettings {
        on_commander_lost: FailSafe::Hold,
        ..control()
    };
    let lost_after = settings.lost_after;
    let mut guard = guard_of(model(), settings);
    let begun = NOW.before(lost_after);
    let start = CommandRequest {
        start_before: NOW,
        ..command(owner, run(Direction::Forward))
    };
    assert!(guard.review(&start, &RESTING, begun).is_ok());
    guard
}

fn at(
    guard: &mut DriveGuard,
    plain: &CommandRequest,
    now: MonoTime,
) -> Result<(), (Outcome, Reason)> {
    let plain = CommandRequest {
        start_before: now + DELAY,
        ..plain.clone()
    };
    guard
        .review(&plain, &RESTING, now)
        .map(drop)
        .map_err(|report| (report.outcome, report.reason))
}

#[test]
fn a_plain_run_is_refused_for_a_time_after_whatever_inhibits_the_start() {
    for (cause, happens) in ENDINGS {
        for owner in [mqtt(), page()] {
            let plain = command(owner, run(Direction::Forward));
            let mut guard = running(owner);
            happens(&mut guard);
            let soon = (Outcome::Refused, Reason::RestartDelay);
            assert_eq!(at(&mut guard, &plain, NOW), Err(soon), "{cause}");
            assert_eq!(
                at(&mut guard, &plain, (NOW + DELAY).before(SHORT)),
                Err(soon),
                "{cause}"
            );
            assert_eq!(at(&mut guard, &plain, NOW + DELAY), Ok(()), "{cause}");
        }
    }
}

#[test]
fn an_epoch_that_was_shown_before_whatever_inhibits_the_start_is_stale() {
    for (cause, happens) in ENDINGS {
        let mut guard = running(mqtt());
        let seen_before = CommandRequest {
            epoch: Some(guard.epoch()),
            ..command(mqtt(), run(Direction::Forward))
        };
        happens(&mut guard);
        assert_eq!(
            at(&mut guard, &seen_before, NOW),
            Err((Outcome::Refused, Reason::StaleEpoch)),
            "{cause}"
        );
        let seen_since = CommandRequest {
            epoch: Some(guard.epoch()),
            ..seen_before
        };
        assert_eq!(at(&mut guard, &seen_since, NOW), Ok(()), "{cause}");
    }
}

#[test]
fn nothing_that_waited_is_older_than_the_start_of_the_process() {
    let mut guard = guard_of(model(), control());
    assert_eq!(
        at(
            &mut guard,
            &command(mqtt(), run(Direction::Forward)),
            MonoTime::ZERO
        ),
        Ok(())
    );
}
