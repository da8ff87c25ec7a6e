//! The only room with tokio, files, sockets, clocks and signals. It carries out what the pure rooms decide.
//!
//! The main thread serves the north side on a runtime of its own; each line has a thread of its own, so that
//! nothing else delays its frames. Between them go requests ([`inbox::Inbox`]) and answers
//! ([`answers::AnswerBox`]).

#![allow(clippy::disallowed_methods, reason = "this room reads the clocks for all others")]

pub mod answers;
pub mod bell;
pub mod board;
pub mod build;
pub mod clock;
pub mod conversations;
pub mod descriptors;
mod embedded_broker;
pub mod http;
pub mod inbox;
pub mod journal;
pub mod keeper;
pub mod line_end;
pub mod line_rows;
pub mod line_thread;
pub mod lines;
pub mod local;
pub mod modbus_server;
pub mod mqtt;
pub mod north;
pub mod north_journal;
pub mod north_sides;
pub mod notify;
pub mod own_lock;
pub mod pem_files;
pub mod port;
pub mod pty;
mod random;
pub mod reload;
pub mod reload_request;
pub mod router;
pub mod run;
pub mod secret_files;
pub mod shared;
pub mod simulator;
pub mod sparkplug;
mod stall;
pub mod start_error;
#[cfg(test)]
mod stop_all_tests;
pub mod sys;
#[cfg(test)]
pub(crate) mod testing;
pub mod timer;
mod to_lines;
pub mod told;
pub mod tool_line;
pub mod totals;
pub mod traffic;
pub mod user_files;
