//! The words of a command in JSON, by whatever way it comes: everything that is not exactly known is refused by name.

use crate::domain::command::{Direction, Reason};
use crate::domain::frequency::{Hertz, NoFrequency};
use crate::domain::problem::nearest;
use serde_json::{Map, Value};

/// Why something that was to be a command is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// By its number and word.
    pub reason: Reason,
    /// What is wrong and what would be right, for people.
    pub message: String,
}

impl Refused {
    /// With words of its own.
    #[must_use]
    pub fn new(reason: Reason, message: impl Into<String>) -> Self {
        Self { reason, message: message.into() }
    }

    /// With the words that the reason has for itself.
    #[must_use]
    pub fn plain(reason: Reason) -> Self {
        Self::new(reason, reason.text())
    }
}

/// What a run command may say, for people.
pub const RUN_EXAMPLE: &str = "`forward`, `reverse`, `stop` or `coast`";

/// A word of `run/set` and of `run`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunWord {
    /// Run in this direction.
    Run(Direction),
    /// Decelerate and stop.
    Stop,
    /// Cut the output off.
    Coast,
}

/// The word that `text` is, trimmed, in any case.
///
/// # Errors
/// It is none of them.
pub fn run_word(text: &str) -> Result<RunWord, Refused> {
    let table = [
        ("forward", RunWord::Run(Direction::Forward)),
        ("reverse", RunWord::Run(Direction::Reverse)),
        ("stop", RunWord::Stop),
        ("coast", RunWord::Coast),
    ];
    let found = table.iter().find(|(word, _)| text.trim().eq_ignore_ascii_case(word));
    found.map(|(_, word)| *word).ok_or_else(|| unknown_word(text, RUN_EXAMPLE))
}

/// Why the value of `key`, written as `text`, is no frequency.
#[must_use]
pub fn no_frequency(why: NoFrequency, key: &str, text: &str) -> Refused {
    let reason = match why {
        NoFrequency::NotANumber => Reason::NotANumber,
        NoFrequency::OutOfRange => Reason::OutsideLimits,
        NoFrequency::TooFine => Reason::BetweenSteps,
    };
    let message = format!("`{key}` takes hertz with a decimal point, such as 42.5; `{}` is {why}", short(text));
    Refused::new(reason, message)
}

/// A word that is not known, where `right` would be.
#[must_use]
pub fn unknown_word(text: &str, right: &str) -> Refused {
    Refused::new(Reason::NotUnderstood, format!("`{}` is not known here; right is {right}", short(text)))
}

/// So much of `text` as a message shows.
#[must_use]
pub fn short(text: &str) -> String {
    const CHARS_MAX: usize = 40;
    let mut short: String = text.chars().take(CHARS_MAX).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}

/// The JSON object that `payload` writes; `example` shows people one.
///
/// # Errors
/// It writes none.
pub fn object(payload: &[u8], example: &str) -> Result<Map<String, Value>, Refused> {
    match serde_json::from_slice(payload) {
        Ok(Value::Object(object)) => Ok(object),
        Ok(_) => Err(not_understood(format!("a JSON object was expected, such as {example}"))),
        Err(error) => Err(not_understood(format!("no JSON ({error}); right is, for example, {example}"))),
    }
}

/// Whether `object` has keys of `keys` alone.
///
/// # Errors
/// It has another one, which is named.
pub fn known_keys(object: &Map<String, Value>, keys: &[&str]) -> Result<(), Refused> {
    let Some(key) = object.keys().find(|key| !keys.contains(&key.as_str())) else { return Ok(()) };
    let near = (key.len() <= 64).then(|| nearest(key, keys.iter().copied())).flatten();
    let right = near.map_or_else(|| format!("known are {}", keys.join(", ")), |near| format!("is it `{near}`?"));
    Err(not_understood(format!("`{}` is not known; {right}", short(key))))
}

/// Whether each key of `object`, which `payload` writes, stands there once.
///
/// # Errors
/// One stands there twice.
pub fn keys_stand_once(payload: &[u8], object: &Map<String, Value>) -> Result<(), Refused> {
    if pairs_written(payload) == pairs_in(object) { Ok(()) } else { Err(not_understood("a key stands there twice")) }
}

/// Pairs of key and value that the valid JSON text `payload` writes.
fn pairs_written(payload: &[u8]) -> usize {
    let (mut pairs, mut in_text, mut is_escaped) = (0, false, false);
    for byte in payload {
        match byte {
            _ if is_escaped => is_escaped = false,
            b'\\' => is_escaped = true,
            b'"' => in_text = !in_text,
            b':' if !in_text => pairs += 1,
            _ => {}
        }
    }
    pairs
}

/// Pairs that are left of it: of two with the same key only one is.
fn pairs_in(object: &Map<String, Value>) -> usize {
    object.len() + object.values().map(pairs_below).sum::<usize>()
}

fn pairs_below(value: &Value) -> usize {
    match value {
        Value::Object(object) => pairs_in(object),
        Value::Array(array) => array.iter().map(pairs_below).sum(),
        _ => 0,
    }
}

/// The word of `run`.
///
/// # Errors
/// It is none of those that are known.
pub fn run(object: &Map<String, Value>) -> Result<Option<RunWord>, Refused> {
    match object.get("run") {
        None => Ok(None),
        Some(Value::String(text)) => run_word(text).map(Some),
        Some(_) => Err(not_understood("`run` takes \"forward\", \"reverse\", \"stop\" or \"coast\"")),
    }
}

/// The frequency of `frequency_hz`.
///
/// # Errors
/// It is none.
pub fn frequency(object: &Map<String, Value>) -> Result<Option<Hertz>, Refused> {
    let Some(value) = object.get("frequency_hz") else { return Ok(None) };
    let number = value.as_f64().ok_or_else(|| not_a_number("frequency_hz", "42.5"))?;
    let frequency = Hertz::from_f64(number).map_err(|why| no_frequency(why, "frequency_hz", &value.to_string()))?;
    Ok(Some(frequency))
}

/// Whether `key` is there, which takes true alone.
///
/// # Errors
/// It is something else.
pub fn only_true(object: &Map<String, Value>, key: &str) -> Result<bool, Refused> {
    match object.get(key) {
        None => Ok(false),
        Some(Value::Bool(true)) => Ok(true),
        Some(_) => Err(not_understood(format!("`{key}` takes true and nothing else"))),
    }
}

/// Refused because it is not understood.
#[must_use]
pub fn not_understood(message: impl Into<String>) -> Refused {
    Refused::new(Reason::NotUnderstood, message)
}

/// Refused because the value of `key` is no number.
#[must_use]
pub fn not_a_number(key: &str, example: &str) -> Refused {
    Refused::new(Reason::NotANumber, format!("`{key}` takes a number, such as {example}"))
}
