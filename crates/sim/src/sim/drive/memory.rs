//! Register contents of a drive: current, after a power cycle, and the number of writes to stored memory.

use super::super::options::DriveOptions;
use super::back_door::BackDoor;
use super::basis::first_basis;
use super::command::has_priority;
use crate::domain::address::{Address, DataTable};
use crate::profile::model::{
    Model, OrderKind, Register, RegisterAccess, RegisterMemory, RegisterRole, RunForm,
};
use crate::wire::pdu::Request;
use std::time::Duration;

/// The words of the model's registers, in the model's order; of a register with two words the number in them.
#[derive(Clone, Debug)]
pub(super) struct SimMemory {
    now: Vec<u32>,
    stored: Vec<u32>,
    /// What was written and does not act yet.
    waiting: Vec<Option<u32>>,
    stored_writes: Vec<u64>,
}

/// The register that an address on the wire refers to, and in which form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MemoryAddress {
    pub(super) index: usize,
    pub(super) form: AddressForm,
}

/// Which memory an address means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AddressForm {
    /// The memory of the register itself.
    Own,
    /// The memory of stored twins, whose bit the address has: it can only be written.
    Stored,
    /// RAM, although the register is stored.
    Ram,
}

impl SimMemory {
    pub(super) fn new(model: &Model, options: &DriveOptions) -> Self {
        let now: Vec<_> = model
            .registers
            .iter()
            .map(|register| first_word(model, register, options).into())
            .collect();
        Self {
            stored: now.clone(),
            waiting: vec![None; now.len()],
            stored_writes: vec![0; now.len()],
            now,
        }
    }

    pub(super) fn word(&self, index: usize) -> u16 {
        (self.now[index] & 0xFFFF) as u16
    }

    /// The number in one word or two.
    pub(super) fn number(&self, index: usize) -> u32 {
        self.now[index]
    }

    /// Holds `word` until power-off.
    pub(super) fn hold(&mut self, index: usize, word: u16) {
        self.now[index] = word.into();
    }

    /// Keeps `number` back until [`Self::apply`].
    pub(super) fn hold_back(&mut self, index: usize, number: u32) {
        self.waiting[index] = Some(number);
    }

    /// What was kept back acts, and is lost with the power; false if there was nothing.
    pub(super) fn apply(&mut self, index: usize) -> bool {
        let Some(number) = self.waiting[index].take() else {
            return false;
        };
        self.now[index] = number;
        true
    }

    /// What it holds outlasts the power.
    pub(super) fn store(&mut self, index: usize) {
        self.stored[index] = self.now[index];
    }

    /// Holds and stores `word`, as the drive's own panel does.
    pub(super) fn keep(&mut self, index: usize, word: u16) {
        self.keep_number(index, word.into());
    }

    fn keep_number(&mut self, index: usize, number: u32) {
        (self.now[index], self.stored[index]) = (number, number);
    }

    /// Takes `number` from the bus. A stored twin is the same value, so a write to it takes effect at once.
    pub(super) fn take(&mut self, register: &Register, place: MemoryAddress, number: u32) {
        let MemoryAddress { index, form } = place;
        // A run command is not restored at power-up unless a document says that it is stored.
        let is_order = matches!(
            register.role,
            Some(RegisterRole::RunCommand | RegisterRole::Order)
        ) && register.memory != Some(RegisterMemory::Stored);
        let is_volatile =
            (is_order || register.memory == Some(RegisterMemory::Ram)) && form == AddressForm::Own;
        if is_volatile || form == AddressForm::Ram {
            self.now[index] = number;
            return;
        }
        self.keep_number(index, number);
        // An undocumented setpoint is restored at power-up, but does not count as wear.
        let is_unknown =
            register.role == Some(RegisterRole::FrequencyCommand) && register.memory.is_none();
        self.stored_writes[index] += u64::from(!is_unknown);
    }

    /// Restores the stored words.
    pub(super) fn forget(&mut self, index: usize) {
        self.now[index] = self.stored[index];
    }

    /// Resets everything to the stored words.
    pub(super) fn lose_power(&mut self) {
        self.now.clone_from(&self.stored);
        self.waiting.fill(None);
    }

    pub(super) fn stored_writes(&self, index: usize) -> u64 {
        self.stored_writes[index]
    }
}

/// What `address` means in a write.
pub(super) fn place_of(model: &Model, address: Address) -> Option<MemoryAddress> {
    let written = model
        .registers
        .iter()
        .position(|it| it.address == address && it.access.can_write());
    if let Some(index) = written.or_else(|| index_of(model, address)) {
        return Some(MemoryAddress {
            index,
            form: AddressForm::Own,
        });
    }
    if let Some(index) = index_in_ram(model, address) {
        return Some(MemoryAddress {
            index,
            form: AddressForm::Ram,
        });
    }
    let bit = 1_u16.checked_shl(model.quirks.stored_alias_bit.as_ref()?.value.into())?;
    let number = address.number();
    if number & bit == 0 {
        return None;
    }
    let index = index_of(model, address.at(number & !bit))?;
    // Only parameters are stored: commands are written only, measurements are read only.
    (model.registers[index].access == RegisterAccess::ReadWrite).then_some(MemoryAddress {
        index,
        form: AddressForm::Stored,
    })
}

/// The stored register whose form in RAM is at `address`.
pub(super) fn index_in_ram(model: &Model, address: Address) -> Option<usize> {
    if address.table() != DataTable::Holding {
        return None;
    }
    let rule = model.quirks.ram_alias.as_ref()?.value;
    let number = rule.register_of(address.number())?;
    let index = index_of(model, address.at(number))?;
    let register = &model.registers[index];
    (register.access == RegisterAccess::ReadWrite && register.memory != Some(RegisterMemory::Ram))
        .then_some(index)
}

/// How long the drive of `model` needs a pause after a request with `pdu`, if that is a write.
pub(super) fn pause_after(model: &Model, pdu: &[u8]) -> Duration {
    let addresses = Request::decode(pdu)
        .into_iter()
        .flat_map(|request| request.written());
    let stored = addresses
        .filter_map(|address| place_of(model, address))
        .map(|place| {
            let register = &model.registers[place.index];
            let is_order = matches!(
                register.role,
                Some(RegisterRole::RunCommand | RegisterRole::FrequencyCommand)
            );
            match place.form {
                AddressForm::Stored => true,
                AddressForm::Ram => false,
                AddressForm::Own => {
                    register.memory == Some(RegisterMemory::Stored)
                        || (register.memory.is_none() && !is_order)
                }
            }
        });
    stored
        .map(|is_stored| model.timing.pause_after(is_stored))
        .max()
        .unwrap_or_default()
}

/// Where the register at `address` stands in the model; the readable one if there are two.
pub(super) fn index_of(model: &Model, address: Address) -> Option<usize> {
    let start = model
        .registers
        .partition_point(|register| register.address < address);
    let here = model
        .registers
        .get(start..)?
        .iter()
        .take_while(|register| register.address == address);
    let readable = here.clone().position(|register| register.access.can_read());
    Some(start + readable.or(here.count().checked_sub(1).map(|_| 0))?)
}

/// The number after `address`; nothing behind the last one. With `is_decimal` the last two places count to 9.
pub(super) fn following(address: Address, is_decimal: bool) -> Option<Address> {
    let step = match (is_decimal, address.number() & 0x00FF) {
        (true, 0x99) => 0x100 - 0x99,
        (true, low) if low & 0x0F == 9 => 7,
        _ => 1,
    };
    address.checked_add(step)
}

const NANOS: u64 = 1_000_000_000;

/// The time that `word` represents in `register`, which is in seconds.
pub(super) fn time(register: &Register, word: u16) -> Duration {
    Duration::from_nanos(u64::from(word) * NANOS / u64::from(register.scale.max(1)))
}

/// The initial word of a register.
fn first_word(model: &Model, register: &Register, options: &DriveOptions) -> u16 {
    let seconds = |time: Duration| {
        let raw = time.as_nanos() * u128::from(register.scale) / u128::from(NANOS);
        u16::try_from(raw).unwrap_or(u16::MAX)
    };
    let demanded = model
        .setup
        .iter()
        .find(|item| item.address == Some(register.address));
    let demanded = demanded.and_then(|item| item.values.value.first().copied());
    let identity = model
        .identity
        .as_ref()
        .filter(|identity| identity.address == register.address);
    let watchdog = model
        .watchdog
        .as_ref()
        .filter(|watchdog| watchdog.time == register.address);
    match register.role {
        Some(RegisterRole::AccelerationTime) => seconds(options.acceleration),
        Some(RegisterRole::DecelerationTime) => seconds(options.deceleration),
        Some(RegisterRole::FrequencySource | RegisterRole::RunSource) => {
            let takes_control = model.run.as_ref().is_some_and(has_priority);
            let ready = demanded.unwrap_or(if takes_control {
                0
            } else {
                options.communication
            });
            options.sources_at_start.unwrap_or(ready)
        }
        Some(RegisterRole::RunCommand) => model.run.as_ref().map_or(0, |run| match run.form {
            RunForm::Values
                if run
                    .places
                    .registers
                    .iter()
                    .any(|(kind, _)| *kind == OrderKind::Stop) =>
            {
                0
            }
            RunForm::Values => run.stop.value,
            RunForm::Bits { .. } => 0,
        }),
        Some(RegisterRole::Order) => at_rest(model, register),
        _ if BackDoor::of(register) == Some(BackDoor::Limit) => {
            u16::try_from(u32::from(options.max_frequency_hz) * register.scale).unwrap_or(u16::MAX)
        }
        _ => demanded
            .or(identity.and_then(|identity| identity.values.value.first().copied()))
            .or(first_basis(model, register, options))
            .or(watchdog.map(|watchdog| watchdog.off.value))
            .unwrap_or_else(|| lowest(register)),
    }
}

/// The word of `register` that is nearest to 0.
fn lowest(register: &Register) -> u16 {
    let raw = register.range.as_ref().map_or(0, |range| {
        0.clamp(*range.start(), *range.end().max(range.start()))
    });
    (raw & 0xFFFF) as u16
}

/// The word of `register`, which takes orders, before any was given.
fn at_rest(model: &Model, register: &Register) -> u16 {
    let direction = model
        .direction_at(register.address)
        .map(|words| words.forward);
    let clear = || {
        let clears = model
            .reset_clears()
            .filter(|it| it.address == register.address)?;
        Some(clears.value)
    };
    direction.or_else(clear).unwrap_or(0)
}
