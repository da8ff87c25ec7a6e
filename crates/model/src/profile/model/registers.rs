//! Questions to a model about its registers: what is at an address, what it means, and how it is read.

use super::{
    CodeRule, CodeText, ExceptionKind, Fact, FractionWhole, IndicatedState, Model, NUMBERS_MAX,
    ParameterGroup, PollClass, RamAlias, Register, RegisterAccess, RegisterMemory, RegisterRole,
    StatusFlag,
};
use crate::domain::address::{Address, DataTable};
use crate::domain::frequency::Hertz;
use crate::domain::link::Framing;
use std::collections::BTreeSet;
use std::time::Duration;

impl Model {
    /// The register at `address`.
    #[must_use]
    pub fn register_at(&self, address: impl Into<Address>) -> Option<&Register> {
        let address = address.into();
        self.registers
            .iter()
            .find(|register| register.address == address)
    }

    /// The register that is written at `address`.
    #[must_use]
    pub fn writable_at(&self, address: impl Into<Address>) -> Option<&Register> {
        let address = address.into();
        self.registers
            .iter()
            .find(|register| register.address == address && register.access.can_write())
    }

    /// A register that is read at `address`: one that begins there, or has its second word there.
    #[must_use]
    pub fn readable_at(&self, address: impl Into<Address>) -> Option<&Register> {
        let address = address.into();
        let covers = |it: &&Register| {
            address
                .offset_from(it.address)
                .is_some_and(|offset| offset < it.form.words())
        };
        self.registers
            .iter()
            .filter(|register| register.access.can_read())
            .find(covers)
    }

    /// What a read of the word at `address` shows: more than one register if it has fields.
    pub fn fields_at(&self, address: Address) -> impl Iterator<Item = &Register> {
        self.registers
            .iter()
            .filter(move |register| register.address == address && register.access.can_read())
    }

    /// How often the word at `address` is polled, if a read of `count` words from `first` on covers all words that it
    /// belongs to; `None` if it is not polled, or is one half of a pair.
    #[must_use]
    pub fn polled_at(&self, address: Address, first: Address, count: u16) -> Option<PollClass> {
        let is_read = |it: Address| it.offset_from(first).is_some_and(|offset| offset < count);
        let class = |register: &Register| {
            let words = register.form.words();
            let is_own = address
                .offset_from(register.address)
                .is_some_and(|offset| offset < words);
            let is_whole = register.address.onwards().take(words.into()).all(is_read);
            let is_part = register
                .form
                .plus
                .iter()
                .any(|part| part.address == address);
            if (is_own && is_whole) || is_part {
                register.poll
            } else {
                None
            }
        };
        self.registers.iter().filter_map(class).min()
    }

    /// The drive's own parameter that holds that full scale, if the model names it.
    #[must_use]
    pub fn full_scale_parameter(&self) -> Option<&str> {
        let scales = self
            .registers
            .iter()
            .filter_map(|register| register.form.full_scale.as_ref());
        scales
            .into_iter()
            .find_map(|scale| scale.parameter.as_deref())
    }

    /// The register whose stored twin is at `address`, on a model that has such twins.
    #[must_use]
    pub fn stored_twin(&self, address: impl Into<Address>) -> Option<&Register> {
        let address = address.into();
        let bit = 1_u16.checked_shl(u32::from(self.quirks.stored_alias_bit.as_ref()?.value))?;
        let number = address.number();
        (number & bit != 0).then(|| self.register_at(address.at(number & !bit)))?
    }

    /// Whether the register at `address` is non-volatile. If undocumented, only the registers that the gateway commands
    /// through count as volatile: no drive is commanded through a memory that wears out.
    #[must_use]
    pub fn is_stored(&self, address: impl Into<Address>) -> bool {
        let address = address.into();
        let second = || self.second_word_at(address);
        let register = self
            .writable_at(address)
            .or_else(|| self.register_at(address))
            .or_else(second);
        let Some(register) = register else {
            return self.in_ram_at(address).is_none();
        };
        match register.memory {
            Some(memory) => memory == RegisterMemory::Stored,
            None => !register.role.is_some_and(RegisterRole::is_guarded),
        }
    }

    /// Whether a register holds the word at `address`, alone or as the second of two.
    #[must_use]
    pub fn has_word_at(&self, address: Address) -> bool {
        let holds = |it: &Register| {
            address
                .offset_from(it.address)
                .is_some_and(|offset| offset < it.form.words())
        };
        self.registers.iter().any(holds)
    }

    /// The register of two words that can be written and whose second word is at `address`.
    #[must_use]
    pub fn second_word_at(&self, address: Address) -> Option<&Register> {
        let is_second =
            |it: &&Register| it.form.pair.is_some() && it.address.checked_add(1) == Some(address);
        self.registers
            .iter()
            .filter(|register| register.access.can_write())
            .find(is_second)
    }

    /// How long the drive hears nothing after a write of the register at `address`, or of another form of it.
    #[must_use]
    pub fn deaf_after(&self, address: Address) -> Option<Duration> {
        let register = self
            .writable_at(address)
            .or_else(|| self.stored_twin(address));
        register.or_else(|| self.in_ram_at(address))?.deaf_after
    }

    /// The registers whose writes the drive never answers.
    pub fn silent_writes(&self) -> impl Iterator<Item = Address> + '_ {
        self.registers
            .iter()
            .filter(|register| register.has_no_reply)
            .map(|register| register.address)
    }

    /// The longest time for which the drive hears nothing after a write.
    #[must_use]
    pub fn longest_deafness(&self) -> Duration {
        self.registers
            .iter()
            .filter_map(|register| register.deaf_after)
            .max()
            .unwrap_or_default()
    }

    /// The register with `role`; the first one if there are several.
    #[must_use]
    pub fn register_for(&self, role: RegisterRole) -> Option<&Register> {
        self.registers
            .iter()
            .find(|register| register.role == Some(role))
    }

    /// The register called `name`: its name or the vendor's code, ignoring case.
    #[must_use]
    pub fn register_named(&self, name: &str) -> Option<&Register> {
        self.registers.iter().find(|register| {
            let is_called = |label: &str| label.eq_ignore_ascii_case(name);
            is_called(&register.name) || register.code.as_deref().is_some_and(is_called)
        })
    }

    /// The register that shows the setpoint as the drive holds it: a dedicated one, else the frequency command if it
    /// is readable.
    #[must_use]
    pub fn setting_register(&self) -> Option<&Register> {
        let readable = |role| {
            self.register_for(role)
                .filter(|register| register.access.can_read())
        };
        readable(RegisterRole::FrequencySetting)
            .or_else(|| readable(RegisterRole::FrequencyCommand))
    }

    /// The location of `flag`.
    #[must_use]
    pub fn status_flag(&self, flag: IndicatedState) -> Option<&StatusFlag> {
        self.status.iter().find(|it| it.flag == flag)
    }

    /// The most reliable register that indicates a trip: a status word, else the present trip's number or bits, else the
    /// trip count.
    #[must_use]
    pub fn trip_register(&self) -> Option<&Register> {
        let flagged = self
            .status_flag(IndicatedState::Tripped)
            .and_then(|flag| self.readable_at(flag.address));
        let code = || {
            self.register_for(RegisterRole::TripCode)
                .or_else(|| self.register_for(RegisterRole::TripBits))
        };
        flagged
            .or_else(code)
            .or_else(|| self.register_for(RegisterRole::TripCount))
    }

    /// Whether the drive serves `function`.
    #[must_use]
    pub fn serves(&self, function: u8) -> bool {
        self.functions.value.contains(&function)
    }

    /// The vendor's text for trip `code`.
    #[must_use]
    pub fn trip_text(&self, code: u16) -> Option<&CodeText> {
        self.trip_codes.iter().find(|it| it.code == code)
    }

    /// The register that shows the active trips as bits, if the model has one.
    #[must_use]
    pub fn trip_bits(&self) -> Option<&Register> {
        self.register_for(RegisterRole::TripBits)
    }

    /// The register that shows the active warnings, if the model has one.
    #[must_use]
    pub fn warning_register(&self) -> Option<&Register> {
        self.register_for(RegisterRole::WarningCode)
            .or_else(|| self.register_for(RegisterRole::WarningBits))
    }

    /// The vendor's text for warning `code`; of bits, the number of the bit + 1.
    #[must_use]
    pub fn warning_text(&self, code: u16) -> Option<&CodeText> {
        self.warning_codes.iter().find(|it| it.code == code)
    }

    /// The vendor's text for exception `code`.
    #[must_use]
    pub fn exception_text(&self, code: u8) -> Option<&CodeText> {
        self.exceptions.iter().find(|it| it.code == u16::from(code))
    }

    /// What the drive means by exception `code`, if the model says more than its text.
    #[must_use]
    pub fn exception_kind(&self, code: u8) -> Option<ExceptionKind> {
        self.exception_kinds
            .iter()
            .find(|(of, _)| *of == code)
            .map(|(_, kind)| *kind)
    }

    /// How many words may be read from `address` in one frame before the model's limit or group boundary.
    #[must_use]
    pub fn words_in_one_read(&self, address: impl Into<Address>) -> u16 {
        self.read.words_at(address.into())
    }

    /// Whether `address` belongs to no register and a read may cover it all the same.
    #[must_use]
    pub fn is_readable_hole(&self, address: Address) -> bool {
        self.read.reads_holes()
            && self.readable_at(address).is_none()
            && self.writable_at(address).is_none()
    }

    /// The address after `address`, in the drive's numbering.
    #[must_use]
    pub fn next_address(&self, address: Address) -> Address {
        let is_decimal = self.quirks.decimal_numbers.is_some();
        let number = address.number();
        address.at(match (is_decimal, number & 0xF, number & 0xF0) {
            (true, 9.., 0x90..) => (number & 0xFF00).wrapping_add(0x100),
            (true, 9.., _) => (number & 0xFFF0).wrapping_add(0x10),
            _ => number.wrapping_add(1),
        })
    }

    /// The model for a line with `framing`: ASCII frames carry fewer words.
    #[must_use]
    pub fn on(&self, framing: Framing) -> Self {
        let mut model = self.clone();
        if let (Framing::Ascii, Some(words)) = (framing, &self.read.max_words_ascii) {
            model.read.max_words = words.clone();
            for area in &mut model.read.areas {
                area.max_words.value = area.max_words.value.min(words.value);
            }
        }
        model
    }

    /// Whether run state, standstill or trips are read at `address`: without it stops and trips are seen later, or not.
    #[must_use]
    pub fn is_essential(&self, address: Address) -> bool {
        let output = self
            .register_for(RegisterRole::OutputFrequency)
            .map(|register| register.address);
        let trips = self.trip_register().map(|register| register.address);
        let mut flags = self
            .status
            .iter()
            .filter(|flag| !flag.flag.is_permission())
            .map(|flag| flag.address);
        output == Some(address) || trips == Some(address) || flags.any(|flag| flag == address)
    }

    /// The register that shows the states of the drive's own state machine.
    #[must_use]
    pub fn state_register(&self) -> Option<&Register> {
        self.registers
            .iter()
            .find(|register| !register.states.is_empty())
    }

    /// The vendor's words for the state that `word` of that register shows, marked if they are unproven; `None` if the model
    /// does not know it.
    #[must_use]
    pub fn drive_state(&self, word: u16) -> Option<String> {
        let states = &self.state_register()?.states;
        states
            .iter()
            .find(|state| word & state.mask == state.value)
            .map(|state| state.text.clone())
    }

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

    /// The readable holding registers with a vendor code, in order of address.
    pub fn parameters(&self) -> impl Iterator<Item = &Register> {
        let is_parameter =
            |it: &&Register| it.address.table() == DataTable::Holding && it.access.can_read();
        self.registers
            .iter()
            .filter(is_parameter)
            .filter(|register| register.code.is_some())
    }

    /// Whether `word` at `address` satisfies an item of the set-up.
    #[must_use]
    pub fn is_set_up_by(&self, address: Address, word: u16) -> bool {
        self.setup
            .iter()
            .any(|item| item.address == Some(address) && item.is_right(word))
    }

    /// The groups of the code rule; if codes are addresses, those that contain a register with a code, because no others
    /// are known. Empty without a rule.
    #[must_use]
    pub fn groups(&self) -> Vec<ParameterGroup> {
        match &self.codes {
            None | Some(CodeRule::Linear { .. }) => Vec::new(),
            // Whatever is read there is shown: no answer says where a group ends.
            Some(_) if self.read.reads_holes() => Vec::new(),
            Some(CodeRule::Groups { groups, .. }) => groups
                .iter()
                .map(|(name, high)| ParameterGroup {
                    name: name.clone(),
                    high: *high,
                })
                .collect(),
            Some(CodeRule::Hexadecimal(_)) => {
                let bytes: BTreeSet<u8> = self
                    .parameters()
                    .map(|it| it.address.number().to_be_bytes()[0])
                    .collect();
                bytes
                    .into_iter()
                    .map(|high| ParameterGroup {
                        name: format!("{high:02X}"),
                        high,
                    })
                    .collect()
            }
        }
    }

    /// The addresses that `group` may hold, in the drive's numbering.
    pub fn addresses_of(&self, group: &ParameterGroup) -> impl Iterator<Item = Address> {
        let first = Address::holding(u16::from_be_bytes([group.high, 0]));
        let all = std::iter::successors(Some(first), |address| Some(self.next_address(*address)));
        all.take(usize::from(NUMBERS_MAX))
            .filter(|address| self.code_in_group(*address).is_some())
    }

    /// The vendor's code of the parameter at `address`; `None` outside all groups.
    #[must_use]
    pub fn code_in_group(&self, address: Address) -> Option<String> {
        let rule = self.codes.as_ref()?;
        let [high, low] = address.number().to_be_bytes();
        let code = match rule {
            CodeRule::Linear { .. } => return None,
            CodeRule::Hexadecimal(_) => {
                let is_decimal = low & 0xF <= 9 && low >> 4 <= 9;
                let is_known = self
                    .parameters()
                    .any(|it| it.address.number().to_be_bytes()[0] == high);
                (is_decimal && is_known).then(|| format!("{:04X}", address.number()))?
            }
            CodeRule::Groups {
                groups, separator, ..
            } => {
                if low >= NUMBERS_MAX {
                    return None;
                }
                let (name, _) = groups.iter().find(|(_, byte)| *byte == high)?;
                format!("{name}{separator}{low:02}")
            }
        };
        // There is no code beyond the end of a group.
        (rule.address(&code) == Some(address.number())).then_some(code)
    }

    /// The model of a drive whose configuration states `full_scale`, for registers that are fractions of it.
    #[must_use]
    pub fn with_full_scale(&self, full_scale: Hertz) -> Self {
        let mut model = self.clone();
        for scale in model
            .registers
            .iter_mut()
            .filter_map(|register| register.form.full_scale.as_mut())
        {
            if scale.of == FractionWhole::Configured {
                scale.of = FractionWhole::Fixed(full_scale);
            }
        }
        model
    }

    /// Whether a register is a fraction of a full scale that the configuration of the drive must state.
    #[must_use]
    pub fn needs_full_scale(&self) -> bool {
        let scales = self
            .registers
            .iter()
            .filter_map(|register| register.form.full_scale.as_ref());
        scales.into_iter().any(|scale| {
            matches!(
                scale.of,
                FractionWhole::Configured | FractionWhole::Fixed(_)
            )
        })
    }
}

/// Whether a file says of the register that it is stored, or leaves that open where it takes no orders.
fn is_stored(register: &Register) -> bool {
    match register.memory {
        Some(memory) => memory == RegisterMemory::Stored,
        None => !register.role.is_some_and(RegisterRole::is_guarded),
    }
}
