//! The journal on a real disk: written, read again, cut, moved aside, and while it cannot be written.

use super::database::JournalDatabase;
use super::inbox::WriterMessage;
use super::reader::{self, ReadRow, TableRows};
use super::*;
use crate::config::{self, Config};
use crate::daemon::exchange::answers::LineNews;
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::lines::build;
use crate::daemon::testing::Dir;
use crate::domain::command::{Order, Outcome, Owner, Reason, Report};
use crate::domain::ids::DriveIndex;
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::view::{TripEvent, TripEventKind, TripRecord};
use crate::journal::RowNumber;
use crate::journal::{
    AttemptId, JournalBook, JournalEntry, JournalRow, JournalTable, RememberedStop, StoredEvent,
    TriedWrite, TripBaseline,
};
use crate::vendors;
use std::collections::BTreeSet;
use std::sync::LazyLock;
use std::time::Instant;

const PATIENCE: Duration = Duration::from_secs(10);

static CONFIG: LazyLock<Config> = LazyLock::new(|| {
    let text = "[[line]]\nname = \"hall-1\"\nport = \"/dev/ttyUSB0\"\n[[line.drive]]\nname = \"pump-1\"\n\
                model = \"hyundai-n700\"\nstation = 1\n[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\n";
    let catalog = vendors::catalog();
    config::load(text, &catalog).unwrap()
});

/// Where a journal is.
struct Place(Dir);

impl Place {
    fn new() -> Self {
        Self(Dir::new())
    }

    fn file(&self) -> PathBuf {
        file_in(&self.0)
    }

    fn rows(&self, table: JournalTable) -> Vec<ReadRow> {
        let connection = reader::connect(&self.file()).unwrap();
        TableRows::after(&connection, table, 0)
            .map(Result::unwrap)
            .collect()
    }

    /// Waits until everything is in the file itself: the log may still be emptied after the writer's end.
    fn wait_for_file(&self) {
        let log = self.0.join("journal.db-wal");
        until("the log is emptied", || {
            std::fs::metadata(&log)
                .map_or(true, |log| log.len() == 0)
                .then_some(())
        });
    }

    fn aside(&self) -> Vec<String> {
        let names = std::fs::read_dir(&self.0)
            .unwrap()
            .map(|it| it.unwrap().file_name().into_string().unwrap());
        names
            .filter(|name| {
                name.contains("damaged") && !name.ends_with("-wal") && !name.ends_with("-shm")
            })
            .collect()
    }
}

/// A journal with one line and an MQTT side, both played by hand.
struct Rig {
    journal: Arc<Journal>,
    memory: BTreeMap<Name, RememberedDrive>,
    source: JournalSource,
    north: NorthSource,
    inbox: Arc<LineInbox>,
    sides: NorthSides,
    row: u64,
}

impl Rig {
    fn start(place: &Place) -> Self {
        Self::with(place, 64_000_000)
    }

    fn with(place: &Place, max_bytes: u64) -> Self {
        let shared = Arc::new(build::shared(&CONFIG));
        let sides = NorthSides {
            mqtt: Some(Arc::default()),
            ..NorthSides::default()
        };
        let settings = Settings {
            directory: place.0.to_owned(),
            max_bytes,
            configuration: "one".to_owned(),
        };
        let (journal, memory) =
            Journal::start(&settings, sides.clone(), Arc::clone(&shared.changed)).unwrap();
        let inbox = Arc::<LineInbox>::default();
        let drives = vec![shared.drives[0].description.clone()];
        let source = journal.line(Name::new("hall-1").unwrap(), drives, Arc::clone(&inbox));
        let north = journal.north(crate::daemon::exchange::shared::CurrentPlant::from(shared));
        Self {
            journal,
            memory,
            source,
            north,
            inbox,
            sides,
            row: 0,
        }
    }

    fn keep(&mut self, entry: JournalEntry) -> RowNumber {
        self.row += 1;
        let keep = EntryToKeep {
            row: RowNumber(self.row),
            drive: DriveIndex(0),
            at: clock::now(),
            entry,
        };
        self.source.keep(keep);
        RowNumber(self.row)
    }

    fn trip(&mut self, count: u16) -> RowNumber {
        let record = TripRecord {
            at: clock::now(),
            code: Some(count),
            words: Vec::new(),
        };
        let kind = TripEventKind::Tripped { trips: 1, record };
        let event = TripEvent {
            kind,
            count: Some(count),
            at: clock::now(),
            while_away: false,
        };
        self.keep(JournalEntry::Trip(
            event,
            TripBaseline {
                count: Some(count),
                held: Some(true),
                code: None,
            },
        ))
    }

    fn refuse(&mut self, number: u64) -> RowNumber {
        let tried = TriedWrite::Text(format!("no {number}"));
        let report = Some(Report::refused(Reason::NotUnderstood));
        self.keep(JournalEntry::Attempt(WriteAttempt {
            id: AttemptId(number),
            owner: Owner::Mqtt,
            tried,
            report,
        }))
    }

    fn wait_for(&self, row: RowNumber) {
        until("the row is kept", || {
            self.source.origin().has_kept(row).then_some(())
        });
    }

    /// The events that the MQTT side receives, until there are `count`.
    fn events(&self, count: usize) -> (Vec<StoredEvent>, bool) {
        let mut batch = Vec::new();
        let mut received = Vec::new();
        let mut last = false;
        until("the events are received", || {
            self.sides.mqtt.as_ref().unwrap().take(&mut batch);
            for news in batch.drain(..) {
                let LineNews::Events { events, more } = news else {
                    panic!("{news:?}")
                };
                received.extend(events);
                last = more;
            }
            (received.len() >= count).then_some(())
        });
        (received, last)
    }

    /// Leaves it as a kill would: nothing is closed, and the file is not touched any more.
    fn abandon(self, place: &Place) -> Place {
        let copy = Place::new();
        for name in ["journal.db", "journal.db-wal"] {
            std::fs::copy(place.0.join(name), copy.0.join(name)).unwrap();
        }
        copy
    }

    fn close(self) {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .build()
            .unwrap();
        runtime.block_on(self.journal.close(PATIENCE));
    }
}

#[track_caller]
fn until<T>(what: &str, mut done: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(it) = done() {
            return it;
        }
        assert!(Instant::now() < end, "not in time: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn name() -> Name {
    Name::new("pump-1").unwrap()
}

fn sound(rows: Vec<ReadRow>) -> Vec<JournalRow> {
    rows.into_iter()
        .map(|seen| {
            if let ReadRow::Sound(row) = seen {
                row
            } else {
                panic!("{seen:?}")
            }
        })
        .collect()
}

#[test]
fn a_trip_outlives_a_kill_once_and_its_number_goes_on() {
    let first = Place::new();
    let mut rig = Rig::start(&first);
    assert_eq!(rig.memory.get(&name()), None);
    let row = rig.trip(1);
    rig.wait_for(row);
    let kept = until("the line is notified", || {
        let mut batch = Vec::new();
        rig.inbox.take(&mut batch);
        batch.into_iter().find_map(|message| {
            if let LineMessage::Kept(row) = message {
                Some(row)
            } else {
                None
            }
        })
    });
    assert_eq!(kept, row);
    rig.north.want_events(0);
    let (events, more) = rig.events(1);
    assert_eq!(
        (events[0].seq, events[0].drive.as_str(), more),
        (1, "pump-1", false)
    );
    let body: serde_json::Value = serde_json::from_str(&events[0].body).unwrap();
    assert_eq!(
        (&body["seq"], &body["code"], &body["kind"]),
        (&1.into(), &1.into(), &"tripped".into())
    );

    let second = rig.abandon(&first);
    let mut rig = Rig::start(&second);
    let memory = rig.memory[&name()];
    assert_eq!(
        (
            memory.trips_total,
            memory.last_code,
            memory.trips.unwrap().count
        ),
        (1, Some(1), Some(1))
    );
    let row = rig.trip(2);
    rig.wait_for(row);
    rig.north.want_events(0);
    let (again, more) = rig.events(2);
    assert_eq!(
        (again[0].clone(), again[1].seq, more),
        (events[0].clone(), 2, false)
    );
    rig.north.event_taken(1);
    rig.close();
    let mut rig = Rig::start(&second);
    rig.north.want_events(0);
    assert_eq!(
        rig.events(1).0,
        [again[1].clone()],
        "what was taken is not sent again"
    );
    rig.north.want_events(2);
    rig.trip(3);
    assert_eq!(
        rig.events(1).0[0].seq,
        3,
        "who asks before there is anything is answered then"
    );
    rig.close();
    assert_eq!(second.rows(JournalTable::Event).len(), 3);
}

#[test]
fn what_is_remembered_of_a_drive_is_found_again() {
    let place = Place::new();
    let mut rig = Rig::start(&place);
    rig.keep(JournalEntry::Lease(Some(Owner::Mqtt)));
    let row = rig.keep(JournalEntry::StopPending { coast: true });
    rig.wait_for(row);
    let place = rig.abandon(&place);
    for was_orphaned in [false, true] {
        let rig = Rig::start(&place);
        let memory = rig.memory[&name()];
        assert_eq!(
            memory.lease.map(|lease| (lease.owner, lease.was_orphaned)),
            Some((Owner::Mqtt, was_orphaned))
        );
        assert_eq!(memory.stop, Some(RememberedStop { coast: true }));
        rig.close();
    }
    let mut rig = Rig::start(&place);
    rig.keep(JournalEntry::Lease(None));
    let row = rig.keep(JournalEntry::StopOver { is_effective: true });
    rig.wait_for(row);
    rig.close();
    let rig = Rig::start(&place);
    assert_eq!(
        (rig.memory[&name()].lease, rig.memory[&name()].stop),
        (None, None)
    );
    let states: Vec<_> = sound(place.rows(JournalTable::Availability))
        .into_iter()
        .map(|row| row.body)
        .collect();
    assert!(
        states
            .iter()
            .filter(|body| body.contains("started"))
            .count()
            >= 4,
        "{states:?}"
    );
}

/// The gateway goes on controlling, and knows what it has to do for its drives at the start.
#[test]
fn what_is_remembered_is_found_also_where_nothing_can_be_written() {
    let place = Place::new();
    let mut rig = Rig::start(&place);
    rig.trip(7);
    rig.keep(JournalEntry::Lease(Some(Owner::Mqtt)));
    rig.keep(JournalEntry::ResetWord { may_stand: true });
    let row = rig.keep(JournalEntry::StopPending { coast: true });
    rig.wait_for(row);
    rig.close();
    place.wait_for_file();
    // Another process reads it, and has left no writable log: such a lock holds for root, too.
    let other = rusqlite::Connection::open(place.file()).unwrap();
    other
        .execute_batch("PRAGMA journal_mode = DELETE; BEGIN")
        .unwrap();
    other
        .query_row("SELECT count(*) FROM drive", [], |_| Ok(()))
        .unwrap();
    let rig = Rig::start(&place);
    assert_eq!(rig.journal.report().state, JournalState::Memory);
    let memory = rig.memory[&name()];
    assert_eq!(memory.lease.map(|lease| lease.owner), Some(Owner::Mqtt));
    assert_eq!(
        (memory.stop, memory.reset),
        (Some(RememberedStop { coast: true }), true)
    );
    assert_eq!((memory.trips_total, memory.last_code), (1, Some(7)));
    rig.close();
}

#[test]
fn what_no_row_is_about_is_forgotten_unless_the_drive_is_there() {
    let place = Place::new();
    let mut rig = Rig::start(&place);
    let row = rig.keep(JournalEntry::StopPending { coast: true });
    rig.wait_for(row);
    assert_eq!(reader::unused_drives(&place.file()).unwrap(), [name()]);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .build()
        .unwrap();
    let is_remembered = |journal: &Journal| {
        let memory = runtime.block_on(journal.memory(PATIENCE)).unwrap();
        memory.contains_key(&name())
    };
    rig.journal.inbox.put(WriterMessage::Unused(vec![name()]));
    assert!(is_remembered(&rig.journal), "its line is here");
    rig.close();
    let shared = Arc::new(build::shared(&CONFIG));
    let settings = Settings {
        directory: place.0.to_owned(),
        max_bytes: 64_000_000,
        configuration: "one".to_owned(),
    };
    let (journal, memory) = Journal::start(
        &settings,
        NorthSides::default(),
        Arc::clone(&shared.changed),
    )
    .unwrap();
    assert!(memory.contains_key(&name()));
    until("it is forgotten", || {
        (!is_remembered(&journal)).then_some(())
    });
    until("in the file too", || {
        reader::unused_drives(&place.file())
            .unwrap()
            .is_empty()
            .then_some(())
    });
}

/// The system may report a failed write although all of it is stored.
#[test]
fn what_a_failed_write_has_left_is_taken_back_and_written_once() {
    let place = Place::new();
    let drive = build::shared(&CONFIG).drives[0].description.clone();
    let open = || {
        JournalDatabase::open(&place.file(), "one", 64_000_000)
            .unwrap()
            .0
    };
    let none = BTreeSet::new();
    let mut book = JournalBook::default();
    let label = |at: MonoTime| WallTime {
        unix_ms: (at.as_nanos() / 1_000_000) as i64,
    };
    let tell = |book: &mut JournalBook, entry| book.take(1, &drive, MonoTime::ZERO, entry, &label);
    let trip = |code| {
        let record = TripRecord {
            at: MonoTime::ZERO,
            code: Some(code),
            words: Vec::new(),
        };
        let kind = TripEventKind::Tripped { trips: 1, record };
        JournalEntry::Trip(
            TripEvent {
                kind,
                count: None,
                at: MonoTime::ZERO,
                while_away: false,
            },
            TripBaseline::default(),
        )
    };
    let attempt = |id| {
        let tried = TriedWrite::Registers {
            address: 1_u16.into(),
            values: vec![2],
        };
        JournalEntry::Attempt(WriteAttempt {
            id: AttemptId(id),
            owner: Owner::Mqtt,
            tried,
            report: None,
        })
    };
    let mut database = open();
    tell(&mut book, trip(1));
    tell(&mut book, attempt(1));
    book.note(row::ended(WallTime { unix_ms: 0 }));
    database.write(&book, &none).unwrap();
    book.written();
    let mark = database.mark();
    tell(&mut book, trip(2));
    tell(&mut book, attempt(2));
    tell(
        &mut book,
        JournalEntry::Presence(crate::drive::snapshot::DrivePresence::Online),
    );
    database.write(&book, &none).unwrap();
    drop(database);

    tell(&mut book, trip(3));
    let mut database = open();
    database.count_audit_from(0);
    database.resume(&mark).unwrap();
    database.write(&book, &none).unwrap();
    book.written();
    tell(&mut book, trip(4));
    database.write(&book, &none).unwrap();
    let codes: Vec<_> = sound(place.rows(JournalTable::Event))
        .into_iter()
        .map(|row| (row.number, row.body))
        .collect();
    for (number, (found, body)) in (1..).zip(&codes) {
        assert!(
            number == *found && body.contains(&format!("\"code\":{number},")),
            "{codes:?}"
        );
    }
    assert_eq!(codes.len(), 4);
    assert_eq!(
        (
            place.rows(JournalTable::Audit).len(),
            place.rows(JournalTable::Availability).len()
        ),
        (2, 2)
    );

    // A mark of another file says nothing about this one.
    let other = Place::new();
    let mut database = JournalDatabase::open(&other.file(), "two", 64_000_000)
        .unwrap()
        .0;
    database.resume(&mark).unwrap();
    book.written();
    tell(&mut book, trip(1));
    database.write(&book, &none).unwrap();
    assert_eq!(sound(other.rows(JournalTable::Event))[0].number, 1);
}

#[test]
fn an_attempt_is_one_row_over_groups_and_lives() {
    let place = Place::new();
    for life in 0..2_u64 {
        let mut rig = Rig::start(&place);
        let tried = TriedWrite::Order(Order::Reset);
        let attempt = WriteAttempt {
            id: AttemptId(1),
            owner: Owner::Local,
            tried,
            report: None,
        };
        let row = rig.keep(JournalEntry::Attempt(attempt));
        rig.wait_for(row);
        assert!(
            sound(place.rows(JournalTable::Audit))[life as usize]
                .body
                .contains("\"outcome\":null")
        );
        let report = Report::new(Outcome::Confirmed, Reason::None);
        let row = rig.keep(JournalEntry::Ended {
            attempt: AttemptId(1),
            report,
        });
        rig.wait_for(row);
        rig.close();
        let rows = sound(place.rows(JournalTable::Audit));
        assert_eq!(
            rows.iter().map(|row| row.number).collect::<Vec<_>>(),
            (1..=life + 1).collect::<Vec<_>>()
        );
        assert!(
            rows[life as usize]
                .body
                .contains("\"outcome\":\"confirmed\""),
            "{rows:?}"
        );
    }
}

#[test]
fn a_full_journal_loses_the_oldest_commands_and_keeps_the_trips() {
    let place = Place::new();
    let mut rig = Rig::with(&place, 1_000_000);
    (1..=20).for_each(|count| {
        rig.trip(count);
    });
    for number in 0..20_000 {
        let row = rig.refuse(number);
        if number % 500 == 0 {
            rig.wait_for(row);
        }
    }
    let row = rig.refuse(20_000);
    rig.wait_for(row);
    let report = rig.journal.report();
    assert!(
        (500_000..1_300_000).contains(&report.size_bytes),
        "{report:?}"
    );
    assert_eq!((report.state, report.lost), (JournalState::Ok, 0));
    rig.close();
    let audit = sound(place.rows(JournalTable::Audit));
    assert!(
        audit[0].number > 10_000 && audit.last().unwrap().number == 20_001,
        "{:?}",
        audit[0]
    );
    assert_eq!(place.rows(JournalTable::Event).len(), 20);
    assert!(place.aside().is_empty());
}

#[test]
fn a_flipped_byte_costs_one_row() {
    let place = Place::new();
    let mut rig = Rig::start(&place);
    (0..3).for_each(|number| {
        rig.refuse(number);
    });
    (1..=3).for_each(|count| {
        rig.trip(count);
    });
    rig.close();
    place.wait_for_file();
    let mut bytes = std::fs::read(place.file()).unwrap();
    for text in [&b"no 1\""[..], &b"\"code\":2"[..]] {
        let at = bytes.windows(text.len()).position(|it| it == text).unwrap();
        bytes[at + 3] ^= 1;
    }
    std::fs::write(place.file(), bytes).unwrap();
    let audit = place.rows(JournalTable::Audit);
    assert!(
        matches!(
            audit[..],
            [ReadRow::Sound(_), ReadRow::Damaged(2), ReadRow::Sound(_)]
        ),
        "{audit:?}"
    );
    let rig = Rig::start(&place);
    rig.north.want_events(0);
    let seqs: Vec<_> = rig.events(2).0.into_iter().map(|event| event.seq).collect();
    assert_eq!(seqs, [1, 3], "a damaged event cannot be sent");
    assert_eq!(rig.journal.report().state, JournalState::Ok);
    rig.close();
    assert!(place.aside().is_empty());
}

#[test]
fn what_cannot_be_a_journal_is_moved_aside_and_never_overwritten() {
    let newer = |place: &Place| {
        Rig::start(place).close();
        rusqlite::Connection::open(place.file())
            .unwrap()
            .pragma_update(None, "user_version", 99)
            .unwrap();
    };
    let foreign = |place: &Place| {
        rusqlite::Connection::open(place.file())
            .unwrap()
            .execute_batch("CREATE TABLE theirs (a)")
            .unwrap();
    };
    let garbage = |place: &Place| {
        std::fs::write(place.file(), "this is no database at all".repeat(500)).unwrap()
    };
    let directory = |place: &Place| std::fs::create_dir(place.file()).unwrap();
    let makes: [&dyn Fn(&Place); 4] = [&newer, &foreign, &garbage, &directory];
    for make in makes {
        let place = Place::new();
        make(&place);
        let mut rig = Rig::start(&place);
        let row = rig.trip(1);
        rig.wait_for(row);
        let report = rig.journal.report();
        assert_eq!(
            (report.state, report.moved_aside.is_some()),
            (JournalState::Ok, true),
            "{report:?}"
        );
        rig.close();
        assert_eq!(
            (place.aside().len(), place.rows(JournalTable::Event).len()),
            (1, 1)
        );
        let said = sound(place.rows(JournalTable::Availability));
        assert!(
            said.iter().any(|row| row.body.contains("begun_anew")),
            "{said:?}"
        );
    }
}

#[test]
fn a_truncated_journal_gives_what_nobody_had_taken_to_the_next() {
    let place = Place::new();
    let mut rig = Rig::start(&place);
    (1..=3).for_each(|count| {
        rig.trip(count);
    });
    (0..4000).for_each(|number| {
        rig.refuse(number);
    });
    rig.close();
    place.wait_for_file();
    let file = std::fs::OpenOptions::new()
        .write(true)
        .open(place.file())
        .unwrap();
    file.set_len(file.metadata().unwrap().len() / 2).unwrap();
    let mut rig = Rig::start(&place);
    let row = rig.trip(4);
    rig.wait_for(row);
    // If the start did not find the damage, the check of the whole file does.
    until("it is moved aside", || rig.journal.report().moved_aside);
    assert_eq!(rig.memory[&name()].trips_total, 3);
    rig.north.want_events(0);
    let seqs: Vec<_> = rig.events(4).0.into_iter().map(|event| event.seq).collect();
    assert_eq!(seqs[seqs.len() - 4..], [1, 2, 3, 4]);
    let row = rig.trip(5);
    rig.wait_for(row);
    rig.close();
    assert_eq!(
        sound(place.rows(JournalTable::Event))
            .iter()
            .map(|row| row.number)
            .collect::<Vec<_>>(),
        [1, 2, 3, 4, 5]
    );
}

/// The sound rows of a table that can be read at `path`, which may be damaged. It terminates whatever the file
/// contains.
fn readable(path: &Path, table: JournalTable, most: usize) -> Vec<JournalRow> {
    let Ok(connection) = reader::salvage(path) else {
        return Vec::new();
    };
    let rows: Vec<_> = TableRows::after(&connection, table, 0)
        .take(most + 1)
        .collect();
    assert!(
        rows.len() <= most,
        "{}: {} rows of {most}",
        table.name(),
        rows.len()
    );
    rows.into_iter()
        .filter_map(|row| {
            if let Ok(ReadRow::Sound(row)) = row {
                Some(row)
            } else {
                None
            }
        })
        .collect()
}

#[test]
fn a_journal_that_was_cut_anywhere_is_read_to_its_end_and_its_sound_rows_are_kept() {
    let place = Place::new();
    let mut rig = Rig::start(&place);
    for count in 1..=20 {
        rig.trip(count);
        (0..20).for_each(|number| {
            rig.refuse(u64::from(count) * 100 + number);
        });
    }
    let row = rig.trip(21);
    rig.wait_for(row);
    rig.close();
    place.wait_for_file();
    let whole = std::fs::read(place.file()).unwrap();
    let rows = JournalTable::ALL.map(|table| sound(place.rows(table)));
    let most = rows.iter().map(Vec::len).max().unwrap() + 2;
    assert!(
        whole.len() >= 10 * 4096 && most > 300,
        "{} bytes, {most} rows",
        whole.len()
    );
    let at_pages = (0..=whole.len() / 4096)
        .flat_map(|page| [0, 1, 41, 2048, 4095].map(|more| page * 4096 + more));
    let cuts: BTreeSet<_> = at_pages
        .chain((0..whole.len()).step_by(1999))
        .filter(|cut| *cut < whole.len())
        .collect();
    for (number, cut) in cuts.into_iter().enumerate() {
        let place = Place::new();
        std::fs::write(place.file(), &whole[..cut]).unwrap();
        let left = JournalTable::ALL.map(|table| readable(&place.file(), table, most));
        for (left, rows) in left.iter().zip(&rows) {
            assert!(
                left.iter().all(|row| rows.contains(row)),
                "cut to {cut}: rows that never were"
            );
        }
        if cut > 4096 && number % 3 != 0 {
            continue;
        }
        let mut rig = Rig::start(&place);
        let row = rig.trip(99);
        rig.wait_for(row);
        let report = rig.journal.report();
        assert_eq!(
            (report.state, report.moved_aside.is_some()),
            (JournalState::Ok, cut > 0),
            "cut to {cut}"
        );
        rig.close();
        let now = JournalTable::ALL.map(|table| sound(place.rows(table)));
        for (left, now) in left.iter().zip(&now) {
            assert!(
                left.iter().all(|row| now.contains(row)),
                "cut to {cut}: sound rows are lost"
            );
        }
        assert!(
            now.iter()
                .flatten()
                .any(|row| row.body.contains("begun_anew")),
            "cut to {cut}: without a word"
        );
    }
    let almost = Place::new();
    std::fs::write(almost.file(), &whole[..whole.len() - 1]).unwrap();
    let left: usize = JournalTable::ALL
        .iter()
        .map(|table| readable(&almost.file(), *table, most).len())
        .sum();
    assert!(left > 200, "{left} rows are left where one byte is missing");
}

#[test]
fn a_log_without_its_file_is_kept_and_not_removed() {
    let place = Place::new();
    std::fs::write(place.0.join("journal.db-wal"), "all there is").unwrap();
    for is_there in [false, true] {
        if is_there {
            std::fs::remove_dir_all(&place.0).unwrap();
            std::fs::create_dir(&place.0).unwrap();
            std::fs::write(place.0.join("journal.db-wal"), "all there is").unwrap();
            std::fs::write(place.file(), "").unwrap();
        }
        let mut rig = Rig::start(&place);
        let row = rig.trip(1);
        rig.wait_for(row);
        let aside = rig.journal.report().moved_aside.unwrap();
        rig.close();
        assert_eq!(
            std::fs::read_to_string(format!("{aside}-wal")).unwrap(),
            "all there is"
        );
    }
}

#[test]
fn too_many_damaged_ones_are_not_added_to_and_control_goes_on() {
    let place = Place::new();
    for number in 0..8 {
        std::fs::write(place.0.join(format!("journal.db.damaged-{number}")), "").unwrap();
    }
    std::fs::write(place.file(), "this is no database at all".repeat(500)).unwrap();
    let mut rig = Rig::start(&place);
    rig.trip(1);
    let report = rig.journal.report();
    assert_eq!(report.state, JournalState::Memory);
    assert!(report.reason.unwrap().contains("8 damaged journals"));
    assert!(!rig.source.is_sound());
    std::fs::remove_file(place.0.join("journal.db.damaged-0")).unwrap();
    rig.north.want_events(0);
    until("it recovers by itself", || {
        (rig.journal.report().state == JournalState::Ok).then_some(())
    });
    assert_eq!(
        rig.events(1).0[0].seq,
        1,
        "what waited in memory is written"
    );
    rig.close();
    assert_eq!(place.aside().len(), 8);
}

#[test]
fn a_journal_that_cannot_be_written_keeps_the_newest_and_goes_on_by_itself() {
    let place = Place::new();
    let mut rig = Rig::start(&place);
    rig.north.want_events(0);
    rig.trip(1);
    assert_eq!(rig.events(1).0[0].seq, 1);
    rig.north.want_events(1);
    // Another process holds it.
    let other = rusqlite::Connection::open(place.file()).unwrap();
    other.execute_batch("BEGIN IMMEDIATE").unwrap();
    let row = rig.trip(2);
    until("it says so", || {
        (rig.journal.report().state == JournalState::Failed).then_some(())
    });
    assert!(!rig.source.origin().has_kept(row));
    assert!(rig.journal.report().reason.unwrap().contains("locked"));
    assert_eq!(rig.events(0).0, [], "what is not on the disk is not sent");
    other.execute_batch("COMMIT").unwrap();
    rig.wait_for(row);
    assert_eq!(
        (rig.events(1).0[0].seq, rig.journal.report().state),
        (2, JournalState::Ok)
    );
    rig.close();
}

#[test]
fn a_file_that_is_deleted_while_it_is_open_is_told_and_written_again_with_all_rows() {
    for files in [
        &["journal.db"][..],
        &["journal.db", "journal.db-wal", "journal.db-shm"],
    ] {
        let place = Place::new();
        let mut rig = Rig::start(&place);
        for number in 1..=3 {
            rig.refuse(number);
        }
        let row = rig.trip(1);
        rig.wait_for(row);
        for file in files {
            std::fs::remove_file(place.0.join(file)).unwrap();
        }
        let replaced = until("it is reported", || rig.journal.report().replaced);
        assert!(
            replaced.contains("was deleted") && replaced.contains("all rows"),
            "{replaced}"
        );
        let row = rig.trip(2);
        rig.wait_for(row);
        assert_eq!(rig.journal.report().state, JournalState::Ok);
        rig.close();
        let kinds = |table| {
            sound(place.rows(table))
                .into_iter()
                .map(|row| row.kind)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            (
                kinds(JournalTable::Event).len(),
                kinds(JournalTable::Audit).len()
            ),
            (2, 3),
            "{files:?}"
        );
        assert!(
            kinds(JournalTable::Availability)
                .iter()
                .any(|kind| kind.contains("journal")),
            "{files:?}"
        );
        assert_eq!(place.aside(), [""; 0]);
    }
}

#[test]
fn a_log_that_is_deleted_costs_no_row() {
    let place = Place::new();
    let status = Arc::<JournalStatus>::default();
    let (mut store, found) = JournalStore::open(&place.file(), 64_000_000, &status);
    let mut book = JournalBook::new(found.memory);
    let mut write = |store: &mut JournalStore, version| {
        book.note(row::started(WallTime { unix_ms: 1 }, version, "one", false));
        assert!(store.write(&mut book, &BTreeSet::new()));
        book.written();
    };
    write(&mut store, "1");
    store.reopen_if_replaced();
    assert_eq!(status.report().replaced, None);
    std::fs::remove_file(place.0.join("journal.db-wal")).unwrap();
    store.reopen_if_replaced();
    let replaced = status.report().replaced.unwrap();
    assert!(
        replaced.contains("log was deleted") && replaced.contains("all rows"),
        "{replaced}"
    );
    write(&mut store, "2");
    drop(store);
    let rows = sound(place.rows(JournalTable::Availability));
    assert!(
        ["\"1\"", "\"2\""]
            .iter()
            .all(|version| rows.iter().any(|row| row.body.contains(version))),
        "{rows:?}"
    );
}

#[test]
fn a_file_that_is_replaced_is_told_and_the_new_one_is_continued() {
    let (place, other) = (Place::new(), Place::new());
    let mut rig = Rig::start(&other);
    let row = rig.trip(7);
    rig.wait_for(row);
    rig.close();
    other.wait_for_file();
    let mut rig = Rig::start(&place);
    let row = rig.trip(1);
    rig.wait_for(row);
    // The log of the old one stays, and is not taken for one of the new.
    std::fs::rename(other.file(), place.file()).unwrap();
    let replaced = until("it is reported", || rig.journal.report().replaced);
    assert!(replaced.contains("was replaced"), "{replaced}");
    let row = rig.trip(2);
    rig.wait_for(row);
    rig.close();
    assert_eq!(
        sound(place.rows(JournalTable::Event)).len(),
        2,
        "of the other one, and the new"
    );
}

#[test]
fn nobody_is_reported_more_than_he_has_room_for() {
    let place = Place::new();
    let mut rig = Rig::start(&place);
    for count in 1..=40 {
        let row = rig.trip(count);
        rig.wait_for(row);
    }
    for (after, first, last, has_more) in
        [(0, 1, 16, true), (16, 17, 32, true), (32, 33, 40, false)]
    {
        (1..=after).for_each(|seq| rig.north.event_taken(seq));
        rig.north.want_events(after);
        let (events, more) = rig.events(8);
        assert_eq!(
            (events[0].seq, events.last().unwrap().seq, more),
            (first, last, has_more)
        );
    }
    rig.close();
}
