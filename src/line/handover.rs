//! The one frame of the gateways' own on a line: the active one asks the next one to take over, so that nothing is silent
//! for long and no drive is stopped.
//!
//! It is for a station that no drive may have (248 to 255 are reserved, MODBUS over serial line V1.02, 2.2), with a function
//! that the standard leaves to the user (V1.1b3, 5.1), so that no drive takes it for an order.

use crate::domain::ids::Station;

/// The station that the frame is for.
pub const STATION: Station = Station(0xFA);

/// The PDU: a function of the user's, and letters that no other device sends there by chance.
pub const PDU: [u8; 5] = [0x65, b'V', b'F', b'D', 0x01];

/// Whether a frame of `station` with `pdu` is that one.
#[must_use]
pub fn is_handover(station: Station, pdu: &[u8]) -> bool {
    station == STATION && pdu == PDU
}
