//! Modbus TCP from the side of one client: parsing requests, forming answers, and the connection between them.

mod answer;
mod connection;
mod request;

pub use connection::{Call, CloseReason, Connection, Counters, Limits};
pub use request::parse;
