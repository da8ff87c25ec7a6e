//! The port of a line that is a connection: to a serial device server, which passes bytes between its line and the
//! connection, or to a Modbus TCP server.

use super::OpenError;
use crate::config::ready::TCP_LATENESS;
use crate::daemon::host::sys;
use rustix::net::sockopt;
use std::io::{self, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::unix::AsyncFd;
use tokio::task::JoinHandle;

/// Longest wait for the addresses of a name. A lookup that takes longer continues, and its result is used next time.
const LOOKUP_WITHIN: Duration = Duration::from_secs(2);
/// Longest wait for a connection to one address: long enough for a lost first packet, which is repeated after 1 s.
const CONNECT_WITHIN: Duration = Duration::from_secs(2);
/// Most addresses of one name that are tried.
const ADDRESSES_MAX: usize = 4;
/// An idle connection is probed after this time, and at this interval.
const KEEP_ALIVE: Duration = Duration::from_secs(2);
/// Probes without an answer after which the peer is gone.
const KEEP_ALIVE_PROBES: u32 = 3;

/// An open connection.
#[derive(Debug)]
pub struct TcpPort {
    stream: AsyncFd<TcpStream>,
}

/// A lookup of the addresses of a name. The system's lookup blocks for longer than the line thread may, so it runs on
/// another thread: one at a time, however often the port is tried.
#[derive(Debug, Default)]
pub(super) struct AddressLookup {
    running: Option<JoinHandle<io::Result<Vec<SocketAddr>>>>,
}

impl TcpPort {
    /// Connects to `host`. Bytes that the peer received on its line before are not requested.
    pub(super) async fn open(
        host: &str,
        port: u16,
        lookup: &mut AddressLookup,
    ) -> Result<Self, OpenError> {
        let mut why = OpenError::NoConnection(format!("the name {host} has no address"));
        for address in lookup.addresses(host, port).await? {
            match tokio::time::timeout(CONNECT_WITHIN, tokio::net::TcpStream::connect(address))
                .await
            {
                Ok(Ok(stream)) => return Ok(Self::new(stream.into_std()?)?),
                Ok(Err(error)) => why = OpenError::NoConnection(format!("{address}: {error}")),
                Err(_) => {
                    let within = CONNECT_WITHIN.as_secs();
                    why = OpenError::NoConnection(format!(
                        "{address} does not answer within {within} s"
                    ));
                }
            }
        }
        Err(why)
    }

    fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        // A vanished peer is noticed by missing acknowledgements, and by probes while nothing is sent.
        let patience_ms = u32::try_from(TCP_LATENESS.as_millis()).unwrap_or(u32::MAX);
        sockopt::set_tcp_user_timeout(&stream, patience_ms)?;
        sockopt::set_socket_keepalive(&stream, true)?;
        sockopt::set_tcp_keepidle(&stream, KEEP_ALIVE)?;
        sockopt::set_tcp_keepintvl(&stream, KEEP_ALIVE)?;
        sockopt::set_tcp_keepcnt(&stream, KEEP_ALIVE_PROBES)?;
        // Bytes still under way when the port is given up must not reach the line later.
        sockopt::set_socket_linger(&stream, Some(Duration::ZERO))?;
        Ok(Self {
            stream: sys::readable(stream)?,
        })
    }

    pub(super) fn poll_readable(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(self.stream.poll_read_ready_mut(cx))?.clear_ready();
        Poll::Ready(Ok(()))
    }

    pub(super) fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.stream.get_mut().read(buffer)
    }

    pub(super) fn write(&mut self, frame: &[u8]) -> io::Result<usize> {
        self.stream.get_mut().write(frame)
    }
}

impl AddressLookup {
    async fn addresses(&mut self, host: &str, port: u16) -> Result<Vec<SocketAddr>, OpenError> {
        if let Ok(ip) = host.parse::<IpAddr>() {
            return Ok(vec![SocketAddr::new(ip, port)]);
        }
        let name = host.to_owned();
        let running = self.running.get_or_insert_with(|| {
            tokio::task::spawn_blocking(move || {
                (name.as_str(), port)
                    .to_socket_addrs()
                    .map(|found| found.take(ADDRESSES_MAX).collect())
            })
        });
        let Ok(ended) = tokio::time::timeout(LOOKUP_WITHIN, running).await else {
            let what = format!(
                "the name {host} is not found within {} s",
                LOOKUP_WITHIN.as_secs()
            );
            return Err(OpenError::NoConnection(what));
        };
        self.running = None;
        let found = ended.unwrap_or_else(|error| Err(io::Error::other(error)));
        found.map_err(|error| {
            OpenError::NoConnection(format!("the name {host} is not found: {error}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::OpenPort;
    use super::super::PortOpener;
    use super::super::PortSettings;
    use super::*;
    use crate::config::PortAddress;
    use crate::domain::link::{DirectionControl, LinkSettings, PortKind};
    use std::future::poll_fn;
    use std::net::TcpListener;
    use std::os::fd::AsFd;

    fn settings(host: &str, port: u16) -> PortSettings {
        PortSettings {
            line: "hall-1".to_owned(),
            address: PortAddress::Tcp {
                host: host.to_owned(),
                port,
            },
            link: LinkSettings::DEFAULT,
            direction: DirectionControl::Adapter,
            low_latency: true,
            needs_virtual: true,
            lock_dirs: Vec::new(),
        }
    }

    async fn opened(host: &str, port: u16) -> Result<OpenPort, OpenError> {
        PortOpener::new(&settings(host, port)).open().await
    }

    async fn readable(port: &mut OpenPort) {
        poll_fn(|cx| port.poll_readable(cx)).await.unwrap();
    }

    #[tokio::test]
    async fn bytes_go_both_ways_and_the_end_is_reported() {
        for (bind, host) in [
            ("127.0.0.1:0", "127.0.0.1"),
            ("127.0.0.1:0", "localhost"),
            ("[::1]:0", "::1"),
        ] {
            // Skipped on a machine without IPv6.
            let Ok(server) = TcpListener::bind(bind) else {
                continue;
            };
            let mut port = opened(host, server.local_addr().unwrap().port())
                .await
                .unwrap();
            assert_eq!(port.kind(), PortKind::Virtual);
            let mut peer = server.accept().unwrap().0;
            let mut buffer = [0; 16];
            assert_eq!(port.read_now(&mut buffer).unwrap(), None, "quiet");
            port.write_frame(b"request").unwrap();
            peer.read_exact(&mut buffer[..7]).unwrap();
            assert_eq!(&buffer[..7], b"request");
            peer.write_all(b"reply").unwrap();
            readable(&mut port).await;
            assert_eq!(port.read_now(&mut buffer).unwrap(), Some(5));
            drop(peer);
            readable(&mut port).await;
            assert_eq!(port.read_now(&mut buffer).unwrap(), Some(0), "gone");
        }
    }

    #[tokio::test]
    async fn a_vanished_peer_is_noticed_and_nothing_is_sent_after_the_end() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let OpenPort::Tcp(port) = opened("127.0.0.1", server.local_addr().unwrap().port())
            .await
            .unwrap()
        else {
            panic!()
        };
        let stream = port.stream.get_ref();
        assert!(stream.nodelay().unwrap());
        assert_eq!(sockopt::tcp_user_timeout(stream.as_fd()).unwrap(), 3000);
        assert!(sockopt::socket_keepalive(stream.as_fd()).unwrap());
        assert_eq!(
            sockopt::socket_linger(stream.as_fd()).unwrap(),
            Some(Duration::ZERO)
        );
        let mut peer = server.accept().unwrap().0;
        drop(port);
        let mut rest = Vec::new();
        assert_eq!(
            peer.read_to_end(&mut rest).unwrap_err().kind(),
            io::ErrorKind::ConnectionReset
        );
    }

    #[tokio::test]
    async fn a_peer_that_takes_no_bytes_is_reported_as_such() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut port = opened("127.0.0.1", server.local_addr().unwrap().port())
            .await
            .unwrap();
        let peer = server.accept().unwrap().0;
        let frame = [0x55; 4096];
        let refused = (0..100_000)
            .find_map(|_| port.write_frame(&frame).err())
            .unwrap();
        assert!(
            matches!(
                refused.kind(),
                io::ErrorKind::WouldBlock | io::ErrorKind::WriteZero
            ),
            "{refused:?}"
        );
        drop(peer);
    }

    #[tokio::test]
    async fn who_refuses_is_named() {
        let port = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port();
        let error = opened("127.0.0.1", port).await.unwrap_err().to_string();
        assert!(
            error.contains(&format!("127.0.0.1:{port}: ")) && error.contains("refused"),
            "{error}"
        );
        let error = opened("no-such-host.invalid", port)
            .await
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("the name no-such-host.invalid is not found"),
            "{error}"
        );
    }
}
