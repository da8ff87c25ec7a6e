//! The order in a payload, or why it orders nothing.

use super::command_json;
use super::params;
use super::topics::DriveInput;
use crate::domain::command::{Direction, GoOrder, Order, Reason, RegisterWrite};
use crate::domain::frequency::{Hertz, decimal};
use crate::domain::time::MonoTime;
use crate::north::command_words::{
    RUN_EXAMPLE, RunWord, beside_a_stop, no_frequency, run_word, short_number, stop_in,
    unknown_word, without_mark,
};
pub(super) use crate::north::command_words::{RefusedCommand, short};
use crate::profile::model::Model;
use crate::profile::scale::setpoint_step;
use serde_json::Value;
use std::time::Duration;

/// The largest payload that is read: many times the largest command.
pub(super) const PAYLOAD_MAX_BYTES: usize = 8 * 1024;

/// What an input requests.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum InputRequest {
    Order(InputCommand),
    /// The value of the register at this index in the model.
    Read(usize),
}

/// An order with what its client said about it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct InputCommand {
    /// A string or an integer.
    pub(super) id: Option<Value>,
    pub(super) order: Order,
    pub(super) ttl: Option<Duration>,
    /// Milliseconds since 1970.
    pub(super) issued_at: Option<i64>,
    pub(super) epoch: Option<u64>,
    /// When it was issued, on our clock.
    pub(super) issued: Option<MonoTime>,
    /// A remark about it, for people.
    pub(super) remark: Option<String>,
}

impl InputCommand {
    pub(super) const fn plain(order: Order) -> Self {
        Self {
            id: None,
            order,
            ttl: None,
            issued_at: None,
            epoch: None,
            issued: None,
            remark: None,
        }
    }
}

/// Reads the payload of `input` for a drive of `model`, with the id if one could be read.
pub(super) fn read(
    input: DriveInput<'_>,
    payload: &[u8],
    model: &Model,
) -> (Option<Value>, Result<InputRequest, RefusedCommand>) {
    if payload.len() > PAYLOAD_MAX_BYTES {
        let refused = too_large(payload.len());
        let stop = match input {
            DriveInput::Command => stop_in(payload),
            DriveInput::Run => stop_word(payload),
            _ => None,
        };
        let Some(stop) = stop else {
            return (None, Err(refused));
        };
        let remark = Some(beside_a_stop(&refused));
        return (
            None,
            Ok(InputRequest::Order(InputCommand {
                remark,
                ..InputCommand::plain(stop_order(stop))
            })),
        );
    }
    if payload.is_empty() && !input.takes_empty() {
        return (None, Err(empty()));
    }
    if input == DriveInput::Command {
        let (id, wish) = command_json::read(payload, model);
        return (id, wish.map(InputRequest::Order));
    }
    (None, plain(input, payload, model))
}

fn empty() -> RefusedCommand {
    RefusedCommand::new(
        Reason::NotUnderstood,
        "the payload is empty, which orders nothing",
    )
}

fn too_large(bytes: usize) -> RefusedCommand {
    let message = format!(
        "{bytes} bytes are more than any command needs; at most {PAYLOAD_MAX_BYTES} are read"
    );
    RefusedCommand::new(Reason::TooLarge, message)
}

fn plain(
    input: DriveInput<'_>,
    payload: &[u8],
    model: &Model,
) -> Result<InputRequest, RefusedCommand> {
    let order = match input {
        DriveInput::ParamGet(code) => return params::readable(model, code).map(InputRequest::Read),
        DriveInput::Run => run_order(text(payload, RUN_EXAMPLE)?)?,
        DriveInput::Frequency => frequency_order(text(payload, "such as 42.5")?, model)?,
        DriveInput::Reset => only(text(payload, "`reset`")?, "reset", Order::Reset)?,
        DriveInput::Take => only(text(payload, "`take`")?, "take", Order::Take)?,
        DriveInput::Release => only(text(payload, "`release`")?, "release", Order::Release)?,
        DriveInput::ParamSet(code) => param_order(model, code, payload)?,
        DriveInput::Lease => Order::Renew,
        DriveInput::Command => return Err(RefusedCommand::plain(Reason::NotUnderstood)),
    };
    Ok(InputRequest::Order(InputCommand::plain(order)))
}

/// The stop in the first bytes of a payload that is too large, if they contain no other word.
fn stop_word(payload: &[u8]) -> Option<RunWord> {
    let start = std::str::from_utf8(without_mark(payload.get(..PAYLOAD_MAX_BYTES)?)).ok()?;
    run_word(start)
        .ok()
        .filter(|word| matches!(word, RunWord::Stop | RunWord::Coast))
}

/// The order of a word that must be a stop.
pub(super) const fn stop_order(word: RunWord) -> Order {
    if matches!(word, RunWord::Coast) {
        Order::Coast
    } else {
        Order::Stop { setpoint: None }
    }
}

/// Accepts the payload of `all/run/set`.
pub(super) fn read_all(payload: &[u8]) -> Result<(), RefusedCommand> {
    if payload.len() > PAYLOAD_MAX_BYTES {
        let is_stop = stop_word(payload) == Some(RunWord::Stop);
        return if is_stop {
            Ok(())
        } else {
            Err(too_large(payload.len()))
        };
    }
    if payload.is_empty() {
        return Err(empty());
    }
    let word = text(payload, "`stop`")?;
    if word.eq_ignore_ascii_case("stop") {
        Ok(())
    } else {
        Err(unknown_word(word, "`stop` and nothing else"))
    }
}

fn run_order(text: &str) -> Result<Order, RefusedCommand> {
    Ok(match run_word(text)? {
        RunWord::Stop => Order::Stop { setpoint: None },
        RunWord::Coast => Order::Coast,
        RunWord::Run(direction) => go(Vec::new(), None, Some(direction))?,
    })
}

fn frequency_order(text: &str, model: &Model) -> Result<Order, RefusedCommand> {
    short_number(text, "42.5")?;
    let frequency = Hertz::parse(text);
    let frequency =
        frequency.map_err(|why| no_frequency(why, "frequency/set", text, setpoint_step(model)))?;
    go(Vec::new(), Some(frequency), None)
}

/// Accepts the only word that a topic takes.
fn only(text: &str, word: &str, order: Order) -> Result<Order, RefusedCommand> {
    if text.trim().eq_ignore_ascii_case(word) {
        Ok(order)
    } else {
        Err(unknown_word(text.trim(), &format!("`{word}`")))
    }
}

fn param_order(model: &Model, code: &str, payload: &[u8]) -> Result<Order, RefusedCommand> {
    let text = text(payload, "such as 10.5")?;
    short_number(text, "10.5")?;
    let value = decimal(text).ok_or_else(|| {
        RefusedCommand::new(
            Reason::NotANumber,
            format!(
                "`{}` is not a number with a decimal point, such as 10.5",
                short(text)
            ),
        )
    })?;
    go(vec![params::write(model, code, value)?], None, None)
}

/// The order of these parts, of which at least one is present.
pub(super) fn go(
    registers: Vec<RegisterWrite>,
    frequency: Option<Hertz>,
    run: Option<Direction>,
) -> Result<Order, RefusedCommand> {
    GoOrder::new(registers, frequency, run)
        .map(Order::Go)
        .ok_or_else(|| RefusedCommand::plain(Reason::TooManyFrames))
}

/// The payload as trimmed text.
fn text<'p>(payload: &'p [u8], right: &str) -> Result<&'p str, RefusedCommand> {
    let text = std::str::from_utf8(without_mark(payload)).map(str::trim);
    text.map_err(|_| {
        RefusedCommand::new(
            Reason::NotUnderstood,
            format!("the payload is not text; expected {right}"),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::north::mqtt::harness::model;

    fn order(input: DriveInput<'_>, payload: &str) -> Result<Order, Reason> {
        match read(input, payload.as_bytes(), &model()).1 {
            Ok(InputRequest::Order(wish)) => Ok(wish.order),
            Ok(InputRequest::Read(_)) => panic!("a read"),
            Err(refused) => Err(refused.reason),
        }
    }

    #[test]
    fn words_are_taken_trimmed_and_in_any_case() {
        assert_eq!(
            order(DriveInput::Run, " STOP\n"),
            Ok(Order::Stop { setpoint: None })
        );
        assert_eq!(order(DriveInput::Run, "Coast"), Ok(Order::Coast));
        let reverse = GoOrder::new(Vec::new(), None, Some(Direction::Reverse)).unwrap();
        assert_eq!(order(DriveInput::Run, "reverse"), Ok(Order::Go(reverse)));
        assert_eq!(order(DriveInput::Reset, "Reset "), Ok(Order::Reset));
        assert_eq!(order(DriveInput::Take, " Take"), Ok(Order::Take));
        assert_eq!(order(DriveInput::Release, "RELEASE"), Ok(Order::Release));
        assert_eq!(order(DriveInput::Lease, "anything"), Ok(Order::Renew));
        let frequency =
            GoOrder::new(Vec::new(), Some(Hertz::from_millihertz(42_500)), None).unwrap();
        assert_eq!(
            order(DriveInput::Frequency, " 42.5 "),
            Ok(Order::Go(frequency))
        );
    }

    #[test]
    fn other_payloads_are_refused_with_their_reason() {
        let table = [
            (DriveInput::Run, "start", Reason::NotUnderstood),
            (DriveInput::Run, "1", Reason::NotUnderstood),
            (DriveInput::Run, "forward stop", Reason::NotUnderstood),
            (DriveInput::Frequency, "4,5", Reason::NotANumber),
            (DriveInput::Frequency, "NaN", Reason::NotANumber),
            (DriveInput::Frequency, "inf", Reason::NotANumber),
            (DriveInput::Frequency, "1e3", Reason::NotANumber),
            (DriveInput::Frequency, "-5", Reason::OutsideLimits),
            (DriveInput::Frequency, "5.00001", Reason::BetweenSteps),
            (DriveInput::Reset, "true", Reason::NotUnderstood),
            (DriveInput::Take, "1", Reason::NotUnderstood),
            (DriveInput::Take, "", Reason::NotUnderstood),
            (DriveInput::ParamSet("F007"), "1e1", Reason::NotANumber),
            (DriveInput::ParamSet("F007"), "4,5", Reason::NotANumber),
            (DriveInput::ParamSet("F007"), "1.25", Reason::BetweenSteps),
            (DriveInput::ParamSet("F999"), "1", Reason::NotListed),
        ];
        for (input, payload, reason) in table {
            assert_eq!(order(input, payload), Err(reason), "{payload}");
        }
        let absurd = format!("{}1", "0".repeat(4_000));
        for input in [DriveInput::Frequency, DriveInput::ParamSet("F007")] {
            let (_, refused) = read(input, absurd.as_bytes(), &model());
            let refused = refused.unwrap_err();
            assert_eq!(refused.reason, Reason::NotUnderstood);
            assert!(
                refused.message.contains("an example: ") && refused.message.len() < 200,
                "{}",
                refused.message
            );
        }
        let (_, not_text) = read(DriveInput::Run, b"stop\xFF", &model());
        assert_eq!(not_text.unwrap_err().reason, Reason::NotUnderstood);
        let (_, large) = read(
            DriveInput::Run,
            &vec![b' '; PAYLOAD_MAX_BYTES + 1],
            &model(),
        );
        assert_eq!(large.unwrap_err().reason, Reason::TooLarge);
    }

    #[test]
    fn a_stop_in_a_payload_that_is_too_large_is_one() {
        let padded = |text: &str| format!("{text}{}", " ".repeat(PAYLOAD_MAX_BYTES)).into_bytes();
        let stop = Order::Stop { setpoint: None };
        for (input, payload, expected) in [
            (DriveInput::Run, padded(" Stop"), &stop),
            (DriveInput::Run, padded("coast"), &Order::Coast),
            (DriveInput::Command, padded(r#"{"run":"stop","x":"#), &stop),
        ] {
            let Ok(InputRequest::Order(wish)) = read(input, &payload, &model()).1 else {
                panic!("{input:?}")
            };
            assert_eq!(&wish.order, expected);
            assert!(wish.remark.is_some_and(|remark| remark.contains("8192")));
        }
        for (input, payload) in [
            (DriveInput::Run, padded("forward")),
            (DriveInput::Run, padded("stop it")),
            (DriveInput::Command, padded(r#"{"run":"forward""#)),
            (DriveInput::Reset, padded("stop")),
        ] {
            assert_eq!(
                read(input, &payload, &model()).1.unwrap_err().reason,
                Reason::TooLarge
            );
        }
        assert!(read_all(&padded("stop")).is_ok() && read_all(&padded("go")).is_err());
    }

    #[test]
    fn messages_show_an_example_and_never_the_whole_of_a_long_payload() {
        let (_, refused) = read(DriveInput::Frequency, "4,5".as_bytes(), &model());
        assert!(refused.unwrap_err().message.contains("such as 42.5"));
        let (_, refused) = read(DriveInput::Run, "ü".repeat(4000).as_bytes(), &model());
        assert!(refused.unwrap_err().message.len() < 200);
    }
}
