//! Uniform units: the same map for every model, answered at once from the view of the drive.

mod column;
mod order;
mod sources;
mod status;
mod table;
mod words;

pub use crate::north::points::alarm;
pub use column::{ABSENT, ABSENT_SIGNED};
pub use order::{presses_stop, run};
pub use status::{bit, capability};
pub(super) use table::WORDS;

use super::ask::{BitTable, ModbusRequest, WordTable};
use super::taken::{RequestAction, RequestContext};
use super::words::WordBuffer;
use crate::domain::command::Reason;
use crate::domain::frequency::Hertz;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::wire::exception;
use sources::MeasurementSources;

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
/// Discrete inputs: the bits of word 1.
const STATUS_BITS: u16 = 16;

/// The uniform unit of one drive, prepared once so that a read needs no lookup by name.
#[derive(Clone, Debug)]
pub struct UniformUnit {
    sources: MeasurementSources,
    reported: u16,
    capabilities: u16,
    /// Lowest and highest setpoint, 0.01 Hz.
    limits: [u16; 2],
}

impl UniformUnit {
    /// The unit of the drive that `drive` describes.
    #[must_use]
    pub fn new(drive: &DriveDescription) -> Self {
        let sources = MeasurementSources::new(drive);
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
    pub fn take(
        &self,
        ask: &ModbusRequest,
        view: &DriveView,
        present: &RequestContext,
        words: &mut WordBuffer,
    ) -> RequestAction {
        match ask {
            ModbusRequest::ReadWords {
                table: WordTable::Input,
                address,
                count,
            } if !Self::are_of_view(last(*address, *count)) => {
                RequestAction::Exception(exception::ILLEGAL_DATA_ADDRESS)
            }
            ModbusRequest::ReadWords { address, count, .. } => {
                self.read(*address, *count, view, present, words)
            }
            ModbusRequest::ReadBits {
                table,
                address,
                count,
            } => self.read_bits(*table, *address, *count, view, present),
            ModbusRequest::LoopTest { .. } => RequestAction::Nothing,
            ModbusRequest::Identify { .. } => RequestAction::Exception(exception::ILLEGAL_FUNCTION),
            ModbusRequest::ReadWriteWords {
                read_address,
                read_count,
                ..
            } => match self.read(*read_address, *read_count, view, present, words) {
                RequestAction::Words => self.write(ask, view),
                _ => RequestAction::Refused(Reason::NotListed),
            },
            ModbusRequest::WriteCoil { .. }
            | ModbusRequest::WriteWord { .. }
            | ModbusRequest::WriteCoils { .. }
            | ModbusRequest::WriteWords { .. }
            | ModbusRequest::MaskWord { .. } => self.write(ask, view),
        }
    }

    /// Fills in `count` holding registers from `address` on, all of the view or all of control.
    pub fn read(
        &self,
        address: u16,
        count: u16,
        view: &DriveView,
        present: &RequestContext,
        words: &mut WordBuffer,
    ) -> RequestAction {
        let last = last(address, count);
        let is_there = Self::are_of_view(last) || Self::are_of_control(address, last);
        let is_filled =
            is_there && words.fill(address, count, |address| self.word(address, view, present));
        if is_filled {
            RequestAction::Words
        } else {
            RequestAction::Exception(exception::ILLEGAL_DATA_ADDRESS)
        }
    }

    /// Whether `ask` orders this drive to stop or to coast.
    #[must_use]
    pub fn is_stop(&self, ask: &ModbusRequest, view: &DriveView) -> bool {
        matches!(self.write(ask, view), RequestAction::Order(order) if order.is_stop())
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

    fn write(&self, ask: &ModbusRequest, view: &DriveView) -> RequestAction {
        if !self.has_control() {
            return RequestAction::Refused(Reason::ReadOnly);
        }
        match order::order_in(ask, view.control.as_ref()) {
            Ok(Some(order)) => RequestAction::Order(order),
            Ok(None) => RequestAction::Nothing,
            Err(reason) => RequestAction::Refused(reason),
        }
    }

    /// Coils read back the ordered direction; those for RESET and STOP act at once and read 0.
    fn read_bits(
        &self,
        table: BitTable,
        address: u16,
        count: u16,
        view: &DriveView,
        present: &RequestContext,
    ) -> RequestAction {
        let (bits, there) = match table {
            BitTable::Discrete => (status::status(&self.sources, view, present), STATUS_BITS),
            BitTable::Coils => (self.coils(view), address::COILS),
        };
        if last(address, count) >= there {
            return RequestAction::Exception(exception::ILLEGAL_DATA_ADDRESS);
        }
        RequestAction::Bits {
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
