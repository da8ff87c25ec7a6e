//! A broker inside this process, for the demo and for trying out: MQTT 3.1.1 and 5, in memory, anonymous, on
//! loopback only.

use async_trait::async_trait;
use rmqtt::context::ServerContext;
use rmqtt::net::Builder;
use rmqtt::retain::{DefaultRetainStorage, RetainStorage};
use rmqtt::server::MqttServer;
use rmqtt::types::{Retain, TopicFilter, TopicName};
use std::io;
use std::net::SocketAddr;
use std::num::NonZeroU16;
use std::sync::Arc;
use std::time::Duration;

/// Retained messages at most. A message for another topic is then delivered, but not kept.
const RETAINED_MAX: isize = 100_000;
/// Longest packet. More than the gateway takes, so that its own limits can be tried.
const PACKET_MAX: u32 = 1024 * 1024;
/// Connections at once.
const CONNECTIONS_MAX: usize = 1000;
/// Messages that wait for one client.
const WAITING_MAX: usize = 10_000;
/// Messages to one client that wait for its acknowledgement.
const INFLIGHT_MAX: NonZeroU16 = NonZeroU16::MIN.saturating_add(63);
/// How often expired messages are looked for.
const SWEEP: Duration = Duration::from_secs(10);

/// Why there is no broker.
#[derive(Debug, thiserror::Error)]
pub enum BrokerError {
    /// The address can be reached from elsewhere.
    #[error("{0} is not a loopback address; this broker asks nobody for a password and stays on this machine")]
    NotLoopback(SocketAddr),
    /// The address cannot be taken.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// As asked for.
        address: SocketAddr,
        /// The system's reason.
        error: io::Error,
    },
}

/// A broker that listens.
pub struct Listening {
    server: MqttServer,
    address: SocketAddr,
}

/// Begins to listen. It is called on a runtime.
///
/// # Errors
/// [`BrokerError`].
pub async fn listen(address: SocketAddr) -> Result<Listening, BrokerError> {
    if !address.ip().is_loopback() {
        return Err(BrokerError::NotLoopback(address));
    }
    // It would refuse connections while the processor is busy with other things.
    let context = ServerContext::new().busy_check_enable(false).task_exec_workers(64).build().await;
    let retained = Retained(Arc::new(DefaultRetainStorage::new()));
    tokio::spawn(sweep(Arc::clone(&retained.0)));
    *context.extends.retain_mut().await = Box::new(retained);
    let refused = |error: rmqtt::Error| BrokerError::Listen { address, error: io_error(error) };
    let listener = Builder::new()
        .name("broker")
        .laddr(address)
        .reuseaddr(Some(true))
        .nodelay(true)
        .max_connections(CONNECTIONS_MAX)
        .max_packet_size(PACKET_MAX)
        .max_mqueue_len(WAITING_MAX)
        .max_inflight(INFLIGHT_MAX)
        // Otherwise every message, also a retained one, would expire after five minutes.
        .message_expiry_interval(Duration::ZERO)
        // No repeats while a connection lives, as MQTT 5 wants it.
        .message_retry_interval(Duration::ZERO)
        .bind()
        .map_err(refused)?;
    let address = listener.local_addr().map_err(refused)?;
    let listener = listener.tcp().map_err(refused)?;
    let server = MqttServer::new(context).listener_by_id(listener, 1).build();
    Ok(Listening { server, address })
}

impl Listening {
    /// Where it really listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until it is dropped.
    pub async fn serve(self) {
        if let Err(error) = self.server.run().await {
            tracing::error!(%error, "the broker ended");
        }
    }
}

async fn sweep(retained: Arc<DefaultRetainStorage>) {
    loop {
        tokio::time::sleep(SWEEP).await;
        retained.remove_expired_messages().await;
    }
}

fn io_error(error: rmqtt::Error) -> io::Error {
    error.downcast::<io::Error>().unwrap_or_else(io::Error::other)
}

/// The library's own store of retained messages; without this around it, it keeps none.
struct Retained(Arc<DefaultRetainStorage>);

#[async_trait]
impl RetainStorage for Retained {
    fn enable(&self) -> bool {
        true
    }

    async fn set(&self, topic: &TopicName, retain: Retain, expiry: Option<Duration>) -> rmqtt::Result<()> {
        let clears = retain.publish.payload.is_empty();
        if !clears && self.0.count().await >= RETAINED_MAX {
            tracing::warn!("too many retained messages; one is not kept");
            return Ok(());
        }
        self.0.set_with_timeout(topic, retain, expiry.filter(|span| !span.is_zero())).await
    }

    async fn get(&self, filter: &TopicFilter) -> rmqtt::Result<Vec<(TopicName, Retain)>> {
        self.0.get_message(filter).await
    }

    async fn count(&self) -> isize {
        self.0.count().await
    }

    async fn max(&self) -> isize {
        self.0.max().await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn it_stays_on_this_machine() {
        let refused = listen("0.0.0.0:0".parse().unwrap()).await;
        assert!(matches!(refused, Err(BrokerError::NotLoopback(_))));
    }

    #[tokio::test]
    async fn a_taken_port_is_named() {
        let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = taken.local_addr().unwrap();
        let Err(refused) = listen(address).await else { panic!("it listens on a taken port") };
        assert!(refused.to_string().contains(&address.to_string()), "{refused}");
        assert!(matches!(refused, BrokerError::Listen { error, .. } if error.kind() == io::ErrorKind::AddrInUse));
    }
}
