//! The serial port of a line: opened, its settings read back, read and written without ever blocking.

use super::sys;
use crate::domain::link::{LinkSettings, Parity, PortKind};
use mio_serial::SerialStream;
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::Path;
use std::task::{Context, Poll, ready};
use tokio::io::unix::AsyncFd;
use tokio_serial::{DataBits, SerialPort, StopBits};

/// Major device numbers of the slave sides of Unix 98 pseudo-terminals (Linux, Documentation/admin-guide/devices.txt).
const PTY_MAJORS: std::ops::RangeInclusive<u32> = 136..=143;

/// An open port.
///
/// It is `tokio-serial`'s own foundation, `mio-serial`, registered with tokio for reading only. `tokio-serial`
/// itself asks to be told of writing too, and each frame that goes out would wake the line thread twice for
/// nothing.
#[derive(Debug)]
pub struct Port {
    stream: AsyncFd<SerialStream>,
    kind: PortKind,
}

/// Why a port could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The system refused.
    #[error("{0}")]
    Refused(tokio_serial::Error),
    /// Something could not be asked of the device.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The device took other settings than it was given.
    #[error("the device does not take {wanted}: it is set to {held}")]
    Settings {
        /// As configured.
        wanted: LinkSettings,
        /// As read back.
        held: String,
    },
    /// A shorter silence than the models need, on something that is not a pseudo-terminal.
    #[error("`silence` is shorter than the drives need; that is allowed only on a pseudo-terminal, for tests")]
    SilenceTooShort,
}

impl Port {
    /// Opens the device at `path` for this process alone and reads its settings back.
    ///
    /// # Errors
    /// [`OpenError`] says what the system, the device or the configuration objects to.
    pub fn open(path: &Path, link: LinkSettings, needs_pty: bool) -> Result<Self, OpenError> {
        if needs_pty && !is_pty(path)? {
            return Err(OpenError::SilenceTooShort);
        }
        let builder = tokio_serial::new(path.to_string_lossy(), link.baud)
            .data_bits(if link.data_bits == 7 { DataBits::Seven } else { DataBits::Eight })
            .parity(match link.parity {
                Parity::None => tokio_serial::Parity::None,
                Parity::Even => tokio_serial::Parity::Even,
                Parity::Odd => tokio_serial::Parity::Odd,
            })
            .stop_bits(if link.stop_bits == 2 { StopBits::Two } else { StopBits::One });
        let stream = SerialStream::open(&builder).map_err(OpenError::Refused)?;
        let kind = if is_pty(path)? { PortKind::Virtual } else { PortKind::Serial };
        check_settings(&stream, link, kind == PortKind::Virtual)?;
        stream.clear(tokio_serial::ClearBuffer::All).map_err(OpenError::Refused)?;
        Ok(Self { stream: sys::readable(stream)?, kind })
    }

    /// What it is.
    #[must_use]
    pub const fn kind(&self) -> PortKind {
        self.kind
    }

    /// Ready once something has come since the last time. Whoever is told reads with [`Port::read_now`] until
    /// there is nothing more; what comes after that is told anew.
    pub fn poll_readable(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(self.stream.poll_read_ready_mut(cx))?.clear_ready();
        Poll::Ready(Ok(()))
    }

    /// Reads what is there this very moment, whatever the runtime has noticed so far; nothing if the line is
    /// quiet. Zero bytes mean that the device is gone.
    ///
    /// # Errors
    /// As the device reports.
    pub fn read_now(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>> {
        match self.stream.get_mut().read(buffer) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Hands a whole frame over. The longest frame is far smaller than any port's buffer, so one that
    /// does not fit means that the device takes no bytes.
    ///
    /// # Errors
    /// As the device reports; `WriteZero` if it took only a part.
    pub fn write_frame(&mut self, frame: &[u8]) -> io::Result<()> {
        match self.stream.get_mut().write(frame)? {
            bytes if bytes == frame.len() => Ok(()),
            _ => Err(io::ErrorKind::WriteZero.into()),
        }
    }
}

/// Whether `path` leads to a pseudo-terminal.
fn is_pty(path: &Path) -> io::Result<bool> {
    let metadata = std::fs::metadata(path)?;
    Ok(metadata.file_type().is_char_device() && PTY_MAJORS.contains(&rustix::fs::major(metadata.rdev())))
}

/// Reads the settings back. A pseudo-terminal carries whole bytes without parity whatever it is told (Linux,
/// `pty_set_termios`), and no character has a form there.
fn check_settings(stream: &SerialStream, wanted: LinkSettings, on_pty: bool) -> Result<(), OpenError> {
    let baud = stream.baud_rate().map_err(OpenError::Refused)?;
    let data_bits = stream.data_bits().map_err(OpenError::Refused)?;
    let parity = stream.parity().map_err(OpenError::Refused)?;
    let stop_bits = stream.stop_bits().map_err(OpenError::Refused)?;
    let same_parity = matches!(
        (parity, wanted.parity),
        (tokio_serial::Parity::None, Parity::None)
            | (tokio_serial::Parity::Even, Parity::Even)
            | (tokio_serial::Parity::Odd, Parity::Odd)
    );
    let same_characters = u8::from(data_bits) == wanted.data_bits && same_parity;
    let fits = baud == wanted.baud && u8::from(stop_bits) == wanted.stop_bits && (same_characters || on_pty);
    let held = || format!("{baud} bit/s, {data_bits} data bits, parity {parity}, {stop_bits} stop bits");
    if fits { Ok(()) } else { Err(OpenError::Settings { wanted, held: held() }) }
}

#[cfg(test)]
mod tests {
    use super::super::pty::Pty;
    use super::*;

    #[tokio::test]
    async fn a_pseudo_terminal_serves_for_every_form_of_characters() {
        let pty = Pty::new().unwrap();
        let link = LinkSettings::DEFAULT;
        for link in [link, LinkSettings { data_bits: 7, parity: Parity::Even, ..link }] {
            assert!(Port::open(pty.path(), link, true).is_ok(), "{link}");
        }
    }

    #[tokio::test]
    async fn a_port_that_is_not_there_is_told_as_the_system_tells_it() {
        let missing = Port::open(Path::new("/dev/no-such-port"), LinkSettings::DEFAULT, false);
        assert!(matches!(missing, Err(OpenError::Refused(_))), "{missing:?}");
    }
}
