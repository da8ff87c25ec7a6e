//! The wire of one line as a machine without IO and without a clock.
//!
//! [`timing`] knows what characters and silences cost, [`transaction`] runs one exchange, [`station`] keeps
//! late replies apart and dead stations cheap, [`schedule`] says what goes next, [`fault`] what follows from
//! each fault, [`budget`] what a poll plan costs before it is started.

pub mod budget;
pub mod fault;
pub mod schedule;
pub mod station;
pub mod timing;
pub mod transaction;
#[cfg(test)]
mod transaction_ascii_tests;
