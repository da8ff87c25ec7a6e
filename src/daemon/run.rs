//! The daemon: one thread per line, the north side on this one, until it is told to end.

use super::answers::NorthSides;
use super::http::socket::{OwnSocket, SocketError};
use super::journal::Journal;
use super::line_thread::LineHandle;
use super::mqtt::broker_child::BrokerChild;
use super::north::{self, North};
use super::shared::Shared;
use super::{build, clock};
use crate::config::{BrokerSettings, Config};
use crate::domain::ids::Name;
use crate::domain::report::{LineCounters, StopBounds};
use rustix::system::uname;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;
use tokio::task::LocalSet;

/// Most time for the journal's last rows.
const JOURNAL_MAX: Duration = Duration::from_secs(2);

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
    /// The socket for the program's own commands could not be made.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The broker for trying out does not start.
    #[error("the embedded broker does not start: {0}")]
    Broker(io::Error),
    /// A password or a certificate cannot be used.
    #[error("mqtt: {0}")]
    Mqtt(String),
    /// A thread, a runtime or a signal handler was refused.
    #[error("the system refuses what the daemon needs: {0}")]
    System(#[from] io::Error),
}

/// What a running gateway shows to the one who started it.
#[derive(Debug)]
pub struct Running<'a> {
    /// The gateway's name.
    pub name: &'a Name,
    /// The addresses on which Modbus TCP is really listened to, in the order of the configuration.
    pub listening: Vec<SocketAddr>,
    /// The address of the HTTP side, if there is one.
    pub http: Option<SocketAddr>,
    /// The address of the embedded broker, if there is one.
    pub broker: Option<SocketAddr>,
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
/// At the end each drive under control gets its declared action first, then the north sides end.
///
/// # Errors
/// [`StartError`]; nothing keeps running then.
pub fn run<F>(config: &Config, until: F) -> Result<(), StartError>
where
    F: AsyncFnOnce(&Running<'_>),
{
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let name = name_of(config);
    let shared = Arc::new(build::shared(config));
    let mqtt_side = config.mqtt.as_ref().map(|_| Arc::default());
    let sides = NorthSides { mqtt: mqtt_side, ..NorthSides::default() };
    let (bound, socket) = runtime.block_on(async {
        let socket = config.gateway.data_dir.as_deref().map(OwnSocket::open).transpose()?;
        Ok::<_, StartError>((north::bind(config).await?, socket))
    })?;
    let broker = embedded_broker(config)?;
    let broker_at = broker.as_ref().map(BrokerChild::address);
    let mqtt = config.mqtt.as_ref().map(|mqtt| build::broker(mqtt, &name, broker_at)).transpose();
    let mqtt = mqtt.map_err(StartError::Mqtt)?;
    let (listening, http) = bound.addresses()?;
    let (sides, memory) = with_journal(config, sides, &shared)?;
    let journal = sides.journal.clone();
    let mut lines = start_lines(config, &shared, &sides, memory.as_ref())?;
    let local = LocalSet::new();
    runtime.block_on(local.run_until(async {
        let north = North::start(config, &name, &shared, sides, bound, socket, mqtt);
        until(&Running { name: &name, listening, http, broker: broker_at, shared: &shared }).await;
        for line in &lines {
            line.begin_shutdown();
        }
        for line in &mut lines {
            line.ended().await;
        }
        north.farewell().await;
        if let Some(journal) = &journal {
            journal.close(JOURNAL_MAX).await;
        }
    }));
    drop(local);
    drop(runtime);
    lines.into_iter().for_each(LineHandle::join);
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

/// The gateway's name: as configured, or the host's, as far as it fits into a topic.
fn name_of(config: &Config) -> Name {
    let host = || {
        let host = uname().nodename().to_string_lossy().into_owned();
        let fits = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        let text: String = host.chars().filter(|c| fits(*c)).take(Name::MAX_CHARS).collect();
        Name::new(&text)
    };
    config.gateway.name.clone().or_else(host).unwrap_or_else(Name::fallback)
}

fn embedded_broker(config: &Config) -> Result<Option<BrokerChild>, StartError> {
    let is_embedded = config.mqtt.as_ref().is_some_and(|mqtt| mqtt.broker == BrokerSettings::Embedded);
    if !is_embedded {
        return Ok(None);
    }
    let any = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    // The usual port if it is free, so that tools find it; else any.
    let broker = BrokerChild::start(any(1883)).or_else(|_| BrokerChild::start(any(0)));
    broker.map(Some).map_err(StartError::Broker)
}

/// `sides` with the journal, if there is a data directory, and what it remembers of the drives.
fn with_journal(
    config: &Config,
    sides: NorthSides,
    shared: &Arc<Shared>,
) -> io::Result<(NorthSides, Option<build::Memory>)> {
    let Some(settings) = build::journal(config) else { return Ok((sides, None)) };
    let (journal, memory) = Journal::start(&settings, sides.clone(), Arc::clone(shared))?;
    Ok((NorthSides { journal: Some(journal), ..sides }, Some(memory)))
}

fn start_lines(
    config: &Config,
    shared: &Arc<Shared>,
    sides: &NorthSides,
    memory: Option<&build::Memory>,
) -> Result<Vec<LineHandle>, StartError> {
    // Epochs rise far slower than this, so those of another start are others, and JSON still holds them exactly.
    let first_epoch = u64::try_from(clock::wall().unix_ms).unwrap_or(0) << 8;
    let data_dir = config.gateway.data_dir.as_deref();
    let start = |(place, line)| {
        let (port, setup) = (build::line_port(line, data_dir), build::line_setup(line, first_epoch, memory));
        let StopBounds { all_healthy, one_silent, .. } = setup.stop_bounds();
        tracing::info!(line = %line.name, ?all_healthy, ?one_silent, "a stop starts within these times");
        LineHandle::start(port, setup, Arc::clone(shared), place, sides.clone())
    };
    let lines: io::Result<Vec<_>> = config.lines.iter().enumerate().map(start).collect();
    Ok(lines?)
}
