//! A start beside a large journal: it serves within a second.
//!
//! A hundred thousand rows here; `ROWS=1000000 cargo test --test process beginning` for more.

use super::mosquitto::free_port;
use super::raw::Raw;
use super::rig::{Place, program};
use super::started::{PATIENCE, Started, until};
use super::yard::{Drive, FAMILIES, configuration};
use rusqlite::{Connection, params};
use serde_json::json;
use std::net::SocketAddr;
use std::path::Path;
use std::time::{Duration, Instant};
use vfd_gateway::domain::time::WallTime;
use vfd_gateway::journal::{JournalRow, JournalTable};

/// How many starts are measured.
const STARTS: usize = 3;
/// What is promised.
const WITHIN: Duration = Duration::from_secs(1);
/// What else a start may take on a machine that is busy with other tests, the program of a debug build included.
const MARGIN: Duration = Duration::from_secs(2);

#[test]
fn a_large_journal_delays_no_start() {
    let place = Place::new();
    let drive = Drive::new(&FAMILIES[0], &place);
    std::fs::create_dir(place.file("data")).unwrap();
    let modbus = SocketAddr::from(([127, 0, 0, 1], free_port()));
    let more = "[journal]\nmax_size = \"4GB\"\n";
    let file = place.write(
        "gateway.toml",
        &configuration(&place, [drive.family], modbus, more),
    );
    let serves = || {
        let mut command = program();
        command.arg("run").arg("-c").arg(&file);
        let begun = Instant::now();
        let mut gateway = Started::new(command);
        until("it serves", PATIENCE, || {
            Raw::try_connect(modbus)?.read_unit(101, 0, 1).ok()
        });
        let took = begun.elapsed();
        gateway.terminate();
        assert!(gateway.end_within(PATIENCE).success(), "{}", gateway.text());
        assert!(!gateway.text().contains("ALARM"), "{}", gateway.text());
        took
    };
    // What else goes on at this machine makes a start longer and never shorter.
    let shortest = |journal: &Path| {
        let starts = (0..STARTS).map(|_| {
            // Each finds it as the first one does.
            std::fs::copy(journal, place.file("data/journal.db")).unwrap();
            serves()
        });
        starts.min().unwrap()
    };
    serves();
    let (small, filled) = (place.file("small.db"), place.file("filled.db"));
    for copy in [&small, &filled] {
        std::fs::copy(place.file("data/journal.db"), copy).unwrap();
    }
    let count = std::env::var("ROWS")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or(100_000);
    fill(&filled, count);
    let (empty, large) = (shortest(&small), shortest(&filled));
    println!("it serves after {empty:?} without rows, after {large:?} beside {count}");
    assert!(
        large < WITHIN + MARGIN && large < empty + WITHIN,
        "{large:?}, {empty:?} without rows"
    );
}

/// Puts `count` rows into the audit and a tenth of that into each other table, as the gateway itself would have.
pub fn fill(path: &Path, count: u64) {
    let mut connection = Connection::open(path).unwrap();
    let transaction = connection.transaction().unwrap();
    for (table, count) in [
        (JournalTable::Audit, count),
        (JournalTable::Availability, count / 10),
        (JournalTable::Event, count / 10),
    ] {
        let sql = format!(
            "INSERT INTO {} (number, at, kind, name, body, crc) VALUES (?, ?, ?, ?, ?, ?)",
            table.name()
        );
        let mut put = transaction.prepare(&sql).unwrap();
        for number in 0..count {
            let body = json!({ "by": "mqtt", "tried": format!("{number} Hz, run forward"), "count": 1, "outcome": "refused" });
            let at = WallTime {
                unix_ms: 1_767_225_600_000 + number as i64,
            };
            let row = JournalRow {
                number: 1_000 + number,
                ..JournalRow::new(at, "attempt", Some("n700"), &body)
            };
            put.execute(params![
                row.number,
                row.at.unix_ms,
                row.kind,
                row.name,
                row.body,
                row.crc(table)
            ])
            .unwrap();
        }
    }
    transaction.commit().unwrap();
}
