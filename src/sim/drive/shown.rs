//! Register values of a drive as shown by reads.

use super::SimDrive;
use super::memory::index_of;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{Register, RegisterRole};
use crate::profile::value::code_under;
use crate::sim::motor::MICROHERTZ;
use crate::sim::trip::SimTripRecord;

/// Millionths in a unit of measure: readings are whole numbers of them.
const MICRO: i64 = 1_000_000;
/// The words of a trip record in a block, in order.
const RECORD: [RegisterRole; 4] = [
    RegisterRole::TripCause,
    RegisterRole::TripFrequency,
    RegisterRole::TripCurrent,
    RegisterRole::TripDcLinkVoltage,
];
/// Number of records in such a block: the newest and the five before it.
const BLOCK_RECORDS: u16 = 6;

impl SimDrive {
    /// The word that the register at `index` shows.
    pub(super) fn held(&self, at: MonoTime, index: usize) -> u16 {
        let register = &self.model.registers[index];
        // A flag may also be in a setting, which shows the value that was set.
        if !register.access.can_write()
            && self.has_flag_in(register)
            && let Some(word) = self.status_word(at, register.address, self.memory.word(index))
        {
            return code_under(word, register.form.mask);
        }
        match register.role {
            Some(RegisterRole::TripCode) => {
                if self.tripped {
                    self.trips.newest().cause
                } else {
                    0
                }
            }
            Some(
                role @ (RegisterRole::TripBits
                | RegisterRole::WarningCode
                | RegisterRole::WarningBits),
            ) => (self.bits(role).unwrap_or(0) & 0xFFFF) as u16,
            Some(RegisterRole::TripCount) => self.trips.count(),
            Some(RegisterRole::TripCause) => self.trips.newest().cause,
            Some(RegisterRole::TripHistory) => self
                .trips
                .record(self.place_in_history(register))
                .map_or(0, |it| it.cause),
            Some(RegisterRole::RunHours) => {
                let hours =
                    i64::from(self.options.run_hours) * MICRO + self.run_clock.microhours(at);
                raw(register, hours)
            }
            Some(role) => match self.reading(at, role) {
                Some(micro) => self.word_of(register, micro),
                None => self.memory.word(index),
            },
            None => self
                .block_word(register.address)
                .unwrap_or_else(|| self.memory.word(index)),
        }
    }

    /// What a register with `role` shows that holds the bits of trips, or warnings, in one word or two.
    pub(super) fn bits(&self, role: RegisterRole) -> Option<u32> {
        match role {
            RegisterRole::TripBits => Some(if self.tripped { self.trip_bits } else { 0 }),
            RegisterRole::WarningCode | RegisterRole::WarningBits => Some(self.warning),
            _ => None,
        }
    }

    /// Whether `register`, which may be a field of a word, contains a flag.
    fn has_flag_in(&self, register: &Register) -> bool {
        let here = self
            .model
            .status
            .iter()
            .filter(|flag| flag.address == register.address);
        here.into_iter()
            .any(|flag| flag.mask & register.form.mask != 0)
    }

    /// Whether a register with `role` is a measurement, which cannot be written.
    pub(super) fn is_measured(role: RegisterRole) -> bool {
        !matches!(
            role,
            RegisterRole::RunCommand
                | RegisterRole::Order
                | RegisterRole::FrequencyCommand
                | RegisterRole::FrequencySetting
                | RegisterRole::AccelerationTime
                | RegisterRole::DecelerationTime
                | RegisterRole::FrequencySource
                | RegisterRole::RunSource
        )
    }

    /// The value of `register`, in millionths of its unit of measure, if it is measured.
    pub(super) fn measured(&self, at: MonoTime, register: &Register) -> Option<i64> {
        match register.role? {
            RegisterRole::RunHours => {
                Some(i64::from(self.options.run_hours) * MICRO + self.run_clock.microhours(at))
            }
            role => self.reading(at, role),
        }
    }

    /// The value of a register with `role`, in millionths of its unit of measure.
    fn reading(&self, at: MonoTime, role: RegisterRole) -> Option<i64> {
        let output = self.motor.output(at);
        let trip = self.trips.newest();
        Some(match role {
            RegisterRole::FrequencyCommand | RegisterRole::FrequencySetting => self.setpoint,
            RegisterRole::OutputFrequency => output,
            RegisterRole::OutputCurrent => self.current(output),
            RegisterRole::OutputVoltage => self.voltage(output),
            RegisterRole::DcLinkVoltage => self.dc_link(output),
            RegisterRole::OutputPower => power(self.current(output), self.voltage(output)),
            // As if it ran at its rated power all the time.
            RegisterRole::Energy => {
                let power = power(self.rated_current(), self.rated_voltage());
                (self.run_clock.microhours(at) / 1000).saturating_mul(power / 1000)
            }
            RegisterRole::Torque => self.share(100 * MICRO, output) * output.signum(),
            RegisterRole::Temperature => 25 * MICRO + self.share(20 * MICRO, output),
            RegisterRole::TripFrequency => trip.frequency,
            RegisterRole::TripCurrent => trip.current,
            RegisterRole::TripDcLinkVoltage => trip.dc_link,
            _ => return None,
        })
    }

    /// The record of a trip at this moment.
    pub(super) fn record(&self, at: MonoTime, cause: u16) -> SimTripRecord {
        let output = self.motor.output(at);
        SimTripRecord {
            cause,
            frequency: output,
            current: self.current(output),
            dc_link: self.dc_link(output),
        }
    }

    /// The word of the block of trip records at `address`, whether or not the model lists each word of them: four
    /// words a record without a gap. The block ends where the model has something else.
    pub(super) fn block_word(&self, address: Address) -> Option<u16> {
        let registers = &self.model.registers;
        let first = index_of(
            &self.model,
            self.model.register_for(RegisterRole::TripCause)?.address,
        )?;
        let newest = registers.get(first..first + RECORD.len())?;
        let start = newest[0].address;
        let is_listed =
            newest
                .iter()
                .zip(RECORD)
                .zip(start.onwards())
                .all(|((register, role), address)| {
                    register.role == Some(role) && register.address == address
                });
        let older = registers
            .iter()
            .filter(|it| it.role == Some(RegisterRole::TripHistory));
        let is_block = is_listed
            && older
                .zip(1..)
                .all(|(it, back)| it.address == start.saturating_add(4 * back));
        let others = registers[first..]
            .iter()
            .filter(|it| it.role.is_some_and(|role| !is_of_a_trip(role)));
        let end = others
            .map(|it| it.address)
            .min()
            .unwrap_or(start.at(u16::MAX))
            .min(start.saturating_add(4 * BLOCK_RECORDS));
        if !is_block || address >= end {
            return None;
        }
        let offset = address.offset_from(start)?;
        let record = self.trips.record(usize::from(offset / 4))?;
        let register = &newest[usize::from(offset % 4)];
        Some(match offset % 4 {
            0 => record.cause,
            1 => self.word_of(register, record.frequency),
            2 => self.word_of(register, record.current),
            _ => self.word_of(register, record.dc_link),
        })
    }

    /// How many trips ago the trip shown by `register` was. The newest one is first, unless it has a register
    /// of its own.
    fn place_in_history(&self, register: &Register) -> usize {
        let older = self
            .model
            .registers
            .iter()
            .filter(|it| it.role == Some(RegisterRole::TripHistory));
        let before = older.filter(|it| it.address < register.address).count();
        before + usize::from(self.model.register_for(RegisterRole::TripCause).is_some())
    }

    /// `micro` as shown by `register`: in its unit, or in percent of the rated value.
    fn word_of(&self, register: &Register, micro: i64) -> u16 {
        let rated = match register.role {
            Some(RegisterRole::OutputCurrent | RegisterRole::TripCurrent) => self.rated_current(),
            Some(RegisterRole::OutputVoltage) => self.rated_voltage(),
            Some(RegisterRole::DcLinkVoltage | RegisterRole::TripDcLinkVoltage) => self.dc_link(0),
            Some(RegisterRole::OutputPower) => power(self.rated_current(), self.rated_voltage()),
            _ => 0,
        };
        if register.unit == UnitOfMeasure::Percent && rated > 0 {
            return raw(register, micro * 100_000 / (rated / 1_000));
        }
        raw(register, micro)
    }

    /// `whole` in proportion to the speed.
    fn share(&self, whole: i64, output: i64) -> i64 {
        // Both are some hundred millions at most, so that the product fits.
        whole * (output.abs() / 10) / (self.full_scale() / 10)
    }

    /// Magnetising the motor takes a third of the rated current.
    fn current(&self, output: i64) -> i64 {
        let rated = self.rated_current();
        if output == 0 {
            0
        } else {
            rated / 100 * 33 + self.share(rated / 100 * 67, output)
        }
    }

    /// In proportion to the frequency.
    fn voltage(&self, output: i64) -> i64 {
        self.share(self.rated_voltage(), output)
    }

    /// The rectified supply, which gives way by 20 V at full speed.
    fn dc_link(&self, output: i64) -> i64 {
        i64::from(self.options.dc_link_v) * MICRO - self.share(20 * MICRO, output)
    }

    fn rated_current(&self) -> i64 {
        i64::from(self.options.rated_current_x10) * MICRO / 10
    }

    fn rated_voltage(&self) -> i64 {
        i64::from(self.options.rated_voltage_v) * MICRO
    }

    /// The frequency, in microhertz, that the ramps refer to.
    pub(super) fn full_scale(&self) -> i64 {
        i64::from(self.options.max_frequency_hz.max(1)) * MICROHERTZ
    }
}

/// Of three phases at a power factor of about 0.87, in millionths of a kilowatt.
fn power(current: i64, voltage: i64) -> i64 {
    current / 1_000 * (voltage / 1_000) / 1_000 * 15 / 10
}

fn is_of_a_trip(role: RegisterRole) -> bool {
    role == RegisterRole::TripHistory || RECORD.contains(&role)
}

/// `micro` millionths as `register` can hold it: negative ones without their sign where it has none.
fn raw(register: &Register, micro: i64) -> u16 {
    let raw = micro * i64::from(register.scale) / MICRO;
    if register.signed {
        let raw = raw.clamp(i64::from(i16::MIN), i64::from(i16::MAX));
        return (raw & 0xFFFF) as u16;
    }
    u16::try_from(raw.abs()).unwrap_or(u16::MAX)
}
