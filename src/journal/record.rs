//! What stands in one row of the audit.

use super::entry::{Attempt, Cause};
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
}

impl RecordKind {
    /// The word as it stands in the journal.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Attempt => "attempt",
            Self::FailSafe(_) => "failsafe",
            Self::StopGivenUp => "stop_given_up",
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
        say("tried", self.tried.as_str().into());
        say("count", self.count.into());
        match self.kind {
            RecordKind::Attempt => {
                say("outcome", self.report.map(|report| report.outcome.word()).into());
                say("reason", self.report.map(|report| report.reason.word()).into());
            }
            RecordKind::FailSafe(cause) => say("cause", cause.word().into()),
            RecordKind::StopGivenUp => {}
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
