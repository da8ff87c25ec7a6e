//! Pseudo-terminals, through which a simulated line is reached.

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// A pseudo-terminal in raw mode. [`Pty::path`] can be opened as a serial port.
#[derive(Debug)]
pub struct Pty {
    master: OwnedFd,
    path: PathBuf,
    /// Kept open, so that the master end does not fail while no other process has the port open.
    slave: File,
    link: Option<PathBuf>,
}

impl Pty {
    /// A new pseudo-terminal. Child processes do not inherit it: it would outlive this value.
    ///
    /// # Errors
    /// The system's refusal.
    pub fn new() -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let name = ptsname(&master, Vec::new())?;
        let path = PathBuf::from(std::ffi::OsString::from_vec(name.into_bytes()));
        let noctty = i32::try_from(rustix::fs::OFlags::NOCTTY.bits()).unwrap_or(0);
        let slave = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(noctty)
            .open(&path)?;
        let mut settings = tcgetattr(&slave)?;
        settings.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &settings)?;
        rustix::io::ioctl_fionbio(&master, true)?;
        Ok(Self {
            master,
            path,
            slave,
            link: None,
        })
    }

    /// Makes the port reachable as `link` too, replacing a link that an earlier run left behind.
    ///
    /// # Errors
    /// The system's refusal, or something other than a link exists there.
    pub fn link_as(&mut self, link: &Path) -> io::Result<()> {
        match std::fs::symlink_metadata(link) {
            Ok(found) if found.is_symlink() => std::fs::remove_file(link)?,
            Ok(_) => return Err(io::ErrorKind::AlreadyExists.into()),
            Err(_) => {}
        }
        std::os::unix::fs::symlink(&self.path, link)?;
        self.link = Some(link.to_owned());
        Ok(())
    }

    /// The device to open as a serial port.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Speed in bit/s and stop bits as set by the process that has the port open. A pseudo-terminal does not keep
    /// parity.
    ///
    /// # Errors
    /// The system's refusal.
    pub fn speed(&self) -> io::Result<(u32, u8)> {
        let settings = tcgetattr(&self.slave)?;
        let stop_bits = if settings.control_modes.contains(ControlModes::CSTOPB) {
            2
        } else {
            1
        };
        Ok((settings.output_speed(), stop_bits))
    }

    /// The end of the simulated drives; it never blocks.
    #[must_use]
    pub const fn master(&self) -> &OwnedFd {
        &self.master
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        if let Some(link) = &self.link
            // A newer simulator may have replaced the link.
            && std::fs::read_link(link).is_ok_and(|target| target == self.path)
        {
            // It may be gone already.
            let _ = std::fs::remove_file(link);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::event::{PollFd, PollFlags, poll};
    use rustix::time::Timespec;
    use std::process::{Command, Stdio};

    #[test]
    fn it_ends_with_its_owner_whichever_process_was_started_meanwhile() {
        let pty = Pty::new().unwrap();
        let flags = rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::NOCTTY;
        let port = rustix::fs::open(pty.path(), flags, rustix::fs::Mode::empty()).unwrap();
        let mut child = Command::new("sleep")
            .arg("10")
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        drop(pty);
        // A child process that another test is starting holds it until it runs.
        let mut fds = [PollFd::new(&port, PollFlags::IN)];
        poll(
            &mut fds,
            Some(&Timespec {
                tv_sec: 5,
                tv_nsec: 0,
            }),
        )
        .unwrap();
        let mut byte = [0];
        let read = rustix::io::read(&port, &mut byte);
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(read, Ok(0), "hung up");
    }
}
