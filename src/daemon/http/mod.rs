//! HTTP for monitoring: alive, ready, health, metrics, the state of lines and drives. These routes read what the lines
//! publish and request nothing from them. Signed-in users may command too, over TCP only ([`HttpControl`]).
//!
//! They are served on a TCP listener ([`serve`]) and on a Unix socket in the data directory ([`socket::OwnSocket`]), by
//! which the program's own commands reach the gateway. Only the socket has the routes that check and set what a drive
//! needs before it obeys the bus.

mod answers;
mod connections;
mod control;
pub mod diagnostics;
mod doorkeeper;
mod entrance;
mod front;
mod hand_over;
mod health;
mod large;
pub mod lasting;
pub mod live;
mod metrics;
mod own_routes;
mod page;
mod params;
mod qualify;
mod query;
mod reachable;
pub mod report;
mod routes;
mod setup;
#[cfg(test)]
mod setup_tests;
pub mod socket;
pub mod standstill;
mod state;
mod table;
mod taking;
#[cfg(test)]
mod tests;
mod traffic;
#[cfg(test)]
mod traffic_tests;
mod watchdog;

pub use connections::CONNECTIONS_MAX;
pub use control::HttpControl;
pub use front::ClientRequirements;
pub use routes::RouteDocuments;
pub use state::HttpState;

use axum::middleware::from_fn_with_state;
use connections::ConnectionPatience;
use diagnostics::ArchiveMaker;
use std::sync::Arc;
use tokio::net::TcpListener;

/// Bytes that the system buffers for a client that does not read. The default is some megabytes.
pub const SEND_BUFFER_BYTES: u32 = 128 * 1024;

/// Serves HTTP on `listener` until the task is dropped. It must run on a `LocalSet`.
pub async fn serve(listener: TcpListener, documents: RouteDocuments, control: Arc<HttpControl>) {
    let front = Arc::clone(control.front());
    let changed = Arc::clone(control.changed());
    let diagnostics = Arc::new(ArchiveMaker::new(documents.clone()));
    let router =
        routes::router(documents).merge(control::router(Arc::clone(&control), diagnostics));
    let router = router.layer(from_fn_with_state(control, control::view));
    let router = router.layer(from_fn_with_state(
        large::AnswerRoom::default(),
        large::limit_answer,
    ));
    let router = router.layer(from_fn_with_state(
        Arc::clone(&front),
        doorkeeper::admit_request,
    ));
    entrance::serve(
        listener,
        router,
        (front, changed),
        ConnectionPatience::default(),
    )
    .await;
}
