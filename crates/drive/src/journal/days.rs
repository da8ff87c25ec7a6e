//! What each drive has used on each day, by UTC. The sums of a day are written as a whole, so that a write that is repeated
//! changes nothing.

use super::memory::{totals, totals_to_json};
use super::row::day_crc;
use crate::domain::ids::Name;
use crate::domain::time::WallTime;
use crate::drive::usage::{EnergySource, UsageTotals};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Days that are stored of each drive: a year and a month.
pub const DAYS_MAX: u32 = 400;
/// Days that are remembered of each drive after they were written.
const REMEMBERED_DAYS: i32 = 2;
const DAY_MS: i64 = 86_400_000;

/// A day, in days since 1970-01-01 UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DayNumber(pub i32);

impl DayNumber {
    /// The day of `at`.
    #[must_use]
    pub fn of(at: WallTime) -> Self {
        let day = at.unix_ms.div_euclid(DAY_MS);
        Self(i32::try_from(day).unwrap_or(if day < 0 { i32::MIN } else { i32::MAX }))
    }

    /// When it begins.
    #[must_use]
    pub fn begin(self) -> WallTime {
        WallTime {
            unix_ms: i64::from(self.0) * DAY_MS,
        }
    }
}

/// What a drive used on one day.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DayUsage {
    /// The sums.
    pub totals: UsageTotals,
    /// Where the energy comes from; `None` if none is known.
    pub energy_from: Option<EnergySource>,
}

/// The sums of one drive and day.
#[derive(Clone, Copy, Debug, Default)]
struct DaySum {
    /// What the file holds from before this process; `None` while that was not read.
    before: Option<UsageTotals>,
    /// What this process has added.
    since: DayUsage,
}

/// The sums of days that are to be written.
#[derive(Debug, Default)]
pub struct DaySums {
    sums: BTreeMap<(Name, DayNumber), DaySum>,
    touched: BTreeSet<(Name, DayNumber)>,
}

impl DaySums {
    /// The drive called `name` has used `more` on `day`.
    pub fn add(&mut self, name: &Name, day: DayNumber, more: DayUsage) {
        if more.totals == UsageTotals::default() {
            return;
        }
        let key = (name.clone(), day);
        let since = &mut self.sums.entry(key.clone()).or_default().since;
        since.totals += more.totals;
        since.energy_from = more.energy_from;
        self.touched.insert(key);
    }

    /// What waits and was not compared with the file yet.
    #[must_use]
    pub fn unread(&self) -> Vec<(Name, DayNumber)> {
        let is_unread =
            |key: &&(Name, DayNumber)| self.sums.get(key).is_some_and(|sum| sum.before.is_none());
        self.touched.iter().filter(is_unread).cloned().collect()
    }

    /// The file holds `before` for this drive and day.
    pub fn read(&mut self, key: &(Name, DayNumber), before: UsageTotals) {
        if let Some(sum) = self.sums.get_mut(key) {
            sum.before = Some(before);
        }
    }

    /// The sums that are to be written.
    pub fn waiting(&self) -> impl Iterator<Item = (&Name, DayNumber, DayUsage)> {
        self.touched.iter().filter_map(|key| {
            let sum = self.sums.get(key)?;
            let mut totals = sum.before.unwrap_or_default();
            totals += sum.since.totals;
            Some((
                &key.0,
                key.1,
                DayUsage {
                    totals,
                    ..sum.since
                },
            ))
        })
    }

    /// How many wait.
    #[must_use]
    pub fn count(&self) -> usize {
        self.touched.len()
    }

    /// Everything has been written. Days that have passed are read again if the clock goes back to them.
    pub fn written(&mut self) {
        for (_, day) in std::mem::take(&mut self.touched) {
            self.sums
                .retain(|(_, it), _| it.0.abs_diff(day.0) < REMEMBERED_DAYS.unsigned_abs());
        }
    }

    /// All sums are to be written again, because the file was replaced.
    pub fn touch_all(&mut self) {
        self.touched = self.sums.keys().cloned().collect();
    }
}

/// The stored form of sums, and its CRC.
#[must_use]
pub fn to_row(name: &str, day: DayNumber, usage: &DayUsage) -> (String, u32) {
    let mut body = totals_to_json(&usage.totals);
    body["energy_from"] = usage.energy_from.map(EnergySource::keyword).into();
    let body = body.to_string();
    let crc = day_crc(name, day.0, &body);
    (body, crc)
}

/// Sums from their stored form; `None` if it is damaged.
#[must_use]
pub fn from_row(name: &str, day: DayNumber, body: &str, crc: u32) -> Option<DayUsage> {
    if day_crc(name, day.0, body) != crc {
        return None;
    }
    let body: Value = serde_json::from_str(body).ok()?;
    let energy_from = body["energy_from"]
        .as_str()
        .and_then(EnergySource::from_word);
    Some(DayUsage {
        totals: totals(&body),
        energy_from,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const HOUR: UsageTotals = UsageTotals {
        energy_mj: 36,
        running: Duration::from_secs(3600),
        starts: 1,
        trips: 0,
    };

    fn pump() -> Name {
        Name::new("pump-1").unwrap()
    }

    fn waiting(days: &DaySums) -> Vec<(DayNumber, u64)> {
        days.waiting()
            .map(|(_, day, usage)| (day, usage.totals.energy_mj))
            .collect()
    }

    fn used() -> DayUsage {
        DayUsage {
            totals: HOUR,
            energy_from: Some(EnergySource::Power),
        }
    }

    #[test]
    fn a_day_is_written_as_a_whole_with_what_the_file_holds() {
        let mut days = DaySums::default();
        days.add(&pump(), DayNumber(3), DayUsage::default());
        assert_eq!(days.count(), 0, "nothing was used");
        days.add(&pump(), DayNumber(3), used());
        assert_eq!(days.unread(), [(pump(), DayNumber(3))]);
        days.read(
            &(pump(), DayNumber(3)),
            UsageTotals {
                energy_mj: 100,
                ..UsageTotals::default()
            },
        );
        assert_eq!(
            (days.unread().len(), waiting(&days)),
            (0, vec![(DayNumber(3), 136)])
        );
        assert_eq!(
            waiting(&days),
            [(DayNumber(3), 136)],
            "a write that is repeated changes nothing"
        );
        days.written();
        days.add(&pump(), DayNumber(3), used());
        assert_eq!(
            (days.unread().len(), waiting(&days)),
            (0, vec![(DayNumber(3), 172)]),
            "the file is not read again"
        );
        days.written();
        days.touch_all();
        assert_eq!(waiting(&days), [(DayNumber(3), 172)], "into a new file");
    }

    #[test]
    fn a_clock_that_jumps_adds_to_the_day_that_it_shows() {
        let mut days = DaySums::default();
        for day in [DayNumber(20_000), DayNumber(0), DayNumber(20_000)] {
            days.add(&pump(), day, used());
            for key in days.unread() {
                days.read(
                    &key,
                    UsageTotals {
                        energy_mj: 1000,
                        ..UsageTotals::default()
                    },
                );
            }
            assert_eq!(waiting(&days), [(day, 1036)]);
            days.written();
        }
        assert_eq!(
            days.sums.len(),
            1,
            "what is far from the newest day is not remembered"
        );
    }

    #[test]
    fn days_are_those_of_utc() {
        for (unix_ms, day) in [
            (0, 0),
            (DAY_MS - 1, 0),
            (DAY_MS, 1),
            (-1, -1),
            (i64::MAX, i32::MAX),
        ] {
            assert_eq!(
                DayNumber::of(WallTime { unix_ms }),
                DayNumber(day),
                "{unix_ms}"
            );
        }
        assert_eq!(DayNumber(1).begin().unix_ms, DAY_MS);
    }

    #[test]
    fn what_is_stored_is_read_back_and_damage_shows() {
        let (body, crc) = to_row("pump-1", DayNumber(7), &used());
        assert_eq!(from_row("pump-1", DayNumber(7), &body, crc), Some(used()));
        for (name, day, body) in [
            ("pump-2", 7, body.clone()),
            ("pump-1", 8, body.clone()),
            ("pump-1", 7, body + " "),
        ] {
            assert_eq!(
                from_row(name, DayNumber(day), &body, crc),
                None,
                "{name} {day} {body}"
            );
        }
    }
}
