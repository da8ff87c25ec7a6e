//! The orders that a drive obeys, and how long it has run.

use super::command::{MotorMotion, SimRunOrder};
use crate::domain::time::MonoTime;
use std::time::Duration;

/// The orders that the drive obeys.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ObeyedOrders {
    /// 1 forward, -1 reverse, 0 not ordered to run.
    direction: i64,
    is_jog: bool,
    /// The newest word takes control whatever the source registers say.
    bus_run: bool,
    bus_frequency: bool,
    /// The newest word has the reset bit.
    reset_held: bool,
    /// The reset word stands in a register of its own.
    reset_stands: bool,
    /// When the drive obeys a reset word that must stand for a while.
    reset_due: Option<MonoTime>,
}

impl ObeyedOrders {
    /// 1 forward, -1 reverse, 0 not ordered to run.
    pub(super) const fn direction(&self) -> i64 {
        self.direction
    }

    pub(super) const fn is_ordered_to_run(&self) -> bool {
        self.direction != 0
    }

    pub(super) const fn is_jog(&self) -> bool {
        self.is_jog
    }

    /// Whether the newest word takes the run order from the bus whatever the source registers say.
    pub(super) const fn bus_run(&self) -> bool {
        self.bus_run
    }

    /// Whether the newest word takes the frequency from the bus whatever the source registers say.
    pub(super) const fn bus_frequency(&self) -> bool {
        self.bus_frequency
    }

    /// The direction of a motor that is ordered to move like this; 0 if it is to stand still.
    pub(super) const fn wanted_direction(&self, motion: MotorMotion) -> i64 {
        let before = self.direction;
        match motion {
            MotorMotion::Stop => 0,
            MotorMotion::Run(direction) => direction,
            MotorMotion::Keep(Some(direction)) if before != 0 => direction,
            MotorMotion::Keep(_) | MotorMotion::Freeze => before,
            MotorMotion::Toggle => -before,
        }
    }

    /// Runs in `direction`; 0 is a stop.
    pub(super) const fn run(&mut self, direction: i64, is_jog: bool) {
        self.direction = direction;
        self.is_jog = is_jog;
    }

    /// Runs in `direction` as before.
    pub(super) const fn turn(&mut self, direction: i64) {
        self.direction = direction;
    }

    /// A word is obeyed as far as it claims control or resets. Returns whether its reset bit, if it has one, is new.
    pub(super) const fn take_word(&mut self, wish: &SimRunOrder) -> bool {
        let is_edge = wish.is_one_command || !self.reset_held;
        self.bus_run = wish.bus_run;
        self.bus_frequency = wish.bus_frequency;
        self.reset_held = wish.reset;
        is_edge
    }

    /// Forgets everything but the reset bit of the newest word.
    pub(super) fn forget(&mut self) {
        *self = Self {
            reset_held: self.reset_held,
            ..Self::default()
        };
    }

    /// The reset is obeyed when its word has stood until `due`.
    pub(super) const fn reset_at(&mut self, due: MonoTime) {
        self.reset_due = Some(due);
    }

    /// Another word takes the place of a reset word.
    pub(super) const fn end_reset(&mut self) {
        self.reset_due = None;
    }

    /// When a reset word that has stood for as long as it must at `at` took effect. Answers once.
    pub(super) fn take_due_reset(&mut self, at: MonoTime) -> Option<MonoTime> {
        self.reset_due.take_if(|due| *due <= at)
    }

    pub(super) const fn reset_stands(&self) -> bool {
        self.reset_stands
    }

    pub(super) const fn set_reset_stands(&mut self, stands: bool) {
        self.reset_stands = stands;
    }
}

/// Accumulated running time.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RunClock {
    total: Duration,
    since: Option<MonoTime>,
}

impl RunClock {
    /// The motor is ordered to run or not from `at` on.
    pub(super) fn turn(&mut self, at: MonoTime, runs: bool) {
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
