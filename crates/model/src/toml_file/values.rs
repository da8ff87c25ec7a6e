//! Kinds of TOML values: text, words, numbers with a range, durations with a unit.

use crate::domain::problem::nearest;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::time::Duration;
use toml::de::DeValue;

/// What is wrong with a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrongValue {
    /// The mistake, in one sentence.
    pub what: String,
    /// What would be right, if that is more precise than the kind's own sentence.
    pub right: Option<String>,
}

impl WrongValue {
    /// A mistake with the description `what`.
    #[must_use]
    pub fn new(what: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            right: None,
        }
    }
}

impl From<(String, String)> for WrongValue {
    /// From a description of the mistake, and what would be right.
    fn from((what, right): (String, String)) -> Self {
        Self {
            what,
            right: Some(right),
        }
    }
}

/// `text` as a message repeats it; one that may hold a password or its hash is not repeated.
fn quoted(text: &str) -> String {
    let has_user = text
        .split_once("://")
        .is_some_and(|(_, rest)| rest.contains('@'));
    if has_user || text.contains("$argon2") {
        "this text".to_owned()
    } else {
        format!("`{text}`")
    }
}

/// A kind of value: how it is read, and what is right for it, in words.
pub struct ValueKind<'k, T> {
    right: String,
    notation: String,
    read: Box<Read<'k, T>>,
}

type Read<'k, T> = dyn Fn(&DeValue<'_>) -> Result<T, WrongValue> + 'k;

impl<'k, T: 'k> ValueKind<'k, T> {
    /// What is right, as it follows "help:": `a whole number from 1 to 9`.
    #[must_use]
    pub fn right(&self) -> &str {
        &self.right
    }

    /// The valid values as a reference lists them: `1 to 9`.
    #[must_use]
    pub fn notation(&self) -> &str {
        &self.notation
    }

    /// This kind, listed in a reference as `notation`.
    #[must_use]
    pub fn listed_as(self, notation: impl Into<String>) -> Self {
        Self {
            notation: notation.into(),
            ..self
        }
    }

    /// Reads `value`.
    ///
    /// # Errors
    /// The value is of another kind or out of range.
    pub fn read(&self, value: &DeValue<'_>) -> Result<T, WrongValue> {
        (self.read)(value)
    }

    /// Text that `parse` turns into a value, or `None` if it is invalid. `right` says which text is valid.
    pub fn parsed(right: impl Into<String>, parse: impl Fn(&str) -> Option<T> + 'k) -> Self {
        Self::new(right.into(), move |value| {
            let text = as_text(value)?;
            parse(text).ok_or_else(|| WrongValue::new(format!("{} is not valid", quoted(text))))
        })
    }

    /// This kind, or the word `word`, which is read as `None`.
    #[must_use]
    pub fn or_word(self, word: &'static str) -> ValueKind<'k, Option<T>> {
        ValueKind {
            right: format!("\"{word}\" or {}", self.right),
            notation: format!("\"{word}\", or {}", self.notation),
            read: Box::new(move |value| match value {
                DeValue::String(text) if text == word => Ok(None),
                other => (self.read)(other).map(Some),
            }),
        }
    }

    /// The values of this kind turned by `turn`, which may refuse some.
    #[must_use]
    pub fn and_then<U>(self, turn: impl Fn(T) -> Result<U, WrongValue> + 'k) -> ValueKind<'k, U> {
        ValueKind {
            right: self.right,
            notation: self.notation,
            read: Box::new(move |value| turn((self.read)(value)?)),
        }
    }

    /// The values of this kind turned by `turn`.
    #[must_use]
    pub fn map<U>(self, turn: impl Fn(T) -> U + 'k) -> ValueKind<'k, U> {
        self.and_then(move |value| Ok(turn(value)))
    }

    fn new(right: String, read: impl Fn(&DeValue<'_>) -> Result<T, WrongValue> + 'k) -> Self {
        Self {
            notation: right.clone(),
            right,
            read: Box::new(read),
        }
    }
}

impl<'k, T: Copy + 'k> ValueKind<'k, T> {
    /// One of `words`, each of which stands for a value.
    #[must_use]
    pub fn one_of(words: &'k [(&'k str, T)]) -> Self {
        let list: Vec<_> = words
            .iter()
            .map(|(word, _)| format!("\"{word}\""))
            .collect();
        let right = if let [one] = &list[..] {
            one.clone()
        } else {
            format!("one of {}", list.join(", "))
        };
        Self::new(right, move |value| {
            let text = as_text(value)?;
            if let Some((_, found)) = words.iter().find(|(word, _)| *word == text) {
                return Ok(*found);
            }
            let near = nearest(text, words.iter().map(|(word, _)| *word));
            Err(WrongValue {
                what: format!("{} is not an allowed value", quoted(text)),
                right: near.map(|near| format!("\"{near}\"")),
            })
        })
        .listed_as(listed(words))
    }
}

/// `words` in quotes: `"none", "even" or "odd"`.
fn listed<T>(words: &[(&str, T)]) -> String {
    let mut list: Vec<_> = words
        .iter()
        .map(|(word, _)| format!("\"{word}\""))
        .collect();
    let last = list.pop().unwrap_or_default();
    if list.is_empty() {
        last
    } else {
        format!("{} or {last}", list.join(", "))
    }
}

impl<'k, T: Copy + 'k> ValueKind<'k, T> {
    /// One of `words`, each of which stands for a value that `means` something. For what decides what a motor does and who
    /// moves it: a word that is none of them is answered with all of them and their meanings, never with the nearest.
    #[must_use]
    pub fn choice(words: &'k [(&'k str, T)], means: impl Fn(T) -> &'static str) -> Self {
        let list: Vec<_> = words
            .iter()
            .map(|(word, value)| format!("\"{word}\" ({})", means(*value)))
            .collect();
        let right = if let [one] = &list[..] {
            one.clone()
        } else {
            format!("one of {}", list.join(", "))
        };
        Self::new(right, move |value| {
            let text = as_text(value)?;
            let found = words.iter().find(|(word, _)| *word == text);
            found
                .map(|(_, value)| *value)
                .ok_or_else(|| WrongValue::new(format!("{} is not an allowed value", quoted(text))))
        })
        .listed_as(listed(words))
    }
}

impl<'k, T: Copy + TryFrom<i64> + Into<i64> + Display + 'k> ValueKind<'k, T> {
    /// A whole number in `range`.
    #[must_use]
    pub fn number(range: RangeInclusive<T>) -> Self {
        let (least, most): (i64, i64) = ((*range.start()).into(), (*range.end()).into());
        let right = format!("a whole number from {least} to {most}");
        let between = if least + 1 == most { "or" } else { "to" };
        Self::new(right, move |value| in_range(value, &range))
            .listed_as(format!("{least} {between} {most}"))
    }
}

impl ValueKind<'_, u16> {
    /// An address of a register, best written in hexadecimal.
    #[must_use]
    pub fn address() -> Self {
        Self::new("an address from 0x0000 to 0xFFFF".to_owned(), |value| {
            in_range(value, &(0..=u16::MAX))
        })
    }
}

impl ValueKind<'_, String> {
    /// Text that is not blank.
    #[must_use]
    pub fn text() -> Self {
        Self::new("text, not empty".to_owned(), |value| {
            match as_text(value)?.trim() {
                "" => Err(WrongValue::new("is empty")),
                text => Ok(text.to_owned()),
            }
        })
        .listed_as("text")
    }
}

impl ValueKind<'_, bool> {
    /// `true` or `false`.
    #[must_use]
    pub fn flag() -> Self {
        Self::new("true or false".to_owned(), |value| match value {
            DeValue::Boolean(flag) => Ok(*flag),
            other => Err(WrongValue::new(format!(
                "must be true or false, not {}",
                kind_of(other)
            ))),
        })
    }
}

impl ValueKind<'_, f64> {
    /// A number in `range`, with or without a decimal point.
    #[must_use]
    pub fn decimal(range: RangeInclusive<f64>) -> Self {
        let list = format!("{} to {}", range.start(), range.end());
        Self::new(format!("a number from {list}"), move |value| {
            let text = match value {
                DeValue::Float(float) => float.as_str(),
                DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str(),
                other => {
                    return Err(WrongValue::new(format!(
                        "must be a number, not {}",
                        kind_of(other)
                    )));
                }
            };
            let number = text.parse().ok().filter(|number| range.contains(number));
            number.ok_or_else(|| WrongValue::new(format!("{text} is out of range")))
        })
        .listed_as(list)
    }
}

impl ValueKind<'_, Duration> {
    /// A time in `range`, as text with its unit: `500ms`, `5s`, `10min`, `1h`.
    #[must_use]
    pub fn duration(range: RangeInclusive<Duration>) -> Self {
        let least = duration_text(*range.start());
        let most = duration_text(*range.end());
        let list = format!("\"{least}\" to \"{most}\"");
        Self::new(format!("a time from {list}"), move |value| {
            let DeValue::String(text) = value else {
                return Err(WrongValue::new(format!(
                    "must be a time with its unit as text, not {}",
                    kind_of(value)
                )));
            };
            match parse_duration(text) {
                None => Err(WrongValue::new(format!(
                    "`{text}` is not a time; the units are ms, s, min, h"
                ))),
                Some(time) if !range.contains(&time) => {
                    Err(WrongValue::new(format!("{text} is out of range")))
                }
                Some(time) => Ok(time),
            }
        })
        .listed_as(list)
    }
}

/// `time` as a file has it, in the largest unit that divides it. Fractions of a millisecond are dropped.
#[must_use]
pub fn duration_text(time: Duration) -> String {
    let millis = time.as_millis();
    let (unit, size) = UNITS
        .into_iter()
        .rev()
        .find(|(_, size)| millis >= *size && millis.is_multiple_of(*size))
        .unwrap_or(UNITS[0]);
    format!("{}{unit}", millis / size)
}

/// Units of time, with their milliseconds.
const UNITS: [(&str, u128); 4] = [("ms", 1), ("s", 1_000), ("min", 60_000), ("h", 3_600_000)];

/// The duration in `text`, such as `500ms`; `None` if it is not one.
#[must_use]
pub fn parse_duration(text: &str) -> Option<Duration> {
    let digits = text.find(|c: char| !c.is_ascii_digit())?;
    let (number, unit) = text.split_at(digits);
    let (_, size) = UNITS.into_iter().find(|(name, _)| *name == unit)?;
    let millis = u128::from(number.parse::<u64>().ok()?) * size;
    u64::try_from(millis).ok().map(Duration::from_millis)
}

/// The type of `value`, as messages name it.
pub(super) const fn kind_of(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a decimal number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

fn as_text<'v>(value: &'v DeValue<'_>) -> Result<&'v str, WrongValue> {
    value
        .as_str()
        .ok_or_else(|| WrongValue::new(format!("must be text, not {}", kind_of(value))))
}

fn in_range<T: Copy + TryFrom<i64> + Into<i64>>(
    value: &DeValue<'_>,
    range: &RangeInclusive<T>,
) -> Result<T, WrongValue> {
    let DeValue::Integer(integer) = value else {
        return Err(WrongValue::new(format!(
            "must be a whole number, not {}",
            kind_of(value)
        )));
    };
    let (least, most): (i64, i64) = ((*range.start()).into(), (*range.end()).into());
    let number = i64::from_str_radix(integer.as_str(), integer.radix()).ok();
    let number = number
        .filter(|number| (least..=most).contains(number))
        .and_then(|number| T::try_from(number).ok());
    number.ok_or_else(|| WrongValue::new(format!("{integer} is out of range")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read<T>(kind: &ValueKind<'_, T>, text: &str) -> Result<T, String> {
        let value = DeValue::parse(text).unwrap();
        kind.read(value.get_ref()).map_err(|wrong| wrong.what)
    }

    #[test]
    fn numbers_keep_to_their_range_in_any_radix() {
        let kind = ValueKind::number(1..=247_u8);
        assert_eq!(read(&kind, "0xF7"), Ok(247));
        assert_eq!(read(&kind, "1"), Ok(1));
        assert_eq!(read(&kind, "0xF8"), Err("0xF8 is out of range".to_owned()));
        assert_eq!(read(&kind, "-1"), Err("-1 is out of range".to_owned()));
        assert_eq!(
            read(&kind, "99999999999999999999"),
            Err("99999999999999999999 is out of range".to_owned())
        );
        assert_eq!(
            read(&kind, "1.0"),
            Err("must be a whole number, not a decimal number".to_owned())
        );
        assert_eq!(read(&ValueKind::address(), "0xFFFF"), Ok(0xFFFF));
    }

    #[test]
    fn decimals_are_finite_and_in_range() {
        let kind = ValueKind::decimal(3.5..=100.0);
        assert_eq!(read(&kind, "4.5"), Ok(4.5));
        assert_eq!(read(&kind, "4"), Ok(4.0));
        for bad in ["3.4", "nan", "inf", "0x10", "'4'"] {
            assert!(read(&kind, bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn times_carry_their_unit() {
        let kind = ValueKind::duration(Duration::from_millis(1)..=Duration::from_secs(3600));
        assert_eq!(kind.right(), "a time from \"1ms\" to \"1h\"");
        for (text, millis) in [
            ("'500ms'", 500),
            ("'5s'", 5_000),
            ("'10min'", 600_000),
            ("'1h'", 3_600_000),
        ] {
            assert_eq!(
                read(&kind, text),
                Ok(Duration::from_millis(millis)),
                "{text}"
            );
        }
        for bad in [
            "'500'",
            "'ms'",
            "''",
            "'1.5s'",
            "'-1s'",
            "'1 s'",
            "'2h'",
            "'0ms'",
            "5",
            "'99999999999999999999s'",
        ] {
            assert!(read(&kind, bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn times_are_shown_in_their_largest_unit() {
        for (millis, text) in [
            (0, "0ms"),
            (500, "500ms"),
            (1_500, "1500ms"),
            (5_000, "5s"),
            (3_600_000, "1h"),
        ] {
            assert_eq!(duration_text(Duration::from_millis(millis)), text);
        }
    }

    #[test]
    fn a_slip_of_the_pen_in_a_word_is_named() {
        let kind = ValueKind::one_of(&[("none", 0), ("even", 1)]);
        let wrong = kind
            .read(DeValue::parse("'evne'").unwrap().get_ref())
            .unwrap_err();
        assert_eq!(wrong.right.as_deref(), Some("\"even\""));
        assert_eq!(kind.right(), "one of \"none\", \"even\"");
        assert_eq!(read(&kind.or_word("auto"), "'auto'"), Ok(None));
    }

    #[test]
    fn a_choice_is_never_guessed() {
        let kind = ValueKind::choice(&[("stop", 0), ("hold", 1)], |it| {
            if it == 0 { "it stops" } else { "it goes on" }
        });
        let wrong = kind
            .read(DeValue::parse("'halt'").unwrap().get_ref())
            .unwrap_err();
        assert_eq!(wrong, WrongValue::new("`halt` is not an allowed value"));
        assert_eq!(
            kind.right(),
            "one of \"stop\" (it stops), \"hold\" (it goes on)"
        );
        assert_eq!(read(&kind, "'hold'"), Ok(1));
    }

    #[test]
    fn text_is_trimmed_and_not_empty() {
        assert_eq!(read(&ValueKind::text(), "' a '"), Ok("a".to_owned()));
        assert_eq!(read(&ValueKind::text(), "' '"), Err("is empty".to_owned()));
        assert_eq!(
            read(
                &ValueKind::parsed("a letter", |text| text.chars().next()),
                "''"
            ),
            Err("`` is not valid".to_owned())
        );
        assert_eq!(read(&ValueKind::flag(), "true"), Ok(true));
    }
}
