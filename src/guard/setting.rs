//! An accepted setpoint, a reading of the drive's own setting, and whether the one is in force by the other.

use crate::domain::command::{Outcome, Owner, Reason, Report};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;

/// The last accepted setpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Setpoint {
    pub value: Hertz,
    pub by: Owner,
    pub acknowledged: bool,
    /// When it was acknowledged last.
    pub acknowledged_at: MonoTime,
    /// The drive has shown it since it was accepted.
    pub is_shown: bool,
    /// It was sent before, acknowledged and never shown.
    pub is_repeated: bool,
}

impl Setpoint {
    pub const fn accepted(by: Owner, value: Hertz) -> Self {
        let acknowledged_at = MonoTime::ZERO;
        Self {
            value,
            by,
            acknowledged: false,
            acknowledged_at,
            is_shown: false,
            is_repeated: false,
        }
    }
}

/// The last reading of the setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SettingReading {
    /// Its words; the second is 0 for a setting of one word.
    pub words: [u16; 2],
    /// When it arrived.
    pub at: MonoTime,
}

impl SettingReading {
    pub const fn keeps_out(self) -> InForce {
        InForce::KeptOut {
            held: self.words[0],
        }
    }
}

/// Whether a setpoint that equals the accepted one is in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum InForce {
    /// As far as the drive shows: nothing is sent.
    Yes,
    /// The drive holds another value: it is sent.
    No,
    /// The drive has acknowledged it and holds another value. It is not sent again yet.
    KeptOut {
        /// The first word of what it holds.
        held: u16,
    },
}

impl InForce {
    /// The answer to a client whose order would change nothing.
    pub fn report(self) -> Result<(), Report> {
        match self {
            Self::Yes | Self::No => Ok(()),
            Self::KeptOut { held } => Err(Report {
                held: Some(held),
                ..Report::new(Outcome::Failed, Reason::NotReadBack)
            }),
        }
    }
}
