//! HTTP for those who watch the gateway: alive, ready, health, metrics. It reads what the lines show and asks nothing
//! of them, and nothing can be commanded here.
//!
//! The same routes are served on a TCP listener ([`serve`]) and on a Unix socket in the data directory
//! ([`socket::OwnSocket`]), by which the program's own commands reach the gateway.

mod connections;
mod health;
mod metrics;
mod routes;
pub mod socket;
pub mod state;
mod table;
#[cfg(test)]
mod tests;

pub use connections::CONNECTIONS_MAX;
pub use state::State;

use connections::Patience;
use std::sync::Arc;
use tokio::net::TcpListener;

/// Serves HTTP on `listener` until the task is dropped. It must run on a `LocalSet`.
pub async fn serve(listener: TcpListener, state: Arc<State>) {
    connections::serve(listener, routes::router(state), Patience::default()).await;
}
