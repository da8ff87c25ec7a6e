//! What the MQTT and Sparkplug sessions with a broker share: the path to the broker and its probe, the age of a
//! command, and commands on their way to the lines. The sessions add parsing and answers.

mod commands;
mod issued;
mod oversized;
mod path;
mod types;

#[cfg(test)]
pub(in crate::north) use commands::ATTEMPTS_MAX;
pub use commands::ToLine;
pub(in crate::north) use commands::{
    BrokerCommands, DriveRequest, NewCommand, NewRead, PendingRequest, refused_frequency, tried_by,
};
pub(in crate::north) use issued::ClientClocks;
pub use oversized::OversizedPublication;
pub(in crate::north) use oversized::OversizedTopics;
pub use path::unnoticed;
pub(in crate::north) use path::{BrokerPath, ReturnedProbe};
pub use types::{
    BrokerEvent, BrokerLimits, BrokerMessage, MqttVersion, Publication, PublicationRefusal, Qos,
    SessionLine, SubscriptionFilter,
};
