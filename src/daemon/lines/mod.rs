//! Lines: their threads, their rows in the journal, the line of a tool, and simulated ones.

pub mod rows;
pub mod simulated_end;
pub mod simulator;
pub mod threads;
pub mod tool_line;
