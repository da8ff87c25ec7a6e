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
    Commands, NewCommand, NewRead, Pending, Request, refused_frequency, tried_by,
};
pub(in crate::north) use issued::Issued;
pub use oversized::Oversized;
pub(in crate::north) use oversized::OversizedTopics;
pub use path::unnoticed;
pub(in crate::north) use path::{Path, Returned};
pub use types::{Broker, Event, Filter, LineState, Message, Publication, Qos, Refusal, Version};
