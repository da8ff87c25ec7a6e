//! Log messages: alarms and other events that no answer carries.

use crate::domain::address::Address;
use crate::domain::command::Owner;
use crate::domain::control::FailSafe;
use crate::domain::fail_safe::{FailSafeRun, FailSafeStage};
use crate::domain::frequency::Hertz;
use crate::domain::report::LineFault;
use crate::domain::suspicion::LineSuspicion;
pub use crate::domain::traffic::HeardFrame;
use crate::drive::plan::RefusedRegister;
use crate::drive::sight::LastSeen;
use crate::drive::status::UndocumentedState;
use crate::drive::watchdog::WatchdogState;
use crate::line::standby::StandbyChange;
use std::time::Duration;

/// An event of a drive that no request caused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DriveNote {
    /// Contact with the controlling client was lost; the declared action runs.
    #[error("commander lost ({owner}): the declared action is {}", .action.keyword())]
    CommanderLost {
        /// The lost owner.
        owner: Owner,
        /// The declared action.
        action: FailSafe,
    },
    /// The drive could not be reached for so long that its client lost control of it, although the client is there.
    #[error("the drive is out of reach, and {owner} no longer controls it: the declared action is \
             {}", .action.keyword())]
    OutOfReach {
        /// The client.
        owner: Owner,
        /// The declared action.
        action: FailSafe,
    },
    /// A declared action has come further.
    #[error("the declared {} {}", .0.action.keyword(), came(.0.stage))]
    FailSafeCame(FailSafeRun),
    /// The owner from before a restart did not return, or the gateway exited again before the owner's time was over: the
    /// declared action runs.
    #[error("the gateway was restarted and its previous commander ({owner}) did not return: the declared action is {}", .action.keyword())]
    Orphaned {
        /// The previous owner.
        owner: Owner,
        /// The declared action.
        action: FailSafe,
    },
    /// The drive is out of sight and was not seen at standstill.
    #[error("ALARM: the drive is out of sight, {}: it may still run, go to the drive", last_seen(.0))]
    MayStillRun(Option<LastSeen>),
    /// A person confirmed that the motor of a drive that is out of sight stands.
    #[error("{by} confirmed that the motor stands still")]
    StandstillConfirmed {
        /// The person.
        by: Owner,
    },
    /// A run order was executed before its journal row was durable.
    #[error("ALARM: the journal is slow; RUN proceeds before it is recorded")]
    JournalSlow,
    /// A stop has no effect.
    #[error("ALARM: a stop has no effect; repeating it")]
    NotEffective,
    /// A stop could not be sent in time.
    #[error(
        "ALARM: a stop could not be sent yet; it is sent as soon as the drive can be reached and the line allows it"
    )]
    StopNotSent,
    /// The drive refuses every form of the stop.
    #[error("ALARM: the drive refuses to stop; it will not be started until a stop takes effect")]
    StopRefused,
    /// A reset from before a restart, or an unanswered one, may not have been cleared.
    #[error("the reset word may remain in the drive's run command: clearing it")]
    ResetTakenBack,
    /// The drive has not followed a start in several words.
    #[error("the drive has not followed the start: withdrawing it")]
    StartTakenBack,
    /// A client repeatedly stops the drive although others start it.
    #[error(
        "{by} repeatedly stops the drive although it was started elsewhere: a controller that is not in charge must not write"
    )]
    StoppedAgain {
        /// The client that stops it.
        by: Owner,
    },
    /// A status register holds a word that no document names.
    #[error(
        "undocumented_state: {} holds {}, which no document of this model names: it proves nothing, and the run state \
         follows the output frequency", .0.address, .0.word
    )]
    Undocumented(UndocumentedState),
    /// A polled register is refused.
    #[error(
        "register_refused: the drive refuses to show {} with exception {:02X}; it is left out, and asked again once an hour \
         and after an outage", .0.address, .0.code
    )]
    RegisterRefused(RefusedRegister),
    /// A stop took effect after the alarm.
    #[error("the stop has taken effect")]
    EffectiveAtLast,
    /// A pending stop was dropped because the drive stayed offline.
    #[error("ALARM: the drive stayed offline; a pending stop was dropped")]
    StopDropped,
    /// The drive's own setpoint is outside the limits.
    #[error("ALARM: the drive's setpoint is outside the limits of its control section")]
    SetpointOutside,
    /// The drive does not show what every drive of its model shows.
    #[error(
        "ALARM: register {register} holds {held}, which no drive of its model shows: no reading of \
         it is shown as good, and it takes no orders. Check that it is this model, and that its \
         addresses are those of the model"
    )]
    Implausible {
        /// The register.
        register: Address,
        /// The word that the register holds.
        held: u16,
    },
    /// The drive has stopped following its order to run.
    #[error(
        "the drive no longer follows its order to run: it was stopped elsewhere (stopped_elsewhere)"
    )]
    StoppedElsewhere,
    /// The output is not what was ordered.
    #[error(
        "ALARM: output_outside_limits: the output is {output} Hz, and {wanted} Hz was ordered: only stops and lower setpoints are \
         accepted{}", likely_cause(.is_scale_typed)
    )]
    OutputOutside {
        /// The output.
        output: Hertz,
        /// The setpoint, or the nearest limit.
        wanted: Hertz,
        /// The configuration states the full scale of the drive's frequencies.
        is_scale_typed: bool,
    },
    /// The output is again what was ordered, or the motor stands.
    #[error("the output is again what was ordered, or the motor stands")]
    OutputRight,
    /// Too many exchanges with the drive fail.
    #[error(
        "too many exchanges with the drive fail: only stops and lower frequencies are accepted"
    )]
    Suspended,
    /// Its exchanges are good again.
    #[error("the exchanges with the drive are good again: run orders are accepted")]
    Resumed,
    /// Control was taken over.
    #[error("control taken over by {by} from {}", holder(.from))]
    Taken {
        /// The previous owner, if any.
        from: Option<Owner>,
        /// The new owner.
        by: Owner,
    },
    /// The settings of the drive's own watchdog have changed.
    #[error("{}", watchdog(*.0))]
    Watchdog(WatchdogState),
    /// A declared stop without effect is left to the drive's own watchdog.
    #[error(
        "ALARM: the declared stop has no effect; sending nothing more, so that the drive's own watchdog stops the motor"
    )]
    LeftToWatchdog,
    /// The gateway shuts down and the declared action runs.
    #[error("the gateway is shutting down: the declared action is {}", .0.keyword())]
    ShuttingDown(FailSafe),
    /// Another gateway of the line is lost while the drive was ordered to run; the declared action runs.
    #[error("the other gateway of the line is lost: the declared action is {}", .0.keyword())]
    GatewayLost(FailSafe),
    /// The line was handed over, or came back because no other gateway took it: the drive goes on for a while.
    #[error(
        "the other gateway of the line is lost: the drive keeps running, and its client has \
         `lost_after` to come back"
    )]
    Adopted,
    /// The line was handed over, or came back because no other gateway took it, and no gateway takes the order up: its
    /// direction is not known, or a stop from before had no effect yet.
    #[error(
        "the line was handed over, and no gateway takes up the order of the drive: the declared \
         action is {}",
        .0.keyword()
    )]
    LineGiven(FailSafe),
    /// The line was given up on purpose, and the drive goes on until its client has had the time of a lost one.
    #[error(
        "the line was handed over: the drive keeps running, and its client has `lost_after` to \
         connect here"
    )]
    GoesOn,
    /// A stop is sent while another gateway or master has the line: one frame of two masters.
    #[error("a stop is sent between the frames of the gateway or master that has the line")]
    StopBetween,
    /// The line was to be handed over, and this gateway does not take it.
    #[error(
        "the line is not taken over: the drive runs, and its direction of rotation is not known here; stop it and start it \
         again through the active gateway, then hand over"
    )]
    HandOverRefused,
    /// Another gateway or master of the line sent the drive a stop.
    #[error("stopped by another gateway or master of the line: RUN needs a stop and a new order")]
    StoppedByAnother,
    /// The drive leaves the configuration, or its line is restarted, while it is in use.
    #[error("the drive is being removed or its line restarted: stopping it first")]
    Leaving,
}

/// An event of a line while its port is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineNote {
    /// The line has become unusable.
    #[error("line down: {0}")]
    Down(LineFault),
    /// The line is usable again.
    #[error("line up")]
    Up,
    /// Too many exchanges fail.
    #[error(
        "ALARM: {bad_per_cent} % of the line's exchanges fail: only stops and lower frequencies are accepted"
    )]
    Suspended {
        /// Failed exchanges among the last 100.
        bad_per_cent: u8,
    },
    /// The exchanges are good again.
    #[error("the line's exchanges are good again: run orders are accepted")]
    Resumed,
    /// This gateway sends on the line from now on.
    #[error("active on the line: {}", silence(.silent_for))]
    TakenOver {
        /// How long nothing of another gateway or master at work was heard; `None`: never since the port was opened.
        silent_for: Option<Duration>,
    },
    /// This gateway sends on the line from now on, because the other one handed it over.
    #[error("active on the line: the other gateway handed it over")]
    HandedOver,
    /// Another gateway of the line is to send.
    #[error("listening on the line: {}", given_up(.0))]
    GivenUp(StandbyChange),
    /// Another master was heard while this gateway was active.
    #[error("ALARM: listening on the line: rival_on_line, another {} sent {frame}; {}", sender(.is_gateway), cost(.is_gateway))]
    Rival {
        /// What it sent.
        frame: HeardFrame,
        /// What was heard was a signal between gateways. What another gateway asks a drive looks like what any master
        /// asks.
        is_gateway: bool,
    },
    /// The suspected cause of the failures; `None`: no longer any.
    #[error("{}", suspected(.0))]
    Suspects(Option<LineSuspicion>),
}

fn silence(silent_for: &Option<Duration>) -> String {
    match silent_for {
        Some(time) => {
            format!(
                "no other gateway or master was heard for {:.1} s",
                time.as_secs_f64()
            )
        }
        None => "no other gateway or master was heard since the port was opened".to_owned(),
    }
}

const fn sender(is_gateway: &bool) -> &'static str {
    if *is_gateway { "gateway" } else { "master" }
}

const fn cost(is_gateway: &bool) -> &'static str {
    if *is_gateway {
        "it has the line"
    } else {
        "while it is heard nothing is polled and no RUN is accepted; stops are sent between its frames"
    }
}

const fn given_up(change: &StandbyChange) -> &'static str {
    match change {
        StandbyChange::Stalled => {
            "nothing was sent for too long, so another gateway may have taken it over"
        }
        StandbyChange::Rival => "another master was heard",
        StandbyChange::Collided => "it was taken over by another gateway at the same moment",
        StandbyChange::Yielded => "it was handed over on request",
        StandbyChange::Deaf => {
            "line_deaf, no drive was heard for some seconds: the receiver may be dead, or speed or \
             polarity wrong"
        }
        StandbyChange::TakenOver | StandbyChange::HandedOver => "it was taken over",
    }
}

fn suspected(suspicion: &Option<LineSuspicion>) -> String {
    suspicion.map_or("suspicion cleared".to_owned(), |suspicion| {
        suspicion.to_string()
    })
}

const fn likely_cause(is_scale_typed: &bool) -> &'static str {
    if *is_scale_typed {
        "; the likely cause is `full_scale_hz`, which was typed by hand: compare it with the drive's highest frequency"
    } else {
        ""
    }
}

fn holder(owner: &Option<Owner>) -> String {
    owner.map_or("no owner".to_owned(), |owner| owner.to_string())
}

const fn came(stage: FailSafeStage) -> &'static str {
    match stage {
        FailSafeStage::Due => "is due",
        FailSafeStage::Sent => "was sent",
        FailSafeStage::Effective => "has taken effect",
        FailSafeStage::NotNeeded => {
            "was not needed: the drive was found at standstill before it was sent"
        }
        FailSafeStage::GivenUp => "was given up",
    }
}

fn last_seen(seen: &Option<LastSeen>) -> String {
    match seen {
        None => "and nothing was seen of it".to_owned(),
        Some(LastSeen {
            run_state,
            output: None,
            ..
        }) => format!("last seen {}", run_state.keyword()),
        Some(LastSeen {
            run_state,
            output: Some(hertz),
            ..
        }) => {
            format!("last seen {} at {hertz} Hz", run_state.keyword())
        }
    }
}

const fn watchdog(state: WatchdogState) -> &'static str {
    match state {
        WatchdogState::Unknown => "the state of the drive's own watchdog is unknown",
        WatchdogState::Off => {
            "ALARM: the drive's own watchdog is off: without the gateway the motor would keep running"
        }
        WatchdogState::KeepsRunning => {
            "ALARM: the drive's own watchdog is set to keep the motor running"
        }
        WatchdogState::TooShort => {
            "ALARM: the drive's own watchdog is no longer than twice the longest gap between two frames: it may stop the \
             motor without cause"
        }
        WatchdogState::TooLong => {
            "ALARM: the drive's own watchdog takes longer than the time allowed for a lost commander"
        }
        WatchdogState::InOrder => "the drive's own watchdog is on and suitable",
    }
}
