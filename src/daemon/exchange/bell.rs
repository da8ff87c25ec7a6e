//! Wakes the readers of the drive views whenever one has changed.

use tokio::sync::Notify;

/// A bell for both sides of the broker. Each is woken on its own: waking one does not consume the ring of the other.
#[derive(Debug, Default)]
pub struct BrokerBell {
    /// The MQTT side waits for it.
    pub mqtt: Notify,
    /// The Sparkplug side waits for it.
    pub sparkplug: Notify,
}

impl BrokerBell {
    /// Rings for both. A side that is busy is woken later.
    pub fn ring(&self) {
        self.mqtt.notify_one();
        self.sparkplug.notify_one();
    }
}
