//! Accepting connections, also when the system has no descriptors left.

use super::admission::ClientSeat;
use super::handshake::{AuthenticatedClient, shake};
use super::stream::ClientStream;
use super::{ModbusListener, ModbusServer, ProvenClient};
use rustix::io::Errno;
use rustix::net::sockopt;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::task::Poll;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::yield_now;
use tokio::time::sleep;

/// Wait after a connection could not be accepted and no place could be made.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);
/// Connections that are accepted before open connections have their turn.
const BATCH: u32 = 32;
/// Turns within which a closed connection frees its descriptor.
const CLOSING_TURNS: u32 = 4;
/// Probes of a silent client.
const PROBES: u32 = 3;

impl ModbusServer {
    /// Accepts connections that `listener` allows until the task is dropped.
    pub async fn listen(self: Rc<Self>, socket: TcpListener, listener: Rc<ModbusListener>) {
        self.spare.refill();
        let mut accepted = 0;
        loop {
            match socket.accept().await {
                Ok((stream, peer)) => self.admit(stream, peer, &listener),
                Err(error) if is_scarcity(&error) => self.squeeze(&socket, &listener, &error).await,
                // The client left while it waited.
                Err(error) if error.kind() == io::ErrorKind::ConnectionAborted => {}
                Err(error) => {
                    self.log
                        .say(&format!("cannot accept a connection: {error}"));
                    sleep(ACCEPT_PAUSE).await;
                }
            }
            accepted += 1;
            if accepted == BATCH {
                accepted = 0;
                yield_now().await;
            }
        }
    }

    /// Serves a client if it is allowed and there is a place.
    pub(super) fn admit(
        self: &Rc<Self>,
        stream: TcpStream,
        peer: SocketAddr,
        listener: &Rc<ModbusListener>,
    ) {
        if !listener.allows(peer.ip()) {
            self.refuse(peer, "not in `allow`");
        } else if let Some(seat) = self.seat(peer.ip(), listener) {
            tune(&stream, peer, listener.keep_alive());
            self.welcome(stream, peer, Rc::clone(listener), seat);
        } else {
            self.refuse(peer, "all connections are in use, and none may be closed");
        }
    }

    /// Serves a client, after authentication if its listener requires it.
    fn welcome(
        self: &Rc<Self>,
        stream: TcpStream,
        peer: SocketAddr,
        listener: Rc<ModbusListener>,
        seat: ClientSeat,
    ) {
        let (source, socket) = stream.into_split();
        let Some(security) = listener.security() else {
            return self.begin(
                source,
                ClientStream::Plain(socket),
                peer,
                None,
                listener,
                seat,
            );
        };
        let server = Rc::clone(self);
        let asker = seat.asker;
        let task = tokio::task::spawn_local(async move {
            let shaken = shake(source, socket, &security).await;
            server.handshakes.ended(asker);
            match shaken {
                Ok(AuthenticatedClient {
                    source,
                    stream,
                    certificate,
                }) => {
                    tracing::info!(%peer, name = %certificate.name, role = &*certificate.role, "secure connection");
                    let proven = Some(Box::new(ProvenClient {
                        certificate,
                        to: security,
                    }));
                    server.begin(
                        source,
                        ClientStream::Secured(Box::new(stream)),
                        peer,
                        proven,
                        listener,
                        seat,
                    );
                }
                Err(reason) => server.shake_failed(peer, &reason),
            }
        });
        if let Some(oldest) = self.handshakes.began(asker, peer, task.abort_handle()) {
            self.shake_failed(oldest, "too many handshakes at once");
        }
    }

    fn shake_failed(&self, peer: SocketAddr, reason: &str) {
        self.totals.handshake_failed();
        self.log
            .say(&format!("TLS handshake with {peer} failed: {reason}"));
    }

    /// Accepts the next client although the system has no descriptors left: with the spare one, and in place of the
    /// client that was silent longest. Waits until the spare one is available again, or for a moment.
    async fn squeeze(
        self: &Rc<Self>,
        socket: &TcpListener,
        listener: &Rc<ModbusListener>,
        error: &io::Error,
    ) {
        self.log.say(&format!(
            "cannot accept a connection; closing the client that was silent longest: {error}"
        ));
        if self.spare.release() {
            let accepted = poll_fn(|cx| match socket.poll_accept(cx) {
                Poll::Ready(accepted) => Poll::Ready(accepted.ok()),
                Poll::Pending => Poll::Ready(None),
            });
            if let Some((stream, peer)) = accepted.await {
                let is_let_in = !listener.allows(peer.ip())
                    || self.make_room()
                    || listener.has_priority(peer.ip());
                if is_let_in {
                    self.admit(stream, peer, listener);
                } else {
                    self.refuse(
                        peer,
                        "no file descriptors left, and no connection may be closed",
                    );
                }
            }
        } else {
            self.make_room();
        }
        for _ in 0..CLOSING_TURNS {
            yield_now().await;
            if self.spare.refill() {
                return;
            }
        }
        sleep(ACCEPT_PAUSE).await;
        self.spare.refill();
    }

    fn refuse(&self, peer: SocketAddr, why: &str) {
        self.totals.refused();
        self.log.say(&format!("refused {peer}: {why}"));
    }
}

/// Whether the system lacks what every connection needs.
fn is_scarcity(error: &io::Error) -> bool {
    let scarce = [Errno::MFILE, Errno::NFILE, Errno::NOBUFS, Errno::NOMEM];
    error
        .raw_os_error()
        .is_some_and(|code| scarce.iter().any(|errno| errno.raw_os_error() == code))
}

/// Small answers are sent at once, and a vanished client is noticed within twice `keep_alive` of its last packet, or of
/// the first byte that it did not acknowledge.
fn tune(stream: &TcpStream, peer: SocketAddr, keep_alive: Option<Duration>) {
    let set = || -> rustix::io::Result<()> {
        sockopt::set_tcp_nodelay(stream, true)?;
        let Some(idle) = keep_alive else {
            return Ok(());
        };
        let seconds = u32::try_from(idle.as_secs()).unwrap_or(u32::MAX);
        let every = (seconds / 4).max(1);
        let probes = seconds.clamp(1, PROBES);
        sockopt::set_socket_keepalive(stream, true)?;
        sockopt::set_tcp_keepidle(stream, idle)?;
        sockopt::set_tcp_keepintvl(stream, Duration::from_secs(every.into()))?;
        sockopt::set_tcp_keepcnt(stream, probes)?;
        sockopt::set_tcp_user_timeout(
            stream,
            seconds.saturating_add(every * probes).saturating_mul(1000),
        )
    };
    if let Err(error) = set() {
        tracing::debug!(%peer, %error, "cannot set socket options");
    }
}
