//! A serial master ready to be served.

use super::ready::{ListenerSettings, PortAddress};
use crate::domain::ids::CommanderName;
use crate::domain::link::{DirectionControl, Framing, LinkSettings};
use std::time::Duration;

/// A serial port at which the gateway is a slave: its master is the only client there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialMasterSettings {
    /// Unique among the serial masters.
    pub name: CommanderName,
    /// Neither a line nor another master has the same one, as far as the text shows.
    pub port: PortAddress,
    /// Speed and character format.
    pub link: LinkSettings,
    /// How the master delimits frames.
    pub framing: Framing,
    /// What switches the direction.
    pub direction: DirectionControl,
    /// Whether the driver of a device is asked to deliver received bytes at once.
    pub low_latency: bool,
    /// Time from the end of a request until an exception has been sent, if there is no answer: 20 ms to 5 s, and longer
    /// than the silence and the exception take.
    pub answer_within: Duration,
    /// What the master reaches and may do, in the words of a listener: its one client is this host.
    pub serving: ListenerSettings,
}

impl SerialMasterSettings {
    /// Whether `other` uses the same port in the same way, so that the port stays open over a change.
    #[must_use]
    pub fn has_port_of(&self, other: &Self) -> bool {
        Self {
            serving: other.serving.clone(),
            ..self.clone()
        } == *other
    }
}
