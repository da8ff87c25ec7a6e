//! The contents of one audit row.

use super::entry::WriteAttempt;
use super::remembered::RememberedLease;
use super::row::JournalRow;
use super::words;
use crate::domain::command::{Owner, Report};
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::ids::Name;
use crate::domain::time::WallTime;
use crate::drive::sight::LastSeen;
use serde_json::{Map, Value};

/// One row of the audit before it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct AuditRecord {
    /// Its number in this run of the gateway, from 1.
    pub number: u64,
    /// When the first of the counted attempts happened.
    pub at: WallTime,
    /// The drive; `None` if none, or no known one, was named.
    pub name: Option<Name>,
    /// What it is.
    pub kind: RecordKind,
    /// The client; `None` if no client held control.
    pub by: Option<Owner>,
    /// What was tried or done, in words.
    pub tried: String,
    /// The outcome; `None` if not known yet, or if the gateway exited before.
    pub report: Option<Report>,
    /// The number of attempts that it counts.
    pub count: u64,
    /// Whether it removes energy from the motor.
    pub is_stop: bool,
    /// Whether it is only a setpoint.
    pub is_setpoint: bool,
}

/// Kinds of audit rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordKind {
    /// A client tried to write.
    Attempt,
    /// A declared action fell due or came further, without a command.
    FailSafe(FailSafeRun),
    /// A stop was given up because the drive stayed offline.
    StopGivenUp,
    /// The holder of control changed, or there is none any more.
    Lease(LeaseChange),
    /// The drive is out of sight and may still run; this was last seen of it.
    MayStillRun(Option<LastSeen>),
    /// A person confirmed that the motor of such a drive stands.
    StandstillConfirmed,
    /// The sums of what the drive has used were set back to 0.
    UsageReset,
}

/// How control changed hands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseChange {
    /// Control had no holder before.
    Opened,
    /// Control has no holder any more.
    Ended,
    /// Control was taken over from this owner.
    TakenOver(Owner),
    /// The gateway restarted, and its owner is awaited.
    Orphaned,
    /// The owner came back after a restart of the gateway.
    TakenUp,
}

impl LeaseChange {
    /// The change from the remembered lease `before` to `owner`, with the owner concerned; `None` if nothing changed.
    #[must_use]
    pub fn of(before: Option<RememberedLease>, owner: Option<Owner>) -> Option<(Owner, Self)> {
        match (before, owner) {
            (None, Some(owner)) => Some((owner, Self::Opened)),
            (Some(before), None) => Some((before.owner, Self::Ended)),
            (Some(before), Some(owner)) if before.owner != owner => {
                Some((owner, Self::TakenOver(before.owner)))
            }
            (Some(before), Some(owner)) if before.was_orphaned => Some((owner, Self::TakenUp)),
            (Some(_), Some(_)) | (None, None) => None,
        }
    }

    const fn keyword(self) -> &'static str {
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
    /// The word used in the journal.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Attempt => "attempt",
            Self::FailSafe(_) => "failsafe",
            Self::StopGivenUp => "stop_given_up",
            Self::Lease(_) => "lease",
            Self::MayStillRun(_) => "may_still_run",
            Self::StandstillConfirmed => "standstill_confirmed",
            Self::UsageReset => "usage_reset",
        }
    }
}

impl AuditRecord {
    /// The record of `attempt` on the drive called `name`.
    #[must_use]
    pub fn of_attempt(at: WallTime, name: Option<&Name>, attempt: &WriteAttempt) -> Self {
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
    pub fn of_failsafe(at: WallTime, name: &Name, owner: Option<Owner>, run: FailSafeRun) -> Self {
        let kind = RecordKind::FailSafe(run);
        Self {
            kind,
            by: owner,
            tried: run.action.keyword().to_owned(),
            ..Self::of_gateway(at, name)
        }
    }

    /// The record of a stop that was given up.
    #[must_use]
    pub fn of_stop_given_up(at: WallTime, name: &Name) -> Self {
        Self {
            kind: RecordKind::StopGivenUp,
            tried: "stop".to_owned(),
            ..Self::of_gateway(at, name)
        }
    }

    /// The record of a lease that changed, or of its `owner`.
    #[must_use]
    pub fn of_lease(at: WallTime, name: &Name, owner: Owner, change: LeaseChange) -> Self {
        let kind = RecordKind::Lease(change);
        Self {
            kind,
            by: Some(owner),
            is_stop: false,
            ..Self::of_gateway(at, name)
        }
    }

    /// The record of sums that `owner` has set back to 0.
    #[must_use]
    pub fn of_usage_reset(at: WallTime, name: &Name, owner: Owner) -> Self {
        let tried = "reset usage".to_owned();
        Self {
            kind: RecordKind::UsageReset,
            by: Some(owner),
            tried,
            is_stop: false,
            ..Self::of_gateway(at, name)
        }
    }

    /// The record of a drive that is out of sight and may still run.
    #[must_use]
    pub fn of_out_of_sight(at: WallTime, name: &Name, last_seen: Option<LastSeen>) -> Self {
        Self {
            kind: RecordKind::MayStillRun(last_seen),
            ..Self::of_gateway(at, name)
        }
    }

    /// The record that `owner` confirmed that the motor stands.
    #[must_use]
    pub fn of_standstill(at: WallTime, name: &Name, owner: Owner) -> Self {
        let tried = "confirm standstill".to_owned();
        Self {
            kind: RecordKind::StandstillConfirmed,
            by: Some(owner),
            tried,
            ..Self::of_gateway(at, name)
        }
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

    /// The row, numbered after `base` rows of earlier runs.
    #[must_use]
    pub fn row(&self, base: u64) -> JournalRow {
        let mut body = Map::new();
        let mut say = |key: &str, value: Value| drop(body.insert(key.to_owned(), value));
        say("by", self.by.map(|owner| owner.to_string()).into());
        if !matches!(self.kind, RecordKind::Lease(_) | RecordKind::MayStillRun(_)) {
            say("tried", self.tried.as_str().into());
            say("count", self.count.into());
        }
        match self.kind {
            RecordKind::Attempt => {
                say(
                    "outcome",
                    self.report.map(|report| report.outcome.keyword()).into(),
                );
                say(
                    "reason",
                    self.report.map(|report| report.reason.keyword()).into(),
                );
            }
            RecordKind::FailSafe(run) => {
                say("cause", run.cause.keyword().into());
                say("stage", run.stage.keyword().into());
            }
            RecordKind::Lease(change) => {
                say("state", change.keyword().into());
                if let LeaseChange::TakenOver(from) = change {
                    say("from", from.to_string().into());
                }
            }
            RecordKind::MayStillRun(last_seen) => {
                say(
                    "run_state",
                    last_seen.map(|seen| seen.run_state.keyword()).into(),
                );
                say(
                    "output_hz",
                    last_seen
                        .and_then(|seen| Some(seen.output?.as_f64()))
                        .into(),
                );
            }
            RecordKind::StopGivenUp | RecordKind::StandstillConfirmed | RecordKind::UsageReset => {}
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
        let row = JournalRow::new(self.at, self.kind.keyword(), name, &Value::Object(body));
        JournalRow {
            number: base + self.number,
            ..row
        }
    }
}
