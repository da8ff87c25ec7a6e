//! Modbus TCP listeners: sockets on one side, [`Connection`] machines on the other.

use super::answers::{AnswerBox, News};
use super::clock;
use super::inbox::{Full, Inbox, Message};
use super::router::{Drive, Router, Target};
use crate::config::ListenerSettings;
use crate::domain::command::{CommandAnswer, CommandRequest, Manner, Order, Origin, Owner, Rights};
use crate::domain::ids::{AskerId, DriveIndex, Ticket};
use crate::domain::native::NativeRequest;
use crate::domain::time::MonoTime;
use crate::north::modbus::{
    Answer, Ask, Call, Commands, Connection, Ended, Limits, Ordered, Present, ReadBehind, Taken, Words, native, own,
};
use crate::wire::exception;
use ipnet::IpNet;
use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::future::poll_fn;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::rc::Rc;
use std::sync::Arc;
use std::task::{Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, ReadBuf};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use tokio::time::Instant;

/// Wait after a connection could not be accepted, for want of descriptors for instance.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);
/// Bytes read from a socket at once: the longest message and some, or a burst of short ones. Small, because each
/// connection has a buffer.
const READ_BYTES: usize = 512;
/// The first frame of a command leaves within this time or never.
const COMMAND_DEADLINE: Duration = Duration::from_secs(1);
/// Reads that renew a lease do so at most this often for each drive of a connection.
const RENEW_EVERY: Duration = Duration::from_millis(100);
/// Most connections at once over all listeners.
pub const CONNECTIONS_MAX: usize = 4096;

/// The connections of all listeners. It lives on the main thread.
#[derive(Debug, Default)]
pub struct Server {
    clients: RefCell<HashMap<AskerId, Rc<Client>>>,
    last: Cell<u64>,
}

/// What a listener grants to a client.
#[derive(Clone, Copy, Debug)]
struct Granted {
    rights: Rights,
    /// Its reads of a uniform unit renew its lease.
    reads_renew: bool,
}

#[derive(Debug)]
struct Client {
    asker: AskerId,
    origin: Origin,
    reads_renew: bool,
    stream: OwnedWriteHalf,
    machine: RefCell<Connection>,
    commands: RefCell<Commands>,
    /// When a read renewed a lease last, by the place of the drive.
    renewed: RefCell<HashMap<usize, MonoTime>>,
    router: Rc<Router>,
    /// Rung when the machine was changed by somebody other than its own task.
    bell: Notify,
}

impl Server {
    /// Accepts connections of those whom `settings` allow until the task is dropped.
    pub async fn listen(self: Rc<Self>, listener: TcpListener, settings: ListenerSettings, router: Rc<Router>) {
        loop {
            match listener.accept().await {
                Ok((stream, peer)) if !is_allowed(settings.allow.as_deref(), peer.ip()) => {
                    tracing::warn!(%peer, "refused: not in `allow`");
                    drop(stream);
                }
                Ok((stream, peer)) if self.clients.borrow().len() >= CONNECTIONS_MAX => {
                    tracing::warn!(%peer, "refused: too many connections");
                    drop(stream);
                }
                Ok((stream, peer)) => {
                    self.welcome(stream, peer, rights_of(&settings, peer.ip()), Rc::clone(&router));
                }
                Err(error) => {
                    tracing::warn!(%error, "cannot accept a connection");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    /// Hands the answers of the lines to their connections until the task is dropped.
    pub async fn distribute(self: Rc<Self>, answers: Arc<AnswerBox>) {
        let mut batch: Vec<News> = Vec::new();
        let mut touched: Vec<Rc<Client>> = Vec::new();
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
                if client.flush().is_err() || !client.machine.borrow().output().is_empty() {
                    client.bell.notify_one();
                }
            }
        }
    }

    fn welcome(self: &Rc<Self>, stream: TcpStream, peer: SocketAddr, granted: Granted, router: Rc<Router>) {
        if let Err(error) = stream.set_nodelay(true) {
            tracing::debug!(%peer, %error, "cannot set TCP_NODELAY");
        }
        self.last.set(self.last.get() + 1);
        let asker = AskerId(self.last.get());
        let machine = RefCell::new(Connection::new(Limits::default(), clock::now()));
        let (mut source, stream) = stream.into_split();
        let owner = Owner::ModbusTcp(peer.ip().to_canonical());
        let client = Rc::new(Client {
            asker,
            origin: Origin { owner, rights: granted.rights, manner: Manner::Cyclic },
            reads_renew: granted.reads_renew,
            stream,
            machine,
            commands: RefCell::default(),
            renewed: RefCell::default(),
            router,
            bell: Notify::new(),
        });
        self.clients.borrow_mut().insert(asker, Rc::clone(&client));
        let server = Rc::clone(self);
        tokio::task::spawn_local(async move {
            let end = client.serve(&mut source).await;
            tracing::debug!(%peer, end = %end, "connection closed");
            server.clients.borrow_mut().remove(&asker);
            for inbox in client.router.inboxes() {
                // A full inbox loses nothing but early removal: the requests end at their deadlines.
                let _ = inbox.put(Message::AskerGone(asker));
            }
        });
    }
}

impl Client {
    /// Serves the connection until it ends; returns why it ended.
    async fn serve(&self, source: &mut OwnedReadHalf) -> String {
        let wake = tokio::time::sleep(Duration::from_secs(3600));
        tokio::pin!(wake);
        let mut buffer = [0; READ_BYTES];
        loop {
            let (next_wake, wants_input, has_output) = {
                let machine = self.machine.borrow();
                (machine.next_wake(), machine.wants_input(), !machine.output().is_empty())
            };
            let now = clock::now();
            if let Some(at) = next_wake {
                let at = instant_of(now, at);
                if at < wake.deadline() {
                    wake.as_mut().reset(at);
                }
            }
            let moved = tokio::select! {
                read = receive(source, &mut buffer), if wants_input => read.and_then(|read| self.take(&buffer[..read])),
                ready = self.stream.writable(), if has_output => ready.and_then(|()| self.flush()),
                () = self.bell.notified() => Ok(()),
                () = &mut wake => {
                    self.machine.borrow_mut().tick(clock::now());
                    wake.as_mut().reset(Instant::now() + Duration::from_secs(3600));
                    self.flush()
                }
            };
            if let Err(error) = moved {
                return error.to_string();
            }
            let close_reason = self.machine.borrow().close_reason();
            if let Some(reason) = close_reason {
                // What was due before is still sent, as far as the socket takes it at once.
                let _ = self.flush();
                return reason.to_string();
            }
        }
    }

    /// Takes received bytes, answers what can be answered at once, orders the rest.
    fn take(&self, bytes: &[u8]) -> io::Result<()> {
        if bytes.is_empty() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let now = clock::now();
        let mut words = Words::default();
        let mut machine = self.machine.borrow_mut();
        machine.receive(now, bytes, &|unit, ask| self.router.is_stop(unit, ask));
        while let Some(call) = machine.next_call() {
            self.serve_call(now, &mut machine, call, &mut words);
        }
        drop(machine);
        self.flush()
    }

    fn serve_call(&self, now: MonoTime, machine: &mut Connection, call: Call, words: &mut Words) {
        let ticket = call.ticket;
        match self.router.find(call.unit) {
            Some(Target::Native(inbox, drive)) => {
                if let Err(code) = self.ask_drive(inbox, drive, call) {
                    machine.answer(now, ticket, Answer::Exception(code));
                }
            }
            Some(Target::Uniform(drive)) => {
                let taken = drive.unit.take(&call.ask, &drive.shared.view.load(), &self.present(now), words);
                if self.reads_renew && !call.ask.writes() && !matches!(taken, Taken::Exception(_)) {
                    self.renew(now, machine, drive);
                }
                self.settle(now, machine, &call, taken, words, Some(drive));
            }
            Some(Target::Own) => {
                let taken = own::take(call.unit, &call.ask, self.router.as_ref(), &self.present(now), words);
                self.settle(now, machine, &call, taken, words, None);
            }
            None => machine.answer(now, ticket, Answer::Exception(exception::GATEWAY_PATH_UNAVAILABLE)),
        }
    }

    /// Hands a native request to its line, or returns the exception that answers it.
    fn ask_drive(&self, inbox: &Inbox, drive: DriveIndex, call: Call) -> Result<(), u8> {
        let Call { ticket, ask, deadline, .. } = call;
        let ask = native::ask_of(ask)?;
        let request = NativeRequest { asker: self.asker, ticket, drive, origin: self.origin, ask, deadline };
        inbox.put(Message::Native(request)).map_err(|Full| exception::SERVER_DEVICE_BUSY)
    }

    /// Answers a call at once, or gives the orders that have to be answered first.
    fn settle(
        &self,
        now: MonoTime,
        machine: &mut Connection,
        call: &Call,
        taken: Taken,
        words: &Words,
        drive: Option<Drive<'_>>,
    ) {
        match (taken.at_once(words, |answer| machine.answer(now, call.ticket, answer)), drive) {
            (Ok(()), _) => {}
            (Err(Ordered::One(order)), Some(drive)) => {
                let result = self.order(now, call.ticket, drive, order);
                self.expect(now, machine, call, vec![(call.ticket, result)]);
            }
            (Err(_), _) => {
                let stop = |drive| {
                    let ticket = machine.fresh_ticket();
                    (ticket, self.order(now, ticket, drive, Order::Stop { setpoint: None }))
                };
                let given = self.router.controlled().map(stop).collect();
                self.expect(now, machine, call, given);
            }
        }
    }

    /// Gives an order to a drive, or returns why not.
    fn order(&self, now: MonoTime, ticket: Ticket, drive: Drive<'_>, order: Order) -> Result<(), Full> {
        drive.inbox.put(Message::Command(CommandRequest {
            asker: self.asker,
            ticket,
            drive: drive.shared.description.place.drive,
            origin: self.origin,
            order,
            start_before: now + COMMAND_DEADLINE,
            issued: None,
            epoch: None,
        }))
    }

    /// Waits for the answers to what was ordered for `call`. If nothing was (no drive has control), it is never
    /// allowed; if nothing could be, the answer comes at once.
    fn expect(&self, now: MonoTime, machine: &mut Connection, call: &Call, given: Vec<(Ticket, Result<(), Full>)>) {
        if given.is_empty() {
            return machine.answer(now, call.ticket, Answer::Exception(exception::ILLEGAL_FUNCTION));
        }
        let has_full = given.iter().any(|(_, result)| result.is_err());
        let worst = has_full.then_some(exception::SERVER_DEVICE_BUSY);
        let out: Vec<Ticket> = given.into_iter().filter_map(|(ticket, result)| result.ok().map(|()| ticket)).collect();
        if let (true, Some(code)) = (out.is_empty(), worst) {
            return machine.answer(now, call.ticket, Answer::Exception(code));
        }
        let read = read_behind(call);
        self.commands.borrow_mut().expect(now, call.ticket, call.deadline, out, worst, read);
    }

    /// Takes what a line says.
    fn hear(&self, now: MonoTime, news: &News) {
        match news {
            News::Native(answer) => {
                self.machine.borrow_mut().answer(now, answer.ticket, native::answer_of(&answer.outcome));
            }
            News::Command(answer) => self.hear_command(now, answer),
            News::Trip(..) => {}
        }
    }

    fn hear_command(&self, now: MonoTime, answer: &CommandAnswer) {
        let Some(Ended { call, exception, read }) = self.commands.borrow_mut().take(answer) else { return };
        let mut machine = self.machine.borrow_mut();
        let Some(read) = read else {
            return machine.answer(now, call, exception.map_or(Answer::Written, Answer::Exception));
        };
        let Some(Target::Uniform(drive)) = self.router.find(read.unit) else {
            return machine.answer(now, call, Answer::Exception(exception::SERVER_DEVICE_FAILURE));
        };
        let mut words = Words::default();
        let (view, present) = (drive.shared.view.load(), self.present(now));
        let taken = drive.unit.read(read.address, read.count, &view, &present, &mut words);
        // A read orders nothing.
        let _ = taken.at_once(&words, |answer| machine.answer(now, call, answer));
    }

    /// Renews the lease that this client holds. Nobody waits for the answer.
    fn renew(&self, now: MonoTime, machine: &mut Connection, drive: Drive<'_>) {
        let view = drive.shared.view.load();
        let lease = view.control.as_ref().and_then(|control| control.lease);
        if lease.is_none_or(|(owner, _)| owner != self.origin.owner) {
            return;
        }
        let mut renewed = self.renewed.borrow_mut();
        if renewed.get(&drive.place).is_some_and(|at| now.since(*at) < RENEW_EVERY) {
            return;
        }
        if self.order(now, machine.fresh_ticket(), drive, Order::Renew).is_ok() {
            renewed.insert(drive.place, now);
        }
    }

    fn present(&self, now: MonoTime) -> Present {
        Present { now, uptime_s: self.router.uptime_s(now), owner: self.origin.owner }
    }

    /// Writes as much as the socket takes.
    fn flush(&self) -> io::Result<()> {
        let mut machine = self.machine.borrow_mut();
        while !machine.output().is_empty() {
            match self.stream.try_write(machine.output()) {
                Ok(bytes) => machine.wrote(bytes),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// Reads once bytes are there. tokio then knows by itself that a short read has emptied the socket, which saves
/// asking the system a second time.
async fn receive(source: &mut OwnedReadHalf, buffer: &mut [u8]) -> io::Result<usize> {
    poll_fn(|cx| {
        let mut read = ReadBuf::new(buffer);
        ready!(Pin::new(&mut *source).poll_read(cx, &mut read))?;
        Poll::Ready(Ok(read.filled().len()))
    })
    .await
}

/// What `listener` grants to `peer`. Nothing else decides about it.
fn rights_of(_listener: &ListenerSettings, _peer: IpAddr) -> Granted {
    Granted { rights: Rights { write: false, stop: false }, reads_renew: false }
}

/// What is read once the order in `call` is answered.
const fn read_behind(call: &Call) -> Option<ReadBehind> {
    match call.ask {
        Ask::ReadWriteWords { read_address, read_count, .. } => {
            Some(ReadBehind { unit: call.unit, address: read_address, count: read_count })
        }
        _ => None,
    }
}

fn is_allowed(allow: Option<&[IpNet]>, peer: IpAddr) -> bool {
    allow.is_none_or(|nets| nets.iter().any(|net| net.contains(&peer.to_canonical())))
}

fn instant_of(now: MonoTime, at: MonoTime) -> Instant {
    Instant::now() + at.since(now)
}
