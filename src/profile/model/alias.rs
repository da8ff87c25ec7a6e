//! Other addresses of stored registers, by which they are written in RAM.

use super::{Fact, Model, Register, RegisterAccess, RegisterMemory, RegisterRole};
use crate::domain::address::{Address, DataTable};

/// A rule for the RAM form of a stored register: its address with other bits under a mask. The value is the same; written
/// there, it acts at once and is lost with the power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RamAlias {
    /// The bits that tell both forms apart.
    pub mask: u16,
    /// The bits under the mask in addresses of stored registers that have a RAM form.
    pub from: u16,
    /// The bits under the mask in addresses of the RAM form.
    pub to: u16,
    /// Whether the form can be read as well.
    pub is_readable: bool,
}

impl RamAlias {
    /// The RAM form of the register at `number`; `None` if it has none.
    #[must_use]
    pub const fn form_of(self, number: u16) -> Option<u16> {
        if number & self.mask == self.from {
            Some(number & !self.mask | self.to)
        } else {
            None
        }
    }

    /// The register whose RAM form is at `number`; `None` if none can be there.
    #[must_use]
    pub const fn register_of(self, number: u16) -> Option<u16> {
        if number & self.mask == self.to {
            Some(number & !self.mask | self.from)
        } else {
            None
        }
    }
}

impl Model {
    /// The address at which the register is written in RAM although it is stored; `None` if there is no such address, or it
    /// is unproven.
    #[must_use]
    pub fn ram_form(&self, register: &Register) -> Option<Address> {
        let alias = self.proven_alias()?;
        let is_aliased = register.access == RegisterAccess::ReadWrite
            && register.address.table() == DataTable::Holding
            && register.form.pair.is_none()
            && is_stored(register);
        if !is_aliased {
            return None;
        }
        let number = alias.form_of(register.address.number())?;
        Some(register.address.at(number))
    }

    /// The register whose RAM form is at `address`.
    #[must_use]
    pub fn in_ram_at(&self, address: Address) -> Option<&Register> {
        if address.table() != DataTable::Holding {
            return None;
        }
        let number = self.proven_alias()?.register_of(address.number())?;
        self.registers
            .iter()
            .find(|it| it.address == address.at(number) && self.ram_form(it) == Some(address))
    }

    /// Where `register`, which is written again and again, is written: in RAM if it is stored.
    #[must_use]
    pub fn cyclic_address(&self, register: &Register) -> Address {
        self.ram_form(register).unwrap_or(register.address)
    }

    /// Whether the RAM form of a register can be read.
    #[must_use]
    pub fn reads_ram_forms(&self) -> bool {
        self.proven_alias().is_some_and(|alias| alias.is_readable)
    }

    fn proven_alias(&self) -> Option<RamAlias> {
        let is_proven = |fact: &&Fact<RamAlias>| fact.confidence.is_proven();
        self.quirks
            .ram_alias
            .as_ref()
            .filter(is_proven)
            .map(|fact| fact.value)
    }
}

/// Whether a file says of the register that it is stored, or leaves that open where it takes no orders.
fn is_stored(register: &Register) -> bool {
    match register.memory {
        Some(memory) => memory == RegisterMemory::Stored,
        None => !register.role.is_some_and(RegisterRole::is_guarded),
    }
}
