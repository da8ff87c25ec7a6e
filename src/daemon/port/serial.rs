//! A serial device: locked, opened, its settings read back, its direction turned.

use super::lock::{self, PortLock};
use super::{OpenError, PortSettings, all_of, driver, refused};
use crate::daemon::host::clock;
use crate::daemon::host::sys;
use crate::domain::link::{DirectionControl, LinkSettings, Parity, PortKind};
use crate::domain::time::MonoTime;
use mio_serial::SerialStream;
use std::io::{self, Read, Write};
use std::os::fd::BorrowedFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::Path;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::unix::AsyncFd;
use tokio_serial::{ClearBuffer, DataBits, SerialPort as _, StopBits};

/// Major device numbers of the slave sides of Unix 98 pseudo-terminals (Linux, Documentation/admin-guide/devices.txt).
const PTY_MAJORS: std::ops::RangeInclusive<u32> = 136..=143;
/// How much later than requested a transmitter may begin: a USB adapter gets its bytes with the next frame of the bus.
const BEGINS_LATE_MAX: Duration = Duration::from_millis(1);
/// How long a transmitter that should have finished is polled.
const ENDS_LATE_MAX: Duration = Duration::from_millis(20);

/// An open device.
///
/// It is `tokio-serial`'s own foundation, `mio-serial`, registered with tokio for reading only. `tokio-serial` itself
/// also registers for writing, and each sent frame would wake the line thread twice for nothing.
#[derive(Debug)]
pub struct SerialPort {
    stream: AsyncFd<SerialStream>,
    kind: PortKind,
    link: LinkSettings,
    sets_rts: bool,
    remark: Option<String>,
    /// Declared after the device, so that it is released after the device is closed.
    _lock: Option<PortLock>,
}

impl SerialPort {
    /// Opens the device at `path` exclusively and reads its settings back.
    pub(super) fn open(path: &Path, settings: &PortSettings) -> Result<Self, OpenError> {
        // Links are resolved once, so that the locked device is the opened one, and again at each attempt: they may
        // change when an adapter is replugged.
        let device = path.canonicalize()?;
        let is_pty = is_pty(&device)?;
        if settings.needs_virtual && !is_pty {
            return Err(OpenError::SilenceTooShort);
        }
        let lock = lock::lock(&device, &settings.line, &settings.lock_dirs)?;
        let link = settings.link;
        let builder = tokio_serial::new(device.to_string_lossy(), link.baud)
            .data_bits(if link.data_bits == 7 {
                DataBits::Seven
            } else {
                DataBits::Eight
            })
            .parity(match link.parity {
                Parity::None => tokio_serial::Parity::None,
                Parity::Even => tokio_serial::Parity::Even,
                Parity::Odd => tokio_serial::Parity::Odd,
            })
            .stop_bits(if link.stop_bits == 2 {
                StopBits::Two
            } else {
                StopBits::One
            });
        let stream =
            SerialStream::open(&builder).map_err(|refusal| refused::error_of(&device, refusal))?;
        check_settings(&stream, link, is_pty)?;
        let mut port = Self {
            stream: sys::readable(stream)?,
            kind: if is_pty {
                PortKind::Virtual
            } else {
                PortKind::Serial
            },
            link,
            sets_rts: settings.direction == DirectionControl::Rts,
            remark: None,
            _lock: lock,
        };
        port.set_up(&device, settings)?;
        port.stream
            .get_ref()
            .clear(ClearBuffer::All)
            .map_err(io::Error::from)?;
        Ok(port)
    }

    fn set_up(&mut self, device: &Path, settings: &PortSettings) -> Result<(), OpenError> {
        match settings.direction {
            DirectionControl::Adapter => {}
            DirectionControl::Kernel => {
                driver::turn_direction(self.fd()).map_err(OpenError::Direction)?
            }
            DirectionControl::Rts => self.set_rts(false).map_err(|error| {
                OpenError::Direction(format!(
                    "`rs485 = \"rts\"` needs a port with the line RTS (TIOCMBIC): {error}; use \
                     \"adapter\" where the adapter turns the direction itself"
                ))
            })?,
        }
        if settings.low_latency
            && let Err(error) = driver::ask_for_low_latency(self.fd())
        {
            self.remark = Some(format!(
                "the driver refuses low latency (TIOCSSERIAL): {error}"
            ));
        }
        self.remark = driver::latency_remark(device).or(self.remark.take());
        Ok(())
    }

    pub(super) const fn kind(&self) -> PortKind {
        self.kind
    }

    pub(super) fn remark(&self) -> Option<&str> {
        self.remark.as_deref()
    }

    pub(super) fn poll_readable(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(self.stream.poll_read_ready_mut(cx))?.clear_ready();
        Poll::Ready(Ok(()))
    }

    pub(super) fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.stream.get_mut().read(buffer)
    }

    /// Writes a whole frame; if the gateway turns the direction, it returns once that is turned back.
    pub(super) fn write_frame(&mut self, frame: &[u8]) -> io::Result<()> {
        if !self.sets_rts {
            return self.write(frame);
        }
        self.set_rts(true)?;
        let begun = clock::now();
        let written = self
            .write(frame)
            .map(|()| self.wait_until_sent(begun + self.link.bytes(frame.len())));
        written.and(self.set_rts(false))
    }

    fn write(&mut self, frame: &[u8]) -> io::Result<()> {
        let taken = self.stream.get_mut().write(frame)?;
        all_of(frame, taken)
    }

    /// Waits until the last bit is sent, which is expected at `end`, and at most 20 ms longer. Blocks on purpose: doing
    /// other work meanwhile could release the line too late, on top of the reply, and while a frame is being sent
    /// nothing else can be sent or received.
    fn wait_until_sent(&self, end: MonoTime) {
        std::thread::sleep(end.since(clock::now()));
        while clock::now() < end + ENDS_LATE_MAX {
            match sys::is_sent(self.fd()) {
                Ok(true) => return,
                Ok(false) => std::thread::yield_now(),
                // A driver that cannot tell.
                Err(_) => return std::thread::sleep((end + BEGINS_LATE_MAX).since(clock::now())),
            }
        }
    }

    fn set_rts(&mut self, is_set: bool) -> io::Result<()> {
        self.stream
            .get_mut()
            .write_request_to_send(is_set)
            .map_err(io::Error::from)
    }

    fn fd(&self) -> BorrowedFd<'_> {
        sys::borrowed(self.stream.get_ref())
    }
}

impl Drop for SerialPort {
    fn drop(&mut self) {
        // Unsent bytes in a device that accepts none would delay its close by up to 30 s. A device that is gone has
        // none.
        let _ = self.stream.get_ref().clear(ClearBuffer::All);
    }
}

/// Whether `path` leads to a pseudo-terminal.
fn is_pty(path: &Path) -> io::Result<bool> {
    let metadata = std::fs::metadata(path)?;
    Ok(metadata.file_type().is_char_device()
        && PTY_MAJORS.contains(&rustix::fs::major(metadata.rdev())))
}

/// Reads the settings back. A pseudo-terminal carries whole bytes without parity whatever is set (Linux,
/// `pty_set_termios`), so the character format does not matter there.
fn check_settings(
    stream: &SerialStream,
    wanted: LinkSettings,
    on_pty: bool,
) -> Result<(), OpenError> {
    let baud = stream.baud_rate().map_err(io::Error::from)?;
    let data_bits = stream.data_bits().map_err(io::Error::from)?;
    let parity = stream.parity().map_err(io::Error::from)?;
    let stop_bits = stream.stop_bits().map_err(io::Error::from)?;
    let same_parity = matches!(
        (parity, wanted.parity),
        (tokio_serial::Parity::None, Parity::None)
            | (tokio_serial::Parity::Even, Parity::Even)
            | (tokio_serial::Parity::Odd, Parity::Odd)
    );
    let same_characters = u8::from(data_bits) == wanted.data_bits && same_parity;
    let fits = baud == wanted.baud
        && u8::from(stop_bits) == wanted.stop_bits
        && (same_characters || on_pty);
    let held =
        || format!("{baud} bit/s, {data_bits} data bits, parity {parity}, {stop_bits} stop bits");
    if fits {
        Ok(())
    } else {
        Err(OpenError::Settings {
            wanted,
            held: held(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::PortAddress;
    use crate::daemon::host::pty::Pty;
    use std::path::PathBuf;

    fn settings(path: &Path) -> PortSettings {
        PortSettings {
            line: "hall-1".to_owned(),
            address: PortAddress::Device(path.to_owned()),
            link: LinkSettings::DEFAULT,
            direction: DirectionControl::Adapter,
            low_latency: true,
            needs_virtual: true,
            lock_dirs: vec![std::env::temp_dir()],
        }
    }

    fn opened(
        path: &Path,
        change: impl FnOnce(&mut PortSettings),
    ) -> Result<SerialPort, OpenError> {
        let mut settings = settings(path);
        change(&mut settings);
        SerialPort::open(path, &settings)
    }

    #[tokio::test]
    async fn a_pseudo_terminal_serves_for_every_form_of_characters() {
        let pty = Pty::new().unwrap();
        let link = LinkSettings::DEFAULT;
        for link in [
            link,
            LinkSettings {
                data_bits: 7,
                parity: Parity::Even,
                ..link
            },
        ] {
            let port = opened(pty.path(), |it| it.link = link).unwrap();
            assert_eq!(
                (port.kind(), port.remark()),
                (PortKind::Virtual, None),
                "{link}"
            );
        }
    }

    #[tokio::test]
    async fn a_port_that_is_not_there_is_reported_as_the_system_tells_it() {
        let missing = opened(Path::new("/dev/no-such-port"), |_| {})
            .unwrap_err()
            .to_string();
        assert!(missing.contains("No such file"), "{missing}");
    }

    #[tokio::test]
    async fn one_device_under_two_names_is_opened_once() {
        let mut pty = Pty::new().unwrap();
        let link = std::env::temp_dir().join(format!("vfd-port-{}", std::process::id()));
        pty.link_as(&link).unwrap();
        let first = opened(pty.path(), |_| {}).unwrap();
        let error = opened(&link, |it| it.line = "hall-2".to_owned()).unwrap_err();
        assert!(
            matches!(error, OpenError::Taken(_))
                && error.to_string().contains("line hall-1 of this gateway"),
            "{error}"
        );
        // Without a directory for lock files the system refuses.
        let error = opened(&link, |it| {
            it.lock_dirs = vec![PathBuf::from("/nonexistent")]
        })
        .unwrap_err();
        assert!(matches!(error, OpenError::Refused(_)), "{error}");
        drop(first);
        assert!(opened(&link, |_| {}).is_ok());
    }

    #[tokio::test]
    async fn a_port_that_cannot_turn_the_direction_is_reported_with_the_call() {
        let pty = Pty::new().unwrap();
        for (direction, call) in [
            (DirectionControl::Kernel, "TIOCSRS485"),
            (DirectionControl::Rts, "TIOCMBIC"),
        ] {
            let error = opened(pty.path(), |it| it.direction = direction).unwrap_err();
            let text = error.to_string();
            assert!(matches!(error, OpenError::Direction(_)), "{text}");
            assert!(
                text.contains(call) && text.contains("\"adapter\""),
                "{text}"
            );
        }
        assert!(
            opened(pty.path(), |_| {}).is_ok(),
            "nothing was left locked"
        );
    }

    #[tokio::test]
    async fn a_driver_that_does_not_tell_is_given_the_time_of_the_frame() {
        let pty = Pty::new().unwrap();
        let port = opened(pty.path(), |_| {}).unwrap();
        let begun = clock::now();
        port.wait_until_sent(begun + Duration::from_millis(5));
        let waited = clock::now().since(begun);
        assert!(
            waited >= Duration::from_millis(5) + BEGINS_LATE_MAX,
            "{waited:?}"
        );
    }
}
