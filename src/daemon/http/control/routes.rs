//! Where what needs a sign-in is found.

use super::{Control, commands, sign_in};
use axum::Router;
use axum::routing::{get, post};
use std::sync::Arc;

/// The routes of those who sign in. Orders have no bound of their own: a connection gives one after the other, and
/// connections are bounded.
pub fn router(control: Arc<Control>) -> Router {
    Router::new()
        .route("/api/v1/session", get(sign_in::session).post(sign_in::sign_in).delete(sign_in::sign_out))
        .route("/api/v1/drives/{name}/command", post(commands::command))
        .route("/api/v1/drives/{name}/lease", post(commands::renew))
        .route("/api/v1/stop", post(commands::stop_all))
        .with_state(control)
}
