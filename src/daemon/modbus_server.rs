//! Modbus TCP listeners: they carry bytes between sockets and [`ModbusConnection`] machines.

mod accepting;
mod admission;
mod calls;
mod certificate;
mod handshake;
mod listener;
mod security;
mod stream;

pub use listener::ModbusListener;
pub use security::ListenerSecurity;
pub use stream::PortMaster;

use crate::daemon::exchange::answers::{AnswerBox, LineNews};
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::exchange::keeper::AttemptKeeper;
use crate::daemon::exchange::north_journal::Journal;
use crate::daemon::exchange::rate_limited_log::RateLimitedLog;
use crate::daemon::exchange::router::UnitRouter;
use crate::daemon::exchange::totals::ModbusTotals;
use crate::daemon::host::clock;
use crate::daemon::host::descriptors::SpareDescriptor;
use crate::daemon::host::stall::LastStalls;
use crate::domain::command::{OrderManner, Origin, Owner, Rights};
use crate::domain::ids::AskerId;
use crate::domain::time::MonoTime;
use crate::north::modbus::{
    CallCommands, ClientSlots, ConnectionCounters, ModbusConnection, UnsentAttempt,
};
use admission::{ClientAdmission, ClientDismissal, ClientSeat};
use certificate::CertifiedClient;
use handshake::PendingHandshakes;
use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::future::poll_fn;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::pin::Pin;
use std::rc::{Rc, Weak};
use std::sync::Arc;
use std::task::{Poll, ready};
use std::time::Duration;
use stream::{ClientStream, READ_BYTES};
use tokio::io::{AsyncRead, ReadBuf};
use tokio::net::UnixStream;
use tokio::sync::Notify;
use tokio::task::yield_now;
use tokio::time::Instant;

/// The connections of all listeners. It lives on the main thread.
#[derive(Debug, Default)]
pub struct ModbusServer {
    totals: Arc<ModbusTotals>,
    keeper: Rc<AttemptKeeper>,
    clients: RefCell<HashMap<AskerId, Rc<ModbusClient>>>,
    handshakes: PendingHandshakes,
    admission: Rc<ClientAdmission>,
    spare: SpareDescriptor,
    log: RateLimitedLog,
    stalls: Arc<LastStalls>,
    last: Cell<u64>,
}

#[derive(Debug)]
struct ModbusClient {
    asker: AskerId,
    seat: ClientSeat,
    peer: IpAddr,
    proven: Option<Box<ProvenClient>>,
    origin: Cell<Origin>,
    /// Whether its requests are answered at all.
    may_ask: Cell<bool>,
    reads_renew: Cell<bool>,
    stream: ClientStream,
    machine: RefCell<ModbusConnection>,
    stalls: Arc<LastStalls>,
    /// When its socket was last read empty.
    emptied: Cell<MonoTime>,
    commands: RefCell<CallCommands>,
    /// Until when requests of it may wait at a line: reads until their deadlines, reads after a stop longer.
    known_until: Cell<MonoTime>,
    /// When a read last renewed a lease, by the place of the drive.
    renewed: RefCell<HashMap<usize, MonoTime>>,
    listener: Rc<ModbusListener>,
    router: RefCell<Arc<UnitRouter>>,
    /// Why it is to be closed, if it is.
    dismissed: Cell<Option<ClientDismissal>>,
    server: Weak<ModbusServer>,
    keeper: Rc<AttemptKeeper>,
    /// Notified when the machine was changed outside its own task.
    bell: Notify,
    totals: Arc<ModbusTotals>,
    /// The part of the machine's counts that is in the totals already.
    counted: Cell<ConnectionCounters>,
}

/// How a client has authenticated itself.
#[derive(Debug)]
struct ProvenClient {
    certificate: CertifiedClient,
    to: Rc<ListenerSecurity>,
}

impl ModbusServer {
    /// A server without listeners that counts into `totals`. Attempts that reach no line are sent to `journal`.
    #[must_use]
    pub fn new(totals: Arc<ModbusTotals>, journal: Journal) -> Self {
        Self {
            totals,
            keeper: Rc::new(AttemptKeeper::new(journal)),
            ..Self::default()
        }
    }

    /// This server with `stalls`: of what was sent before the end of a stall it accepts only stops.
    #[must_use]
    pub fn with_stalls(self, stalls: Arc<LastStalls>) -> Self {
        Self { stalls, ..self }
    }

    /// This server with at most `most` connections.
    #[must_use]
    pub fn with_slots(self, most: usize) -> Self {
        self.admission.slots.replace(ClientSlots::new(most));
        self
    }

    /// What all connections have counted.
    #[must_use]
    pub const fn totals(&self) -> &Arc<ModbusTotals> {
        &self.totals
    }

    /// Applies to every connection what its listener grants now, before its next request, and closes those that are no
    /// longer allowed.
    pub fn review(&self) {
        self.clients
            .borrow()
            .values()
            .for_each(|client| client.review());
    }

    /// Passes the answers of the lines to their connections until the task is dropped.
    pub async fn distribute(self: Rc<Self>, answers: Arc<AnswerBox>) {
        let mut batch: Vec<LineNews> = Vec::new();
        let mut touched: Vec<Rc<ModbusClient>> = Vec::new();
        loop {
            answers.fetch(&mut batch).await;
            let now = clock::now();
            let clients = self.clients.borrow();
            for news in batch.drain(..) {
                if let Some(client) = clients.get(&news.asker()) {
                    client.hear(now, &news);
                    touched.push(Rc::clone(client));
                }
            }
            drop(clients);
            for client in touched.drain(..) {
                if client.flush().is_err() || client.has_output() {
                    client.bell.notify_one();
                }
            }
        }
    }

    /// Serves a tool of this process, with what `listener` grants to this host.
    pub fn serve_tool(self: &Rc<Self>, stream: UnixStream, listener: &Rc<ModbusListener>) {
        let peer = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let Some(seat) = self.seat(peer.ip(), listener) else {
            return;
        };
        let (source, sink) = stream.into_split();
        self.begin(
            source,
            ClientStream::Tool(sink),
            peer,
            None,
            Rc::clone(listener),
            seat,
        );
    }

    /// Serves a serial master behind `stream`, with what `listener` grants to this host.
    pub fn serve_master(
        self: &Rc<Self>,
        stream: UnixStream,
        master: PortMaster,
        listener: &Rc<ModbusListener>,
    ) {
        let peer = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let Some(seat) = self.seat(peer.ip(), listener) else {
            return;
        };
        let (source, sink) = stream.into_split();
        self.begin(
            source,
            ClientStream::Master(sink, master),
            peer,
            None,
            Rc::clone(listener),
            seat,
        );
    }

    /// Serves a client, `proven` if its listener requires authentication.
    fn begin(
        self: &Rc<Self>,
        mut source: impl AsyncRead + Unpin + 'static,
        stream: ClientStream,
        peer: SocketAddr,
        proven: Option<Box<ProvenClient>>,
        listener: Rc<ModbusListener>,
        seat: ClientSeat,
    ) {
        let asker = seat.asker;
        let machine = RefCell::new(ModbusConnection::new(stream.limits(), clock::now()));
        let owner = match &proven {
            None => stream.owner_at(peer.ip()),
            Some(proven) => Owner::ModbusSecurity(proven.certificate.name),
        };
        let client = Rc::new(ModbusClient {
            asker,
            seat,
            peer: peer.ip(),
            proven,
            origin: Cell::new(Origin {
                owner,
                rights: Rights::NONE,
                manner: OrderManner::Cyclic,
            }),
            may_ask: Cell::new(false),
            reads_renew: Cell::new(false),
            stream,
            machine,
            stalls: Arc::clone(&self.stalls),
            emptied: Cell::new(MonoTime::ZERO),
            commands: RefCell::default(),
            known_until: Cell::new(MonoTime::ZERO),
            renewed: RefCell::default(),
            router: RefCell::new(listener.router()),
            listener,
            dismissed: Cell::default(),
            server: Rc::downgrade(self),
            keeper: Rc::clone(&self.keeper),
            bell: Notify::new(),
            totals: Arc::clone(&self.totals),
            counted: Cell::default(),
        });
        // The listener may have changed during a handshake.
        client.review();
        self.totals.opened();
        self.clients.borrow_mut().insert(asker, Rc::clone(&client));
        let server = Rc::clone(self);
        tokio::task::spawn_local(async move {
            let end = client.serve(&mut source).await;
            client.stream.close();
            tracing::debug!(%peer, end = %end, "connection closed");
            server.clients.borrow_mut().remove(&asker);
            client.count();
            server.totals.closed();
            if clock::now() < client.known_until.get() {
                for inbox in client.router().inboxes() {
                    // If the inbox is full, the requests just end at their deadlines.
                    let _ = inbox.put(LineMessage::AskerGone(asker));
                }
            }
        });
    }
}

impl ModbusClient {
    /// Serves the connection until it is closed; returns the reason.
    async fn serve(&self, source: &mut (impl AsyncRead + Unpin)) -> String {
        let wake = tokio::time::sleep(Duration::from_secs(3600));
        tokio::pin!(wake);
        let mut buffer = [0; READ_BYTES];
        // A secure connection may have sent requests right after its handshake.
        if let Err(error) = self.take(&[]) {
            return error.to_string();
        }
        loop {
            let (next_wake, wants_input) = {
                let machine = self.machine.borrow();
                (machine.next_wake(), machine.wants_input())
            };
            let has_output = self.has_output();
            let now = clock::now();
            if let Some(at) = next_wake {
                let at = instant_of(now, at);
                if at < wake.deadline() {
                    wake.as_mut().reset(at);
                }
            }
            let mut has_more = false;
            let moved = tokio::select! {
                read = receive(source, &mut buffer), if wants_input => match read {
                    Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
                    read => read.and_then(|read| {
                        has_more = read == READ_BYTES;
                        self.take(&buffer[..read])
                    }),
                },
                ready = self.stream.writable(), if has_output => ready.and_then(|()| self.flush()),
                () = self.bell.notified() => Ok(()),
                () = &mut wake => {
                    self.machine.borrow_mut().tick(clock::now());
                    self.journal_attempts();
                    wake.as_mut().reset(Instant::now() + Duration::from_secs(3600));
                    self.flush()
                }
            };
            if let Some(why) = self.dismissed.get() {
                return why.to_string();
            }
            if let Err(error) = moved {
                return error.to_string();
            }
            let close_reason = self.machine.borrow().close_reason();
            if let Some(reason) = close_reason {
                // Pending answers are still sent, as far as the socket takes them at once.
                let _ = self.flush();
                return reason.to_string();
            }
            if has_more {
                yield_now().await;
            }
        }
    }

    /// Processes received bytes: answers what can be answered at once, and passes the rest on.
    fn take(&self, bytes: &[u8]) -> io::Result<()> {
        if self.dismissed.get().is_some() {
            return Ok(());
        }
        let now = clock::now();
        let has_waited = self.stalls.may_have_waited(now, self.emptied.get());
        // What a serial port held through a stall comes in several messages.
        if (1..READ_BYTES).contains(&bytes.len())
            && !matches!(self.stream, ClientStream::Master(..))
        {
            self.emptied.set(now);
        }
        let opened = self
            .stream
            .open(bytes, |plain| self.serve_bytes(now, plain, has_waited));
        self.journal_attempts();
        opened.and_then(|()| self.flush())
    }

    /// Passes the machine's attempts that reached no line to the journal.
    fn journal_attempts(&self) {
        while let Some(UnsentAttempt {
            unit,
            tried,
            report,
        }) = self.next_kept()
        {
            self.keeper.keep(
                self.router().drive_of(unit),
                self.origin.get().owner,
                tried,
                report,
            );
        }
    }

    fn next_kept(&self) -> Option<UnsentAttempt> {
        self.machine.borrow_mut().next_kept()
    }

    fn router(&self) -> Arc<UnitRouter> {
        Arc::clone(&self.router.borrow())
    }

    /// Applies what its listener grants now.
    fn review(&self) {
        let (role, security) = match &self.proven {
            None => (None, None),
            Some(proven) => (Some(&*proven.certificate.role), Some(&*proven.to)),
        };
        if self.listener.allows(self.peer) && self.listener.goes_on(security) {
            let granted = self.listener.grants(self.peer, role);
            self.may_ask.set(granted.may_ask);
            self.origin.set(Origin {
                rights: granted.rights,
                ..self.origin.get()
            });
            self.reads_renew.set(granted.reads_renew);
            self.router.replace(self.listener.router());
            // Places of drives may have changed.
            self.renewed.borrow_mut().clear();
            self.machine
                .borrow_mut()
                .set_idle_timeout(granted.idle_timeout);
            self.bell.notify_one();
        } else {
            self.dismiss(ClientDismissal::Unwanted);
        }
    }

    /// Its task closes it at its next turn.
    fn dismiss(&self, why: ClientDismissal) {
        self.dismissed.set(Some(why));
        self.bell.notify_one();
    }

    /// Adds new counts to the totals, and reports activity and unread bytes to the state that all connections share.
    fn count(&self) {
        let (now, unread) = {
            let machine = self.machine.borrow();
            (*machine.counters(), machine.output().len())
        };
        let before = self.counted.replace(now);
        if now.requests != before.requests {
            self.seat.active();
        }
        self.totals.add(&before, &now);
        if self.seat.leaves_unread(unread)
            && let Some(server) = self.server.upgrade()
        {
            server.shed();
        }
    }

    fn has_output(&self) -> bool {
        !self.machine.borrow().output().is_empty() || self.stream.wants_write()
    }

    /// Writes as much as the socket takes.
    fn flush(&self) -> io::Result<()> {
        let mut machine = self.machine.borrow_mut();
        self.stream.flush(&mut machine)?;
        drop(machine);
        self.count();
        Ok(())
    }
}

/// Reads once bytes are there. tokio then knows that a short read has emptied the socket, which saves a second system
/// call.
async fn receive(source: &mut (impl AsyncRead + Unpin), buffer: &mut [u8]) -> io::Result<usize> {
    poll_fn(|cx| {
        let mut read = ReadBuf::new(buffer);
        ready!(Pin::new(&mut *source).poll_read(cx, &mut read))?;
        Poll::Ready(Ok(read.filled().len()))
    })
    .await
}

fn instant_of(now: MonoTime, at: MonoTime) -> Instant {
    Instant::now() + at.since(now)
}

#[cfg(test)]
mod admission_tests;
#[cfg(test)]
mod audit_tests;
#[cfg(test)]
mod issuing;
#[cfg(test)]
mod secured_tests;
#[cfg(test)]
mod tests;
