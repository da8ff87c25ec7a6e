//! The native registers of a drive that clients may write.

use super::file::{DriveFile, NativeFile};
use crate::domain::address::DataTable;
use crate::domain::problem::{Problem, nearest};
use crate::profile::model::{CommitEffect, Model, Register, RegisterRole};
use crate::toml_file::{LocatedValue, OptionalKey};

/// The addresses that clients may write at `drive`, in the order of the list; `None` if it is invalid, see `problems`.
pub(super) fn settle(
    drive: &DriveFile,
    model: Option<&Model>,
    problems: &mut Vec<Problem>,
) -> Option<Vec<u16>> {
    let native = match &drive.native {
        OptionalKey::Absent => return Some(Vec::new()),
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(native) => native,
    };
    if drive.control.is_absent() {
        let what = "only clients that may command can write registers, and the drive has no control section";
        let right = "a `[line.drive.control]`, or leave `native` out";
        native.warn(what, right, problems);
    }
    let file = &native.value;
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
                written.warn(what, "each once", problems);
            }
            Ok(listed) if model.sets_watchdog(listed.address) => {
                let what = format!("`{}` sets the drive's own watchdog", listed.register.name);
                let right = "leave it out; only `vfd-gateway watchdog` sets it";
                written.refuse(what, right, problems);
            }
            Ok(listed) => addresses.push(listed.address),
            Err(problem) => problems.push(problem),
        }
    }
    stores_by_a_word(file, model, problems);
    Some(addresses)
}

fn stores_by_a_word(file: &NativeFile, model: &Model, problems: &mut Vec<Problem>) {
    if let Some(store) = file.store.valid_as(&true)
        && model.commit(CommitEffect::Store).is_none()
    {
        let id = &model.id;
        let what = match model.commit.stated(CommitEffect::Store) {
            Some(_) => {
                format!("the word by which {id} stores parameters is unproven, and is never sent")
            }
            None => format!("{id} has no word of its own by which it stores parameters"),
        };
        store.refuse(what, "leave it out", problems);
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
        let refused = |register: &Register, why: &str, right: &str| {
            let what = format!("{} {why}", self.called(register));
            Err(written.location.problem(what).right(right))
        };
        // A register added by the configuration may be at the address of a twin.
        for register in self.twin_of.into_iter().chain([self.register]) {
            if let Some(why) = &register.back_door {
                return refused(
                    register,
                    &format!("is never written: {why}"),
                    "leave it out",
                );
            }
            match register.role {
                Some(
                    RegisterRole::RunCommand | RegisterRole::Order | RegisterRole::FrequencyCommand,
                ) => {
                    let right = "leave it out; `control` says what may be commanded, and each write there is reviewed as a command";
                    return refused(register, "takes commands", right);
                }
                Some(role) if role.is_guarded() => {
                    let why = "selects the source of commands, and would bypass `control`";
                    return refused(register, why, "leave it out");
                }
                _ => {}
            }
        }
        if self.register.access.can_write() {
            return Ok(self);
        }
        let right = "registers with the access \"write\" or \"read-write\"";
        refused(self.register, "cannot be written", right)
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
    let (id, location) = (&model.id, &written.location);
    if let Some(digits) = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        let address = if digits.starts_with('+') {
            None
        } else {
            u16::from_str_radix(digits, 16).ok()
        };
        let found = address.and_then(|address| listed(model, address));
        return found.ok_or_else(|| {
            let right = "the address of a register of the model, or of one added by `[[line.drive.register]]`";
            location.problem(format!("{id} has no register at `{text}`")).right(right)
        });
    }
    let found = model.register_named(text);
    if let Some(register) = found
        && register.address.table() != DataTable::Holding
    {
        let problem = location.problem(format!("`{}` is not a holding register", register.name));
        return Err(problem.right("leave it out: only holding registers can be made writable"));
    }
    let found = found.and_then(|register| listed(model, register.address.number()));
    found.ok_or_else(|| {
        let registers = model.registers.iter();
        let labels =
            registers.flat_map(|it| it.code.as_deref().into_iter().chain([it.name.as_str()]));
        let problem = location.problem(format!("{id} has no register `{text}`"));
        match nearest(text, labels) {
            Some(near) => problem.right(format!("\"{near}\"")),
            None => problem.right("a name or a code of the model, or an address as \"0x020C\""),
        }
    })
}
