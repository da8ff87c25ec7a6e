//! The remembered state of a drive: how entries change it, and its JSON form.

use super::entry::JournalEntry;
use super::remembered::{RememberedDrive, RememberedLease, RememberedStop, TripBaseline};
use super::words;
use crate::domain::frequency::Hertz;
use crate::domain::time::WallTime;
use crate::drive::sight::{LastSeen, SeenAt};
use crate::drive::usage::{EnergySource, KeptUsage, UsageTotals};
use crate::drive::view::{RunState, TripEventKind};
use serde_json::{Value, json};
use std::time::Duration;

impl RememberedDrive {
    /// Applies `entry`.
    pub fn take(&mut self, entry: &JournalEntry) {
        match entry {
            JournalEntry::Trip(event, baseline) => {
                self.trips = Some(*baseline);
                if let TripEventKind::Tripped { trips, record } = &event.kind {
                    self.trips_total = self.trips_total.saturating_add((*trips).into());
                    self.last_code = record.code;
                }
            }
            JournalEntry::Baseline(baseline) => self.trips = Some(*baseline),
            JournalEntry::Lease(owner) => {
                self.lease = owner.map(|owner| RememberedLease {
                    owner,
                    was_orphaned: false,
                });
            }
            JournalEntry::StopPending { coast } => {
                self.stop = Some(RememberedStop { coast: *coast })
            }
            JournalEntry::StopOver { .. } => self.stop = None,
            JournalEntry::OutOfSight { last_seen } => {
                (self.may_still_run, self.last_seen) = (true, *last_seen)
            }
            JournalEntry::InSight { .. } => (self.may_still_run, self.last_seen) = (false, None),
            JournalEntry::ResetWord { may_stand } => self.reset = *may_stand,
            JournalEntry::Usage(usage) => self.usage = *usage,
            JournalEntry::UsageReset { .. } => self.usage.totals = UsageTotals::default(),
            JournalEntry::Attempt(_)
            | JournalEntry::Ended { .. }
            | JournalEntry::FailSafe { .. }
            | JournalEntry::FailSafeCame(_)
            | JournalEntry::Presence(_) => {}
        }
    }

    /// The JSON form.
    #[must_use]
    pub fn to_json(&self) -> String {
        let mut usage = totals_to_json(&self.usage.totals);
        usage["counter_mj"] = self.usage.counter_mj.into();
        usage["between_mj"] = self.usage.between_mj.into();
        usage["energy_from"] = self.usage.energy_from.map(EnergySource::keyword).into();
        json!({
            "trips": self.trips.map(|it| json!({ "count": it.count, "held": it.held, "code": it.code })),
            "trips_total": self.trips_total,
            "last_code": self.last_code,
            "lease": self.lease.map(|it| json!({ "owner": it.owner.to_string(), "was_orphaned": it.was_orphaned })),
            "reset": self.reset,
            "may_still_run": self.may_still_run,
            "last_seen": self.last_seen.and_then(seen_to_json),
            "usage": usage,
            "stop": self.stop.map(|stop| if stop.coast { "coast" } else { "stop" }),
        })
        .to_string()
    }

    /// Parses the JSON form; `None` if `text` is not valid.
    #[must_use]
    pub fn from_json(text: &str) -> Option<Self> {
        let value: Value = serde_json::from_str(text).ok()?;
        let word = |of: &Value| of.as_u64().and_then(|number| u16::try_from(number).ok());
        let trips = |it: &Value| TripBaseline {
            count: word(&it["count"]),
            held: it["held"].as_bool(),
            code: it["code"]
                .as_u64()
                .and_then(|code| u32::try_from(code).ok()),
        };
        let lease = |it: &Value| {
            let owner = words::owner(it["owner"].as_str()?)?;
            Some(RememberedLease {
                owner,
                was_orphaned: it["was_orphaned"].as_bool()?,
            })
        };
        let trips_total = u32::try_from(value["trips_total"].as_u64()?).ok()?;
        let usage = |it: &Value| KeptUsage {
            totals: totals(it),
            counter_mj: it["counter_mj"].as_u64(),
            between_mj: it["between_mj"].as_u64().unwrap_or(0),
            energy_from: it["energy_from"].as_str().and_then(EnergySource::from_word),
        };
        // Earlier versions summed up trips only.
        let seen = UsageTotals {
            trips: trips_total,
            ..UsageTotals::default()
        };
        let trips_only = KeptUsage {
            totals: seen,
            ..KeptUsage::default()
        };
        let there = |key: &str| Some(&value[key]).filter(|it| !it.is_null());
        Some(Self {
            trips: there("trips").map(trips),
            trips_total,
            last_code: word(&value["last_code"]),
            lease: match there("lease") {
                Some(written) => Some(lease(written)?),
                None => None,
            },
            stop: there("stop").map(|stop| RememberedStop {
                coast: stop == "coast",
            }),
            // Earlier versions did not write it.
            reset: value["reset"].as_bool().unwrap_or(false),
            may_still_run: value["may_still_run"].as_bool().unwrap_or(false),
            last_seen: there("last_seen").and_then(last_seen),
            usage: there("usage").map_or(trips_only, usage),
        })
    }
}

/// The JSON form of what was last seen, which outlives the process only by its wall clock time.
fn seen_to_json(seen: LastSeen) -> Option<Value> {
    let SeenAt::Before(at) = seen.at else {
        return None;
    };
    Some(json!({
        "run_state": seen.run_state.keyword(),
        "millihertz": seen.output.map(Hertz::millihertz),
        "unix_ms": at.unix_ms,
    }))
}

fn last_seen(of: &Value) -> Option<LastSeen> {
    let millihertz = |it: &Value| Some(Hertz::from_millihertz(u32::try_from(it.as_u64()?).ok()?));
    Some(LastSeen {
        run_state: RunState::from_word(of["run_state"].as_str()?)?,
        output: millihertz(&of["millihertz"]),
        at: SeenAt::Before(WallTime {
            unix_ms: of["unix_ms"].as_i64()?,
        }),
    })
}

/// The JSON form of sums.
#[must_use]
pub fn totals_to_json(totals: &UsageTotals) -> Value {
    json!({
        "energy_mj": totals.energy_mj,
        "running_ms": u64::try_from(totals.running.as_millis()).unwrap_or(u64::MAX),
        "starts": totals.starts,
        "trips": totals.trips,
    })
}

/// Sums from their JSON form; 0 for each that it does not have.
#[must_use]
pub fn totals(of: &Value) -> UsageTotals {
    let number = |key: &str| of[key].as_u64().unwrap_or(0);
    let count = |key: &str| u32::try_from(number(key)).unwrap_or(u32::MAX);
    UsageTotals {
        energy_mj: number("energy_mj"),
        running: Duration::from_millis(number("running_ms")),
        starts: count("starts"),
        trips: count("trips"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::Owner;
    use crate::domain::time::MonoTime;
    use crate::drive::view::{TripEvent, TripRecord};

    #[test]
    fn what_is_written_is_read_back() {
        let lease = RememberedLease {
            owner: Owner::ModbusTcp("10.0.0.7".parse().unwrap()),
            was_orphaned: true,
        };
        let whole = RememberedDrive {
            trips: Some(TripBaseline {
                count: Some(65_535),
                held: Some(false),
                code: None,
            }),
            trips_total: u32::MAX,
            last_code: Some(12),
            lease: Some(lease),
            stop: Some(RememberedStop { coast: true }),
            may_still_run: true,
            last_seen: Some(LastSeen {
                run_state: RunState::Reverse,
                output: Some(Hertz::from_millihertz(42_505)),
                at: SeenAt::Before(WallTime {
                    unix_ms: 1_700_000_000_123,
                }),
            }),
            reset: true,
            usage: KeptUsage {
                totals: UsageTotals {
                    energy_mj: u64::MAX,
                    running: Duration::from_millis(1_234_567),
                    starts: 4,
                    trips: 5,
                },
                counter_mj: Some(6),
                between_mj: 5,
                energy_from: Some(EnergySource::Power),
            },
        };
        let stop = Some(RememberedStop { coast: false });
        for memory in [
            RememberedDrive::default(),
            whole,
            RememberedDrive {
                stop,
                ..RememberedDrive::default()
            },
        ] {
            assert_eq!(RememberedDrive::from_json(&memory.to_json()), Some(memory));
        }
        assert_eq!(
            RememberedDrive::from_json("{\"trips_total\":0}"),
            Some(RememberedDrive::default()),
            "of an earlier version"
        );
        for text in [
            "",
            "{}",
            "{\"trips_total\":-1}",
            "{\"trips_total\":0,\"lease\":{\"owner\":\"x\"}}",
        ] {
            assert_eq!(RememberedDrive::from_json(text), None, "{text}");
        }
    }

    #[test]
    fn entries_change_it() {
        let mut memory = RememberedDrive::default();
        let baseline = TripBaseline {
            count: Some(7),
            held: Some(true),
            code: Some(0x8000_0003),
        };
        let record = TripRecord {
            at: MonoTime::ZERO,
            code: Some(3),
            words: Vec::new(),
        };
        let event = |kind| TripEvent {
            kind,
            count: Some(7),
            at: MonoTime::ZERO,
            while_away: false,
        };
        memory.take(&JournalEntry::Trip(
            event(TripEventKind::Tripped { trips: 2, record }),
            baseline,
        ));
        memory.take(&JournalEntry::Trip(
            event(TripEventKind::Cleared),
            TripBaseline {
                held: Some(false),
                ..baseline
            },
        ));
        assert_eq!((memory.trips_total, memory.last_code), (2, Some(3)));
        assert_eq!(memory.trips.unwrap().held, Some(false));
        memory.take(&JournalEntry::Lease(Some(Owner::Mqtt)));
        memory.take(&JournalEntry::StopPending { coast: false });
        assert_eq!(
            memory.lease,
            Some(RememberedLease {
                owner: Owner::Mqtt,
                was_orphaned: false
            })
        );
        assert!(memory.stop.is_some());
        memory.take(&JournalEntry::StopOver { is_effective: true });
        memory.take(&JournalEntry::Lease(None));
        assert_eq!((memory.lease, memory.stop), (None, None));
        let last_seen = Some(LastSeen {
            run_state: RunState::Forward,
            output: None,
            at: SeenAt::Here(MonoTime::ZERO),
        });
        memory.take(&JournalEntry::OutOfSight { last_seen });
        assert_eq!((memory.may_still_run, memory.last_seen), (true, last_seen));
        memory.take(&JournalEntry::InSight { confirmed_by: None });
        assert_eq!((memory.may_still_run, memory.last_seen), (false, None));
        for may_stand in [true, false] {
            memory.take(&JournalEntry::ResetWord { may_stand });
            assert_eq!(memory.reset, may_stand);
        }
    }
}
