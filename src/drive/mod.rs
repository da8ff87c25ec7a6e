//! What is known about one drive, and what an order means to it: which registers are polled and when, what was last
//! read, orders as steps, trips, run state, and the picture that the north sides are shown.

pub mod decode;
pub mod description;
pub mod plan;
pub mod rated;
pub mod run_state;
pub mod snapshot;
pub mod status;
pub mod steps;
#[cfg(test)]
pub mod testing;
pub mod trips;
pub mod view;
pub mod watchdog;
