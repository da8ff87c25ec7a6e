//! Kept trends of one drive as a document: for the page, for dashboards, or as CSV.

use super::kept::{TrendCell, TrendLevel};
use crate::domain::calendar::rfc3339;
use crate::domain::time::WallTime;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// One value, as it was stored.
#[derive(Clone, Debug, PartialEq, Eq)]
struct HistoryColumn {
    name: String,
    label: String,
    unit: String,
    digits: i32,
}

/// Which values are wanted, by name; `None`: all.
pub type Names = Option<BTreeSet<String>>;

/// The rows of one drive at one level.
#[derive(Debug)]
pub struct DriveHistory {
    level: TrendLevel,
    wanted: Names,
    columns: Vec<HistoryColumn>,
    /// By their beginning in seconds since 1970-01-01 UTC.
    rows: BTreeMap<i64, Vec<TrendCell>>,
}

impl DriveHistory {
    /// Without rows.
    #[must_use]
    pub const fn new(level: TrendLevel, wanted: Names) -> Self {
        Self {
            level,
            wanted,
            columns: Vec::new(),
            rows: BTreeMap::new(),
        }
    }

    /// Adds the row at `at_s` with `cells` for the stored `columns`. A model that was changed has other columns than before:
    /// values with the same name and unit continue.
    pub fn add(&mut self, at_s: i64, columns: &str, cells: &[TrendCell]) {
        let places: Vec<_> = read_columns(columns)
            .into_iter()
            .map(|column| self.place(column))
            .collect();
        let row = self.rows.entry(at_s).or_default();
        for (place, cell) in places.into_iter().zip(cells) {
            let Some(place) = place else { continue };
            if row.len() <= place {
                row.resize(place + 1, TrendCell::EMPTY);
            }
            if let Some(known) = row.get_mut(place) {
                *known = known.with(*cell);
            }
        }
    }

    fn place(&mut self, column: HistoryColumn) -> Option<usize> {
        if self
            .wanted
            .as_ref()
            .is_some_and(|wanted| !wanted.contains(&column.name))
        {
            return None;
        }
        let same = |known: &HistoryColumn| known.name == column.name && known.unit == column.unit;
        let place = self
            .columns
            .iter()
            .position(same)
            .unwrap_or(self.columns.len());
        if place == self.columns.len() {
            self.columns.push(column);
        }
        Some(place)
    }

    /// The document that the page draws: a grid from the first row to the last.
    #[must_use]
    pub fn document(&self, drive: &str) -> Value {
        let step = self.level.step_s.max(1);
        let bounds = self.rows.keys().next().zip(self.rows.keys().next_back());
        let (first, last) = bounds.map_or((0, -step), |(first, last)| (*first, *last));
        // A clock that was set leaves rows that are far apart; the newest ones are shown.
        let span = i64::try_from(self.level.rows)
            .unwrap_or(i64::MAX)
            .saturating_mul(step);
        let first = first.max(last.saturating_sub(span).saturating_add(step));
        let times = || {
            (0..)
                .map(|index| first + index * step)
                .take_while(|at| *at <= last)
        };
        let of = |take: fn(&TrendCell) -> f32| {
            let column = |place: usize| {
                times()
                    .map(|at| self.number(at, place, take))
                    .collect::<Vec<_>>()
            };
            (0..self.columns.len()).map(column).collect::<Vec<_>>()
        };
        json!({
            "drive": drive,
            "step_s": step,
            "end_at_s": last,
            "columns": self.columns.iter().map(|it| json!({ "name": it.name, "label": it.label, "unit": it.unit })).collect::<Vec<_>>(),
            "values": of(|cell| cell.mean),
            "min": of(|cell| cell.min),
            "max": of(|cell| cell.max),
        })
    }

    /// A list of rows with their time and the mean of each value, as dashboards read it.
    #[must_use]
    pub fn list(&self) -> Value {
        let row = |at: i64| {
            let mut row = Map::new();
            row.insert("time".to_owned(), rfc3339(moment(at)).into());
            for (place, column) in self.columns.iter().enumerate() {
                row.insert(
                    column.name.clone(),
                    self.number(at, place, |cell| cell.mean).into(),
                );
            }
            Value::Object(row)
        };
        self.rows.keys().map(|at| row(*at)).collect()
    }

    /// The rows as CSV with a head: the time, and minimum, mean and maximum of each value.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = "time".to_owned();
        for HistoryColumn { name, unit, .. } in &self.columns {
            // Writing to a String cannot fail.
            let _ = write!(
                text,
                ",{name}_min ({unit}),{name}_mean ({unit}),{name}_max ({unit})"
            );
        }
        for at in self.rows.keys() {
            text += "\n";
            text += &rfc3339(moment(*at));
            for place in 0..self.columns.len() {
                for take in [
                    |cell: &TrendCell| cell.min,
                    |cell: &TrendCell| cell.mean,
                    |cell: &TrendCell| cell.max,
                ] {
                    let number = self
                        .number(*at, place, take)
                        .map(|number| number.to_string());
                    let _ = write!(text, ",{}", number.unwrap_or_default());
                }
            }
        }
        text + "\n"
    }

    fn number(&self, at_s: i64, place: usize, take: fn(&TrendCell) -> f32) -> Option<f64> {
        let cell = self
            .rows
            .get(&at_s)?
            .get(place)
            .filter(|cell| cell.count > 0)?;
        // A mean has one digit more than what it is the mean of.
        let steps = 10_f64.powi(self.columns.get(place)?.digits + 1);
        Some((f64::from(take(cell)) * steps).round() / steps)
    }
}

const fn moment(at_s: i64) -> WallTime {
    WallTime {
        unix_ms: at_s.saturating_mul(1000),
    }
}

fn read_columns(text: &str) -> Vec<HistoryColumn> {
    let document: Value = serde_json::from_str(text).unwrap_or_default();
    let text = |column: &Value, key: &str| column[key].as_str().unwrap_or_default().to_owned();
    let read = |column: &Value| HistoryColumn {
        name: text(column, "name"),
        label: text(column, "label"),
        unit: text(column, "unit"),
        digits: column["digits"]
            .as_i64()
            .and_then(|digits| i32::try_from(digits).ok())
            .unwrap_or_default(),
    };
    document
        .as_array()
        .map(|columns| columns.iter().map(read).collect())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::super::kept::LEVELS;
    use super::*;

    const COLUMNS: &str = r#"[{"name":"output_frequency","label":"Output frequency","unit":"Hz","digits":2},
        {"name":"current","label":"Output current","unit":"A","digits":1}]"#;
    const LATER: &str = r#"[{"name":"torque","label":"Torque","unit":"%","digits":0},
        {"name":"output_frequency","label":"Output frequency","unit":"Hz","digits":2}]"#;

    fn history(wanted: Names) -> DriveHistory {
        let mut history = DriveHistory::new(LEVELS[0], wanted);
        history.add(
            600,
            COLUMNS,
            &[
                TrendCell::of(10.0).with(TrendCell::of(20.55)),
                TrendCell::of(1.5),
            ],
        );
        history.add(720, LATER, &[TrendCell::of(80.0), TrendCell::of(30.0)]);
        history
    }

    #[test]
    fn a_value_continues_over_a_change_of_the_model_and_gaps_are_shown() {
        let document = history(None).document("pump-1");
        assert_eq!(
            (&document["step_s"], &document["end_at_s"]),
            (&json!(60), &json!(720))
        );
        let names: Vec<_> = document["columns"]
            .as_array()
            .unwrap()
            .iter()
            .map(|it| &it["name"])
            .collect();
        assert_eq!(names, ["output_frequency", "current", "torque"]);
        assert_eq!(
            document["values"],
            json!([[15.275, null, 30.0], [1.5, null, null], [null, null, 80.0]])
        );
        assert_eq!(document["max"][0], json!([20.55, null, 30.0]));
    }

    #[test]
    fn the_same_is_a_list_for_dashboards_and_csv_for_tables() {
        let wanted = Some(BTreeSet::from(["current".to_owned()]));
        assert_eq!(
            history(wanted.clone()).list(),
            json!([{ "time": "1970-01-01T00:10:00.000Z", "current": 1.5 }, { "time": "1970-01-01T00:12:00.000Z", "current": null }])
        );
        let csv = "time,current_min (A),current_mean (A),current_max (A)\n1970-01-01T00:10:00.000Z,1.5,1.5,1.5\n\
                   1970-01-01T00:12:00.000Z,,,\n";
        assert_eq!(history(wanted).csv(), csv);
    }

    #[test]
    fn a_clock_that_was_set_far_ahead_makes_no_document_longer() {
        let mut history = history(None);
        history.add(
            4_000_000_020,
            COLUMNS,
            &[TrendCell::of(1.0), TrendCell::of(1.0)],
        );
        let document = history.document("pump-1");
        assert_eq!(
            document["values"][0].as_array().unwrap().len(),
            LEVELS[0].rows
        );
        assert_eq!(
            DriveHistory::new(LEVELS[0], None).document("pump-1")["values"],
            json!([])
        );
    }
}
