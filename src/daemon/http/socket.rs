//! The Unix socket by which the program's own commands reach the running gateway.

use super::connections::{self, ConnectionPatience};
use super::diagnostics::{self, ArchiveMaker};
use super::reachable::CommandReachability;
use super::routes::RouteDocuments;
use super::{own_routes, qualify, routes};
use crate::daemon::host::own_lock::{AlreadyRunning, DataDirLock};
use crate::daemon::local::LocalSide;
use rustix::fs::{FileType, Mode};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{UnixListener, UnixSocket};

/// Name of the socket in the data directory.
pub const SOCKET_NAME: &str = "vfd-gateway.sock";
/// Connections that wait to be accepted.
const BACKLOG: u32 = 16;
/// After how long creating the socket is retried.
const AGAIN_AFTER: Duration = Duration::from_secs(10);

/// Why there is no socket.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another file exists where the socket should be.
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

/// The socket of this gateway. Its file is removed when this is dropped.
#[derive(Debug)]
pub struct OwnSocket {
    /// `None` if it could not be created so far.
    listener: Option<UnixListener>,
    /// Whether the file is ours.
    is_made: bool,
    path: PathBuf,
    reachable: Arc<CommandReachability>,
    /// Released after the socket.
    _lock: DataDirLock,
}

impl OwnSocket {
    /// Creates `vfd-gateway.sock` in `directory`, accessible to its owner only. A stale socket of an earlier gateway is
    /// replaced. If it cannot be created, that is logged and retried while serving: the gateway controls without it.
    /// Must be called on a runtime.
    ///
    /// # Errors
    /// [`AlreadyRunning`] if another gateway runs on the same directory.
    pub fn open(directory: &Path) -> Result<Self, AlreadyRunning> {
        let lock = DataDirLock::take(directory)?;
        let path = directory.join(SOCKET_NAME);
        let reachable = Arc::default();
        let mut own = Self {
            listener: None,
            is_made: false,
            path,
            reachable,
            _lock: lock,
        };
        if let Err(error) = own.make() {
            tracing::error!(%error, "ALARM: cannot create the local command socket; control continues");
        }
        Ok(own)
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the program's own commands reach the gateway; updated from now on.
    #[must_use]
    pub fn reachable(&self) -> Arc<CommandReachability> {
        Arc::clone(&self.reachable)
    }

    /// Serves HTTP on it until the task is dropped, which removes the file. Must run on a `LocalSet`.
    pub async fn serve(mut self, documents: RouteDocuments, side: Arc<LocalSide>) {
        while self.listener.is_none() {
            tokio::time::sleep(AGAIN_AFTER).await;
            if self.make().is_ok() {
                tracing::warn!("local command socket ready");
            }
        }
        if let Some(listener) = self.listener.take() {
            let data_dir = self.path.parent().map(Path::to_owned).unwrap_or_default();
            let trials = qualify::router(Arc::clone(&side), data_dir);
            let diagnostics =
                diagnostics::own_router(Arc::new(ArchiveMaker::new(documents.clone())));
            let own = own_routes::router(side).merge(trials).merge(diagnostics);
            let router = routes::router(documents).merge(own);
            connections::serve(listener, router, ConnectionPatience::default()).await;
        }
    }

    fn make(&mut self) -> Result<(), SocketError> {
        let made = remove_dead(&self.path).and_then(|()| {
            listen(&self.path).map_err(|error| SocketError::System {
                path: self.path.clone(),
                error,
            })
        });
        self.reachable
            .set(made.as_ref().err().map(ToString::to_string));
        self.listener = Some(made?);
        self.is_made = true;
        Ok(())
    }
}

impl Drop for OwnSocket {
    fn drop(&mut self) {
        if self.is_made {
            // The lock is still held, so the file is ours. If it stays, the next gateway replaces it.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Removes the stale socket of an earlier gateway.
fn remove_dead(path: &Path) -> Result<(), SocketError> {
    match rustix::fs::lstat(path) {
        Ok(stat) if FileType::from_raw_mode(stat.st_mode) == FileType::Socket => {
            std::fs::remove_file(path).map_err(|error| SocketError::System {
                path: path.to_owned(),
                error,
            })
        }
        Ok(_) => Err(SocketError::NoSocket(path.to_owned())),
        Err(rustix::io::Errno::NOENT) => Ok(()),
        Err(error) => Err(SocketError::System {
            path: path.to_owned(),
            error: error.into(),
        }),
    }
}

fn listen(path: &Path) -> io::Result<UnixListener> {
    let socket = UnixSocket::new_stream()?;
    // The file gets the mode that the socket has when it is bound, so other users can never open it.
    rustix::fs::fchmod(&socket, Mode::RUSR | Mode::WUSR)?;
    socket.bind(path)?;
    socket.listen(BACKLOG)
}
