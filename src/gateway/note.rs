//! What people should read: alarms and other things that no answer carries.

use crate::domain::command::Owner;
use crate::domain::control::FailSafe;
use crate::domain::report::LineFault;
use crate::domain::suspicion::Suspicion;

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
    /// Too many exchanges with the drive fail.
    #[error("too many exchanges with the drive fail: only stops and lower frequencies are taken")]
    Suspended,
    /// Its exchanges are good again.
    #[error("the exchanges with the drive are good again: run orders are taken")]
    Resumed,
    /// The gateway ends and the declared action runs.
    #[error("the gateway ends: the declared action is {}", .0.word())]
    ShuttingDown(FailSafe),
    /// The drive leaves the configuration while it is in use.
    #[error("the drive leaves the configuration, or its line starts anew: it is stopped first")]
    Leaving,
}

/// Something that happened to a line while its port is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineNote {
    /// Nothing can be asked over it any more.
    #[error("line down: {0}")]
    Down(LineFault),
    /// It can be used again.
    #[error("line up again")]
    Up,
    /// Too many exchanges fail.
    #[error("ALARM: {bad_per_cent} % of the line's exchanges fail: only stops and lower frequencies are taken")]
    Suspended {
        /// Bad ones of the last 100.
        bad_per_cent: u8,
    },
    /// The exchanges are good again.
    #[error("the line's exchanges are good again: run orders are taken")]
    Resumed,
    /// What is probably wrong; nothing any more.
    #[error("{}", suspected(.0))]
    Suspects(Option<Suspicion>),
}

fn suspected(suspicion: &Option<Suspicion>) -> String {
    suspicion.map_or("what was suspected is over".to_owned(), |suspicion| suspicion.to_string())
}
