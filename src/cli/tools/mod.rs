//! What several commands use: the ways to a gateway or a drive, files, questions, output.

pub(super) mod client;
pub(super) mod consent;
pub(super) mod data_dir;
pub(super) mod failure;
pub mod input;
pub(super) mod keyboard;
pub(super) mod link_args;
pub mod log;
pub(super) mod model_facts;
pub(super) mod order;
pub(super) mod output;
pub(super) mod own_gateway;
pub mod own_models;
pub(super) mod page_certificate;
pub(super) mod passwords;
pub mod progress;
pub(super) mod questions;
pub(super) mod reading;
pub(super) mod running;
pub(super) mod scanning;
pub(super) mod setup;
pub(super) mod socket;
pub(super) mod stopping;
pub(super) mod straight_write;
pub(super) mod target;
pub(super) mod told_to_stop;
pub(super) mod unseen;

pub use failure::CommandFailure;
pub use output::{WordTone, print, toned};
