//! Findings about one drive.

use super::rules::{ENOUGH, FindingText, SIGNS, graded};
use super::{DriveObserved, LineObserved};
use crate::domain::counts::DamageCounts;
use crate::domain::report::REPLY_CLASSES;
use crate::domain::suspicion::LineSuspicion;
use crate::drive::snapshot::DrivePresence;
use crate::north::finding::{self, Severity};
use crate::north::texts::Sentence;
use std::time::Duration;

/// Long replies are damaged because of their length if this many times more of them are.
const LONG_TIMES: u64 = 3;
/// One drive stands out if its share of damage is this many times that of all others.
const ALONE_TIMES: u64 = 10;
/// This many exceptions in a thousand exchanges are no accident.
const EXCEPTIONS_PER_MILLE: u64 = 50;

pub(super) fn offline(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let station = drive.now.station;
    let is_suspected = match seen.line.suspicion {
        Some(LineSuspicion::OneSilent(silent) | LineSuspicion::OneUnitSilent(silent)) => {
            silent == station
        }
        suspicion => suspicion.is_some(),
    };
    let is_silent = drive.now.presence == DrivePresence::Offline && silent(seen, drive).is_none();
    let is_offline = seen.is_up() && is_silent && !is_suspected;
    is_offline.then(|| (Severity::Problem, finding::offline(Some(station))))
}

pub(super) fn warns(_: &LineObserved, drive: &DriveObserved) -> FindingText {
    let warning = drive.now.warning.clone()?;
    Some((Severity::Hint, finding::warns(warning)))
}

pub(super) fn duplicate_station(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let station = drive.now.station;
    let doubled = drive.damage.doubled;
    let is_suspected = seen.line.suspicion == Some(LineSuspicion::DuplicateStation(station));
    let text = || {
        Sentence::new("finding.duplicate_station")
            .with("answers", doubled)
            .with("station", u64::from(station.0))
    };
    (doubled >= SIGNS && !is_suspected).then(|| (Severity::Problem, text()))
}

pub(super) fn late_beyond_limit(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let station = drive.now.station;
    let beyond = drive.damage.beyond_limit;
    let is_suspected = seen.line.suspicion == Some(LineSuspicion::LateBeyondLimit(station));
    let text = || Sentence::new("finding.late_beyond_limit").with("replies", beyond);
    (beyond > 0 && !is_suspected).then(|| (Severity::Problem, text()))
}

/// Where damage is. Each names one cause; the first that applies takes precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DamagePattern {
    FirstCharacters,
    Cut,
    LongFrames,
    OneStation,
    Spread,
}

pub(super) fn first_characters(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let DamageCounts { head, damaged, .. } = drive.damage;
    say_damage(seen, drive, DamagePattern::FirstCharacters, || {
        Sentence::new("finding.first_characters")
            .with("replies", head)
            .with("damaged", damaged)
    })
}

pub(super) fn cut(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let DamageCounts { cut, damaged, .. } = drive.damage;
    // A contact that is loose lets some replies through.
    let is_always = cut == damaged && drive.exchanges.replies + drive.exchanges.exceptions == 0;
    say_damage(seen, drive, DamagePattern::Cut, || {
        let text = Sentence::new(if is_always {
            "finding.cut_always"
        } else {
            "finding.cut"
        });
        text.with("replies", cut).with("damaged", damaged)
    })
}

pub(super) fn long_frames(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let DamageCounts {
        damaged,
        long_damaged,
        ..
    } = drive.damage;
    say_damage(seen, drive, DamagePattern::LongFrames, || {
        Sentence::new("finding.long_frames")
            .with("replies", long_damaged)
            .with("damaged", damaged)
    })
}

pub(super) fn one_station(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let damaged = drive.damage.damaged;
    let all = drive.exchanges.total();
    say_damage(seen, drive, DamagePattern::OneStation, || {
        let alone = Sentence::new("finding.one_station")
            .with("damaged", damaged)
            .with("replies", all);
        alone.with("station", u64::from(drive.now.station.0))
    })
}

pub(super) fn damaged(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let damaged = drive.damage.damaged;
    let all = drive.exchanges.total();
    say_damage(seen, drive, DamagePattern::Spread, || {
        Sentence::new("finding.damaged")
            .with("damaged", damaged)
            .with("replies", all)
    })
}

fn say_damage(
    seen: &LineObserved,
    drive: &DriveObserved,
    pattern: DamagePattern,
    text: impl FnOnce() -> Sentence,
) -> FindingText {
    let severity = graded(drive.damage.damaged, drive.exchanges.total())?;
    // What is suspected of the whole line already says what to do.
    let is_suspected = seen.line.suspicion.is_some_and(|suspicion| {
        !matches!(
            suspicion,
            LineSuspicion::OneSilent(_) | LineSuspicion::OneUnitSilent(_)
        )
    });
    (!is_suspected && pattern_of(seen, drive) == pattern).then(|| (severity, text()))
}

fn pattern_of(seen: &LineObserved, drive: &DriveObserved) -> DamagePattern {
    let DamageCounts {
        damaged,
        head,
        cut,
        long,
        long_damaged,
        ..
    } = drive.damage;
    let all = drive.exchanges.total();
    let short_damaged = damaged.saturating_sub(long_damaged);
    let short = all.saturating_sub(long);
    let is_by_length = long.min(short) >= ENOUGH
        && long_damaged >= SIGNS
        && long_damaged * short >= LONG_TIMES * short_damaged.max(1) * long;
    let others = || {
        seen.drives
            .iter()
            .filter(|other| other.now.name != drive.now.name)
    };
    let (of_others, all_others): (u64, u64) = (
        others().map(|it| it.damage.damaged).sum(),
        others().map(|it| it.exchanges.total()).sum(),
    );
    let is_alone =
        all_others >= ENOUGH && damaged * all_others >= ALONE_TIMES * of_others.max(1) * all;
    if head * 2 >= damaged {
        DamagePattern::FirstCharacters
    } else if cut * 2 >= damaged {
        DamagePattern::Cut
    } else if is_by_length {
        DamagePattern::LongFrames
    } else if is_alone {
        DamagePattern::OneStation
    } else {
        DamagePattern::Spread
    }
}

pub(super) fn late(_: &LineObserved, drive: &DriveObserved) -> FindingText {
    let late = drive.damage.late;
    let severity = graded(late, drive.exchanges.total())?;
    let waited = drive
        .now
        .report
        .replies
        .iter()
        .map(|reply| whole_millis(reply.timeout))
        .max()
        .unwrap_or_default();
    Some((
        severity,
        Sentence::new("finding.late")
            .with("replies", late)
            .with("waited", waited),
    ))
}

/// Requests that are never answered, where late replies do not explain them.
pub(super) fn silent(seen: &LineObserved, drive: &DriveObserved) -> FindingText {
    let silent = drive.silent();
    let all = drive.exchanges.total();
    let severity = graded(silent, all)?;
    let is_explained = drive.damage.late * 2 >= silent || seen.line.suspicion.is_some();
    let is_there = seen.is_up() && drive.exchanges.replies > 0;
    let text = || {
        Sentence::new("finding.silent")
            .with("unanswered", silent)
            .with("requests", all)
    };
    (is_there && !is_explained).then(|| (severity, text()))
}

pub(super) fn timeout_short(_: &LineObserved, drive: &DriveObserved) -> FindingText {
    let replies = REPLY_CLASSES.into_iter().zip(&drive.now.report.replies);
    let (class, reply, suggested) = replies
        .filter_map(|(class, reply)| Some((class, reply, reply.suggested?)))
        .find(|(_, reply, suggested)| reply.timeout < *suggested)?;
    let text = Sentence::new("finding.timeout_short")
        .with("request", Sentence::new(format!("request.{class}")));
    let text = text
        .with("waited", whole_millis(reply.timeout))
        .with("suggested", whole_millis(suggested));
    Some((Severity::Hint, text))
}

pub(super) fn exceptions(_: &LineObserved, drive: &DriveObserved) -> FindingText {
    let exceptions = drive.exchanges.exceptions;
    let all = drive.exchanges.total();
    let is_much = exceptions >= SIGNS && exceptions * 1000 >= all * EXCEPTIONS_PER_MILLE;
    let text = || {
        Sentence::new("finding.exceptions")
            .with("exceptions", exceptions)
            .with("requests", all)
    };
    is_much.then(|| (Severity::Hint, text()))
}

fn whole_millis(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}
