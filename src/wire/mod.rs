//! Bytes on one side, PDUs on the other: CRC, RTU frames, MBAP, function codes. Knows no drive.

pub mod crc;
pub mod exception;
pub mod mbap;
pub mod pdu;
pub mod rtu;
