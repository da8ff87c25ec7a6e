//! The routes that need a sign-in.

use super::{Control, commands, sign_in};
use axum::Router;
use axum::routing::{get, post};
use std::sync::Arc;

/// The routes of control. Orders have no bound of their own: a connection sends one at a time, and connections are
/// bounded.
pub fn router(control: Arc<Control>) -> Router {
    Router::new()
        .route("/api/v1/session", get(sign_in::session).post(sign_in::sign_in).delete(sign_in::sign_out))
        .route("/api/v1/drives/{name}/command", post(commands::command))
        .route("/api/v1/drives/{name}/lease", post(commands::renew))
        .route("/api/v1/stop", post(commands::stop_all))
        .with_state(control)
}
