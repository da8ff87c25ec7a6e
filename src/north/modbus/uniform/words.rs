//! The uniform map, word by word.

use super::super::taken::Present;
use super::column::{ABSENT, ABSENT_SIGNED, Column, unsigned};
use super::order::run_word;
use super::{MAP_VERSION, Uniform, address, run, status};
use crate::domain::command::Owner;
use crate::domain::time::MonoTime;
use crate::drive::view::DriveView;
use std::time::Duration;

/// Steps per hertz, and for what is shown a second time with finer steps.
const HUNDREDTHS: i64 = 100;
/// Steps of the other measurements.
const TENTHS: i64 = 10;
/// The first word of the run hours.
const RUN_HOURS: u16 = 22;
/// One step of word 12.
const AGE_STEP_MS: u128 = 10;

impl Uniform {
    /// The holding register at `address`; nothing outside of the map.
    pub(in super::super) fn word(&self, address: u16, view: &DriveView, present: &Present) -> Option<u16> {
        let (sources, now) = (&self.sources, present.now);
        let fresh = |address| self.column(address)?.fresh(view, now);
        let steps = |steps| fresh(address).map_or(ABSENT, |value| value.unsigned(steps));
        let frequency = || fresh(address).map_or(ABSENT, |value| value.magnitude().unsigned(HUNDREDTHS));
        Some(match address {
            0 => MAP_VERSION,
            1 => status::status(sources, view, now),
            2 => status::run_state(view).number(),
            3 => self.trip_code(view),
            4 | 5 => frequency(),
            6..=9 => steps(TENTHS),
            10 | 11 => fresh(address).map_or(ABSENT_SIGNED, |value| value.signed(TENTHS)),
            12 => age_word(sources.oldest_age(view, now)),
            13 => self.trips_kept(view),
            14 => self.last_trip(view),
            15 => self.reported,
            16 => life(present),
            17 => status::alarms(sources, view, now),
            18 | address::RENEW => self.lease(view, now).map_or(0, |(_, left)| seconds_word(left)),
            19 => self.lease(view, now).map_or(0, |(owner, _)| owner_class(owner, present.owner)),
            20 => self.limits[0],
            21 => self.limits[1],
            RUN_HOURS => (self.run_hours(view, now) >> 16) as u16,
            23 => (self.run_hours(view, now) & 0xFFFF) as u16,
            24 | 25 => steps(HUNDREDTHS),
            26 => self.capabilities,
            27..=31 => 0,
            address::RUN => self.intent(view),
            address::SETPOINT => {
                let setpoint =
                    view.control.as_ref().filter(|_| self.has_control()).and_then(|control| control.setpoint);
                setpoint.and_then(|setpoint| setpoint.centihertz()).unwrap_or(ABSENT)
            }
            259..=261 => self.last_command(address, view),
            _ => return None,
        })
    }

    /// What the measurement in the word at `address` comes from; nothing if the drive does not have it, or the word is
    /// no measurement.
    pub(super) fn column(&self, address: u16) -> Option<&Column> {
        let sources = &self.sources;
        match address {
            4 => sources.output_frequency.as_ref(),
            5 => sources.setting.as_ref(),
            6 | 24 => sources.current.as_ref(),
            7 => sources.voltage.as_ref(),
            8 => sources.dc_voltage.as_ref(),
            9 | 25 => sources.power.as_ref(),
            10 => sources.torque.as_ref(),
            11 => sources.temperature.as_ref(),
            RUN_HOURS | 23 => sources.run_hours.as_ref(),
            _ => None,
        }
    }

    /// Whether the word at `address` can ever hold something else than its mark of absence, with this drive.
    #[must_use]
    pub fn has(&self, address: u16) -> bool {
        match address {
            3 => self.sources.has_trips || self.reported & status::bit::TRIPPED != 0,
            13 | 14 => self.sources.has_trips,
            12 => !self.sources.polled.is_empty(),
            4..=11 | RUN_HOURS..=25 => self.column(address).is_some(),
            20 | 21 | address::SETPOINT => self.has_control(),
            _ => true,
        }
    }

    /// The drive's own register in which the measurement in the word at `address` is read; nothing if there is none.
    #[must_use]
    pub fn register_of(&self, address: u16) -> Option<u16> {
        Some(self.column(address)?.address())
    }

    /// Word 256.
    pub(super) fn intent(&self, view: &DriveView) -> u16 {
        let control = view.control.as_ref().filter(|_| self.has_control());
        control.map_or(run::STOP, |control| run_word(control.intent))
    }

    /// The vendor's number while a trip holds, 0 without one; absent if the number or the trip is not known.
    fn trip_code(&self, view: &DriveView) -> u16 {
        match status::is_tripped(view) {
            Some(false) => 0,
            Some(true) => {
                let code = view.trip.last.as_ref().and_then(|last| last.code);
                // 0 means that there is none.
                code.filter(|code| *code != 0).unwrap_or(ABSENT)
            }
            None => ABSENT,
        }
    }

    /// It stays at 65534 rather than to read as absent or as few.
    fn trips_kept(&self, view: &DriveView) -> u16 {
        if self.sources.has_trips { view.trip_kept.total.min(u32::from(ABSENT - 1)) as u16 } else { ABSENT }
    }

    /// 0 without a trip; absent if its number could not be read.
    fn last_trip(&self, view: &DriveView) -> u16 {
        match view.trip_kept.last_code {
            None if self.sources.has_trips && view.trip_kept.total == 0 => 0,
            last => last.unwrap_or(ABSENT),
        }
    }

    /// Who holds control, and for how long without a sign of life.
    fn lease(&self, view: &DriveView, now: MonoTime) -> Option<(Owner, Duration)> {
        let (owner, until) = view.control.as_ref().filter(|_| self.has_control())?.lease?;
        (now < until).then(|| (owner, until.since(now)))
    }

    /// Both words are 65535 if it is not known.
    fn run_hours(&self, view: &DriveView, now: MonoTime) -> u32 {
        let fresh = self.column(RUN_HOURS).and_then(|column| column.fresh(view, now));
        fresh.and_then(|hours| u32::try_from(hours.in_steps(1)).ok()).unwrap_or(u32::MAX)
    }

    fn last_command(&self, address: u16, view: &DriveView) -> u16 {
        let Some(control) = view.control.as_ref().filter(|_| self.has_control()) else { return 0 };
        match address {
            259 => control.last.map_or(0, |report| report.outcome.number()),
            260 => control.commands,
            _ => control.last.map_or(0, |report| report.reason.number()),
        }
    }
}

/// Word 16: seconds since start, wrapping, so that a client sees that the gateway lives.
const fn life(present: &Present) -> u16 {
    (present.uptime_s & 0xFFFF) as u16
}

fn age_word(age: Option<Duration>) -> u16 {
    age.and_then(|age| u16::try_from(age.as_millis() / AGE_STEP_MS).ok()).unwrap_or(ABSENT)
}

/// Whole seconds; a lease that never ends reads 65534.
fn seconds_word(left: Duration) -> u16 {
    unsigned(i64::try_from(left.as_secs()).unwrap_or(i64::MAX).min(i64::from(ABSENT - 1)))
}

fn owner_class(owner: Owner, client: Owner) -> u16 {
    match owner {
        _ if owner == client => 3,
        Owner::Mqtt | Owner::MqttBy(_) => 1,
        Owner::ModbusTcp(_) | Owner::ModbusSecurity(_) => 2,
        Owner::Local => 4,
        Owner::Page(_) => 5,
        Owner::Sparkplug => 6,
    }
}
