//! What the MQTT and Sparkplug sessions with a broker share: what a session takes and returns, the path to the broker and
//! its probe, the age of a command, and commands on their way to the lines. The sessions add topics and payloads.

mod commands;
mod issued;
mod link;
mod oversized;
mod path;
mod session;
mod types;

#[cfg(test)]
pub(in crate::north) use commands::ATTEMPTS_MAX;
pub use commands::ToLine;
pub(in crate::north) use commands::{
    DriveRequest, NewCommand, NewRead, PendingRequest, refused_frequency, tried_by, tried_text,
};
pub(in crate::north) use link::BrokerLink;
pub use oversized::OversizedPublication;
pub(in crate::north) use path::ReturnedProbe;
pub use path::unnoticed;
pub use session::{BrokerSession, SessionAct, SessionNotice};
pub use types::{
    BrokerEvent, BrokerLimits, BrokerMessage, MqttVersion, Publication, PublicationRefusal, Qos,
    SessionLine, SubscriptionFilter,
};
