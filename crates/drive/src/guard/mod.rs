//! The single entry point for commands: each is reviewed here and becomes [`Approved`], a [`StopOrder`], or a refusal.
//!
//! The line accepts nothing else, and no other module can create one. One [`DriveGuard`] per drive tracks who holds
//! control, the current order, and who may start the drive. It is called guard, not safety: it is no safety function.

pub mod access;
mod adoption;
mod approved;
mod at_rest;
mod closing;
mod commit;
#[cfg(test)]
mod control_tests;
mod interlocks;
mod lease;
mod loss;
mod motion;
mod owners;
mod registers;
#[cfg(test)]
mod restart_tests;
mod review;
mod run_order;
mod setpoint;
mod sign;
mod start_inhibit;
mod state;
#[cfg(test)]
mod tests;
mod trial;
#[cfg(test)]
mod trial_tests;

pub use approved::{Approved, LossAction, StopOrder, VoidApproval};
pub use review::{COMMAND_DEADLINE, CommandVerdict, DriveFacts};
pub use state::DriveGuard;
