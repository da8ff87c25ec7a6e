//! Routes of the program's own tools, over the socket and never over TCP: what has to be set on a drive.

use super::answers::json;
use super::{hand_over, params, setup, standstill, watchdog};
use crate::config::change::ChangeNote;
use crate::daemon::exchange::reload_request::{AppliedReload, ReloadRefusal};
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::local::{LocalSide, OrderingClient};
use crate::domain::address::Address;
use crate::domain::command::{GoOrder, Owner, Reason, Report};
use crate::domain::problem::Problem;
use crate::north::api::{
    ConfigurationChange, ConfigurationWarning, OrderOutcomeDocument, RefusedReload, ReloadDocument,
    UsageResetDocument,
};
use crate::north::setup_body::{EXAMPLE, WATCHDOG_EXAMPLE, addresses, watchdog_time};
use crate::north::shown;
use axum::Router;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use serde_json::json as value;
use std::sync::Arc;
use std::time::Duration;

/// Longest body in bytes: room for the addresses of some registers.
const BODY_BYTES_MAX: usize = 4096;

/// The routes of the tools.
pub(super) fn router(side: Arc<LocalSide>) -> Router {
    Router::new()
        .route("/api/v1/drives/{name}/setup", get(show_setup).post(set))
        .route("/api/v1/drives/{name}/watchdog", post(set_watchdog))
        .route("/api/v1/drives/{name}/usage/reset", post(reset_usage))
        .route("/api/v1/drives/{name}/standstill", post(confirm_standstill))
        .route("/api/v1/reload", post(reload))
        .route("/api/v1/standby/yield", post(hand_over))
        .merge(params::router())
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .with_state(side)
}

async fn show_setup(State(side): State<Arc<LocalSide>>, Path(name): Path<String>) -> Response {
    let Some(_place) = side.place() else {
        return too_many(&name);
    };
    match find(&side, &name) {
        Some(drive) => json(&setup::report(&side, &drive).await).into_response(),
        None => unknown(&side, &name),
    }
}

async fn set(
    State(side): State<Arc<LocalSide>>,
    Path(name): Path<String>,
    body: Bytes,
) -> Response {
    match addresses(&body) {
        Some(addresses) => execute(side, name, SettingRequest::Setup(addresses)).await,
        None => not_understood(
            &name,
            format!(
                "a body such as {EXAMPLE} is expected, with 1 to {}",
                GoOrder::REGISTERS_MAX
            ),
        ),
    }
}

async fn set_watchdog(
    State(side): State<Arc<LocalSide>>,
    Path(name): Path<String>,
    body: Bytes,
) -> Response {
    match watchdog_time(&body) {
        Some(time) => execute(side, name, SettingRequest::Watchdog(time)).await,
        None => not_understood(
            &name,
            format!("a body such as {WATCHDOG_EXAMPLE} is expected, with null for off"),
        ),
    }
}

/// What a tool wants set on a drive.
enum SettingRequest {
    /// The registers at these addresses, to the values that the drive's model demands.
    Setup(Vec<u16>),
    /// The drive's own watchdog, to this time or off.
    Watchdog(Option<Duration>),
}

async fn execute(side: Arc<LocalSide>, name: String, wish: SettingRequest) -> Response {
    let Some(place) = side.place() else {
        return too_many(&name);
    };
    let Some(drive) = find(&side, &name) else {
        return unknown(&side, &name);
    };
    // A client that disconnects does not cancel the order; its outcome is logged.
    let carried_out = tokio::spawn(async move {
        let _place = place;
        match wish {
            SettingRequest::Setup(addresses) => {
                setup::set(
                    &side,
                    &drive,
                    addresses.into_iter().map(Address::holding).collect(),
                )
                .await
            }
            SettingRequest::Watchdog(time) => watchdog::set(&side, &drive, time).await,
        }
    });
    match carried_out.await {
        Ok(answer) => json(&answer).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

pub(super) fn not_understood(name: &str, message: String) -> Response {
    let answer = OrderOutcomeDocument {
        message: message.into(),
        ..refusal(name, Reason::NotUnderstood)
    };
    (StatusCode::BAD_REQUEST, json(&answer)).into_response()
}

/// Sets what the drive has used back to 0. The answer has the sums before.
async fn reset_usage(State(side): State<Arc<LocalSide>>, Path(name): Path<String>) -> Response {
    let Some(drive) = find(&side, &name) else {
        return unknown(&side, &name);
    };
    let before = shown::usage(&drive.view.load());
    if !side.reset_usage(OrderingClient::TOOL, drive.description.place) {
        return too_many(&name);
    }
    tracing::info!(drive = name, by = %Owner::Local, before = %value!(before), "energy, running hours, starts and trips set back to 0");
    let drive = name.into();
    json(&UsageResetDocument { drive, before }).into_response()
}

async fn confirm_standstill(
    State(side): State<Arc<LocalSide>>,
    Path(name): Path<String>,
) -> Response {
    match find(&side, &name) {
        Some(drive) => standstill::confirm(&side, OrderingClient::TOOL, &drive),
        None => unknown(&side, &name),
    }
}

async fn reload(State(side): State<Arc<LocalSide>>) -> Response {
    // A client that disconnects does not cancel it.
    match tokio::spawn(async move { side.reload().await }).await {
        Ok(done) => {
            let status = match &done {
                Ok(_) => StatusCode::OK,
                Err(ReloadRefusal::Configuration(_)) => StatusCode::UNPROCESSABLE_ENTITY,
                Err(_) => StatusCode::CONFLICT,
            };
            let answer = match &done {
                Ok(applied) => json(&applied_reload(applied)).into_response(),
                Err(refusal) => json(&refused_reload(refusal)).into_response(),
            };
            (status, answer).into_response()
        }
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

async fn hand_over(State(side): State<Arc<LocalSide>>, body: Bytes) -> Response {
    hand_over::answer(side, OrderingClient::TOOL, &body).await
}

fn applied_reload(applied: &AppliedReload) -> ReloadDocument {
    let change = |it: &ChangeNote| ConfigurationChange {
        part: it.part.keyword().into(),
        name: it.name.clone(),
        change: it.how.keyword().into(),
    };
    let warning = |it: &Problem| ConfigurationWarning {
        key: it.key.clone().into(),
        what: it.what.clone().into(),
        right: it.right.clone(),
    };
    ReloadDocument {
        reloaded: true,
        changes: applied.changes.iter().map(change).collect(),
        warnings: applied.warnings.iter().map(warning).collect(),
    }
}

fn refused_reload(refusal: &ReloadRefusal) -> RefusedReload {
    RefusedReload {
        reloaded: false,
        reason: refusal.keyword().into(),
        drives: refusal.drives().to_vec(),
        message: Some(refusal.to_string()),
    }
}

pub(super) fn find(side: &LocalSide, name: &str) -> Option<Arc<SharedDrive>> {
    side.shared()
        .drives
        .iter()
        .find(|drive| drive.description.name.as_str() == name)
        .cloned()
}

pub(super) fn unknown(side: &LocalSide, name: &str) -> Response {
    let shared = side.shared();
    let names = shared
        .drives
        .iter()
        .map(|it| it.description.name.to_string());
    let answer = OrderOutcomeDocument {
        drives: Some(names.collect()),
        ..refusal(name, Reason::UnknownDrive)
    };
    (StatusCode::NOT_FOUND, json(&answer)).into_response()
}

pub(super) fn too_many(name: &str) -> Response {
    (
        StatusCode::SERVICE_UNAVAILABLE,
        json(&refusal(name, Reason::QueueFull)),
    )
        .into_response()
}

fn refusal(name: &str, reason: Reason) -> OrderOutcomeDocument {
    setup::outcome(name, Report::refused(reason))
}
