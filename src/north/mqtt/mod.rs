//! The MQTT side without a socket or a clock: what the broker says, what the lines answer and time go in; what is
//! to be published, subscribed and commanded comes out.
//!
//! [`Session`] is the whole. Inside it, `topics` knows every topic, `payload`, `command_json` and `params` read what
//! commanders send, `inputs` and `dispatch` make it commands of [`broker`](super::broker), `answers` and `results` tell
//! how they ended, `attempts` says what a refused message tried, `seen` remembers the ids that were used, `stored`,
//! `outbox` and `history` hold what is to be told, `telemetry` walks the pictures of the drives, where `points` says of
//! each register which change of it is news, and `home_assistant` says what there is to show of them.

mod answers;
mod attempts;
mod command_json;
mod counters;
mod dispatch;
mod drive_topics;
mod history;
mod home_assistant;
mod in_flight;
mod inputs;
mod line_topics;
mod outbox;
mod params;
mod payload;
mod points;
mod replaced;
#[cfg(test)]
mod replaced_tests;
mod results;
mod seen;
mod session;
mod slot;
mod state;
mod stored;
mod telemetry;
mod topics;
mod types;

#[cfg(test)]
mod clock_steps;
#[cfg(test)]
mod command_tests;
#[cfg(test)]
mod harness;
#[cfg(test)]
mod outage_tests;
#[cfg(test)]
mod publish_tests;
#[cfg(test)]
mod refused_tests;
#[cfg(test)]
mod session_tests;
#[cfg(test)]
mod telemetry_tests;

pub use counters::Counters;
pub(in crate::north) use drive_topics::{Kind, code as trip_code, kinds, trips_are_fresh};
pub(in crate::north) use points::Points;
pub use session::Session;
pub use types::{Act, HomeAssistant, LeaseMode, Settings, Tree};
