//! The only room with tokio, files, sockets, clocks and signals. It executes what the pure rooms decide.
//!
//! The main thread serves the north side on a runtime of its own; each line has a thread of its own, so that nothing
//! else delays its frames. They exchange requests ([`exchange::inbox::LineInbox`]) and answers
//! ([`exchange::answers::AnswerBox`]).

#![allow(
    clippy::disallowed_methods,
    reason = "this room reads the clocks for all others"
)]

pub mod commissioning;
pub mod exchange;
pub mod host;
pub mod http;
pub mod journal;
pub mod line_thread;
pub mod lines;
pub mod local;
pub mod modbus_rtu;
pub mod modbus_server;
pub mod mqtt;
pub mod port;
pub mod qualified_file;
pub mod scan;
pub mod service;
#[cfg(test)]
mod stop_all_tests;
#[cfg(test)]
pub(crate) mod testing;
pub mod trends;
