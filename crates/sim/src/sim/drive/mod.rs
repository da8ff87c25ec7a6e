//! One simulated drive, built from the same model that the gateway reads: request PDUs in, reply PDUs out.
//!
//! | part | what it plays |
//! | --- | --- |
//! | `answer` | requests and replies |
//! | `denied` | exception codes |
//! | `memory` | register contents, volatile and stored |
//! | `command` | meaning of a run command |
//! | `commit` | words that take over or store parameters |
//! | `obeyed` | the orders that are obeyed, and the time run |
//! | `start` | a start in several words |
//! | `control` | control of the motor by words, bus or panel |
//! | `faults` | trips, warnings and the alarm |
//! | `ratings` | what is measured at an output frequency |
//! | `shown` | measurements, trips and settings as registers show them |
//! | `status` | status words |
//! | `watchdog` | the reaction to a silent bus |
//! | `encode` | numbers with more than a scale |
//! | `back_door` | other ways to the motor |
//! | `untrue` | readings that are not so, and reads that are refused |
//!
//! This file has what acts on a drive from outside the line (panel, terminals, another master, the drive itself), and the true
//! state of its motor, for observers that do not ask over the line.

mod answer;
mod back_door;
mod basis;
mod command;
mod commit;
mod control;
mod denied;
mod encode;
mod faults;
mod memory;
mod obeyed;
mod ratings;
mod shown;
mod start;
mod status;
#[cfg(test)]
mod tests;
mod untrue;
mod watchdog;

use super::motor::{MICROHERTZ, Motor};
use super::options::{DriveOptions, RefusedStops};
use super::report::DriveReport;
use crate::domain::address::Address;
use crate::domain::command::Direction;
use crate::domain::time::MonoTime;
use crate::profile::model::{ExceptionKind, Model, OrderKind, RegisterRole};
use crate::wire::pdu::function;
use control::sign;
use encode::RegisterScales;
use faults::SimFaults;
use memory::{MemoryAddress, SimMemory, index_of, time};
use obeyed::{ObeyedOrders, RunClock};
use ratings::SimRatings;
use start::StartReadiness;
use std::sync::Arc;
use std::time::Duration;
use untrue::UntrueReads;
use watchdog::SimWatchdog;

/// One drive with its motor. Moments passed to it may be equal but never go back.
///
/// Registers with a role behave; all others of the model are plain words that keep what is written to them.
#[derive(Clone, Debug)]
pub struct SimDrive {
    model: Arc<Model>,
    options: DriveOptions,
    memory: SimMemory,
    /// In microhertz.
    setpoint: i64,
    motor: Motor,
    control: ObeyedOrders,
    start: StartReadiness,
    run_clock: RunClock,
    faults: SimFaults,
    ratings: SimRatings,
    watchdog: SimWatchdog,
    powered: bool,
    /// The next requests are answered with this exception and not executed.
    objects: Option<(ExceptionKind, u32)>,
    /// The drive ignores requests before this moment.
    deaf_until: MonoTime,
    untrue: UntrueReads,
    report: DriveReport,
}

impl SimDrive {
    /// A drive that has been on for a while, at standstill, without a setpoint and without trips.
    #[must_use]
    pub fn new(model: Arc<Model>, options: DriveOptions) -> Self {
        let ratings = SimRatings::of(&options);
        let mut drive = Self {
            motor: Motor::new(
                ratings.full_scale(),
                options.acceleration,
                options.deceleration,
            ),
            memory: SimMemory::new(&model, &options),
            model,
            options,
            setpoint: 0,
            control: ObeyedOrders::default(),
            start: StartReadiness::default(),
            run_clock: RunClock::default(),
            faults: SimFaults::default(),
            ratings,
            watchdog: SimWatchdog::new(),
            powered: true,
            objects: None,
            deaf_until: MonoTime::ZERO,
            untrue: UntrueReads::default(),
            report: DriveReport::default(),
        };
        if !drive.is_run_from_bus() {
            drive.hand_over(MonoTime::ZERO);
        }
        drive
    }

    /// The model of the drive.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The drive's counters.
    #[must_use]
    pub const fn report(&self) -> DriveReport {
        self.report
    }

    /// Number of writes from the bus to the stored memory of the register at `address`; 0 for an unknown one.
    #[must_use]
    pub fn stored_writes(&self, address: Address) -> u64 {
        index_of(&self.model, address).map_or(0, |index| self.memory.stored_writes(index))
    }

    /// How long it needs a pause after a request with `pdu`.
    #[must_use]
    pub fn pause_after(&self, pdu: &[u8]) -> Duration {
        memory::pause_after(&self.model, pdu)
    }

    /// Output frequency at `at` in microhertz, negative in reverse.
    #[must_use]
    pub fn output(&self, at: MonoTime) -> i64 {
        self.motor_at(at).output(at)
    }

    /// Whether the drive is tripped, as of the last moment passed to it.
    #[must_use]
    pub const fn is_tripped(&self) -> bool {
        self.faults.is_tripped()
    }

    /// Whether the drive is switched on. When off, it neither receives nor sends.
    #[must_use]
    pub const fn is_powered(&self) -> bool {
        self.powered
    }

    /// Whether panel or terminals, not the bus, command the motor.
    #[must_use]
    pub fn is_local(&self) -> bool {
        !self.is_run_from_bus()
    }

    /// Trips the drive: the motor coasts, the count rises, the record is kept, RUN is refused until a reset.
    /// A drive that is switched off cannot trip. Where each trip has a bit, `cause` is the number of the bit + 1, and
    /// the bits of trips that are active stay set.
    pub fn trip(&mut self, at: MonoTime, cause: u16) {
        self.advance(at);
        if !self.powered {
            return;
        }
        self.faults.trip(self.record(at, cause));
        self.drop_out(at);
    }

    /// Leaves only those of the active trips whose bits are set in `bits`. It resets nothing.
    pub const fn keep_trip_bits(&mut self, bits: u32) {
        self.faults.keep_trip_bits(bits);
    }

    /// Shows the warning with this number, or the warnings with these bits; 0 for none. The motor goes on.
    pub const fn set_warning(&mut self, warning: u32) {
        self.faults.set_warning(warning);
    }

    /// Answers the next `times` requests with the model's exception of this `kind`, without executing them.
    pub const fn object(&mut self, kind: ExceptionKind, times: u32) {
        self.objects = Some((kind, times));
    }

    /// Sets or clears the alarm that status words show.
    pub const fn set_alarm(&mut self, alarm: bool) {
        self.faults.set_alarm(alarm);
    }

    /// Switches the drive off or on. When off, the motor coasts and volatile registers are lost. After power-up, the
    /// drive ignores requests for the time in its model, and panel or terminals command it if its source registers name them.
    pub fn set_powered(&mut self, at: MonoTime, powered: bool) {
        self.advance(at);
        if self.powered && !powered {
            self.drop_out(at);
            self.memory.lose_power();
            self.forget_orders();
            if !self.options.trip_outlasts_power {
                self.faults.reset();
            }
            (0..self.model.registers.len()).for_each(|index| self.follow_ramps(at, index));
        }
        let comes_on = !self.powered && powered;
        self.powered = powered;
        if comes_on {
            self.control = ObeyedOrders::default();
            let deaf = self.model.quirks.deaf_after_power_up.as_ref();
            self.deaf_until = deaf.map_or(at, |deaf| at + deaf.value);
            self.watchdog.heard(at);
            if !self.is_run_from_bus() {
                self.hand_over(at);
            }
        }
    }

    /// Sets the register at `address` as a person at the operator panel would, with no regard to sources;
    /// registers that behave (frequencies, trips) do not change. Nothing happens at an unknown address.
    pub fn set_locally(&mut self, at: MonoTime, address: Address, value: u16) {
        self.advance(at);
        if let Some(index) = index_of(&self.model, address) {
            self.memory.keep(index, value);
            self.follow_register(at, index);
        }
    }

    /// Sets the order of panel and terminals from `at` on: the motor follows while they have control.
    pub fn operate_panel(&mut self, at: MonoTime, runs: Option<Direction>) {
        self.advance(at);
        self.options.panel_runs = runs;
        if self.powered && self.is_local() {
            self.hand_over(at);
        }
    }

    /// Runs or stops the motor like a key or a terminal that acts whatever the source registers say. Registers do not
    /// change. A drive that is off or tripped does not run.
    pub fn operate(&mut self, at: MonoTime, runs: Option<Direction>) {
        self.advance(at);
        if self.powered && !(self.faults.is_tripped() && runs.is_some()) {
            self.run(at, runs.map_or(0, sign), false);
        }
    }

    /// Sets another setpoint, in whole hertz, from outside the line.
    pub fn set_frequency(&mut self, at: MonoTime, hertz: u16) {
        self.advance(at);
        if self.powered {
            self.setpoint = i64::from(hertz) * MICROHERTZ;
            self.follow(at);
        }
    }

    /// From now on it takes no setpoint above so many hertz, but acknowledges it.
    pub const fn clamp(&mut self, hertz: Option<u16>) {
        self.options.clamps_at_hz = hertz;
    }

    /// Ends a trip as by a key, or by the drive itself; it then runs if `runs`.
    pub fn clear_trip(&mut self, at: MonoTime, runs: Option<Direction>) {
        self.advance(at);
        if self.powered && self.faults.is_tripped() {
            self.faults.reset();
            self.run(at, runs.map_or(0, sign), false);
        }
    }

    /// Sets which stops are refused from now on, in the way in which the model refuses a write.
    pub const fn refuse_stops(&mut self, which: RefusedStops) {
        self.options.refused_stops = which;
    }

    /// The stops that it currently refuses.
    #[must_use]
    pub const fn refused_stops(&self) -> RefusedStops {
        self.options.refused_stops
    }

    /// The current order of the motor, from any source, as of the last moment passed to the drive.
    #[must_use]
    pub fn ordered(&self) -> Option<Direction> {
        match self.control.direction() * self.setpoint_sign() {
            0 => None,
            1.. => Some(Direction::Forward),
            _ => Some(Direction::Reverse),
        }
    }

    /// -1 if the setpoint is below 0, which only drives take that turn by its sign; else 1.
    const fn setpoint_sign(&self) -> i64 {
        if self.setpoint < 0 { -1 } else { 1 }
    }

    /// How often the drive tripped.
    #[must_use]
    pub const fn trips(&self) -> u16 {
        self.faults.count()
    }

    /// The word that the register at `address` holds, whether or not it can be read over the line.
    #[must_use]
    pub fn word(&self, address: Address) -> Option<u16> {
        index_of(&self.model, address).map(|index| self.memory.word(index))
    }

    /// Whether a write of `value` to `address` by function `by` is a stop that this drive refuses.
    fn refuses_stop(&self, by: u8, address: Address, value: u16) -> bool {
        let is_refused = match self.options.refused_stops {
            RefusedStops::None => return false,
            RefusedStops::Single => by == function::WRITE_SINGLE,
            RefusedStops::All => true,
        };
        let stop = self.model.order(OrderKind::Stop);
        is_refused
            && stop.is_some_and(|(register, fact)| register == address && fact.value == value)
    }

    /// From now on reads of `address` show `word`, whatever is so. Nothing else changes.
    pub fn shows_at(&mut self, address: Address, word: u16) {
        self.untrue.show_at(address, Some(word));
    }

    /// From now on reads of `address` are refused, and each read that covers it.
    pub fn refuses_at(&mut self, address: Address) {
        self.untrue.show_at(address, None);
    }

    /// From now on reads that begin at `address` are answered with a word more than they ask for.
    pub const fn answers_too_long_at(&mut self, address: Address) {
        self.untrue.answer_too_long_at(address);
    }

    /// From now on all reads show `word`.
    pub const fn shows_everywhere(&mut self, word: u16) {
        self.untrue.show_everywhere(word);
    }

    /// From now on reads show again what is so.
    pub fn shows_the_truth(&mut self) {
        self.untrue = UntrueReads::default();
    }

    /// Coasts by the drive's own decision. The run command is then as after a stop, so that a refused RUN is
    /// answered with a value other than its own.
    fn drop_out(&mut self, at: MonoTime) {
        self.cut_off(at);
        self.start.begin_again();
        let stop = self
            .model
            .order(OrderKind::Stop)
            .map(|(address, fact)| (address, fact.value));
        for kind in [OrderKind::Forward, OrderKind::Reverse] {
            let Some(address) = self.model.order_address(kind) else {
                continue;
            };
            let word = stop
                .filter(|(register, _)| *register == address)
                .map_or(0, |(_, word)| word);
            if let Some(index) = index_of(&self.model, address) {
                self.memory.hold(index, word);
            }
        }
    }

    /// Applies the effect of the register at `index`, which has just been set.
    fn follow_register(&mut self, at: MonoTime, index: usize) {
        self.follow_ramps(at, index);
        match self.model.registers[index].role {
            // The new source takes control with its next order, unless an order is already active.
            Some(RegisterRole::RunSource)
                if self.is_local() && self.options.panel_runs.is_some() =>
            {
                self.hand_over(at)
            }
            Some(RegisterRole::FrequencySource) | None => self.follow(at),
            _ => {}
        }
    }

    /// Gives the motor the ramp time that the register at `index` holds.
    fn follow_ramps(&mut self, at: MonoTime, index: usize) {
        let register = &self.model.registers[index];
        let time = time(register, self.memory.word(index));
        match register.role {
            Some(RegisterRole::AccelerationTime) => self.motor.set_acceleration(at, time),
            Some(RegisterRole::DecelerationTime) => self.motor.set_deceleration(at, time),
            _ => {}
        }
    }

    /// Holds `word` from the bus and counts the write if it is stored.
    fn take(&mut self, place: MemoryAddress, word: u16) {
        self.take_number(place, word.into());
    }

    fn take_number(&mut self, place: MemoryAddress, number: u32) {
        let before = self.memory.stored_writes(place.index);
        self.memory
            .take(&self.model.registers[place.index], place, number);
        self.report.stored_writes += self.memory.stored_writes(place.index) - before;
    }

    /// What the numbers in its registers mean at the moment.
    fn scale(&self) -> RegisterScales<'_> {
        RegisterScales::new(&self.model, &self.memory, self.options.max_frequency_hz)
    }

    fn index_for(&self, role: RegisterRole) -> Option<usize> {
        self.model
            .registers
            .iter()
            .position(|register| register.role == Some(role))
    }
}
