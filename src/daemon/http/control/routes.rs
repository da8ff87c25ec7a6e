//! The routes that need a sign-in.

use super::admission::{AdmittedRequest, admit};
use super::{HttpControl, commands, commissioning, sign_in};
use crate::daemon::http::answers::refusal;
use crate::daemon::http::diagnostics::{ArchiveMaker, answer};
use crate::daemon::http::hand_over;
use crate::daemon::local::OrderingClient;
use axum::Router;
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::response::Response;
use axum::routing::{get, post};
use std::sync::Arc;

/// The routes of control. Orders have no bound of their own: a connection sends one at a time, and connections are
/// bounded.
pub fn router(control: Arc<HttpControl>, diagnostics: Arc<ArchiveMaker>) -> Router {
    let for_users = (Arc::clone(&control), diagnostics);
    Router::new()
        .route(
            "/api/v1/session",
            get(sign_in::session)
                .post(sign_in::sign_in)
                .delete(sign_in::sign_out),
        )
        .route("/api/v1/drives/{name}/command", post(commands::command))
        .route("/api/v1/drives/{name}/lease", post(commands::renew))
        .route(
            "/api/v1/drives/{name}/standstill",
            post(commands::confirm_standstill),
        )
        .route("/api/v1/stop", post(commands::stop_all))
        .route("/api/v1/standby/yield", post(yield_lines))
        .with_state(Arc::clone(&control))
        .merge(commissioning::router(control))
        .merge(
            Router::new()
                .route("/api/v1/diagnostics", post(diagnostics_for_user))
                .with_state(for_users),
        )
}

type ForUsers = (Arc<HttpControl>, Arc<ArchiveMaker>);

async fn diagnostics_for_user(
    State((control, diagnostics)): State<ForUsers>,
    request: Request,
) -> Response {
    match admit(&control, request)
        .await
        .and_then(AdmittedRequest::whole)
    {
        Ok(admitted) if !admitted.rights.may_maintain() => refusal(
            StatusCode::FORBIDDEN,
            "diagnostics need the role `maintain`",
        ),
        Ok(admitted) => {
            tracing::info!(user = %admitted.user, "diagnostics made for the page");
            answer(&diagnostics).await
        }
        Err(refused) => *refused,
    }
}

async fn yield_lines(State(control): State<Arc<HttpControl>>, request: Request) -> Response {
    match admit(&control, request)
        .await
        .and_then(AdmittedRequest::whole)
    {
        Ok(admitted) if !admitted.rights.may_maintain() => refusal(
            StatusCode::FORBIDDEN,
            "to give a line to the other gateway needs the role `maintain`",
        ),
        Ok(AdmittedRequest { old: Some(old), .. }) => {
            refusal(StatusCode::CONFLICT, &old.to_string())
        }
        Ok(AdmittedRequest { user, body, .. }) => {
            hand_over::answer(
                Arc::clone(&control.side),
                OrderingClient::signed_in(user),
                &body,
            )
            .await
        }
        Err(refused) => *refused,
    }
}
