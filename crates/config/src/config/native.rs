//! The native registers of a drive that clients may write.

use super::file::{DriveFile, NativeFile};
use crate::domain::address::DataTable;
use crate::domain::control::ControlSettings;
use crate::domain::problem::{Problem, nearest};
use crate::profile::model::{CommitEffect, Model, Register, RegisterRole};
use crate::toml_file::{LocatedValue, OptionalKey};
use std::time::Duration;

/// The writable addresses of `drive`, in the order of the list; `None` if it is invalid, see `problems`.
pub(super) fn settle(
    drive: &DriveFile,
    model: Option<&Model>,
    problems: &mut Vec<Problem>,
) -> Option<Vec<u16>> {
    let LocatedValue {
        value: file,
        location,
    } = match &drive.native {
        OptionalKey::Absent => return Some(Vec::new()),
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(native) => native,
    };
    if matches!(drive.control, OptionalKey::Absent) {
        let what = "only clients that may command can write registers, and the drive has no control section";
        problems.push(
            location
                .problem(what)
                .right("a `[line.drive.control]`, or leave `native` out")
                .warning(),
        );
    }
    let list = file.write.as_ref()?;
    let model = model?;
    let mut addresses = Vec::new();
    for written in &list.value {
        match find_listed(written, model).and_then(|listed| listed.writable(written)) {
            Ok(listed) if addresses.contains(&listed.address) => {
                let what = format!(
                    "register `{}`, 0x{:04X}, is listed twice",
                    listed.register.name, listed.address
                );
                problems.push(written.location.problem(what).right("each once").warning());
            }
            Ok(listed) if model.sets_watchdog(listed.address) => {
                let problem = written.location.problem(format!(
                    "`{}` sets the drive's own watchdog",
                    listed.register.name
                ));
                problems.push(problem.right("leave it out; only `vfd-gateway watchdog` sets it"));
            }
            Ok(listed) => addresses.push(listed.address),
            Err(problem) => problems.push(problem),
        }
    }
    stores_by_a_word(file, model, problems);
    Some(addresses)
}

/// Whether native writes to `drive` are followed by the word that stores them; `None` if that is invalid, see `problems`.
pub(super) fn stores(drive: &DriveFile) -> Option<bool> {
    match &drive.native {
        OptionalKey::Absent => Some(false),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(native) => native.value.store(),
    }
}

fn stores_by_a_word(file: &NativeFile, model: &Model, problems: &mut Vec<Problem>) {
    let Some(store) = file.store.valid().filter(|store| store.value) else {
        return;
    };
    if model.commit(CommitEffect::Store).is_none() {
        let what = match model.commit.stated(CommitEffect::Store) {
            Some(_) => format!(
                "the word by which {} stores parameters is unproven, and is never sent",
                model.id
            ),
            None => format!(
                "{} has no word of its own by which it stores parameters",
                model.id
            ),
        };
        problems.push(store.location.problem(what).right("leave it out"));
    }
}

/// Minimum time between two writes of a stored register of `drive`; `None` if it is invalid, see `problems`.
pub(super) fn stored_write_interval(drive: &DriveFile) -> Option<Duration> {
    match &drive.native {
        OptionalKey::Absent => Some(ControlSettings::STORED_WRITE_INTERVAL),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(native) => native.value.stored_write_interval(),
    }
}

/// The register that a listed address writes to.
#[derive(Clone, Copy)]
pub struct ListedRegister<'m> {
    /// The address itself.
    pub address: u16,
    /// The register there.
    pub register: &'m Register,
    /// The register whose stored twin it is, if it is one.
    pub twin_of: Option<&'m Register>,
}

/// The register that `address` writes to on `model`; `None` if there is none.
#[must_use]
pub fn listed(model: &Model, address: u16) -> Option<ListedRegister<'_>> {
    let twin_of = model.quirks.stored_alias_bit.as_ref().and_then(|bit| {
        let bit = 1_u16.checked_shl(bit.value.into())?;
        if address & bit == 0 {
            None
        } else {
            model.register_at(address & !bit)
        }
    });
    let in_ram = model.in_ram_at(address.into());
    let register = model
        .writable_at(address)
        .or_else(|| model.register_at(address))
        .or(twin_of)
        .or(in_ram)?;
    Some(ListedRegister {
        address,
        register,
        twin_of,
    })
}

impl ListedRegister<'_> {
    /// Itself, if it may be made writable.
    fn writable(self, written: &LocatedValue<String>) -> Result<Self, Problem> {
        // A register added by the configuration may be at the address of a twin.
        for register in self.twin_of.into_iter().chain([self.register]) {
            self.is_no_way_around_control(register, written)?;
        }
        if self.register.access.can_write() {
            return Ok(self);
        }
        let problem = written
            .location
            .problem(format!("{} cannot be written", self.called(self.register)));
        Err(problem.right("registers with the access \"write\" or \"read-write\""))
    }

    fn is_no_way_around_control(
        self,
        register: &Register,
        written: &LocatedValue<String>,
    ) -> Result<(), Problem> {
        let refused = |why: &str| {
            written
                .location
                .problem(format!("{} {why}", self.called(register)))
        };
        if let Some(why) = &register.back_door {
            return Err(refused(&format!("is never written: {why}")).right("leave it out"));
        }
        match register.role {
            Some(RegisterRole::RunCommand | RegisterRole::Order | RegisterRole::FrequencyCommand) => Err(refused("takes commands").right(
                "leave it out; `control` says what may be commanded, and each write there is reviewed as a command",
            )),
            Some(role) if role.is_guarded() => {
                Err(refused("selects the source of commands, and would bypass `control`").right("leave it out"))
            }
            _ => Ok(()),
        }
    }

    /// The label of `register` in messages.
    fn called(self, register: &Register) -> String {
        let twin = match self.twin_of {
            _ if register.address == self.address => "",
            Some(_) => "the stored twin of ",
            None => "the form in RAM of ",
        };
        format!("{twin}`{}`", register.name)
    }
}

/// Finds the register for `written`: a name, a code, or an address in hexadecimal.
fn find_listed<'m>(
    written: &LocatedValue<String>,
    model: &'m Model,
) -> Result<ListedRegister<'m>, Problem> {
    let text = written.value.as_str();
    if let Some(digits) = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        let address = if digits.starts_with('+') {
            None
        } else {
            u16::from_str_radix(digits, 16).ok()
        };
        return address.and_then(|address| listed(model, address)).ok_or_else(|| {
            let problem = written.location.problem(format!("{} has no register at `{text}`", model.id));
            problem.right("the address of a register of the model, or of one added by `[[line.drive.register]]`")
        });
    }
    let found = model.register_named(text);
    if let Some(register) = found.filter(|register| register.address.table() != DataTable::Holding)
    {
        let problem = written
            .location
            .problem(format!("`{}` is not a holding register", register.name));
        return Err(problem.right("leave it out: only holding registers can be made writable"));
    }
    found
        .and_then(|register| listed(model, register.address.number()))
        .ok_or_else(|| {
            let labels = model
                .registers
                .iter()
                .flat_map(|it| it.code.as_deref().into_iter().chain([it.name.as_str()]));
            let problem = written
                .location
                .problem(format!("{} has no register `{text}`", model.id));
            match nearest(text, labels) {
                Some(near) => problem.right(format!("\"{near}\"")),
                None => problem.right("a name or a code of the model, or an address as \"0x020C\""),
            }
        })
}
