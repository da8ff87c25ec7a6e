//! Commands of signed-in users: to one drive, or a stop of all.

use super::HttpControl;
use super::admission::{AdmittedRequest, admit};
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::host::clock;
use crate::daemon::http::answers::json;
use crate::daemon::http::answers::refusal;
use crate::daemon::http::{setup, standstill};
use crate::daemon::local::OrderingClient;
use crate::domain::command::{Order, Outcome, Reason, Report};
use crate::domain::ids::CommanderName;
use crate::guard::COMMAND_DEADLINE;
use crate::journal::TriedWrite;
use crate::north::command_words::{RefusedCommand, stop_in};
use crate::north::operator::body::{PageCommand, is_empty, parse_command};
use crate::north::operator::moments::OrderAge;
use crate::north::shown;
use crate::north::texts::Sentence;
use crate::profile::scale::setpoint_step;
use axum::extract::{Path, Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};
use std::sync::Arc;

/// Characters of a body that is not understood that are kept in the audit.
const KEPT_CHARS: usize = 200;

/// Executes a command to one drive and reports its outcome.
pub(super) async fn command(
    State(control): State<Arc<HttpControl>>,
    Path(name): Path<String>,
    request: Request,
) -> Response {
    let AdmittedRequest {
        user,
        rights,
        body,
        old,
        flaw,
        ..
    } = match admit(&control, request).await {
        Ok(admitted) => admitted,
        Err(refused) => return *refused,
    };
    if let Some(flaw) = flaw
        && stop_in(&body).is_none()
    {
        return *flaw;
    }
    let who = OrderingClient::signed_in(user);
    let drive = find(&control, &name);
    let place = drive.as_ref().map(|drive| drive.description.place);
    let keep = |reason| {
        let text = format!("{name}: {}", String::from_utf8_lossy(&body));
        let tried = TriedWrite::Text(text.chars().take(KEPT_CHARS).collect());
        control
            .side
            .keep(who, place, tried, Report::refused(reason));
    };
    let Some(drive) = &drive else {
        keep(Reason::UnknownDrive);
        return unknown(&control, &name);
    };
    let is_allowed = rights.may_command(drive.description.group.as_ref());
    let is_stop = rights.may_stop() && stop_in(&body).is_some();
    if !is_allowed && !is_stop {
        keep(Reason::NotAllowed);
        return not_allowed(drive);
    }
    match parse_command(&body, setpoint_step(&drive.description.model)) {
        Ok(mut wish) => {
            if !is_allowed {
                leave_the_stop_alone(&mut wish);
            }
            let old = old
                .filter(|_| !wish.order.as_ref().is_some_and(Order::is_stop))
                .map(|old| old.to_string());
            let (report, message) = match old {
                Some(old) => {
                    keep(Reason::Stale);
                    (Report::refused(Reason::Stale), Some(old))
                }
                None => (execute(&control, who, drive, &wish).await, wish.beside),
            };
            json(&outcome_with(drive, report, message)).into_response()
        }
        Err(RefusedCommand { reason, message }) => {
            keep(reason);
            let mut answer = outcome_json(drive, Report::refused(reason));
            answer["message"] = message.as_str().into();
            answer["error"] = message.into();
            (StatusCode::BAD_REQUEST, json(&answer)).into_response()
        }
    }
}

/// What stands beside the stop is not this user's to order.
fn leave_the_stop_alone(wish: &mut PageCommand) {
    wish.takes = false;
    if let Some(Order::Stop { setpoint }) = &mut wish.order {
        *setpoint = None;
    }
}

async fn execute(
    control: &HttpControl,
    who: OrderingClient,
    drive: &SharedDrive,
    wish: &PageCommand,
) -> Report {
    let place = drive.description.place;
    let begun = clock::now();
    let taken = if wish.takes {
        Some(control.side.command(who, place, Order::Take).await)
    } else {
        None
    };
    let is_refused = taken.is_some_and(|taken| taken.outcome != Outcome::Acknowledged);
    match (taken, wish.order.clone()) {
        (Some(taken), None) => taken,
        (Some(taken), Some(_)) if is_refused => taken,
        // The line took longer to grant control than an order may wait.
        (Some(_), Some(order)) if clock::now().since(begun) >= COMMAND_DEADLINE => {
            let report = Report::new(Outcome::Expired, Reason::TooLate);
            control
                .side
                .keep(who, Some(place), TriedWrite::Order(order), report);
            report
        }
        (_, Some(order)) => control.side.command(who, place, order).await,
        (None, None) => Report::refused(Reason::NotUnderstood),
    }
}

/// Who asks with an empty body about the drive `name`, which that user may command, and why the request may be old.
async fn for_drive(
    control: &Arc<HttpControl>,
    name: &str,
    request: Request,
) -> Result<(CommanderName, Option<OrderAge>, Arc<SharedDrive>), Box<Response>> {
    let AdmittedRequest {
        user,
        rights,
        body,
        old,
        ..
    } = admit(control, request)
        .await
        .and_then(AdmittedRequest::whole)?;
    if !is_empty(&body) {
        return Err(Box::new(refusal(
            StatusCode::BAD_REQUEST,
            "an empty body is expected: {}",
        )));
    }
    let Some(drive) = find(control, name) else {
        return Err(Box::new(unknown(control, name)));
    };
    if !rights.may_command(drive.description.group.as_ref()) {
        return Err(Box::new(not_allowed(&drive)));
    }
    Ok((user, old, drive))
}

/// Renews the lease of the signed-in user.
pub(super) async fn renew(
    State(control): State<Arc<HttpControl>>,
    Path(name): Path<String>,
    request: Request,
) -> Response {
    let (user, old, drive) = match for_drive(&control, &name, request).await {
        Ok(admitted) => admitted,
        Err(refused) => return *refused,
    };
    let report = match old {
        None => {
            control
                .side
                .command(
                    OrderingClient::signed_in(user),
                    drive.description.place,
                    Order::Renew,
                )
                .await
        }
        Some(_) => Report::refused(Reason::Stale),
    };
    if report.outcome == Outcome::Acknowledged {
        return StatusCode::NO_CONTENT.into_response();
    }
    let mut answer = outcome_json(&drive, report);
    answer["error"] = old
        .map_or_else(|| report.message(), |old| old.to_string())
        .into();
    (StatusCode::CONFLICT, json(&answer)).into_response()
}

/// The signed-in user confirms that the motor of a drive that is out of sight stands. It ends what is reported of the
/// drive, and sends it nothing.
pub(super) async fn confirm_standstill(
    State(control): State<Arc<HttpControl>>,
    Path(name): Path<String>,
    request: Request,
) -> Response {
    let (user, old, drive) = match for_drive(&control, &name, request).await {
        Ok(admitted) => admitted,
        Err(refused) => return *refused,
    };
    if let Some(old) = old {
        let mut answer = outcome_json(&drive, Report::refused(Reason::Stale));
        answer["error"] = old.to_string().into();
        return (StatusCode::CONFLICT, json(&answer)).into_response();
    }
    standstill::confirm(&control.side, OrderingClient::signed_in(user), &drive)
}

/// Stops every drive that may be commanded from the page, whatever the body says. Each line finds its orders together,
/// so that it can stop its drives with one frame.
pub(super) async fn stop_all(
    State(control): State<Arc<HttpControl>>,
    request: Request,
) -> Response {
    let AdmittedRequest {
        user,
        rights,
        body,
        flaw,
        ..
    } = match admit(&control, request).await {
        Ok(admitted) => admitted,
        Err(refused) => return *refused,
    };
    let who = OrderingClient::signed_in(user);
    let shared = control.side.shared();
    let order = Order::Stop { setpoint: None };
    let is_ours = |drive: &&Arc<SharedDrive>| {
        rights.may_stop()
            && drive
                .description
                .control
                .as_ref()
                .is_some_and(|it| it.from_page)
    };
    let drives: Vec<_> = shared.drives.iter().filter(is_ours).collect();
    let places: Vec<_> = drives.iter().map(|drive| drive.description.place).collect();
    let ordered = control.side.stop_all(who, &places);
    tracing::info!(%user, drives = ordered.len(), "STOP of all drives from the page");
    if ordered.is_empty() {
        control.side.keep(
            who,
            None,
            TriedWrite::Order(order),
            Report::refused(Reason::NotAllowed),
        );
        return refusal(
            StatusCode::CONFLICT,
            "there is no drive that you may stop from the page",
        );
    }
    let mut ends = Vec::with_capacity(drives.len());
    for (drive, ordered) in drives.into_iter().zip(ordered) {
        ends.push(outcome_json(drive, ordered.end().await));
    }
    let mut answer = json!({ "drives": ends });
    if flaw.is_some() || !is_empty(&body) {
        answer["message"] = "the stop was taken all the same: an empty body is expected: {}".into();
    }
    json(&answer).into_response()
}

fn not_allowed(drive: &SharedDrive) -> Response {
    let mut answer = outcome_json(drive, Report::refused(Reason::NotAllowed));
    answer["error"] = "your role or your groups in [[http.users]] do not allow this".into();
    (StatusCode::FORBIDDEN, json(&answer)).into_response()
}

/// The outcome of an order.
fn outcome_json(drive: &SharedDrive, report: Report) -> Value {
    let mut outcome = json!(setup::outcome_at(drive, report, Vec::new()));
    outcome["holder"] = report.holder.map(|holder| holder.to_string()).into();
    outcome["said"] = shown::said(&drive.description.model, &report).document();
    if report.reason == Reason::BetweenSteps
        && let Some(step) = setpoint_step(&drive.description.model)
    {
        let said = Sentence::new("reason.between_steps_of").with("step", step.to_string());
        outcome["message"] = said.to_string().into();
        outcome["said"] = said.document();
    }
    outcome
}

/// The outcome of an order, with what else there is to say.
fn outcome_with(drive: &SharedDrive, report: Report, message: Option<String>) -> Value {
    let mut answer = outcome_json(drive, report);
    if let Some(message) = message {
        // What stands beside a stop is more than the reason says.
        if report.reason != Reason::Stale {
            answer["said"] = Value::Null;
        }
        answer["message"] = message.into();
    }
    answer
}

/// The drive called `name`.
pub(super) fn find(control: &HttpControl, name: &str) -> Option<Arc<SharedDrive>> {
    control
        .side
        .shared()
        .drives
        .iter()
        .find(|drive| drive.description.name.as_str() == name)
        .cloned()
}

fn unknown(control: &HttpControl, name: &str) -> Response {
    let shared = control.side.shared();
    let names: Vec<_> = shared
        .drives
        .iter()
        .map(|drive| drive.description.name.as_str())
        .collect();
    let name: String = name.chars().take(64).collect();
    let answer = json!({ "error": format!("there is no drive `{name}`"), "drives": names });
    (StatusCode::NOT_FOUND, json(&answer)).into_response()
}
