//! Sums up what one drive uses, reading by reading.

use super::{EnergySource, KeptUsage, MJ_PER_KWH, UsageTotals};
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::drive::doubt::CounterFallWatch;
use crate::drive::plan::PollPace;
use crate::drive::snapshot::DriveSnapshot;
use crate::profile::model::{Model, PollClass, Register};
use std::time::Duration;

/// How many planned periods may lie between two readings that are measured between.
const GAP_PERIODS: u32 = 3;
/// The most that one drive is believed to take: 1 MW, in millijoules per millisecond. A counter that rises faster is that
/// of another drive, or was read while it carried from one register into the next.
const MJ_PER_MS_MAX: u64 = 1_000_000;

/// Sums up what one drive uses.
#[derive(Clone, Debug)]
pub struct UsageMeter {
    power: Option<PowerRegister>,
    counter: Option<EnergyCounter>,
    /// The most that may lie between two readings of the run state.
    running_gap: Duration,
    /// When the run state was last read, while readings follow each other.
    seen_at: Option<MonoTime>,
    /// Whether the motor ran when the run state was last known.
    ran: Option<bool>,
    totals: UsageTotals,
    /// The last sums that were returned to be kept, and when.
    kept: (KeptUsage, MonoTime),
}

/// The output power of a drive.
#[derive(Clone, Debug)]
struct PowerRegister {
    register: Register,
    gap: Duration,
    /// The last reading in milliwatts.
    last: Option<(u64, MonoTime)>,
}

/// The energy counter of a drive.
#[derive(Clone, Debug)]
struct EnergyCounter {
    register: Register,
    /// The last reading in millijoules.
    last_mj: Option<u64>,
    /// When this process took the last reading.
    read_at: Option<MonoTime>,
    /// One step of the counter, in millijoules.
    step_mj: u64,
    /// What readings of the output power added since the counter's last step, in millijoules.
    between_mj: u64,
    /// Whether the counter has fallen.
    fall: CounterFallWatch,
}

impl UsageMeter {
    /// A meter for drives of `model`, polled at `pace`.
    #[must_use]
    pub fn new(model: &Model, pace: PollPace) -> Self {
        let gap = |class| pace.period(class) * GAP_PERIODS;
        let power = |register: &Register| PowerRegister {
            register: register.clone(),
            gap: gap(register.poll.unwrap_or(PollClass::Slow)),
            last: None,
        };
        Self {
            power: super::power(model).map(power),
            counter: super::counter(model).map(EnergyCounter::new),
            running_gap: gap(PollClass::Fast),
            seen_at: None,
            ran: None,
            totals: UsageTotals::default(),
            kept: (
                KeptUsage {
                    energy_from: EnergySource::of(model),
                    ..KeptUsage::default()
                },
                MonoTime::ZERO,
            ),
        }
    }

    /// Continues from what an earlier process has kept.
    pub fn remember(&mut self, kept: KeptUsage) {
        self.totals = kept.totals;
        if let Some(counter) = &mut self.counter {
            counter.last_mj = kept.counter_mj;
            counter.between_mj = kept.between_mj;
        }
        // The model may be another one now.
        self.kept.0 = KeptUsage {
            energy_from: self.kept.0.energy_from,
            ..kept
        };
    }

    /// The sums.
    #[must_use]
    pub const fn totals(&self) -> &UsageTotals {
        &self.totals
    }

    /// The run state was read at `at`: the motor runs or is ordered to; `None` if that is not known.
    pub fn take_running(&mut self, runs: Option<bool>, at: MonoTime) {
        let Some(runs) = runs else { return };
        let since = self
            .seen_at
            .map(|seen_at| at.since(seen_at))
            .filter(|since| *since <= self.running_gap);
        if let (Some(true), Some(since)) = (self.ran, since) {
            self.totals.running = self.totals.running.saturating_add(since);
        }
        if runs && self.ran == Some(false) {
            self.totals.starts = self.totals.starts.saturating_add(1);
        }
        self.seen_at = Some(at);
        self.ran = Some(runs);
    }

    /// Registers of the drive were read: power and energy are in `snapshot` as far as they are known.
    pub fn take_readings(&mut self, snapshot: &DriveSnapshot) {
        let by_power = self.power.as_mut().map_or(0, |power| power.take(snapshot));
        let used = self
            .counter
            .as_mut()
            .map_or(by_power, |counter| counter.take(snapshot, by_power));
        self.totals.energy_mj = self.totals.energy_mj.saturating_add(used);
    }

    /// The drive tripped this many times.
    pub fn tripped(&mut self, trips: u16) {
        self.totals.trips = self.totals.trips.saturating_add(trips.into());
    }

    /// The drive is offline: nothing is measured until it is back.
    pub const fn out_of_sight(&mut self) {
        self.seen_at = None;
        if let Some(power) = &mut self.power {
            power.last = None;
        }
    }

    /// Sets all sums back to 0.
    pub fn reset(&mut self) {
        self.totals = UsageTotals::default();
    }

    /// What is to be kept at `now`, if it has changed and the last time is at least `after` ago.
    pub fn take_unkept(&mut self, now: MonoTime, after: Duration) -> Option<KeptUsage> {
        let counter_mj = self.counter.as_ref().and_then(|counter| counter.last_mj);
        let between_mj = self
            .counter
            .as_ref()
            .map_or(0, |counter| counter.between_mj);
        let usage = KeptUsage {
            totals: self.totals,
            counter_mj,
            between_mj,
            ..self.kept.0
        };
        let is_due = usage != self.kept.0 && now.since(self.kept.1) >= after;
        is_due.then(|| {
            self.kept = (usage, now);
            usage
        })
    }
}

impl PowerRegister {
    /// The energy in millijoules between the last two readings.
    fn take(&mut self, snapshot: &DriveSnapshot) -> u64 {
        let Some(reading) = snapshot.value(&self.register) else {
            return 0;
        };
        if self.last.is_some_and(|(_, at)| at == reading.at) {
            return 0;
        }
        let (raw, scale) = reading.value.fraction();
        // Energy that is fed back is none that was used.
        let milliwatts =
            u64::try_from(raw.max(0).saturating_mul(1_000_000) / scale.max(1)).unwrap_or(0);
        let before = self.last.replace((milliwatts, reading.at));
        let Some((before, at)) = before else { return 0 };
        let span = reading.at.since(at);
        if span > self.gap {
            return 0;
        }
        let used = u128::from(before + milliwatts) * span.as_micros() / 2_000_000;
        u64::try_from(used).unwrap_or(u64::MAX)
    }
}

impl EnergyCounter {
    fn new(register: &Register) -> Self {
        let register = register.clone();
        Self {
            register,
            last_mj: None,
            read_at: None,
            step_mj: 0,
            between_mj: 0,
            fall: CounterFallWatch::default(),
        }
    }

    /// The energy in millijoules that is to be added. Until the counter makes its next step, that is what the readings of
    /// the output power tell, `by_power`, but less than a step; the step then settles it.
    fn take(&mut self, snapshot: &DriveSnapshot, by_power: u64) -> u64 {
        match self.rise(snapshot) {
            Some(CounterRise::Used(used)) => {
                used.saturating_sub(std::mem::take(&mut self.between_mj))
            }
            Some(CounterRise::NotBelieved) => {
                self.between_mj = 0;
                0
            }
            None => {
                let room = self
                    .step_mj
                    .saturating_sub(1)
                    .saturating_sub(self.between_mj);
                let more = by_power.min(room);
                self.between_mj += more;
                more
            }
        }
    }

    /// What a new reading tells; `None` without one, or if the counter stands where it was.
    fn rise(&mut self, snapshot: &DriveSnapshot) -> Option<CounterRise> {
        let reading = snapshot
            .value(&self.register)
            .filter(|reading| self.read_at != Some(reading.at))?;
        let (raw, scale) = reading.value.fraction();
        let unit = if self.register.unit == UnitOfMeasure::MegawattHour {
            1000 * MJ_PER_KWH
        } else {
            MJ_PER_KWH
        };
        self.step_mj = unit.unsigned_abs() / scale.unsigned_abs().max(1);
        let now_mj = raw.max(0).unsigned_abs().saturating_mul(self.step_mj);
        let read_before = self.read_at.replace(reading.at);
        let Some(known_mj) = self.last_mj else {
            self.last_mj = Some(now_mj);
            return None;
        };
        // A counter that reads lower may be a wrong reading: nothing is counted until that is clear.
        let Some(before_mj) = self.fall.base(now_mj, known_mj, reading.at) else {
            return Some(CounterRise::NotBelieved);
        };
        self.last_mj = Some(now_mj);
        let Some(rise) = now_mj.checked_sub(before_mj) else {
            return Some(CounterRise::NotBelieved);
        };
        let span_ms = read_before.map_or(u64::MAX, |before| {
            u64::try_from(reading.at.since(before).as_millis()).unwrap_or(u64::MAX)
        });
        let most = span_ms
            .saturating_mul(MJ_PER_MS_MAX)
            .saturating_add(self.step_mj);
        match rise {
            0 => None,
            rise if rise <= most => Some(CounterRise::Used(rise)),
            _ => Some(CounterRise::NotBelieved),
        }
    }
}

/// What a reading of a counter tells.
enum CounterRise {
    /// This much was used, in millijoules.
    Used(u64),
    /// The counter was reset, wrapped, or is that of another drive: counting goes on from where it is.
    NotBelieved,
}
