//! A declared action that is carried out without a command: why, and how far it has come.

use super::control::FailSafe;
use super::time::MonoTime;

/// Why a declared action runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FailSafeCause {
    /// The client stopped responding.
    CommanderLost,
    /// The drive could not be reached while its client was there: its renewals could not be accepted.
    OutOfReach,
    /// The gateway is stopped on purpose.
    Shutdown,
    /// The lease of an earlier run of the gateway was not renewed.
    Orphaned,
    /// The gateway exited again before the lease of an earlier run could expire.
    CrashLoop,
    /// The drive is removed from the configuration.
    Removed,
    /// Another gateway of the line was lost while the drive was ordered to run.
    GatewayLost,
    /// The output was outside the limits or far from the setpoint.
    OutputOutside,
}

impl FailSafeCause {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::CommanderLost,
        Self::OutOfReach,
        Self::Shutdown,
        Self::Orphaned,
        Self::CrashLoop,
        Self::Removed,
        Self::GatewayLost,
        Self::OutputOutside,
    ];

    /// The word used in the journal.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::CommanderLost => "commander_lost",
            Self::OutOfReach => "out_of_reach",
            Self::Shutdown => "shutdown",
            Self::Orphaned => "orphaned",
            Self::CrashLoop => "crash_loop",
            Self::Removed => "removed",
            Self::GatewayLost => "gateway_lost",
            Self::OutputOutside => "output_outside_limits",
        }
    }

    /// Whether the client is gone, as far as known.
    #[must_use]
    pub const fn is_lost_commander(self) -> bool {
        matches!(self, Self::CommanderLost | Self::Orphaned | Self::CrashLoop)
    }
}

/// How far a declared action has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FailSafeStage {
    /// Nothing was sent for it yet.
    Due,
    /// Its frame was on the wire.
    Sent,
    /// The drive showed its effect. A declared `hold` is there at once: it leaves the motor as it is.
    Effective,
    /// The drive was found at standstill before anything was sent.
    NotNeeded,
    /// The action is no longer sent: the drive stayed out of reach for too long, or another gateway has the line.
    GivenUp,
}

impl FailSafeStage {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Due,
        Self::Sent,
        Self::Effective,
        Self::NotNeeded,
        Self::GivenUp,
    ];

    /// The word in documents.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Due => "due",
            Self::Sent => "sent",
            Self::Effective => "effective",
            Self::NotNeeded => "not_needed",
            Self::GivenUp => "given_up",
        }
    }

    const fn is_over(self) -> bool {
        matches!(self, Self::Effective | Self::NotNeeded | Self::GivenUp)
    }
}

/// A declared action since it fell due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FailSafeRun {
    /// What is declared.
    pub action: FailSafe,
    /// Why it runs.
    pub cause: FailSafeCause,
    /// How far it has come.
    pub stage: FailSafeStage,
    /// When it fell due.
    pub at: MonoTime,
}

impl FailSafeRun {
    /// The `action` falls due at `at`.
    #[must_use]
    pub fn due(action: FailSafe, cause: FailSafeCause, at: MonoTime) -> Self {
        let stage = if action == FailSafe::Hold {
            FailSafeStage::Effective
        } else {
            FailSafeStage::Due
        };
        Self {
            action,
            cause,
            stage,
            at,
        }
    }

    /// Its frame was on the wire. Returns whether that is new.
    pub fn was_sent(&mut self) -> bool {
        self.reach(FailSafeStage::Sent, self.stage == FailSafeStage::Due)
    }

    /// The drive showed its effect, or was found at standstill. Returns whether that is new.
    pub fn was_effective(&mut self) -> bool {
        let was_sent = self.stage == FailSafeStage::Sent;
        let stage = if was_sent {
            FailSafeStage::Effective
        } else {
            FailSafeStage::NotNeeded
        };
        self.reach(stage, !self.stage.is_over())
    }

    /// The action is no longer sent. Returns whether that is new.
    pub fn was_given_up(&mut self) -> bool {
        self.reach(FailSafeStage::GivenUp, !self.stage.is_over())
    }

    const fn reach(&mut self, stage: FailSafeStage, is_next: bool) -> bool {
        if is_next {
            self.stage = stage;
        }
        is_next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_called_by_the_stage_that_it_has_reached() {
        let due = || FailSafeRun::due(FailSafe::Stop, FailSafeCause::CommanderLost, MonoTime::ZERO);
        let mut run = due();
        assert_eq!(run.stage, FailSafeStage::Due);
        assert!(run.was_sent() && !run.was_sent());
        assert_eq!(run.stage, FailSafeStage::Sent);
        assert!(run.was_effective() && !run.was_given_up() && !run.was_effective());
        assert_eq!(run.stage, FailSafeStage::Effective);
        let mut never_sent = due();
        assert!(never_sent.was_effective());
        assert_eq!(
            never_sent.stage,
            FailSafeStage::NotNeeded,
            "nothing is carried out that was not sent"
        );
        let mut given_up = due();
        assert!(given_up.was_given_up() && !given_up.was_sent());
        assert_eq!(
            FailSafeRun::due(FailSafe::Hold, FailSafeCause::CommanderLost, MonoTime::ZERO).stage,
            FailSafeStage::Effective
        );
    }
}
