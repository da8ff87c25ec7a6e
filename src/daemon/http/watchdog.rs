//! Sets the drive's own watchdog, for `vfd-gateway watchdog` only.

use super::setup::{outcome, outcome_at};
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::host::clock;
use crate::daemon::local::{LocalSide, OrderingClient};
use crate::domain::command::{GoOrder, Order, Outcome, Owner, Reason, RegisterWrite, Report};
use crate::north::api::{ChangeDocument, OrderOutcomeDocument};
use crate::profile::model::Register;
use std::time::Duration;

/// Longest time for the read before.
const READ_WITHIN: Duration = Duration::from_secs(5);

/// Sets the watchdog of `drive` to exactly `time`, or off if `None`, and reports the outcome. The old value is read
/// first, because it is logged; a drive that does not return it is not set.
pub(super) async fn set(
    side: &LocalSide,
    drive: &SharedDrive,
    time: Option<Duration>,
) -> OrderOutcomeDocument {
    let description = &drive.description;
    let model = &*drive.description.model;
    let name = description.name.as_str();
    let place = description.place;
    let refused = |reason| outcome(name, Report::refused(reason));
    let Some(watchdog) = &model.watchdog else {
        return refused(Reason::NotCapable);
    };
    let Some(value) = model.watchdog_word(time) else {
        return refused(Reason::OutsideRange);
    };
    let address = watchdog.time;
    let old = match side.read(place, address, clock::now() + READ_WITHIN).await {
        Ok(old) => old,
        Err(failed) => {
            return outcome_at(
                drive,
                Report {
                    outcome: Outcome::Refused,
                    ..failed
                },
                Vec::new(),
            );
        }
    };
    let Some(go) = GoOrder::new(vec![RegisterWrite::new(address, value)], None, None) else {
        return refused(Reason::NotUnderstood);
    };
    let report = side
        .command(OrderingClient::TOOL, place, Order::Go(go))
        .await;
    let what = model.register_at(address).map_or("-", Register::label);
    let result = report.outcome.keyword();
    let reason = report.reason.keyword();
    tracing::info!(
        drive = name, by = %Owner::Local, what, old, new = value, outcome = result, reason, "drive watchdog set"
    );
    let change = ChangeDocument {
        what: what.to_owned().into(),
        address: Some(address.number()),
        old: Some(old.into()),
        new: Some(value.into()),
    };
    outcome_at(drive, report, vec![change])
}
