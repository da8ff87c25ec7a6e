//! The register sections of a summary: the table of all registers, and the meanings of their words.

use super::layout::{Row, choice, list, row};
use crate::domain::address::Address;
use crate::profile::model::{
    ClearWords, CodeRule, CodeText, FractionWhole, MaskedWord, Model, Register, RegisterRole,
    StatusFlag,
};
use crate::profile::scale::ScaledValue;
use crate::profile::words::{FLAGS, POLL_CLASSES};
use crate::toml_file::values::duration_text;
use crate::toml_file::words::word_for;
use std::ops::RangeInclusive;

/// The name of the register at `address`.
pub(super) fn name_at(model: &Model, address: Address) -> String {
    model
        .register_at(address)
        .map_or_else(|| address.to_string(), |register| register.name.clone())
}

pub(super) fn registers(registers: &[Register]) -> Vec<Row> {
    let head = [
        "address",
        "code",
        "name",
        "unit",
        "scale",
        "access",
        "poll",
        "memory",
        "range",
        "confidence",
        "source",
        "what it is",
    ];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    rows.extend(registers.iter().map(register));
    rows
}

fn register(register: &Register) -> Row {
    let memory = register.memory.map_or("-", |memory| memory.keyword());
    vec![
        address(register),
        register.code.clone().unwrap_or_else(|| "-".to_owned()),
        register.name.clone(),
        register.unit.to_string(),
        scale(register),
        register.access.keyword().to_owned(),
        register
            .poll
            .map_or("-", |poll| word_for(&POLL_CLASSES, &poll))
            .to_owned(),
        memory.to_owned(),
        register
            .range
            .as_ref()
            .map_or_else(|| "-".to_owned(), |range| range_text(range, register)),
        confidence(register),
        register.source.clone(),
        register.title.clone(),
    ]
}

/// Its address, with the bits of a field, or of both words.
fn address(register: &Register) -> String {
    match (register.form.pair, register.form.mask) {
        (Some(_), _) => format!(
            "{}-{:04X}",
            register.address,
            register.address.number().wrapping_add(1)
        ),
        (None, u16::MAX) => register.address.to_string(),
        (None, mask) => format!("{}&{mask:04X}", register.address),
    }
}

/// How its value follows from its words.
fn scale(register: &Register) -> String {
    let form = &register.form;
    let per = |scale: u32, per: u32| {
        if per == 1 {
            format!("x{scale}")
        } else {
            format!("x{scale}/{per}")
        }
    };
    let mut text = match (&form.full_scale, &form.scale_by) {
        (Some(scale), _) => {
            let of = match &scale.of {
                FractionWhole::Register(basis) => basis.address.to_string(),
                FractionWhole::Configured | FractionWhole::Fixed(_) => match &scale.parameter {
                    Some(parameter) => format!("full_scale_hz ({parameter})"),
                    None => "full_scale_hz".to_owned(),
                },
            };
            let from = scale
                .from
                .as_ref()
                .map(|basis| format!(" from {}", basis.address))
                .unwrap_or_default();
            format!("{} = {of}{from}", scale.steps)
        }
        (None, Some(by)) => {
            let steps = list(
                by.steps
                    .iter()
                    .map(|(word, steps)| format!("{word}: x{steps}")),
            );
            format!("by {}&{:04X} ({steps})", by.address, by.mask)
        }
        (None, None) => per(register.scale, form.per),
    };
    if form.exponent_mask != 0 {
        text.push_str(&format!(" exp &{:04X}", form.exponent_mask));
    }
    for part in &form.plus {
        text.push_str(&format!(
            " + {} {}",
            part.address,
            per(part.scale, part.per)
        ));
    }
    if let Some(order) = form.pair {
        text.push_str(&format!(" {}", order.keyword()));
    }
    if register.signed {
        text.push_str(if form.sign_is_direction {
            " signed, the sign is the direction"
        } else {
            " signed"
        });
    }
    text
}

/// The confidence of the row, and the parts that it does not cover.
fn confidence(register: &Register) -> String {
    let word = register.confidence.keyword();
    if register.not_stated.is_empty() {
        return word.to_owned();
    }
    format!(
        "{word}, but not {}",
        list(register.not_stated.iter().map(|part| part.keyword()))
    )
}

fn range_text(range: &RangeInclusive<i32>, register: &Register) -> String {
    // In two's complement, the low word of a negative number is its register word.
    let end = |raw: &i32| ScaledValue::from_word((raw & 0xFFFF) as u16, register);
    format!("{} to {}", end(range.start()), end(range.end()))
}

/// The meanings of register words, each register named once.
pub(super) fn meanings(registers: &[Register]) -> Vec<Row> {
    let rows = registers.iter().flat_map(|register| {
        register
            .meanings
            .iter()
            .enumerate()
            .map(|(index, (word, text))| {
                let name = if index == 0 {
                    register.name.clone()
                } else {
                    String::new()
                };
                vec![name, word.to_string(), text.clone()]
            })
    });
    rows.collect()
}

pub(super) fn back_doors(registers: &[Register]) -> Vec<Row> {
    let closed =
        |register: &Register| Some(vec![register.name.clone(), register.back_door.clone()?]);
    registers.iter().filter_map(closed).collect()
}

pub(super) fn deaf(registers: &[Register]) -> Vec<Row> {
    let deaf = |register: &Register| {
        Some(vec![
            register.name.clone(),
            duration_text(register.deaf_after?),
        ])
    };
    registers.iter().filter_map(deaf).collect()
}

pub(super) fn silent(registers: &[Register]) -> Vec<Row> {
    let silent = registers.iter().filter(|register| register.has_no_reply);
    silent
        .map(|register| {
            vec![
                register.name.clone(),
                "its outcome is read afterwards".to_owned(),
            ]
        })
        .collect()
}

/// The states of the drive's own state machine.
pub(super) fn states(model: &Model) -> Vec<Row> {
    let states = model.run.iter().flat_map(|run| &run.states);
    let rows = states.map(|state| {
        let name = name_at(model, state.address);
        let condition = match state.mask {
            u16::MAX => format!("{name} = {}", state.value),
            mask => format!("{name} & 0x{mask:04X} = 0x{:04X}", state.value),
        };
        vec![
            condition,
            state.text.clone(),
            state.confidence.keyword().to_owned(),
            state.source.clone(),
        ]
    });
    rows.collect()
}

pub(super) fn status(model: &Model) -> Vec<Row> {
    let rows = model.status.iter().map(|status| {
        let name = name_at(model, status.address);
        let condition = match status.mask {
            u16::MAX => format!("{name} = {}", choice(&status.values)),
            mask => format!(
                "{name} & 0x{mask:04X} = {}",
                choice(status.values.iter().map(|it| format!("0x{it:04X}")))
            ),
        };
        let flag = word_for(&FLAGS, &status.flag).to_owned();
        let condition = format!("{condition}{}", clear_words(status));
        vec![
            flag,
            condition,
            status.confidence.keyword().to_owned(),
            status.source.clone(),
        ]
    });
    rows.collect()
}

/// The words that are named as not setting a flag, unless all others are.
fn clear_words(status: &StatusFlag) -> String {
    let ClearWords::Named(named) = &status.clear else {
        return String::new();
    };
    let mut words: Vec<_> = named
        .iter()
        .filter(|word| !status.holds(word.value))
        .collect();
    words.sort_unstable_by_key(|word| (word.mask, word.value));
    words.dedup();
    let text = |word: &&MaskedWord| match word.mask {
        mask if mask != status.mask => format!("& 0x{mask:04X} = 0x{:04X}", word.value),
        u16::MAX => word.value.to_string(),
        _ => format!("0x{:04X}", word.value),
    };
    format!("; not with {}", choice(words.iter().map(text)))
}

pub(super) fn trips(model: &Model) -> Vec<Row> {
    coded(&model.trip_codes, model.trip_bits().is_some())
}

pub(super) fn warnings(model: &Model) -> Vec<Row> {
    coded(
        &model.warning_codes,
        model.register_for(RegisterRole::WarningBits).is_some(),
    )
}

/// A row for each text, by its number or its bit.
fn coded(codes: &[CodeText], are_bits: bool) -> Vec<Row> {
    let rows = codes.iter().map(|it| {
        let number = if are_bits {
            format!("bit {}", it.code.saturating_sub(1))
        } else {
            it.code.to_string()
        };
        vec![
            number,
            it.text.clone(),
            it.confidence.keyword().to_owned(),
            it.source.clone(),
        ]
    });
    rows.collect()
}

pub(super) fn codes(rule: Option<&CodeRule>) -> Vec<Row> {
    match rule {
        None => Vec::new(),
        Some(CodeRule::Hexadecimal(origin)) => {
            vec![row("a code is", "the address in hexadecimal", origin)]
        }
        Some(CodeRule::Linear {
            separator,
            group,
            number,
            offset,
            origin,
        }) => {
            let code = separator
                .as_ref()
                .map_or_else(|| "n".to_owned(), |separator| format!("g{separator}n"));
            let of_group = separator
                .as_ref()
                .map(|_| format!("g x {group} + "))
                .unwrap_or_default();
            vec![row(
                "a code is",
                format!("{code} = {of_group}n x {number} {offset:+}"),
                origin,
            )]
        }
        Some(CodeRule::Groups {
            groups,
            ends,
            separator,
            origin,
        }) => {
            let end = |name: &String| ends.iter().find(|(it, _)| it == name).map(|(_, end)| *end);
            let group = |(name, byte): &(String, u8)| {
                let end = end(name)
                    .map(|end| format!(" up to {name}{separator}{end:02}"))
                    .unwrap_or_default();
                format!("{name}{separator}n = 0x{byte:02X}00 + n{end}")
            };
            let groups = list(groups.iter().map(group));
            vec![row("a code is", groups, origin)]
        }
    }
}
