//! Actions on a drive from outside the line: panel, terminals, another master, the drive itself. Also the true state of
//! the motor, for observers that do not ask over the line.

use super::SimDrive;
use super::control::sign;
use super::memory::index_of;
use super::untrue::UntrueReads;
use crate::domain::address::Address;
use crate::domain::command::Direction;
use crate::domain::time::MonoTime;
use crate::profile::model::OrderKind;
use crate::sim::motor::MICROHERTZ;
use crate::sim::options::RefusedStops;
use crate::wire::pdu::function;

impl SimDrive {
    /// Runs or stops the motor like a key or a terminal that acts whatever the source registers say. Registers do not
    /// change. A drive that is off or tripped does not run.
    pub fn operate(&mut self, at: MonoTime, runs: Option<Direction>) {
        self.advance(at);
        if self.powered && !(self.tripped && runs.is_some()) {
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
        if self.powered && self.tripped {
            self.tripped = false;
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
        match self.control.direction * self.setpoint_sign() {
            0 => None,
            1.. => Some(Direction::Forward),
            _ => Some(Direction::Reverse),
        }
    }

    /// -1 if the setpoint is below 0, which only drives take that turn by its sign; else 1.
    pub(super) const fn setpoint_sign(&self) -> i64 {
        if self.setpoint < 0 { -1 } else { 1 }
    }

    /// How often the drive tripped.
    #[must_use]
    pub const fn trips(&self) -> u16 {
        self.trips.count()
    }

    /// The word that the register at `address` holds, whether or not it can be read over the line.
    #[must_use]
    pub fn word(&self, address: Address) -> Option<u16> {
        index_of(&self.model, address).map(|index| self.memory.word(index))
    }

    /// Whether a write of `value` to `address` by function `by` is a stop that this drive refuses.
    pub(super) fn refuses_stop(&self, by: u8, address: Address, value: u16) -> bool {
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
        self.untrue.single.insert(address, Some(word));
    }

    /// From now on reads of `address` are refused, and each read that covers it.
    pub fn refuses_at(&mut self, address: Address) {
        self.untrue.single.insert(address, None);
    }

    /// From now on reads that begin at `address` are answered with a word more than they ask for.
    pub const fn answers_too_long_at(&mut self, address: Address) {
        self.untrue.too_long_at = Some(address);
    }

    /// From now on all reads show `word`.
    pub const fn shows_everywhere(&mut self, word: u16) {
        self.untrue.everywhere = Some(word);
    }

    /// From now on reads show again what is so.
    pub fn shows_the_truth(&mut self) {
        self.untrue = UntrueReads::default();
    }
}
