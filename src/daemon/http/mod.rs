//! HTTP for those who watch the gateway: alive, ready, health, metrics. These routes read what the lines show and ask
//! nothing of them, and nothing can be commanded there.
//!
//! They are served on a TCP listener ([`serve`]) and on a Unix socket in the data directory ([`socket::OwnSocket`]), by
//! which the program's own commands reach the gateway. On the socket alone are the routes that look at and set what a
//! drive needs before it obeys the bus.

mod connections;
mod health;
mod metrics;
mod own_routes;
mod params;
mod routes;
mod setup;
#[cfg(test)]
mod setup_tests;
pub mod socket;
pub mod state;
mod table;
#[cfg(test)]
mod tests;
mod watchdog;

pub use connections::CONNECTIONS_MAX;
pub use state::State;

use connections::Patience;
use std::sync::Arc;
use tokio::net::TcpListener;

/// Serves HTTP on `listener` until the task is dropped. It must run on a `LocalSet`.
pub async fn serve(listener: TcpListener, state: Arc<State>) {
    connections::serve(listener, routes::router(state), Patience::default()).await;
}
