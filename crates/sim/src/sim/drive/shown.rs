//! Register values of a drive as shown by reads.

use super::SimDrive;
use super::encode::{mantissa_and_exponent, split};
use super::memory::index_of;
use super::ratings::MICRO;
use super::status::{FLAGS, word_of_flags};
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{IndicatedState, Register, RegisterRole};
use crate::profile::value::code_under;
use crate::sim::trip::SimTripRecord;

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
            Some(RegisterRole::TripCode) => self.faults.code(),
            Some(
                role @ (RegisterRole::TripBits
                | RegisterRole::WarningCode
                | RegisterRole::WarningBits),
            ) => (self.faults.bits(role).unwrap_or(0) & 0xFFFF) as u16,
            Some(RegisterRole::TripCount) => self.faults.count(),
            Some(RegisterRole::TripCause) => self.faults.newest().cause,
            Some(RegisterRole::TripHistory) => self
                .faults
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

    /// The value of `register`, in millionths of its unit of measure, if it is measured.
    fn measured(&self, at: MonoTime, register: &Register) -> Option<i64> {
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
        let trip = self.faults.newest();
        let ratings = &self.ratings;
        Some(match role {
            RegisterRole::FrequencyCommand | RegisterRole::FrequencySetting => self.setpoint,
            RegisterRole::OutputFrequency => output,
            RegisterRole::OutputCurrent => ratings.current(output),
            RegisterRole::OutputVoltage => ratings.voltage(output),
            RegisterRole::DcLinkVoltage => ratings.dc_link(output),
            RegisterRole::OutputPower => ratings.power(output),
            // As if it ran at its rated power all the time.
            RegisterRole::Energy => {
                (self.run_clock.microhours(at) / 1000).saturating_mul(ratings.rated_power() / 1000)
            }
            RegisterRole::Torque => ratings.share(100 * MICRO, output) * output.signum(),
            RegisterRole::Temperature => 25 * MICRO + ratings.share(20 * MICRO, output),
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
            current: self.ratings.current(output),
            dc_link: self.ratings.dc_link(output),
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
        let record = self.faults.record(usize::from(offset / 4))?;
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
            Some(RegisterRole::OutputCurrent | RegisterRole::TripCurrent) => {
                self.ratings.rated_current()
            }
            Some(RegisterRole::OutputVoltage) => self.ratings.rated_voltage(),
            Some(RegisterRole::DcLinkVoltage | RegisterRole::TripDcLinkVoltage) => {
                self.ratings.dc_link(0)
            }
            Some(RegisterRole::OutputPower) => self.ratings.rated_power(),
            _ => 0,
        };
        if register.unit == UnitOfMeasure::Percent && rated > 0 {
            return raw(register, micro * 100_000 / (rated / 1_000));
        }
        raw(register, micro)
    }

    /// The word of the status register at `address`; `None` if it has no flag. Bits that no flag names are
    /// those of `other`.
    fn status_word(&self, at: MonoTime, address: Address, other: u16) -> Option<u16> {
        let flags = |flag| {
            self.model
                .status
                .iter()
                .find(move |it| it.address == address && it.flag == flag)
        };
        let indicated: Vec<_> = FLAGS
            .into_iter()
            .filter_map(flags)
            .map(|it| (it, self.is_so(at, it.flag)))
            .collect();
        let word = word_of_flags(&indicated, other)?;
        // What the drive shows of a start.
        Some(if self.faults.is_tripped() || self.shows_running(at) {
            word
        } else {
            self.start.shown_in(&self.model, address, word)
        })
    }

    /// Whether the drive shows that it runs.
    fn shows_running(&self, at: MonoTime) -> bool {
        self.control.is_ordered_to_run() || (self.motor.output(at) != 0 && self.start.shows_ramps())
    }

    /// Whether `flag` is set at `at`.
    fn is_so(&self, at: MonoTime, flag: IndicatedState) -> bool {
        let output = self.motor.output(at);
        let direction = self.control.direction() * self.setpoint_sign();
        match flag {
            IndicatedState::Running => self.shows_running(at),
            IndicatedState::Reverse => output < 0 || (output == 0 && direction < 0),
            IndicatedState::Stopping => output != 0 && direction == 0,
            IndicatedState::Tripped => self.faults.is_tripped(),
            IndicatedState::Alarm => self.faults.alarm(),
            IndicatedState::Ready => !self.faults.is_tripped(),
            IndicatedState::BusRun => self.is_run_from_bus(),
            IndicatedState::BusFrequency => self.is_frequency_from_bus(),
        }
    }

    /// The word that a read shows at `address` where registers share it, have two words or are added to another one;
    /// `None` where it is one register with one word.
    pub(super) fn shared_word(&self, at: MonoTime, address: Address) -> Option<u16> {
        let registers = self
            .model
            .registers
            .iter()
            .enumerate()
            .filter(|(_, register)| register.access.can_read());
        let mut shared = None;
        for (index, register) in registers.filter(|(_, register)| !register.form.is_plain()) {
            let part = register
                .form
                .plus
                .iter()
                .position(|part| part.address == address);
            let place = address
                .offset_from(register.address)
                .filter(|place| *place < register.form.words());
            let word = match (place, part) {
                (Some(place), _) => self.words(at, index)[usize::from(place)],
                // A part that is a register of its own shows its own word.
                (None, Some(part)) if self.model.readable_at(address).is_none() => {
                    self.parts(at, index).1[part]
                }
                (None, _) => continue,
            };
            shared = Some(shared.unwrap_or(0) | word);
        }
        shared
    }

    /// The words of the register at `index`.
    fn words(&self, at: MonoTime, index: usize) -> [u16; 2] {
        let register = &self.model.registers[index];
        let number = self.parts(at, index).0;
        let number = if register.signed {
            number
        } else {
            number.abs()
        };
        match register.form.pair {
            Some(order) => order.words((number & 0xFFFF_FFFF) as u32),
            None => [mantissa_and_exponent(register, number), 0],
        }
    }

    /// The number in the register at `index` before its exponent, and the words that are added to it.
    fn parts(&self, at: MonoTime, index: usize) -> (i128, Vec<u16>) {
        let register = &self.model.registers[index];
        let Some(micro) = self.measured(at, register) else {
            if register.form.pair.is_some() {
                let bits = register.role.and_then(|role| self.faults.bits(role));
                return (
                    bits.unwrap_or_else(|| self.memory.number(index)).into(),
                    Vec::new(),
                );
            }
            return (
                self.held(at, index).into(),
                vec![0; register.form.plus.len()],
            );
        };
        let (left, words) = split(register, micro);
        (self.scale().number_of(register, left), words)
    }
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
