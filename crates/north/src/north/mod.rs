//! The client side: parsers and sans-IO state machines. No socket, no clock, and no access to the line machine.

pub mod api;
pub mod broker;
pub mod clock;
pub mod command_words;
pub mod finding;
pub mod modbus;
pub mod mqtt;
pub mod operator;
pub mod page;
pub mod points;
pub mod report;
mod seal;
pub mod setup_body;
pub mod shown;
pub mod sparkplug;
#[cfg(test)]
mod stage;
pub mod texts;
pub mod titles;
pub mod traffic;
