//! Lines: what they are built from, their threads, the line of a tool, and simulated ones.

pub mod build;
pub mod simulated_end;
pub mod simulator;
pub mod threads;
pub mod tool_line;
