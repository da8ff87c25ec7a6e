//! How a simulated bus behaves.

use super::fault::FaultPlan;
use super::transmissions::BusDelivery;
use crate::domain::link::Framing;
use std::time::Duration;

/// Whether characters take time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum BusPacing {
    /// Every byte takes its character time, in both directions, and drives need their turnaround.
    #[default]
    CharacterTimes,
    /// Bytes take no time and a reply is due at once, over Modbus TCP after the turnaround, unless a fault makes it late.
    None,
}

/// The behaviour of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusOptions {
    /// The framing.
    pub framing: Framing,
    /// Whether characters take time.
    pub pacing: BusPacing,
    /// Time from the end of a request to the start of its reply.
    pub turnaround: Duration,
    /// Silence that the master must keep before a request, and that ends an RTU request. `None`: the maximum that a
    /// model on the bus requires, but at least 1.75 ms above 19,200 bit/s (Modbus over serial line V1.02, 2.5.1.1) and
    /// 10 ms on an ASCII bus.
    pub silence: Option<Duration>,
    /// The pieces in which bytes are delivered to the master.
    pub delivery: BusDelivery,
    /// The faults of replies.
    pub faults: FaultPlan,
}

impl Default for BusOptions {
    /// RTU, paced, 2 ms turnaround, silence as required by the models, no faults.
    fn default() -> Self {
        Self {
            framing: Framing::Rtu,
            pacing: BusPacing::CharacterTimes,
            turnaround: Duration::from_millis(2),
            silence: None,
            delivery: BusDelivery::default(),
            faults: FaultPlan::NONE,
        }
    }
}
