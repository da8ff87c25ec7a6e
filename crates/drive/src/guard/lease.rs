//! The lease on control, which ends unless its owner renews it. One that was held when the gateway exited awaits its owner;
//! so does an order of another gateway.

use super::adoption::AdoptedOrder;
use crate::domain::command::{Direction, Owner};
use crate::domain::control::{ControlSettings, Ownership};
use crate::domain::fail_safe::FailSafeCause;
use crate::domain::time::MonoTime;
use crate::journal::RememberedLease;
use std::time::Duration;

/// A lease on control of one owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Lease {
    owner: Owner,
    until: MonoTime,
    /// Set for a lease from before a restart of the gateway, whose owner has not been heard since.
    orphan: Option<OrphanLease>,
    /// When its owner was last refused because the drive could not be reached: it is there all the same.
    refused_at: Option<MonoTime>,
}

/// Who holds control of one drive.
#[derive(Debug, Default)]
pub(super) struct ControlLease {
    lease: Option<Lease>,
    /// A run order from another gateway of the line that no client here has taken up yet.
    adopted: Option<AdoptedOrder>,
}

/// A lease that has ended because its owner was not heard in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LostLease {
    pub owner: Owner,
    pub cause: FailSafeCause,
}

impl ControlLease {
    /// The owner, and when the lease ends unless renewed.
    pub fn held(&self) -> Option<(Owner, MonoTime)> {
        self.lease.map(|lease| (lease.owner, lease.until))
    }

    pub fn owner(&self) -> Option<Owner> {
        self.lease.map(|lease| lease.owner)
    }

    pub const fn is_held(&self) -> bool {
        self.lease.is_some()
    }

    /// Whether `owner` may treat the lease as its own.
    pub fn counts_as_held_by(&self, owner: Owner, control: &ControlSettings) -> bool {
        let holder = self.owner();
        holder == Some(owner) || (holder.is_some() && control.ownership == Ownership::Any)
    }

    /// The order that awaits an owner.
    pub const fn adopted(&self) -> Option<AdoptedOrder> {
        self.adopted
    }

    /// When the lease ends, or the wait for an owner.
    pub fn next_end(&self) -> Option<MonoTime> {
        let lease = self
            .lease
            .map(|lease| lease.until)
            .filter(|until| *until != MonoTime::NEVER);
        lease
            .into_iter()
            .chain(self.adopted.map(AdoptedOrder::until))
            .min()
    }

    /// Control passes to `owner`.
    pub fn take(&mut self, owner: Owner, lost_after: Duration, now: MonoTime) {
        self.adopted = None;
        self.lease = Some(Lease {
            owner,
            until: now + lost_after,
            orphan: None,
            refused_at: None,
        });
    }

    /// `owner` renews its lease.
    pub fn renew(&mut self, owner: Owner, lost_after: Duration, now: MonoTime) {
        if let Some(lease) = &mut self.lease
            && lease.owner == owner
        {
            lease.until = now + lost_after;
            lease.orphan = lease.orphan.and_then(OrphanLease::taken_up);
        }
    }

    /// An order to run in `direction` awaits an owner until `until`.
    pub const fn adopt(&mut self, direction: Direction, until: MonoTime) {
        self.adopted = Some(AdoptedOrder::new(direction, until));
    }

    /// No order awaits an owner any more.
    pub const fn end_adoption(&mut self) {
        self.adopted = None;
    }

    /// The lease ends. Returns its owner.
    pub fn end(&mut self) -> Option<Owner> {
        self.lease.take().map(|lease| lease.owner)
    }

    /// Ends the lease if it has expired at `now`.
    pub fn end_expired(&mut self, lost_after: Duration, now: MonoTime) -> Option<LostLease> {
        let lease = self.lease.filter(|it| it.until <= now)?;
        self.lease = None;
        let is_there = lease.refused_at.is_some_and(|at| at + lost_after > now);
        let cause = match lease.orphan {
            Some(orphan) => orphan.cause(),
            None if is_there => FailSafeCause::OutOfReach,
            None => FailSafeCause::CommanderLost,
        };
        Some(LostLease {
            owner: lease.owner,
            cause,
        })
    }

    /// What `owner` orders, or its open connection, renews nothing while the drive cannot be reached, but the client is
    /// there.
    pub fn was_out_of_reach(&mut self, owner: Owner, now: MonoTime) {
        if let Some(lease) = self.lease.as_mut().filter(|lease| lease.owner == owner) {
            lease.refused_at = Some(now);
        }
    }

    /// Restores a lease from before a restart of the gateway. It does not end before the drive is seen.
    pub const fn remember(&mut self, lease: RememberedLease) {
        let orphan = OrphanLease::Unseen {
            was_orphaned: lease.was_orphaned,
        };
        self.lease = Some(Lease {
            owner: lease.owner,
            until: MonoTime::NEVER,
            orphan: Some(orphan),
            refused_at: None,
        });
    }

    /// Restores a lease from before a restart of the gateway, which ends at `until`, because another gateway may be
    /// active.
    pub const fn remember_listening(&mut self, lease: RememberedLease, until: MonoTime) {
        let orphan = OrphanLease::Listening {
            was_orphaned: lease.was_orphaned,
        };
        self.lease = Some(Lease {
            owner: lease.owner,
            until,
            orphan: Some(orphan),
            refused_at: None,
        });
    }

    /// No other gateway was active since the start: the owner is awaited until `until`.
    pub const fn awaited_until(&mut self, until: MonoTime) {
        let Some(lease) = &mut self.lease else {
            return;
        };
        if let Some(OrphanLease::Listening { was_orphaned }) = lease.orphan {
            lease.until = if was_orphaned { MonoTime::NEVER } else { until };
            lease.orphan = Some(OrphanLease::Unseen { was_orphaned });
        }
    }

    /// Whether the lease is from before a restart of the gateway, whether or not its owner was heard since.
    pub fn is_from_before(&self) -> bool {
        self.lease.is_some_and(|lease| lease.orphan.is_some())
    }

    /// Whether the owner is awaited since before a restart of the gateway.
    pub fn is_orphaned(&self) -> bool {
        let orphan = self.lease.and_then(|lease| lease.orphan);
        orphan.is_some_and(OrphanLease::is_awaited)
    }

    /// The drive was seen running: the time of an awaited owner begins.
    pub fn found_running(&mut self, lost_after: Duration, now: MonoTime) {
        let Some(lease) = &mut self.lease else {
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
                lease.until = lease.until.min(now + lost_after);
            }
            Some(OrphanLease::TakenUp) => lease.orphan = None,
            Some(OrphanLease::Listening { .. } | OrphanLease::Running(_)) | None => {}
        }
    }
}

/// The state of a lease from before a restart of the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OrphanLease {
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
    const fn taken_up(self) -> Option<Self> {
        match self {
            Self::Unseen { .. } | Self::Listening { .. } | Self::TakenUp => Some(Self::TakenUp),
            Self::Running(_) => None,
        }
    }

    /// Its owner was not heard since the restart.
    const fn is_awaited(self) -> bool {
        match self {
            Self::Unseen { .. } | Self::Listening { .. } | Self::Running(_) => true,
            Self::TakenUp => false,
        }
    }

    /// Why the declared action runs when the lease ends.
    const fn cause(self) -> FailSafeCause {
        match self {
            Self::Running(cause) => cause,
            Self::Unseen { .. } | Self::Listening { .. } | Self::TakenUp => {
                FailSafeCause::CommanderLost
            }
        }
    }
}
