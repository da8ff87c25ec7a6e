//! Work on the database outside the writer: one check of the whole file after the start, and emptying its log from time
//! to time.

use super::inbox::{WriterInbox, WriterMessage};
use super::reader;
use rusqlite::{Connection, Error, OpenFlags};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// The check begins once the gateway is serving.
const CHECK_AFTER: Duration = Duration::from_secs(2);

/// Starts the thread. It empties the log whenever something is sent, and exits when the sender is dropped.
///
/// # Errors
/// The system's refusal to start a thread.
pub fn start(path: PathBuf, inbox: Arc<WriterInbox>) -> io::Result<SyncSender<()>> {
    let (ask, asked) = sync_channel(1);
    std::thread::Builder::new().name("journal upkeep".to_owned()).spawn(move || {
        let mut wait = Some(CHECK_AFTER);
        loop {
            let next = match wait {
                Some(wait) => asked.recv_timeout(wait),
                None => asked.recv().map_err(|_| RecvTimeoutError::Disconnected),
            };
            match next {
                Ok(()) => {
                    // The writer empties the log itself if this never succeeds.
                    if let Err(error) = checkpoint(&path) {
                        tracing::debug!(%error, "cannot empty the journal's log");
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {
                    wait = None;
                    check(&path, &inbox);
                    match reader::unused_drives(&path) {
                        Ok(drives) if drives.is_empty() => {}
                        Ok(drives) => inbox.put(WriterMessage::Unused(drives)),
                        Err(error) => {
                            tracing::debug!(%error, "cannot find out which drives the journal still mentions")
                        }
                    }
                }
            }
        }
    })?;
    Ok(ask)
}

fn check(path: &Path, inbox: &WriterInbox) {
    match reader::check(path) {
        Ok(problems) if problems.is_empty() => {
            tracing::debug!("journal checked; no problems found")
        }
        Ok(problems) => inbox.put(WriterMessage::Checked(problems)),
        Err(error) => tracing::debug!(%error, "cannot check the journal"),
    }
}

fn checkpoint(path: &Path) -> Result<(), Error> {
    let connection = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
    connection.query_row("PRAGMA wal_checkpoint(PASSIVE)", [], |_| Ok(()))
}
