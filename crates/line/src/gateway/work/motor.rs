//! What was read of the motor: its output, its status, and how old both are.

use crate::domain::address::Address;
use crate::domain::command::Direction;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::bases::FrequencyBases;
use crate::drive::description::STALE_PERIODS;
use crate::drive::output::OutputRegister;
use crate::drive::plan::PollPace;
use crate::drive::run_state::OutputWatch;
use crate::drive::status::{StatusWatch, UndocumentedState};
use crate::guard::DriveGuard;
use crate::profile::model::{IndicatedState, Model, PollClass};
use std::sync::Arc;
use std::time::Duration;

/// The noise of a steady speed is less than this part of a hertz, or one step.
const NOISE_PER_HERTZ: u32 = 10;
const LEAST_FALL: u16 = 2;
/// What was read of the motor is shown for this time at least.
const READINGS_LAST: Duration = Duration::from_secs(10);

/// The age of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Age {
    Fresh,
    Stale,
    Old,
}

/// The last readings of the motor of one drive.
#[derive(Debug)]
pub(super) struct MotorReadings {
    model: Arc<Model>,
    output: OutputWatch,
    output_register: Option<OutputRegister>,
    status: StatusWatch,
    /// When a reading last showed whether the drive is ordered to run.
    status_at: Option<MonoTime>,
    /// Whether the drive showed reverse when the last stop took effect.
    ramps_reverse: Option<bool>,
    /// How often it is polled.
    pace: PollPace,
    /// The motor turned, and has not stood for certain since.
    has_turned: bool,
}

impl MotorReadings {
    pub fn new(model: &Arc<Model>) -> Self {
        Self {
            model: Arc::clone(model),
            output: OutputWatch::default(),
            output_register: OutputRegister::of(model),
            status: StatusWatch::new(model),
            status_at: None,
            ramps_reverse: None,
            pace: PollPace::new(Duration::ZERO, 1.0),
            has_turned: false,
        }
    }

    pub const fn polled(&mut self, pace: PollPace) {
        self.pace = pace;
    }

    pub const fn model(&self) -> &Arc<Model> {
        &self.model
    }

    pub const fn output(&self) -> &OutputWatch {
        &self.output
    }

    pub const fn status(&self) -> &StatusWatch {
        &self.status
    }

    pub const fn status_at(&self) -> Option<MonoTime> {
        self.status_at
    }

    /// Whether the drive shows that it ramps to a stop, or has an output register in which no zero was read.
    pub fn ramps_or_shows_output(&self) -> bool {
        let ramps = self.status.get(IndicatedState::Stopping) == Some(true);
        ramps || (self.output_register.is_some() && self.output.raw() != Some(0))
    }

    /// When the last reading arrived; `None` if there is none.
    pub fn read_at(&self) -> Option<MonoTime> {
        self.output.at().max(self.status_at)
    }

    /// Whether the motor is known to turn.
    pub fn is_moving(&self) -> bool {
        self.output.is_active() || self.status.is_running() == Some(true)
    }

    /// Whether the motor is known to be at standstill: the output is zero, and the drive shows no order to run.
    pub fn is_at_standstill(&self) -> bool {
        self.output.is_at_standstill() && self.status.is_running() != Some(true)
    }

    /// Whether the motor is at standstill for certain: one that turned, and was not stopped from here (`is_stopping`), has
    /// been so for long.
    pub fn stands(&self, is_stopping: bool) -> bool {
        self.is_at_standstill() && (!self.has_turned || is_stopping || self.output.has_stood())
    }

    /// Sets whether the motor turned, and has not stood for certain since.
    pub const fn set_turned(&mut self, has_turned: bool) {
        self.has_turned = has_turned;
    }

    /// The direction in which the motor turns, if the drive shows it.
    pub fn turns(&self) -> Option<Direction> {
        if self.is_moving() {
            self.shown_direction()
        } else {
            None
        }
    }

    /// The direction in which the drive shows that it runs.
    pub fn ordered_direction(&self) -> Option<Direction> {
        if self.status.is_running() == Some(true) {
            self.shown_direction()
        } else {
            None
        }
    }

    /// The direction that the status shows, whether or not the motor turns.
    fn shown_direction(&self) -> Option<Direction> {
        let is_reverse = self.status.get(IndicatedState::Reverse)?;
        Some(if is_reverse {
            Direction::Reverse
        } else {
            Direction::Forward
        })
    }

    /// Whether the motor turns or the drive is ordered to run; `None` if that is not known.
    pub fn runs(&self) -> Option<bool> {
        let is_at_rest = self.status.is_running() == Some(false) || self.output.raw() == Some(0);
        if self.is_moving() {
            Some(true)
        } else {
            is_at_rest.then_some(false)
        }
    }

    /// The output frequency of the last reading.
    pub fn output_frequency(&self, bases: &FrequencyBases) -> Option<Hertz> {
        self.output_register
            .as_ref()?
            .frequency(self.output.raw()?, bases)
    }

    /// The steps of the output in a hertz.
    pub fn steps_per_hertz(&self, bases: &FrequencyBases) -> u32 {
        self.output_register
            .as_ref()
            .map_or(1, |register| register.steps_per_hertz(bases))
    }

    /// The steps by which an output falls that are more than noise.
    pub fn least_fall(&self, bases: &FrequencyBases) -> u16 {
        let noise =
            u16::try_from(self.steps_per_hertz(bases) / NOISE_PER_HERTZ).unwrap_or(u16::MAX);
        noise.max(LEAST_FALL)
    }

    /// The register of the output frequency, if `words` show more there than the drive can do: such a reading proves
    /// nothing.
    pub fn impossible_output(
        &self,
        address: Address,
        words: &[u16],
        guard: &DriveGuard,
    ) -> Option<Address> {
        let register = self.output_register.as_ref()?;
        let shown = register.frequency(register.steps(address, words)?, guard.bases())?;
        let most = guard
            .control()
            .map_or(Hertz::ZERO, |control| control.most)
            .max(register.range());
        (shown > most.doubled()).then(|| register.address())
    }

    /// The steps of the output that `words` show, unless they are impossible.
    pub fn steps(&self, address: Address, words: &[u16], guard: &DriveGuard) -> Option<u16> {
        match &self.output_register {
            Some(register) if self.impossible_output(address, words, guard).is_none() => {
                register.steps(address, words)
            }
            _ => None,
        }
    }

    pub fn take_output(&mut self, raw: u16, read_at: MonoTime) {
        self.output.take(raw, read_at);
    }

    /// Takes the status in `words`. If they show whether the drive is ordered to run, returns that, and whether another
    /// master has started it: it did not run before, or not in this direction when its stop took effect.
    pub fn take_status(
        &mut self,
        address: Address,
        words: &[u16],
        read_at: MonoTime,
    ) -> Option<(bool, bool)> {
        let ran = self.status.is_running();
        let running = self.status.take(address, words)?;
        self.status_at = Some(read_at);
        let is_started = running && (ran == Some(false) || self.is_turned_round());
        Some((running, is_started))
    }

    /// Whether the drive shows a different direction than when its stop took effect: another master has ordered it to
    /// turn the other way.
    fn is_turned_round(&self) -> bool {
        let is_reverse = self.status.get(IndicatedState::Reverse);
        self.ramps_reverse.is_some() && is_reverse.is_some() && self.ramps_reverse != is_reverse
    }

    /// A word of the status that no document names, returned once for each word.
    pub fn take_undocumented(&mut self) -> Option<UndocumentedState> {
        self.status.take_undocumented()
    }

    /// A stop took effect at `at`.
    pub fn ramps_down(&mut self, at: MonoTime) {
        self.output.ramps_down(at);
        self.ramps_reverse = self.status.get(IndicatedState::Reverse);
    }

    pub fn forget_output(&mut self) {
        self.output.forget();
    }

    pub fn forget_status(&mut self) {
        self.status.forget();
        self.status_at = None;
    }

    /// Whether the readings of the motor are fresh.
    pub fn is_fresh(&self, now: MonoTime) -> bool {
        let is_fresh = |address: Address, at: Option<MonoTime>| {
            at.is_some_and(|at| now.since(at) < self.stale_after(address))
        };
        let output = self
            .output_register
            .as_ref()
            .is_none_or(|it| is_fresh(it.address(), self.output.at()));
        let status = self.model.status_flag(IndicatedState::Running);
        output && status.is_none_or(|flag| is_fresh(flag.address, self.status_at))
    }

    /// A reading of the register at `address` is stale after this time.
    fn stale_after(&self, address: Address) -> Duration {
        let class = self
            .model
            .register_at(address)
            .and_then(|register| register.poll);
        self.pace.period(class.unwrap_or(PollClass::Fast)) * STALE_PERIODS
    }

    /// The ages of output and status; `None` if none is old, or if others may become so in a moment.
    pub fn old_readings(&self, now: MonoTime) -> Option<[Option<Age>; 2]> {
        let lasts = |at: Option<MonoTime>| at.is_none_or(|at| now.since(at) < READINGS_LAST);
        // By far the most calls end here.
        if lasts(self.output.at()) && lasts(self.status_at) {
            return None;
        }
        let output = self
            .output_register
            .as_ref()
            .and_then(|it| self.age(it.address(), self.output.at(), now));
        let status = self
            .model
            .status_flag(IndicatedState::Running)
            .and_then(|it| self.age(it.address, self.status_at, now));
        let ages = [output, status];
        let is_seen = ages.contains(&Some(Age::Fresh));
        // What is not fresh may become old in a moment: nothing is reported of one part before the other is known.
        if !ages.contains(&Some(Age::Old)) || (!is_seen && ages.contains(&Some(Age::Stale))) {
            return None;
        }
        Some(ages)
    }

    /// The age at `now` of what was read of the register at `address` at a moment, if it was.
    fn age(&self, address: Address, at: Option<MonoTime>, now: MonoTime) -> Option<Age> {
        let stale_after = self.stale_after(address);
        Some(match now.since(at?) {
            age if age < stale_after => Age::Fresh,
            age if age < READINGS_LAST => Age::Stale,
            _ => Age::Old,
        })
    }
}
