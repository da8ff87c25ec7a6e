//! The trend of the last hour: a few values of each drive, every two seconds.

use super::drive::PageDrive;
use crate::domain::ids::Name;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::rated::RatedConversion;
use crate::north::shown::fresh;
use crate::profile::model::{Register, RegisterRole};
use crate::profile::scale::ScaledValue;
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// Time between two rows.
pub const STEP: Duration = Duration::from_secs(2);
/// Most rows of a drive: an hour.
pub const ROWS_MAX: usize = 1800;
/// Rows of the last ten minutes.
pub const ROWS_RECENT: usize = 300;
/// Digits of a value that is derived from a rated one, and of one that is not read.
const USUAL_DIGITS: u8 = 2;

/// The trends of all drives. A drive has at most [`ROWS_MAX`] rows of four numbers, 29 kB.
#[derive(Clone, Debug, Default)]
pub struct DriveTrends {
    drives: BTreeMap<Name, DriveTrend>,
    /// Steps of the clock up to the newest row.
    newest: Option<u64>,
}

impl DriveTrends {
    /// Takes over these drives. What is known of one that is unchanged continues.
    pub fn change_to<'d>(&mut self, drives: impl IntoIterator<Item = &'d DriveDescription>) {
        let mut old = std::mem::take(&mut self.drives);
        for drive in drives {
            let new = DriveTrend::of(drive);
            let known = old
                .remove(&drive.name)
                .filter(|known| known.columns == new.columns);
            self.drives.insert(drive.name.clone(), known.unwrap_or(new));
        }
    }

    /// Whether another row is due.
    #[must_use]
    pub fn is_due(&self, now: MonoTime) -> bool {
        self.newest.is_none_or(|newest| newest < steps(now))
    }

    /// Takes a row of each of `drives`. Rows that were missed are empty: after a suspend, for example.
    pub fn note<'d>(&mut self, now: MonoTime, drives: impl IntoIterator<Item = PageDrive<'d>>) {
        let step = steps(now);
        let missed = self
            .newest
            .map_or(0, |newest| step.saturating_sub(newest).saturating_sub(1));
        let missed = usize::try_from(missed).unwrap_or(ROWS_MAX).min(ROWS_MAX);
        for drive in drives {
            if let Some(trend) = self.drives.get_mut(&drive.description.name) {
                (0..missed).for_each(|_| trend.push(|_| None));
                trend.push(|column| column.read(&drive, now));
            }
        }
        self.newest = Some(step);
    }

    /// The moment of the newest row.
    #[must_use]
    pub fn newest_at(&self) -> Option<MonoTime> {
        Some(MonoTime::ZERO + STEP * u32::try_from(self.newest?).ok()?)
    }

    /// The document of the newest `rows` rows of the drive called `name`, whose newest row is at `end_at_s` seconds after
    /// 1970-01-01 UTC; `None` if there is no such drive.
    #[must_use]
    pub fn document(&self, name: &str, end_at_s: i64, rows: usize) -> Option<Value> {
        let trend = self.drives.get(&Name::new(name)?)?;
        Some(json!({
            "drive": name,
            "step_s": STEP.as_secs(),
            "end_at_s": end_at_s,
            "columns": trend.columns.iter().map(TrendColumn::document).collect::<Vec<_>>(),
            "values": trend.values(rows),
        }))
    }
}

fn steps(now: MonoTime) -> u64 {
    now.as_nanos() / u64::try_from(STEP.as_nanos()).unwrap_or(u64::MAX)
}

/// The trend of one drive.
#[derive(Clone, Debug)]
struct DriveTrend {
    columns: Vec<TrendColumn>,
    /// Row by row, oldest first; NaN if unknown. As exact as a register word.
    cells: VecDeque<f32>,
}

impl DriveTrend {
    fn of(drive: &DriveDescription) -> Self {
        let column = |role| TrendColumn::of_register(drive, drive.model.register_for(role)?);
        let [output, current, voltage] = [
            RegisterRole::OutputFrequency,
            RegisterRole::OutputCurrent,
            RegisterRole::DcLinkVoltage,
        ]
        .map(column);
        let columns = [output, TrendColumn::of_setpoint(drive), current, voltage];
        Self {
            columns: columns.into_iter().flatten().collect(),
            cells: VecDeque::new(),
        }
    }

    fn push(&mut self, value: impl Fn(&TrendColumn) -> Option<f64>) {
        if self.cells.len() >= ROWS_MAX * self.columns.len() {
            self.cells.drain(..self.columns.len().min(self.cells.len()));
        }
        self.cells.extend(
            self.columns
                .iter()
                .map(|column| value(column).map_or(f32::NAN, |value| value as f32)),
        );
    }

    /// The newest `rows` rows, column by column.
    fn values(&self, rows: usize) -> Vec<Vec<Option<f64>>> {
        let older = self.cells.len().saturating_sub(rows * self.columns.len());
        let cells = |place| {
            self.cells
                .iter()
                .skip(older + place)
                .step_by(self.columns.len().max(1))
        };
        let columns = self.columns.iter().enumerate();
        columns
            .map(|(place, column)| cells(place).map(|cell| column.rounded(*cell)).collect())
            .collect()
    }
}

/// One value of a drive.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TrendColumn {
    pub name: String,
    pub label: String,
    pub unit: &'static str,
    pub digits: u8,
    source: ColumnSource,
}

/// Where a value comes from.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ColumnSource {
    /// The polled register with this name.
    Register(String),
    /// The polled register with this name, shown in per cent of a rated value.
    Rated(String, RatedConversion),
    /// The setpoint.
    Setpoint,
}

impl TrendColumn {
    pub fn of_register(drive: &DriveDescription, register: &Register) -> Option<Self> {
        register.poll?;
        let name = register.name.clone();
        let label = register.title.clone();
        Some(match RatedConversion::of(register, &drive.ratings) {
            Some(rated) => {
                let unit = rated.unit.symbol();
                let source = ColumnSource::Rated(register.name.clone(), rated);
                Self {
                    name,
                    label,
                    unit,
                    digits: USUAL_DIGITS,
                    source,
                }
            }
            None => {
                let unit = register.unit.symbol();
                let source = ColumnSource::Register(register.name.clone());
                Self {
                    name,
                    label,
                    unit,
                    digits: register.digits(),
                    source,
                }
            }
        })
    }

    pub fn of_setpoint(drive: &DriveDescription) -> Option<Self> {
        let polled = drive
            .model
            .setting_register()
            .filter(|register| register.poll.is_some());
        let digits = polled.map_or(USUAL_DIGITS, Register::digits);
        let label = polled.map_or_else(
            || "Setpoint that was commanded".to_owned(),
            |it| it.title.clone(),
        );
        let is_there = polled.is_some() || drive.control.is_some();
        is_there.then_some(Self {
            name: "setpoint".to_owned(),
            label,
            unit: "Hz",
            digits,
            source: ColumnSource::Setpoint,
        })
    }

    fn document(&self) -> Value {
        json!({ "name": self.name, "label": self.label, "unit": self.unit })
    }

    /// Name, label, unit and digits of the column, as stored beside kept values.
    pub fn kept(&self) -> Value {
        json!({ "name": self.name, "label": self.label, "unit": self.unit, "digits": self.digits })
    }

    /// The value, unless it is stale.
    pub fn read(&self, drive: &PageDrive<'_>, now: MonoTime) -> Option<f64> {
        self.source.read(drive, now)
    }

    /// A number with this many digits, as it was before it was stored.
    fn rounded(&self, cell: f32) -> Option<f64> {
        let steps = 10_f64.powi(self.digits.into());
        (!cell.is_nan()).then(|| (f64::from(cell) * steps).round() / steps)
    }
}

impl ColumnSource {
    /// The value, unless it is stale.
    fn read(&self, drive: &PageDrive<'_>, now: MonoTime) -> Option<f64> {
        let read = |name: &str| {
            let register = drive
                .description
                .model
                .registers
                .iter()
                .find(|register| register.name == name)?;
            Some(fresh(drive.description, register, drive.view, now)?.value)
        };
        match self {
            Self::Setpoint => drive.setpoint(now),
            Self::Register(name) => read(name).map(ScaledValue::value),
            Self::Rated(name, rated) => {
                read(name).map(|value| rated.to_digits(value, USUAL_DIGITS).value())
            }
        }
    }
}
