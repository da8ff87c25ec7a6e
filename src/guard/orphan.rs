//! Control held when the gateway exited: its owner has time to resume it, after which the declared action runs.

use super::approved::StopOrder;
use super::state::{DriveGuard, Lease};
use crate::domain::command::{Direction, RunIntent};
use crate::domain::time::MonoTime;
use crate::journal::{FailSafeCause, RememberedLease};
use std::time::Duration;

/// The state of a lease from before a restart of the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OrphanLease {
    /// The drive has not been seen yet. If the lease was already orphaned, its owner's time is over.
    Unseen { was_orphaned: bool },
    /// The drive has not been seen yet, and this gateway listens to the line: another one commands the drive. If the
    /// lease was already orphaned, its owner's time is over.
    Listening { was_orphaned: bool },
    /// The owner sent a heartbeat before the drive was seen.
    TakenUp,
    /// The drive was found running, and the owner has not sent a heartbeat yet.
    Running(FailSafeCause),
}

impl OrphanLease {
    /// Its owner sent a heartbeat.
    pub const fn taken_up(self) -> Option<Self> {
        match self {
            Self::Unseen { .. } | Self::Listening { .. } | Self::TakenUp => Some(Self::TakenUp),
            Self::Running(_) => None,
        }
    }

    /// Why the declared action runs when the lease ends.
    pub const fn cause(self) -> FailSafeCause {
        match self {
            Self::Running(cause) => cause,
            Self::Unseen { .. } | Self::Listening { .. } | Self::TakenUp => {
                FailSafeCause::CommanderLost
            }
        }
    }
}

impl DriveGuard {
    /// Restores control held when the gateway exited. No other client gets it before the drive is seen.
    pub fn remember_lease(&mut self, lease: RememberedLease) {
        if self.control.is_some() {
            let orphan = Some(OrphanLease::Unseen {
                was_orphaned: lease.was_orphaned,
            });
            self.lease = Some(Lease {
                owner: lease.owner,
                until: MonoTime::NEVER,
                orphan,
                refused_at: None,
            });
        }
    }

    /// Restores control held when the gateway exited, on a line where another gateway may be active: it says so within
    /// `signals_within`, and the lease ends then. Where none is, it lasts until the owner was awaited for its time.
    pub fn remember_lease_listening(
        &mut self,
        lease: RememberedLease,
        now: MonoTime,
        signals_within: Duration,
    ) {
        if let Some(control) = &self.control {
            let orphan = Some(OrphanLease::Listening {
                was_orphaned: lease.was_orphaned,
            });
            let until = now + control.lost_after.max(signals_within);
            self.lease = Some(Lease {
                owner: lease.owner,
                until,
                orphan,
                refused_at: None,
            });
        }
    }

    /// No other gateway was active since the start: the time of the owner counts from there.
    pub fn awaited_since_start(&mut self) {
        let (Some(lease), Some(control)) = (&mut self.lease, &self.control) else {
            return;
        };
        if let Some(OrphanLease::Listening { was_orphaned }) = lease.orphan {
            lease.until = if was_orphaned {
                MonoTime::NEVER
            } else {
                self.found_at + control.lost_after
            };
            lease.orphan = Some(OrphanLease::Unseen { was_orphaned });
        }
    }

    /// Restores a stop that was pending when the gateway exited. `None` if it can no longer be ordered.
    pub fn remember_stop(&mut self, coast: bool, now: MonoTime) -> Option<StopOrder> {
        self.control.as_ref()?;
        let order = self.stop_order(coast)?;
        self.accept_stop(None, coast, now);
        Some(order)
    }

    /// Whether the owner of the lease is awaited since before a restart of the gateway.
    #[must_use]
    pub fn is_orphaned(&self) -> bool {
        let is_awaited = |it| {
            matches!(
                it,
                OrphanLease::Unseen { .. }
                    | OrphanLease::Listening { .. }
                    | OrphanLease::Running(_)
            )
        };
        self.lease
            .and_then(|lease| lease.orphan)
            .is_some_and(is_awaited)
    }

    /// The drive shows at `now` that its motor turns, and perhaps in which `direction`. For an orphaned lease, the owner's
    /// time begins here.
    pub fn found_running(&mut self, direction: Option<Direction>, now: MonoTime) {
        if !matches!(self.intent, RunIntent::Run(_)) {
            self.turned = direction.or(self.turned);
        }
        let (Some(lease), Some(control)) = (&mut self.lease, &self.control) else {
            return;
        };
        match lease.orphan {
            Some(OrphanLease::Unseen { was_orphaned: true }) => {
                lease.orphan = Some(OrphanLease::Running(FailSafeCause::CrashLoop));
                lease.until = now;
            }
            Some(OrphanLease::Unseen {
                was_orphaned: false,
            }) => {
                lease.orphan = Some(OrphanLease::Running(FailSafeCause::Orphaned));
                lease.until = lease.until.min(now + control.lost_after);
            }
            Some(OrphanLease::TakenUp) => lease.orphan = None,
            Some(OrphanLease::Listening { .. } | OrphanLease::Running(_)) | None => {}
        }
    }
}
