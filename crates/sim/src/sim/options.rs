//! Properties that a model does not state, and that must be chosen for each simulated drive.

use crate::domain::command::Direction;
use std::ops::RangeInclusive;
use std::time::Duration;

/// The reaction to a request that a drive cannot serve: an unknown register, function or number of words.
/// If it is undocumented, both must be tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum BadRequest {
    /// The drive answers with an exception if the model lists any, else it does not answer.
    #[default]
    AsDocumented,
    /// The drive does not answer.
    Silence,
    /// The drive answers with an exception.
    Exception,
}

/// The stops that a drive refuses, like one that lacks the function or the register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RefusedStops {
    /// None.
    #[default]
    None,
    /// Stops by function 06.
    Single,
    /// Stops by any function.
    All,
}

/// Properties that a model does not state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveOptions {
    /// The reaction to a request that it cannot serve.
    pub bad_request: BadRequest,
    /// Value of a source register for which the drive obeys the line, if the model's setup does not name one.
    pub communication: u16,
    /// Value of both source registers in a new drive. `None`: the one for which it obeys the line.
    pub sources_at_start: Option<u16>,
    /// Frequency, in whole hertz and above 0, that the ramp times refer to and that no setpoint may exceed.
    pub max_frequency_hz: u16,
    /// Acceleration time of a new drive.
    pub acceleration: Duration,
    /// Deceleration time of a new drive.
    pub deceleration: Duration,
    /// Rated output current x10 in A.
    pub rated_current_x10: u16,
    /// Rated output voltage in V.
    pub rated_voltage_v: u16,
    /// DC link voltage at standstill in V.
    pub dc_link_v: u16,
    /// Run hours of a new drive.
    pub run_hours: u16,
    /// The order of panel and terminals while they have control: a closed terminal, or a pressed key.
    pub panel_runs: Option<Direction>,
    /// Frequency in whole hertz if it does not come from the bus. `None`: the setpoint stays.
    pub panel_frequency_hz: Option<u16>,
    /// Whether a trip persists across a power cycle.
    pub trip_outlasts_power: bool,
    /// Highest frequency, in whole hertz, that it takes of a setpoint: a higher one is acknowledged, and this one kept.
    pub clamps_at_hz: Option<u16>,
    /// Stops that it refuses.
    pub refused_stops: RefusedStops,
    /// Addresses that can be read on top of the model's registers and whose every word is the low half of
    /// the exchange number, see [`super::SimBus::exchange`]. They hide registers of the model.
    pub proof_words: Option<RangeInclusive<u16>>,
}

impl Default for DriveOptions {
    /// A drive ready to be commanded: sources at communication, 60 Hz, 10 s ramps, 11 A, 400 V, no panel input.
    fn default() -> Self {
        Self {
            bad_request: BadRequest::AsDocumented,
            communication: 3,
            sources_at_start: None,
            max_frequency_hz: 60,
            acceleration: Duration::from_secs(10),
            deceleration: Duration::from_secs(10),
            rated_current_x10: 110,
            rated_voltage_v: 400,
            dc_link_v: 540,
            run_hours: 0,
            panel_runs: None,
            panel_frequency_hz: None,
            trip_outlasts_power: false,
            clamps_at_hz: None,
            refused_stops: RefusedStops::None,
            proof_words: None,
        }
    }
}
