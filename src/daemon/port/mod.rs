//! The port of a line: a serial device, or a connection to a serial device server or a Modbus TCP server, read and written
//! without ever blocking.

mod attempts;
mod driver;
mod lock;
mod refused;
mod serial;
mod tcp;

pub use attempts::OpenBackoff;

use crate::config::PortAddress;
use crate::domain::link::{DirectionControl, LinkSettings, PortKind};
use refused::RefusalAdvice;
use serial::SerialPort;
use std::io;
use std::path::PathBuf;
use std::task::{Context, Poll};
use tcp::{AddressLookup, TcpPort};

/// Which port is opened, and how.
#[derive(Clone, Debug)]
pub struct PortSettings {
    /// Name of the line, for its lock file.
    pub line: String,
    /// Where it is.
    pub address: PortAddress,
    /// Speed and character format.
    pub link: LinkSettings,
    /// What controls the direction.
    pub direction: DirectionControl,
    /// Whether the driver is asked to deliver received bytes at once.
    pub low_latency: bool,
    /// Whether serial devices are refused, because the silence is shorter than the models need.
    pub needs_virtual: bool,
    /// Directories for the lock file of a device; the first that can be written is used.
    pub lock_dirs: Vec<PathBuf>,
}

/// Opens one port again and again.
#[derive(Debug)]
pub struct PortOpener<'a> {
    settings: &'a PortSettings,
    lookup: AddressLookup,
    advice: RefusalAdvice,
}

/// An open port.
#[derive(Debug)]
pub enum OpenPort {
    /// A device of this host.
    Serial(SerialPort),
    /// A connection.
    Tcp(TcpPort),
    /// No connection to a Modbus TCP server, which closed the last one: the next frame makes another one.
    Parked,
}

/// Why a port could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The system refused, or a setting of the device could not be read or written.
    #[error("{0}")]
    Refused(#[from] io::Error),
    /// Another process uses the device.
    #[error("{0}")]
    Taken(#[from] lock::HeldPort),
    /// The device did not accept its settings.
    #[error("the device does not take {wanted}: it is set to {held}")]
    Settings {
        /// The settings as configured.
        wanted: LinkSettings,
        /// The settings as read back.
        held: String,
    },
    /// The driver cannot turn the direction as configured.
    #[error("{0}")]
    Direction(String),
    /// A shorter silence than the models need, on a serial device.
    #[error(
        "`silence` is shorter than the drives need; that is allowed only on a pseudo-terminal or `tcp://`, for tests"
    )]
    SilenceTooShort,
    /// No connection to the device server, or to the Modbus TCP server.
    #[error("{0}")]
    NoConnection(String),
}

impl<'a> PortOpener<'a> {
    /// An opener for the port that `settings` describe.
    #[must_use]
    pub fn new(settings: &'a PortSettings) -> Self {
        Self {
            settings,
            lookup: AddressLookup::default(),
            advice: RefusalAdvice::default(),
        }
    }

    /// Opens the port. A device is opened at once; connecting takes a few seconds at most, without blocking.
    ///
    /// # Errors
    /// [`OpenError`] if the system, the device or the configuration does not allow it.
    pub async fn open(&mut self) -> Result<OpenPort, OpenError> {
        match &self.settings.address {
            PortAddress::Device(path) => {
                Ok(OpenPort::Serial(SerialPort::open(path, self.settings)?))
            }
            PortAddress::Tcp { host, port } | PortAddress::ModbusTcp { host, port } => Ok(
                OpenPort::Tcp(TcpPort::open(host, *port, &mut self.lookup).await?),
            ),
        }
    }

    /// Why the port could not be opened, and what to do about it.
    pub fn explain(&mut self, error: &OpenError) -> String {
        match (&self.settings.address, error) {
            (PortAddress::Device(path), OpenError::Refused(error)) => self.advice.of(path, error),
            _ => error.to_string(),
        }
    }
}

impl OpenPort {
    /// Its kind.
    #[must_use]
    pub const fn kind(&self) -> PortKind {
        match self {
            Self::Serial(port) => port.kind(),
            Self::Tcp(_) | Self::Parked => PortKind::Virtual,
        }
    }

    /// Warnings about this port for the log.
    #[must_use]
    pub fn remark(&self) -> Option<&str> {
        match self {
            Self::Serial(port) => port.remark(),
            Self::Tcp(_) | Self::Parked => None,
        }
    }

    /// Whether there is no connection until the next frame.
    #[must_use]
    pub const fn is_parked(&self) -> bool {
        matches!(self, Self::Parked)
    }

    /// Closes it until the next frame.
    pub fn park(&mut self) {
        *self = Self::Parked;
    }

    /// Ready once bytes have arrived since the last time. The caller then reads with [`OpenPort::read_now`] until it is
    /// empty; later bytes make it ready again.
    pub fn poll_readable(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self {
            Self::Serial(port) => port.poll_readable(cx),
            Self::Tcp(port) => port.poll_readable(cx),
            Self::Parked => Poll::Pending,
        }
    }

    /// Reads the bytes that are available right now, whatever the runtime has noticed so far; `None` if there are none.
    /// Zero bytes mean that the device is gone.
    ///
    /// # Errors
    /// As the device reports.
    pub fn read_now(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>> {
        let read = match self {
            Self::Serial(port) => port.read(buffer),
            Self::Tcp(port) => port.read(buffer),
            Self::Parked => return Ok(None),
        };
        match read {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
                ) =>
            {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// Writes a whole frame. The longest frame is far smaller than any port's buffer, so one that does not fit means
    /// that the device accepts no bytes.
    ///
    /// # Errors
    /// As the device reports; `WriteZero` if it accepted only a part.
    pub fn write_frame(&mut self, frame: &[u8]) -> io::Result<()> {
        match self {
            Self::Serial(port) => port.write_frame(frame),
            Self::Tcp(port) => all_of(frame, port.write(frame)?),
            Self::Parked => Err(io::ErrorKind::NotConnected.into()),
        }
    }
}

/// Success if all of `frame` was accepted.
fn all_of(frame: &[u8], taken: usize) -> io::Result<()> {
    if taken == frame.len() {
        Ok(())
    } else {
        Err(io::ErrorKind::WriteZero.into())
    }
}
