//! Function codes that only clients use: the drives are asked with those of [`crate::wire::pdu::function`].

use crate::wire::pdu::function;

/// Read coils.
pub const READ_COILS: u8 = 0x01;
/// Read discrete inputs.
pub const READ_DISCRETE: u8 = 0x02;
/// Write a single coil.
pub const WRITE_COIL: u8 = 0x05;
/// Write several coils.
pub const WRITE_COILS: u8 = 0x0F;
/// Change single bits of a register.
pub const MASK_WRITE: u8 = 0x16;
/// Write several registers, then read several.
pub const READ_WRITE: u8 = 0x17;
/// Encapsulated interface transport.
pub const ENCAPSULATED: u8 = 0x2B;
/// The transport's type for device identification.
pub const DEVICE_IDENTIFICATION: u8 = 0x0E;
/// The word that switches a coil on; 0 switches it off.
pub const COIL_ON: u16 = 0xFF00;

/// Whether a function writes, alone or beside a read.
pub const fn writes(code: u8) -> bool {
    matches!(
        code,
        WRITE_COIL
            | function::WRITE_SINGLE
            | WRITE_COILS
            | function::WRITE_MULTIPLE
            | MASK_WRITE
            | READ_WRITE
    )
}
