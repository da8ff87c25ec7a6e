//! Agreement between a line and its models: speed, character format, framing, interface.

use super::file::{DriveFile, LineFile};
use super::port;
use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use crate::domain::problem::Problem;
use crate::profile::model::{FactorySetting, Model, ModelLink};
use crate::toml_file::words::{FRAMINGS, INTERFACES, PARITIES, word_for};
use crate::toml_file::{KeyLocation, OptionalKey};

/// Default data bits of a line.
const DEFAULT_DATA_BITS: u8 = 8;
/// Data bits of RTU frames, which are bytes.
const RTU_DATA_BITS: u8 = 8;

/// A model of a line, with the first drive that has it.
pub(super) struct OnLine<'a> {
    pub model: &'a Model,
    pub drive: &'a DriveFile,
}

/// All models of a line, and its framing; `None` if that is invalid.
#[derive(Clone, Copy)]
struct LineModels<'a> {
    models: &'a [OnLine<'a>],
    framing: Option<Framing>,
}

/// The settings of a line that agrees with its models.
pub(super) struct SettledLink {
    pub link: LinkSettings,
    pub framing: Framing,
    pub interface: Interface,
}

/// Settles `line` with its distinct `models`. `None`: see `problems`. Over Modbus TCP there is nothing to agree on.
pub(super) fn settle(
    line: &LineFile,
    models: &[OnLine],
    problems: &mut Vec<Problem>,
) -> Option<SettledLink> {
    if port::is_modbus_tcp(line) {
        let link = LinkSettings::DEFAULT;
        return Some(SettledLink {
            link,
            framing: Framing::Mbap,
            interface: Interface::Rs485,
        });
    }
    let given = (&line.framing, line.framing());
    let framing = choose(line, models, given, &FRAMING, problems);
    let given = (&line.interface, line.interface());
    let interface = choose(line, models, given, &INTERFACE, problems);
    let with = LineModels { models, framing };
    let baud = setting(line, with, &line.baud, &BAUD, |it| it.baud, problems);
    let data_bits = data_bits(line, with, problems);
    let parity = setting(line, with, &line.parity, &PARITY, |it| it.parity, problems);
    let stop_bits = setting(
        line,
        with,
        &line.stop_bits,
        &STOP_BITS,
        |it| it.stop_bits,
        problems,
    );
    let link = LinkSettings {
        baud: baud?,
        data_bits: data_bits?,
        parity: parity?,
        stop_bits: stop_bits?,
    };
    Some(SettledLink {
        link,
        framing: framing?,
        interface: interface?,
    })
}

/// RTU frames are bytes, so 7 data bits are invalid there. False if `given` is another number.
pub(super) fn rtu_has_bytes(
    given: &OptionalKey<u8>,
    framing: Option<Framing>,
    problems: &mut Vec<Problem>,
) -> bool {
    if let (OptionalKey::Valid(bits), Some(Framing::Rtu)) = (given, framing)
        && bits.value != RTU_DATA_BITS
    {
        let right = "8, or leave it out";
        bits.refuse("RTU frames need 8 data bits", right, problems);
        return false;
    }
    true
}

/// Data bits: 8 with RTU, or where no model has another choice; else as the models say.
fn data_bits(line: &LineFile, with: LineModels<'_>, problems: &mut Vec<Problem>) -> Option<u8> {
    let given = &line.data_bits;
    let LineModels { models, framing } = with;
    if !rtu_has_bytes(given, framing, problems) {
        return None;
    }
    if given.is_absent() && (framing != Some(Framing::Ascii) || !matters(models)) {
        let given = (given, Some(DEFAULT_DATA_BITS));
        return choose(line, models, given, &DATA_BITS, problems);
    }
    setting(line, with, given, &DATA_BITS, |it| it.data_bits, problems)
}

/// Whether a drive of the line may be set to other data bits than the default.
fn matters(models: &[OnLine]) -> bool {
    let mut bits = models.iter().flat_map(|it| &it.model.link.data_bits.value);
    bits.any(|bits| *bits != DEFAULT_DATA_BITS)
}

/// One part of the link settings, and the place of its allowed values in a model.
struct LinkPart<T: 'static> {
    name: &'static str,
    /// The value as written in a file.
    written: fn(T) -> String,
    allowed: fn(&ModelLink) -> &[T],
}

const FRAMING: LinkPart<Framing> = LinkPart {
    name: "framing",
    written: |it| quoted(word_for(&FRAMINGS, &it)),
    allowed: |link| &link.framings.value,
};
const INTERFACE: LinkPart<Interface> = LinkPart {
    name: "interface",
    written: |it| quoted(word_for(&INTERFACES, &it)),
    allowed: |link| &link.interfaces.value,
};
const BAUD: LinkPart<u32> = LinkPart {
    name: "baud",
    written: |it| it.to_string(),
    allowed: |link| &link.bauds.value,
};
const DATA_BITS: LinkPart<u8> = LinkPart {
    name: "data_bits",
    written: |it| it.to_string(),
    allowed: |link| &link.data_bits.value,
};
const PARITY: LinkPart<Parity> = LinkPart {
    name: "parity",
    written: |it| quoted(word_for(&PARITIES, &it)),
    allowed: |link| &link.parities.value,
};
const STOP_BITS: LinkPart<u8> = LinkPart {
    name: "stop_bits",
    written: |it| it.to_string(),
    allowed: |link| &link.stop_bits.value,
};

/// `value`, which is `given` or a fixed default, if every model supports it.
fn choose<T: Copy + PartialEq>(
    line: &LineFile,
    models: &[OnLine],
    (given, value): (&OptionalKey<T>, Option<T>),
    part: &LinkPart<T>,
    problems: &mut Vec<Problem>,
) -> Option<T> {
    let missing = line.location.missing(part.name);
    let location = given.location().unwrap_or(&missing);
    possible(location, models, value?, part, problems)
}

/// The value of a part that defaults to the models' common factory setting, which `factory` takes from their settings.
fn setting<T: Copy + PartialEq>(
    line: &LineFile,
    LineModels { models, framing }: LineModels<'_>,
    given: &OptionalKey<T>,
    part: &LinkPart<T>,
    factory: fn(LinkSettings) -> T,
    problems: &mut Vec<Problem>,
) -> Option<T> {
    match given {
        OptionalKey::Absent => shared_factory(line, models, framing?, part, factory, problems),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(written) => {
            possible(&written.location, models, written.value, part, problems)
        }
    }
}

/// `value`, if every model supports it.
fn possible<T: Copy + PartialEq>(
    location: &KeyLocation,
    models: &[OnLine],
    value: T,
    part: &LinkPart<T>,
    problems: &mut Vec<Problem>,
) -> Option<T> {
    let before = problems.len();
    for on_line in models {
        let allowed = (part.allowed)(&on_line.model.link);
        if !allowed.contains(&value) {
            let what = format!(
                "{} {} is not possible with {}",
                part.name,
                (part.written)(value),
                who(on_line)
            );
            location.refuse(what, list(part, allowed), problems);
        }
    }
    (problems.len() == before).then_some(value)
}

/// The factory setting common to all models. `None` without any model (all unknown).
fn shared_factory<T: Copy + PartialEq>(
    line: &LineFile,
    models: &[OnLine],
    framing: Framing,
    part: &LinkPart<T>,
    factory: fn(LinkSettings) -> T,
    problems: &mut Vec<Problem>,
) -> Option<T> {
    let (first, others) = models.split_first()?;
    let of_model = |on_line: &OnLine| on_line.model.link.factory_with(framing).map(factory);
    let known = of_model(first);
    if known.is_some() && others.iter().all(|other| of_model(other) == known) {
        return known;
    }
    let each = models.iter().map(|on_line| {
        let id = &on_line.model.id;
        match (of_model(on_line), &on_line.model.link.default.value) {
            (Some(value), _) => format!("{id} {}", (part.written)(value)),
            (None, FactorySetting::Set(of_ascii)) => {
                format!("the factory setting of {id} is ASCII frames at {of_ascii}")
            }
            (None, FactorySetting::Ask(text)) => format!("{id}: {text}"),
        }
    });
    let each = each.collect::<Vec<_>>().join(", ");
    let why = match models.iter().any(|on_line| of_model(on_line).is_none()) {
        true => "no factory setting can be assumed",
        false => "the models of the line have different factory settings",
    };
    let what = format!("`{}` is left out, and {why}: {each}", part.name);
    let right = advice(first, others, part);
    line.location
        .missing(part.name)
        .refuse(what, right, problems);
    None
}

/// What to write if the factory settings differ.
fn advice<T: Copy + PartialEq>(first: &OnLine, others: &[OnLine], part: &LinkPart<T>) -> String {
    let allowed = |on_line: &OnLine, value: &T| (part.allowed)(&on_line.model.link).contains(value);
    let mut shared = (part.allowed)(&first.model.link).to_vec();
    shared.retain(|value| others.iter().all(|other| allowed(other, value)));
    match shared.is_empty() {
        true => "a line for each model: no value can be set on all of them".to_owned(),
        false => format!(
            "add `{}`, and set it on every drive: {}",
            part.name,
            list(part, &shared)
        ),
    }
}

fn who(on_line: &OnLine) -> String {
    format!("{} ({})", on_line.model.id, on_line.drive.label())
}

fn list<T: Copy>(part: &LinkPart<T>, values: &[T]) -> String {
    let words: Vec<String> = values.iter().map(|value| (part.written)(*value)).collect();
    match words.as_slice() {
        [] => "nothing".to_owned(),
        [only] => format!("only {only}"),
        words => format!("one of {}", words.join(", ")),
    }
}

fn quoted(word: &str) -> String {
    format!("\"{word}\"")
}
