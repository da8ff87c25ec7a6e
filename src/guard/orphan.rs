//! Control that was held when the gateway ended: its owner has time to take it up again, and then the declared action runs.

use super::approved::StopOrder;
use super::state::{DriveGuard, Lease};
use crate::domain::time::MonoTime;
use crate::journal::{Cause, RememberedLease};

/// A lease of an earlier life of the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Orphan {
    /// The drive was not seen yet. If the lease was orphaned before, its owner has had its time.
    Unseen { was_orphaned: bool },
    /// The owner gave a sign of life before the drive was seen.
    TakenUp,
    /// The drive was found running, and the owner gave no sign of life yet.
    Running(Cause),
}

impl Orphan {
    /// Its owner gave a sign of life.
    pub const fn taken_up(self) -> Option<Self> {
        match self {
            Self::Unseen { .. } | Self::TakenUp => Some(Self::TakenUp),
            Self::Running(_) => None,
        }
    }

    /// Why the declared action runs at its end.
    pub const fn cause(self) -> Cause {
        match self {
            Self::Running(cause) => cause,
            Self::Unseen { .. } | Self::TakenUp => Cause::CommanderLost,
        }
    }
}

impl DriveGuard {
    /// Control was held when the gateway ended. Nobody else gets it before the drive is seen.
    pub fn remember_lease(&mut self, lease: RememberedLease) {
        if self.control.is_some() {
            let orphan = Some(Orphan::Unseen { was_orphaned: lease.was_orphaned });
            self.lease = Some(Lease { owner: lease.owner, until: MonoTime::NEVER, orphan });
        }
    }

    /// A stop was pending when the gateway ended: it is so again. Nothing where it cannot be ordered any more.
    pub fn remember_stop(&mut self, coast: bool, now: MonoTime) -> Option<StopOrder> {
        self.control.as_ref()?;
        let order = self.stop_order(coast)?;
        self.accept_stop(None, coast, now);
        Some(order)
    }

    /// Whether the owner of the lease is awaited from an earlier life of the gateway.
    #[must_use]
    pub fn is_orphaned(&self) -> bool {
        self.lease.is_some_and(|lease| matches!(lease.orphan, Some(Orphan::Unseen { .. } | Orphan::Running(_))))
    }

    /// The drive shows at `now` that its motor turns. Under an orphaned lease that is when the time of its owner begins.
    pub fn found_running(&mut self, now: MonoTime) {
        let (Some(lease), Some(control)) = (&mut self.lease, &self.control) else { return };
        match lease.orphan {
            Some(Orphan::Unseen { was_orphaned: true }) => {
                lease.orphan = Some(Orphan::Running(Cause::CrashLoop));
                lease.until = now;
            }
            Some(Orphan::Unseen { was_orphaned: false }) => {
                lease.orphan = Some(Orphan::Running(Cause::Orphaned));
                lease.until = now + control.lost_after;
            }
            Some(Orphan::TakenUp) => lease.orphan = None,
            Some(Orphan::Running(_)) | None => {}
        }
    }
}
