//! The MQTT side without a socket or a clock: what the broker says, what the lines answer and time go in; what is
//! to be published, subscribed and commanded comes out.
//!
//! [`Session`] is the whole. Inside it, `path` follows the connection and its probe, `topics` knows every topic,
//! `payload`, `command_json` and `params` read what commanders send, `inputs`, `giving` and `answers` turn it into
//! commands and results, `kept` accounts for what comes to nothing, `pending` and `seen` remember what is under way and
//! what was, `results`, `stored`, `outbox` and `history` hold what is to be told, `telemetry` walks the pictures of the
//! drives, where `points` says of each register which change of it is news, and `home_assistant` says what there is to
//! show of them.

mod answers;
mod command_json;
mod counters;
mod drive_topics;
mod giving;
mod history;
mod home_assistant;
mod in_flight;
mod inputs;
mod kept;
mod line_topics;
mod outbox;
mod params;
mod path;
mod payload;
mod pending;
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
pub use path::unnoticed;
pub(in crate::north) use path::{Path, Returned};
pub(in crate::north) use points::Points;
pub use session::Session;
pub use types::{
    Act, Broker, Event, Filter, HomeAssistant, LeaseMode, LineState, Message, Moment, Publication, Qos, Refusal,
    Settings, Tree, Version,
};
