//! Rules between registers, and between registers and their model, for model files and configurations alike.

use super::RegisterFile;
use crate::domain::address::Address;
use crate::domain::problem::Problem;
use crate::profile::model::{CodeRule, Register, RegisterAccess, RegisterRole};
use crate::toml_file::{KeyLocation, LocatedValue};
use std::collections::BTreeMap;

/// Reports each register of `written` whose name, code, address or role is already used by an earlier one or by
/// `model`. Names and codes share one namespace and ignore case, as in [`Model::register_named`].
pub(in crate::profile) fn distinct(
    model: &[Register],
    written: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    let mut taken = UsedNames {
        is_extended: !model.is_empty(),
        ..UsedNames::default()
    };
    for register in model {
        let owner = format!("`{}` of the model", register.name);
        taken
            .labels
            .insert(register.name.to_lowercase(), owner.clone());
        taken.labels.extend(
            register
                .code
                .as_ref()
                .map(|code| (code.to_lowercase(), owner.clone())),
        );
        let place = OccupiedAddress {
            owner,
            access: register.access,
            bits: register.form.mask | register.form.exponent_mask,
        };
        let words = register
            .address
            .onwards()
            .take(register.form.words().into());
        words.for_each(|it| taken.addresses.entry(it).or_default().push(place.clone()));
    }
    for register in written {
        taken.add(register, problems);
    }
}

/// The owner of each name or code (in lower case), address and role.
#[derive(Default)]
struct UsedNames {
    labels: BTreeMap<String, String>,
    addresses: BTreeMap<Address, Vec<OccupiedAddress>>,
    roles: BTreeMap<RegisterRole, String>,
    /// The model is finished: what others add shares no address with it.
    is_extended: bool,
}

impl UsedNames {
    fn add(&mut self, register: &RegisterFile, problems: &mut Vec<Problem>) {
        if let Some(name) = &register.name {
            let called = format!("the name `{}`", name.value);
            claim(
                &mut self.labels,
                name.value.to_lowercase(),
                &called,
                &name.location,
                problems,
            );
        }
        if let Some(code) = register.code.valid() {
            let called = format!("the code `{}`", code.value);
            let is_own = register
                .name
                .as_ref()
                .is_some_and(|name| name.value.eq_ignore_ascii_case(&code.value));
            if !is_own {
                claim(
                    &mut self.labels,
                    code.value.to_lowercase(),
                    &called,
                    &code.location,
                    problems,
                );
            }
        }
        if let Some(address) = register.place() {
            self.claim_words(register, &address, problems);
        }
        if let Some(role) = register
            .role
            .valid()
            .filter(|role| !role.value.is_repeated())
        {
            claim(
                &mut self.roles,
                role.value,
                "this role",
                &role.location,
                problems,
            );
        }
    }
}

/// What a register takes of an address.
#[derive(Clone)]
struct OccupiedAddress {
    owner: String,
    access: RegisterAccess,
    /// The bits of a field; all for a register without one.
    bits: u16,
}

impl OccupiedAddress {
    /// Whether both may be at one address: fields without a common bit that are only read, or one that is only read and
    /// one that is only written.
    fn may_share(&self, other: &Self) -> bool {
        match (self.access, other.access) {
            (RegisterAccess::Read, RegisterAccess::Write)
            | (RegisterAccess::Write, RegisterAccess::Read) => true,
            (RegisterAccess::Read, RegisterAccess::Read) => self.bits & other.bits == 0,
            _ => false,
        }
    }
}

impl UsedNames {
    /// Claims the addresses of the words of `register`.
    fn claim_words(
        &mut self,
        register: &RegisterFile,
        address: &LocatedValue<Address>,
        problems: &mut Vec<Problem>,
    ) {
        let access = register
            .access
            .as_ref()
            .map_or(RegisterAccess::ReadWrite, |access| access.value);
        let bits = if register.form.is_pair() {
            u16::MAX
        } else {
            register.form.bits()
        };
        let place = OccupiedAddress {
            owner: address.location.key.clone(),
            access,
            bits,
        };
        let words = if register.form.is_pair() { 2 } else { 1 };
        for word in address.value.onwards().take(words) {
            let places = self.addresses.entry(word).or_default();
            if let Some(other) = places
                .iter()
                .find(|other| self.is_extended || !other.may_share(&place))
            {
                let what = format!("address {word} is taken by {}", other.owner);
                let right = "one that no other register of the model uses";
                problems.push(address.location.problem(what).right(right));
            }
            places.push(place.clone());
        }
    }
}

fn claim<T: Ord>(
    taken: &mut BTreeMap<T, String>,
    value: T,
    called: &str,
    location: &KeyLocation,
    problems: &mut Vec<Problem>,
) {
    match taken.get(&value) {
        Some(owner) => {
            let problem = location.problem(format!("{called} is taken by {owner}"));
            problems.push(problem.right("one that no other register of the model uses"));
        }
        None => {
            taken.insert(value, location.key.clone());
        }
    }
}

/// Reports each register of `written` at an invalid address: if `in_decimal`, the last two places must be decimal digits;
/// the bit `alias_bit` marks the stored twin of another register.
pub(in crate::profile) fn addresses_fit(
    in_decimal: bool,
    alias_bit: Option<u8>,
    written: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    for address in written
        .iter()
        .filter_map(|register| register.address.as_ref())
    {
        if in_decimal && !has_decimal_digits(address.value) {
            let what = format!(
                "0x{:04X} is not an address: this drive uses decimal digits",
                address.value
            );
            problems.push(
                address
                    .location
                    .problem(what)
                    .right("0 to 9 in each of the last two places"),
            );
        }
        if let Some(bit) = alias_bit.filter(|bit| address.value >> bit & 1 == 1) {
            let what = format!(
                "0x{:04X} is the stored twin of another register: it has bit {bit}",
                address.value
            );
            let right = format!("0x{:04X}, the register itself", address.value & !(1 << bit));
            problems.push(address.location.problem(what).right(right));
        }
    }
}

/// Whether the last two hexadecimal places of `address` are decimal digits.
pub(in crate::profile) fn has_decimal_digits(address: u16) -> bool {
    address & 0xF <= 9 && address >> 4 & 0xF <= 9
}

/// Reports each register of `written` whose code maps to another address by `rule`.
pub(in crate::profile) fn codes_fit(
    rule: &CodeRule,
    written: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    for register in written {
        let (Some(code), Some(address)) = (register.code.valid(), &register.address) else {
            continue;
        };
        if let Some(by_rule) = rule
            .address(&code.value)
            .filter(|by_rule| *by_rule != address.value)
        {
            let what = format!(
                "`{}` is 0x{by_rule:04X} by `codes`, not 0x{:04X}",
                code.value, address.value
            );
            problems.push(
                code.location
                    .problem(what)
                    .right("the code that belongs to the address, or leave it out"),
            );
        }
    }
}
