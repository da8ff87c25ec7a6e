//! Settings of the driver of a serial device: turning the direction of an RS-485 transceiver, and delivering received
//! bytes at once.

use crate::daemon::host::sys;
use rustix::io::Errno;
use std::io;
use std::os::fd::BorrowedFd;
use std::path::Path;

/// Factory setting of FTDI adapters: they hold bytes back for this long.
const FTDI_LATENCY_MS: u32 = 16;

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
            now.flags(),
            wanted.flags()
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
        "`rs485 = \"kernel\"` needs {call}: {why}; use \"adapter\" where the adapter turns the \
         direction itself, as USB adapters do, or \"rts\" where its direction hangs on RTS"
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
    fn a_driver_without_rs485_is_reported_with_the_call_and_what_would_be_right() {
        let pty = Pty::new().unwrap();
        let port = std::fs::File::open(pty.path()).unwrap();
        let reason = turn_direction(port.as_fd()).unwrap_err();
        for part in [
            "TIOCSRS485",
            "does not support it",
            "\"adapter\"",
            "\"rts\"",
        ] {
            assert!(reason.contains(part), "{reason}");
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
    fn an_adapter_that_holds_bytes_back_is_reported_with_what_to_do() {
        let file = Path::new("/sys/class/tty/ttyUSB0/device/latency_timer");
        let text = latency_text("16\n", file).unwrap();
        assert!(
            text.contains("16 ms") && text.contains("write 1 to /sys/class/tty/ttyUSB0/device"),
            "{text}"
        );
        assert_eq!(latency_text("1\n", file), None);
        assert_eq!(latency_text("", file), None);
        assert_eq!(latency_remark(Path::new("/dev/no-such-port")), None);
    }
}
