//! One function per parser of external bytes. It accepts any bytes, and panics if a property is violated.
//!
//! The fuzzer calls them from `fuzz_targets/`; the ordinary tests replay the corpus through the same functions.

mod feed;
mod plant;
mod text;

pub mod assembler;
pub mod bus;
pub mod config;
pub mod line;
pub mod modbus_tcp;
pub mod model;
pub mod mqtt;
pub mod page;
pub mod pdu;
pub mod setup_body;
pub mod sparkplug;
pub mod values;

/// A target: it panics if a property is violated.
pub type Target = fn(&[u8]);

/// All targets by the names of their binaries and of their folders in `corpus/`.
pub const TARGETS: &[(&str, Target)] = &[
    ("assembler", assembler::run),
    ("bus", bus::run),
    ("config", config::run),
    ("line", line::run),
    ("modbus_tcp", modbus_tcp::run),
    ("model", model::run),
    ("mqtt", mqtt::run),
    ("page", page::run),
    ("pdu", pdu::run),
    ("setup_body", setup_body::run),
    ("sparkplug", sparkplug::run),
    ("values", values::run),
];
