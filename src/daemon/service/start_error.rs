//! Why the gateway could not start.

use crate::daemon::host::own_lock::AlreadyRunning;
use std::io;
use std::net::SocketAddr;

/// Why the daemon could not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// A listener's address could not be bound.
    #[error("cannot listen on {address}: {error}{}", listen_hint(error))]
    Listen {
        /// The address as configured.
        address: SocketAddr,
        /// The system's reason.
        error: io::Error,
    },
    /// The certificates of a listener cannot be used.
    #[error("modbus_tcp {address}: {what}")]
    ModbusTls {
        /// The listener, as configured.
        address: SocketAddr,
        /// Everything that is wrong with its files.
        what: String,
    },
    /// The users or the certificate of the HTTP listener cannot be used.
    #[error("http: {0}")]
    Http(String),
    /// Another gateway runs on the same data directory.
    #[error(transparent)]
    AlreadyRunning(#[from] AlreadyRunning),
    /// The embedded broker does not start.
    #[error("the embedded broker does not start: {0}")]
    Broker(io::Error),
    /// A password or a certificate cannot be used.
    #[error("mqtt: {0}")]
    Mqtt(String),
    /// A thread, a runtime or a signal handler was refused.
    #[error("the system refuses a resource that the daemon needs: {0}")]
    System(#[from] io::Error),
}

/// What to do about a refused address.
fn listen_hint(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrInUse => {
            "; another program uses this port (`ss -ltnp` shows which): end it, or set another `listen`"
        }
        io::ErrorKind::AddrNotAvailable => {
            "; this host has no such address (`ip address` shows those that it has)"
        }
        io::ErrorKind::PermissionDenied => {
            "; ports below 1024 need the right CAP_NET_BIND_SERVICE: set another `listen`, such as port 1502"
        }
        _ => "",
    }
}
