//! Wakes those who look at pictures whenever one has changed.

use tokio::sync::Notify;

/// A bell that both sides of the broker hear, each in its own time: what one has heard the other still hears.
#[derive(Debug, Default)]
pub struct Bell {
    /// The MQTT side waits for it.
    pub mqtt: Notify,
    /// The Sparkplug side waits for it.
    pub sparkplug: Notify,
}

impl Bell {
    /// Rings for both. It is heard later by who is busy now.
    pub fn ring(&self) {
        self.mqtt.notify_one();
        self.sparkplug.notify_one();
    }
}
