//! Uniform units: the same map for every model, answered at once from the view of the drive.

mod column;
mod order;
mod sources;
mod status;
mod table;
mod words;

pub use column::{ABSENT, ABSENT_SIGNED};
pub use order::{presses_stop, run};
pub use status::{alarm, bit, capability};
pub(super) use table::WORDS;

use super::ask::{Ask, BitTable, WordTable};
use super::taken::{Present, Taken};
use super::words::Words;
use crate::domain::command::Reason;
use crate::domain::frequency::Hertz;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::wire::exception;
use sources::Sources;

/// Addresses of the uniform map that can be written.
pub mod address {
    /// Run command, a holding register.
    pub const RUN: u16 = 256;
    /// Setpoint, a holding register.
    pub const SETPOINT: u16 = 257;
    /// Renews the lease, a holding register.
    pub const RENEW: u16 = 258;
    /// RUN forward, a coil.
    pub const FORWARD: u16 = 0;
    /// RUN reverse, a coil.
    pub const REVERSE: u16 = 1;
    /// RESET, a coil.
    pub const RESET: u16 = 2;
    /// STOP, a coil.
    pub const STOP: u16 = 3;
    /// Number of coils.
    pub const COILS: u16 = 4;
}

/// Version of the map: uniform word 0.
pub const MAP_VERSION: u16 = 1;
/// Words from 0 on that 03 and 04 read.
const PICTURE_WORDS: u16 = 40;
/// The last word of control.
const CONTROL_LAST: u16 = 261;
/// Discrete inputs: the bits of word 1.
const STATUS_BITS: u16 = 16;

/// The uniform unit of one drive, prepared once so that a read needs no lookup by name.
#[derive(Clone, Debug)]
pub struct Uniform {
    sources: Sources,
    reported: u16,
    capabilities: u16,
    /// Lowest and highest setpoint, 0.01 Hz.
    limits: [u16; 2],
}

impl Uniform {
    /// The unit of the drive that `drive` describes.
    #[must_use]
    pub fn new(drive: &DriveDescription) -> Self {
        let sources = Sources::new(drive);
        let reported = status::reported(drive, &sources);
        let control = drive.control.as_deref();
        let capabilities = status::capabilities(&drive.model, control);
        let limits = control.map_or([ABSENT; 2], |control| {
            [least_word(control.least), most_word(control.most)]
        });
        Self {
            sources,
            reported,
            capabilities,
            limits,
        }
    }

    /// What `ask` means to this unit. Words are filled into `words`, computed from `view` as of `present`.
    ///
    /// Reads succeed whatever the state of the drive. A request that is partly outside of the map is answered with 02
    /// as a whole; a write to a drive without control with 01.
    pub fn take(&self, ask: &Ask, view: &DriveView, present: &Present, words: &mut Words) -> Taken {
        match ask {
            Ask::ReadWords {
                table: WordTable::Input,
                address,
                count,
            } if last(*address, *count) >= PICTURE_WORDS => {
                Taken::Exception(exception::ILLEGAL_DATA_ADDRESS)
            }
            Ask::ReadWords { address, count, .. } => {
                self.read(*address, *count, view, present, words)
            }
            Ask::ReadBits {
                table,
                address,
                count,
            } => self.read_bits(*table, *address, *count, view, present),
            Ask::LoopTest { .. } => Taken::Nothing,
            Ask::Identify { .. } => Taken::Exception(exception::ILLEGAL_FUNCTION),
            Ask::ReadWriteWords {
                read_address,
                read_count,
                ..
            } => match self.read(*read_address, *read_count, view, present, words) {
                Taken::Words => self.write(ask, view),
                _ => Taken::Refused(Reason::NotListed),
            },
            Ask::WriteCoil { .. }
            | Ask::WriteWord { .. }
            | Ask::WriteCoils { .. }
            | Ask::WriteWords { .. }
            | Ask::MaskWord { .. } => self.write(ask, view),
        }
    }

    /// Fills in `count` holding registers from `address` on: 0 to 31 or 256 to 261.
    pub fn read(
        &self,
        address: u16,
        count: u16,
        view: &DriveView,
        present: &Present,
        words: &mut Words,
    ) -> Taken {
        let is_there = last(address, count) < PICTURE_WORDS
            || address >= address::RUN && last(address, count) <= CONTROL_LAST;
        let is_filled =
            is_there && words.fill(address, count, |address| self.word(address, view, present));
        if is_filled {
            Taken::Words
        } else {
            Taken::Exception(exception::ILLEGAL_DATA_ADDRESS)
        }
    }

    /// Whether `ask` orders this drive to stop or to coast.
    #[must_use]
    pub fn is_stop(&self, ask: &Ask, view: &DriveView) -> bool {
        matches!(self.write(ask, view), Taken::Order(order) if order.is_stop())
    }

    /// What can be ordered of the drive: the bits of [`capability`].
    #[must_use]
    pub const fn capabilities(&self) -> u16 {
        self.capabilities
    }

    /// Whether the drive has a control section.
    #[must_use]
    pub const fn has_control(&self) -> bool {
        self.sources.has_control
    }

    fn write(&self, ask: &Ask, view: &DriveView) -> Taken {
        if !self.has_control() {
            return Taken::Refused(Reason::ReadOnly);
        }
        match order::order_in(ask, view.control.as_ref()) {
            Ok(Some(order)) => Taken::Order(order),
            Ok(None) => Taken::Nothing,
            Err(reason) => Taken::Refused(reason),
        }
    }

    /// Coils read back the ordered direction; those for RESET and STOP act at once and read 0.
    fn read_bits(
        &self,
        table: BitTable,
        address: u16,
        count: u16,
        view: &DriveView,
        present: &Present,
    ) -> Taken {
        let (bits, there) = match table {
            BitTable::Discrete => (status::status(&self.sources, view, present), STATUS_BITS),
            BitTable::Coils => (self.coils(view), address::COILS),
        };
        if last(address, count) >= there {
            return Taken::Exception(exception::ILLEGAL_DATA_ADDRESS);
        }
        Taken::Bits {
            bits: bits >> address,
            count,
        }
    }

    fn coils(&self, view: &DriveView) -> u16 {
        match self.intent(view) {
            run::FORWARD => 1 << address::FORWARD,
            run::REVERSE => 1 << address::REVERSE,
            _ => 0,
        }
    }
}

/// The last of `count` addresses from `address` on. A request never passes 0xFFFF.
const fn last(address: u16, count: u16) -> u16 {
    address.saturating_add(count.saturating_sub(1))
}

/// The least word that is not below `least`.
fn least_word(least: Hertz) -> u16 {
    column::unsigned(i64::from(least.millihertz().div_ceil(10)))
}

/// The greatest word that is not above `most`.
fn most_word(most: Hertz) -> u16 {
    column::unsigned(i64::from(most.millihertz() / 10))
}

#[cfg(test)]
mod tests;
