//! What a model does not say of its drives, so that it has to be chosen for each simulated one.

use std::ops::RangeInclusive;
use std::time::Duration;

/// What a drive does with a request that it cannot serve: an unknown register, function or number of words.
/// Where no document says it, both must be tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum BadRequest {
    /// It does not answer.
    #[default]
    Silence,
    /// It answers with an exception.
    Exception,
}

/// What a model does not say of its drives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveOptions {
    /// What the drive does with a request that it cannot serve.
    pub bad_request: BadRequest,
    /// Value of the source registers under which the drive obeys the line.
    pub communication: u16,
    /// Value of both source registers in a new drive.
    pub sources_at_start: u16,
    /// Frequency, in whole hertz and above 0, that the ramp times refer to and that no setpoint may exceed.
    pub max_frequency_hz: u16,
    /// Acceleration time of a new drive.
    pub acceleration: Duration,
    /// Deceleration time of a new drive.
    pub deceleration: Duration,
    /// Rated output current x10 in A, for trip records.
    pub rated_current_x10: u16,
    /// Addresses that can be read on top of the model's registers and whose every word is the low half of
    /// the exchange number, see [`super::SimBus::exchange`]. They hide registers of the model.
    pub proof_words: Option<RangeInclusive<u16>>,
}

impl Default for DriveOptions {
    /// A drive ready to be commanded: sources at communication (3), 60 Hz, 10 s ramps, 11 A, silent on bad requests.
    fn default() -> Self {
        Self {
            bad_request: BadRequest::Silence,
            communication: 3,
            sources_at_start: 3,
            max_frequency_hz: 60,
            acceleration: Duration::from_secs(10),
            deceleration: Duration::from_secs(10),
            rated_current_x10: 110,
            proof_words: None,
        }
    }
}
