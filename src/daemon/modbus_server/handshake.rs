//! TLS handshakes: concurrent with accepting, bounded in number and time.

use super::certificate::CertifiedClient;
use super::receive;
use super::security::ListenerSecurity;
use super::stream::{READ_BYTES, SecuredStream};
use crate::domain::ids::AskerId;
use rustls::{CertificateError, Error};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::io;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::task::AbortHandle;

/// Most time for a handshake.
pub(super) const HANDSHAKE_MAX: Duration = Duration::from_secs(5);
/// Most handshakes at once over all listeners. One more aborts the oldest: a stalled one holds up no one.
pub(super) const HANDSHAKES_MAX: usize = 64;

/// A client that has authenticated itself.
pub(super) struct AuthenticatedClient {
    pub source: OwnedReadHalf,
    pub stream: SecuredStream,
    pub certificate: CertifiedClient,
}

/// Performs the handshake of a connection.
///
/// # Errors
/// Why it failed, as text.
pub(super) async fn shake(
    mut source: OwnedReadHalf,
    socket: OwnedWriteHalf,
    security: &ListenerSecurity,
) -> Result<AuthenticatedClient, String> {
    let session = security.session().map_err(|error| error.to_string())?;
    let stream = SecuredStream::new(socket, session);
    match tokio::time::timeout(HANDSHAKE_MAX, finish(&mut source, &stream)).await {
        Ok(done) => done.map_err(|error| reason(&error))?,
        Err(_) => {
            return Err(format!(
                "it did not finish within {} s",
                HANDSHAKE_MAX.as_secs()
            ));
        }
    }
    let certificate = stream.with_certificate(CertifiedClient::read);
    let certificate = certificate
        .ok_or("the client presented no certificate")?
        .map_err(|error| error.to_string())?;
    Ok(AuthenticatedClient {
        source,
        stream,
        certificate,
    })
}

async fn finish(source: &mut OwnedReadHalf, stream: &SecuredStream) -> io::Result<()> {
    let mut buffer = [0; READ_BYTES];
    while !stream.is_ready() {
        tokio::select! {
            read = receive(source, &mut buffer) => match read? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                read => stream.shake(buffer.get(..read).unwrap_or_default())?,
            },
            ready = stream.writable(), if stream.wants_write() => {
                ready?;
                stream.shake(&[])?;
            }
        }
    }
    Ok(())
}

/// Why a handshake failed, as text.
fn reason(error: &io::Error) -> String {
    let tls = error
        .get_ref()
        .and_then(|inner| inner.downcast_ref::<Error>());
    let Some(tls) = tls else {
        return match error.kind() {
            io::ErrorKind::UnexpectedEof => "the client left before the end".to_owned(),
            _ => error.to_string(),
        };
    };
    let text = match tls {
        Error::NoCertificatesPresented => "the client presented no certificate",
        Error::InvalidCertificate(wrong) => return certificate_reason(wrong),
        Error::InvalidMessage(_) => "the client does not speak TLS",
        Error::AlertReceived(alert) => return format!("the client refuses: {alert:?}"),
        Error::PeerIncompatible(lacks) => {
            return format!(
                "the client has no version or cipher in common with the gateway: {lacks:?}"
            );
        }
        other => return other.to_string(),
    };
    text.to_owned()
}

fn certificate_reason(wrong: &CertificateError) -> String {
    let text = match wrong {
        // An authority of the same name with another key causes the second.
        CertificateError::UnknownIssuer | CertificateError::BadSignature => {
            "its certificate is not signed by an authority in `client_ca_file`"
        }
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => {
            "its certificate has expired"
        }
        CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
            "its certificate is not valid yet; compare the clocks"
        }
        CertificateError::InvalidPurpose | CertificateError::InvalidPurposeContext { .. } => {
            "its certificate is not for clients (extended key usage)"
        }
        CertificateError::Other(other)
            if format!("{other:?}").contains("UnsupportedCriticalExtension") =>
        {
            "its certificate has an unknown critical extension; the role extension must not be critical"
        }
        CertificateError::Other(other) => return other.to_string(),
        other => return format!("its certificate is refused: {other}"),
    };
    text.to_owned()
}

/// The handshakes that are under way.
#[derive(Debug, Default)]
pub(super) struct PendingHandshakes {
    under_way: RefCell<VecDeque<UnderWay>>,
}

#[derive(Debug)]
struct UnderWay {
    asker: AskerId,
    peer: SocketAddr,
    task: AbortHandle,
}

impl PendingHandshakes {
    /// The number of handshakes under way.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.under_way.borrow().len()
    }

    /// Registers a handshake. If there are too many, the oldest is aborted and its peer returned.
    pub fn began(&self, asker: AskerId, peer: SocketAddr, task: AbortHandle) -> Option<SocketAddr> {
        let mut under_way = self.under_way.borrow_mut();
        let is_full = under_way.len() >= HANDSHAKES_MAX;
        let oldest = if is_full { under_way.pop_front() } else { None };
        under_way.push_back(UnderWay { asker, peer, task });
        oldest.map(|oldest| {
            oldest.task.abort();
            oldest.peer
        })
    }

    /// Removes a finished handshake.
    pub fn ended(&self, asker: AskerId) {
        self.under_way.borrow_mut().retain(|it| it.asker != asker);
    }

    /// Aborts the handshake of this client. Returns whether there is one.
    pub fn dismiss(&self, asker: AskerId) -> bool {
        let mut under_way = self.under_way.borrow_mut();
        let place = under_way.iter().position(|it| it.asker == asker);
        place
            .and_then(|place| under_way.remove(place))
            .inspect(|it| it.task.abort())
            .is_some()
    }
}
