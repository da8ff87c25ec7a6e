//! Trends that are kept: every polled value with a unit, in rows of a minute, ten minutes and an hour.
//!
//! A minute is collected in memory and returned as a whole. The store merges it into its row of each [`TrendLevel`], so
//! that an end without notice loses at most the minute that was being collected.

use super::drive::PageDrive;
use super::trend::TrendColumn;
use crate::domain::ids::Name;
use crate::domain::time::{MonoTime, WallTime};
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::profile::model::{PollClass, Register, RegisterRole};
use serde_json::Value;
use std::collections::BTreeMap;

/// Rows of one length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrendLevel {
    /// The span that all of them cover, as it is asked for.
    pub span: &'static str,
    /// Seconds from one row to the next.
    pub step_s: i64,
    /// Most rows.
    pub rows: usize,
}

/// All levels, finest first.
pub const LEVELS: [TrendLevel; 3] = [
    TrendLevel {
        span: "24h",
        step_s: 60,
        rows: 1440,
    },
    TrendLevel {
        span: "7d",
        step_s: 600,
        rows: 1008,
    },
    TrendLevel {
        span: "30d",
        step_s: 3600,
        rows: 720,
    },
];
/// Most values of a drive.
pub const COLUMNS_MAX: usize = 32;
/// Bytes of a stored [`TrendCell`].
const CELL_BYTES: usize = 16;

/// What was seen of one value within a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrendCell {
    /// The smallest one.
    pub min: f32,
    /// The mean.
    pub mean: f32,
    /// The largest one.
    pub max: f32,
    /// How often it was seen; 0 if it was always stale, and the others mean nothing then.
    pub count: u32,
}

impl TrendCell {
    /// Nothing was seen.
    pub const EMPTY: Self = Self {
        min: 0.0,
        mean: 0.0,
        max: 0.0,
        count: 0,
    };

    /// One value.
    #[must_use]
    pub fn of(value: f64) -> Self {
        let value = value as f32;
        Self {
            min: value,
            mean: value,
            max: value,
            count: 1,
        }
    }

    /// One cell for all values of this cell and `other`.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        match (self.count, other.count) {
            (_, 0) => self,
            (0, _) => other,
            (one, two) => {
                let count = one.saturating_add(two);
                let sum =
                    f64::from(self.mean) * f64::from(one) + f64::from(other.mean) * f64::from(two);
                let mean = (sum / f64::from(count)) as f32;
                Self {
                    min: self.min.min(other.min),
                    mean,
                    max: self.max.max(other.max),
                    count,
                }
            }
        }
    }

    fn bytes(self) -> [u8; CELL_BYTES] {
        let parts = [
            self.min.to_le_bytes(),
            self.mean.to_le_bytes(),
            self.max.to_le_bytes(),
            self.count.to_le_bytes(),
        ];
        let mut bytes = [0; CELL_BYTES];
        bytes
            .chunks_exact_mut(4)
            .zip(parts)
            .for_each(|(place, part)| place.copy_from_slice(&part));
        bytes
    }

    fn read(bytes: &[u8]) -> Option<Self> {
        let (words, _) = bytes.as_chunks::<4>();
        let [min, mean, max, count] = *words.first_chunk::<4>()?;
        let [min, mean, max] = [min, mean, max].map(f32::from_le_bytes);
        let cell = Self {
            min,
            mean,
            max,
            count: u32::from_le_bytes(count),
        };
        [min, mean, max]
            .iter()
            .all(|it| it.is_finite())
            .then_some(cell)
    }
}

/// Cells as they are stored.
#[must_use]
pub fn stored(cells: &[TrendCell]) -> Vec<u8> {
    cells.iter().flat_map(|cell| cell.bytes()).collect()
}

/// Stored cells; `None` if these are none.
#[must_use]
pub fn cells(bytes: &[u8]) -> Option<Vec<TrendCell>> {
    let whole = bytes.chunks_exact(CELL_BYTES);
    whole
        .remainder()
        .is_empty()
        .then(|| whole.map(TrendCell::read).collect())
        .flatten()
}

/// Merges `newer` into the stored row `bytes`. A row that is damaged or of another length is replaced.
#[must_use]
pub fn merged(bytes: &[u8], newer: &[TrendCell]) -> Vec<u8> {
    match cells(bytes).filter(|older| older.len() == newer.len()) {
        Some(older) => stored(
            &older
                .into_iter()
                .zip(newer)
                .map(|(one, two)| one.with(*two))
                .collect::<Vec<_>>(),
        ),
        None => stored(newer),
    }
}

/// A finished minute of one drive.
#[derive(Clone, Debug, PartialEq)]
pub struct TrendMinute {
    /// The drive.
    pub drive: Name,
    /// Its values as a JSON document; the same text as long as they are the same.
    pub columns: String,
    /// When it began, in seconds since 1970-01-01 UTC.
    pub at_s: i64,
    /// One for each value.
    pub cells: Vec<TrendCell>,
}

/// The minutes of all drives that are being collected.
#[derive(Debug, Default)]
pub struct MinuteCollector {
    drives: BTreeMap<Name, CollectedMinute>,
    at_s: Option<i64>,
}

#[derive(Debug)]
struct CollectedMinute {
    columns: Vec<TrendColumn>,
    /// The columns as a JSON document.
    document: String,
    cells: Vec<TrendCell>,
}

impl MinuteCollector {
    /// Takes over these drives. What was collected of one that is unchanged continues.
    pub fn change_to<'d>(&mut self, drives: impl IntoIterator<Item = &'d DriveDescription>) {
        let mut old = std::mem::take(&mut self.drives);
        for drive in drives {
            let columns = columns(drive);
            let known = old
                .remove(&drive.name)
                .filter(|known| known.columns == columns);
            let new = || {
                let document = columns
                    .iter()
                    .map(TrendColumn::kept)
                    .collect::<Value>()
                    .to_string();
                CollectedMinute {
                    cells: vec![TrendCell::EMPTY; columns.len()],
                    document,
                    columns,
                }
            };
            self.drives
                .insert(drive.name.clone(), known.unwrap_or_else(new));
        }
    }

    /// Takes the values of each of `drives` at `wall`. Returns the minute before, of all drives, when another one begins.
    pub fn note<'d>(
        &mut self,
        wall: WallTime,
        now: MonoTime,
        drives: impl IntoIterator<Item = PageDrive<'d>>,
    ) -> Vec<TrendMinute> {
        let at_s = wall.unix_ms.div_euclid(60_000) * 60;
        let before = self.at_s.replace(at_s).filter(|before| *before != at_s);
        let finished = before.map(|at_s| self.finish(at_s)).unwrap_or_default();
        for drive in drives {
            let Some(CollectedMinute { columns, cells, .. }) =
                self.drives.get_mut(&drive.description.name)
            else {
                continue;
            };
            for (column, cell) in columns.iter().zip(cells) {
                *cell = column
                    .read(&drive, now)
                    .map_or(*cell, |value| cell.with(TrendCell::of(value)));
            }
        }
        finished
    }

    fn finish(&mut self, at_s: i64) -> Vec<TrendMinute> {
        let drives = self
            .drives
            .iter_mut()
            .filter(|(_, it)| it.cells.iter().any(|cell| cell.count > 0));
        let minute = |(drive, it): (&Name, &mut CollectedMinute)| {
            let cells = it
                .cells
                .iter_mut()
                .map(|cell| std::mem::replace(cell, TrendCell::EMPTY))
                .collect();
            TrendMinute {
                drive: drive.clone(),
                columns: it.document.clone(),
                at_s,
                cells,
            }
        };
        drives.map(minute).collect()
    }
}

/// Everything that is polled again and again and has a unit, with the setpoint; the output frequency first.
fn columns(drive: &DriveDescription) -> Vec<TrendColumn> {
    let model = &drive.model;
    let setting = model
        .setting_register()
        .map(|register| register.name.as_str());
    let is_kept = |register: &&Register| {
        register.poll.is_some_and(PollClass::is_live)
            && register.unit != UnitOfMeasure::None
            && Some(register.name.as_str()) != setting
    };
    let is_output = |register: &&Register| register.role == Some(RegisterRole::OutputFrequency);
    let column = |register: &Register| TrendColumn::of_register(drive, register);
    let (outputs, others): (Vec<_>, Vec<_>) =
        model.registers.iter().filter(is_kept).partition(is_output);
    let outputs = outputs.into_iter().filter_map(column);
    let all = outputs
        .chain(TrendColumn::of_setpoint(drive))
        .chain(others.into_iter().filter_map(column));
    all.take(COLUMNS_MAX).collect()
}

#[cfg(test)]
mod tests {
    use super::super::testing::{NOW, description, view};
    use super::*;

    #[test]
    fn what_is_stored_is_read_as_it_was_and_anything_else_is_not() {
        let row = [
            TrendCell::of(50.0).with(TrendCell::of(20.0)),
            TrendCell::EMPTY,
            TrendCell {
                count: u32::MAX,
                ..TrendCell::of(-0.5)
            },
        ];
        assert_eq!(
            row[0],
            TrendCell {
                min: 20.0,
                mean: 35.0,
                max: 50.0,
                count: 2
            }
        );
        let bytes = stored(&row);
        assert_eq!(cells(&bytes).unwrap(), row);
        assert_eq!(cells(&bytes[1..]), None);
        let infinite = [f32::INFINITY.to_le_bytes(); 4].concat();
        assert_eq!(cells(&infinite), None);
        assert_eq!(
            merged(&bytes[1..], &row),
            bytes,
            "a damaged row is replaced"
        );
    }

    #[test]
    fn rows_are_merged_by_how_often_each_value_was_seen() {
        let minute = |value: f64, count: u32| TrendCell {
            count,
            ..TrendCell::of(value)
        };
        let older = stored(&[minute(10.0, 30), TrendCell::EMPTY, minute(7.0, 1)]);
        let row = cells(&merged(
            &older,
            &[minute(40.0, 10), minute(3.0, 2), TrendCell::EMPTY],
        ))
        .unwrap();
        assert_eq!(
            row[0],
            TrendCell {
                min: 10.0,
                mean: 17.5,
                max: 40.0,
                count: 40
            }
        );
        assert_eq!((row[1], row[2]), (minute(3.0, 2), minute(7.0, 1)));
    }

    #[test]
    fn a_minute_is_handed_out_when_the_next_one_begins_even_if_the_clock_was_set() {
        let description = description("hyundai-n700");
        let mut collector = MinuteCollector::default();
        collector.change_to([&description]);
        let wall = |s: i64| WallTime { unix_ms: s * 1000 };
        let mut note = |s: i64, word: u16| {
            let view = view(&description, word);
            collector.note(
                wall(s),
                NOW,
                [PageDrive {
                    description: &description,
                    view: &view,
                    station: None,
                    standby: None,
                }],
            )
        };
        assert_eq!(note(600, 1000), []);
        assert_eq!(note(659, 3000), []);
        let finished = note(660, 5000);
        assert_eq!(finished.len(), 1);
        assert_eq!(finished[0].at_s, 600);
        assert_eq!(
            finished[0].cells[0],
            TrendCell {
                min: 10.0,
                mean: 20.0,
                max: 30.0,
                count: 2
            }
        );
        let earlier = note(0, 1000);
        assert_eq!(
            (earlier[0].at_s, earlier[0].cells[0].mean),
            (660, 50.0),
            "the clock went back"
        );
        let columns: Value = serde_json::from_str(&earlier[0].columns).unwrap();
        assert_eq!(columns[0]["name"], "output_frequency");
        assert_eq!(columns.as_array().unwrap().len(), earlier[0].cells.len());
    }
}
