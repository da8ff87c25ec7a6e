//! The words of a command in JSON, for all interfaces: everything that is not exactly known is refused by name.

use crate::domain::command::{Direction, GoOrder, Order, Reason, RegisterWrite};
use crate::domain::frequency::{Hertz, NoFrequency};
use crate::domain::problem::nearest;
use crate::profile::scale::Decimal;
use serde_json::{Map, Value};

/// Why an intended command is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RefusedCommand {
    /// Its reason, with number and word.
    pub reason: Reason,
    /// What is wrong and what would be right, for people.
    pub message: String,
}

impl RefusedCommand {
    /// With a message of its own.
    #[must_use]
    pub fn new(reason: Reason, message: impl Into<String>) -> Self {
        Self {
            reason,
            message: message.into(),
        }
    }

    /// With the message that the reason has.
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

/// The word that `text` is, trimmed, ignoring case.
///
/// # Errors
/// It is none of them.
pub fn run_word(text: &str) -> Result<RunWord, RefusedCommand> {
    let table = [
        ("forward", RunWord::Run(Direction::Forward)),
        ("reverse", RunWord::Run(Direction::Reverse)),
        ("stop", RunWord::Stop),
        ("coast", RunWord::Coast),
    ];
    let found = table
        .iter()
        .find(|(word, _)| text.trim().eq_ignore_ascii_case(word));
    found
        .map(|(_, word)| *word)
        .ok_or_else(|| unknown_word(text, RUN_EXAMPLE))
}

/// Refuses the value of `key`, written as `text`, as no frequency. `step`: that of the drive's setpoint, where it is known.
#[must_use]
pub fn no_frequency(
    why: NoFrequency,
    key: &str,
    text: &str,
    step: Option<Decimal>,
) -> RefusedCommand {
    let reason = match why {
        NoFrequency::NotANumber => Reason::NotANumber,
        NoFrequency::OutOfRange => Reason::OutsideLimits,
        NoFrequency::TooFine => Reason::BetweenSteps,
    };
    let why = match step {
        Some(step) if why == NoFrequency::TooFine => {
            format!("between the drive's steps of {step} Hz")
        }
        _ => why.to_string(),
    };
    let message = format!(
        "`{key}` takes hertz with a decimal point, such as 42.5; `{}` is {why}",
        short(text)
    );
    RefusedCommand::new(reason, message)
}

/// Refuses an unknown word where `right` is expected.
#[must_use]
pub fn unknown_word(text: &str, right: &str) -> RefusedCommand {
    RefusedCommand::new(
        Reason::NotUnderstood,
        format!("`{}` is not valid here; expected {right}", short(text)),
    )
}

/// The part of `text` that a message shows.
#[must_use]
pub fn short(text: &str) -> String {
    const CHARS_MAX: usize = 40;
    let mut short: String = text.chars().take(CHARS_MAX).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}

/// `payload` without the byte order mark that some editors and languages write before text.
#[must_use]
pub fn without_mark(payload: &[u8]) -> &[u8] {
    payload.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(payload)
}

/// The JSON object in `payload`; `example` is shown to people.
///
/// # Errors
/// `payload` is not a JSON object.
pub fn object(payload: &[u8], example: &str) -> Result<Map<String, Value>, RefusedCommand> {
    match serde_json::from_slice(without_mark(payload)) {
        Ok(Value::Object(object)) => Ok(object),
        Ok(_) => Err(not_understood(format!(
            "a JSON object was expected, such as {example}"
        ))),
        Err(error) => Err(not_understood(format!(
            "invalid JSON ({error}); an example: {example}"
        ))),
    }
}

/// Checks that `object`, which `payload` contains, has only keys of `keys`, and none of them twice.
///
/// # Errors
/// It has another one, which is named, or one occurs twice.
pub fn exact_keys(
    payload: &[u8],
    object: &Map<String, Value>,
    keys: &[&str],
) -> Result<(), RefusedCommand> {
    known_keys(object, keys)?;
    if pairs_written(payload) == pairs_in(object) {
        Ok(())
    } else {
        Err(not_understood("a key occurs twice"))
    }
}

/// Checks that `object` has only keys of `keys`.
fn known_keys(object: &Map<String, Value>, keys: &[&str]) -> Result<(), RefusedCommand> {
    let Some(key) = object.keys().find(|key| !keys.contains(&key.as_str())) else {
        return Ok(());
    };
    let near = (key.len() <= 64)
        .then(|| nearest(key, keys.iter().copied()))
        .flatten();
    let right = near.map_or_else(
        || format!("known keys: {}", keys.join(", ")),
        |near| format!("is it `{near}`?"),
    );
    Err(not_understood(format!(
        "`{}` is unknown; {right}",
        short(key)
    )))
}

/// Number of key-value pairs written in the valid JSON text `payload`.
fn pairs_written(payload: &[u8]) -> usize {
    let mut pairs = 0;
    let mut in_text = false;
    let mut is_escaped = false;
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

/// Number of pairs that remain after parsing: of two with the same key only one is left.
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

/// How much of a payload is searched for a stop, in bytes, however long it is.
pub const STOP_WITHIN_BYTES: usize = 8 * 1024;

/// The stop that `payload` orders, whatever else it contains and whether or not it is complete JSON: the word of a
/// `run` of its object, of any of them if there are several, or the word alone. Only the first bytes are searched.
#[must_use]
pub fn stop_in(payload: &[u8]) -> Option<RunWord> {
    let payload = payload.get(..STOP_WITHIN_BYTES).unwrap_or(payload);
    let mut rest = without_mark(payload).trim_ascii_start();
    if rest.first() != Some(&b'{') {
        return stop_alone(rest.trim_ascii_end());
    }
    let mut depth = 0_usize;
    let mut found = None;
    while let Some((first, after)) = rest.split_first() {
        match first {
            b'{' | b'[' => depth += 1,
            b'}' | b']' => depth = depth.saturating_sub(1),
            b'"' => {
                let Some((key, behind)) = text_at(rest) else {
                    return found;
                };
                let value = behind
                    .trim_ascii_start()
                    .strip_prefix(b":")
                    .map(<[u8]>::trim_ascii_start);
                let is_run = depth == 1 && is_text(key, "run");
                match value
                    .filter(|value| is_run && value.first() == Some(&b'"'))
                    .and_then(text_at)
                {
                    Some((word, behind)) => {
                        match text_of(word).as_deref().map(run_word) {
                            Some(Ok(RunWord::Stop)) => return Some(RunWord::Stop),
                            Some(Ok(RunWord::Coast)) => found = Some(RunWord::Coast),
                            _ => {}
                        }
                        rest = behind;
                    }
                    None => rest = behind,
                }
                continue;
            }
            _ => {}
        }
        rest = after;
    }
    found
}

/// The stop that `word` is, with or without quotes.
fn stop_alone(word: &[u8]) -> Option<RunWord> {
    let word = text_of(word).or_else(|| std::str::from_utf8(word).ok().map(str::to_owned))?;
    run_word(&word)
        .ok()
        .filter(|word| matches!(word, RunWord::Stop | RunWord::Coast))
}

/// The quoted text that `bytes` begin with, including quotes, and what follows; `None` if it does not end.
fn text_at(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let mut is_escaped = false;
    let end = bytes.iter().skip(1).position(|byte| {
        let is_end = *byte == b'"' && !is_escaped;
        is_escaped = *byte == b'\\' && !is_escaped;
        is_end
    })?;
    bytes.split_at_checked(end + 2)
}

fn text_of(quoted: &[u8]) -> Option<String> {
    serde_json::from_slice(quoted).ok()
}

fn is_text(quoted: &[u8], text: &str) -> bool {
    // Nothing longer is equal, even with every character escaped.
    quoted.len() <= 2 + 6 * text.len() && text_of(quoted).as_deref() == Some(text)
}

/// The remark on what else a message with a stop contains.
#[must_use]
pub fn beside_a_stop(refused: &RefusedCommand) -> String {
    format!("the stop was taken all the same: {}", refused.message)
}

/// Longest number, in characters.
pub const NUMBER_CHARS_MAX: usize = 32;

/// Checks that `text`, which is to be a number as in `example`, is not longer than one.
///
/// # Errors
/// It is longer.
pub fn short_number(text: &str, example: &str) -> Result<(), RefusedCommand> {
    if text.len() <= NUMBER_CHARS_MAX {
        return Ok(());
    }
    let message = format!(
        "`{}` is longer than {NUMBER_CHARS_MAX} characters; an example: {example}",
        short(text)
    );
    Err(not_understood(message))
}

/// What the keys `run`, `frequency_hz` and `reset` of a command order. A stop excludes the others, whatever they say.
#[derive(Clone, Debug, PartialEq)]
pub enum OrderWords {
    /// A stop, or coasting.
    Stop(Order),
    /// Something else, or nothing.
    Other {
        /// Run in this direction.
        run: Option<Direction>,
        /// The frequency.
        frequency: Option<Hertz>,
        /// Reset a trip.
        is_reset: bool,
    },
}

impl OrderWords {
    /// The words in `object`, for a drive whose setpoint has this step.
    ///
    /// # Errors
    /// One of them is not valid.
    pub fn read(
        object: &Map<String, Value>,
        step: Option<Decimal>,
    ) -> Result<Self, RefusedCommand> {
        let run = match run(object)? {
            Some(RunWord::Stop) => return Ok(Self::Stop(Order::Stop { setpoint: None })),
            Some(RunWord::Coast) => return Ok(Self::Stop(Order::Coast)),
            Some(RunWord::Run(direction)) => Some(direction),
            None => None,
        };
        Ok(Self::Other {
            run,
            frequency: frequency(object, step)?,
            is_reset: only_true(object, "reset")?,
        })
    }

    /// The order, together with writes to `registers`; `None` if there is nothing to order.
    ///
    /// # Errors
    /// A reset does not stand alone, or the order needs too many frames.
    pub fn order(self, registers: Vec<RegisterWrite>) -> Result<Option<Order>, RefusedCommand> {
        let (run, frequency, is_reset) = match self {
            Self::Stop(order) => return Ok(Some(order)),
            Self::Other {
                run,
                frequency,
                is_reset,
            } => (run, frequency, is_reset),
        };
        let has_more = run.is_some() || frequency.is_some() || !registers.is_empty();
        match (is_reset, has_more) {
            (true, true) => Err(RefusedCommand::new(
                Reason::Conflict,
                "`reset` stands alone: send the rest after it",
            )),
            (true, false) => Ok(Some(Order::Reset)),
            (false, false) => Ok(None),
            (false, true) => GoOrder::new(registers, frequency, run)
                .map(|go| Some(Order::Go(go)))
                .ok_or_else(|| RefusedCommand::plain(Reason::TooManyFrames)),
        }
    }
}

/// Refused because it orders nothing; `example` is shown to people.
#[must_use]
pub fn orders_nothing(example: &str) -> RefusedCommand {
    not_understood(format!("the command orders nothing; an example: {example}"))
}

/// The word of `run`.
fn run(object: &Map<String, Value>) -> Result<Option<RunWord>, RefusedCommand> {
    match object.get("run") {
        None => Ok(None),
        Some(Value::String(text)) => run_word(text).map(Some),
        Some(_) => Err(not_understood(
            "`run` takes \"forward\", \"reverse\", \"stop\" or \"coast\"",
        )),
    }
}

/// The frequency of `frequency_hz`.
fn frequency(
    object: &Map<String, Value>,
    step: Option<Decimal>,
) -> Result<Option<Hertz>, RefusedCommand> {
    let Some(value) = object.get("frequency_hz") else {
        return Ok(None);
    };
    let number = value
        .as_f64()
        .ok_or_else(|| not_a_number("frequency_hz", "42.5"))?;
    let frequency = Hertz::from_f64(number);
    let frequency =
        frequency.map_err(|why| no_frequency(why, "frequency_hz", &value.to_string(), step))?;
    Ok(Some(frequency))
}

/// Whether `key` is present, which takes only true.
///
/// # Errors
/// The value of `key` is something else.
pub fn only_true(object: &Map<String, Value>, key: &str) -> Result<bool, RefusedCommand> {
    match object.get(key) {
        None => Ok(false),
        Some(Value::Bool(true)) => Ok(true),
        Some(_) => Err(not_understood(format!("`{key}` accepts only true"))),
    }
}

/// Refused because it is not understood.
#[must_use]
pub fn not_understood(message: impl Into<String>) -> RefusedCommand {
    RefusedCommand::new(Reason::NotUnderstood, message)
}

/// Refused because the value of `key` is no number.
#[must_use]
pub fn not_a_number(key: &str, example: &str) -> RefusedCommand {
    RefusedCommand::new(
        Reason::NotANumber,
        format!("`{key}` takes a number, such as {example}"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_is_found_whatever_stands_beside_it() {
        for text in [
            r#"{"run":"stop"}"#,
            r#" { "run" : " STOP " , "x": 1 }"#,
            r#"{"run":"forward","run":"stop"}"#,
            r#"{"run":"stop","run":"forward"}"#,
            r#"{"run":"coast","run":"stop"}"#,
            r#"{"a":{"run":"forward"},"b":[1,{"c":"}"}],"run":"stop","run":7}"#,
            r#"{"\u0072un":"\u0073top"}"#,
            r#"{"x":"\"","run":"stop""#,
            r#"{"run":"stop"} x"#,
            r#"{"run":"stop","x":"#,
            r#"{"run":"stop","x":"not ended"#,
            "\u{FEFF}{\"run\":\"stop\"}",
            // The word alone, as on `run/set`.
            "stop",
            " STOP\n",
            "\u{FEFF}stop",
            r#""stop""#,
        ] {
            assert_eq!(stop_in(text.as_bytes()), Some(RunWord::Stop), "{text}");
        }
        assert_eq!(
            stop_in(br#"{"run":"coast","run":"forward"}"#),
            Some(RunWord::Coast)
        );
        assert_eq!(stop_in(b"coast"), Some(RunWord::Coast));
        assert_eq!(
            stop_in(b"{\"run\":\"stop\",\"x\":\"\xFF\"}"),
            Some(RunWord::Stop)
        );
        let large = format!(r#"{{"run":"stop","x":"{}"}}"#, "x".repeat(1_000_000));
        assert_eq!(stop_in(large.as_bytes()), Some(RunWord::Stop));
        let late = format!(
            r#"{{"x":"{}","run":"stop"}}"#,
            "x".repeat(STOP_WITHIN_BYTES)
        );
        assert_eq!(stop_in(late.as_bytes()), None, "beyond the searched bytes");
    }

    #[test]
    fn a_byte_order_mark_is_no_part_of_an_object() {
        let read = object("\u{FEFF}{\"run\": \"forward\"}".as_bytes(), "{}").unwrap();
        assert_eq!(run(&read), Ok(Some(RunWord::Run(Direction::Forward))));
        assert!(object("{\u{FEFF}}".as_bytes(), "{}").is_err());
    }

    #[test]
    fn what_only_speaks_of_a_stop_is_none() {
        for text in [
            "",
            "stop it",
            "forward",
            r#""stop"#,
            r#"["run","stop"]"#,
            r#"[{"run":"stop"}]"#,
            r#"{"run":"forward"}"#,
            r#"{"run":["stop"]}"#,
            r#"{"a":{"run":"stop"}}"#,
            r#"{"x":"\"run\":\"stop\""}"#,
            r#"{"runs":"stop"}"#,
            r#"{"id":"run","x":"stop"}"#,
            r#"{"run":"sto"#,
        ] {
            assert_eq!(stop_in(text.as_bytes()), None, "{text}");
        }
        assert_eq!(stop_in(&vec![b'{'; 100_000]), None);
    }
}
