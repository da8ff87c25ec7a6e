//! What others do to a drive, beside the line: its panel, a terminal, another master, the drive itself. And the truth
//! about the motor, for an observer that does not ask over the line.

use super::SimDrive;
use super::control::sign;
use super::memory::index_of;
use crate::domain::command::Direction;
use crate::domain::time::MonoTime;
use crate::profile::model::Role;
use crate::sim::motor::MICROHERTZ;
use crate::sim::options::RefusedStops;
use crate::wire::pdu::function;

impl SimDrive {
    /// Runs the motor, or stops it, as a key or a terminal does that acts whatever the sources say. Registers stay as
    /// they are. A drive that is off or tripped does not run.
    pub fn operate(&mut self, at: MonoTime, runs: Option<Direction>) {
        self.advance(at);
        if self.powered && !(self.tripped && runs.is_some()) {
            self.run(at, runs.map_or(0, sign), false);
        }
    }

    /// Another setpoint, in whole hertz, that did not come over the line.
    pub fn set_frequency(&mut self, at: MonoTime, hertz: u16) {
        self.advance(at);
        if self.powered {
            self.setpoint = i64::from(hertz) * MICROHERTZ;
            self.follow(at);
        }
    }

    /// Ends a trip as a key does, or the drive on its own account; it then runs if `runs` says so.
    pub fn clear_trip(&mut self, at: MonoTime, runs: Option<Direction>) {
        self.advance(at);
        if self.powered && self.tripped {
            self.tripped = false;
            self.run(at, runs.map_or(0, sign), false);
        }
    }

    /// Which stops are refused from now on: with an exception, or by the old value where the model refuses so.
    pub const fn refuse_stops(&mut self, which: RefusedStops) {
        self.options.refused_stops = which;
    }

    /// Which stops it refuses at present.
    #[must_use]
    pub const fn refused_stops(&self) -> RefusedStops {
        self.options.refused_stops
    }

    /// What the motor is ordered to do, whoever ordered it, as of the last moment that the drive was given.
    #[must_use]
    pub fn ordered(&self) -> Option<Direction> {
        match self.control.direction {
            0 => None,
            1.. => Some(Direction::Forward),
            _ => Some(Direction::Reverse),
        }
    }

    /// How often the drive tripped.
    #[must_use]
    pub const fn trips(&self) -> u16 {
        self.trips.count()
    }

    /// The word that the register at `address` holds, whether or not it can be read over the line.
    #[must_use]
    pub fn word(&self, address: u16) -> Option<u16> {
        index_of(&self.model, address).map(|index| self.memory.word(index))
    }

    /// Whether a write of `value` to `address` by function `by` is a stop that this drive refuses.
    pub(super) fn refuses_stop(&self, by: u8, address: u16, value: u16) -> bool {
        let is_refused = match self.options.refused_stops {
            RefusedStops::None => return false,
            RefusedStops::Single => by == function::WRITE_SINGLE,
            RefusedStops::All => true,
        };
        let run = self.model.register_for(Role::RunCommand).is_some_and(|it| it.address == address);
        is_refused && run && self.model.run.as_ref().is_some_and(|run| run.stop.value == value)
    }
}
