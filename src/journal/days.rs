//! What each drive has used on each day, by UTC. The sums of a day are written as a whole, so that a write that is repeated
//! changes nothing.

use super::memory::{totals, totals_to_json};
use super::row::day_crc;
use crate::domain::ids::Name;
use crate::domain::time::WallTime;
use crate::drive::usage::UsageTotals;
use std::collections::{BTreeMap, BTreeSet};

/// Days that are stored of each drive: a year and a month.
pub const DAYS_MAX: u32 = 400;
/// Days that are remembered of each drive after they were written.
const REMEMBERED_DAYS: i32 = 2;
const DAY_MS: i64 = 86_400_000;

/// A day, in days since 1970-01-01 UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Day(pub i32);

impl Day {
    /// The day of `at`.
    #[must_use]
    pub fn of(at: WallTime) -> Self {
        let day = at.unix_ms.div_euclid(DAY_MS);
        Self(i32::try_from(day).unwrap_or(if day < 0 { i32::MIN } else { i32::MAX }))
    }

    /// When it begins.
    #[must_use]
    pub fn begin(self) -> WallTime {
        WallTime { unix_ms: i64::from(self.0) * DAY_MS }
    }
}

/// The sums of one drive and day.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    /// What the file holds from before this process; `None` while that was not read.
    before: Option<UsageTotals>,
    /// What this process has added.
    since: UsageTotals,
}

/// The sums of days that are to be written.
#[derive(Debug, Default)]
pub struct Days {
    sums: BTreeMap<(Name, Day), Sum>,
    touched: BTreeSet<(Name, Day)>,
}

impl Days {
    /// The drive called `name` has used `more` on `day`.
    pub fn add(&mut self, name: &Name, day: Day, more: UsageTotals) {
        if more == UsageTotals::default() {
            return;
        }
        let key = (name.clone(), day);
        self.sums.entry(key.clone()).or_default().since += more;
        self.touched.insert(key);
    }

    /// What waits and was not compared with the file yet.
    #[must_use]
    pub fn unread(&self) -> Vec<(Name, Day)> {
        let is_unread = |key: &&(Name, Day)| self.sums.get(key).is_some_and(|sum| sum.before.is_none());
        self.touched.iter().filter(is_unread).cloned().collect()
    }

    /// The file holds `before` for this drive and day.
    pub fn read(&mut self, key: &(Name, Day), before: UsageTotals) {
        if let Some(sum) = self.sums.get_mut(key) {
            sum.before = Some(before);
        }
    }

    /// The sums that are to be written.
    pub fn waiting(&self) -> impl Iterator<Item = (&Name, Day, UsageTotals)> {
        self.touched.iter().filter_map(|key| {
            let sum = self.sums.get(key)?;
            let mut totals = sum.before.unwrap_or_default();
            totals += sum.since;
            Some((&key.0, key.1, totals))
        })
    }

    /// How many wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.touched.len()
    }

    /// Everything has been written. Days that have passed are read again if the clock goes back to them.
    pub fn written(&mut self) {
        for (_, day) in std::mem::take(&mut self.touched) {
            self.sums.retain(|(_, it), _| it.0.abs_diff(day.0) < REMEMBERED_DAYS.unsigned_abs());
        }
    }

    /// All sums are to be written again, because the file was replaced.
    pub fn touch_all(&mut self) {
        self.touched = self.sums.keys().cloned().collect();
    }
}

/// The stored form of sums, and its CRC.
#[must_use]
pub fn to_row(name: &str, day: Day, totals: &UsageTotals) -> (String, u32) {
    let body = totals_to_json(totals).to_string();
    let crc = day_crc(name, day.0, &body);
    (body, crc)
}

/// Sums from their stored form; `None` if it is damaged.
#[must_use]
pub fn from_row(name: &str, day: Day, body: &str, crc: u32) -> Option<UsageTotals> {
    let is_sound = day_crc(name, day.0, body) == crc;
    is_sound.then(|| serde_json::from_str(body).ok().map(|body| totals(&body))).flatten()
}
