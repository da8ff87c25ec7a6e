//! A gateway between variable-frequency drives on serial lines and Modbus TCP and MQTT.
//!
//! The rooms, in the order in which they may use each other (each only those before it):
//!
//! | room | what lives there |
//! | --- | --- |
//! | [`domain`] | words of the trade: time, ids, frequencies, commands, requests, reports |
//! | [`wire`] | bytes to PDUs and back; knows no drive |
//! | [`toml_file`] | reads any TOML file and reports all its mistakes at once, each with its place |
//! | [`profile`] | what a drive description may say, and the proof that it is sound |
//! | [`vendors`] | one folder per vendor: model files, data only |
//! | [`drive`] | what is known about one drive: poll plan, picture, trips; commands as steps |
//! | [`journal`] | what is kept beyond the life of the process, and what is known of an earlier one |
//! | [`guard`] | the only door for commands: limits, owners, leases, start inhibit |
//! | [`mod@line`] | the wire of one line as a machine: schedule, transaction, timing, fault table, counters |
//! | [`gateway`] | `LineCore`: the pure whole of one line; events and time in, effects out |
//! | [`north`] | Modbus TCP, MQTT and Sparkplug B as machines without sockets |
//! | [`config`] | the configuration file, from text to ready values or to all its problems |
//! | [`sim`] | simulated drives on a simulated bus |
//! | [`daemon`] | the only room with tokio, files, sockets, clocks and signals |
//! | [`cli`] | the commands, one file each, and their tools |
//!
//! Everything up to `sim` is synchronous and pure: it is given events and the time and says what should
//! be done. A build without default features proves it.

#![cfg_attr(test, allow(clippy::too_many_lines, reason = "a test is one story"))]

pub mod config;
pub mod domain;
pub mod drive;
pub mod gateway;
pub mod guard;
pub mod journal;
pub mod line;
pub mod north;
pub mod profile;
pub mod sim;
pub mod toml_file;
pub mod vendors;
pub mod wire;

#[cfg(feature = "daemon")]
pub mod cli;
#[cfg(feature = "daemon")]
pub mod daemon;
