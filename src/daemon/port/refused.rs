//! Why a serial device cannot be opened, in words that say what to do.

use crate::daemon::host::adapters;
use rustix::io::Errno;
use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// After so many attempts that fail in the same way the advice is worked out again: an adapter may have been plugged in.
const ATTEMPTS_PER_ADVICE: u32 = 25;

/// The words for the last refusal. To find them takes longer than an attempt to open the port.
#[derive(Debug, Default)]
pub(super) struct RefusalAdvice {
    errno: Option<i32>,
    words: String,
    attempts: u32,
}

impl RefusalAdvice {
    /// The words for `error`, with which the system refused the device at `path`.
    pub fn of(&mut self, path: &Path, error: &io::Error) -> String {
        let is_same = self.errno.is_some() && self.errno == error.raw_os_error();
        if is_same && self.attempts < ATTEMPTS_PER_ADVICE {
            self.attempts += 1;
        } else {
            *self = Self {
                errno: error.raw_os_error(),
                words: words(path, error),
                attempts: 1,
            };
        }
        self.words.clone()
    }
}

/// The error behind a refusal of `tokio-serial`, which drops its number.
pub(super) fn error_of(device: &Path, refusal: tokio_serial::Error) -> io::Error {
    let flags = i32::try_from((rustix::fs::OFlags::NOCTTY | rustix::fs::OFlags::NONBLOCK).bits())
        .unwrap_or(0);
    match OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags)
        .open(device)
    {
        Err(error) => error,
        Ok(file) if !rustix::termios::isatty(&file) => Errno::NOTTY.into(),
        Ok(_) => refusal.into(),
    }
}

fn words(path: &Path, error: &io::Error) -> String {
    match error.raw_os_error().map(Errno::from_raw_os_error) {
        Some(Errno::NOENT) => format!("there is no such device; {}", offered(&adapters::names())),
        Some(Errno::ACCESS | Errno::PERM) => not_allowed(&adapters::group_of(path)),
        Some(Errno::BUSY) => in_use(&adapters::holders_of(path)),
        Some(Errno::IO | Errno::NXIO | Errno::NODEV) => {
            "there is no hardware behind this device".to_owned()
        }
        Some(Errno::NOTTY | Errno::ISDIR | Errno::INVAL | Errno::NOTDIR) => {
            "this is not a serial device".to_owned()
        }
        _ => error.to_string(),
    }
}

fn offered(names: &[String]) -> String {
    match names {
        [] => {
            "this host has no serial port: plug the adapter in, or pass its device to the container"
                .to_owned()
        }
        names => format!("serial ports of this host: {}", names.join(", ")),
    }
}

fn not_allowed(group: &str) -> String {
    format!(
        "permission denied: the device belongs to the group {group}; add the user of the gateway to it (usermod -aG \
         {group} USER, then a new start), or the group to the container"
    )
}

fn in_use(holders: &[String]) -> String {
    let by = if holders.is_empty() {
        "another program".to_owned()
    } else {
        holders.join(", ")
    };
    format!("in use by {by}; stop it, or give this line a port of its own")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(errno: Errno) -> String {
        words(Path::new("/dev/no-such-port"), &errno.into())
    }

    #[test]
    fn each_refusal_says_what_to_do() {
        assert!(said(Errno::NOENT).starts_with("there is no such device; "));
        assert!(said(Errno::BUSY).contains("in use by another program; stop it"));
        assert!(said(Errno::IO).contains("no hardware"));
        assert!(said(Errno::NOTTY).contains("not a serial device"));
        assert_eq!(
            said(Errno::MFILE),
            io::Error::from(Errno::MFILE).to_string()
        );
        assert!(not_allowed("dialout").contains("usermod -aG dialout USER"));
        assert!(
            in_use(&["minicom (process 42)".to_owned()]).contains("in use by minicom (process 42)")
        );
        assert!(
            offered(&["/dev/ttyUSB0".to_owned()])
                .ends_with("serial ports of this host: /dev/ttyUSB0")
        );
        assert!(offered(&[]).contains("has no serial port"));
    }

    #[test]
    fn the_advice_is_made_again_for_another_error_and_after_many_attempts() {
        let mut advice = RefusalAdvice::default();
        let path = Path::new("/dev/no-such-port");
        let missing = advice.of(path, &Errno::NOENT.into());
        assert_eq!(advice.of(path, &Errno::NOENT.into()), missing);
        assert_eq!(advice.attempts, 2);
        assert_ne!(advice.of(path, &Errno::BUSY.into()), missing);
        assert_eq!(advice.attempts, 1);
        for _ in 0..ATTEMPTS_PER_ADVICE {
            advice.of(path, &Errno::BUSY.into());
        }
        assert_eq!(advice.attempts, 1);
    }
}
