//! The journal on the disk: an SQLite database that one thread writes in groups.
//!
//! Lines and north sides put rows into the `inbox` and never wait. The `writer` takes all of them, writes them in one
//! transaction, and reports to each line up to which row everything is kept. What cannot be written waits in its
//! `JournalBook`, which is bounded; control continues. `event_sender` passes trip events to the MQTT side. `upkeep` checks the file
//! and empties its log, on another thread.

mod aside;
mod database;
pub mod days;
mod event_sender;
mod events;
mod files;
mod inbox;
pub mod listing;
pub mod reader;
pub mod rescue;
pub mod schema;
pub mod search;
pub mod status;
mod store;
mod upkeep;
mod writer;

#[cfg(test)]
mod tests;

pub use aside::move_aside;
pub use status::{JournalReport, JournalState};

use crate::daemon::exchange::bell::BrokerBell;
use crate::daemon::exchange::inbox::LineInbox;
use crate::daemon::exchange::north_journal::{self, NorthJournal};
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::origin::RowOrigin;
use crate::daemon::exchange::shared::CurrentPlant;
use crate::daemon::host::clock;
use crate::domain::ids::Name;
use crate::domain::report::LineReport;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::journal::{EntryToKeep, RememberedDrive, WriteAttempt, row};
use inbox::{WriterInbox, WriterMessage};
use status::JournalStatus;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use store::JournalStore;
use tokio::sync::oneshot;

/// The journal's file in the data directory.
pub const FILE_NAME: &str = "journal.db";

/// How the journal is set up.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The data directory.
    pub directory: PathBuf,
    /// Maximum size of the file in bytes.
    pub max_bytes: u64,
    /// A digest of the configuration.
    pub configuration: String,
}

/// The journal of a running gateway.
#[derive(Debug)]
pub struct Journal {
    file: PathBuf,
    inbox: Arc<WriterInbox>,
    status: Arc<JournalStatus>,
    sources: AtomicU64,
    known: writer::Known,
    /// Closed when the writer has exited.
    ended: Mutex<Option<oneshot::Receiver<()>>>,
}

impl Journal {
    /// Opens the journal, reads the remembered state of each drive, and starts the writer. A file that cannot be used
    /// is moved aside; while none can be opened, the newest rows are kept in memory. No other process may use the
    /// directory.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(
        settings: &Settings,
        sides: NorthSides,
        changed: Arc<BrokerBell>,
    ) -> io::Result<(Arc<Self>, BTreeMap<Name, RememberedDrive>)> {
        let inbox = Arc::<WriterInbox>::default();
        let status = Arc::<JournalStatus>::default();
        let (store, found) = JournalStore::open(
            &settings.directory.join(FILE_NAME),
            settings.max_bytes,
            &status,
        );
        let memory = found.memory.clone();
        let (ends, ended) = oneshot::channel();
        let upkeep = upkeep::start(settings.directory.join(FILE_NAME), Arc::clone(&inbox))?;
        let writer = writer::JournalWriter::new(
            store,
            found,
            Arc::clone(&inbox),
            Arc::clone(&status),
            sides,
            changed,
            upkeep,
        );
        let configuration = settings.configuration.clone();
        let known = writer.known();
        std::thread::Builder::new()
            .name("journal".to_owned())
            .spawn(move || {
                writer.run(&configuration);
                drop(ends);
            })?;
        let file = settings.directory.join(FILE_NAME);
        let journal = Self {
            file,
            inbox,
            status,
            sources: AtomicU64::new(0),
            known,
            ended: Mutex::new(Some(ended)),
        };
        Ok((Arc::new(journal), memory))
    }

    /// Registers a line that has just started: its rows are numbered from 1. `inbox` is notified of what is kept.
    #[must_use]
    pub fn line(
        self: &Arc<Self>,
        name: Name,
        drives: Vec<DriveDescription>,
        inbox: Arc<LineInbox>,
    ) -> JournalSource {
        let names = drives.iter().map(|drive| drive.name.clone());
        self.known
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .extend(names);
        let origin = RowOrigin::new(self.next_source(), name, drives, inbox);
        JournalSource {
            journal: Arc::clone(self),
            origin: Arc::new(origin),
        }
    }

    /// Registers a north side for attempts that it refuses itself; `current` has the names of drives.
    #[must_use]
    pub fn north(self: &Arc<Self>, current: CurrentPlant) -> NorthSource {
        NorthSource {
            journal: Arc::clone(self),
            current,
            id: self.next_source(),
        }
    }

    fn next_source(&self) -> u64 {
        self.sources.fetch_add(1, Ordering::Relaxed)
    }

    /// The remembered state of each drive; `None` if the journal does not answer within `within`.
    pub async fn memory(&self, within: Duration) -> Option<BTreeMap<Name, RememberedDrive>> {
        let (tell, answer) = oneshot::channel();
        self.inbox.put(WriterMessage::Memory(tell));
        tokio::time::timeout(within, answer).await.ok()?.ok()
    }

    /// The path of its file.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Its present state.
    #[must_use]
    pub fn report(&self) -> JournalReport {
        self.status.report()
    }

    /// Writes what is left, and waits for that at most for `within`: a disk that hangs must not hold up the shutdown.
    pub async fn close(&self, within: Duration) {
        self.inbox
            .put(WriterMessage::Note(row::ended(clock::wall())));
        self.inbox.put(WriterMessage::Close);
        let ended = self
            .ended
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        let Some(ended) = ended else { return };
        if tokio::time::timeout(within, ended).await.is_err() {
            tracing::error!("journal did not write its last rows in time");
        }
    }
}

/// A line's handle to the journal.
#[derive(Clone, Debug)]
pub struct JournalSource {
    journal: Arc<Journal>,
    origin: Arc<RowOrigin>,
}

impl JournalSource {
    /// Keeps a row of the line.
    pub fn keep(&self, keep: EntryToKeep) {
        self.journal
            .inbox
            .put(WriterMessage::Keep(Arc::clone(&self.origin), keep));
    }

    /// Notes whether the line can be used.
    pub fn state(&self, report: &LineReport) {
        let note = row::line(
            clock::wall(),
            self.origin.line.as_str(),
            report.state,
            report.fault,
        );
        self.journal.inbox.put(WriterMessage::Note(note));
    }

    /// The origin of its rows, which also shows what is kept.
    #[must_use]
    pub fn origin(&self) -> &Arc<RowOrigin> {
        &self.origin
    }

    /// Whether waiting for a row makes sense: the journal can write.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.journal.status.is_ok()
    }
}

/// A north side's handle to the journal. No call blocks.
#[derive(Clone, Debug)]
pub struct NorthSource {
    journal: Arc<Journal>,
    current: CurrentPlant,
    id: u64,
}

impl NorthSource {
    /// Keeps an attempt that reached no line. `drive` is `None` if it was for all drives or for one that does not
    /// exist.
    pub fn keep(&self, drive: Option<DriveRef>, attempt: WriteAttempt) {
        let shared = self.current.load();
        let find = |place| {
            shared
                .drives
                .iter()
                .find(|drive| drive.description.place == place)
        };
        let name = drive
            .and_then(find)
            .map(|drive| drive.description.name.clone());
        self.journal
            .inbox
            .put(WriterMessage::Attempt(self.id, name, clock::now(), attempt));
    }

    /// The broker has the event `seq`: it is not published again.
    pub fn event_taken(&self, seq: u64) {
        self.journal.inbox.put(WriterMessage::EventTaken(seq));
    }

    /// Requests the first events after `after` that no broker has. Answered once by
    /// [`LineNews::Events`](crate::daemon::exchange::answers::LineNews::Events), when there are any. A later request replaces
    /// this one.
    pub fn want_events(&self, after: u64) {
        self.journal.inbox.put(WriterMessage::WantEvents(after));
    }
}

impl NorthJournal for NorthSource {
    fn keep(&self, drive: Option<DriveRef>, attempt: WriteAttempt) {
        Self::keep(self, drive, attempt);
    }

    fn event_taken(&self, seq: u64) {
        Self::event_taken(self, seq);
    }

    fn want_events(&self, after: u64) {
        Self::want_events(self, after);
    }
}

/// The way of another north side, whose attempts are counted from 1, to `journal`; `current` knows the names of drives.
#[must_use]
pub fn side(journal: Option<&Arc<Journal>>, current: &CurrentPlant) -> north_journal::Journal {
    Some(Arc::new(journal?.north(current.clone())))
}

/// The path of the journal in the data directory `directory`.
#[must_use]
pub fn file_in(directory: &Path) -> PathBuf {
    directory.join(FILE_NAME)
}
