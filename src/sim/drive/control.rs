//! Control of the motor: bus or panel, and their orders.

use super::SimDrive;
use super::back_door::BackDoor;
use super::command::{MotorMotion, RunOrder, has_priority};
use super::denied::RequestObjection;
use crate::domain::command::Direction;
use crate::domain::time::MonoTime;
use crate::profile::model::{BitMeaning, Register, RegisterMemory, RegisterRole, RunForm};
use crate::sim::motor::MICROHERTZ;
use std::time::Duration;

/// Output frequency of a jog in microhertz.
const JOG: i64 = 5 * MICROHERTZ;
/// Number of an ordered trip, if the model's table has none for it.
const ORDERED_TRIP: u16 = 1;

/// The orders that the drive obeys.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ObeyedOrders {
    /// 1 forward, -1 reverse, 0 not ordered to run.
    pub(super) direction: i64,
    is_jog: bool,
    /// The newest word takes control whatever the source registers say.
    pub(super) bus_run: bool,
    pub(super) bus_frequency: bool,
    /// The newest word has the reset bit.
    reset_held: bool,
    /// The reset word stands in a register of its own.
    pub(super) reset_stands: bool,
    /// When the drive obeys a reset word that must stand for a while.
    reset_due: Option<MonoTime>,
}

/// Accumulated running time.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RunClock {
    total: Duration,
    since: Option<MonoTime>,
}

impl RunClock {
    fn turn(&mut self, at: MonoTime, runs: bool) {
        self.total += self
            .since
            .take()
            .map_or(Duration::ZERO, |since| at.since(since));
        self.since = runs.then_some(at);
    }

    /// Millionths of an hour.
    pub(super) fn microhours(&self, at: MonoTime) -> i64 {
        let time = self.total + self.since.map_or(Duration::ZERO, |since| at.since(since));
        i64::try_from(time.as_micros() / 3_600).unwrap_or(i64::MAX)
    }
}

impl SimDrive {
    /// Applies the orders of a word to the motor.
    pub(super) fn obey_word(&mut self, at: MonoTime, wish: RunOrder) {
        let is_edge = wish.is_one_command || !self.control.reset_held;
        self.report.resets_held += u64::from(wish.reset && !is_edge);
        let had_bus = self.is_run_from_bus();
        let RunOrder {
            bus_run,
            bus_frequency,
            ..
        } = wish;
        self.control = ObeyedOrders {
            bus_run,
            bus_frequency,
            reset_held: wish.reset,
            ..self.control
        };
        if wish.trip && !self.tripped {
            self.trip(at, self.ordered_trip());
        }
        let has_bus = self.is_run_from_bus();
        // A command that only resets does not change a drive without a trip.
        let only_resets = wish.is_one_command && wish.reset;
        if wish.release || (had_bus && !has_bus) {
            self.hand_over(at);
        } else if has_bus && wish.coast {
            self.cut_off(at);
        } else if has_bus && !only_resets && !self.tripped {
            self.turn(at, wish);
        }
        if wish.reset && is_edge && self.tripped {
            let wait = self
                .model
                .reset_writes()
                .iter()
                .find(|write| write.resets)
                .map(|write| write.wait);
            match wait.filter(|wait| !wait.is_zero()) {
                Some(wait) => self.control.reset_due = Some(at + wait),
                None => self.reset(at),
            }
        }
    }

    /// A reset word that has stood for as long as it must takes effect.
    pub(super) fn follow_reset(&mut self, at: MonoTime) {
        if let Some(due) = self.control.reset_due.take_if(|due| *due <= at)
            && self.tripped
            && self.powered
        {
            self.reset(due);
        }
    }

    /// Another word takes the place of a reset word.
    pub(super) const fn end_reset(&mut self) {
        self.control.reset_due = None;
    }

    /// The direction of a motor that is ordered to move like this; 0 if it is to stand still.
    pub(super) fn wanted_direction(&self, motion: MotorMotion) -> i64 {
        let before = self.control.direction;
        match motion {
            MotorMotion::Stop => 0,
            MotorMotion::Run(direction) => direction,
            MotorMotion::Keep(Some(direction)) if before != 0 => direction,
            MotorMotion::Keep(_) | MotorMotion::Freeze => before,
            MotorMotion::Toggle => -before,
        }
    }

    fn turn(&mut self, at: MonoTime, wish: RunOrder) {
        let direction = self.wanted_direction(wish.motion);
        match wish.motion {
            MotorMotion::Freeze => {
                self.control.direction = direction;
                let output = self.motor.output(at);
                self.motor.ramp_to(at, output);
            }
            MotorMotion::Keep(_) => self.run(at, direction, self.control.is_jog),
            MotorMotion::Stop | MotorMotion::Run(_) | MotorMotion::Toggle => {
                self.run(at, direction, wish.jog)
            }
        }
    }

    /// Ends the trip. A drive that ignores requests afterwards restarts: it forgets command and setpoint.
    fn reset(&mut self, at: MonoTime) {
        self.tripped = false;
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
        let reset_held = self.control.reset_held;
        self.control = ObeyedOrders {
            reset_held,
            ..ObeyedOrders::default()
        };
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
        let direction = if self.tripped {
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
        self.control.bus_run || self.is_source_at_bus(RegisterRole::RunSource)
    }

    /// Whether the frequency comes from the bus.
    pub(super) fn is_frequency_from_bus(&self) -> bool {
        self.control.bus_frequency || self.is_source_at_bus(RegisterRole::FrequencySource)
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
        self.control = ObeyedOrders {
            direction,
            is_jog,
            ..self.control
        };
        self.run_clock.turn(at, direction != 0);
        self.motor.ramp_to(at, direction * self.wanted());
    }

    pub(super) fn cut_off(&mut self, at: MonoTime) {
        self.control.direction = 0;
        self.run_clock.turn(at, false);
        self.motor.cut_off(at);
    }

    /// Applies changes to a running motor.
    pub(super) fn follow(&mut self, at: MonoTime) {
        if self.control.direction != 0 {
            self.run(at, self.control.direction, self.control.is_jog);
        }
    }

    /// The frequency at which the motor would run now: without direction, or below 0 where the sign of the setpoint turns it.
    fn wanted(&self) -> i64 {
        let frequency = match self.options.panel_frequency_hz {
            Some(hertz) if !self.is_frequency_from_bus() => i64::from(hertz) * MICROHERTZ,
            _ => self.setpoint,
        };
        if self.control.is_jog {
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
        limits.fold(self.full_scale(), i64::min)
    }

    fn ordered_trip(&self) -> u16 {
        let is_one = |text: &str| {
            ["emergency", "external"]
                .iter()
                .any(|part| text.contains(part))
        };
        let ordered = self
            .model
            .trip_codes
            .iter()
            .find(|it| is_one(&it.text.to_lowercase()));
        ordered.map_or(ORDERED_TRIP, |it| it.code)
    }
}

/// 1 forward, -1 reverse.
pub(super) fn sign(direction: Direction) -> i64 {
    match direction {
        Direction::Forward => 1,
        Direction::Reverse => -1,
    }
}
