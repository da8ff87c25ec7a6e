//! The daemon: one thread per line, the north side on this one, until it is told to end.

use super::answers::NorthSides;
use super::line_thread::LineHandle;
use super::modbus_server::Server;
use super::router::{Router, Units};
use super::shared::Shared;
use super::{build, clock};
use crate::config::{Config, ListenerSettings};
use crate::domain::report::LineCounters;
use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::task::LocalSet;

/// Why the daemon could not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// A listener's address could not be taken.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// As configured.
        address: SocketAddr,
        /// The system's reason.
        error: io::Error,
    },
    /// A thread, a runtime or a signal handler was refused.
    #[error("the system refuses what the daemon needs: {0}")]
    System(#[from] io::Error),
}

/// What a running gateway shows to the one who started it.
#[derive(Debug)]
pub struct Running<'a> {
    /// The addresses that are really listened on, in the order of the configuration.
    pub listening: Vec<SocketAddr>,
    /// What lines and north sides share.
    pub shared: &'a Shared,
}

impl Running<'_> {
    /// The counters of each line.
    #[must_use]
    pub fn counters(&self) -> Vec<LineCounters> {
        self.shared.lines.iter().map(|line| line.report().counters).collect()
    }
}

/// Runs the gateway of `config` until `until` is over. It is given what is running once everything listens.
///
/// # Errors
/// [`StartError`]; nothing keeps running then.
pub fn run<F>(config: &Config, until: F) -> Result<(), StartError>
where
    F: AsyncFnOnce(&Running<'_>),
{
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let north = NorthSides::default();
    let shared = Arc::new(build::shared(config));
    let listeners = runtime.block_on(bind(&config.listeners))?;
    // Epochs rise far slower than this, so those of another start are others, and JSON still holds them exactly.
    let first_epoch = u64::try_from(clock::wall().unix_ms).unwrap_or(0) << 8;
    let mut lines = Vec::with_capacity(config.lines.len());
    for (place, line) in config.lines.iter().enumerate() {
        let (port, setup) = (build::line_port(line), build::line_setup(line, first_epoch));
        lines.push(LineHandle::start(port, setup, Arc::clone(&shared), place, north.clone())?);
    }
    let listening = listeners.iter().map(TcpListener::local_addr).collect::<io::Result<_>>()?;
    let local = LocalSet::new();
    runtime.block_on(local.run_until(async {
        serve(config, listeners, &shared, north);
        until(&Running { listening, shared: &shared }).await;
    }));
    drop(local);
    drop(runtime);
    for line in lines {
        line.join();
    }
    Ok(())
}

/// Catches SIGINT and SIGTERM from now on, and waits for the first of them. It is called on a runtime, before
/// the first sign of life: whoever sees that may send a signal at once.
///
/// # Errors
/// The system's refusal to install the handlers.
pub fn told_to_end() -> io::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    Ok(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
    })
}

async fn bind(settings: &[ListenerSettings]) -> Result<Vec<TcpListener>, StartError> {
    let mut listeners = Vec::with_capacity(settings.len());
    for listener in settings {
        let address = listener.listen;
        let bound = TcpListener::bind(address).await.map_err(|error| StartError::Listen { address, error })?;
        listeners.push(bound);
    }
    Ok(listeners)
}

fn serve(config: &Config, listeners: Vec<TcpListener>, shared: &Arc<Shared>, north: NorthSides) {
    let units = Units::new(shared);
    let server = Rc::new(Server::default());
    for (listener, settings) in listeners.into_iter().zip(&config.listeners) {
        let router = Rc::new(Router::new(settings, units.clone()));
        tokio::task::spawn_local(Rc::clone(&server).listen(listener, settings.clone(), router));
    }
    tokio::task::spawn_local(server.distribute(north.modbus));
}
