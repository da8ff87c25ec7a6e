//! What is wrong with a drive: its trips, the active ones, warnings and the alarm.

use crate::profile::model::RegisterRole;
use crate::sim::trip::{SimTripRecord, TripLog};

/// The trips and warnings of one drive.
#[derive(Clone, Debug, Default)]
pub(super) struct SimFaults {
    log: TripLog,
    is_tripped: bool,
    /// The active trips, where each has a bit.
    trip_bits: u32,
    alarm: bool,
    /// What the register of warnings shows.
    warning: u32,
}

impl SimFaults {
    pub(super) const fn is_tripped(&self) -> bool {
        self.is_tripped
    }

    pub(super) const fn alarm(&self) -> bool {
        self.alarm
    }

    /// How often the drive tripped.
    pub(super) const fn count(&self) -> u16 {
        self.log.count()
    }

    pub(super) const fn newest(&self) -> SimTripRecord {
        self.log.newest()
    }

    /// The record of the trip `back` trips before the newest one.
    pub(super) fn record(&self, back: usize) -> Option<SimTripRecord> {
        self.log.record(back)
    }

    /// The number of the active trip; 0 for none.
    pub(super) const fn code(&self) -> u16 {
        if self.is_tripped {
            self.log.newest().cause
        } else {
            0
        }
    }

    /// What a register with `role` shows that holds the bits of trips, or warnings, in one word or two.
    pub(super) fn bits(&self, role: RegisterRole) -> Option<u32> {
        match role {
            RegisterRole::TripBits => Some(if self.is_tripped { self.trip_bits } else { 0 }),
            RegisterRole::WarningCode | RegisterRole::WarningBits => Some(self.warning),
            _ => None,
        }
    }

    /// The drive trips. Where each trip has a bit, the cause is the number of the bit + 1, and the bits of trips that are
    /// active stay set.
    pub(super) fn trip(&mut self, record: SimTripRecord) {
        let others = if self.is_tripped { self.trip_bits } else { 0 };
        self.trip_bits = others
            | record
                .cause
                .checked_sub(1)
                .and_then(|bit| 1_u32.checked_shl(bit.into()))
                .unwrap_or(0);
        self.log.push(record);
        self.is_tripped = true;
    }

    /// The trip is over.
    pub(super) const fn reset(&mut self) {
        self.is_tripped = false;
    }

    /// Leaves only those of the active trips whose bits are set in `bits`.
    pub(super) const fn keep_trip_bits(&mut self, bits: u32) {
        self.trip_bits &= bits;
    }

    pub(super) const fn set_warning(&mut self, warning: u32) {
        self.warning = warning;
    }

    pub(super) const fn set_alarm(&mut self, alarm: bool) {
        self.alarm = alarm;
    }
}
