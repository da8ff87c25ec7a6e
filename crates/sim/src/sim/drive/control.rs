//! Control of the motor: the words that order it, bus or panel, and the drive's own watchdog.

use super::SimDrive;
use super::back_door::BackDoor;
use super::command::{MotorMotion, SimRunOrder, has_priority, run_order_in};
use super::denied::RequestObjection;
use super::memory::{MemoryAddress, index_of};
use super::watchdog::WatchdogReaction;
use crate::domain::address::Address;
use crate::domain::command::Direction;
use crate::domain::time::MonoTime;
use crate::profile::model::{
    BitMeaning, Model, OrderKind, Register, RegisterMemory, RegisterRole, RunForm,
};
use crate::sim::motor::{MICROHERTZ, Motor};
use std::sync::Arc;

/// Output frequency of a jog in microhertz.
const JOG: i64 = 5 * MICROHERTZ;
/// Number of an ordered trip, if the model's table has none for it.
const ORDERED_TRIP: u16 = 1;

impl SimDrive {
    /// Applies the orders of a word to the motor.
    fn obey_word(&mut self, at: MonoTime, wish: SimRunOrder) {
        let had_bus = self.is_run_from_bus();
        let is_edge = self.control.take_word(&wish);
        self.report.resets_held += u64::from(wish.reset && !is_edge);
        if wish.trip && !self.faults.is_tripped() {
            self.trip(at, ordered_trip(&self.model));
        }
        let has_bus = self.is_run_from_bus();
        // A command that only resets does not change a drive without a trip.
        let only_resets = wish.is_one_command && wish.reset;
        if wish.release || (had_bus && !has_bus) {
            self.hand_over(at);
        } else if has_bus && wish.coast {
            self.cut_off(at);
        } else if has_bus && !only_resets && !self.faults.is_tripped() {
            self.turn(at, wish);
        }
        if wish.reset && is_edge && self.faults.is_tripped() {
            let wait = self
                .model
                .reset_writes()
                .iter()
                .find(|write| write.resets)
                .map(|write| write.wait);
            match wait.filter(|wait| !wait.is_zero()) {
                Some(wait) => self.control.reset_at(at + wait),
                None => self.reset(at),
            }
        }
    }

    /// A reset word that has stood for as long as it must takes effect.
    fn follow_reset(&mut self, at: MonoTime) {
        if let Some(due) = self.control.take_due_reset(at)
            && self.faults.is_tripped()
            && self.powered
        {
            self.reset(due);
        }
    }

    fn turn(&mut self, at: MonoTime, wish: SimRunOrder) {
        let direction = self.control.wanted_direction(wish.motion);
        match wish.motion {
            MotorMotion::Freeze => {
                self.control.turn(direction);
                let output = self.motor.output(at);
                self.motor.ramp_to(at, output);
            }
            MotorMotion::Keep(_) => self.run(at, direction, self.control.is_jog()),
            MotorMotion::Stop | MotorMotion::Run(_) | MotorMotion::Toggle => {
                self.run(at, direction, wish.jog)
            }
        }
    }

    /// Ends the trip. A drive that ignores requests afterwards restarts: it forgets command and setpoint.
    fn reset(&mut self, at: MonoTime) {
        self.faults.reset();
        let Some(deaf) = &self.model.quirks.deaf_after_reset else {
            return;
        };
        self.deaf_until = at + deaf.value;
        self.forget_orders();
        if !self.is_run_from_bus() {
            self.hand_over(at);
        }
    }

    /// Clears command values in volatile registers.
    pub(super) fn forget_orders(&mut self) {
        self.control.forget();
        let is_ram = |role| {
            self.model
                .register_for(role)
                .is_some_and(|it| it.memory == Some(RegisterMemory::Ram))
        };
        if is_ram(RegisterRole::FrequencyCommand) {
            self.setpoint = 0;
        }
        let is_order = |it: &Register| {
            matches!(
                it.role,
                Some(RegisterRole::RunCommand | RegisterRole::Order)
            )
        };
        let orders = self
            .model
            .registers
            .iter()
            .enumerate()
            .filter(|(_, it)| is_order(it));
        orders.for_each(|(index, _)| self.memory.forget(index));
    }

    /// Gives control to panel and terminals.
    pub(super) fn hand_over(&mut self, at: MonoTime) {
        let direction = if self.faults.is_tripped() {
            0
        } else {
            self.options.panel_runs.map_or(0, sign)
        };
        self.run(at, direction, false);
    }

    /// Applies `setpoint`, in microhertz; a running motor follows.
    pub(super) fn take_setpoint(
        &mut self,
        at: MonoTime,
        setpoint: i64,
    ) -> Result<(), RequestObjection> {
        let listens = self.is_source_at_bus(RegisterRole::FrequencySource);
        let is_below = setpoint < 0 && !self.model.turns_by_sign();
        if is_below || setpoint.abs() > self.highest() {
            return Err(RequestObjection::Value);
        }
        if !listens && !self.can_take_frequency() {
            return Err(RequestObjection::NotNow);
        }
        let most = self
            .options
            .clamps_at_hz
            .map_or(i64::MAX, |hertz| i64::from(hertz) * MICROHERTZ);
        self.setpoint = setpoint.clamp(-most, most);
        self.follow(at);
        Ok(())
    }

    /// Whether run commands come from the bus.
    pub(super) fn is_run_from_bus(&self) -> bool {
        self.control.bus_run() || self.is_source_at_bus(RegisterRole::RunSource)
    }

    /// Whether the frequency comes from the bus.
    pub(super) fn is_frequency_from_bus(&self) -> bool {
        self.control.bus_frequency() || self.is_source_at_bus(RegisterRole::FrequencySource)
    }

    /// Whether the source register with `role` holds the value that the model's setup requires. A model without such a
    /// register always obeys, unless its commands must claim control.
    pub(super) fn is_source_at_bus(&self, role: RegisterRole) -> bool {
        let Some(index) = self.index_for(role) else {
            return !self.model.run.as_ref().is_some_and(has_priority);
        };
        let word = self.memory.word(index);
        let address = self.model.registers[index].address;
        let mut demanded = self
            .model
            .setup
            .iter()
            .filter(|item| item.address == Some(address))
            .peekable();
        if demanded.peek().is_none() {
            return word == self.options.communication;
        }
        demanded.any(|item| item.is_right(word))
    }

    fn can_take_frequency(&self) -> bool {
        let Some(RunForm::Bits { bits, .. }) = self.model.run.as_ref().map(|run| &run.form) else {
            return false;
        };
        bits.iter().any(|it| it.meaning == BitMeaning::BusFrequency)
    }

    /// Runs in `direction`; 0 is a stop by the ramp.
    pub(super) fn run(&mut self, at: MonoTime, direction: i64, is_jog: bool) {
        self.control.run(direction, is_jog);
        self.run_clock.turn(at, direction != 0);
        self.motor.ramp_to(at, direction * self.wanted());
    }

    pub(super) fn cut_off(&mut self, at: MonoTime) {
        self.control.turn(0);
        self.run_clock.turn(at, false);
        self.motor.cut_off(at);
    }

    /// Applies changes to a running motor.
    pub(super) fn follow(&mut self, at: MonoTime) {
        if self.control.is_ordered_to_run() {
            self.run(at, self.control.direction(), self.control.is_jog());
        }
    }

    /// The frequency at which the motor would run now: without direction, or below 0 where the sign of the setpoint turns it.
    fn wanted(&self) -> i64 {
        let frequency = match self.options.panel_frequency_hz {
            Some(hertz) if !self.is_frequency_from_bus() => i64::from(hertz) * MICROHERTZ,
            _ => self.setpoint,
        };
        if self.control.is_jog() {
            JOG
        } else {
            frequency.clamp(-self.highest(), self.highest())
        }
    }

    /// The maximum output frequency of the drive, in microhertz.
    fn highest(&self) -> i64 {
        let limits = self.model.registers.iter().enumerate();
        let limits = limits.filter(|(_, register)| BackDoor::of(register) == Some(BackDoor::Limit));
        let limits = limits.map(|(index, it)| {
            i64::from(self.memory.word(index)) * MICROHERTZ / i64::from(it.scale.max(1))
        });
        limits.fold(self.ratings.full_scale(), i64::min)
    }

    /// Takes `word` in a register of orders.
    pub(super) fn take_order(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        word: u16,
    ) -> Result<(), RequestObjection> {
        let model = Arc::clone(&self.model);
        let register = &model.registers[place.index];
        let address = register.address;
        let Some(run) = model.run.as_ref() else {
            return Err(RequestObjection::Value);
        };
        let is_own = register.role == Some(RegisterRole::RunCommand);
        let is_forbidden = run.never.iter().any(|never| is_own && never.value == word)
            || run
                .places
                .never
                .iter()
                .any(|(register, never)| *register == address && never.value == word);
        if is_forbidden {
            self.report.forbidden_words += 1;
            return Err(RequestObjection::Value);
        }
        if self.model.order_address(OrderKind::Reset) == Some(address) {
            self.control.end_reset();
        }
        if self.model.direction_at(address).is_some() {
            return self.take_direction(at, place, word);
        }
        let is_of_reset = is_of_reset(&self.model, address);
        if is_of_reset && run.places.clear == Some(word) {
            self.take(place, word);
            self.control.set_reset_stands(false);
            return Ok(());
        }
        let wished = run_order_in(&self.model, address, word);
        let motion = wished.map(|wish| wish.motion);
        if is_own
            && self.is_source_at_bus(RegisterRole::RunSource)
            && self.take_start(at, place, word, motion)
        {
            return Ok(());
        }
        let mut wish = wished.ok_or(RequestObjection::Value)?;
        if wish.is_ignored {
            return Ok(());
        }
        if let MotorMotion::Run(direction) = &mut wish.motion {
            *direction *= self.given_direction();
        }
        if wish.is_one_command {
            // Only a word of bits can give them up.
            wish.bus_run = self.control.bus_run();
            wish.bus_frequency = self.control.bus_frequency();
        }
        let needs_sources = !has_priority(run) && !wish.release;
        let has_sources = self.is_source_at_bus(RegisterRole::RunSource)
            && self.is_source_at_bus(RegisterRole::FrequencySource);
        if (needs_sources && !has_sources)
            || (self.control.wanted_direction(wish.motion) != 0 && self.faults.is_tripped())
        {
            return Err(RequestObjection::NotNow);
        }
        let stood = is_of_reset && self.control.reset_stands();
        if is_of_reset && run_clears(&self.model) {
            self.control.set_reset_stands(true);
        }
        // The effect of the word may change the register.
        self.take(place, word);
        if stood {
            // It is set already: a drive acts on the change.
            self.report.resets_held += 1;
            return Ok(());
        }
        self.obey_word(at, wish);
        Ok(())
    }

    /// The direction of the next run word; a motor that runs follows at once.
    fn take_direction(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        word: u16,
    ) -> Result<(), RequestObjection> {
        let words = self
            .model
            .direction_at(self.model.registers[place.index].address);
        if !words.is_some_and(|words| word == words.forward || Some(word) == words.reverse) {
            return Err(RequestObjection::Value);
        }
        self.take(place, word);
        let sign = self.given_direction();
        if self.control.is_ordered_to_run()
            && self.is_run_from_bus()
            && self.control.direction() != sign
        {
            self.run(at, sign, false);
        }
        Ok(())
    }

    /// 1, or -1 if the register of the direction holds the word for reverse.
    fn given_direction(&self) -> i64 {
        let words = self
            .model
            .run
            .as_ref()
            .and_then(|run| run.places.direction.as_ref());
        let Some(words) = words.map(|fact| &fact.value) else {
            return 1;
        };
        let held = index_of(&self.model, words.address).map(|index| self.memory.word(index));
        if held.is_some() && held == words.reverse {
            -1
        } else {
            1
        }
    }

    /// Holds the drive back: it takes the words of a start but follows none. A drive that is let go obeys the run word that
    /// stands in its register.
    pub fn hold_back(&mut self, at: MonoTime, is_held_back: bool) {
        self.advance(at);
        self.start.hold_back(is_held_back);
        if is_held_back {
            return;
        }
        let stands = |kind| {
            let (address, fact) = self.model.order(kind)?;
            let held = self.word(address)?;
            (self.powered && !self.faults.is_tripped() && held == fact.value).then_some(())
        };
        let direction = if stands(OrderKind::Forward).is_some() {
            1
        } else if stands(OrderKind::Reverse).is_some() {
            -1
        } else {
            return;
        };
        self.start.complete(&self.model);
        self.run(at, direction, false);
    }

    /// Shows `running` only while the drive is ordered to run: a motor that ramps down is shown as ready for the run word.
    pub const fn show_orders(&mut self) {
        self.start.show_orders();
    }

    /// Takes `word`, which orders `motion`, if it belongs to a start or is a run word that the drive is not ready for. Returns
    /// whether it is one of these; any other word is an order.
    fn take_start(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        word: u16,
        motion: Option<MotorMotion>,
    ) -> bool {
        let steps = self.model.start_steps();
        if steps.is_empty() {
            return false;
        }
        let run = self.model.run.as_ref();
        let is_stop = run.is_some_and(|run| run.stop.value == word);
        let is_taken_back = self.model.start_take_back() == Some(word);
        let falls_back = match steps.iter().position(|step| step.write.value == word) {
            Some(step) => self.start.take_step(at, step, !self.faults.is_tripped()),
            None if is_taken_back && !is_stop => {
                self.start.begin_again();
                false
            }
            None if matches!(motion, Some(MotorMotion::Run(_))) && !self.is_ready(at, place) => {
                self.take(place, word);
                return true;
            }
            None => return false,
        };
        self.take(place, word);
        // An earlier state of the drive is one in which its output is off.
        if falls_back && self.is_run_from_bus() && self.motor.output(at) != 0 {
            self.cut_off(at);
        } else if self.is_run_from_bus()
            && self.control.is_ordered_to_run()
            && !matches!(motion, Some(MotorMotion::Keep(_)))
        {
            self.run(at, 0, false);
        }
        true
    }

    fn is_ready(&self, at: MonoTime, place: MemoryAddress) -> bool {
        let address = self.model.registers[place.index].address;
        let held = self.memory.word(place.index);
        let runs = self.control.is_ordered_to_run();
        self.start.is_ready(&self.model, at, (address, held), runs)
    }

    /// Lets time pass until `at`: the watchdog may act.
    pub fn advance(&mut self, at: MonoTime) {
        self.follow_reset(at);
        let Some(due) = self.watchdog_due().filter(|due| *due <= at) else {
            return;
        };
        self.watchdog.expire();
        self.report.watchdog_expiries += 1;
        match WatchdogReaction::of(&self.model, &self.memory) {
            WatchdogReaction::Decelerate => self.run(due, 0, false),
            WatchdogReaction::Coast => self.cut_off(due),
            WatchdogReaction::Trip(code) => self.trip(due, code),
            WatchdogReaction::Keep => {}
        }
    }

    /// The motor at `at` if the bus stays silent until then.
    pub(super) fn motor_at(&self, at: MonoTime) -> Motor {
        let mut motor = self.motor.clone();
        if let Some(due) = self.watchdog_due().filter(|due| *due <= at) {
            match WatchdogReaction::of(&self.model, &self.memory) {
                WatchdogReaction::Decelerate => motor.ramp_to(due, 0),
                WatchdogReaction::Coast | WatchdogReaction::Trip(_) => motor.cut_off(due),
                WatchdogReaction::Keep => {}
            }
        }
        motor
    }

    /// When the watchdog acts if the bus stays silent; `None` if it is off, or there is nothing to stop.
    fn watchdog_due(&self) -> Option<MonoTime> {
        let watches = self.powered && self.control.is_ordered_to_run() && self.is_run_from_bus();
        if !watches {
            return None;
        }
        self.watchdog.due(&self.model, &self.memory)
    }
}

/// The number of a trip that a word orders.
fn ordered_trip(model: &Model) -> u16 {
    let is_one = |text: &str| {
        ["emergency", "external"]
            .iter()
            .any(|part| text.contains(part))
    };
    let ordered = model
        .trip_codes
        .iter()
        .find(|it| is_one(&it.text.to_lowercase()));
    ordered.map_or(ORDERED_TRIP, |it| it.code)
}

/// Whether the register at `address` takes nothing but the reset.
fn is_of_reset(model: &Model, address: Address) -> bool {
    let mut kinds = model.orders_at(address).map(|(kind, _)| kind);
    kinds.next() == Some(OrderKind::Reset) && kinds.next().is_none()
}

/// 1 forward, -1 reverse.
pub(super) fn sign(direction: Direction) -> i64 {
    match direction {
        Direction::Forward => 1,
        Direction::Reverse => -1,
    }
}

/// Whether the drive leaves the reset word in its register.
fn run_clears(model: &Model) -> bool {
    model
        .run
        .as_ref()
        .is_some_and(|run| run.places.clear.is_some())
}
