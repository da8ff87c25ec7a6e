//! The only door for commands: each is reviewed here and becomes [`Approved`], a [`StopOrder`], or a refusal.
//!
//! The line takes nothing else, and nobody else can make one. One [`DriveGuard`] per drive keeps who holds control,
//! what is ordered, and who may start it. It is called guard, not safety: nothing here is a safety function.

pub mod access;
mod approved;
mod at_rest;
#[cfg(test)]
mod control_tests;
mod interlocks;
mod leaving;
mod motion;
mod orphan;
mod owners;
mod ownership;
mod registers;
#[cfg(test)]
mod restart_tests;
mod review;
mod state;
#[cfg(test)]
mod tests;

pub use approved::{Approved, StopOrder, Void};
pub use review::{COMMAND_DEADLINE, Facts, Verdict};
pub use state::{DriveGuard, Lost};
