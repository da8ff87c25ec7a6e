//! The sockets of the broker: a task for each, which carries bytes between its client and the machine.

use super::limits::PACKET_MAX;
use super::machine::{BrokerMachine, ConnectionId};
use super::packet::ProtocolFault;
use super::reader;
use crate::daemon::host::clock;
use bytes::{Buf, BytesMut};
use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::Notify;

/// Time for a client to take the last bytes.
const FAREWELL: Duration = Duration::from_secs(2);
/// Ticks between two log messages about dropped messages.
const REPORT_EVERY: u32 = 40;

/// The machine, and the tasks to wake when it has bytes for a connection.
pub struct SharedMachine {
    state: Mutex<MachineState>,
}

struct MachineState {
    machine: BrokerMachine,
    bells: HashMap<ConnectionId, Arc<Notify>>,
    beats: u32,
}

/// The place of a connection, which is freed when this is dropped.
pub struct ConnectionPermit {
    id: ConnectionId,
    bell: Arc<Notify>,
    shared: Arc<SharedMachine>,
}

impl SharedMachine {
    pub fn new() -> Arc<Self> {
        // The seed is for names, which are not secrets.
        let machine = BrokerMachine::new(clock::wall_micros().unsigned_abs(), clock::now());
        Arc::new(Self {
            state: Mutex::new(MachineState {
                machine,
                bells: HashMap::new(),
                beats: 0,
            }),
        })
    }

    /// A place for one more connection; `None` if there are too many.
    pub fn open(self: &Arc<Self>) -> Option<ConnectionPermit> {
        let bell = Arc::new(Notify::new());
        let mut state = self.state();
        let id = state.machine.open(clock::now())?;
        state.bells.insert(id, Arc::clone(&bell));
        Some(ConnectionPermit {
            id,
            bell,
            shared: Arc::clone(self),
        })
    }

    /// Lets time pass.
    pub fn tick(&self) {
        self.with(|machine| machine.tick(clock::now()));
        let mut state = self.state();
        state.beats = state.beats.wrapping_add(1);
        if state.beats.is_multiple_of(REPORT_EVERY) {
            let report = state.machine.take_report();
            drop(state);
            for (client, count) in report.dropped {
                tracing::warn!(%client, count, "client is too slow or away; messages dropped");
            }
            if report.not_kept > 0 {
                tracing::warn!(
                    count = report.not_kept,
                    "too many retained messages; some were not kept"
                );
            }
        }
    }

    /// Runs `act` on the machine, then wakes the connections that have bytes to send.
    fn with<T>(&self, act: impl FnOnce(&mut BrokerMachine) -> T) -> T {
        let mut state = self.state();
        let done = act(&mut state.machine);
        for id in state.machine.take_woken() {
            if let Some(bell) = state.bells.get(&id) {
                bell.notify_one();
            }
        }
        done
    }

    fn state(&self) -> MutexGuard<'_, MachineState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ConnectionPermit {
    /// Passes received bytes to the machine, packet by packet.
    fn received(&self, bytes: &mut BytesMut, peer: SocketAddr) {
        loop {
            let done = match reader::frame(bytes, PACKET_MAX as usize) {
                Ok(None) => return,
                Ok(Some(frame)) => {
                    let body = &bytes[frame.body..frame.end];
                    let done = self
                        .shared
                        .with(|it| it.received(self.id, frame.first, body, clock::now()));
                    bytes.advance(frame.end);
                    done
                }
                Err(fault) => {
                    self.shared.with(|it| it.fail(self.id, fault, clock::now()));
                    bytes.clear();
                    Err(fault)
                }
            };
            if let Err(ProtocolFault { reason, why }) = done {
                tracing::info!(%peer, reason, why, "client connection closed by the broker");
            }
        }
    }

    /// Appends the bytes to be sent now. Returns whether the connection is to be closed afterwards.
    fn hand_over(&self, out: &mut Vec<u8>) -> bool {
        self.shared.with(|machine| {
            machine.hand_over(self.id, clock::now(), out);
            machine.is_ending(self.id)
        })
    }

    fn may_say_more(&self) -> bool {
        self.shared.state().machine.may_say_more(self.id)
    }
}

impl Drop for ConnectionPermit {
    fn drop(&mut self) {
        self.shared
            .with(|machine| machine.closed(self.id, clock::now()));
        self.shared.state().bells.remove(&self.id);
    }
}

/// Serves one client until either side closes the connection.
pub async fn serve(stream: TcpStream, peer: SocketAddr, place: ConnectionPermit) {
    // Small packets should not wait for each other; if this fails, they are only delayed.
    let _ = stream.set_nodelay(true);
    let (mut from, mut to) = stream.into_split();
    if let Err(error) = carry(&mut from, &mut to, &place, peer).await {
        tracing::debug!(%peer, %error, "client connection lost");
    }
}

async fn carry(
    from: &mut OwnedReadHalf,
    to: &mut OwnedWriteHalf,
    place: &ConnectionPermit,
    peer: SocketAddr,
) -> io::Result<()> {
    let mut incoming = BytesMut::new();
    let mut outgoing = Vec::new();
    let mut sent = 0;
    loop {
        if sent == outgoing.len() {
            outgoing = Vec::new();
            sent = 0;
            if place.hand_over(&mut outgoing) {
                break;
            }
        }
        tokio::select! {
            read = from.read_buf(&mut incoming), if place.may_say_more() => {
                if read? == 0 {
                    return Ok(());
                }
                place.received(&mut incoming, peer);
            }
            written = to.write(&outgoing[sent..]), if sent < outgoing.len() => sent += written?,
            () = place.bell.notified() => {}
        }
    }
    // A client that does not read does not hold its place for long.
    tokio::time::timeout(FAREWELL, to.write_all(&outgoing))
        .await
        .unwrap_or(Ok(()))
}
