//! What stands in one row of the audit.

use super::entry::{Attempt, Cause};
use super::remembered::RememberedLease;
use super::row::Row;
use super::words;
use crate::domain::command::{Owner, Report};
use crate::domain::control::FailSafe;
use crate::domain::ids::Name;
use crate::domain::time::WallTime;
use serde_json::{Map, Value};

/// One row of the audit before it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Its number among those of this life of the gateway, from 1.
    pub number: u64,
    /// When the first of what it counts happened.
    pub at: WallTime,
    /// The drive; nothing: none was named, or no known one.
    pub name: Option<Name>,
    /// What it is.
    pub kind: RecordKind,
    /// Who; nothing: nobody held control.
    pub by: Option<Owner>,
    /// What was tried or done, in words.
    pub tried: String,
    /// What became of it; nothing: that is not known yet, or the gateway ended before.
    pub report: Option<Report>,
    /// How many attempts it stands for.
    pub count: u64,
    /// It takes energy off the motor.
    pub is_stop: bool,
    /// It is a setpoint alone.
    pub is_setpoint: bool,
}

/// What a row of the audit is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordKind {
    /// Somebody tried to write.
    Attempt,
    /// A declared action ran although nobody commanded it.
    FailSafe(Cause),
    /// A stop was given up because the drive stayed away.
    StopGivenUp,
    /// Control is held by somebody else than before, or by nobody.
    Lease(LeaseChange),
}

/// How control changed hands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseChange {
    /// Nobody held it before.
    Opened,
    /// Nobody holds it any more.
    Ended,
    /// It was taken over from this one.
    TakenOver(Owner),
    /// The gateway started anew, and its owner is awaited.
    Orphaned,
    /// Its owner came back after that.
    TakenUp,
}

impl LeaseChange {
    /// What `owner` now means where `before` is remembered, with the one whom it is about; nothing new: nothing.
    #[must_use]
    pub fn of(before: Option<RememberedLease>, owner: Option<Owner>) -> Option<(Owner, Self)> {
        match (before, owner) {
            (None, Some(owner)) => Some((owner, Self::Opened)),
            (Some(before), None) => Some((before.owner, Self::Ended)),
            (Some(before), Some(owner)) if before.owner != owner => Some((owner, Self::TakenOver(before.owner))),
            (Some(before), Some(owner)) if before.was_orphaned => Some((owner, Self::TakenUp)),
            (Some(_), Some(_)) | (None, None) => None,
        }
    }

    const fn word(self) -> &'static str {
        match self {
            Self::Opened => "opened",
            Self::Ended => "ended",
            Self::TakenOver(_) => "taken_over",
            Self::Orphaned => "orphaned",
            Self::TakenUp => "taken_up",
        }
    }
}

impl RecordKind {
    /// The word as it stands in the journal.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Attempt => "attempt",
            Self::FailSafe(_) => "failsafe",
            Self::StopGivenUp => "stop_given_up",
            Self::Lease(_) => "lease",
        }
    }
}

impl Record {
    /// The record of `attempt` on the drive called `name`.
    #[must_use]
    pub fn of_attempt(at: WallTime, name: Option<&Name>, attempt: &Attempt) -> Self {
        Self {
            number: 0,
            at,
            name: name.cloned(),
            kind: RecordKind::Attempt,
            by: Some(attempt.owner),
            tried: words::tried(&attempt.tried),
            report: attempt.report,
            count: 1,
            is_stop: words::is_stop(&attempt.tried),
            is_setpoint: words::is_setpoint(&attempt.tried),
        }
    }

    /// The record of a declared action.
    #[must_use]
    pub fn of_failsafe(at: WallTime, name: &Name, owner: Option<Owner>, action: FailSafe, cause: Cause) -> Self {
        let kind = RecordKind::FailSafe(cause);
        Self { kind, by: owner, tried: action.word().to_owned(), ..Self::of_gateway(at, name) }
    }

    /// The record of a stop that was given up.
    #[must_use]
    pub fn of_stop_given_up(at: WallTime, name: &Name) -> Self {
        Self { kind: RecordKind::StopGivenUp, tried: "stop".to_owned(), ..Self::of_gateway(at, name) }
    }

    /// The record of a lease that changed, or of its `owner`.
    #[must_use]
    pub fn of_lease(at: WallTime, name: &Name, owner: Owner, change: LeaseChange) -> Self {
        let kind = RecordKind::Lease(change);
        Self { kind, by: Some(owner), is_stop: false, ..Self::of_gateway(at, name) }
    }

    fn of_gateway(at: WallTime, name: &Name) -> Self {
        Self {
            number: 0,
            at,
            name: Some(name.clone()),
            kind: RecordKind::StopGivenUp,
            by: None,
            tried: String::new(),
            report: None,
            count: 1,
            is_stop: true,
            is_setpoint: false,
        }
    }

    /// The row, behind `base` rows of earlier lives.
    #[must_use]
    pub fn row(&self, base: u64) -> Row {
        let mut body = Map::new();
        let mut say = |key: &str, value: Value| drop(body.insert(key.to_owned(), value));
        say("by", self.by.map(|owner| owner.to_string()).into());
        if !matches!(self.kind, RecordKind::Lease(_)) {
            say("tried", self.tried.as_str().into());
            say("count", self.count.into());
        }
        match self.kind {
            RecordKind::Attempt => {
                say("outcome", self.report.map(|report| report.outcome.word()).into());
                say("reason", self.report.map(|report| report.reason.word()).into());
            }
            RecordKind::FailSafe(cause) => say("cause", cause.word().into()),
            RecordKind::Lease(change) => {
                say("state", change.word().into());
                if let LeaseChange::TakenOver(from) = change {
                    say("from", from.to_string().into());
                }
            }
            RecordKind::StopGivenUp => {}
        }
        if let Some(holder) = self.report.and_then(|report| report.holder) {
            say("holder", holder.to_string().into());
        }
        if let Some(held) = self.report.and_then(|report| report.held) {
            say("held", held.into());
        }
        if let Some(exception) = self.report.and_then(|report| report.exception) {
            say("exception", exception.into());
        }
        let name = self.name.as_ref().map(Name::as_str);
        let row = Row::new(self.at, self.kind.word(), name, &Value::Object(body));
        Row { number: base + self.number, ..row }
    }
}
