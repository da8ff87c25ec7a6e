//! What is known about one drive: which registers are polled and when, and what was last read.

pub mod plan;
pub mod snapshot;
