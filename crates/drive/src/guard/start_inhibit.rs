//! The start inhibit: which clients may start the drive, and which of their messages are older than the last inhibit.

use super::owners::OwnerSet;
use crate::domain::command::{CommandRequest, OrderManner, Owner, Reason, Report};
use crate::domain::control::ControlSettings;
use crate::domain::time::MonoTime;

/// The right to start one drive.
#[derive(Debug)]
pub(super) struct StartInhibit {
    /// Owners that have commanded stop since the last inhibit, and may therefore start.
    armed: OwnerSet,
    epoch: u64,
    /// When the drive was added. Orders issued before do not start it.
    found_at: MonoTime,
    /// When the right to start last ended, by a stop, a trip or a lost lease. Orders issued before do not start the drive.
    inhibited_at: Option<MonoTime>,
}

impl StartInhibit {
    /// No client may start a drive that was added at `now`. Epochs count from `first_epoch`.
    pub fn new(first_epoch: u64, now: MonoTime) -> Self {
        Self {
            armed: OwnerSet::default(),
            epoch: first_epoch,
            found_at: now,
            inhibited_at: None,
        }
    }

    pub const fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Orders issued before are stale.
    pub const fn new_epoch(&mut self) {
        self.epoch += 1;
    }

    /// Every client must command stop before it may start the drive.
    pub const fn is_for_all(&self) -> bool {
        self.armed.is_empty()
    }

    pub const fn found_at(&self) -> MonoTime {
        self.found_at
    }

    pub fn is_armed(&self, owner: Owner) -> bool {
        self.armed.has(owner)
    }

    pub fn arm(&mut self, owner: Owner) {
        self.armed.add(owner, MonoTime::NEVER);
    }

    pub fn disarm(&mut self, owner: Owner) {
        self.armed.remove(owner);
    }

    /// Inhibits the start for all clients at `now`.
    pub fn inhibit(&mut self, now: MonoTime) {
        self.inhibited_at = Some(now);
        self.epoch += 1;
        self.armed.clear();
    }

    /// Whether the client of `command` may start the drive. A cyclic client acknowledges the inhibit by a stop; a message
    /// must have been sent after the last inhibit, as shown by its epoch, its moment of issue, or, without either, by
    /// arriving a while later. The start of the process is no such inhibit: no earlier message reaches it.
    pub fn may_start(
        &self,
        command: &CommandRequest,
        control: &ControlSettings,
        now: MonoTime,
    ) -> Result<(), Report> {
        if command.origin.manner == OrderManner::Cyclic {
            return if self.is_armed(command.origin.owner) {
                Ok(())
            } else {
                Err(Report::refused(Reason::StartInhibited))
            };
        }
        if command.epoch.is_some() {
            return Ok(());
        }
        if let Some(issued) = command.issued {
            return if issued > self.inhibited_at.unwrap_or(self.found_at) {
                Ok(())
            } else {
                Err(Report::refused(Reason::Stale))
            };
        }
        // Orders from the page are never retained by a broker.
        if control.strict && !matches!(command.origin.owner, Owner::Page(_)) {
            return Err(Report::refused(Reason::EpochNeeded));
        }
        let too_soon = self
            .inhibited_at
            .is_some_and(|inhibited| now.since(inhibited) < control.restart_delay);
        if too_soon {
            Err(Report::refused(Reason::RestartDelay))
        } else {
            Ok(())
        }
    }
}
