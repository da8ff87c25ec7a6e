//! Findings about one drive.

use super::rules::{ENOUGH, FindingText, SIGNS, graded};
use super::{DriveObserved, Observed};
use crate::domain::counts::DamageCounts;
use crate::domain::report::REPLY_CLASSES;
use crate::domain::suspicion::Suspicion;
use crate::drive::snapshot::Presence;
use crate::north::finding::{OFFLINE_REMEDY, Severity, warns_text};

/// Long replies are damaged because of their length if this many times more of them are.
const LONG_TIMES: u64 = 3;
/// One drive stands out if its share of damage is this many times that of all others.
const ALONE_TIMES: u64 = 10;
/// This many exceptions in a thousand exchanges are no accident.
const EXCEPTIONS_PER_MILLE: u64 = 50;

pub(super) fn offline(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let station = drive.now.station;
    let is_told = match seen.line.suspicion {
        Some(Suspicion::OneSilent(silent)) => silent == station,
        suspicion => suspicion.is_some(),
    };
    let is_silent = drive.now.presence == Presence::Offline && silent(seen, drive).is_none();
    let is_offline = seen.is_up() && is_silent && !is_told;
    let text = || format!("it does not answer at station {}: {OFFLINE_REMEDY}", station.0);
    is_offline.then(|| (Severity::Problem, text()))
}

pub(super) fn warns(_: &Observed, drive: &DriveObserved) -> FindingText {
    let warning = drive.now.warning.as_ref()?;
    Some((Severity::Hint, warns_text(warning)))
}

pub(super) fn duplicate_station(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let station = drive.now.station;
    let doubled = drive.damage.doubled;
    let is_told = seen.line.suspicion == Some(Suspicion::DuplicateStation(station));
    let text = || {
        format!(
            "{doubled} answers are explained by no request: two drives probably have station {}; disconnect one \
             and look whether it still answers",
            station.0
        )
    };
    (doubled >= SIGNS && !is_told).then(|| (Severity::Problem, text()))
}

pub(super) fn late_beyond_limit(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let station = drive.now.station;
    let beyond = drive.damage.beyond_limit;
    let is_told = seen.line.suspicion == Some(Suspicion::LateBeyondLimit(station));
    let text = || {
        format!(
            "{beyond} replies came later than `max_lateness` allows, when they could be taken for others: raise \
             `max_lateness`, and check what is in between (a serial device server, a radio)"
        )
    };
    (beyond > 0 && !is_told).then(|| (Severity::Problem, text()))
}

/// Where damage is. Each names one cause; the first that applies takes precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pattern {
    FirstCharacters,
    Cut,
    LongFrames,
    OneStation,
    Spread,
}

pub(super) fn first_characters(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let DamageCounts { head, damaged, .. } = drive.damage;
    said(seen, drive, Pattern::FirstCharacters, || {
        format!(
            "in {head} of {damaged} damaged replies only the first characters are wrong: the adapter still sends when the \
             drive begins (use one that turns its direction by itself, or `rs485`), the drive answers too soon (raise its \
             reply delay), or the line has no bias resistors"
        )
    })
}

pub(super) fn cut(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let DamageCounts { cut, damaged, .. } = drive.damage;
    said(seen, drive, Pattern::Cut, || {
        format!(
            "the end of {cut} of {damaged} damaged replies is missing: an adapter or serial device server that hands \
             replies on in pieces (lower its latency timer), or a loose contact"
        )
    })
}

pub(super) fn long_frames(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let DamageCounts { damaged, long_damaged, .. } = drive.damage;
    said(seen, drive, Pattern::LongFrames, || {
        format!(
            "{long_damaged} of {damaged} damaged replies are long ones: single bits are lost along the cable; check \
             termination (120 ohm at both ends), shield and distance to motor cables, or lower the speed"
        )
    })
}

pub(super) fn one_station(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let damaged = drive.damage.damaged;
    let all = drive.exchanges.total();
    said(seen, drive, Pattern::OneStation, || {
        format!(
            "{damaged} of {all} replies are damaged, and those of others are not: check its connector, its stub (as short \
             as can be) and its ground; or two drives have station {} and answer at once",
            drive.now.station.0
        )
    })
}

pub(super) fn damaged(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let damaged = drive.damage.damaged;
    let all = drive.exchanges.total();
    said(seen, drive, Pattern::Spread, || {
        format!(
            "{damaged} of {all} replies are damaged: check termination (120 ohm at both ends), shield and ground, distance \
             to motor cables, and parity and stop bits"
        )
    })
}

fn said(seen: &Observed, drive: &DriveObserved, pattern: Pattern, text: impl FnOnce() -> String) -> FindingText {
    let severity = graded(drive.damage.damaged, drive.exchanges.total())?;
    // What is suspected of the whole line already says what to do.
    let is_told = seen.line.suspicion.is_some_and(|suspicion| !matches!(suspicion, Suspicion::OneSilent(_)));
    (!is_told && pattern_of(seen, drive) == pattern).then(|| (severity, text()))
}

fn pattern_of(seen: &Observed, drive: &DriveObserved) -> Pattern {
    let DamageCounts { damaged, head, cut, long, long_damaged, .. } = drive.damage;
    let all = drive.exchanges.total();
    let short_damaged = damaged.saturating_sub(long_damaged);
    let short = all.saturating_sub(long);
    let is_by_length = long.min(short) >= ENOUGH
        && long_damaged >= SIGNS
        && long_damaged * short >= LONG_TIMES * short_damaged.max(1) * long;
    let others = || seen.drives.iter().filter(|other| other.now.name != drive.now.name);
    let (of_others, all_others): (u64, u64) =
        (others().map(|it| it.damage.damaged).sum(), others().map(|it| it.exchanges.total()).sum());
    let is_alone = all_others >= ENOUGH && damaged * all_others >= ALONE_TIMES * of_others.max(1) * all;
    if head * 2 >= damaged {
        Pattern::FirstCharacters
    } else if cut * 2 >= damaged {
        Pattern::Cut
    } else if is_by_length {
        Pattern::LongFrames
    } else if is_alone {
        Pattern::OneStation
    } else {
        Pattern::Spread
    }
}

pub(super) fn late(_: &Observed, drive: &DriveObserved) -> FindingText {
    let late = drive.damage.late;
    let severity = graded(late, drive.exchanges.total())?;
    let waited = drive.now.report.replies.iter().map(|reply| reply.timeout.as_millis()).max().unwrap_or_default();
    let text = format!(
        "{late} replies arrived after their time-out, after up to {waited} ms: leave `reply_timeout` away or \
         raise it, lower the drive's reply delay, and check what is in between (a serial device server, a radio)"
    );
    Some((severity, text))
}

/// Requests that are never answered, where late replies do not explain them.
pub(super) fn silent(seen: &Observed, drive: &DriveObserved) -> FindingText {
    let silent = drive.silent();
    let all = drive.exchanges.total();
    let severity = graded(silent, all)?;
    let is_told = drive.damage.late * 2 >= silent || seen.line.suspicion.is_some();
    let is_there = seen.is_up() && drive.exchanges.replies > 0;
    let text = || {
        format!(
            "{silent} of {all} requests had no answer at all, and others had: a loose contact, a request that is damaged on \
             its way (termination, shield), or a drive that is too busy (raise `min_request_gap`)"
        )
    };
    (is_there && !is_told).then(|| (severity, text()))
}

pub(super) fn timeout_short(_: &Observed, drive: &DriveObserved) -> FindingText {
    let replies = REPLY_CLASSES.into_iter().zip(&drive.now.report.replies);
    let (class, reply, suggested) = replies
        .filter_map(|(class, reply)| Some((class, reply, reply.suggested?)))
        .find(|(_, reply, suggested)| reply.timeout < *suggested)?;
    let text = format!(
        "a reply to a {} is waited for {} ms, and {} ms are suggested from what it takes: leave `reply_timeout` away, or \
         raise it",
        class.replace('_', " "),
        reply.timeout.as_millis(),
        suggested.as_millis()
    );
    Some((Severity::Hint, text))
}

pub(super) fn exceptions(_: &Observed, drive: &DriveObserved) -> FindingText {
    let exceptions = drive.exchanges.exceptions;
    let all = drive.exchanges.total();
    let is_much = exceptions >= SIGNS && exceptions * 1000 >= all * EXCEPTIONS_PER_MILLE;
    let text = || {
        format!(
            "{exceptions} of {all} requests were answered with an exception: it is asked for what it does not have; check \
             `model`, and what clients ask for"
        )
    };
    is_much.then(|| (Severity::Hint, text()))
}
