//! What is known about one drive: which registers are polled and when, what was last read, and the picture that
//! the north sides are shown.

pub mod description;
pub mod plan;
pub mod snapshot;
pub mod view;
