//! Values as people write them: times, numbers, words, names, frequencies, fault plans.

use super::text;
use std::ops::RangeInclusive;
use std::path::Path;
use std::time::Duration;
use vfd_model::domain::frequency::Hertz;
use vfd_model::domain::ids::Name;
use vfd_model::toml_file::values::{ValueKind, duration_text};
use vfd_model::toml_file::words::PARITIES;
use vfd_model::toml_file::{OptionalKey, TableReader, document};
use vfd_sim::sim::FaultPlan;

const TIMES: RangeInclusive<Duration> = Duration::from_millis(1)..=Duration::from_secs(3600);
const NUMBERS: RangeInclusive<u8> = 1..=247;
const DECIMALS: RangeInclusive<f64> = 0.001..=100_000.0;

pub fn run(bytes: &[u8]) {
    let Some(text) = text::of(bytes) else { return };
    time(text);
    number(text);
    frequency(text);
    other_kinds(text);
    if let Some(name) = Name::new(text) {
        let topic = Path::new("base").join(name.as_str());
        assert!(
            (name.as_str(), name.as_str().len() <= Name::MAX_CHARS) == (text, true),
            "{text}"
        );
        assert_eq!(
            topic.components().count(),
            if text == "." { 1 } else { 2 },
            "{text} is more than one level"
        );
    }
    if let Err(error) = text.parse::<FaultPlan>() {
        assert!(!error.to_string().is_empty());
    }
}

/// What `kind` reads from a file in which `text` is the literal value of a key.
fn read<T>(text: &str, kind: &ValueKind<'_, T>) -> Option<T> {
    let file = format!("v = {text}");
    let mut problems = Vec::new();
    let Some(document) = document(&file, &mut problems) else {
        text::check_problems(&file, &problems);
        return None;
    };
    let mut reader = TableReader::new(document.section(), &mut problems);
    let given = reader.optional("v", kind);
    reader.finish();
    match given {
        OptionalKey::Valid(written) => Some(written.value),
        OptionalKey::Absent => panic!("`v` stands there"),
        OptionalKey::Invalid => {
            assert!(
                problems
                    .iter()
                    .any(|problem| problem.key == "v" && problem.right.is_some()),
                "{problems:?}"
            );
            None
        }
    }
}

/// A time is in its range and survives being shown and parsed.
fn time(text: &str) {
    let kind = ValueKind::duration(TIMES);
    for quoted in [text.to_owned(), format!("'{text}'")] {
        let Some(time) = read(&quoted, &kind) else {
            continue;
        };
        assert!(TIMES.contains(&time), "{time:?}");
        assert_eq!(
            read(&format!("'{}'", duration_text(time)), &kind),
            Some(time)
        );
    }
}

fn number(text: &str) {
    if let Some(number) = read(text, &ValueKind::number(NUMBERS)) {
        assert!(NUMBERS.contains(&number));
        assert_eq!(
            read(&format!("{number:#x}"), &ValueKind::number(NUMBERS)),
            Some(number)
        );
    }
    if let Some(decimal) = read(text, &ValueKind::decimal(DECIMALS)) {
        assert!(DECIMALS.contains(&decimal), "{decimal}");
    }
    if let Some(address) = read(text, &ValueKind::address()) {
        assert_eq!(
            read(&address.to_string(), &ValueKind::address()),
            Some(address)
        );
    }
}

/// A frequency is exact: it survives being shown and parsed.
fn frequency(text: &str) {
    if let Ok(hertz) = Hertz::parse(text) {
        assert_eq!(Hertz::parse(&hertz.to_string()), Ok(hertz), "{text}");
        for scale in [1, 10, 100] {
            let word = hertz.to_word(scale);
            assert!(
                word.is_none_or(|word| Hertz::from_word(word, scale) == hertz),
                "{text} at {scale}"
            );
        }
    }
}

fn other_kinds(text: &str) {
    read(text, &ValueKind::flag());
    read(text, &ValueKind::text().or_word("auto"));
    let parity = read(&format!("'{text}'"), &ValueKind::one_of(&PARITIES));
    assert!(
        parity.is_none() || PARITIES.iter().any(|(word, _)| *word == text),
        "{text}"
    );
}
