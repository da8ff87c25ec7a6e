//! The single entry point for commands: each is reviewed here and becomes [`Approved`], a [`StopOrder`], or a refusal.
//!
//! The line accepts nothing else, and no other module can create one. One [`DriveGuard`] per drive tracks who holds
//! control, the current order, and who may start the drive. It is called guard, not safety: it is no safety function.

pub mod access;
mod adoption;
mod approved;
mod at_rest;
mod commit;
#[cfg(test)]
mod control_tests;
mod full_scale;
mod interlocks;
mod leaving;
mod loss;
mod motion;
mod orphan;
mod owners;
mod ownership;
mod registers;
#[cfg(test)]
mod restart_tests;
mod review;
mod setpoint;
mod setting;
mod sign;
mod state;
#[cfg(test)]
mod tests;
mod trial;
#[cfg(test)]
mod trial_tests;

pub use approved::{Approved, LossAction, StopOrder, VoidApproval};
pub use review::{COMMAND_DEADLINE, CommandVerdict, DriveFacts};
pub use state::DriveGuard;
