//! A gateway between variable-frequency drives on serial lines and Modbus TCP and MQTT.
//!
//! The rooms [`daemon`] and [`cli`] are the program. All others come from the crates in `crates/`, which are synchronous and pure:
//! they are given events and the time, and say what should be done. `ARCHITECTURE.md` has the order in which rooms use each other.

#![cfg_attr(test, allow(clippy::too_many_lines, reason = "a test is one story"))]

pub mod cli;
pub mod daemon;

pub use vfd_config::config;
pub use vfd_drive::{drive, guard, journal};
pub use vfd_line::{gateway, line};
pub use vfd_model::{domain, profile, toml_file, vendors, wire};
pub use vfd_north::north;
pub use vfd_sim::sim;
