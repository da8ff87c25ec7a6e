//! The MQTT side without a socket or a clock: messages of the broker, answers of the lines and time go in; what is to
//! be published, subscribed and commanded is returned.
//!
//! [`MqttSession`] is the whole. Inside it, `topics` knows every topic, `payload`, `command_json` and `params` parse what
//! clients send, `inputs` and `dispatch` turn it into commands of [`broker`](super::broker), `answers` and `results`
//! publish their outcomes, `attempts` describes what a refused message attempted, `seen` remembers used ids, `stored`,
//! `event_queue` and `history` hold what is still to be published, `telemetry` walks the views of the drives by their
//! [`points`](super::points), and `home_assistant` announces it all. `standby`, `half` and `peer_events` make it one of
//! several gateways of the same name.

mod answers;
mod attempts;
mod broker_limits;
mod command_ids;
mod command_json;
mod counters;
mod dispatch;
mod drive_topics;
mod event_queue;
mod half;
mod history;
mod home_assistant;
mod in_flight;
mod inputs;
mod line_topics;
mod params;
mod payload;
mod peer_events;
mod replaced;
#[cfg(test)]
mod replaced_tests;
mod results;
mod session;
mod slot;
mod standby;
#[cfg(test)]
mod standby_pair_tests;
#[cfg(test)]
mod standby_tests;
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

pub use counters::MqttCounters;
pub use session::MqttSession;
pub use types::{CombinedEntity, GatewayIdentity, HomeAssistant, LeaseMode, Settings, TopicTree};
