//! Results: the outcome of a command, as its client reads it.

use super::params::label;
use crate::domain::command::{Order, Outcome, Owner, Reason, RegisterWrite, Report};
use crate::north::broker::Publication;
use crate::profile::model::{Model, Register, RegisterRole};
use crate::profile::scale::ScaledValue;
use serde_json::{Map, Value, json};
use std::collections::VecDeque;

/// Most publications that wait. More are possible only while nothing is published.
const WAITING_MAX: usize = 64;

/// The requester's own response topic, with the correlation data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ReplyTopic {
    pub(super) topic: String,
    pub(super) correlation: Option<Vec<u8>>,
}

/// The content of a result.
#[derive(Clone, Debug)]
pub(super) struct ResultContent<'a> {
    pub(super) id: &'a Value,
    pub(super) drive: &'a str,
    /// The client that commanded.
    pub(super) by: Owner,
    pub(super) report: Report,
    pub(super) is_final: bool,
    /// It was published before: the command was repeated.
    pub(super) is_repeat: bool,
    /// In place of the reason's own message.
    pub(super) message: Option<&'a str>,
    /// Values read back, by code or name.
    pub(super) values: Map<String, Value>,
    /// Now, as RFC 3339.
    pub(super) at: String,
}

impl ResultContent<'_> {
    fn payload(self) -> Vec<u8> {
        let mut result = json!({
            "id": self.id,
            "drive": self.drive,
            "outcome": self.report.outcome.keyword(),
            "reason": self.report.reason.keyword(),
            "final": self.is_final,
            "at": self.at,
        });
        let own_words = Some(self.report.reason)
            .filter(|reason| *reason != Reason::None)
            .map(Reason::text);
        let mut add = |key: &str, value: Option<Value>| {
            if let (Some(object), Some(value)) = (result.as_object_mut(), value) {
                object.insert(key.to_owned(), value);
            }
        };
        add("message", self.message.or(own_words).map(Value::from));
        let named = if let Owner::MqttBy(name) = self.by {
            Some(name.as_str().into())
        } else {
            None
        };
        add("by", named);
        add(
            "owner",
            self.report.holder.map(|owner| owner.to_string().into()),
        );
        add("held", self.report.held.map(Value::from));
        add("exception", self.report.exception.map(Value::from));
        add("repeat", self.is_repeat.then_some(Value::Bool(true)));
        add(
            "values",
            (!self.values.is_empty()).then_some(Value::Object(self.values)),
        );
        result.to_string().into_bytes()
    }
}

/// The results that wait to be published. The oldest give way.
#[derive(Debug, Default)]
pub(super) struct WaitingResults {
    waiting: VecDeque<Publication>,
}

impl WaitingResults {
    /// Adds a result for `topic`, and for the requester's own topic. Returns how many older ones were dropped.
    pub(super) fn add(
        &mut self,
        topic: String,
        reply: Option<&ReplyTopic>,
        content: ResultContent<'_>,
    ) -> u64 {
        let payload = content.payload();
        let response = reply.map(|reply| Publication {
            correlation: reply.correlation.clone(),
            ..Publication::new(reply.topic.clone(), payload.clone())
        });
        self.waiting.push_back(Publication::new(topic, payload));
        self.waiting.extend(response);
        let surplus = self.waiting.len().saturating_sub(WAITING_MAX);
        self.waiting.drain(..surplus);
        surplus as u64
    }

    pub(super) fn next(&mut self) -> Option<Publication> {
        self.waiting.pop_front()
    }
}

/// The values that `report` on `order` proves the drive to hold: the commanded ones if they were read back, or what the
/// drive kept if it is clear which register is concerned.
pub(super) fn values(model: &Model, order: &Order, report: &Report) -> Map<String, Value> {
    let Order::Go(go) = order else {
        return Map::new();
    };
    let is_confirmed = report.outcome == Outcome::Confirmed;
    let registers: Vec<_> = go
        .registers()
        .iter()
        .map(|it| (model.writable_at(it.address), *it))
        .collect();
    if is_confirmed {
        let frequency = go
            .frequency()
            .map(|hertz| ("frequency_hz".to_owned(), json!(hertz.as_f64())));
        let registers = registers
            .iter()
            .filter_map(|(register, write)| named_as_written((*register)?, *write));
        return frequency.into_iter().chain(registers).collect();
    }
    let kept = match (report.held, go.frequency(), go.run(), &registers[..]) {
        (Some(held), None, None, [(Some(register), write)]) if write.second.is_none() => {
            Some(labelled_value(register, held))
        }
        (Some(held), Some(_), None, []) => kept_frequency(model, held),
        _ => None,
    };
    kept.into_iter().collect()
}

fn kept_frequency(model: &Model, held: u16) -> Option<(String, Value)> {
    // A fraction means nothing without its full scale.
    let register = model
        .register_for(RegisterRole::FrequencyCommand)
        .filter(|register| register.is_exact())?;
    Some((
        "frequency_hz".to_owned(),
        json!(ScaledValue::from_word(held, register).value()),
    ))
}

/// The value that was written to a register, under its label.
fn named_as_written(register: &Register, write: RegisterWrite) -> Option<(String, Value)> {
    if write.second.is_none() {
        return Some(labelled_value(register, write.value));
    }
    let value = register.value(|address| {
        write
            .words()
            .find(|(it, _)| *it == address)
            .map(|(_, word)| word)
    })?;
    Some((label(register).to_owned(), json!(value.value())))
}

/// A register's value under its label.
pub(super) fn labelled_value(register: &Register, word: u16) -> (String, Value) {
    (
        label(register).to_owned(),
        json!(ScaledValue::from_word(word, register).value()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::ids::CommanderName;

    fn content(id: &Value) -> ResultContent<'_> {
        let report = Report {
            held: Some(7),
            ..Report::new(Outcome::Failed, Reason::KeptOldValue)
        };
        let message = None;
        let values = Map::new();
        let at = "now".into();
        let by = Owner::Mqtt;
        ResultContent {
            id,
            drive: "pump",
            by,
            report,
            is_final: true,
            is_repeat: false,
            message,
            values,
            at,
        }
    }

    #[test]
    fn a_result_says_everything_a_script_needs() {
        let text = String::from_utf8(content(&json!("a1")).payload()).unwrap();
        let expected = r#"{"at":"now","drive":"pump","final":true,"held":7,"id":"a1","message":"the drive kept its old value","outcome":"failed","reason":"kept_old_value"}"#;
        assert_eq!(text, expected);
    }

    #[test]
    fn a_result_names_its_commander_and_who_stood_in_its_way() {
        let name = |name| Owner::MqttBy(CommanderName::new(name).unwrap());
        let id = json!(1);
        let by = name("a");
        let report = Report::held_by(name("b"));
        let content = ResultContent {
            by,
            report,
            ..content(&id)
        };
        let result: Value = serde_json::from_slice(&content.payload()).unwrap();
        assert_eq!(
            (&result["by"], &result["owner"]),
            (&json!("a"), &json!("mqtt b"))
        );
    }

    #[test]
    fn the_oldest_results_give_way() {
        let mut results = WaitingResults::default();
        let ids: Vec<_> = (0..70).map(|number| json!(number)).collect();
        let dropped: u64 = ids
            .iter()
            .map(|id| results.add("t".into(), None, content(id)))
            .sum();
        assert_eq!(dropped, 6);
        assert!(
            String::from_utf8(results.next().unwrap().payload)
                .unwrap()
                .contains("\"id\":6,")
        );
        assert_eq!(std::iter::from_fn(|| results.next()).count(), 63);
    }
}
