//! What the north side may know of a drive: who it is and where it is reached.

use super::ids::{DriveIndex, Name, Station, UnitId};

/// One drive as the north side sees it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveDescription {
    /// The drive's name.
    pub name: Name,
    /// Its place on its line.
    pub index: DriveIndex,
    /// Number on the serial line.
    pub station: Station,
    /// Identifier of the model it is described by.
    pub model: String,
    /// Unit under which its own registers are reached on Modbus TCP.
    pub unit: UnitId,
}
