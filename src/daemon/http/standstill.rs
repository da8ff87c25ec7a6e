//! A person confirms that the motor of a drive that is out of sight stands.

use super::answers::{json, refusal};
use super::setup::outcome_at;
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::local::{LocalSide, OrderingClient};
use crate::domain::command::{Outcome, Reason, Report};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

/// Sends the line of `drive` the confirmation of `who` that the motor stands. It ends what is reported of the drive,
/// and sends the drive nothing.
pub(super) fn confirm(side: &LocalSide, who: OrderingClient, drive: &SharedDrive) -> Response {
    if !drive.view.load().sight.may_still_run {
        let why =
            "there is nothing to confirm: the drive is in sight, or it was seen at standstill";
        return refusal(StatusCode::CONFLICT, why);
    }
    let (shared, place) = (side.shared(), drive.description.place);
    let message = LineMessage::ConfirmStandstill(place.drive, who.owner());
    if shared
        .inbox(place)
        .is_none_or(|inbox| inbox.put(message).is_err())
    {
        return refusal(
            StatusCode::SERVICE_UNAVAILABLE,
            "the drive's line takes no messages",
        );
    }
    tracing::info!(drive = %drive.description.name, by = %who.owner(), "confirmed that the motor stands");
    json(&outcome_at(
        drive,
        Report::new(Outcome::Acknowledged, Reason::None),
        Vec::new(),
    ))
    .into_response()
}
