//! The journal: how long until a trip is on the disk, alternating with a bare write, and rows in groups.

use crate::plant::{Place, Setup};
use crate::table::{Row, Times};
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::daemon::exchange::north_sides::NorthSides;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::daemon::journal::{Journal, JournalSource, Settings};
use vfd_gateway::daemon::lines::build;
use vfd_gateway::domain::command::{Owner, Reason, Report};
use vfd_gateway::domain::ids::DriveIndex;
use vfd_gateway::drive::view::{TripEvent, TripEventKind, TripRecord};
use vfd_gateway::journal::{
    AttemptId, EntryToKeep, JournalEntry, RowNumber, TriedWrite, TripBaseline, WriteAttempt,
};

/// What a trip may take beyond a bare write, in ms.
const MARGIN_MS: f64 = 2.0;
/// Bytes of the bare write: what a small transaction adds to the log.
const BARE_BYTES: usize = 4 * 4096;
/// Rows that are put at once.
const GROUP: u64 = 2000;

pub fn journal() -> Vec<Row> {
    let (trips, groups) = if crate::is_quick() {
        (200, 10)
    } else {
        (2000, 50)
    };
    let place = Place::new();
    let setup = Setup {
        device: Path::new("/dev/null"),
        drives: 1,
        unpaced: false,
        poll: "250ms",
        mqtt: None,
        listen: 0,
    };
    let shared = Arc::new(build::shared(&setup.config()));
    let settings = Settings {
        directory: place.path().to_owned(),
        max_bytes: 64_000_000,
        configuration: String::new(),
    };
    let (journal, _) = Journal::start(
        &settings,
        NorthSides::default(),
        Arc::clone(&shared.changed),
    )
    .expect("a journal");
    let line = &shared.lines[0];
    let drives = vec![shared.drives[0].description.clone()];
    let mut writer = Writer {
        source: journal.line(line.name.clone(), drives, Arc::clone(&line.inbox)),
        row: 0,
    };
    let mut bare = File::create(place.path().join("bare")).expect("a file");
    let mut ours = Vec::new();
    let mut theirs = Vec::new();
    for _ in 0..trips {
        theirs.push(bare_write(&mut bare));
        ours.push(writer.kept(Writer::trip));
    }
    let ours = Times::new(ours);
    let theirs = Times::new(theirs);
    let begun = clock::now();
    for _ in 0..groups {
        for _ in 1..GROUP {
            writer.put(Writer::refusal);
        }
        writer.kept(Writer::refusal);
    }
    let rate = (groups * GROUP) as f64 / clock::now().since(begun).as_secs_f64();
    let report = journal.report();
    vec![
        Row::told(
            "journal: bare write and fdatasync, p50 / p99 / max, ms",
            theirs.shown(),
        ),
        Row::told(
            "journal: trip until it is on the disk, p50 / p99 / max, ms",
            ours.shown(),
        ),
        Row::at_most(
            "journal: p99 of a trip against that of the bare write and 2 ms, ms",
            theirs.at(0.99) + MARGIN_MS,
            ours.at(0.99),
        ),
        Row::told("journal: refusals in groups, rows/s", format!("{rate:.0}")),
        Row::none("journal: rows lost", report.lost),
    ]
}

struct Writer {
    source: JournalSource,
    row: u64,
}

impl Writer {
    fn put(&mut self, entry: fn(u64) -> JournalEntry) -> RowNumber {
        self.row += 1;
        let row = RowNumber(self.row);
        self.source.keep(EntryToKeep {
            row,
            drive: DriveIndex(0),
            at: clock::now(),
            entry: entry(self.row),
        });
        row
    }

    /// How long until it is kept.
    fn kept(&mut self, entry: fn(u64) -> JournalEntry) -> Duration {
        let begun = clock::now();
        let row = self.put(entry);
        while !self.source.origin().has_kept(row) {
            std::thread::yield_now();
        }
        clock::now().since(begun)
    }

    fn trip(number: u64) -> JournalEntry {
        let words = (0x0111_u16..0x0117)
            .map(|address| (address.into(), number as u16))
            .collect();
        let record = TripRecord {
            at: clock::now(),
            code: Some(1),
            words,
        };
        let event = TripEvent {
            kind: TripEventKind::Tripped { trips: 1, record },
            count: None,
            at: clock::now(),
            while_away: false,
        };
        JournalEntry::Trip(event, TripBaseline::default())
    }

    fn refusal(number: u64) -> JournalEntry {
        let tried = TriedWrite::Text(format!("no {number}"));
        let report = Some(Report::refused(Reason::NotUnderstood));
        JournalEntry::Attempt(WriteAttempt {
            id: AttemptId(number),
            owner: Owner::Mqtt,
            tried,
            report,
        })
    }
}

fn bare_write(file: &mut File) -> Duration {
    let begun = clock::now();
    file.write_all(&[0x55; BARE_BYTES]).expect("written");
    file.sync_data().expect("synced");
    clock::now().since(begun)
}
