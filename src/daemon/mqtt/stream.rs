//! The stream to the broker: TCP, and TLS over it.

use super::incident::{BrokenConnection, EndCause};
use super::reason;
use rustls::ClientConfig;
use rustls::pki_types::ServerName;
use std::io::{Error, ErrorKind};
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpSocket, TcpStream, lookup_host};
use tokio_rustls::TlsConnector;

/// Bytes in both directions.
pub trait BrokerStream: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> BrokerStream for T {}

/// The address of the broker, and how it is authenticated.
#[derive(Debug)]
pub struct BrokerTarget {
    pub host: String,
    pub port: u16,
    /// `None` for plain TCP.
    pub tls: Option<Arc<ClientConfig>>,
}

/// Connects. The caller limits the time.
pub async fn connect(target: &BrokerTarget) -> Result<Box<dyn BrokerStream>, BrokenConnection> {
    let tcp = connect_tcp(target).await.map_err(|error| of_tcp(&error))?;
    let Some(config) = &target.tls else {
        return Ok(Box::new(tcp));
    };
    let name = ServerName::try_from(target.host.clone()).map_err(|_| {
        of_tls("TLS: the broker's name is neither a DNS name nor an address".to_owned())
    })?;
    match TlsConnector::from(Arc::clone(config))
        .connect(name, tcp)
        .await
    {
        Ok(stream) => Ok(Box::new(stream)),
        Err(error) => Err(of_tls(
            reason::of_io(&error).unwrap_or_else(|| format!("TLS: {error}")),
        )),
    }
}

/// Tries each address of the name in turn.
async fn connect_tcp(target: &BrokerTarget) -> Result<TcpStream, Error> {
    let mut last = Error::new(ErrorKind::InvalidInput, "could not resolve to any address");
    for address in lookup_host(format!("{}:{}", target.host, target.port)).await? {
        let socket = match address {
            SocketAddr::V4(_) => TcpSocket::new_v4()?,
            SocketAddr::V6(_) => TcpSocket::new_v6()?,
        };
        socket.set_nodelay(true)?;
        match socket.connect(address).await {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn of_tcp(error: &Error) -> BrokenConnection {
    // An established connection is reset or closed; only an attempt can be refused.
    let is_unsent = error.kind() == ErrorKind::ConnectionRefused;
    BrokenConnection {
        reason: error.to_string(),
        is_fresh: false,
        cause: EndCause::Gone,
        is_unsent,
    }
}

/// A failure before CONNECT, which follows the handshake.
const fn of_tls(reason: String) -> BrokenConnection {
    BrokenConnection {
        reason,
        is_fresh: true,
        cause: EndCause::Other,
        is_unsent: true,
    }
}
