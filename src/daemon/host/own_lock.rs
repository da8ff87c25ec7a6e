//! One gateway per data directory: a lock that is released when its process exits in any way.
//!
//! It is held twice. A lock on a file in the directory names its holder, and works between containers that share the
//! directory. An abstract socket name needs no disk: it works even if the directory cannot be written, or is gone.

use ring::digest::{SHA256, digest};
use rustix::fs::{Mode, fchmod};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, bind, connect, listen, socket_with,
    sockopt,
};
use rustix::process::geteuid;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// Name of the lock's file in the data directory.
const FILE_NAME: &str = "vfd-gateway.lock";
/// Most bytes of it that are read: a process id and a reserve.
const HOLDER_BYTES_MAX: u64 = 32;
/// Bytes of the path's digest in the socket name.
const NAME_BYTES: usize = 16;

/// Another gateway runs on this data directory.
#[derive(Debug, thiserror::Error)]
#[error("another gateway (process {holder}) is running on {}", directory.display())]
pub struct AlreadyRunning {
    /// Its process id, as far as it is known.
    pub holder: String,
    /// The data directory.
    pub directory: PathBuf,
}

/// The lock of a data directory.
#[derive(Debug)]
pub struct DataDirLock {
    _file: Option<File>,
    _name: Option<OwnedFd>,
}

/// Why a socket name could not be taken.
enum NameRefusal {
    /// A process of the same user has it, or of root.
    Gateway(String),
    /// The name cannot be taken, but there is no evidence of another gateway.
    Unknown(String),
}

impl DataDirLock {
    /// Takes the lock of `directory`, even if it cannot be written.
    ///
    /// # Errors
    /// Another gateway has it.
    pub fn take(directory: &Path) -> Result<Self, AlreadyRunning> {
        let taken = |holder| AlreadyRunning {
            holder,
            directory: directory.to_owned(),
        };
        let file = match file(&directory.join(FILE_NAME)) {
            Ok(Ok(file)) => Some(file),
            Ok(Err(holder)) => return Err(taken(holder)),
            Err(error) => {
                tracing::error!(
                    directory = %directory.display(), %error,
                    "ALARM: cannot lock the data directory; control continues"
                );
                None
            }
        };
        let name = match name(directory) {
            Ok(name) => Some(name),
            Err(NameRefusal::Gateway(holder)) => return Err(taken(holder)),
            Err(NameRefusal::Unknown(why)) => {
                tracing::warn!(directory = %directory.display(), why, "cannot lock the name of the data directory; control continues");
                None
            }
        };
        Ok(Self {
            _file: file,
            _name: name,
        })
    }
}

/// Locks the file at `path` and writes our process id into it, if it can be written. Otherwise returns the holder.
fn file(path: &Path) -> io::Result<Result<File, String>> {
    let mut options = OpenOptions::new();
    // A process that can open it can hold the lock, and so keep the gateway from starting.
    let opened = options
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        .open(path);
    // If it cannot be written, an existing file can still be locked.
    let (mut file, is_ours_to_write) = match opened {
        Ok(file) => (file, true),
        Err(error) => (File::open(path).map_err(|_| error)?, false),
    };
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Ok(Err(holder(&mut file))),
        Err(TryLockError::Error(error)) => return Err(error),
    }
    if is_ours_to_write && let Err(error) = sign(&mut file) {
        tracing::warn!(lock = %path.display(), %error, "cannot write the process id to the lock file");
    }
    Ok(Ok(file))
}

fn sign(file: &mut File) -> io::Result<()> {
    // An earlier gateway may have created it with wider permissions.
    fchmod(&*file, Mode::RUSR | Mode::WUSR)?;
    file.set_len(0)?;
    file.rewind()?;
    writeln!(file, "{}", std::process::id())
}

fn holder(file: &mut File) -> String {
    let mut text = String::new();
    let read = file.take(HOLDER_BYTES_MAX).read_to_string(&mut text);
    let number = text.trim();
    if read.is_ok() && !number.is_empty() {
        number.to_owned()
    } else {
        "unknown".to_owned()
    }
}

/// A socket with a name derived from `directory` that is never served: it exists as long as this process.
fn name(directory: &Path) -> Result<OwnedFd, NameRefusal> {
    let unknown = |error: Errno| NameRefusal::Unknown(io::Error::from(error).to_string());
    // Independent of how the path is written, and also if it does not exist.
    let place = directory
        .canonicalize()
        .or_else(|_| std::path::absolute(directory));
    let place = place.unwrap_or_else(|_| directory.to_owned());
    let digest = digest(&SHA256, place.as_os_str().as_bytes());
    let digest: String = digest
        .as_ref()
        .iter()
        .take(NAME_BYTES)
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let address = SocketAddrUnix::new_abstract_name(format!("vfd-gateway {digest}").as_bytes())
        .map_err(unknown)?;
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket =
        || socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None).map_err(unknown);
    let own = socket()?;
    match bind(&own, &address) {
        Ok(()) => listen(&own, 1).map(|()| own).map_err(unknown),
        Err(Errno::ADDRINUSE) => {
            let other = socket()?;
            // Any account of the host may take the name: another user must not keep the gateway from its drives.
            connect(&other, &address).map_err(unknown)?;
            let other = sockopt::socket_peercred(&other).map_err(unknown)?;
            let process = other.pid.as_raw_nonzero();
            match other.uid.is_root() || other.uid == geteuid() {
                true => Err(NameRefusal::Gateway(process.to_string())),
                false => Err(NameRefusal::Unknown(format!(
                    "process {process} of another user has it"
                ))),
            }
        }
        Err(error) => Err(unknown(error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;

    #[test]
    fn a_lock_file_that_cannot_be_written_is_locked_all_the_same() {
        let directory = Dir::new();
        let path = directory.join(FILE_NAME);
        // No user can write into it, not even root.
        std::fs::create_dir(&path).unwrap();
        let first = file(&path).unwrap().unwrap();
        assert_eq!(
            file(&path).unwrap().unwrap_err(),
            "unknown",
            "nobody has signed it"
        );
        drop(first);
        assert!(file(&path).unwrap().is_ok());
    }

    #[test]
    fn a_directory_that_is_gone_has_one_gateway() {
        let directory = Dir::new().join("gone");
        let first = DataDirLock::take(&directory).unwrap();
        let taken = DataDirLock::take(&directory).unwrap_err().to_string();
        assert!(
            taken.contains(&format!("process {}", std::process::id())),
            "{taken}"
        );
        assert!(DataDirLock::take(&directory.join("another")).is_ok());
        drop(first);
        assert!(DataDirLock::take(&directory).is_ok());
    }
}
