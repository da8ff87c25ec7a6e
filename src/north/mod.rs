//! What clients see: parsers and sans-IO machines. No socket, no clock, and nothing of the line machine.

pub mod modbus;
pub mod mqtt;
pub mod report;
pub mod setup_body;
pub mod traffic;
