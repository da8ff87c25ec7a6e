//! One simulated drive, made from the same model that the gateway reads: it gets request PDUs and gives reply PDUs.

use super::motor::{MICROHERTZ, Motor};
use super::options::{BadRequest, DriveOptions};
use super::trip::{TripLog, TripRecord};
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, RefusedWrite, Register, Role};
use crate::wire::exception::{ILLEGAL_DATA_ADDRESS, ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION};
use crate::wire::pdu::{self, Request, function};
use std::sync::Arc;
use std::time::Duration;

/// One drive with its motor. All moments that it is given may be equal but never run backwards.
///
/// Registers with a role behave; all others of the model are plain words that keep what is written to them.
#[derive(Clone, Debug)]
pub struct SimDrive {
    model: Arc<Model>,
    options: DriveOptions,
    /// One for each of the model's registers, in the same order.
    words: Vec<u16>,
    /// In microhertz.
    setpoint: i64,
    motor: Motor,
    /// 1 forward, -1 reverse, 0 not ordered to run.
    direction: i64,
    trips: TripLog,
    tripped: bool,
    powered: bool,
}

impl SimDrive {
    /// A drive that is switched on, at standstill, without a setpoint and without trips.
    #[must_use]
    pub fn new(model: Arc<Model>, options: DriveOptions) -> Self {
        let full_scale = i64::from(options.max_frequency_hz.max(1)) * MICROHERTZ;
        let words = model.registers.iter().map(|register| first_word(register, &options)).collect();
        Self {
            motor: Motor::new(full_scale, options.acceleration, options.deceleration),
            model,
            options,
            words,
            setpoint: 0,
            direction: 0,
            trips: TripLog::default(),
            tripped: false,
            powered: true,
        }
    }

    /// The model that the drive was made from.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Output frequency at `at` in microhertz, negative in reverse.
    #[must_use]
    pub fn output(&self, at: MonoTime) -> i64 {
        self.motor.output(at)
    }

    /// Whether the drive waits for a reset.
    #[must_use]
    pub const fn is_tripped(&self) -> bool {
        self.tripped
    }

    /// Whether the drive is switched on. One that is off hears nothing and says nothing.
    #[must_use]
    pub const fn is_powered(&self) -> bool {
        self.powered
    }

    /// Trips the drive: the motor coasts, the count rises, the record is kept, RUN is refused until a reset.
    /// A drive that is switched off cannot trip.
    pub fn trip(&mut self, at: MonoTime, cause: u16) {
        if !self.powered {
            return;
        }
        let output = self.motor.output(at).abs();
        let load = output * 100 / self.full_scale();
        self.trips.push(TripRecord {
            cause,
            frequency_x100: word(output * 100 / MICROHERTZ),
            current_x10: if output == 0 { 0 } else { current(self.options.rated_current_x10, load) },
            dc_link_v: dc_link_v(load),
        });
        self.tripped = true;
        self.drop_out(at);
    }

    /// Switches the drive off or on. Off, the motor coasts; on again, the drive is stopped and no longer tripped,
    /// while setpoint, parameters and trip records are as before.
    pub fn set_powered(&mut self, at: MonoTime, powered: bool) {
        if self.powered && !powered {
            self.drop_out(at);
            self.tripped = false;
        }
        self.powered = powered;
    }

    /// Sets the register at `address` as somebody at the operator panel would, with no regard to sources;
    /// registers that behave (frequencies, trips) do not change. Nothing happens at an unknown address.
    pub fn set_locally(&mut self, at: MonoTime, address: u16, value: u16) {
        if let Some(index) = self.index_of(address) {
            self.words[index] = value;
            self.follow_ramps(at, index);
        }
    }

    /// Does what `pdu` asks and appends the reply's PDU to `out`; false if the drive stays silent.
    /// `exchange` is the number that proof words show.
    pub fn answer(&mut self, at: MonoTime, pdu: &[u8], exchange: u64, out: &mut Vec<u8>) -> bool {
        if !self.powered {
            return false;
        }
        let done = match Request::decode(pdu) {
            Some(Request::ReadHolding { address, count }) => self.read(at, address, count, exchange, out),
            Some(Request::WriteSingle { address, value }) => self.write(at, address, value).map(|holds| {
                out.push(function::WRITE_SINGLE);
                pdu::put_words(out, &[address, holds]);
            }),
            _ => Err(Denied::BadRequest(ILLEGAL_FUNCTION)),
        };
        match done {
            Ok(()) => true,
            Err(Denied::BadRequest(_)) if self.options.bad_request == BadRequest::Silence => false,
            Err(Denied::BadRequest(code) | Denied::Refused(code)) => {
                out.extend([pdu.first().copied().unwrap_or_default() | function::EXCEPTION_BIT, code]);
                true
            }
        }
    }

    /// Does what a broadcast `pdu` asks, without a reply, if the model knows broadcasts of this function.
    pub fn obey(&mut self, at: MonoTime, pdu: &[u8]) {
        let known = self
            .model
            .link
            .broadcast
            .as_ref()
            .is_some_and(|broadcast| pdu.first().is_some_and(|function| broadcast.functions.contains(function)));
        if !self.powered || !known {
            return;
        }
        if let Some(Request::WriteSingle { address, value }) = Request::decode(pdu) {
            // Nobody is told whether the drive took it.
            let _ = self.write(at, address, value);
        }
    }

    fn read(&self, at: MonoTime, address: u16, count: u16, exchange: u64, out: &mut Vec<u8>) -> Result<(), Denied> {
        if count == 0 || count > self.model.words_in_one_read(address) || count > pdu::MAX_READ_WORDS {
            return Err(Denied::BadRequest(ILLEGAL_DATA_VALUE));
        }
        let mut words = [0; pdu::MAX_READ_WORDS as usize];
        let words = &mut words[..usize::from(count)];
        for (offset, word) in (0..count).zip(words.iter_mut()) {
            *word = address
                .checked_add(offset)
                .and_then(|address| self.readable(at, address, exchange))
                .ok_or(Denied::BadRequest(ILLEGAL_DATA_ADDRESS))?;
        }
        pdu::encode_words_reply(out, words);
        Ok(())
    }

    /// The word at `address` as a read shows it; nothing if reading is not documented there.
    fn readable(&self, at: MonoTime, address: u16, exchange: u64) -> Option<u16> {
        if self.options.proof_words.as_ref().is_some_and(|range| range.contains(&address)) {
            return Some((exchange & 0xFFFF) as u16);
        }
        match self.index_of(address) {
            Some(index) if !self.model.registers[index].access.can_read() => None,
            Some(index) => Some(self.held(at, index)),
            None => self.trip_word(address),
        }
    }

    /// Takes `value` or keeps the old one; returns what the register at `address` then holds.
    fn write(&mut self, at: MonoTime, address: u16, value: u16) -> Result<u16, Denied> {
        let index = self.index_of(address).ok_or(Denied::BadRequest(ILLEGAL_DATA_ADDRESS))?;
        let Register { role, scale, access, .. } = self.model.registers[index];
        let taken = access.can_write()
            && match role {
                Some(Role::RunCommand) => self.take_run_command(at, value),
                Some(Role::FrequencyCommand | Role::FrequencySetting) => self.take_setpoint(at, value, scale),
                Some(Role::OutputFrequency | Role::TripCount | Role::TripCause) => false,
                _ => true,
            };
        if taken {
            self.words[index] = value;
            self.follow_ramps(at, index);
        } else if self.model.write.refused.value == RefusedWrite::Exception {
            return Err(Denied::Refused(ILLEGAL_DATA_VALUE));
        }
        Ok(self.held(at, index))
    }

    /// Whether the drive obeys run command `value`; if so, the motor follows.
    fn take_run_command(&mut self, at: MonoTime, value: u16) -> bool {
        let Some(order) = self.order(value) else { return false };
        let is_run = matches!(order, Order::Forward | Order::Reverse);
        if !self.listens(Role::RunSource) || !self.listens(Role::FrequencySource) || (is_run && self.tripped) {
            return false;
        }
        match order {
            Order::Forward => self.run(at, 1),
            Order::Reverse => self.run(at, -1),
            Order::Stop => self.run(at, 0),
            Order::Coast => self.cut_off(at),
            // A drive that is not tripped has nothing to reset and goes on as it was.
            Order::Reset => self.tripped = false,
        }
        true
    }

    /// Whether the drive takes `value` as its setpoint; if so, a running motor follows.
    fn take_setpoint(&mut self, at: MonoTime, value: u16, scale: u32) -> bool {
        let setpoint = i64::from(value) * MICROHERTZ / i64::from(scale.max(1));
        if setpoint > self.full_scale() || !self.listens(Role::FrequencySource) {
            return false;
        }
        self.setpoint = setpoint;
        if self.direction != 0 {
            self.run(at, self.direction);
        }
        true
    }

    fn run(&mut self, at: MonoTime, direction: i64) {
        self.direction = direction;
        self.motor.ramp_to(at, direction * self.setpoint);
    }

    fn cut_off(&mut self, at: MonoTime) {
        self.direction = 0;
        self.motor.cut_off(at);
    }

    /// Coasts on the drive's own account. The run command is then as after a stop, so that a refused RUN is
    /// answered with another value than its own.
    fn drop_out(&mut self, at: MonoTime) {
        self.cut_off(at);
        let stop = self.model.run.as_ref().map_or(0, |run| run.stop.value);
        for (register, word) in self.model.registers.iter().zip(&mut self.words) {
            if register.role == Some(Role::RunCommand) {
                *word = stop;
            }
        }
    }

    /// Gives the motor a ramp time that has just been put into the register at `index`.
    fn follow_ramps(&mut self, at: MonoTime, index: usize) {
        let register = &self.model.registers[index];
        let time = Duration::from_nanos(u64::from(self.words[index]) * NANOS / u64::from(register.scale.max(1)));
        match register.role {
            Some(Role::AccelerationTime) => self.motor.set_acceleration(at, time),
            Some(Role::DecelerationTime) => self.motor.set_deceleration(at, time),
            _ => {}
        }
    }

    /// The word that the register at `index` holds.
    fn held(&self, at: MonoTime, index: usize) -> u16 {
        let register = &self.model.registers[index];
        let frequency = |microhertz: i64| word(microhertz * i64::from(register.scale) / MICROHERTZ);
        match register.role {
            Some(Role::OutputFrequency) => frequency(self.motor.output(at).abs()),
            Some(Role::FrequencyCommand | Role::FrequencySetting) => frequency(self.setpoint),
            Some(Role::TripCount) => self.trips.count(),
            _ => self.trip_word(register.address).unwrap_or(self.words[index]),
        }
    }

    /// The word of the trip records at `address`, whether or not the model lists each word of them.
    fn trip_word(&self, address: u16) -> Option<u16> {
        let first = self.model.register_for(Role::TripCause)?.address;
        self.trips.word(address.checked_sub(first)?)
    }

    /// Whether the source register with `role` is at communication; a model without one always listens.
    fn listens(&self, role: Role) -> bool {
        let source = self.model.registers.iter().zip(&self.words).find(|(register, _)| register.role == Some(role));
        source.is_none_or(|(_, word)| *word == self.options.communication)
    }

    fn order(&self, value: u16) -> Option<Order> {
        let run = self.model.run.as_ref()?;
        let orders = [
            (Some(&run.stop), Order::Stop),
            (Some(&run.forward), Order::Forward),
            (run.reverse.as_ref(), Order::Reverse),
            (run.coast.as_ref(), Order::Coast),
            (run.reset.as_ref(), Order::Reset),
        ];
        orders.into_iter().find(|(fact, _)| fact.is_some_and(|fact| fact.value == value)).map(|(_, order)| order)
    }

    fn index_of(&self, address: u16) -> Option<usize> {
        self.model.registers.binary_search_by_key(&address, |register| register.address).ok()
    }

    fn full_scale(&self) -> i64 {
        i64::from(self.options.max_frequency_hz.max(1)) * MICROHERTZ
    }
}

const NANOS: u64 = 1_000_000_000;

/// Why a request was not done, with the exception code for it.
enum Denied {
    /// The drive cannot serve such a request.
    BadRequest(u8),
    /// The drive could, but did not take the value.
    Refused(u8),
}

/// What a run command orders.
#[derive(Clone, Copy)]
enum Order {
    Stop,
    Forward,
    Reverse,
    Coast,
    Reset,
}

/// The word that a register of a new drive holds.
fn first_word(register: &Register, options: &DriveOptions) -> u16 {
    let seconds = |time: Duration| {
        let raw = time.as_nanos() * u128::from(register.scale) / u128::from(NANOS);
        u16::try_from(raw).unwrap_or(u16::MAX)
    };
    match register.role {
        Some(Role::AccelerationTime) => seconds(options.acceleration),
        Some(Role::DecelerationTime) => seconds(options.deceleration),
        Some(Role::FrequencySource | Role::RunSource) => options.sources_at_start,
        _ => 0,
    }
}

/// Output current x10 at `load` per cent of full speed: magnetising the motor takes a third of the rated current.
fn current(rated_x10: u16, load: i64) -> u16 {
    word(i64::from(rated_x10) * (33 + load * 67 / 100) / 100)
}

/// DC link voltage at `load` per cent: a rectified 400 V supply that gives way a little.
fn dc_link_v(load: i64) -> u16 {
    word(540 - load / 5)
}

/// `value` as a register can hold it.
fn word(value: i64) -> u16 {
    u16::try_from(value.max(0)).unwrap_or(u16::MAX)
}

#[cfg(test)]
mod tests {
    use super::super::testing::*;
    use super::*;

    fn drive() -> SimDrive {
        SimDrive::new(n700(), DriveOptions::default())
    }

    fn ask(drive: &mut SimDrive, at: MonoTime, pdu: &[u8]) -> Option<Vec<u8>> {
        let mut out = Vec::new();
        drive.answer(at, pdu, 0x1_0007, &mut out).then_some(out)
    }

    /// What the drive holds after a write, as its reply says.
    fn write(drive: &mut SimDrive, at: MonoTime, address: u16, value: u16) -> u16 {
        let mut pdu = vec![6];
        pdu::put_words(&mut pdu, &[address, value]);
        let reply = ask(drive, at, &pdu).unwrap();
        assert_eq!(reply[..3], pdu[..3]);
        u16::from_be_bytes([reply[3], reply[4]])
    }

    fn read(drive: &mut SimDrive, at: MonoTime, address: u16, count: u16) -> Option<Vec<u16>> {
        let mut pdu = vec![3];
        pdu::put_words(&mut pdu, &[address, count]);
        let reply = ask(drive, at, &pdu)?;
        assert_eq!(reply[..2], [3, (2 * count) as u8]);
        Some(pdu::words(&reply[2..]))
    }

    fn output(drive: &mut SimDrive, at: MonoTime) -> u16 {
        read(drive, at, OUTPUT, 1).unwrap()[0]
    }

    #[test]
    fn ramps_follow_f007_and_f008() {
        let mut drive = drive();
        assert_eq!(read(&mut drive, seconds(0), F007, 1), Some(vec![100]));
        assert_eq!(write(&mut drive, seconds(0), F007, 200), 200);
        assert_eq!(write(&mut drive, seconds(0), F008, 300), 300);
        assert_eq!(write(&mut drive, seconds(0), SETPOINT, 6000), 6000);
        assert_eq!(write(&mut drive, seconds(0), RUN, 1), 1);
        assert_eq!(output(&mut drive, seconds(5)), 1500);
        assert_eq!(output(&mut drive, seconds(20)), 6000);
        assert_eq!(write(&mut drive, seconds(100), RUN, 0), 0);
        assert_eq!(output(&mut drive, seconds(115)), 3000);
        assert_eq!(output(&mut drive, seconds(130)), 0);
    }

    #[test]
    fn reverse_runs_through_standstill_and_a_new_setpoint_is_followed() {
        let mut drive = drive();
        write(&mut drive, seconds(0), SETPOINT, 3000);
        write(&mut drive, seconds(0), RUN, 1);
        write(&mut drive, seconds(10), RUN, 2);
        assert_eq!(output(&mut drive, seconds(15)), 0);
        assert_eq!(drive.output(seconds(20)), -30 * MICROHERTZ);
        assert_eq!(output(&mut drive, seconds(20)), 3000);
        assert_eq!(write(&mut drive, seconds(30), SETPOINT, 6000), 6000);
        assert_eq!(drive.output(seconds(40)), -60 * MICROHERTZ);
        assert_eq!(read(&mut drive, seconds(40), F001, 1), Some(vec![6000]));
    }

    #[test]
    fn coast_cuts_the_output_at_once() {
        let mut drive = drive();
        write(&mut drive, seconds(0), SETPOINT, 6000);
        write(&mut drive, seconds(0), RUN, 1);
        assert_eq!(output(&mut drive, seconds(20)), 6000);
        assert_eq!(write(&mut drive, seconds(20), RUN, 3), 3);
        assert_eq!(output(&mut drive, seconds(20)), 0);
        write(&mut drive, seconds(21), SETPOINT, 5000);
        assert_eq!(output(&mut drive, seconds(60)), 0);
    }

    #[test]
    fn a_refused_write_answers_the_old_value() {
        let mut drive = drive();
        assert_eq!(write(&mut drive, seconds(0), SETPOINT, 5000), 5000);
        assert_eq!(write(&mut drive, seconds(0), SETPOINT, 6001), 5000);
        assert_eq!(write(&mut drive, seconds(0), RUN, 5), 0);
        assert_eq!(write(&mut drive, seconds(0), OUTPUT, 1), 0);
        assert_eq!(write(&mut drive, seconds(0), F001, 100), 5000);
        assert_eq!(write(&mut drive, seconds(0), TRIP_COUNT, 9), 0);
    }

    #[test]
    fn run_is_obeyed_only_with_both_sources_at_communication() {
        for (address, source) in [(F010, 2), (F011, 1)] {
            let mut drive = drive();
            write(&mut drive, seconds(0), SETPOINT, 5000);
            assert_eq!(write(&mut drive, seconds(0), address, source), source);
            assert_eq!(write(&mut drive, seconds(0), RUN, 1), 0);
            assert_eq!(drive.output(seconds(50)), 0);
            assert_eq!(write(&mut drive, seconds(50), address, 3), 3);
            assert_eq!(write(&mut drive, seconds(50), RUN, 1), 1);
            assert_eq!(output(&mut drive, seconds(100)), 5000);
            drive.set_locally(seconds(100), F010, 0);
            assert_eq!(write(&mut drive, seconds(100), SETPOINT, 100), 5000);
        }
        let from_the_factory = DriveOptions { sources_at_start: 2, ..DriveOptions::default() };
        assert_eq!(write(&mut SimDrive::new(n700(), from_the_factory), seconds(0), RUN, 1), 0);
    }

    #[test]
    fn a_trip_is_recorded_and_run_is_refused_until_reset() {
        let mut drive = drive();
        write(&mut drive, seconds(0), SETPOINT, 6000);
        write(&mut drive, seconds(0), RUN, 1);
        drive.trip(seconds(5), 4);
        assert!(drive.is_tripped());
        assert_eq!(output(&mut drive, seconds(5)), 0);
        // 33 % + 67 % * 50 % of 11.0 A; 540 V less a tenth of 100 V.
        assert_eq!(read(&mut drive, seconds(5), TRIP_COUNT, 5), Some(vec![1, 4, 3000, 72, 530]));
        assert_eq!(write(&mut drive, seconds(6), RUN, 1), 0);
        assert_eq!(write(&mut drive, seconds(6), RUN, 2), 0);
        assert_eq!(write(&mut drive, seconds(6), RUN, 0), 0);
        assert_eq!(write(&mut drive, seconds(6), RUN, 4), 4);
        assert!(!drive.is_tripped());
        assert_eq!(output(&mut drive, seconds(20)), 0);
        assert_eq!(write(&mut drive, seconds(20), RUN, 1), 1);
        drive.trip(seconds(50), 9);
        assert_eq!(read(&mut drive, seconds(50), TRIP_COUNT, 6), Some(vec![2, 9, 6000, 110, 520, 4]));
        assert_eq!(read(&mut drive, seconds(50), 0x0117, 4), Some(vec![4, 3000, 72, 530]));
        assert_eq!(read(&mut drive, seconds(50), 0x0127, 4), Some(vec![0; 4]));
        assert_eq!(read(&mut drive, seconds(50), 0x012B, 1), None);
    }

    #[test]
    fn bad_requests_are_met_with_silence_or_an_exception() {
        let bad = [
            (&[3, 0x01, 0x02, 0, 1][..], 0x02),
            (&[3, 0x00, 0x02, 0, 1], 0x02),
            (&[3, 0x01, 0x12, 0, 0], 0x03),
            (&[3, 0x01, 0x12, 0, 9], 0x03),
            (&[3, 0x01, 0xFF, 0, 2], 0x03),
            (&[3, 0xFF, 0xFF, 0, 2], 0x03),
            (&[6, 0x02, 0x02, 0, 100], 0x02),
            (&[4, 0x01, 0x01, 0, 1], 0x01),
            (&[8, 0, 0, 0, 1], 0x01),
            (&[16, 0x02, 0x0C, 0, 1, 2, 0, 1], 0x01),
        ];
        let options = DriveOptions { bad_request: BadRequest::Exception, ..DriveOptions::default() };
        let mut talkative = SimDrive::new(n700(), options);
        for (pdu, code) in bad {
            assert_eq!(ask(&mut drive(), seconds(0), pdu), None, "{pdu:?}");
            assert_eq!(ask(&mut talkative, seconds(0), pdu), Some(vec![pdu[0] | 0x80, code]), "{pdu:?}");
        }
    }

    #[test]
    fn a_model_may_refuse_by_exception() {
        let mut model = (*n700()).clone();
        model.write.refused.value = RefusedWrite::Exception;
        let mut drive = SimDrive::new(Arc::new(model), DriveOptions::default());
        assert_eq!(ask(&mut drive, seconds(0), &[6, 0, 4, 0x17, 0x71]), Some(vec![0x86, 0x03]));
        assert_eq!(write(&mut drive, seconds(0), SETPOINT, 6000), 6000);
    }

    #[test]
    fn registers_without_a_role_keep_what_is_written() {
        let mut model = (*n700()).clone();
        for register in &mut model.registers {
            register.role = register.role.filter(|role| *role != Role::RunSource);
        }
        let mut drive = SimDrive::new(Arc::new(model), DriveOptions::default());
        assert_eq!(read(&mut drive, seconds(0), F011, 1), Some(vec![0]));
        assert_eq!(write(&mut drive, seconds(0), F011, 0xABCD), 0xABCD);
        assert_eq!(read(&mut drive, seconds(0), F011, 1), Some(vec![0xABCD]));
        // A model without a source register always listens.
        assert_eq!(write(&mut drive, seconds(0), RUN, 1), 1);
    }

    #[test]
    fn a_power_cycle_stops_and_resets_but_keeps_settings_and_records() {
        let mut drive = drive();
        write(&mut drive, seconds(0), SETPOINT, 6000);
        write(&mut drive, seconds(0), RUN, 1);
        drive.trip(seconds(10), 1);
        drive.set_powered(seconds(20), false);
        drive.trip(seconds(21), 1);
        assert!(!drive.is_powered());
        assert_eq!(ask(&mut drive, seconds(21), &[3, 1, 1, 0, 1]), None);
        drive.set_powered(seconds(30), true);
        assert!(!drive.is_tripped());
        assert_eq!(output(&mut drive, seconds(60)), 0);
        assert_eq!(read(&mut drive, seconds(60), F001, 1), Some(vec![6000]));
        assert_eq!(read(&mut drive, seconds(60), TRIP_COUNT, 2), Some(vec![1, 1]));
    }

    #[test]
    fn proof_words_show_the_low_half_of_the_exchange_number() {
        let options = DriveOptions { proof_words: Some(0x3000..=0x3FFF), ..DriveOptions::default() };
        let mut drive = SimDrive::new(n700(), options);
        assert_eq!(read(&mut drive, seconds(0), 0x3ABC, 2), Some(vec![7, 7]));
        assert_eq!(read(&mut drive, seconds(0), 0x4000, 1), None);
    }
}
