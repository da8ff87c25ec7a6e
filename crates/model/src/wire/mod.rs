//! Converts between bytes and PDUs: RTU and ASCII frames with their checks, MBAP, function codes. Knows no drive.

pub mod ascii;
pub mod crc;
pub mod exception;
pub mod frame;
pub mod framing;
pub mod mbap;
pub mod pdu;
pub mod rtu;
pub mod signal;
