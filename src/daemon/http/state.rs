//! What the HTTP side knows: what the lines show, and counts that the other north sides keep for it.

use super::reachable::Reachable;
use crate::daemon::exchange::shared::Current;
use crate::daemon::exchange::totals::{ModbusTotals, MqttTotals, SparkplugTotals};
use crate::daemon::journal::Journal;
use crate::domain::report::LineState;
use crate::domain::time::{MonoTime, WallTime};
use arc_swap::ArcSwapOption;
use std::sync::Arc;

/// What the HTTP side knows. It is made once, when the gateway starts.
#[derive(Debug)]
pub struct State {
    /// The gateway's name.
    pub gateway: String,
    /// Lines and drives.
    pub shared: Current,
    /// Counts of the Modbus TCP side.
    pub modbus: Arc<ModbusTotals>,
    /// State and counts of the MQTT side; nothing if no broker is configured.
    pub mqtt: ArcSwapOption<MqttTotals>,
    /// State and counts of the Sparkplug side; nothing if it is not configured.
    pub sparkplug: ArcSwapOption<SparkplugTotals>,
    /// The journal; nothing if there is no data directory.
    pub journal: Option<Arc<Journal>>,
    /// Whether the program's own commands reach the gateway; nothing if there is no data directory.
    pub socket: Option<Arc<Reachable>>,
    /// When the gateway started.
    pub started: MonoTime,
    /// The same moment for people.
    pub started_at: WallTime,
}

impl State {
    /// Whether the gateway does what it is configured for: all lines are open, and the broker is reached if there is
    /// one.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        let lines_are_up = self.shared.load().lines.iter().all(|line| line.report().state == LineState::Up);
        lines_are_up && self.mqtt.load().as_ref().is_none_or(|mqtt| mqtt.is_connected())
    }
}
