//! The wire of one line as a state machine without I/O and without a clock.
//!
//! * [`timing`]: duration of characters and silences
//! * [`timeouts`]: how long to wait for a reply
//! * [`reply_times`]: how long replies have taken
//! * [`transaction`]: runs one exchange
//! * [`station`]: detects late replies and limits the cost of dead stations
//! * [`quiet`]: the silence after an unexplained frame
//! * [`barriers`]: exchanges that rule out late replies
//! * [`echo`]: whether the line echoes
//! * [`quality`]: how good the line is
//! * [`diagnosis`]: what is probably wrong with it
//! * [`damage`]: what is wrong with the data that drives send
//! * [`schedule`]: which native read is next
//! * [`fault`]: the consequences of each fault
//! * [`budget`]: the cost of a poll plan before it is started

mod arrivals;
pub mod barriers;
pub mod budget;
pub mod damage;
pub mod diagnosis;
pub mod echo;
pub mod exchange;
pub mod fault;
pub mod gap;
pub mod histogram;
mod occupancy;
pub mod overheard;
mod own_echo;
pub mod quality;
pub mod quiet;
pub mod reply_times;
pub mod roll_call;
pub mod schedule;
pub mod standby;
pub mod station;
mod stray;
pub mod timeouts;
pub mod timing;
pub mod transaction;
#[cfg(test)]
mod transaction_ascii_tests;
#[cfg(test)]
mod transaction_mbap_tests;
