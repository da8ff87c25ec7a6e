//! The embedded broker, for the demo and for trials: MQTT 3.1.1 and 5, in memory, anonymous, on loopback only.
//!
//! [`machine`] is everything except sockets and clocks: packets and time in, bytes out. It has its own `decode` and
//! `encode`: the client library reads what brokers send, but refuses valid packets of clients (a DISCONNECT of MQTT 5
//! without a reason) and accepts invalid ones. [`connection`] is a task for each client.

mod client_queue;
mod connection;
mod decode;
mod encode;
mod limits;
mod machine;
mod packet;
mod properties;
mod reader;
mod retained;
mod routing;
mod session;
mod sessions;
mod topic;
mod tree;

#[cfg(test)]
mod tests;

use connection::SharedMachine;
use limits::CONNECTIONS_MAX;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::MissedTickBehavior;

/// How often the machine gets a tick.
const BEAT: Duration = Duration::from_millis(250);
/// Wait after a connection could not be accepted because no descriptors are left.
const PAUSE: Duration = Duration::from_millis(100);

/// Why there is no broker.
#[derive(Debug, thiserror::Error)]
pub enum BrokerError {
    /// The address can be reached from elsewhere.
    #[error(
        "{0} is not a loopback address; this broker asks for no password and listens on this machine only"
    )]
    NotLoopback(SocketAddr),
    /// The address cannot be taken.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// The requested address.
        address: SocketAddr,
        /// The system's reason.
        error: io::Error,
    },
}

/// A listening broker.
pub struct ListeningBroker {
    listener: TcpListener,
    address: SocketAddr,
    shared: Arc<SharedMachine>,
}

/// Begins to listen. Must be called on a runtime.
///
/// # Errors
/// [`BrokerError`].
pub async fn listen(address: SocketAddr) -> Result<ListeningBroker, BrokerError> {
    if !address.ip().is_loopback() {
        return Err(BrokerError::NotLoopback(address));
    }
    let refused = |error: io::Error| BrokerError::Listen { address, error };
    let listener = TcpListener::bind(address).await.map_err(refused)?;
    let address = listener.local_addr().map_err(refused)?;
    Ok(ListeningBroker {
        listener,
        address,
        shared: SharedMachine::new(),
    })
}

impl ListeningBroker {
    /// The address on which it actually listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until it is dropped.
    pub async fn serve(self) {
        let mut clients = JoinSet::new();
        let mut beat = tokio::time::interval(BEAT);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                accepted = self.listener.accept() => match accepted {
                    Ok((stream, peer)) => self.welcome(&mut clients, stream, peer),
                    Err(error) => {
                        tracing::warn!(%error, "cannot accept a client");
                        tokio::time::sleep(PAUSE).await;
                    }
                },
                _ = beat.tick() => self.shared.tick(),
                Some(ended) = clients.join_next() => if let Err(error) = ended {
                    tracing::error!(%error, "client connection task failed");
                },
            }
        }
    }

    fn welcome(&self, clients: &mut JoinSet<()>, stream: TcpStream, peer: SocketAddr) {
        match self.shared.open() {
            Some(place) => drop(clients.spawn(connection::serve(stream, peer, place))),
            None => {
                tracing::warn!(%peer, max = CONNECTIONS_MAX, "connection limit reached; closed a new connection")
            }
        }
    }
}
