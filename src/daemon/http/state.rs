//! What the HTTP side reads: what the lines publish, and the counts of the other north sides.

use super::reachable::CommandReachability;
use crate::daemon::exchange::shared::CurrentPlant;
use crate::daemon::exchange::totals::{ModbusTotals, MqttTotals, SparkplugTotals};
use crate::daemon::journal::Journal;
use crate::daemon::trends::KeptTrends;
use crate::domain::report::LineState;
use crate::domain::time::{MonoTime, WallTime};
use arc_swap::ArcSwapOption;
use std::path::PathBuf;
use std::sync::Arc;

/// What the HTTP side reads. It is created once, when the gateway starts.
#[derive(Debug)]
pub struct HttpState {
    /// The gateway's name.
    pub gateway: String,
    /// Lines and drives.
    pub shared: CurrentPlant,
    /// Counts of the Modbus TCP side.
    pub modbus: Arc<ModbusTotals>,
    /// State and counts of the MQTT side; `None` if no broker is configured.
    pub mqtt: ArcSwapOption<MqttTotals>,
    /// State and counts of the Sparkplug side; `None` if it is not configured.
    pub sparkplug: ArcSwapOption<SparkplugTotals>,
    /// The journal; `None` without a data directory.
    pub journal: Option<Arc<Journal>>,
    /// The kept trends; `None` without a data directory.
    pub trends: Option<Arc<KeptTrends>>,
    /// The configuration file; `None` if there is none.
    pub configuration: Option<PathBuf>,
    /// Whether the program's own commands reach the gateway; `None` without a data directory.
    pub socket: Option<Arc<CommandReachability>>,
    /// When the gateway started.
    pub started: MonoTime,
    /// When the gateway started, on the wall clock.
    pub started_at: WallTime,
}

impl HttpState {
    /// Whether all lines are open and the broker is connected, if there is one.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        let lines_are_up = self
            .shared
            .load()
            .lines
            .iter()
            .all(|line| line.report().state == LineState::Up);
        lines_are_up
            && self
                .mqtt
                .load()
                .as_ref()
                .is_none_or(|mqtt| mqtt.is_connected())
    }
}
