//! Writes to the drive's own registers: which may be written, how often stored ones may be, and who may set the drive's
//! watchdog.

use super::interlocks::StartInterlocks;
use crate::domain::command::{GoOrder, Origin, Owner, Reason, RegisterWrite, Report};
use crate::domain::control::ControlSettings;
use crate::domain::time::MonoTime;
use crate::drive::decode;
use crate::profile::model::{Model, ParameterKind, Register};

/// The register is listed, does not bypass control even if listed, and is not written too often.
pub(super) fn may_be_written(
    model: &Model,
    interlocks: &StartInterlocks,
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
        decode::register(model, *write)?;
        if model.sets_watchdog(write.address) {
            return Err(Reason::NotAllowed);
        }
        let is_worn =
            interlocks.was_written_within(control.stored_write_interval, write.address, now);
        if is_worn {
            Err(Reason::WrittenTooOften)
        } else {
            Ok(())
        }
    };
    let is_repeated = |(at, write): (usize, &RegisterWrite)| {
        model.is_stored(write.address)
            && writes
                .iter()
                .take(at)
                .any(|other| other.address == write.address)
    };
    writes
        .iter()
        .try_for_each(|write| may(write).map_err(Report::refused))?;
    if writes.iter().enumerate().any(is_repeated) {
        Err(Report::refused(Reason::WrittenTooOften))
    } else {
        Ok(())
    }
}

/// What a person at the host may restore. The list of writable registers does not apply, because no client does this; back
/// doors stay shut, and a parameter that takes the drive off the bus counts as a release.
pub(super) fn may_be_restored(
    model: &Model,
    interlocks: &StartInterlocks,
    writes: &[RegisterWrite],
    control: &ControlSettings,
    now: MonoTime,
) -> Result<(), Report> {
    for write in writes {
        let register = model
            .writable_at(write.address)
            .ok_or(Report::refused(Reason::NotListed))?;
        match register.parameter_kind() {
            ParameterKind::ReadOnly => return Err(Report::refused(Reason::NotListed)),
            ParameterKind::BackDoor | ParameterKind::Command => {
                return Err(Report::refused(Reason::NotAllowed));
            }
            _ if write.second.is_some() != register.form.pair.is_some() => {
                return Err(Report::refused(Reason::HalfAValue));
            }
            _ if !is_in_range(register, *write) => {
                return Err(Report::refused(Reason::OutsideRange));
            }
            ParameterKind::Source if !model.is_set_up_by(write.address, write.value) => {
                if !control.allow_release {
                    return Err(Report::refused(Reason::NoRelease));
                }
            }
            ParameterKind::Plain | ParameterKind::Source | ParameterKind::Link => {}
        }
        let is_worn =
            interlocks.was_written_within(control.stored_write_interval, write.address, now);
        if is_worn && model.is_stored(write.address) {
            return Err(Report::refused(Reason::WrittenTooOften));
        }
    }
    Ok(())
}

/// Whether `go` sets the time of the drive's own watchdog, sent by a tool through the gateway's local socket.
pub(super) fn sets_watchdog(model: &Model, origin: Origin, go: &GoOrder) -> bool {
    let time = model.watchdog.as_ref().map(|watchdog| watchdog.time);
    let is_alone = go.frequency().is_none() && go.run().is_none();
    let is_time = matches!(go.registers(), [write] if Some(write.address) == time);
    origin.owner == Owner::Local && is_alone && is_time
}

/// Whether `go` writes exactly one register, sent by a tool through the gateway's local socket.
pub(super) fn is_parameter(origin: Origin, go: &GoOrder) -> bool {
    let is_alone = go.frequency().is_none() && go.run().is_none() && go.registers().len() == 1;
    origin.owner == Owner::Local && is_alone
}

fn is_in_range(register: &Register, write: RegisterWrite) -> bool {
    match write.second {
        Some(second) => register.takes_both([write.value, second]),
        None => register.takes(write.value),
    }
}
