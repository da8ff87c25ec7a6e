//! The parts of a fleet that need no socket and no clock: who publishes what and when, and the books of what was sent,
//! acknowledged and received.
//!
//! | part | what it does |
//! | --- | --- |
//! | [`shape`] | how many gateways and drives, when each update is due, and the topics |
//! | [`mark`] | the number and the moment that each update carries |
//! | [`ledger`] | the state of each update |
//! | [`delays`] | times, counted in buckets |
//!
//! The books are shared by all threads of a simulation without a lock.

pub mod delays;
pub mod ledger;
pub mod mark;
pub mod shape;

pub use delays::Delays;
pub use ledger::{Balance, Ledger, Receipt};
pub use mark::Mark;
pub use shape::{Shape, Update};
