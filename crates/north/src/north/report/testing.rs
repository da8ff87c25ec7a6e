//! Observations for tests: a good line, and one for each thing that can be wrong.

use super::{DriveObserved, DriveSeen, LineObserved, LineSeen};
use crate::domain::counts::ExchangeCounts;
use crate::domain::ids::{Name, Station};
use crate::domain::report::{LineFault, LineReport, LineState, ReplyReport, StationReport};
use crate::domain::suspicion::LineSuspicion;
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DrivePresence;
use crate::north::finding::{FindingSign, Severity};
use std::sync::Arc;
use std::time::Duration;

const SPAN: Duration = Duration::from_secs(30);

fn drive(name: &str, station: u8) -> DriveSeen {
    let ms = Duration::from_millis;
    let reads = ReplyReport {
        count: 1000,
        p50: ms(4),
        p90: ms(5),
        p99: ms(6),
        p999: ms(7),
        max: ms(9),
        timeout: ms(30),
        suggested: Some(ms(30)),
    };
    let exchanges = ExchangeCounts {
        replies: 1000,
        ..ExchangeCounts::default()
    };
    let unseen = ReplyReport {
        timeout: ms(500),
        ..ReplyReport::default()
    };
    let report = StationReport {
        replies: [reads, unseen, unseen],
        exchanges,
        ..StationReport::default()
    };
    let name = Name::new(name).unwrap();
    DriveSeen {
        name,
        station: Station(station),
        presence: DrivePresence::Online,
        warning: None,
        report: Arc::new(report),
    }
}

fn up() -> LineReport {
    LineReport {
        state: LineState::Up,
        ..LineReport::default()
    }
}

/// Two drives, a at station 1 and b at 2, 1000 good exchanges each.
pub(super) fn good() -> LineObserved {
    let now = LineSeen {
        at: MonoTime::from_millis(40_000),
        report: up(),
        drives: vec![drive("a", 1), drive("b", 2)],
    };
    LineObserved::between(None, now, MonoTime::from_millis(40_000).before(SPAN))
}

/// The line of [`good`] without any exchange with its drives.
pub(super) fn idle() -> LineObserved {
    let mut observed = good();
    observed
        .drives
        .iter_mut()
        .for_each(|drive| drive.exchanges = ExchangeCounts::default());
    observed
}

fn with(change: impl FnOnce(&mut LineObserved)) -> LineObserved {
    let mut observed = good();
    change(&mut observed);
    observed
}

/// A line observed with `change` made at drive a.
fn of_a(change: impl FnOnce(&mut DriveObserved)) -> LineObserved {
    with(|observed| change(&mut observed.drives[0]))
}

/// Drive a had this many damaged replies of the right length.
fn damaged(count: u64, change: impl FnOnce(&mut DriveObserved)) -> LineObserved {
    of_a(|a| {
        a.exchanges.replies = 1000 - count;
        a.exchanges.garbled = count;
        a.damage.damaged = count;
        change(a);
    })
}

/// Each sign with its severity, a part of its text, and a case in which it comes first.
pub(super) fn line_name() -> Name {
    Name::new("hall-1").expect("a name")
}

pub(super) fn cases() -> Vec<(FindingSign, Severity, &'static str, LineObserved)> {
    [line_cases(), drive_cases(), damage_cases()].concat()
}

type Case = (FindingSign, Severity, &'static str, LineObserved);

fn line_cases() -> Vec<Case> {
    use Severity::{Good, Hint, Problem};
    let suspected = |suspicion| with(|it| it.line.suspicion = Some(suspicion));
    let down = |fault| with(|it| (it.line.state, it.line.fault) = (LineState::Down, fault));
    vec![
        (
            FindingSign::Suspicion,
            Problem,
            "higher speed",
            suspected(LineSuspicion::DrivesAreFaster),
        ),
        (
            FindingSign::Suspicion,
            Problem,
            "lower speed",
            suspected(LineSuspicion::DrivesAreSlower),
        ),
        (
            FindingSign::Suspicion,
            Problem,
            "parity",
            suspected(LineSuspicion::AlwaysDamaged),
        ),
        (
            FindingSign::Suspicion,
            Problem,
            "two drives",
            suspected(LineSuspicion::DuplicateStation(Station(1))),
        ),
        (
            FindingSign::Suspicion,
            Problem,
            "max_lateness",
            suspected(LineSuspicion::LateBeyondLimit(Station(1))),
        ),
        (
            FindingSign::Suspicion,
            Problem,
            "echo",
            suspected(LineSuspicion::Echo),
        ),
        (
            FindingSign::LineDown,
            Problem,
            "the device is gone",
            down(Some(LineFault::Gone)),
        ),
        (FindingSign::LineDown, Problem, "not opened yet", down(None)),
        (
            FindingSign::PortLost,
            Problem,
            "lost 2 times",
            with(|it| it.port_downs = 2),
        ),
        (
            FindingSign::Suspended,
            Problem,
            "14 %",
            with(|it| {
                (it.line.quality.is_suspended, it.line.quality.bad_per_cent) = (true, Some(14))
            }),
        ),
        (
            FindingSign::OtherMaster,
            Problem,
            "one master only",
            with(|it| it.other_master = 5),
        ),
        (
            FindingSign::Stranger,
            Problem,
            "5 frames",
            with(|it| it.foreign = 5),
        ),
        (
            FindingSign::Floating,
            Problem,
            "bias",
            with(|it| it.noise_between = 400),
        ),
        (
            FindingSign::Floating,
            Hint,
            "7 times before",
            of_a(|a| a.damage.led = 7),
        ),
        (
            FindingSign::OverFull,
            Hint,
            "130 %",
            with(|it| it.line.planned_use_per_mille = 1300),
        ),
        (
            FindingSign::EchoStripped,
            Good,
            "as configured",
            with(|it| it.echoes = 2000),
        ),
        (FindingSign::FewExchanges, Hint, "too few", idle()),
    ]
}

fn drive_cases() -> Vec<Case> {
    use Severity::{Hint, Problem};
    let answered = |good, silent, late| {
        of_a(|a| (a.exchanges.replies, a.exchanges.silent, a.damage.late) = (good, silent, late))
    };
    vec![
        (
            FindingSign::Offline,
            Problem,
            "a: the drive does not answer as station 1",
            of_a(|a| a.now.presence = DrivePresence::Offline),
        ),
        (
            FindingSign::Offline,
            Problem,
            "wiring",
            of_a(|a| {
                (a.now.presence, a.exchanges.replies, a.exchanges.silent) =
                    (DrivePresence::Offline, 0, 8)
            }),
        ),
        (
            FindingSign::Warns,
            Hint,
            "a: the drive warns: hot",
            of_a(|a| a.now.warning = Some("hot".to_owned())),
        ),
        (
            FindingSign::DuplicateStation,
            Problem,
            "two drives probably have station 1",
            of_a(|a| a.damage.doubled = 3),
        ),
        (
            FindingSign::LateBeyondLimit,
            Problem,
            "2 replies",
            of_a(|a| a.damage.beyond_limit = 2),
        ),
        (
            FindingSign::Silent,
            Problem,
            "40 of 1000",
            answered(960, 40, 0),
        ),
        (FindingSign::Silent, Hint, "5 of 1000", answered(995, 5, 0)),
        (
            FindingSign::Silent,
            Problem,
            "the others did",
            of_a(|a| {
                (a.now.presence, a.exchanges.replies, a.exchanges.silent) =
                    (DrivePresence::Offline, 100, 8)
            }),
        ),
        (
            FindingSign::Late,
            Problem,
            "after up to 500 ms",
            answered(960, 40, 40),
        ),
        (
            FindingSign::TimeoutShort,
            Hint,
            "suggest 60 ms",
            of_a(|a| {
                let mut report = *a.now.report;
                report.replies[0].suggested = Some(Duration::from_millis(60));
                a.now.report = Arc::new(report);
            }),
        ),
        (
            FindingSign::Exceptions,
            Hint,
            "100 of 1000",
            of_a(|a| (a.exchanges.replies, a.exchanges.exceptions) = (900, 100)),
        ),
    ]
}

fn damage_cases() -> Vec<Case> {
    use Severity::{Hint, Problem};
    let both = |count| {
        let mut observed = damaged(count, |_| {});
        observed.drives[1].damage = observed.drives[0].damage;
        observed
    };
    vec![
        (
            FindingSign::FirstCharacters,
            Problem,
            "30 of 50",
            damaged(50, |a| a.damage.head = 30),
        ),
        (
            FindingSign::Cut,
            Problem,
            "40 of 50 damaged replies lack their end",
            damaged(50, |a| a.damage.cut = 40),
        ),
        (
            FindingSign::Cut,
            Problem,
            "all 50 damaged replies end too early",
            damaged(50, |a| {
                a.damage.cut = 50;
                (a.exchanges.replies, a.exchanges.silent) = (0, 1000);
            }),
        ),
        (
            FindingSign::LongFrames,
            Problem,
            "45 of 50",
            damaged(50, |a| (a.damage.long, a.damage.long_damaged) = (500, 45)),
        ),
        (
            FindingSign::OneStation,
            Problem,
            "those of others are not",
            damaged(50, |_| {}),
        ),
        (FindingSign::Damaged, Problem, "50 of 1000", both(50)),
        (FindingSign::Damaged, Hint, "5 of 1000", both(5)),
    ]
}
