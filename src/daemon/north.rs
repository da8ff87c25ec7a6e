//! The north sides of a running gateway: what listens, and who serves it.

use super::answers::{AnswerBox, NorthSides};
use super::clock;
use super::http::{self, State, socket::OwnSocket};
use super::local::LocalSide;
use super::modbus_server::Server;
use super::mqtt::speaker::Speaker;
use super::mqtt::{self, ConnectionSettings, Counters};
use super::router::{Router, Units};
use super::run::StartError;
use super::shared::Shared;
use super::totals::{ModbusTotals, MqttTotals};
use crate::config::Config;
use crate::domain::ids::Name;
use crate::north::mqtt::Settings;
use std::cell::RefCell;
use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// Most time for the last words to the broker.
const FAREWELL_MAX: Duration = Duration::from_secs(2);

/// What listens before anybody is served.
#[derive(Debug)]
pub struct Bound {
    modbus: Vec<TcpListener>,
    http: Option<TcpListener>,
}

impl Bound {
    /// The addresses that were really taken: Modbus TCP in the order of the configuration, and HTTP.
    ///
    /// # Errors
    /// The system's refusal to tell.
    pub fn addresses(&self) -> io::Result<(Vec<SocketAddr>, Option<SocketAddr>)> {
        let modbus = self.modbus.iter().map(TcpListener::local_addr).collect::<io::Result<_>>()?;
        Ok((modbus, self.http.as_ref().map(TcpListener::local_addr).transpose()?))
    }
}

/// Takes all addresses of `config`, or none.
///
/// # Errors
/// The first one that cannot be taken.
pub async fn bind(config: &Config) -> Result<Bound, StartError> {
    let mut modbus = Vec::with_capacity(config.listeners.len());
    for listener in &config.listeners {
        modbus.push(listen(listener.listen).await?);
    }
    let http = match &config.http {
        Some(http) => Some(listen(http.listen).await?),
        None => None,
    };
    Ok(Bound { modbus, http })
}

async fn listen(address: SocketAddr) -> Result<TcpListener, StartError> {
    TcpListener::bind(address).await.map_err(|error| StartError::Listen { address, error })
}

/// How the broker is reached and what is said there.
pub type Mqtt = (ConnectionSettings, Settings);

/// The running north sides.
#[derive(Debug)]
pub struct North {
    mqtt: Option<(oneshot::Sender<()>, JoinHandle<()>)>,
}

impl North {
    /// Starts everything on the present [`LocalSet`](tokio::task::LocalSet); it ends with that.
    pub fn start(
        config: &Config,
        name: &Name,
        shared: &Arc<Shared>,
        sides: NorthSides,
        bound: Bound,
        socket: Option<OwnSocket>,
        mqtt: Option<Mqtt>,
    ) -> Self {
        let modbus_totals = Arc::new(ModbusTotals::default());
        let mqtt_totals = mqtt.is_some().then(Arc::<MqttTotals>::default);
        let state = Arc::new(State {
            gateway: name.to_string(),
            shared: Arc::clone(shared),
            modbus: Arc::clone(&modbus_totals),
            mqtt: mqtt_totals.clone(),
            journal: sides.journal.clone(),
            started: clock::now(),
            started_at: clock::wall(),
        });
        if let Some(listener) = bound.http {
            tokio::task::spawn_local(http::serve(listener, Arc::clone(&state)));
        }
        if let Some(socket) = socket {
            let side = Arc::new(LocalSide::new(Arc::clone(shared)));
            tokio::task::spawn_local(Arc::clone(&side).distribute(sides.local));
            tokio::task::spawn_local(socket.serve(state, side));
        }
        serve_modbus(config, bound.modbus, shared, sides.modbus, modbus_totals);
        let mqtt = mqtt.zip(mqtt_totals).zip(sides.mqtt).map(|(((connection, settings), totals), news)| {
            let at = mqtt::moment();
            let speaker = Speaker::new(settings, Arc::clone(shared), news, totals, at);
            let (stop, stopped) = oneshot::channel();
            (stop, tokio::task::spawn_local(speak(connection, speaker, Arc::clone(shared), stopped)))
        });
        Self { mqtt }
    }

    /// Says goodbye to the broker, if there is one, and waits for that for a moment.
    pub async fn farewell(self) {
        let Some((stop, task)) = self.mqtt else { return };
        // A task that has ended needs no stop.
        let _ = stop.send(());
        if tokio::time::timeout(FAREWELL_MAX, task).await.is_err() {
            tracing::warn!("the broker did not take the last words");
        }
    }
}

fn serve_modbus(
    config: &Config,
    listeners: Vec<TcpListener>,
    shared: &Arc<Shared>,
    news: Arc<AnswerBox>,
    totals: Arc<ModbusTotals>,
) {
    let units = Units::new(shared);
    let server = Rc::new(Server::new(totals));
    for (listener, settings) in listeners.into_iter().zip(&config.listeners) {
        let router = Rc::new(Router::new(settings, units.clone()));
        tokio::task::spawn_local(Rc::clone(&server).listen(listener, settings.clone(), router));
    }
    tokio::task::spawn_local(server.distribute(news));
}

async fn speak(connection: ConnectionSettings, speaker: Speaker, shared: Arc<Shared>, stopped: oneshot::Receiver<()>) {
    let (speaker, counters) = (RefCell::new(speaker), Counters::default());
    let stop = async {
        // A dropped sender means the end as well.
        let _ = stopped.await;
    };
    mqtt::converse(connection, &speaker, &shared.changed, &counters, stop).await;
}
