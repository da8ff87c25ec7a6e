//! CRC-16/MODBUS through the `crc` crate, whose table is built at compile time and checked against the
//! catalogue of known CRCs. A frame of 256 bytes takes less than a microsecond.

use crc::{CRC_16_MODBUS, Crc};

const MODBUS: Crc<u16> = Crc::<u16>::new(&CRC_16_MODBUS);

/// The CRC of `bytes`. On the wire its low byte is sent first (Modbus over serial line V1.02, 2.5.1.2).
#[must_use]
pub fn modbus(bytes: &[u8]) -> u16 {
    MODBUS.checksum(bytes)
}

/// Whether the last two bytes of `adu` are the CRC of those before, low byte first.
#[must_use]
pub fn is_sound(adu: &[u8]) -> bool {
    match adu.split_last_chunk::<2>() {
        Some((body, sent)) => modbus(body) == u16::from_le_bytes(*sent),
        None => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_the_n700_manual() {
        // Register after each byte of 01 03 01 01 00 01, interface manual, CRC example.
        let bytes = [0x01, 0x03, 0x01, 0x01, 0x00, 0x01];
        let steps = [0x807E, 0x2140, 0x30E1, 0x8831, 0xD449, 0x36D4];
        for (n, step) in steps.into_iter().enumerate() {
            assert_eq!(modbus(&bytes[..=n]), step);
        }
    }

    #[test]
    fn swapped_crc_bytes_are_not_sound() {
        assert!(is_sound(&[0x01, 0x03, 0x01, 0x01, 0x00, 0x01, 0xD4, 0x36]));
        assert!(!is_sound(&[0x01, 0x03, 0x01, 0x01, 0x00, 0x01, 0x36, 0xD4]));
        assert!(!is_sound(&[0x01]));
    }
}
