//! The Unix socket by which the program's own commands reach the running gateway.

use super::connections::{self, Patience};
use super::state::State;
use super::{own_routes, routes};
use crate::daemon::local::LocalSide;
use rustix::fs::{FileType, Mode};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::net::{UnixListener, UnixSocket};

/// Name of the socket in the data directory.
pub const SOCKET_NAME: &str = "vfd-gateway.sock";
/// Name of the lock beside it. It is held by the gateway that owns the socket, and it ends with that process however
/// it ends: a socket without it is a dead one's.
const LOCK_NAME: &str = "vfd-gateway.lock";
/// Connections that wait to be accepted.
const BACKLOG: u32 = 16;
/// Most of a lock file that is read: a process number and some.
const HOLDER_BYTES_MAX: u64 = 32;

/// Why there is no socket.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another gateway runs on this data directory.
    #[error("another gateway (process {holder}) is running on {}", directory.display())]
    Taken {
        /// Its process number, as far as it said so.
        holder: String,
        /// The data directory.
        directory: PathBuf,
    },
    /// Something stands where the socket should be.
    #[error("{} is not a socket and is left alone", .0.display())]
    NoSocket(PathBuf),
    /// The system refused.
    #[error("{}: {error}", path.display())]
    System {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
}

/// The socket of this gateway. Its file is gone when this is dropped.
#[derive(Debug)]
pub struct OwnSocket {
    listener: Option<UnixListener>,
    path: PathBuf,
    /// Unlocked when it is closed.
    _lock: File,
}

impl OwnSocket {
    /// Makes `vfd-gateway.sock` in `directory`, for its owner alone. The socket of a gateway that is gone is replaced.
    /// It must be called on a runtime.
    ///
    /// # Errors
    /// [`SocketError`]; a gateway that runs on the same directory is left alone.
    pub fn open(directory: &Path) -> Result<Self, SocketError> {
        let lock = lock(directory)?;
        let path = directory.join(SOCKET_NAME);
        remove_dead(&path)?;
        let listener = listen(&path).map_err(|error| SocketError::System { path: path.clone(), error })?;
        Ok(Self { listener: Some(listener), path, _lock: lock })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Serves HTTP on it until the task is dropped, and the file with it. It must run on a `LocalSet`.
    pub async fn serve(mut self, state: Arc<State>, side: Arc<LocalSide>) {
        if let Some(listener) = self.listener.take() {
            let router = routes::router(state).merge(own_routes::router(side));
            connections::serve(listener, router, Patience::default()).await;
        }
    }
}

impl Drop for OwnSocket {
    fn drop(&mut self) {
        // The lock is still held, so the file is ours. If it stays, the next gateway replaces it.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Takes the lock and writes our process number into it.
fn lock(directory: &Path) -> Result<File, SocketError> {
    let path = directory.join(LOCK_NAME);
    let system = |error| SocketError::System { path: path.clone(), error };
    let mut options = OpenOptions::new();
    // Whoever can open it can hold the lock, and so keep the gateway from starting.
    let mut file =
        options.read(true).write(true).create(true).truncate(false).mode(0o600).open(&path).map_err(system)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            return Err(SocketError::Taken { holder: holder(&mut file), directory: directory.to_owned() });
        }
        Err(TryLockError::Error(error)) => return Err(system(error)),
    }
    let sign = |file: &mut File| {
        // An earlier gateway may have made it for everybody.
        rustix::fs::fchmod(&*file, Mode::RUSR | Mode::WUSR)?;
        file.set_len(0)?;
        file.rewind()?;
        writeln!(file, "{}", std::process::id())
    };
    sign(&mut file).map_err(system)?;
    Ok(file)
}

fn holder(file: &mut File) -> String {
    let mut text = String::new();
    let read = file.take(HOLDER_BYTES_MAX).read_to_string(&mut text);
    let number = text.trim();
    if read.is_ok() && !number.is_empty() { number.to_owned() } else { "unknown".to_owned() }
}

/// Removes a socket that a gateway which is gone has left.
fn remove_dead(path: &Path) -> Result<(), SocketError> {
    match rustix::fs::lstat(path) {
        Ok(stat) if FileType::from_raw_mode(stat.st_mode) == FileType::Socket => {
            std::fs::remove_file(path).map_err(|error| SocketError::System { path: path.to_owned(), error })
        }
        Ok(_) => Err(SocketError::NoSocket(path.to_owned())),
        Err(rustix::io::Errno::NOENT) => Ok(()),
        Err(error) => Err(SocketError::System { path: path.to_owned(), error: error.into() }),
    }
}

fn listen(path: &Path) -> io::Result<UnixListener> {
    let socket = UnixSocket::new_stream()?;
    // A socket's file has the mode that the socket had when it was bound, so nobody else can ever open it.
    rustix::fs::fchmod(&socket, Mode::RUSR | Mode::WUSR)?;
    socket.bind(path)?;
    socket.listen(BACKLOG)
}
