//! Ownership of control: one owner at a time or shared, and take-over.

use super::review::{CommandVerdict, DriveFacts, refused};
use super::state::DriveGuard;
use crate::domain::command::{Origin, Owner, Reason, Report, RunIntent};
use crate::domain::control::{ControlSettings, Ownership};
use crate::domain::time::MonoTime;

impl DriveGuard {
    /// Rules for every command but a stop.
    pub(super) fn may_command(
        &self,
        origin: Origin,
        control: &ControlSettings,
        facts: &DriveFacts,
    ) -> Result<(), Report> {
        self.may_be_heard(origin)?;
        let reason = if facts.listens {
            Reason::Standby
        } else if !facts.line_is_up {
            Reason::LineDown
        } else if facts.is_offline {
            Reason::Offline
        } else if facts.is_implausible {
            Reason::Implausible
        } else {
            return match self.lease() {
                Some((other, _))
                    if other != origin.owner && control.ownership == Ownership::One =>
                {
                    Err(Report::held_by(other))
                }
                _ => Ok(()),
            };
        };
        Err(refused(reason))
    }

    /// Passes control to the client that takes it; the drive continues unchanged. Without an owner, control can be taken
    /// only of a motor that is not known to be at standstill.
    pub(super) fn review_take(
        &mut self,
        origin: Origin,
        control: &ControlSettings,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        self.may_be_heard(origin)?;
        if !control.allow_take {
            return Err(refused(Reason::NoTake));
        }
        let holder = self.lease().map(|(owner, _)| owner);
        if holder == Some(origin.owner) {
            self.renew(origin.owner, now);
            return Ok(CommandVerdict::Unchanged);
        }
        let rests = facts.at_standstill && !matches!(self.intent(), RunIntent::Run(_));
        if holder.is_none() && rests {
            return Ok(CommandVerdict::Unchanged);
        }
        self.take_lease(origin.owner, now);
        Ok(CommandVerdict::Taken(holder))
    }

    /// Whether `owner` may treat the current lease as its own.
    pub(super) fn counts_as_held_by(&self, owner: Owner, control: &ControlSettings) -> bool {
        let holder = self.lease().map(|(owner, _)| owner);
        holder == Some(owner) || (holder.is_some() && control.ownership == Ownership::Any)
    }

    /// An order that changes nothing renews the lease. With shared ownership it renews the current owner's lease: two
    /// controllers that repeat the same orders do not take control from each other.
    pub(super) fn renew_unchanged(
        &mut self,
        owner: Owner,
        control: &ControlSettings,
        now: MonoTime,
    ) {
        let renewed = match self.lease() {
            Some((holder, _)) if self.counts_as_held_by(owner, control) => holder,
            _ => owner,
        };
        self.renew(renewed, now);
    }

    fn may_be_heard(&self, origin: Origin) -> Result<(), Report> {
        if !origin.rights.write {
            return Err(refused(Reason::NotAllowed));
        }
        if self.is_ending {
            return Err(refused(Reason::ShuttingDown));
        }
        if self.is_leaving {
            Err(refused(Reason::Removed))
        } else {
            Ok(())
        }
    }
}
