//! What is kept survives a restart, stays bounded, and is found by drive.

use super::*;
use crate::daemon::testing::Dir;
use crate::domain::ids::Name;
use crate::north::page::kept::{LEVELS, TrendCell, TrendLevel};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

const COLUMNS: &str =
    r#"[{"name":"output_frequency","label":"Output frequency","unit":"Hz","digits":2}]"#;
const HOUR: TrendLevel = LEVELS[2];

fn minute(drive: &str, at_s: i64, hertz: f64) -> TrendMinute {
    TrendMinute {
        drive: Name::new(drive).unwrap(),
        columns: COLUMNS.to_owned(),
        at_s,
        cells: vec![TrendCell::of(hertz)],
    }
}

fn values(file: &Path, drive: &str, level: TrendLevel) -> Value {
    history(file, drive, level, level.rows, i64::MAX, None)
        .unwrap()
        .document(drive)["values"]
        .clone()
}

#[test]
fn a_minute_is_merged_into_its_row_of_each_level_also_after_a_restart() {
    let directory = Dir::new();
    let file = directory.join(FILE_NAME);
    assert_eq!(
        values(&file, "pump-1", HOUR),
        json!([]),
        "nothing was kept yet"
    );
    let day = 86_400;
    let mut store = TrendStore::open(&file).unwrap();
    store
        .write(&[minute("pump-1", day, 10.0), minute("fan-2", day, 50.0)])
        .unwrap();
    drop(store);
    TrendStore::open(&file)
        .unwrap()
        .write(&[
            minute("pump-1", day + 60, 20.0),
            minute("pump-1", day + 3600, 40.0),
        ])
        .unwrap();
    assert_eq!(values(&file, "pump-1", HOUR), json!([[15.0, 40.0]]));
    assert_eq!(
        values(&file, "pump-1", LEVELS[1]),
        json!([[15.0, null, null, null, null, null, 40.0]])
    );
    assert_eq!(
        values(&file, "pump-1", LEVELS[0])[0]
            .as_array()
            .unwrap()
            .len(),
        61
    );
    assert_eq!(values(&file, "fan-2", HOUR), json!([[50.0]]));
    assert_eq!(values(&file, "mill-3", HOUR), json!([]));
    let of_before = history(&file, "pump-1", HOUR, HOUR.rows, day + 3599, None)
        .unwrap()
        .document("pump-1");
    assert_eq!(
        of_before["values"],
        json!([[15.0]]),
        "what the clock has not reached is not shown"
    );
}

#[test]
fn the_file_stays_bounded_and_a_clock_that_was_set_ahead_deletes_no_more_than_it_adds() {
    let directory = Dir::new();
    let file = directory.join(FILE_NAME);
    let mut store = TrendStore::open(&file).unwrap();
    let rows = i64::try_from(HOUR.rows).unwrap();
    let minutes = |from: i64, count: i64| {
        (from..from + count)
            .map(|it| minute("pump-1", it * 3600, 1.0))
            .collect::<Vec<_>>()
    };
    store.write(&minutes(0, rows + 100)).unwrap();
    let kept = |from: i64, until: i64| {
        let history = history(&file, "pump-1", HOUR, usize::MAX >> 1, until * 3600, None).unwrap();
        let list = history.list();
        let text = crate::domain::calendar::rfc3339(crate::domain::time::WallTime {
            unix_ms: from * 3_600_000,
        });
        (list.as_array().unwrap().len(), list[0]["time"] == text)
    };
    assert_eq!(kept(100, rows + 100), (HOUR.rows, true));
    let years_ahead = 1_000_000;
    store.write(&minutes(years_ahead, 2)).unwrap();
    assert_eq!(kept(102, rows + 100), (HOUR.rows - 2, true));
}

#[test]
fn a_damaged_file_is_moved_aside_and_new_trends_are_kept() {
    let directory = Dir::new();
    let file = directory.join(FILE_NAME);
    std::fs::write(
        &file,
        "this is no database, and longer than the head of one. ".repeat(100),
    )
    .unwrap();
    let trends = KeptTrends::start(&directory).unwrap();
    trends.keep(vec![minute("pump-1", 60, 10.0)]);
    let end = Instant::now() + Duration::from_secs(60);
    let aside = || std::fs::read_dir(&directory).unwrap().count();
    while aside() < 1 || file.exists() {
        assert!(Instant::now() < end, "it is not moved aside");
        std::thread::yield_now();
    }
    trends.keep(vec![minute("pump-1", 120, 30.0)]);
    while !file.exists()
        || history(&file, "pump-1", HOUR, 1, i64::MAX, None)
            .map_or(true, |it| it.list() == json!([]))
    {
        assert!(Instant::now() < end, "nothing is kept");
        std::thread::yield_now();
    }
    assert_eq!(values(&file, "pump-1", HOUR), json!([[30.0]]));
}

#[test]
fn a_file_that_is_deleted_while_it_is_open_starts_again() {
    let directory = Dir::new();
    let file = directory.join(FILE_NAME);
    let mut writer = TrendWriter {
        file: file.clone(),
        store: None,
        opened: None,
        is_failure_logged: false,
    };
    writer.write(&[minute("pump-1", 86_400, 10.0)]).unwrap();
    for part in ["", "-wal", "-shm"] {
        std::fs::remove_file(format!("{}{part}", file.display())).unwrap();
    }
    writer.write(&[minute("pump-1", 90_000, 20.0)]).unwrap();
    assert_eq!(values(&file, "pump-1", HOUR), json!([[20.0]]));
}
