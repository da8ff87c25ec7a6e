//! The journal on the disk: an SQLite database that one thread writes in groups.
//!
//! Lines and north sides put what is to be kept into the `inbox` and never wait. The `writer` takes all that lies there,
//! writes it in one transaction, and tells each line up to which of its rows everything is kept. What cannot be written
//! waits in its `Book`, which is bounded; control goes on. `teller` hands trip events to the MQTT side. `upkeep` looks
//! whether the file is sound and empties its log, beside the writer.

mod aside;
mod database;
mod events;
mod inbox;
pub mod listing;
pub mod origin;
pub mod reader;
pub mod rescue;
pub mod schema;
pub mod search;
pub mod status;
mod store;
mod teller;
mod upkeep;
mod writer;

#[cfg(test)]
mod tests;

pub use status::{JournalReport, JournalState};

use crate::daemon::exchange::bell::Bell;
use crate::daemon::exchange::inbox::Inbox as LineInbox;
use crate::daemon::exchange::shared::Current;
use crate::daemon::host::clock;
use crate::daemon::service::north_sides::NorthSides;
use crate::domain::ids::Name;
use crate::domain::report::LineReport;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::journal::{Attempt, Keep, Remembered, row};
use inbox::{Inbox, Post};
use origin::Origin;
use status::Status;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use store::Store;
use tokio::sync::oneshot;

/// The journal's file in the data directory.
pub const FILE_NAME: &str = "journal.db";

/// How the journal is set up.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The data directory.
    pub directory: PathBuf,
    /// Most bytes of the file.
    pub max_bytes: u64,
    /// What tells this configuration from others.
    pub configuration: String,
}

/// The journal of a running gateway.
#[derive(Debug)]
pub struct Journal {
    file: PathBuf,
    inbox: Arc<Inbox>,
    status: Arc<Status>,
    sources: AtomicU64,
    known: writer::Known,
    /// Closed when the writer has ended.
    ended: Mutex<Option<oneshot::Receiver<()>>>,
}

impl Journal {
    /// Opens the journal, reads what is remembered of each drive, and starts to write. It always comes about: what cannot
    /// be used is moved aside, and where nothing can be opened the newest rows are in memory until that is over. The
    /// directory must be this process's alone.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(
        settings: &Settings,
        sides: NorthSides,
        changed: Arc<Bell>,
    ) -> io::Result<(Arc<Self>, BTreeMap<Name, Remembered>)> {
        let (inbox, status) = (Arc::<Inbox>::default(), Arc::<Status>::default());
        let (store, found) = Store::open(&settings.directory.join(FILE_NAME), settings.max_bytes, &status);
        let memory = found.memory.clone();
        let (ends, ended) = oneshot::channel();
        let upkeep = upkeep::start(settings.directory.join(FILE_NAME), Arc::clone(&inbox))?;
        let writer = writer::Writer::new(store, found, Arc::clone(&inbox), Arc::clone(&status), sides, changed, upkeep);
        let (configuration, known) = (settings.configuration.clone(), writer.known());
        std::thread::Builder::new().name("journal".to_owned()).spawn(move || {
            writer.run(&configuration);
            drop(ends);
        })?;
        let file = settings.directory.join(FILE_NAME);
        let journal = Self { file, inbox, status, sources: AtomicU64::new(0), known, ended: Mutex::new(Some(ended)) };
        Ok((Arc::new(journal), memory))
    }

    /// A line that has just started: its rows are numbered from 1. `inbox` is told what is kept.
    #[must_use]
    pub fn line(self: &Arc<Self>, name: Name, drives: Vec<DriveDescription>, inbox: Arc<LineInbox>) -> Source {
        let names = drives.iter().map(|drive| drive.name.clone());
        self.known.lock().unwrap_or_else(PoisonError::into_inner).extend(names);
        let origin = Origin { id: self.next_source(), line: name, drives, inbox, kept: AtomicU64::new(0) };
        Source { journal: Arc::clone(self), origin: Arc::new(origin) }
    }

    /// A north side that refuses by itself; `current` knows the names of drives.
    #[must_use]
    pub fn north(self: &Arc<Self>, current: Current) -> NorthSource {
        NorthSource { journal: Arc::clone(self), current, id: self.next_source() }
    }

    fn next_source(&self) -> u64 {
        self.sources.fetch_add(1, Ordering::Relaxed)
    }

    /// What is remembered of each drive by now; nothing if the journal does not answer within `within`.
    pub async fn memory(&self, within: Duration) -> Option<BTreeMap<Name, Remembered>> {
        let (tell, told) = oneshot::channel();
        self.inbox.put(Post::Memory(tell));
        tokio::time::timeout(within, told).await.ok()?.ok()
    }

    /// Where it lies.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// How it is doing.
    #[must_use]
    pub fn report(&self) -> JournalReport {
        self.status.report()
    }

    /// Writes what is left, and waits for that at most for `within`: a disk that hangs must not hold up the end.
    pub async fn close(&self, within: Duration) {
        self.inbox.put(Post::Note(row::ended(clock::wall())));
        self.inbox.put(Post::Close);
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(ended) = ended else { return };
        if tokio::time::timeout(within, ended).await.is_err() {
            tracing::error!("journal did not write its last rows in time");
        }
    }
}

/// A line's way to the journal.
#[derive(Clone, Debug)]
pub struct Source {
    journal: Arc<Journal>,
    origin: Arc<Origin>,
}

impl Source {
    /// Keeps what the line says.
    pub fn keep(&self, keep: Keep) {
        self.journal.inbox.put(Post::Keep(Arc::clone(&self.origin), keep));
    }

    /// Notes that the line can be used, or not any more.
    pub fn state(&self, report: &LineReport) {
        let note = row::line(clock::wall(), self.origin.line.as_str(), report.state, report.fault);
        self.journal.inbox.put(Post::Note(note));
    }

    /// What its rows are told apart by, and whether they are kept.
    #[must_use]
    pub fn origin(&self) -> &Arc<Origin> {
        &self.origin
    }

    /// Whether it makes sense to wait for a row: the journal can write.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.journal.status.is_ok()
    }
}

/// A north side's way to the journal. No call waits.
#[derive(Clone, Debug)]
pub struct NorthSource {
    journal: Arc<Journal>,
    current: Current,
    id: u64,
}

impl NorthSource {
    /// Keeps an attempt that no line saw; nothing for the drive: it was for all, or for none that exists.
    pub fn keep(&self, drive: Option<DriveRef>, attempt: Attempt) {
        let shared = self.current.load();
        let find = |place| shared.drives.iter().find(|drive| drive.description.place == place);
        let name = drive.and_then(find).map(|drive| drive.description.name.clone());
        self.journal.inbox.put(Post::Attempt(self.id, name, clock::now(), attempt));
    }

    /// The broker has the event `seq`: it is not told again.
    pub fn event_taken(&self, seq: u64) {
        self.journal.inbox.put(Post::EventTaken(seq));
    }

    /// The MQTT side wants the first events behind `after` that no broker has. It is answered once by
    /// [`News::Events`](crate::daemon::exchange::answers::News::Events), when there are any. A later want takes the place of this one.
    pub fn want_events(&self, after: u64) {
        self.journal.inbox.put(Post::WantEvents(after));
    }
}

/// Where the journal of the data directory `directory` is.
#[must_use]
pub fn file_in(directory: &Path) -> PathBuf {
    directory.join(FILE_NAME)
}
