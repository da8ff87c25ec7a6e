//! The MQTT side: the real session, and a small broker.

use super::world::World;
use vfd_gateway::domain::command::CommandAnswer;
use vfd_gateway::domain::ids::DriveIndex;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::view::TripEvent;

/// The session with its broker.
pub struct MqttSide {
    pub wake_at: MonoTime,
}

impl MqttSide {
    pub fn new(_world: &World) -> Self {
        Self { wake_at: MonoTime::NEVER }
    }
}

impl World {
    pub fn mqtt_turn(&mut self) {}

    pub fn mqtt_hears(&mut self, _answer: &CommandAnswer) {}

    pub fn mqtt_trip(&mut self, _drive: DriveIndex, _event: &TripEvent) {}
}
