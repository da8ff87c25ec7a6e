//! Registers and their words in text for people.

use super::{FrameValue, KnownDrive};
use crate::domain::address::{Address, DataTable};
use crate::domain::units::UnitOfMeasure;
use crate::drive::rated::RatedConversion;
use crate::profile::model::{BitMeaning, Model, OrderKind, Register, RegisterRole};
use crate::profile::scale::digits_of;
use crate::profile::value::codes_of_bits;
use crate::profile::words::{BIT_MEANINGS, FLAGS, ZERO_WORDS};
use crate::toml_file::words::word_for;

/// Most values in one line of text.
const VALUES_IN_TEXT: usize = 8;

/// `words` from `address` on, as `drive` counts.
pub(super) fn values(
    drive: Option<&KnownDrive>,
    address: Address,
    words: &[u16],
) -> Vec<FrameValue> {
    let mut address = address;
    let mut values = Vec::with_capacity(words.len());
    for word in words {
        values.push(value(drive, address, *word));
        address = drive.map_or(address.at(address.number().wrapping_add(1)), |drive| {
            drive.model.next_address(address)
        });
    }
    values
}

/// The values in one line, only the first if there are many.
pub(super) fn in_text(values: &[FrameValue], between: &str, with_address: bool) -> String {
    let one = |value: &FrameValue| match &value.name {
        Some(name) if !with_address => format!("{}{between}{}", spoken(name), value.text),
        _ => format!(
            "{}{between}{}",
            place_text(value.address, value.name.as_deref()),
            value.text
        ),
    };
    let mut text = values
        .iter()
        .take(VALUES_IN_TEXT)
        .map(one)
        .collect::<Vec<_>>()
        .join(", ");
    if let Some(more) = values
        .len()
        .checked_sub(VALUES_IN_TEXT)
        .filter(|more| *more > 0)
    {
        text += &format!(", and {more} more");
    }
    text
}

/// The register at `address` by number and name.
pub(super) fn place(drive: Option<&KnownDrive>, address: Address) -> String {
    place_text(
        address,
        drive
            .and_then(|drive| name(&drive.model, address))
            .as_deref(),
    )
}

fn place_text(address: Address, name: Option<&str>) -> String {
    name.map_or_else(
        || address.to_string(),
        |name| format!("{address} {}", spoken(name)),
    )
}

fn spoken(name: &str) -> String {
    name.replace('_', " ")
}

fn name(model: &Model, address: Address) -> Option<String> {
    let stored = || {
        model
            .stored_twin(address)
            .map(|register| format!("{}_stored", register.name))
    };
    // A drive without input registers may serve its holding registers by 04 as well.
    let as_holding = || {
        if address.table() == DataTable::Input {
            model.register_at(address.number())
        } else {
            None
        }
    };
    let register = model.register_at(address).or_else(as_holding);
    register
        .map(|register| register.name.clone())
        .or_else(stored)
}

fn value(drive: Option<&KnownDrive>, address: Address, word: u16) -> FrameValue {
    let name = drive.and_then(|drive| name(&drive.model, address));
    let known = drive.and_then(|drive| {
        let model = &drive.model;
        let register = model
            .register_at(address)
            .or_else(|| model.stored_twin(address))?;
        let fields: Vec<_> = model
            .fields_at(address)
            .filter(|it| it.form.mask != u16::MAX)
            .collect();
        match fields[..] {
            [] if register.form.is_plain() => Some(text(drive, register, word)),
            [] => None,
            _ => Some(
                fields
                    .iter()
                    .map(|field| text(drive, field, word))
                    .collect::<Vec<_>>()
                    .join(", "),
            ),
        }
    });
    FrameValue {
        address,
        name,
        text: known.unwrap_or_else(|| format!("0x{word:04X}")),
    }
}

fn text(drive: &KnownDrive, register: &Register, word: u16) -> String {
    let model = &drive.model;
    let depends = register.form.bases().next().is_some() || register.form.exponent_mask != 0;
    let value = register.value(|address| (address == register.address).then_some(word));
    let scaled = match value {
        Some(scaled) if !depends => scaled,
        _ => return format!("0x{word:04X}"),
    };
    if matches!(
        register.role,
        Some(RegisterRole::RunCommand | RegisterRole::Order)
    ) {
        return with_meaning(format!("0x{word:04X}"), order_text(model, register, word));
    }
    if let Some(meaning) = register.meaning(word) {
        return with_meaning(scaled.to_string(), meaning.to_owned());
    }
    if register.role == Some(RegisterRole::TripBits) {
        let set = codes_of_bits(register.code_in(word).into());
        let known: Vec<_> = set
            .filter_map(|code| model.trip_text(code))
            .map(|trip| trip.text.clone())
            .collect();
        return with_meaning(format!("0x{word:04X}"), known.join("; "));
    }
    if matches!(
        register.role,
        Some(RegisterRole::TripCode | RegisterRole::TripCause | RegisterRole::TripHistory)
    ) {
        let known = model
            .trip_text(register.code_in(word))
            .map(|trip| trip.text.clone());
        return with_meaning(scaled.to_string(), known.unwrap_or_default());
    }
    if register.unit == UnitOfMeasure::None
        && model
            .status
            .iter()
            .any(|flag| flag.address == register.address)
    {
        return with_meaning(
            format!("0x{word:04X}"),
            flags(model, register.address, word),
        );
    }
    let text = if register.unit == UnitOfMeasure::None {
        scaled.to_string()
    } else {
        format!("{scaled} {}", register.unit)
    };
    if register.form.sign_is_direction && register.number_in(word) < 0 {
        return with_meaning(text, "reverse".to_owned());
    }
    let rated = RatedConversion::of(register, &drive.ratings);
    let rated = rated.map(|rated| {
        format!(
            "{} {}",
            rated.to_digits(scaled, digits_of(register.scale)),
            rated.unit
        )
    });
    with_meaning(text, rated.unwrap_or_default())
}

fn with_meaning(value: String, meaning: String) -> String {
    if meaning.is_empty() {
        value
    } else {
        format!("{value} ({meaning})")
    }
}

/// What a word in a register of orders stands for; empty if the model does not say.
fn order_text(model: &Model, register: &Register, word: u16) -> String {
    if let Some(words) = model.direction_at(register.address) {
        let known = [(Some(words.forward), "forward"), (words.reverse, "reverse")];
        return known
            .into_iter()
            .find(|(it, _)| *it == Some(word))
            .map_or("", |(_, name)| name)
            .to_owned();
    }
    if let Some((kind, _)) = model
        .orders_at(register.address)
        .find(|(_, fact)| fact.value == word)
    {
        let says_no_direction = kind == OrderKind::Forward && model.turns_by_sign();
        return if says_no_direction {
            "run"
        } else {
            kind.keyword()
        }
        .to_owned();
    }
    let (Some(run), Some(RegisterRole::RunCommand)) = (&model.run, register.role) else {
        return String::new();
    };
    if word == 0
        && let Some(zero) = &run.zero
    {
        return word_for(&ZERO_WORDS, &zero.value).to_owned();
    }
    let senses = run.form.senses();
    if senses.has(word, BitMeaning::Ignored) {
        return word_for(&BIT_MEANINGS, &BitMeaning::Ignored).to_owned();
    }
    let names = senses
        .held(word)
        .map(|sense| word_for(&BIT_MEANINGS, &sense.meaning));
    names.collect::<Vec<_>>().join(", ")
}

/// The flags that hold with `word` in the status register at `address`.
fn flags(model: &Model, address: Address, word: u16) -> String {
    let holds = model
        .status
        .iter()
        .filter(|flag| flag.address == address && flag.holds(word));
    let names = holds.filter_map(|flag| FLAGS.iter().find(|(_, known)| *known == flag.flag));
    names.map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
}
