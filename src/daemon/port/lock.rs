//! A lock file for each serial device, as terminal programs use it: it names the user of the device.
//!
//! `/run/lock/LCK..ttyUSB0` contains the process id, the program and the line. Other programs read only the process id;
//! gateways rely on a lock on the file itself, which is released when its holder exits in any way.

use rustix::fs::{FlockOperation, OFlags, flock};
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The name of this program in its locks.
const PROGRAM: &str = "vfd-gateway";
/// Longest lock file that is read, in bytes; longer than any program writes.
const TEXT_MAX: u64 = 128;
/// How long a new holder of a lock has to write its name, at each attempt.
const TO_BE_NAMED: Duration = Duration::from_millis(2);
/// Attempts to lock a file that others remove at the same moment.
const ATTEMPTS: u32 = 4;

/// Exclusive use of a device while this exists.
#[derive(Debug)]
pub(super) struct PortLock {
    /// Held for its lock.
    _file: File,
    path: PathBuf,
}

/// Another process uses the device.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "in use by {holder} (lock file {}); stop it, or give this line a port of its own",
    path.display()
)]
pub struct HeldPort {
    holder: String,
    path: PathBuf,
}

/// Locks `device`, a path without symbolic links, for `line`, in the first directory of `dirs` that can be written.
/// `None` if there is none: then only the system keeps others from the device, without naming the holder.
pub(super) fn lock(
    device: &Path,
    line: &str,
    dirs: &[PathBuf],
) -> Result<Option<PortLock>, HeldPort> {
    lock_waiting(device, line, dirs, &mut || std::thread::sleep(TO_BE_NAMED))
}

/// Locks `device` for `line` in the first directory of `dirs` that can be written, and calls `wait` while a new holder
/// of the lock has not written its name yet. `None` if no directory can be written.
fn lock_waiting(
    device: &Path,
    line: &str,
    dirs: &[PathBuf],
    wait: &mut dyn FnMut(),
) -> Result<Option<PortLock>, HeldPort> {
    for dir in dirs {
        let path = dir.join(file_name(device));
        match take(&path, line, wait) {
            Ok(PortClaim::Ours(file)) => return Ok(Some(PortLock { _file: file, path })),
            Ok(PortClaim::Others(holder)) => return Err(HeldPort { holder, path }),
            Err(error) => {
                tracing::debug!(lock = %path.display(), %error, "cannot create the lock file")
            }
        }
    }
    Ok(None)
}

impl Drop for PortLock {
    fn drop(&mut self) {
        // Still locked, so it was not replaced by another process. It may be gone already.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// `LCK..ttyUSB0`, `LCK..pts_3`: the names that terminal programs use.
fn file_name(device: &Path) -> String {
    let name = device
        .strip_prefix("/dev")
        .unwrap_or(device)
        .to_string_lossy();
    format!("LCK..{}", name.trim_start_matches('/').replace('/', "_"))
}

enum PortClaim {
    Ours(File),
    Others(String),
}

/// Takes the lock at `path`, or returns its holder. An error means that this directory cannot be used.
fn take(path: &Path, line: &str, wait: &mut dyn FnMut()) -> io::Result<PortClaim> {
    let mut unnamed = false;
    for _ in 0..ATTEMPTS {
        let (mut file, is_ours_to_write) = match open(path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => continue,
            opened => opened?,
        };
        let holder = LockHolder::read(&mut file)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) if holder.process.is_some() => {
                return Ok(PortClaim::Others(holder.description()));
            }
            // Taken a moment ago: the holder is about to write its name.
            Err(rustix::io::Errno::WOULDBLOCK) => {
                unnamed = true;
                wait();
                continue;
            }
            Err(error) => return Err(error.into()),
        }
        if !is_at(&file, path)? {
            continue;
        }
        // A gateway would hold the lock on the file; other programs only leave their process id.
        if holder.program != PROGRAM && holder.is_alive() {
            return Ok(PortClaim::Others(holder.description()));
        }
        if !is_ours_to_write {
            std::fs::remove_file(path)?;
            continue;
        }
        file.set_len(0)?;
        file.rewind()?;
        file.write_all(format!("{:>10} {PROGRAM} {line}\n", std::process::id()).as_bytes())?;
        return Ok(PortClaim::Ours(file));
    }
    match unnamed {
        true => Ok(PortClaim::Others(LockHolder::parse("").description())),
        false => Err(ErrorKind::ResourceBusy.into()),
    }
}

/// Opens or creates the file at `path`, and returns whether it can be written. Never follows a link and never blocks,
/// whatever exists there.
fn open(path: &Path) -> io::Result<(File, bool)> {
    let flags = i32::try_from((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits()).unwrap_or(0);
    let options = |may_write: bool| {
        let mut options = OpenOptions::new();
        options
            .read(true)
            .write(may_write)
            .custom_flags(flags)
            .mode(0o644);
        options
    };
    match options(true).open(path) {
        Ok(file) => Ok((file, true)),
        Err(error) if error.kind() == ErrorKind::NotFound => options(true)
            .create_new(true)
            .open(path)
            .map(|file| (file, true)),
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            options(false).open(path).map(|it| (it, false))
        }
        Err(error) => Err(error),
    }
}

/// Whether `file` is still the file at `path`: its holder removes it at the end.
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    let ours = file.metadata()?;
    Ok(std::fs::symlink_metadata(path)
        .is_ok_and(|there| (there.dev(), there.ino()) == (ours.dev(), ours.ino())))
}

/// The contents of a lock file.
#[derive(Debug, PartialEq, Eq)]
struct LockHolder {
    process: Option<u32>,
    program: String,
    /// Additional text of the program: the line, the user.
    more: String,
}

impl LockHolder {
    fn read(file: &mut File) -> io::Result<Self> {
        let mut bytes = Vec::new();
        file.take(TEXT_MAX).read_to_end(&mut bytes)?;
        Ok(Self::parse(&String::from_utf8_lossy(&bytes)))
    }

    fn parse(text: &str) -> Self {
        let mut words = text.split_whitespace();
        let process = words.next().and_then(|number| number.parse().ok());
        let program = words.next().unwrap_or_default().to_owned();
        Self {
            process,
            program,
            more: words.collect::<Vec<_>>().join(" "),
        }
    }

    fn is_alive(&self) -> bool {
        self.process
            .is_some_and(|process| Path::new("/proc").join(process.to_string()).exists())
    }

    fn description(&self) -> String {
        match (self.process, self.program.as_str()) {
            (Some(process), PROGRAM) if process == std::process::id() => {
                format!("line {} of this gateway", self.more)
            }
            (Some(process), PROGRAM) => format!(
                "line {} of the {PROGRAM} that is process {process}",
                self.more
            ),
            (Some(process), "") => format!("process {process}"),
            (Some(process), program) => format!("process {process} ({program})"),
            (None, _) => "another program".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing;

    /// A directory for locks.
    struct Dir(testing::Dir);

    impl Dir {
        fn new() -> Self {
            Self(testing::Dir::new())
        }

        fn lock(&self, device: &str, line: &str) -> Result<Option<PortLock>, HeldPort> {
            lock(Path::new(device), line, &[self.0.to_owned()])
        }

        fn file(&self) -> PathBuf {
            self.0.join("LCK..ttyUSB0")
        }
    }

    const DEVICE: &str = "/dev/ttyUSB0";

    #[test]
    fn files_are_called_as_terminal_programs_call_them() {
        assert_eq!(file_name(Path::new(DEVICE)), "LCK..ttyUSB0");
        assert_eq!(file_name(Path::new("/dev/pts/3")), "LCK..pts_3");
        assert_eq!(file_name(Path::new("/srv/tty/one")), "LCK..srv_tty_one");
    }

    #[test]
    fn a_device_has_one_holder_who_is_named() {
        let dir = Dir::new();
        let first = dir.lock(DEVICE, "hall-1").unwrap();
        let text = std::fs::read_to_string(dir.file()).unwrap();
        assert_eq!(
            text,
            format!("{:>10} vfd-gateway hall-1\n", std::process::id())
        );
        let held = dir.lock(DEVICE, "hall-2").unwrap_err().to_string();
        assert!(
            held.contains("line hall-1 of this gateway") && held.contains("LCK..ttyUSB0"),
            "{held}"
        );
        assert!(
            dir.lock("/dev/ttyUSB1", "hall-2").unwrap().is_some(),
            "another device"
        );
        drop(first);
        assert!(!dir.file().exists());
        assert!(dir.lock(DEVICE, "hall-2").unwrap().is_some());
    }

    #[test]
    fn a_lock_of_the_dead_is_taken_over() {
        let dir = Dir::new();
        // No process has the id 0, and this one has released the file.
        for text in [
            "         0 minicom me\n",
            &format!("{:>10} vfd-gateway old\n", std::process::id()),
            "",
            "rubbish",
        ] {
            std::fs::write(dir.file(), text).unwrap();
            let lock = dir.lock(DEVICE, "hall-1").unwrap();
            assert!(
                std::fs::read_to_string(dir.file())
                    .unwrap()
                    .ends_with("vfd-gateway hall-1\n"),
                "{text}"
            );
            drop(lock);
        }
    }

    #[test]
    fn a_terminal_program_that_lives_is_left_alone() {
        let dir = Dir::new();
        let text = format!("{:>10} minicom me\n", std::process::id());
        std::fs::write(dir.file(), &text).unwrap();
        let held = dir.lock(DEVICE, "hall-1").unwrap_err().to_string();
        assert!(
            held.contains(&format!("process {} (minicom)", std::process::id())),
            "{held}"
        );
        assert_eq!(std::fs::read_to_string(dir.file()).unwrap(), text);
    }

    #[test]
    fn who_has_taken_it_a_moment_ago_is_named() {
        let dir = Dir::new();
        let mut file = File::create_new(dir.file()).unwrap();
        flock(&file, FlockOperation::NonBlockingLockExclusive).unwrap();
        assert!(
            dir.lock(DEVICE, "hall-1")
                .unwrap_err()
                .to_string()
                .contains("another program"),
            "who never says it"
        );
        let mut writes = || file.write_all(b"         1 vfd-gateway hall-2\n").unwrap();
        let held = lock_waiting(
            Path::new(DEVICE),
            "hall-1",
            &[dir.0.to_owned()],
            &mut writes,
        );
        let held = held.unwrap_err().to_string();
        assert!(
            held.contains("line hall-2 of the vfd-gateway that is process 1"),
            "{held}"
        );
    }

    #[test]
    fn where_nothing_can_be_written_the_next_directory_serves_or_none() {
        let dir = Dir::new();
        let nowhere = PathBuf::from("/nonexistent");
        let second = lock(
            Path::new(DEVICE),
            "hall-1",
            &[nowhere.clone(), dir.0.to_owned()],
        )
        .unwrap();
        assert!(second.is_some() && dir.file().exists());
        assert!(
            lock(Path::new(DEVICE), "hall-1", &[nowhere])
                .unwrap()
                .is_none()
        );
    }

    #[test]
    fn a_link_in_its_place_leads_nowhere() {
        let dir = Dir::new();
        let victim = dir.0.join("victim");
        std::fs::write(&victim, "mine").unwrap();
        std::os::unix::fs::symlink(&victim, dir.file()).unwrap();
        assert!(dir.lock(DEVICE, "hall-1").unwrap().is_none());
        assert_eq!(std::fs::read_to_string(&victim).unwrap(), "mine");
    }
}
