//! The daemon: one thread per line, the north side on this one, until shutdown.

use crate::config::Config;
use crate::daemon::commissioning::ConfigSite;
use crate::daemon::exchange::bell::BrokerBell;
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::reload_request::{ReloadRefusal, ReloadRequests, Reloaded};
use crate::daemon::exchange::shared::CurrentPlant;
use crate::daemon::host::{directories, sys};
use crate::daemon::http::socket::OwnSocket;
use crate::daemon::journal::Journal;
use crate::daemon::line_thread::Memory;
use crate::daemon::lines;
use crate::daemon::lines::threads::LineThreads;
use crate::daemon::mqtt::broker_child::BrokerChild;
use crate::daemon::service::build;
use crate::daemon::service::conversations::BrokerSide;
use crate::daemon::service::embedded_broker::embedded_broker;
use crate::daemon::service::north::{self, RunningNorth, ToolConnections};
use crate::daemon::service::notify;
use crate::daemon::service::reload::{ConfigLoader, ConfigOrigin, RunningGateway};
use crate::daemon::service::signals::told_to_end;
use crate::daemon::service::start_error::StartError;
use crate::domain::ids::Name;
use crate::domain::problem::Problem;
use crate::domain::report::LineCounters;
use rustix::system::uname;
use std::io;
use std::net::SocketAddr;
use std::path::Path;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{mpsc, oneshot};
use tokio::task::LocalSet;

/// Most time for the journal's last rows.
const JOURNAL_MAX: Duration = Duration::from_secs(2);
/// Most threads for blocking work (files, name lookups, passwords): each keeps some memory.
const BESIDE_THREADS_MAX: usize = 16;
/// Most time at shutdown for blocking work that is still running: it may hang, and ends with the process.
const BESIDE_MAX: Duration = Duration::from_secs(1);

/// What a running gateway reveals to its caller.
#[derive(Debug)]
pub struct RunningInfo<'a> {
    /// The gateway's name.
    pub name: &'a Name,
    /// The actual addresses of the Modbus TCP listeners, in the order of the configuration.
    pub listening: Vec<SocketAddr>,
    /// The address of the HTTP side, if there is one.
    pub http: Option<SocketAddr>,
    /// The address of the embedded broker, if there is one.
    pub broker: Option<SocketAddr>,
    /// What lines and north sides share.
    pub shared: &'a CurrentPlant,
}

impl RunningInfo<'_> {
    /// The counters of each line.
    #[must_use]
    pub fn counters(&self) -> Vec<LineCounters> {
        self.shared
            .load()
            .lines
            .iter()
            .map(|line| line.report().counters)
            .collect()
    }
}

/// Runs the gateway of `config` until `until` returns, which is called once everything listens. On
/// SIGHUP, and on request of a tool, `load` loads the configuration again, if given.
///
/// At shutdown each drive under control gets its declared action first, then the north sides end. A second signal ends
/// the wait for the effect.
///
/// # Errors
/// [`StartError`]; nothing keeps running then.
pub fn run<F>(config: &Config, load: Option<ConfigOrigin>, until: F) -> Result<(), StartError>
where
    F: AsyncFnOnce(&RunningInfo<'_>),
{
    run_for(config, load, None, until)
}

/// Runs the gateway of `config` for a tool of this process, until `until` returns. It does not listen:
/// the tool commands over `connections` with the rights that the first listener of `config` grants to this host.
///
/// # Errors
/// [`StartError`]; nothing keeps running then.
pub fn run_for_tool<F>(
    config: &Config,
    connections: ToolConnections,
    until: F,
) -> Result<(), StartError>
where
    F: AsyncFnOnce(&RunningInfo<'_>),
{
    run_for(config, None, Some(connections), until)
}

fn run_for<F>(
    config: &Config,
    load: Option<ConfigOrigin>,
    tool: Option<ToolConnections>,
    until: F,
) -> Result<(), StartError>
where
    F: AsyncFnOnce(&RunningInfo<'_>),
{
    sys::give_memory_back();
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    let runtime = runtime
        .enable_all()
        .max_blocking_threads(BESIDE_THREADS_MAX)
        .build()?;
    let local = LocalSet::new();
    let ended = runtime.block_on(local.run_until(async {
        let (reloads, asked) = ReloadRequests::channel();
        let (mut gateway, shown) = start(
            config,
            load.as_ref().map(|load| (load.site(), reloads.clone())),
            tool,
        )
        .await?;
        if load.is_some() {
            tokio::task::spawn_local(reload_on_hangup(signal(SignalKind::hangup())?, reloads));
        }
        let watch = tokio::task::spawn_local(notify::watch(gateway.current.clone()));
        notify::ready(&gateway.current);
        let name = gateway.name.clone();
        let current = gateway.current.clone();
        let (listening, http, broker) = shown;
        let running = RunningInfo {
            name: &name,
            listening,
            http,
            broker,
            shared: &current,
        };
        serve(&mut gateway, load.as_ref(), asked, until(&running)).await;
        watch.abort();
        Ok(end(gateway).await)
    }));
    drop(local);
    runtime.shutdown_timeout(BESIDE_MAX);
    ended.map(LineThreads::join)
}

/// Makes the directory if it is missing and may be made. The gateway controls without it.
fn make_data_dir(directory: &Path) {
    let path = directory.display();
    match directories::make(directory) {
        Ok(true) => tracing::info!(%path, "data_dir created"),
        Ok(false) => (),
        Err(error) => {
            tracing::error!(%path, %error, "ALARM: no data_dir; control continues without journal and local socket")
        }
    }
}

type Addresses = (Vec<SocketAddr>, Option<SocketAddr>, Option<SocketAddr>);

/// Acquires everything that the gateway needs, and starts it.
async fn start(
    config: &Config,
    reloads: Option<(ConfigSite, ReloadRequests)>,
    tool: Option<ToolConnections>,
) -> Result<(RunningGateway, Addresses), StartError> {
    warn_of(&config.warnings);
    let name = name_of(config);
    let sides = NorthSides {
        mqtt: Some(Arc::default()),
        sparkplug: Some(Arc::default()),
        ..NorthSides::default()
    };
    let shared = Arc::new(lines::build::shared(config));
    let data_dir = config.gateway.data_dir.clone();
    if let Some(directory) = &data_dir {
        make_data_dir(directory);
    }
    let (site, reloads) = reloads.unzip();
    let socket = data_dir
        .as_deref()
        .map(OwnSocket::open)
        .transpose()?
        .map(|socket| (socket, reloads));
    let bound = if tool.is_some() {
        north::unbound(config)
    } else {
        north::bind(config, &[], true).await?
    };
    let broker = embedded_broker(config)?;
    let broker_at = broker.as_ref().map(BrokerChild::address);
    let broker_side = broker_side(config, &name, broker_at)?;
    let (listening, http) = bound.addresses()?;
    let changed = Arc::clone(&shared.changed);
    let (journal, memory) = begun_journal(config, &sides, &changed)?;
    let mut lines = LineThreads::new(
        sides.clone(),
        journal.clone(),
        changed,
        data_dir,
        shared.lines.len(),
    );
    let mut handles = Vec::with_capacity(config.lines.len());
    for (settings, line) in config.lines.iter().zip(&shared.lines) {
        handles.push(lines.prepare(settings, Arc::clone(line)).await?);
    }
    let current = CurrentPlant::from(shared);
    let both = (sides, journal.clone());
    let north = RunningNorth::start(
        config,
        (&name, site),
        current.clone(),
        both,
        bound,
        socket,
        broker_side,
    );
    if let Some(connections) = tool {
        north.serve_tool(config, connections);
    }
    lines.begin(handles, &memory);
    let loader = ConfigLoader::default();
    let gateway = RunningGateway {
        config: config.clone(),
        name,
        current,
        lines,
        north,
        broker,
        journal,
        loader,
    };
    Ok((gateway, (listening, http, broker_at)))
}

/// The side of the broker, if one is configured; an embedded one listens at `embedded`.
fn broker_side(
    config: &Config,
    name: &Name,
    embedded: Option<SocketAddr>,
) -> Result<Option<BrokerSide>, StartError> {
    let Some(mqtt) = &config.mqtt else {
        return Ok(None);
    };
    let data_dir = config.gateway.data_dir.as_deref();
    build::broker(mqtt, (name, config.standby.as_ref()), data_dir, embedded)
        .map(Some)
        .map_err(StartError::Mqtt)
}

async fn reload_on_hangup(mut hangup: Signal, reloads: ReloadRequests) {
    while hangup.recv().await.is_some() {
        // The outcome is logged.
        let _ = reloads.ask().await;
    }
}

/// Handles requests to reload until `until` completes.
async fn serve(
    gateway: &mut RunningGateway,
    load: Option<&ConfigOrigin>,
    mut asked: mpsc::Receiver<oneshot::Sender<Reloaded>>,
    until: impl Future<Output = ()>,
) {
    let mut until = pin!(until);
    loop {
        let tell = tokio::select! {
            () = &mut until => return,
            Some(tell) = asked.recv() => tell,
        };
        notify::reloading();
        let done = tokio::select! {
            () = &mut until => return,
            done = reload(gateway, load) => done,
        };
        match &done {
            Ok(applied) => {
                let changes: Vec<_> = applied.changes.iter().map(ToString::to_string).collect();
                tracing::info!(changes = changes.join("; "), "configuration reloaded");
                warn_of(&applied.warnings);
            }
            Err(refusal) => {
                tracing::error!(
                    reason = refusal.keyword(),
                    "configuration unchanged: {refusal}"
                );
            }
        }
        notify::ready(&gateway.current);
        // The requester may be gone.
        let _ = tell.send(done);
    }
}

/// Logs parts of the configuration without effect.
fn warn_of(warnings: &[Problem]) {
    for warning in warnings {
        let right = warning.right.as_deref().unwrap_or_default();
        tracing::warn!(key = warning.key, right, "configuration: {}", warning.what);
    }
}

async fn reload(gateway: &mut RunningGateway, load: Option<&ConfigOrigin>) -> Reloaded {
    match load {
        Some(load) => gateway.reload(load).await,
        None => Err(ReloadRefusal::NoFile),
    }
}

/// Shuts down: the declared actions, the last messages to the broker, and the end of the lines, which serve stops until
/// then. A second signal cuts the waits short.
async fn end(gateway: RunningGateway) -> LineThreads {
    notify::stopping();
    let alive = tokio::task::spawn_local(notify::keep_alive());
    let RunningGateway {
        mut lines,
        north,
        broker,
        journal,
        ..
    } = gateway;
    lines.begin_shutdown();
    let again = async {
        match told_to_end() {
            Ok(again) => again.await,
            // Without the handler no signal is received.
            Err(_) => std::future::pending().await,
        }
    };
    let mut again = pin!(again);
    let is_hurried = tokio::select! {
        () = lines.rested() => false,
        () = &mut again => true,
    };
    if is_hurried {
        tracing::warn!("second signal: no longer waiting for sent stops");
        lines.hurry();
        // The broker publishes the will when the connection breaks.
        lines.rested().await;
    } else {
        tokio::select! {
            () = north.farewell() => {}
            () = &mut again => lines.hurry(),
        }
    }
    lines.end_all().await;
    if let Some(journal) = &journal {
        journal.close(JOURNAL_MAX).await;
    }
    alive.abort();
    drop(broker);
    lines
}

/// The gateway's name: as configured, or the host's as far as it is valid in a topic.
fn name_of(config: &Config) -> Name {
    let host = || {
        let host = uname().nodename().to_string_lossy().into_owned();
        let fits = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        let text: String = host
            .chars()
            .filter(|c| fits(*c))
            .take(Name::MAX_CHARS)
            .collect();
        Name::new(&text)
    };
    config
        .gateway
        .name
        .clone()
        .or_else(host)
        .unwrap_or_else(Name::fallback)
}

/// The journal, if there is a data directory, and the remembered state of the drives.
fn begun_journal(
    config: &Config,
    sides: &NorthSides,
    changed: &Arc<BrokerBell>,
) -> io::Result<(Option<Arc<Journal>>, Memory)> {
    let Some(settings) = build::journal(config) else {
        return Ok((None, Memory::new()));
    };
    let (journal, memory) = Journal::start(&settings, sides.clone(), Arc::clone(changed))?;
    Ok((Some(journal), memory))
}
