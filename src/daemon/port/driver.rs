//! Settings of the driver of a serial device: turning the direction of an RS-485 transceiver, and delivering received
//! bytes at once.

use crate::daemon::host::sys;
use rustix::io::Errno;
use std::io;
use std::os::fd::BorrowedFd;
use std::path::Path;

/// `SER_RS485_ENABLED` (Linux, `linux/serial.h`).
const RS485_ENABLED: u32 = 1;
/// `SER_RS485_RTS_ON_SEND`: RTS is set while sending.
const RS485_RTS_ON_SEND: u32 = 1 << 1;
/// `SER_RS485_RTS_AFTER_SEND`: RTS is set while not sending, on boards that invert it.
const RS485_RTS_AFTER_SEND: u32 = 1 << 2;
/// `ASYNC_LOW_LATENCY` (Linux, `linux/tty_flags.h`).
const LOW_LATENCY: i32 = 1 << 13;
/// Factory setting of FTDI adapters: they hold bytes back for this long.
const FTDI_LATENCY_MS: u32 = 16;

/// `struct serial_rs485` (Linux, `linux/serial.h`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rs485 {
    flags: u32,
    delay_before_send_ms: u32,
    delay_after_send_ms: u32,
    rest: [u32; 5],
}

/// `struct serial_struct` (Linux, `linux/serial.h`). All fields but the flags are written back unchanged.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SerialInfo {
    kind: i32,
    line: i32,
    port: u32,
    irq: i32,
    flags: i32,
    xmit_fifo_size: i32,
    custom_divisor: i32,
    baud_base: i32,
    close_delay: u16,
    io_type: u8,
    reserved: u8,
    hub6: i32,
    closing_wait: [u16; 2],
    iomem_base: usize,
    iomem_reg_shift: u16,
    port_high: u32,
    iomap_base: usize,
}

impl Rs485 {
    /// Settings with the direction turned by the driver. A polarity that the board declares is kept; otherwise RTS is
    /// set while sending.
    const fn enabled(mut self) -> Self {
        self.flags |= RS485_ENABLED;
        if self.flags & (RS485_RTS_ON_SEND | RS485_RTS_AFTER_SEND) == 0 {
            self.flags |= RS485_RTS_ON_SEND;
        }
        self
    }

    const fn polarity(self) -> u32 {
        self.flags & (RS485_RTS_ON_SEND | RS485_RTS_AFTER_SEND)
    }

    /// Whether a driver that now holds `self` has accepted `wanted`.
    const fn does(self, wanted: Self) -> bool {
        self.flags & RS485_ENABLED != 0 && self.polarity() == wanted.polarity()
    }
}

/// Makes the driver turn the direction.
///
/// # Errors
/// Why it does not, with the name of the ioctl and the alternatives.
pub(super) fn turn_direction(fd: BorrowedFd<'_>) -> Result<(), String> {
    let refused = |call: &str, error: &io::Error| {
        let why = if is_unknown(error) {
            "the driver of this port does not support it".to_owned()
        } else {
            error.to_string()
        };
        not_by_kernel(call, &why)
    };
    let held = sys::rs485(fd).map_err(|error| refused("TIOCGRS485", &error))?;
    let wanted = held.enabled();
    sys::set_rs485(fd, &wanted).map_err(|error| refused("TIOCSRS485", &error))?;
    let now = sys::rs485(fd).map_err(|error| refused("TIOCGRS485", &error))?;
    if now.does(wanted) {
        return Ok(());
    }
    Err(not_by_kernel(
        "TIOCSRS485",
        &format!(
            "the driver keeps the flags {:#x} instead of {:#x}",
            now.flags, wanted.flags
        ),
    ))
}

/// The message names the ioctl that sets it, whichever of the two calls failed, since that is what users search for.
fn not_by_kernel(call: &str, why: &str) -> String {
    let call = if call == "TIOCSRS485" {
        call.to_owned()
    } else {
        format!("TIOCSRS485 (asked by {call})")
    };
    format!(
        "`rs485 = \"kernel\"` needs {call}: {why}; right is \"adapter\" where the adapter turns the direction itself, as \
         USB adapters do, or \"rts\" where its direction hangs on RTS"
    )
}

/// Asks the driver to deliver received bytes at once. Drivers without such a setting do not need it; the refusal of
/// others is returned.
pub(super) fn ask_for_low_latency(fd: BorrowedFd<'_>) -> io::Result<()> {
    let asked = sys::serial_info(fd).and_then(|info| match info.with_low_latency() {
        Some(wanted) => sys::set_serial_info(fd, &wanted),
        None => Ok(()),
    });
    match asked {
        Err(error) if is_unknown(&error) => Ok(()),
        asked => asked,
    }
}

impl SerialInfo {
    /// The settings to write; `None` if it is set already.
    const fn with_low_latency(mut self) -> Option<Self> {
        if self.flags & LOW_LATENCY != 0 {
            return None;
        }
        self.flags |= LOW_LATENCY;
        Some(self)
    }
}

/// Whether `error` means that the driver does not support the request.
fn is_unknown(error: &io::Error) -> bool {
    let code = error.raw_os_error().map(Errno::from_raw_os_error);
    matches!(
        code,
        Some(Errno::NOTTY | Errno::INVAL | Errno::OPNOTSUPP | Errno::NOSYS)
    )
}

/// A warning if the adapter behind `device` is known to hold received bytes back for too long.
pub(super) fn latency_remark(device: &Path) -> Option<String> {
    let file = Path::new("/sys/class/tty")
        .join(device.file_name()?)
        .join("device/latency_timer");
    latency_text(&std::fs::read_to_string(&file).ok()?, &file)
}

fn latency_text(content: &str, file: &Path) -> Option<String> {
    let ms: u32 = content.trim().parse().ok()?;
    (ms >= FTDI_LATENCY_MS).then(|| {
        format!(
            "the adapter holds received bytes back for up to {ms} ms, which makes every exchange longer: leave \
             `low_latency` on, or have a udev rule write 1 to {}",
            file.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::host::pty::Pty;
    use std::os::fd::AsFd;

    #[test]
    fn structures_have_the_size_that_the_kernel_expects() {
        assert_eq!(size_of::<Rs485>(), 32);
        assert_eq!(
            size_of::<SerialInfo>(),
            if size_of::<usize>() == 8 { 72 } else { 60 }
        );
    }

    #[test]
    fn rts_is_set_to_send_unless_the_board_says_otherwise() {
        let on = Rs485::default().enabled();
        assert_eq!(on.flags, 0b011);
        let inverted = Rs485 {
            flags: RS485_RTS_AFTER_SEND,
            delay_after_send_ms: 1,
            ..Rs485::default()
        };
        assert_eq!(
            inverted.enabled(),
            Rs485 {
                flags: 0b101,
                delay_after_send_ms: 1,
                ..Rs485::default()
            }
        );
        let with_more = Rs485 {
            flags: on.flags | 1 << 4,
            ..on
        };
        assert_eq!(with_more.enabled(), with_more);
    }

    #[test]
    fn a_driver_that_keeps_something_else_does_not_do_it() {
        let wanted = Rs485::default().enabled();
        assert!(wanted.does(wanted));
        assert!(
            Rs485 {
                flags: wanted.flags | 1 << 4,
                ..wanted
            }
            .does(wanted),
            "it may hear what it sends"
        );
        assert!(!Rs485::default().does(wanted), "off");
        assert!(
            !Rs485 {
                flags: RS485_ENABLED | RS485_RTS_AFTER_SEND,
                ..wanted
            }
            .does(wanted),
            "the other way round"
        );
    }

    #[test]
    fn a_driver_without_rs485_is_reported_with_the_call_and_what_would_be_right() {
        let pty = Pty::new().unwrap();
        let port = std::fs::File::open(pty.path()).unwrap();
        let told = turn_direction(port.as_fd()).unwrap_err();
        for part in [
            "TIOCSRS485",
            "does not support it",
            "\"adapter\"",
            "\"rts\"",
        ] {
            assert!(told.contains(part), "{told}");
        }
    }

    #[test]
    fn a_driver_without_latency_needs_none() {
        let pty = Pty::new().unwrap();
        let port = std::fs::File::open(pty.path()).unwrap();
        assert!(is_unknown(&sys::serial_info(port.as_fd()).unwrap_err()));
        ask_for_low_latency(port.as_fd()).unwrap();
        assert!(!is_unknown(&io::ErrorKind::PermissionDenied.into()));
        assert!(
            !is_unknown(&io::Error::from(Errno::IO)),
            "a device that is gone"
        );
    }

    #[test]
    fn the_flag_is_set_once_and_the_rest_stays() {
        let info = SerialInfo {
            flags: 0b1,
            irq: 4,
            iomap_base: 7,
            ..SerialInfo::default()
        };
        let wanted = info.with_low_latency().unwrap();
        assert_eq!(
            wanted,
            SerialInfo {
                flags: 0x2001,
                ..info
            }
        );
        assert_eq!(wanted.with_low_latency(), None);
    }

    #[test]
    fn an_adapter_that_holds_bytes_back_is_reported_with_what_to_do() {
        let file = Path::new("/sys/class/tty/ttyUSB0/device/latency_timer");
        let told = latency_text("16\n", file).unwrap();
        assert!(
            told.contains("16 ms") && told.contains("write 1 to /sys/class/tty/ttyUSB0/device"),
            "{told}"
        );
        assert_eq!(latency_text("1\n", file), None);
        assert_eq!(latency_text("", file), None);
        assert_eq!(latency_remark(Path::new("/dev/no-such-port")), None);
    }
}
