//! The stream between a client's socket and its machine: plain, or through TLS.

use crate::domain::command::Owner;
use crate::domain::ids::CommanderName;
use crate::north::modbus::{ConnectionLimits, ModbusConnection};
use rustls::ServerConnection;
use std::cell::RefCell;
use std::io::{self, IoSlice, Read, Write};
use std::net::IpAddr;
use std::time::Duration;
use tokio::net::tcp::OwnedWriteHalf;
use tokio::net::unix;

/// Bytes read from a socket at once: the longest message and some, or a burst of short ones. Small, because each
/// connection has a buffer, and because a client that has sent more waits until all others had their turn.
pub(super) const READ_BYTES: usize = 512;

/// The stream to a client. Its raw bytes are read elsewhere.
#[derive(Debug)]
pub(super) enum ClientStream {
    /// Plain.
    Plain(OwnedWriteHalf),
    /// Plain, to a tool in this process.
    Tool(unix::OwnedWriteHalf),
    /// Plain, to the thread of a serial port.
    Master(unix::OwnedWriteHalf, PortMaster),
    /// Through TLS.
    Secured(Box<SecuredStream>),
}

/// The master at a serial port.
#[derive(Clone, Copy, Debug)]
pub struct PortMaster {
    /// Its name, by which it owns control.
    pub name: CommanderName,
    /// How long it waits.
    pub answer_within: Duration,
}

/// A socket with its TLS session.
#[derive(Debug)]
pub(super) struct SecuredStream {
    socket: OwnedWriteHalf,
    session: RefCell<ServerConnection>,
}

impl ClientStream {
    /// What the client may use.
    pub fn limits(&self) -> ConnectionLimits {
        match self {
            Self::Master(_, master) => ConnectionLimits {
                read_within: master.answer_within,
                ..ConnectionLimits::default()
            },
            _ => ConnectionLimits::default(),
        }
    }

    /// Who the client is, if it has no certificate and comes from `peer`.
    pub fn owner_at(&self, peer: IpAddr) -> Owner {
        match self {
            Self::Master(_, master) => Owner::ModbusRtu(master.name),
            _ => Owner::ModbusTcp(peer.to_canonical()),
        }
    }

    /// Decrypts `bytes` and passes the plain text to `take`, in pieces, including what was left from before.
    ///
    /// # Errors
    /// The client ended the session, or the bytes are not valid TLS.
    pub fn open(&self, bytes: &[u8], mut take: impl FnMut(&[u8])) -> io::Result<()> {
        match self {
            Self::Plain(_) | Self::Tool(_) | Self::Master(..) => {
                take(bytes);
                Ok(())
            }
            Self::Secured(secured) => secured.open(bytes, take),
        }
    }

    /// Writes as much of the output of `machine` as the socket takes.
    ///
    /// # Errors
    /// The socket's.
    pub fn flush(&self, machine: &mut ModbusConnection) -> io::Result<()> {
        match self {
            Self::Plain(socket) => write_output(machine, |bytes| socket.try_write(bytes)),
            Self::Tool(socket) | Self::Master(socket, _) => {
                write_output(machine, |bytes| socket.try_write(bytes))
            }
            Self::Secured(secured) => secured.flush(machine),
        }
    }

    /// Whether bytes wait for the socket beside the output of the machine.
    pub fn wants_write(&self) -> bool {
        match self {
            Self::Plain(_) | Self::Tool(_) | Self::Master(..) => false,
            Self::Secured(secured) => secured.session.borrow().wants_write(),
        }
    }

    /// Waits until the socket is writable.
    ///
    /// # Errors
    /// The socket's.
    pub async fn writable(&self) -> io::Result<()> {
        match self {
            Self::Plain(socket) => socket.writable().await,
            Self::Tool(socket) | Self::Master(socket, _) => socket.writable().await,
            Self::Secured(secured) => secured.socket.writable().await,
        }
    }

    /// Sends the client the end of the session, as far as the socket takes it at once.
    pub fn close(&self) {
        if let Self::Secured(secured) = self {
            secured.session.borrow_mut().send_close_notify();
            // The connection is closed in any case.
            let _ = secured.send();
        }
    }
}

/// Writes as much of the output of `machine` as `try_write` takes.
fn write_output(
    machine: &mut ModbusConnection,
    try_write: impl Fn(&[u8]) -> io::Result<usize>,
) -> io::Result<()> {
    while !machine.output().is_empty() {
        match try_write(machine.output()) {
            Ok(bytes) => machine.wrote(bytes),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

impl SecuredStream {
    /// A stream with a session that has not begun.
    pub fn new(socket: OwnedWriteHalf, session: ServerConnection) -> Self {
        Self {
            socket,
            session: RefCell::new(session),
        }
    }

    /// Continues the handshake with received `bytes`, and sends the response as far as the socket takes it.
    ///
    /// # Errors
    /// Why the handshake failed: contains a [`rustls::Error`], or is the socket's.
    pub fn shake(&self, mut bytes: &[u8]) -> io::Result<()> {
        let mut session = self.session.borrow_mut();
        let mut result = Ok(());
        while result.is_ok() && !bytes.is_empty() {
            result = feed(&mut session, &mut bytes);
        }
        drop(session);
        // After a failure this is the alert with the reason.
        let sent = self.send();
        result.and(sent)
    }

    /// Whether the handshake is complete and all of it is sent.
    pub fn is_ready(&self) -> bool {
        let session = self.session.borrow();
        !session.is_handshaking() && !session.wants_write()
    }

    /// Whether bytes wait for the socket.
    pub fn wants_write(&self) -> bool {
        self.session.borrow().wants_write()
    }

    /// Waits until the socket is writable.
    ///
    /// # Errors
    /// The socket's.
    pub async fn writable(&self) -> io::Result<()> {
        self.socket.writable().await
    }

    /// Applies `look` to the client's certificate.
    pub fn with_certificate<T>(&self, look: impl FnOnce(&[u8]) -> T) -> Option<T> {
        let session = self.session.borrow();
        session.peer_certificates()?.first().map(|der| look(der))
    }

    fn open(&self, mut bytes: &[u8], mut take: impl FnMut(&[u8])) -> io::Result<()> {
        let mut session = self.session.borrow_mut();
        let mut plain = [0; READ_BYTES];
        loop {
            match session.reader().read(&mut plain) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(read) => take(plain.get(..read).unwrap_or_default()),
                Err(error) if error.kind() != io::ErrorKind::WouldBlock => return Err(error),
                Err(_) if bytes.is_empty() => return Ok(()),
                Err(_) => feed(&mut session, &mut bytes)?,
            }
        }
    }

    /// Little is encrypted in advance, so that a client that does not read costs no more memory than one without TLS.
    fn flush(&self, machine: &mut ModbusConnection) -> io::Result<()> {
        loop {
            if !machine.output().is_empty() {
                let taken = self.session.borrow_mut().writer().write(machine.output())?;
                machine.wrote(taken);
            }
            self.send()?;
            if machine.output().is_empty() || self.wants_write() {
                return Ok(());
            }
        }
    }

    /// Sends what is encrypted, as far as the socket takes it.
    fn send(&self) -> io::Result<()> {
        let mut session = self.session.borrow_mut();
        while session.wants_write() {
            match session.write_tls(&mut NonblockingSocket(&self.socket)) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// Feeds some of `bytes` to the session.
fn feed(session: &mut ServerConnection, bytes: &mut &[u8]) -> io::Result<()> {
    if session.read_tls(bytes)? == 0 {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    let processed = session.process_new_packets();
    processed
        .map(|_| ())
        .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
}

/// A socket whose writes do not block.
struct NonblockingSocket<'s>(&'s OwnedWriteHalf);

impl Write for NonblockingSocket<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.try_write(bytes)
    }

    fn write_vectored(&mut self, slices: &[IoSlice<'_>]) -> io::Result<usize> {
        self.0.try_write_vectored(slices)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
