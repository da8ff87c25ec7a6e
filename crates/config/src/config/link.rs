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

/// A model of a line, with the first drive that has it.
pub(super) struct OnLine<'a> {
    pub model: &'a Model,
    pub drive: &'a DriveFile,
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
    let framing = choose(
        line,
        models,
        &line.framing,
        line.framing(),
        &FRAMING,
        problems,
    );
    let interface = choose(
        line,
        models,
        &line.interface,
        line.interface(),
        &INTERFACE,
        problems,
    );
    let baud = setting(line, models, framing, &line.baud, &BAUD, problems);
    let data_bits = data_bits(line, models, framing, problems);
    let parity = setting(line, models, framing, &line.parity, &PARITY, problems);
    let stop_bits = setting(line, models, framing, &line.stop_bits, &STOP_BITS, problems);
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

/// Data bits: RTU frames are bytes, so 7 bits are invalid there whatever the models support.
fn data_bits(
    line: &LineFile,
    models: &[OnLine],
    framing: Option<Framing>,
    problems: &mut Vec<Problem>,
) -> Option<u8> {
    match (&line.data_bits, framing) {
        (OptionalKey::Valid(written), Some(Framing::Rtu)) if written.value != 8 => {
            problems.push(
                written
                    .location
                    .problem("RTU frames need 8 data bits")
                    .right("8, or leave it out"),
            );
            None
        }
        // RTU, or any framing with one choice only.
        (OptionalKey::Absent, framing) if framing != Some(Framing::Ascii) || !matters(models) => {
            choose(
                line,
                models,
                &line.data_bits,
                Some(DEFAULT_DATA_BITS),
                &DATA_BITS.part,
                problems,
            )
        }
        (given, framing) => setting(line, models, framing, given, &DATA_BITS, problems),
    }
}

/// Whether a drive of the line may be set to other data bits than the default.
fn matters(models: &[OnLine]) -> bool {
    models.iter().any(|on_line| {
        on_line
            .model
            .link
            .data_bits
            .value
            .iter()
            .any(|bits| *bits != DEFAULT_DATA_BITS)
    })
}

/// One part of the link settings, and the place of its allowed values in a model.
struct LinkPart<T: 'static> {
    name: &'static str,
    /// The value as written in a file.
    written: fn(T) -> String,
    allowed: fn(&ModelLink) -> &[T],
}

/// A part for which models have a factory setting.
struct FactoryPart<T: 'static> {
    part: LinkPart<T>,
    factory: fn(LinkSettings) -> T,
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
const BAUD: FactoryPart<u32> = FactoryPart {
    part: LinkPart {
        name: "baud",
        written: |it| it.to_string(),
        allowed: |link| &link.bauds.value,
    },
    factory: |link| link.baud,
};
const DATA_BITS: FactoryPart<u8> = FactoryPart {
    part: LinkPart {
        name: "data_bits",
        written: |it| it.to_string(),
        allowed: |link| &link.data_bits.value,
    },
    factory: |link| link.data_bits,
};
const PARITY: FactoryPart<Parity> = FactoryPart {
    part: LinkPart {
        name: "parity",
        written: |it| quoted(word_for(&PARITIES, &it)),
        allowed: |link| &link.parities.value,
    },
    factory: |link| link.parity,
};
const STOP_BITS: FactoryPart<u8> = FactoryPart {
    part: LinkPart {
        name: "stop_bits",
        written: |it| it.to_string(),
        allowed: |link| &link.stop_bits.value,
    },
    factory: |link| link.stop_bits,
};

/// `value`, which is `given` or a fixed default, if every model supports it.
fn choose<T: Copy + PartialEq>(
    line: &LineFile,
    models: &[OnLine],
    given: &OptionalKey<T>,
    value: Option<T>,
    part: &LinkPart<T>,
    problems: &mut Vec<Problem>,
) -> Option<T> {
    let location = match given {
        OptionalKey::Valid(written) => written.location.clone(),
        _ => line.location.missing(part.name),
    };
    possible(&location, models, value?, part, problems)
}

/// The value of a part that defaults to the models' common factory setting.
fn setting<T: Copy + PartialEq>(
    line: &LineFile,
    models: &[OnLine],
    framing: Option<Framing>,
    given: &OptionalKey<T>,
    it: &FactoryPart<T>,
    problems: &mut Vec<Problem>,
) -> Option<T> {
    match given {
        OptionalKey::Absent => shared_factory(line, models, framing?, it, problems),
        OptionalKey::Invalid => None,
        OptionalKey::Valid(written) => {
            possible(&written.location, models, written.value, &it.part, problems)
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
            problems.push(location.problem(what).right(list(part, allowed)));
        }
    }
    (problems.len() == before).then_some(value)
}

/// The factory setting common to all models. `None` without any model (all unknown).
fn shared_factory<T: Copy + PartialEq>(
    line: &LineFile,
    models: &[OnLine],
    framing: Framing,
    it: &FactoryPart<T>,
    problems: &mut Vec<Problem>,
) -> Option<T> {
    let (first, others) = models.split_first()?;
    let factory = |on_line: &OnLine| on_line.model.link.factory_with(framing).map(it.factory);
    let known = factory(first);
    if known.is_some() && others.iter().all(|other| factory(other) == known) {
        return known;
    }
    let each =
        models.iter().map(
            |on_line| match (factory(on_line), &on_line.model.link.default.value) {
                (Some(value), _) => format!("{} {}", on_line.model.id, (it.part.written)(value)),
                (None, FactorySetting::Set(of_ascii)) => {
                    format!(
                        "the factory setting of {} is ASCII frames at {of_ascii}",
                        on_line.model.id
                    )
                }
                (None, FactorySetting::Ask(text)) => format!("{}: {text}", on_line.model.id),
            },
        );
    let each = each.collect::<Vec<_>>().join(", ");
    let what = match models.iter().any(|on_line| factory(on_line).is_none()) {
        true => format!(
            "`{}` is left out, and no factory setting can be assumed: {each}",
            it.part.name
        ),
        false => {
            format!(
                "`{}` is left out, and the models of the line have different factory settings: {each}",
                it.part.name
            )
        }
    };
    problems.push(
        line.location
            .missing(it.part.name)
            .problem(what)
            .right(advice(first, others, &it.part)),
    );
    None
}

/// What to write if the factory settings differ.
fn advice<T: Copy + PartialEq>(first: &OnLine, others: &[OnLine], part: &LinkPart<T>) -> String {
    let on_all = |value: &&T| {
        others
            .iter()
            .all(|other| (part.allowed)(&other.model.link).contains(value))
    };
    let shared: Vec<T> = (part.allowed)(&first.model.link)
        .iter()
        .filter(on_all)
        .copied()
        .collect();
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
