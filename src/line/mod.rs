//! The wire of one line as a machine without IO and without a clock.
//!
//! [`timing`] knows what characters and silences cost, [`timeouts`] how long a reply is waited for, [`reply_times`]
//! how long one has taken, [`transaction`] runs one exchange, [`station`] keeps late replies apart and dead stations
//! cheap, [`barriers`] knows what settles them, [`echo`] whether the line echoes, [`quality`] how good it is,
//! [`diagnosis`] what is probably wrong with it, [`damage`] what is wrong with what drives send, [`schedule`] says what goes next, [`fault`] what follows from each
//! fault, [`budget`] what a poll plan costs before it is started.

mod arrivals;
pub mod barriers;
pub mod budget;
pub mod damage;
pub mod diagnosis;
pub mod echo;
pub mod exchange;
pub mod fault;
pub mod histogram;
mod own_echo;
pub mod quality;
pub mod reply_times;
pub mod schedule;
pub mod station;
mod talk;
pub mod timeouts;
pub mod timing;
pub mod transaction;
#[cfg(test)]
mod transaction_ascii_tests;
