//! The review of writes to the drive's own registers: which may be written, how often stored ones may be, and who may set
//! the drive's watchdog.

use super::review::{CommandVerdict, DriveFacts, no_steps, refused};
use super::state::DriveGuard;
use crate::domain::command::{
    CommandRequest, GoOrder, Order, Origin, Owner, Reason, RegisterWrite, Report,
};
use crate::domain::control::ControlSettings;
use crate::domain::time::MonoTime;
use crate::drive::{decode, steps};
use crate::profile::model::{CommitEffect, ParameterKind, Register};

impl DriveGuard {
    /// The register is listed, does not bypass control even if listed, and is not written too often.
    pub(super) fn may_be_written(
        &self,
        writes: &[RegisterWrite],
        control: &ControlSettings,
        now: MonoTime,
    ) -> Result<(), Report> {
        let may = |write: &RegisterWrite| {
            if !control
                .native_write
                .iter()
                .any(|number| write.address == *number)
            {
                return Err(Reason::NotListed);
            }
            decode::register(&self.model, *write)?;
            if self.model.sets_watchdog(write.address) {
                return Err(Reason::NotAllowed);
            }
            let is_worn = self.interlocks.was_written_within(
                control.stored_write_interval,
                write.address,
                now,
            );
            if is_worn {
                Err(Reason::WrittenTooOften)
            } else {
                Ok(())
            }
        };
        let is_repeated = |(at, write): (usize, &RegisterWrite)| {
            self.model.is_stored(write.address)
                && writes
                    .iter()
                    .take(at)
                    .any(|other| other.address == write.address)
        };
        writes
            .iter()
            .try_for_each(|write| may(write).map_err(refused))?;
        if writes.iter().enumerate().any(is_repeated) {
            Err(refused(Reason::WrittenTooOften))
        } else {
            Ok(())
        }
    }

    /// Whether `go` sets the time of the drive's own watchdog, sent by a tool through the gateway's local socket.
    pub(super) fn sets_watchdog(&self, origin: Origin, go: &GoOrder) -> bool {
        let time = self.model.watchdog.as_ref().map(|watchdog| watchdog.time);
        let is_alone = go.frequency().is_none() && go.run().is_none();
        let is_time = matches!(go.registers(), [write] if Some(write.address) == time);
        origin.owner == Owner::Local && is_alone && is_time
    }

    /// A person at the host restores parameters of the drive, one at a time: at standstill and with nothing ordered, like
    /// everything that decides how a motor turns. The list of writable registers does not apply, because no client does this;
    /// back doors stay shut, and a parameter that takes the drive off the bus counts as a release.
    pub(super) fn review_parameter(
        &mut self,
        command: &CommandRequest,
        go: &GoOrder,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        if let Some(word) = self.commits(go) {
            return self.review_commit(command, &word, facts, now);
        }
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        for write in go.registers() {
            let register = self
                .model
                .writable_at(write.address)
                .ok_or(refused(Reason::NotListed))?;
            match register.parameter_kind() {
                ParameterKind::ReadOnly => return Err(refused(Reason::NotListed)),
                ParameterKind::BackDoor | ParameterKind::Command => {
                    return Err(refused(Reason::NotAllowed));
                }
                _ if write.second.is_some() != register.form.pair.is_some() => {
                    return Err(refused(Reason::HalfAValue));
                }
                _ if !is_in_range(register, *write) => return Err(refused(Reason::OutsideRange)),
                ParameterKind::Source if !self.model.is_set_up_by(write.address, write.value) => {
                    if !control.allow_release {
                        return Err(refused(Reason::NoRelease));
                    }
                }
                ParameterKind::Plain | ParameterKind::Source | ParameterKind::Link => {}
            }
            let is_worn = self.interlocks.was_written_within(
                control.stored_write_interval,
                write.address,
                now,
            );
            if is_worn && self.model.is_stored(write.address) {
                return Err(refused(Reason::WrittenTooOften));
            }
        }
        self.may_change_at_rest(command, facts, now)?;
        let mut steps =
            steps::of_go(&self.model, go, &control, None, &self.bases).map_err(no_steps)?;
        // What stores them is sent once, after the last one.
        let applies = self.model.commit(CommitEffect::Apply).cloned();
        self.commit_after(&mut steps, applies.as_ref(), now);
        self.interlocks.approved(&self.model, go.registers(), now);
        Ok(CommandVerdict::Go(self.approve(
            command,
            Order::Go(go.clone()),
            steps,
        )))
    }

    /// The drive's own watchdog is set like everything that decides when a motor stops: at standstill, with nothing
    /// ordered, and with read-back.
    pub(super) fn review_watchdog(
        &mut self,
        command: &CommandRequest,
        go: &GoOrder,
        facts: &DriveFacts,
        now: MonoTime,
    ) -> Result<CommandVerdict, Report> {
        for write in go.registers() {
            decode::register(&self.model, *write).map_err(refused)?;
        }
        self.may_change_at_rest(command, facts, now)?;
        let control = self.control.clone().ok_or(refused(Reason::ReadOnly))?;
        let commit = self.last_commit(&control, now)?;
        let mut steps =
            steps::of_go(&self.model, go, &control, None, &self.bases).map_err(no_steps)?;
        self.commit_after(&mut steps, commit.as_ref(), now);
        Ok(CommandVerdict::Go(self.approve(
            command,
            Order::Go(go.clone()),
            steps,
        )))
    }
}

fn is_in_range(register: &Register, write: RegisterWrite) -> bool {
    match write.second {
        Some(second) => register.takes_both([write.value, second]),
        None => register.takes(write.value),
    }
}

/// Whether `go` writes exactly one register, sent by a tool through the gateway's local socket.
pub(super) fn is_parameter(origin: Origin, go: &GoOrder) -> bool {
    let is_alone = go.frequency().is_none() && go.run().is_none() && go.registers().len() == 1;
    origin.owner == Owner::Local && is_alone
}
