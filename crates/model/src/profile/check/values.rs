//! The rules for values that are more than one word divided by a scale.

use super::keys::readable;
use crate::domain::problem::Problem;
use crate::domain::units::UnitOfMeasure;
use crate::profile::file::ModelFile;
use crate::profile::model::{FactPart, RegisterAccess, RegisterRole};
use crate::profile::register::{CONFIGURED, RegisterFile};
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
use crate::wire::pdu::function;

/// Roles whose registers hold a code, a count or a time that the gateway uses as it is.
const WORDS: [RegisterRole; 13] = [
    RegisterRole::RunCommand,
    RegisterRole::Order,
    RegisterRole::RunSource,
    RegisterRole::FrequencySource,
    RegisterRole::TripCount,
    RegisterRole::TripCode,
    RegisterRole::TripBits,
    RegisterRole::TripCause,
    RegisterRole::TripHistory,
    RegisterRole::WarningCode,
    RegisterRole::WarningBits,
    RegisterRole::AccelerationTime,
    RegisterRole::DecelerationTime,
];
/// Roles of [`WORDS`] that may be a field of a word.
const FIELDS: [RegisterRole; 6] = [
    RegisterRole::TripCode,
    RegisterRole::TripBits,
    RegisterRole::TripCause,
    RegisterRole::TripHistory,
    RegisterRole::WarningCode,
    RegisterRole::WarningBits,
];
/// Roles of [`WORDS`] that may be two words: bits alone.
const PAIRS: [RegisterRole; 2] = [RegisterRole::TripBits, RegisterRole::WarningBits];
/// Widest exponent in bits: larger powers of ten than 10^7 are nowhere.
const EXPONENT_BITS: u32 = 3;

pub(super) fn check(file: &ModelFile, problems: &mut Vec<Problem>) {
    for register in &file.registers {
        words_fit(register, file, problems);
        fields_fit(register, problems);
        parts_are_only_read(register, file, problems);
        full_scale_is_known(register, file, problems);
        scale_is_known(register, file, problems);
        sign_means_a_direction(register, problems);
        sign_in_doubt_is_read(register, problems);
        is_one_value(register, problems);
    }
    ranges_are_fixed(file, problems);
}

fn tell(
    location: &KeyLocation,
    what: impl Into<String>,
    right: impl Into<String>,
    problems: &mut Vec<Problem>,
) {
    problems.push(location.problem(what).right(right));
}

fn role(register: &RegisterFile) -> Option<RegisterRole> {
    register.role.valid().map(|role| role.value)
}

/// Two words have an order, and are read in one frame.
fn words_fit(register: &RegisterFile, file: &ModelFile, problems: &mut Vec<Problem>) {
    let form = &register.form;
    let Some(LocatedValue { location, .. }) = form.words.valid().filter(|words| words.value == 2)
    else {
        if let Some(order) = form.word_order.valid() {
            tell(
                &order.location,
                "one word has no order",
                "`words = 2`, or leave it out",
                problems,
            );
        }
        return;
    };
    if matches!(form.word_order, OptionalKey::Absent) {
        tell(
            location,
            "the order of the two words is not stated",
            "`word_order = \"high-first\"` or \"low-first\", as the documents state it",
            problems,
        );
    }
    let limits = file.read.as_ref().and_then(|read| read.ready());
    let (Some(limits), Some(address)) = (limits, register.place()) else {
        return;
    };
    let ascii = limits
        .max_words_ascii
        .as_ref()
        .map_or(u16::MAX, |words| words.value);
    if limits.words_at(address.value).min(ascii) < 2 {
        tell(
            location,
            "no read of this drive covers both words",
            "a register of one word",
            problems,
        );
    }
    if form.mask.valid().is_some() || form.exponent_mask.valid().is_some() {
        tell(
            location,
            "a field is in one word",
            "leave out `words`, or `mask` and `exponent_mask`",
            problems,
        );
    }
}

/// Masks are contiguous and do not overlap.
fn fields_fit(register: &RegisterFile, problems: &mut Vec<Problem>) {
    let form = &register.form;
    for mask in [&form.mask, &form.exponent_mask]
        .into_iter()
        .filter_map(|mask| mask.valid())
    {
        if !is_contiguous(mask.value) {
            let what = format!(
                "0x{:04X} is not one field: there are gaps between its bits",
                mask.value
            );
            tell(
                &mask.location,
                what,
                "a mask whose bits are neighbours",
                problems,
            );
        } else if mask.value == u16::MAX {
            tell(
                &mask.location,
                "0xFFFF is the whole word",
                "leave it out",
                problems,
            );
        }
    }
    let Some(exponent) = form.exponent_mask.valid() else {
        return;
    };
    match form.mask.valid() {
        None => tell(
            &exponent.location,
            "an exponent needs a mantissa",
            "`mask`, the bits of the mantissa",
            problems,
        ),
        Some(mask) if mask.value & exponent.value != 0 => {
            tell(
                &exponent.location,
                "the exponent has bits of the mantissa",
                "bits that `mask` does not have",
                problems,
            );
        }
        Some(_) if exponent.value.count_ones() > EXPONENT_BITS => {
            tell(
                &exponent.location,
                "the exponent is too wide",
                "at most 3 bits",
                problems,
            );
        }
        Some(_) => {}
    }
}

/// Whether the bits of `mask` are neighbours.
fn is_contiguous(mask: u16) -> bool {
    let shifted = mask.checked_shr(mask.trailing_zeros()).unwrap_or(0);
    shifted & shifted.wrapping_add(1) == 0
}

/// What is more than one whole word is not written.
fn parts_are_only_read(register: &RegisterFile, file: &ModelFile, problems: &mut Vec<Problem>) {
    let form = &register.form;
    if form.is_pair()
        && register
            .access
            .as_ref()
            .is_some_and(|access| access.value.can_write())
    {
        pair_is_written_whole(register, file, problems);
    }
    let is_more = form.mask.valid().is_some()
        || form.exponent_mask.valid().is_some()
        || form.scale_by.valid().is_some()
        || !form.plus.is_empty();
    let written = register
        .access
        .as_ref()
        .filter(|access| is_more && access.value != RegisterAccess::Read);
    if let Some(access) = written {
        let what = "a field, a sum or a scale from elsewhere can only be read";
        tell(&access.location, what, "\"read\"", problems);
    }
}

/// What is written as two words is a plain number, and goes out in one frame. A setpoint has no sign.
fn pair_is_written_whole(register: &RegisterFile, file: &ModelFile, problems: &mut Vec<Problem>) {
    let Some(words) = register.form.words.valid() else {
        return;
    };
    let serves = file
        .functions
        .value
        .as_ref()
        .is_none_or(|served| served.value.contains(&function::WRITE_MULTIPLE));
    if !serves {
        let what = "both words are written in one frame by function 10 hex, which is not served";
        tell(
            &words.location,
            what,
            "0x10 in `functions` if the manual names it, or access \"read\"",
            problems,
        );
    }
    let has_ratio = register
        .scale
        .valid()
        .is_some_and(|scale| scale.value.per != 1);
    let is_setpoint = role(register) == Some(RegisterRole::FrequencyCommand);
    let has_sign = is_setpoint && register.signed() == Some(true);
    if has_sign || has_ratio || register.form.full_scale.valid().is_some() {
        let what = match is_setpoint {
            true => "a setpoint of two words is a number without a sign and with a plain scale",
            false => "what is written as two words is a number with a plain scale",
        };
        tell(
            &words.location,
            what,
            "one word, or leave out `signed` and `full_scale`",
            problems,
        );
    }
}

/// A full scale comes from readable registers in the same unit, or from the configuration.
fn full_scale_is_known(register: &RegisterFile, file: &ModelFile, problems: &mut Vec<Problem>) {
    let Some(LocatedValue { value: scale, .. }) = register.form.full_scale.valid() else {
        return;
    };
    if let Some(from) = scale.from.valid()
        && role(register) == Some(RegisterRole::OutputFrequency)
    {
        tell(
            &from.location,
            "an output of 0 would not be 0 Hz",
            "leave it out",
            problems,
        );
    }
    let is_configured = scale.of.as_ref().is_some_and(|of| of.value == CONFIGURED);
    if let Some(parameter) = scale.parameter.valid()
        && !is_configured
        && scale.of.is_some()
    {
        let right = "leave it out, or `of = \"configured\"`";
        tell(
            &parameter.location,
            "a register of the drive holds the full scale, so it is not entered by hand",
            right,
            problems,
        );
    }
    let unit = register.unit.as_ref().map(|unit| unit.value);
    let from = scale.from.valid();
    for name in scale.of.iter().chain(from) {
        if name.value == CONFIGURED && from != Some(name) {
            if unit.is_some_and(|unit| unit != UnitOfMeasure::Hertz) {
                tell(
                    &name.location,
                    "`full_scale_hz` is a frequency",
                    "the name of a register in the unit of this one",
                    problems,
                );
            }
            continue;
        }
        let Some(basis) = basis(register, name, file, problems) else {
            continue;
        };
        if basis.unit.as_ref().map(|unit| unit.value) != unit {
            let what = format!("`{}` has another unit", name.value);
            tell(
                &name.location,
                what,
                "a register in the unit of this one",
                problems,
            );
        }
    }
}

/// The scale comes from a readable register.
fn scale_is_known(register: &RegisterFile, file: &ModelFile, problems: &mut Vec<Problem>) {
    let by = register
        .form
        .scale_by
        .valid()
        .and_then(|by| by.value.register.as_ref());
    if let Some(name) = by {
        basis(register, name, file, problems);
    }
}

/// The register called `name`, on which the value of `register` depends: another one that is one word or a field of it.
fn basis<'f>(
    register: &RegisterFile,
    name: &LocatedValue<String>,
    file: &'f ModelFile,
    problems: &mut Vec<Problem>,
) -> Option<&'f RegisterFile> {
    let before = problems.len();
    let basis = readable(name, &file.registers, problems)?;
    if problems.len() != before {
        return None;
    }
    let form = &basis.form;
    let is_simple = !form.is_pair()
        && form.exponent_mask.valid().is_none()
        && form.full_scale.valid().is_none()
        && form.scale_by.valid().is_none()
        && form.plus.is_empty();
    if basis.name() == register.name() || !is_simple {
        let what = format!("`{}` is not one word with a scale of its own", name.value);
        tell(
            &name.location,
            what,
            "a register of one word, or a field of it",
            problems,
        );
        return None;
    }
    Some(basis)
}

/// Only signed frequencies show a direction.
fn sign_means_a_direction(register: &RegisterFile, problems: &mut Vec<Problem>) {
    let Some(direction) = register.form.direction.valid() else {
        return;
    };
    let shows = [
        RegisterRole::OutputFrequency,
        RegisterRole::FrequencyCommand,
        RegisterRole::FrequencySetting,
    ];
    if !role(register).is_some_and(|role| shows.contains(&role)) {
        let right = "leave it out, or role \"output-frequency\", \"frequency-command\" or \"frequency-setting\"";
        tell(
            &direction.location,
            "only a frequency shows the direction",
            right,
            problems,
        );
    }
    if register.signed() == Some(false) {
        tell(
            &direction.location,
            "a number without a sign has no direction",
            "leave it out, or `signed = true` if the documents say so",
            problems,
        );
    }
}

/// A number whose sign no document states is read in two's complement: below half of its range both readings agree, and
/// a negative one is not shown as a large positive one. The sign of an output frequency is its direction then.
fn sign_in_doubt_is_read(register: &RegisterFile, problems: &mut Vec<Problem>) {
    let parts = register.not_stated.valid().map(|parts| parts.value.iter());
    let Some(sign) = parts
        .into_iter()
        .flatten()
        .find(|part| part.value == FactPart::Sign)
    else {
        return;
    };
    let is_read = register
        .access
        .as_ref()
        .is_none_or(|access| access.value.can_read());
    let is_output = role(register) == Some(RegisterRole::OutputFrequency);
    if is_read && register.signed() == Some(false) {
        let what = "a negative number would be shown as a large positive one";
        tell(
            &sign.location,
            what,
            "`signed = true`: below half of the range both readings agree",
            problems,
        );
    } else if is_output && matches!(register.form.direction, OptionalKey::Absent) {
        tell(
            &sign.location,
            "a negative output frequency is no magnitude",
            "`direction = \"sign\"`",
            problems,
        );
    }
}

/// Keys that give the value in two ways, and registers whose word the gateway uses as it is.
fn is_one_value(register: &RegisterFile, problems: &mut Vec<Problem>) {
    let form = &register.form;
    let full_scale = form.full_scale.valid().map(|it| &it.location);
    let scale_by = form.scale_by.valid().map(|it| &it.location);
    for location in full_scale.iter().chain(&scale_by) {
        if register.scale.valid().is_some() {
            tell(
                location,
                "the scale is given twice",
                "leave out `scale`",
                problems,
            );
        }
    }
    if let (Some(location), Some(_)) = (full_scale, scale_by) {
        tell(
            location,
            "the scale is given twice",
            "either `full_scale` or `scale_by`",
            problems,
        );
    }
    if full_scale.is_some()
        && let Some(part) = form.plus.iter().find_map(|part| part.address.as_ref())
    {
        tell(
            &part.location,
            "nothing can be added to a fraction",
            "leave out `full_scale` or `plus`",
            problems,
        );
    }
    let Some(role) = register
        .role
        .valid()
        .filter(|role| WORDS.contains(&role.value))
    else {
        return;
    };
    let has_field = form.mask.valid().is_some() && !FIELDS.contains(&role.value);
    let has_ratio = register
        .scale
        .valid()
        .is_some_and(|scale| scale.value.per != 1);
    let is_more = (form.is_pair() && !PAIRS.contains(&role.value))
        || form.exponent_mask.valid().is_some()
        || !form.plus.is_empty();
    if has_field || has_ratio || is_more || full_scale.is_some() || scale_by.is_some() {
        tell(
            &role.location,
            "a register with this role is one word with a plain scale",
            "a plain register",
            problems,
        );
    }
}

/// The range of a register is fixed, so that of a fraction cannot be stated.
fn ranges_are_fixed(file: &ModelFile, problems: &mut Vec<Problem>) {
    for register in &file.registers {
        let (Some(range), Some(_)) = (register.range_location(), register.form.full_scale.valid())
        else {
            continue;
        };
        tell(
            range,
            "the range of a fraction is not fixed",
            "leave it out",
            problems,
        );
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::testing::{MODEL, told_with};

    /// What is said of `keys` in the one register of the small model.
    fn said(keys: &str) -> String {
        let found = told_with(MODEL, "scale = 100\n", &format!("{keys}\n"));
        let lines: Vec<_> = found.lines().map(str::trim).collect();
        let said = lines.chunks(2).map(|pair| {
            let what = pair[0].split_once(' ').map_or(pair[0], |(_, what)| what);
            format!("{what} -> {}", pair[1].trim_start_matches("right: "))
        });
        said.collect::<Vec<_>>()
            .join("\n")
            .replace("register[0].", "")
    }

    #[test]
    fn mistakes_in_words_and_fields_are_named() {
        for (keys, expected) in [
            (
                "words = 2",
                "words: the order of the two words is not stated -> \
                 `word_order = \"high-first\"` or \"low-first\", as the documents state it",
            ),
            (
                "word_order = \"low-first\"",
                "word_order: one word has no order -> `words = 2`, or leave it out",
            ),
            (
                "words = 3",
                "words: 3 is out of range -> a whole number from 1 to 2",
            ),
            (
                "mask = 0x0F0F",
                "mask: 0x0F0F is not one field: there are gaps between its bits -> a mask whose bits are neighbours",
            ),
            (
                "mask = 0xFFFF",
                "mask: 0xFFFF is the whole word -> leave it out",
            ),
            (
                "exponent_mask = 0x0C00",
                "exponent_mask: an exponent needs a mantissa -> `mask`, the bits of the mantissa",
            ),
            (
                "mask = 0x0FFF\nexponent_mask = 0x0C00",
                "exponent_mask: the exponent has bits of the mantissa -> bits that `mask` does not have",
            ),
            (
                "mask = 0x00FF\nexponent_mask = 0x0F00",
                "exponent_mask: the exponent is too wide -> at most 3 bits",
            ),
        ] {
            assert_eq!(said(keys), expected);
        }
    }

    #[test]
    fn a_setpoint_of_two_words_is_written_as_a_plain_number() {
        let pairs = include_str!("../../../../../tests/golden/models/pairs.toml");
        crate::profile::check::model(pairs).unwrap();
        for (from, to, expected) in [
            (
                "[0x03, 0x06, 0x10]",
                "[0x03, 0x06]",
                "words: both words are written in one frame by function 10 hex, which is not served\n    \
                 right: 0x10 in `functions` if the manual names it",
            ),
            (
                "scale = 10000",
                "scale = 10000\nsigned = true",
                "words: a setpoint of two words is a number without a sign and with a plain scale\n    \
                 right: one word, or leave out `signed` and `full_scale`",
            ),
            (
                "scale = 10000",
                "scale = { steps = 10, per = 3 }",
                "words: a setpoint of two words is a number without a sign",
            ),
            (
                "role = \"frequency-command\"",
                "role = \"acceleration-time\"",
                "role: a register with this role is one word with a plain scale",
            ),
        ] {
            let found = told_with(pairs, from, to);
            assert!(found.contains(expected), "{to}: {found}");
        }
    }

    #[test]
    fn a_parameter_of_two_words_is_written_as_a_plain_number() {
        let pairs = include_str!("../../../../../tests/golden/models/pairs.toml");
        let ramp = "scale = 100\nunit = \"s\"";
        let of = |keys: &str| format!("{keys}\nunit = \"s\"");
        let served = ("[0x03, 0x06, 0x10]", "[0x03, 0x06]");
        let without = pairs.replacen(
            "words = 2\nword_order = \"high-first\"\nscale = 10000",
            "scale = 100",
            1,
        );
        for (text, from, to, expected) in [
            (
                without.as_str(),
                served.0,
                served.1.to_owned(),
                "words: both words are written in one frame by function 10 hex",
            ),
            (
                pairs,
                ramp,
                of("scale = { steps = 3, per = 2 }"),
                "words: what is written as two words is a number with a plain",
            ),
            (
                pairs,
                ramp,
                of("scale = 100\nmask = 0x00FF"),
                "access: a field, a sum or a scale from elsewhere can only be read",
            ),
        ] {
            let found = told_with(text, from, &to);
            assert!(found.contains(expected), "{to}: {found}");
        }
    }

    #[test]
    fn trips_and_warnings_are_one_word_or_a_field_of_it() {
        let refusal = "role: a register with this role is one word with a plain scale";
        for role in ["trip-code", "trip-bits", "warning-code", "warning-bits"] {
            let model = MODEL.replace("output-frequency", role);
            let written = |keys: &str| told_with(&model, "scale = 100\n", &format!("{keys}\n"));
            assert!(
                written("scale = { steps = 3, per = 2 }").contains(refusal),
                "{role}"
            );
            let pair = model.replace("scale = 100\n", "words = 2\nword_order = \"high-first\"\n");
            assert_eq!(
                crate::profile::check::model(&pair).is_ok(),
                role.ends_with("bits"),
                "{role}"
            );
            crate::profile::check::model(&model.replace("scale = 100\n", "mask = 0x00FF\n"))
                .unwrap();
        }
    }

    #[test]
    fn mistakes_in_scales_are_named() {
        for (keys, expected) in [
            (
                "scale = { steps = 0, per = 1 }",
                "scale.steps: 0 is out of range -> a whole number from 1 to 1000000",
            ),
            (
                "scale = { steps = 4096 }",
                "scale.per: `per` is missing -> a whole number from 1 to 1000000",
            ),
            (
                "full_scale = { steps = 16384, of = \"max\" }",
                "full_scale.of: there is no register called `max` -> the `name` of a register",
            ),
            (
                "full_scale = { steps = 16384, of = \"output_frequencie\" }",
                "full_scale.of: there is no register called `output_frequencie` -> `output_frequency`",
            ),
            (
                "full_scale = { steps = 16384, of = \"output_frequency\" }",
                "full_scale.of: `output_frequency` is not one word with a scale of its own -> \
                 a register of one word, or a field of it",
            ),
            (
                "full_scale = { steps = 16384, of = \"maximum\", parameter = \"1-01\" }",
                "full_scale.of: there is no register called `maximum` -> the `name` of a register\n\
                 full_scale.parameter: a register of the drive holds the full scale, so it is not entered by hand -> leave it out, or `of = \"configured\"`",
            ),
            (
                "scale = 10\nfull_scale = { steps = 16384, of = \"configured\" }",
                "full_scale: the scale is given twice -> leave out `scale`",
            ),
            (
                "scale_by = { register = \"decimals\", steps = { \"0\" = 1 } }",
                "scale_by.register: there is no register called `decimals` -> the `name` of a register",
            ),
            (
                "direction = \"sign\"",
                "direction: a number without a sign has no direction -> leave it out, or `signed = true` if the documents say so",
            ),
            (
                "not_stated = [\"sign\"]",
                "not_stated[0]: a negative number would be shown as a large positive one -> \
                 `signed = true`: below half of the range both readings agree",
            ),
            (
                "signed = true\nnot_stated = [\"sign\"]",
                "not_stated[0]: a negative output frequency is no magnitude -> `direction = \"sign\"`",
            ),
        ] {
            assert_eq!(said(keys), expected);
        }
    }
}
