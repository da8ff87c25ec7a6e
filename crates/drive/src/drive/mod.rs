//! The state of one drive and how orders are carried out on it: which registers are polled and when, the last
//! readings, orders as steps, trips, run state, and the view for the north interfaces.

pub mod bases;
pub mod decode;
pub mod description;
pub mod doubt;
pub mod output;
pub mod plan;
pub mod plausible;
pub mod rated;
pub mod required;
pub mod run_state;
pub mod sight;
pub mod snapshot;
pub mod status;
pub mod steps;
pub mod trips;
pub mod usage;
pub mod view;
pub mod warnings;
pub mod watchdog;
