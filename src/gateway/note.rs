//! What people should read: alarms and other things that no answer carries.

use crate::domain::command::Owner;
use crate::domain::control::FailSafe;
use crate::domain::report::LineFault;
use crate::domain::suspicion::Suspicion;
use crate::drive::watchdog::WatchdogState;

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
    /// The commander of an earlier life of the gateway did not come back, or the gateway ended again before its time was
    /// over: the declared action runs.
    #[error("the gateway was started anew and its commander before that ({owner}) is not back: the declared action is {}", .action.word())]
    Orphaned {
        /// Who held control.
        owner: Owner,
        /// What is done.
        action: FailSafe,
    },
    /// A run order went on without its row.
    #[error("ALARM: the journal is slow; RUN goes on without its row")]
    JournalSlow,
    /// A stop shows no effect.
    #[error("ALARM: a stop shows no effect; it is repeated")]
    NotEffective,
    /// The drive refuses to be stopped.
    #[error("ALARM: the drive refuses to be stopped; it is not started before a stop was effective")]
    StopRefused,
    /// A reset of an earlier life of the gateway, or one that had no answer, may not have been taken back.
    #[error("the word that resets may stand in the drive's run command: it is taken back")]
    ResetTakenBack,
    /// Somebody stops the drive again and again although others start it.
    #[error(
        "{by} stops the drive again and again although it was started elsewhere: a controller that is not in charge writes nothing"
    )]
    StoppedAgain {
        /// Who.
        by: Owner,
    },
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
    /// Control was taken over.
    #[error("control was taken over by {by} from {}", holder(.from))]
    Taken {
        /// Who held it; nothing: nobody.
        from: Option<Owner>,
        /// Who holds it now.
        by: Owner,
    },
    /// The drive's own watchdog is set to something else than was known.
    #[error("{}", watchdog(*.0))]
    Watchdog(WatchdogState),
    /// A declared stop without effect is left to the drive's own watchdog.
    #[error(
        "ALARM: the declared stop shows no effect; nothing more is sent, so that the drive's own watchdog stops it"
    )]
    LeftToWatchdog,
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

fn holder(owner: &Option<Owner>) -> String {
    owner.map_or("nobody".to_owned(), |owner| owner.to_string())
}

const fn watchdog(state: WatchdogState) -> &'static str {
    match state {
        WatchdogState::Unknown => "the drive's own watchdog is not known",
        WatchdogState::Off => "ALARM: the drive's own watchdog is off: without the gateway the motor would run on",
        WatchdogState::KeepsRunning => "ALARM: the drive's own watchdog is set to let the motor run on",
        WatchdogState::TooShort => {
            "ALARM: the drive's own watchdog is no longer than twice the longest gap between two frames: it may stop the \
             motor although all is well"
        }
        WatchdogState::TooLong => "ALARM: the drive's own watchdog takes longer than a commander may be silent",
        WatchdogState::InOrder => "the drive's own watchdog is on and in order",
    }
}
