//! The writer thread: it writes all that waits in one transaction, then reports what is kept.

use super::database::{DatabaseState, JournalDatabase};
use super::event_sender::EventSender;
use super::inbox::{WriterInbox, WriterMessage};
use super::status::JournalStatus;
use super::store::JournalStore;
use crate::daemon::exchange::bell::BrokerBell;
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::origin::RowOrigin;
use crate::daemon::host::clock;
use crate::domain::ids::Name;
use crate::domain::time::{MonoTime, WallTime};
use crate::domain::version::PROGRAM_VERSION;
use crate::journal::audit::LostCounts;
use crate::journal::{EntryToKeep, JournalBook, JournalEntry, RowNumber, row};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// A line whose inbox was full is notified again after this time.
const TELL_AGAIN: Duration = Duration::from_millis(5);
/// Groups and rows after which the log is emptied: some MB. Seldom, since a trip at that moment shares the disk.
const EMPTY_AFTER: (u64, u64) = (256, 4096);
/// Rows after which the size of the journal is checked.
const CUT_AFTER: u64 = 64;
/// What drives have used is written this late, so that one write has it of many drives.
const USAGE_WAITS: Duration = Duration::from_secs(5);
/// How often it is looked whether the files are still those that were opened.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Most marks of taken events that wait to be written. An event whose mark is lost is published again after the next
/// start.
const TAKEN_MAX: usize = 1024;

/// Writes the journal.
pub struct JournalWriter {
    store: JournalStore,
    book: JournalBook,
    inbox: Arc<WriterInbox>,
    status: Arc<JournalStatus>,
    sides: NorthSides,
    changed: Arc<BrokerBell>,
    event_sender: EventSender,
    upkeep: SyncSender<()>,
    taken: BTreeSet<u64>,
    /// The newest row of each line that is in the book, of which the line is to be notified.
    rows: BTreeMap<u64, (Arc<RowOrigin>, RowNumber)>,
    to_tell: BTreeMap<u64, (Arc<RowOrigin>, RowNumber)>,
    /// Groups and rows since the log was emptied.
    since_emptied: (u64, u64),
    /// Rows since the size of the journal was checked.
    since_cut: u64,
    /// Rows lost since the last row that says so.
    lost: u64,
    /// Something else than what drives have used was taken since the last write, or the gateway shuts down.
    is_urgent: bool,
    configuration: Option<String>,
    known: Known,
}

/// The drives of all lines since the start.
pub type Known = Arc<Mutex<BTreeSet<Name>>>;

impl JournalWriter {
    /// A writer that continues from `found`.
    pub fn new(
        store: JournalStore,
        found: DatabaseState,
        inbox: Arc<WriterInbox>,
        status: Arc<JournalStatus>,
        sides: NorthSides,
        changed: Arc<BrokerBell>,
        upkeep: SyncSender<()>,
    ) -> Self {
        for drive in &found.damaged {
            tracing::error!(
                drive,
                "ALARM: remembered state of the drive is damaged; starting without it"
            );
        }
        let event_sender = EventSender::new(sides.mqtt.clone(), Arc::clone(&changed));
        Self {
            store,
            book: JournalBook::new(found.memory),
            inbox,
            status,
            sides,
            changed,
            event_sender,
            upkeep,
            taken: BTreeSet::new(),
            rows: BTreeMap::new(),
            to_tell: BTreeMap::new(),
            since_emptied: (0, 0),
            // At once, so that the size is known.
            since_cut: CUT_AFTER,
            lost: 0,
            is_urgent: true,
            configuration: found.configuration,
            known: Known::default(),
        }
    }

    /// The drives that it must not forget, even without rows about them.
    #[must_use]
    pub fn known(&self) -> Known {
        Arc::clone(&self.known)
    }

    /// Writes until the gateway shuts down.
    pub fn run(mut self, configuration: &str) {
        self.begin(configuration);
        let mut batch = Vec::new();
        let mut looked = clock::now();
        loop {
            if clock::now().since(looked) >= LOOK_EVERY {
                looked = clock::now();
                self.store.reopen_if_replaced();
            }
            self.write();
            self.event_sender.serve(&mut self.store);
            self.tell_lines();
            let (lost, is_closed) = self.inbox.take(&mut batch, self.wait());
            self.lose(lost);
            self.is_urgent |= is_closed;
            if is_closed && batch.is_empty() {
                self.write();
                break;
            }
            let now = (clock::now(), clock::wall());
            for post in batch.drain(..) {
                self.take(now, post);
            }
        }
        if let Some(Err(error)) = self.store.database().map(|database| database.checkpoint()) {
            tracing::debug!(%error, "cannot empty the journal's log at the end");
        }
    }

    /// Adds a row for the start of the gateway, and marks what an earlier run has left as found.
    fn begin(&mut self, configuration: &str) {
        let has_changed = self
            .configuration
            .as_deref()
            .is_some_and(|last| last != configuration);
        self.book.note(row::started(
            clock::wall(),
            PROGRAM_VERSION,
            configuration,
            has_changed,
        ));
        self.book.orphan_leases(clock::now(), clock::wall());
        if let Some(Err(error)) = self
            .store
            .database()
            .map(|database| database.set_configuration(configuration))
        {
            self.store.troubled(error);
        }
    }

    fn wait(&self) -> Option<Duration> {
        let now = clock::now();
        let retry = self.store.retry_at().map(|at| at.since(now));
        let tell = (!self.to_tell.is_empty()).then_some(TELL_AGAIN);
        // While the disk refuses, only the next retry counts.
        let used = match self.used_until() {
            Some(until) if retry.is_none() => Some(until.since(now)),
            _ => None,
        };
        let look = self.store.is_open().then_some(LOOK_EVERY);
        [retry, tell, used, look].into_iter().flatten().min()
    }

    /// Until when what drives have used may wait to be written; `None` if none of it waits.
    fn used_until(&self) -> Option<MonoTime> {
        self.book.used_since().map(|since| since + USAGE_WAITS)
    }

    fn lose(&mut self, lost: LostCounts) {
        if lost.total() > 0 {
            self.lost += lost.total();
            self.status.change(|report| {
                report.lost += lost.total();
                report.attempts_lost += lost.attempts;
            });
        }
    }

    fn take(&mut self, (now, wall): (MonoTime, WallTime), post: WriterMessage) {
        let label = |at: MonoTime| label(now, wall, at);
        self.is_urgent |= !matches!(
            &post,
            WriterMessage::Keep(
                _,
                EntryToKeep {
                    entry: JournalEntry::Usage(_),
                    ..
                }
            )
        );
        match post {
            WriterMessage::Keep(
                origin,
                EntryToKeep {
                    row,
                    drive,
                    at,
                    entry,
                },
            ) => {
                if let Some(drive) = origin.drives.get(drive.get()) {
                    self.book.take(origin.id, drive, at, entry, &label);
                }
                self.rows.insert(origin.id, (origin, row));
            }
            WriterMessage::Attempt(source, drive, at, attempt) => {
                self.book
                    .attempt(source, drive.as_ref(), at, &attempt, &label);
            }
            WriterMessage::Note(row) => self.book.note(row),
            WriterMessage::WantEvents(after) => self.event_sender.want(after),
            WriterMessage::EventTaken(seq) => {
                if self.taken.len() < TAKEN_MAX {
                    self.taken.insert(seq);
                }
            }
            WriterMessage::Checked(problems) => self.store.give_up(&problems.join("; ")),
            WriterMessage::Unused(drives) => {
                let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
                drives
                    .iter()
                    .filter(|drive| !known.contains(*drive))
                    .for_each(|drive| self.book.forget(drive));
            }
            WriterMessage::Memory(tell) => {
                // The requester may have given up.
                let _ = tell.send(self.book.all_memory().clone());
            }
            WriterMessage::Close => {}
        }
    }

    fn write(&mut self) {
        let lost = self.book.take_lost();
        self.lose(lost);
        let may_wait =
            !self.is_urgent && self.used_until().is_some_and(|until| clock::now() < until);
        if may_wait {
            return;
        }
        self.is_urgent = false;
        let has_nothing = self.book.is_empty() && self.taken.is_empty() && !self.store.has_news();
        if has_nothing && self.store.retry_at().is_none() {
            // A row without news, such as an unchanged lease, counts as kept.
            return self.note_kept();
        }
        self.status
            .change(|report| report.waiting = self.book.len() as u64);
        if self.lost > 0 && self.store.retry_at().is_none() {
            self.book
                .note(row::lost(clock::wall(), std::mem::take(&mut self.lost)));
        }
        let begun = clock::now();
        let has_trip = self.book.has_trip();
        if !self.store.write(&mut self.book, &self.taken) {
            self.is_urgent = true;
            return;
        }
        let took = clock::now().since(begun);
        let rows = self.book.written() as u64;
        self.taken.clear();
        self.status.change(|report| {
            report.rows += rows;
            report.waiting = 0;
            report.commits += 1;
            report.commit_time = took;
            report.commit_time_max = report.commit_time_max.max(took);
        });
        self.note_kept();
        self.tell_lines();
        self.wake_answers();
        if has_trip {
            self.event_sender.kept();
        }
        self.look_after(rows);
    }

    fn note_kept(&mut self) {
        for (id, (origin, row)) in std::mem::take(&mut self.rows) {
            origin.note_kept(row);
            self.to_tell.insert(id, (origin, row));
        }
    }

    fn tell_lines(&mut self) {
        self.to_tell.retain(|_, (origin, row)| {
            origin.inbox.put(LineMessage::Kept(*row)).is_err() && !origin.inbox.is_closed()
        });
    }

    fn wake_answers(&self) {
        self.sides.modbus.release();
        self.sides.local.release();
        let by_broker = [&self.sides.mqtt, &self.sides.sparkplug]
            .into_iter()
            .flatten();
        // Every side is released, whatever the others had.
        if by_broker.filter(|side| side.release()).count() > 0 {
            self.changed.ring();
        }
    }

    /// Deletes old rows, and has the log emptied from time to time.
    fn look_after(&mut self, rows: u64) {
        self.since_cut += rows;
        if self.since_cut >= CUT_AFTER {
            self.since_cut = 0;
            match self.store.database().map(JournalDatabase::cut) {
                Some(Ok(bytes)) => self.status.change(|report| report.size_bytes = bytes),
                Some(Err(error)) => self.store.troubled(error),
                None => {}
            }
        }
        let (commits, all) = &mut self.since_emptied;
        *commits += 1;
        *all += rows;
        if *commits >= EMPTY_AFTER.0 || *all >= EMPTY_AFTER.1 {
            self.since_emptied = (0, 0);
            // A request that is pending already is enough.
            let _ = self.upkeep.try_send(());
            if let Some(Err(error)) = self.store.database().map(|database| database.empty_log()) {
                self.store.troubled(error);
            }
        }
    }
}

/// Converts `at` to the wall clock, by both clocks as of now.
fn label(now: MonoTime, wall: WallTime, at: MonoTime) -> WallTime {
    let millis = |from: MonoTime, to: MonoTime| {
        i64::try_from(to.since(from).as_millis()).unwrap_or(i64::MAX)
    };
    WallTime {
        unix_ms: wall
            .unix_ms
            .saturating_sub(millis(at, now))
            .saturating_add(millis(now, at)),
    }
}
