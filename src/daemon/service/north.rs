//! The north sides of a running gateway: its listeners and the tasks that serve them.

use crate::config::change::ConfigChange;
use crate::config::{BEHIND_A_BRIDGE, Config, ListenerSettings};
use crate::daemon::commissioning::ConfigSite;
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::reload_request::ReloadRequests;
use crate::daemon::exchange::router::{UniformUnits, UnitRouter};
use crate::daemon::exchange::shared::CurrentPlant;
use crate::daemon::exchange::totals::ModbusTotals;
use crate::daemon::host::clock;
use crate::daemon::host::descriptors;
use crate::daemon::host::secret_files;
use crate::daemon::host::stall::LastStalls;
use crate::daemon::http::report;
use crate::daemon::http::{
    self, ClientRequirements, HttpControl, HttpState, RouteDocuments, socket::OwnSocket,
};
use crate::daemon::journal::{self, Journal};
use crate::daemon::lines::build;
use crate::daemon::local::LocalSide;
use crate::daemon::modbus_rtu::SerialMaster;
use crate::daemon::modbus_server::{ListenerSecurity, ModbusListener, ModbusServer};
use crate::daemon::service::conversations::{BrokerConversations, BrokerSide};
use crate::daemon::service::start_error::StartError;
use crate::daemon::trends::KeptTrends;
use crate::domain::ids::Name;
use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::Arc;
use tokio::net::{TcpListener, TcpSocket, UnixStream};
use tokio::task::AbortHandle;

/// Connections that may wait to be accepted: most of a second of a burst of 5000 a second. The system may allow fewer
/// (`net.core.somaxconn`).
const BACKLOG: u32 = 4096;

/// Listeners that are bound but not served yet.
#[derive(Debug)]
pub struct BoundListeners {
    /// In the order of the configuration; `None` where the socket exists already.
    modbus: Vec<Option<TcpListener>>,
    /// The certificates of those with TLS, in the same order.
    security: Vec<Option<ListenerSecurity>>,
    http: Option<TcpListener>,
    /// What the HTTP listener requires of clients.
    front: ClientRequirements,
    /// Whether the address of the HTTP listener has changed, or the listener was removed.
    has_http_moved: bool,
    /// Whether anybody but a tool of this process is served.
    is_bound: bool,
}

impl BoundListeners {
    /// The bound addresses: Modbus TCP in the order of the configuration, and HTTP.
    ///
    /// # Errors
    /// The system cannot report an address.
    pub fn addresses(&self) -> io::Result<(Vec<SocketAddr>, Option<SocketAddr>)> {
        let modbus = self
            .modbus
            .iter()
            .flatten()
            .map(TcpListener::local_addr)
            .collect::<io::Result<_>>()?;
        Ok((
            modbus,
            self.http
                .as_ref()
                .map(TcpListener::local_addr)
                .transpose()?,
        ))
    }
}

/// Binds all addresses of `config`, or none, and reads the certificates of all its listeners. Listeners with a place in
/// `kept` are bound already, and HTTP if it has not moved.
///
/// # Errors
/// The first address that cannot be bound, or listener whose certificates cannot be used.
pub async fn bind(
    config: &Config,
    kept: &[Option<usize>],
    has_http_moved: bool,
) -> Result<BoundListeners, StartError> {
    secret_files::warn(config);
    warn_of_bridges(config);
    let mut modbus = Vec::with_capacity(config.listeners.len());
    for (place, listener) in config.listeners.iter().enumerate() {
        let is_kept = kept.get(place).is_some_and(Option::is_some);
        modbus.push(if is_kept {
            None
        } else {
            Some(listen(listener.listen, None)?)
        });
    }
    let http = match &config.http {
        Some(http) if has_http_moved => Some(listen(http.listen, Some(http::SEND_BUFFER_BYTES))?),
        _ => None,
    };
    Ok(BoundListeners {
        modbus,
        security: security(config).await?,
        http,
        front: front(config).await?,
        has_http_moved,
        is_bound: true,
    })
}

/// Binds no address of `config`: only a tool of this process is served.
#[must_use]
pub fn unbound(config: &Config) -> BoundListeners {
    let modbus = config.listeners.iter().map(|_| None).collect();
    let security = config.listeners.iter().map(|_| None).collect();
    BoundListeners {
        modbus,
        security,
        http: None,
        front: ClientRequirements::default(),
        has_http_moved: false,
        is_bound: false,
    }
}

/// Logs the warning that `check` gives about listeners behind a bridge.
fn warn_of_bridges(config: &Config) {
    for listener in &config.listeners {
        for network in listener.bridges() {
            tracing::warn!(address = %listener.listen, %network, "{BEHIND_A_BRIDGE}");
        }
    }
}

/// Certificates are read outside the runtime: their storage may be slow.
async fn security(config: &Config) -> Result<Vec<Option<ListenerSecurity>>, StartError> {
    let listeners = config.listeners.clone();
    let read = tokio::task::spawn_blocking(move || {
        let read = listeners.iter().map(|listener| {
            let Some(tls) = &listener.tls else {
                return Ok(None);
            };
            let address = listener.listen;
            ListenerSecurity::read(tls)
                .map(Some)
                .map_err(|what| StartError::ModbusTls { address, what })
        });
        read.collect()
    });
    read.await
        .unwrap_or_else(|error| Err(StartError::System(io::Error::other(error))))
}

/// Users and certificate of the HTTP listener, read outside the runtime: their storage may be slow.
async fn front(config: &Config) -> Result<ClientRequirements, StartError> {
    let Some(http) = config.http.clone() else {
        return Ok(ClientRequirements::default());
    };
    match tokio::task::spawn_blocking(move || ClientRequirements::read(&http)).await {
        Ok(read) => read.map_err(StartError::Http),
        Err(error) => Err(StartError::System(io::Error::other(error))),
    }
}

/// Connections inherit the size of the send buffer.
fn listen(address: SocketAddr, send_buffer_bytes: Option<u32>) -> Result<TcpListener, StartError> {
    let open = || {
        let socket = if address.is_ipv4() {
            TcpSocket::new_v4()?
        } else {
            TcpSocket::new_v6()?
        };
        // Connections of a gateway that has just exited do not block the address.
        socket.set_reuseaddr(true)?;
        send_buffer_bytes.map_or(Ok(()), |bytes| socket.set_send_buffer_size(bytes))?;
        socket.bind(address)?;
        socket.listen(BACKLOG)
    };
    open().map_err(|error| StartError::Listen { address, error })
}

/// Connections of a tool to the gateway in its own process. They are non-blocking.
pub type ToolConnections = tokio::sync::mpsc::Receiver<std::os::unix::net::UnixStream>;

/// Default limit of Modbus TCP connections, unless listeners request more: they cost some 28 MB.
const PLACES_USUAL: usize = 10_240;

/// The places for connections; logged if listeners request more than that.
fn places(config: &Config) -> usize {
    let wanted: usize = config
        .listeners
        .iter()
        .filter_map(|it| it.connections_max)
        .sum();
    let most = descriptors::room_for_connections().min(wanted.max(PLACES_USUAL));
    tracing::info!(most, "Modbus TCP connection limit");
    for listener in config
        .listeners
        .iter()
        .filter(|it| it.connections_max.is_some_and(|max| max > most))
    {
        let address = listener.listen;
        tracing::warn!(%address, most, "the limit of open files leaves room for fewer clients than `connections_max`");
    }
    most
}

/// The running north sides.
#[derive(Debug)]
pub struct RunningNorth {
    current: CurrentPlant,
    documents: RouteDocuments,
    server: Rc<ModbusServer>,
    units: UniformUnits,
    /// In the order of the configuration.
    listeners: Vec<ListeningServer>,
    serial: Vec<SerialMaster>,
    http: Option<AbortHandle>,
    control: Arc<HttpControl>,
    conversations: BrokerConversations,
}

/// A Modbus TCP listener, and the task that accepts its connections.
#[derive(Debug)]
struct ListeningServer {
    listener: Rc<ModbusListener>,
    task: AbortHandle,
}

/// The trends that are kept in the journal's directory; `None` if the system refuses a thread.
fn trends_beside(journal: &Journal) -> Option<Arc<KeptTrends>> {
    let started = KeptTrends::start(journal.file().parent()?);
    started
        .inspect_err(|error| tracing::warn!(%error, "trends cannot be kept"))
        .ok()
}

impl RunningNorth {
    /// Starts everything on the current [`LocalSet`](tokio::task::LocalSet); it ends with that.
    pub fn start(
        config: &Config,
        (name, site): (&Name, Option<ConfigSite>),
        current: CurrentPlant,
        (sides, journal): (NorthSides, Option<Arc<Journal>>),
        bound: BoundListeners,
        socket: Option<(OwnSocket, Option<ReloadRequests>)>,
        broker_side: Option<BrokerSide>,
    ) -> Self {
        let modbus_totals = Arc::new(ModbusTotals::default());
        let started = clock::moment();
        let state = Arc::new(HttpState {
            gateway: name.to_string(),
            shared: current.clone(),
            modbus: Arc::clone(&modbus_totals),
            mqtt: None.into(),
            sparkplug: None.into(),
            journal: journal.clone(),
            trends: journal.as_ref().and_then(|journal| trends_beside(journal)),
            configuration: site.as_ref().map(|site| site.file.clone()),
            socket: socket.as_ref().map(|(socket, _)| socket.reachable()),
            started: started.mono,
            started_at: started.wall,
        });
        let documents = RouteDocuments::new(Arc::clone(&state));
        tokio::task::spawn_local(report::remember(Arc::clone(&documents.history)));
        tokio::task::spawn_local(http::live::run(Arc::clone(&documents.live)));
        let (socket, reloads) =
            socket.map_or((None, None), |(socket, reloads)| (Some(socket), reloads));
        let stalls = Arc::<LastStalls>::default();
        tokio::task::spawn_local(Arc::clone(&stalls).watch());
        let side = LocalSide::new(current.clone(), reloads).with_stalls(Arc::clone(&stalls));
        let side = Arc::new(side.keeping(journal::side(journal.as_ref(), &current)));
        tokio::task::spawn_local(Arc::clone(&side).distribute(Arc::clone(&sides.local)));
        if let Some(socket) = socket {
            tokio::task::spawn_local(socket.serve(documents.clone(), Arc::clone(&side)));
        }
        let control = Arc::new(HttpControl::new(
            side,
            documents.live.moments().clone(),
            ClientRequirements::default(),
            site,
        ));
        let server = ModbusServer::new(modbus_totals, journal::side(journal.as_ref(), &current));
        let server = Rc::new(server.with_slots(places(config)).with_stalls(stalls));
        tokio::task::spawn_local(Rc::clone(&server).distribute(Arc::clone(&sides.modbus)));
        let units = UniformUnits::new(&current.get());
        let listeners = Vec::new();
        let serial = Vec::new();
        let conversations = BrokerConversations::new(current.clone(), sides, journal, state);
        let mut north = Self {
            current,
            documents,
            server,
            units,
            listeners,
            serial,
            http: None,
            control,
            conversations,
        };
        let is_bound = bound.is_bound;
        north.listen(config, &[], bound);
        if is_bound {
            north.serve_masters(config);
        }
        north.conversations.talk_as(broker_side);
        north
    }

    /// Serves the connections of a tool of this process, with what the first listener of `config` grants to this host.
    pub fn serve_tool(&self, config: &Config, mut connections: ToolConnections) {
        let Some(settings) = config.listeners.first() else {
            return;
        };
        let listener = ModbusListener::new(
            settings.clone(),
            UnitRouter::new(settings, self.units.clone()),
            None,
        );
        let server = Rc::clone(&self.server);
        tokio::task::spawn_local(async move {
            while let Some(stream) = connections.recv().await {
                match UnixStream::from_std(stream) {
                    Ok(stream) => server.serve_tool(stream, &listener),
                    Err(error) => tracing::error!(%error, "cannot serve the tool"),
                }
            }
        });
    }

    /// Serves `config` from now on; the shared state is switched already. Sockets and connections that continue are not
    /// touched.
    pub fn switch(
        &mut self,
        config: &Config,
        change: &ConfigChange,
        bound: BoundListeners,
        broker_side: Option<BrokerSide>,
    ) {
        self.units = self.units.changed_to(&self.current.get());
        self.listen(config, &change.listeners, bound);
        self.serve_masters(config);
        self.server.review();
        self.conversations.talk_as(broker_side);
    }

    fn listen(&mut self, config: &Config, kept: &[Option<usize>], bound: BoundListeners) {
        let mut old: Vec<_> = std::mem::take(&mut self.listeners)
            .into_iter()
            .map(Some)
            .collect();
        let sockets = bound.modbus.into_iter().zip(bound.security);
        for (place, (settings, (socket, security))) in
            config.listeners.iter().zip(sockets).enumerate()
        {
            let kept = kept
                .get(place)
                .copied()
                .flatten()
                .and_then(|at| old.get_mut(at)?.take());
            self.listeners
                .extend(self.listening(settings, socket, security, kept));
        }
        for gone in old.into_iter().flatten() {
            gone.task.abort();
            gone.listener.close();
        }
        self.control.change(bound.front);
        if bound.has_http_moved {
            self.http.take().inspect(AbortHandle::abort);
            let serve = |listener| {
                tokio::task::spawn_local(http::serve(
                    listener,
                    self.documents.clone(),
                    Arc::clone(&self.control),
                ))
            };
            self.http = bound.http.map(serve).map(|task| task.abort_handle());
        }
    }

    /// Serves the serial masters of `config` from now on. A port whose settings stay is not closed.
    fn serve_masters(&mut self, config: &Config) {
        let mut old = std::mem::take(&mut self.serial);
        let mut to_start = Vec::new();
        for settings in &config.serial_masters {
            let router = UnitRouter::new(&settings.serving, self.units.clone());
            let Some(at) = old.iter().position(|it| it.settings.has_port_of(settings)) else {
                to_start.push((
                    settings,
                    ModbusListener::of_master(settings.name, settings.serving.clone(), router),
                ));
                continue;
            };
            let mut kept = old.swap_remove(at);
            kept.listener()
                .change(settings.serving.clone(), router, None);
            kept.changed(settings.clone());
            self.serial.push(kept);
        }
        // Before others begin: they may use the same ports.
        drop(old);
        for (settings, listener) in to_start {
            let dirs = build::lock_dirs(config.gateway.data_dir.as_deref());
            match SerialMaster::start(settings.clone(), listener, &self.server, dirs) {
                Ok(started) => self.serial.push(started),
                Err(error) => {
                    tracing::error!(master = %settings.name, %error, "cannot serve a serial master")
                }
            }
        }
    }

    fn listening(
        &self,
        settings: &ListenerSettings,
        socket: Option<TcpListener>,
        security: Option<ListenerSecurity>,
        kept: Option<ListeningServer>,
    ) -> Option<ListeningServer> {
        let router = UnitRouter::new(settings, self.units.clone());
        if let Some(kept) = kept {
            kept.listener.change(settings.clone(), router, security);
            return Some(kept);
        }
        let listener = ModbusListener::new(settings.clone(), router, security);
        self.server.totals().reads().show(listener.reads());
        let serve = Rc::clone(&self.server).listen(socket?, Rc::clone(&listener));
        Some(ListeningServer {
            listener,
            task: tokio::task::spawn_local(serve).abort_handle(),
        })
    }

    /// Whether these are the settings of the present conversations.
    #[must_use]
    pub fn talks_as(&self, broker_side: Option<&BrokerSide>) -> bool {
        self.conversations.talks_as(broker_side)
    }

    /// Ends the conversations with the broker, if there are any, and waits a moment for that.
    pub async fn farewell(self) {
        self.conversations.farewell().await;
    }
}
