//! The MQTT side without a socket or a clock: what the broker says, what the lines answer and time go in; what is
//! to be published, subscribed and commanded comes out.

mod types;

pub use types::{Act, Broker, Event, LeaseMode, LineState, Message, Moment, Publication, Qos, Settings, Version};
