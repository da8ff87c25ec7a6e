//! What people should read: alarms and other things that no answer carries.

use crate::domain::command::Owner;
use crate::domain::control::FailSafe;

/// Something that happened to a drive and that nobody asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Note {
    /// The commander was lost and the declared action runs.
    #[error("commander lost ({owner}): the declared action is {}", .action.word())]
    CommanderLost {
        /// Who was lost.
        owner: Owner,
        /// What is done.
        action: FailSafe,
    },
    /// A stop shows no effect.
    #[error("ALARM: a stop shows no effect; it is repeated")]
    NotEffective,
    /// A stop became effective after the alarm.
    #[error("the stop is effective now")]
    EffectiveAtLast,
    /// A pending stop was given up because the drive stayed away.
    #[error("ALARM: the drive stayed away; a pending stop was dropped")]
    StopDropped,
    /// The drive's own setpoint is outside the limits.
    #[error("ALARM: the drive's setpoint is outside the limits of its control section")]
    SetpointOutside,
    /// The gateway ends and the declared action runs.
    #[error("the gateway ends: the declared action is {}", .0.word())]
    ShuttingDown(FailSafe),
}
