//! The JSON form of a command: everything that is not exactly known is refused by name.

use super::params;
use super::payload::{InputCommand, stop_order};
use crate::domain::command::{GoOrder, Order, Reason, RegisterWrite};
use crate::north::command_words::{
    OrderWords, RefusedCommand, beside_a_stop, exact_keys, not_a_number, not_understood, object,
    orders_nothing, short, stop_in,
};
use crate::profile::model::Model;
use crate::profile::scale::setpoint_step;
use serde_json::{Map, Value};
use std::time::Duration;

const KEYS: [&str; 8] = [
    "id",
    "run",
    "frequency_hz",
    "reset",
    "param",
    "ttl_ms",
    "issued_at",
    "epoch",
];
const EXAMPLE: &str = r#"{"id": "a1", "run": "forward", "frequency_hz": 42.5}"#;
const ID_MAX_CHARS: usize = 64;
const TTL_MAX_MS: u64 = 60_000;

/// The wish that `payload` contains, with its id if one could be read. A stop counts whatever else the payload
/// contains.
pub(super) fn read(
    payload: &[u8],
    model: &Model,
) -> (Option<Value>, Result<InputCommand, RefusedCommand>) {
    let (id, wish) = whole_command(payload, model);
    let Some(stop) = stop_in(payload) else {
        return (id, wish);
    };
    let remark = wish.err().map(|refused| beside_a_stop(&refused));
    (
        id.clone(),
        Ok(InputCommand {
            id,
            remark,
            ..InputCommand::plain(stop_order(stop))
        }),
    )
}

fn whole_command(
    payload: &[u8],
    model: &Model,
) -> (Option<Value>, Result<InputCommand, RefusedCommand>) {
    let object = match object(payload, EXAMPLE) {
        Ok(object) => object,
        Err(refused) => return (None, Err(refused)),
    };
    match id(&object) {
        Ok(id) => (id.clone(), parse_input_command(id, &object, payload, model)),
        Err(refused) => (None, Err(refused)),
    }
}

fn parse_input_command(
    id: Option<Value>,
    object: &Map<String, Value>,
    payload: &[u8],
    model: &Model,
) -> Result<InputCommand, RefusedCommand> {
    exact_keys(payload, object, &KEYS)?;
    Ok(InputCommand {
        id,
        order: order(object, model)?,
        ttl: ttl(object)?,
        issued_at: whole(
            object,
            "issued_at",
            "milliseconds since 1970 in UTC, such as 1767225600000",
            Value::as_i64,
        )?,
        epoch: whole(
            object,
            "epoch",
            "the number from the drive's `state`, such as 7",
            Value::as_u64,
        )?,
        issued: None,
        remark: None,
    })
}

fn id(object: &Map<String, Value>) -> Result<Option<Value>, RefusedCommand> {
    let fits = |id: &Value| match id {
        Value::String(text) => (1..=ID_MAX_CHARS).contains(&text.chars().count()),
        other => other.is_i64() || other.is_u64(),
    };
    match object.get("id") {
        None => Ok(None),
        Some(id) if fits(id) => Ok(Some(id.clone())),
        Some(_) => Err(not_understood(
            "`id` takes a text of 1 to 64 characters or an integer, such as \"a1\"",
        )),
    }
}

fn ttl(object: &Map<String, Value>) -> Result<Option<Duration>, RefusedCommand> {
    let in_range = |value: &Value| value.as_u64().filter(|ttl| (1..=TTL_MAX_MS).contains(ttl));
    let ttl = whole(
        object,
        "ttl_ms",
        "milliseconds from 1 to 60000, such as 500",
        in_range,
    )?;
    Ok(ttl.map(Duration::from_millis))
}

fn whole<T>(
    object: &Map<String, Value>,
    key: &str,
    right: &str,
    take: impl Fn(&Value) -> Option<T>,
) -> Result<Option<T>, RefusedCommand> {
    let Some(value) = object.get(key) else {
        return Ok(None);
    };
    let taken = take(value).ok_or_else(|| not_understood(format!("`{key}` takes {right}")))?;
    Ok(Some(taken))
}

fn order(object: &Map<String, Value>, model: &Model) -> Result<Order, RefusedCommand> {
    let words = OrderWords::read(object, setpoint_step(model))?;
    // A stop is carried out whatever else the message contains, and nothing else of that message is.
    if let OrderWords::Stop(stop) = words {
        return Ok(stop);
    }
    let order = words.order(registers(object, model)?)?;
    order.ok_or_else(|| orders_nothing(EXAMPLE))
}

fn registers(
    object: &Map<String, Value>,
    model: &Model,
) -> Result<Vec<RegisterWrite>, RefusedCommand> {
    let params = match object.get("param") {
        None => return Ok(Vec::new()),
        Some(Value::Object(params)) => params,
        Some(_) => {
            return Err(not_understood(
                "`param` takes an object, such as {\"NAME\": 10.5}",
            ));
        }
    };
    if params.len() > GoOrder::REGISTERS_MAX {
        let message = format!(
            "`param` takes at most {} parameters",
            GoOrder::REGISTERS_MAX
        );
        return Err(RefusedCommand::new(Reason::TooManyFrames, message));
    }
    let mut writes: Vec<RegisterWrite> = Vec::with_capacity(params.len());
    for (code, value) in params {
        let number = value
            .as_f64()
            .ok_or_else(|| not_a_number(&short(code), "10.5"))?;
        let write = params::write(model, code, number)?;
        if writes.iter().any(|it| it.address == write.address) {
            let message = format!("`{}` occurs twice, by code and by name", short(code));
            return Err(RefusedCommand::new(Reason::Conflict, message));
        }
        writes.push(write);
    }
    Ok(writes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::Direction;
    use crate::domain::frequency::Hertz;
    use crate::north::mqtt::harness::model;
    use serde_json::json;

    fn reason(text: &str) -> Reason {
        read(text.as_bytes(), &model()).1.expect_err(text).reason
    }

    #[test]
    fn a_full_command_is_read_to_its_last_key() {
        let text = r#"{"id": 7, "run": "Reverse", "frequency_hz": 42.5, "param": {"f007": 10, "deceleration_time": 0.5},
            "ttl_ms": 500, "issued_at": 1767225600000, "epoch": 3}"#;
        let (id, wish) = read(text.as_bytes(), &model());
        let wish = wish.unwrap();
        assert_eq!(id, Some(json!(7)));
        let Order::Go(go) = wish.order else { panic!() };
        assert_eq!(
            (go.run(), go.frequency()),
            (
                Some(Direction::Reverse),
                Some(Hertz::from_millihertz(42_500))
            )
        );
        let writes: Vec<_> = go
            .registers()
            .iter()
            .map(|it| (it.address.number(), it.value))
            .collect();
        assert_eq!(writes, [(0x020E, 5), (0x020C, 100)]);
        let ttl = Some(Duration::from_millis(500));
        let issued_at = Some(1_767_225_600_000);
        assert_eq!(
            (wish.ttl, wish.issued_at, wish.epoch),
            (ttl, issued_at, Some(3))
        );
    }

    #[test]
    fn a_stop_is_carried_out_whatever_stands_beside_it() {
        let order = |text: &str| read(text.as_bytes(), &model()).1.expect(text).order;
        let stop = Order::Stop { setpoint: None };
        assert_eq!(order(r#"{"run":"stop","frequency_hz":5}"#), stop);
        assert_eq!(
            order(r#"{"run":"stop","reset":true,"frequency_hz":"fast"}"#),
            stop
        );
        assert_eq!(order(r#"{"run":"coast","param":{"F007":1}}"#), Order::Coast);
        for beside in [
            r#""speed":5"#,
            r#""run":"forward""#,
            r#""run":"go""#,
            r#""id":1.5"#,
            r#""id":"""#,
            r#""id":{}"#,
            r#""ttl_ms":0"#,
            r#""ttl_ms":60001"#,
            r#""issued_at":"now""#,
            r#""epoch":-1"#,
            r#""param":{"F007":1,"F007":2}"#,
            r#""x":"#,
        ] {
            for text in [
                format!(r#"{{"run":"stop",{beside}}}"#),
                format!(r#"{{{beside},"run":"stop"}}"#),
            ] {
                let wish = read(text.as_bytes(), &model()).1.expect(&text);
                assert_eq!(wish.order, stop, "{text}");
                assert!(
                    wish.remark.is_some_and(
                        |remark| remark.starts_with("the stop was taken all the same: ")
                    ),
                    "{text}"
                );
            }
        }
        let (id, wish) = read(br#"{"id":"a","run":"stop","x":1}"#, &model());
        assert_eq!((id, wish.unwrap().id), (Some(json!("a")), Some(json!("a"))));
        assert_eq!(order(r#"{"run":"stop"} x"#), stop);
        assert_eq!(order(r#"{"run":"stop""#), stop);
        assert_eq!(
            order(&json!({ "run": "stop", "id": "x".repeat(65) }).to_string()),
            stop
        );
    }

    #[test]
    fn what_is_not_exactly_known_is_refused_by_name() {
        use Reason::{
            Conflict, NotANumber, NotListed, NotUnderstood, OutsideLimits, TooManyFrames,
        };
        let table = [
            ("", NotUnderstood),
            ("[]", NotUnderstood),
            ("\"go\"", NotUnderstood),
            ("{}", NotUnderstood),
            ("{\"run\":\"forward\"", NotUnderstood),
            (r#"{"run":"forward"} x"#, NotUnderstood),
            (r#"{"frequency_hz":NaN}"#, NotUnderstood),
            (r#"{"frequency_hz":4,5}"#, NotUnderstood),
            (r#"{"frequency_hz":1e999}"#, NotUnderstood),
            (r#"{"frequency_hz":"42.5"}"#, NotANumber),
            (r#"{"frequency_hz":null}"#, NotANumber),
            (r#"{"frequency_hz":-1}"#, OutsideLimits),
            (r#"{"frequency_hz":5.00001}"#, Reason::BetweenSteps),
            (r#"{"run":1}"#, NotUnderstood),
            (r#"{"run":"go"}"#, NotUnderstood),
            (r#"{"run":"forward","speed":5}"#, NotUnderstood),
            (r#"{"run":"forward","run":"reverse"}"#, NotUnderstood),
            (r#"{"param":{"F007":1,"F007":2}}"#, NotUnderstood),
            (r#"{"param":{"F007":1,"f007":2}}"#, Conflict),
            (r#"{"param":{}}"#, NotUnderstood),
            (r#"{"param":[1]}"#, NotUnderstood),
            (r#"{"param":{"F007":"1"}}"#, NotANumber),
            (r#"{"param":{"F999":1}}"#, NotListed),
            (r#"{"param":{"run_command":1}}"#, NotListed),
            (r#"{"reset":false}"#, NotUnderstood),
            (r#"{"reset":true,"run":"forward"}"#, Conflict),
            (r#"{"reset":true,"frequency_hz":5}"#, Conflict),
            (r#"{"run":"forward","id":1.5}"#, NotUnderstood),
            (r#"{"run":"forward","id":""}"#, NotUnderstood),
            (r#"{"run":"forward","id":{}}"#, NotUnderstood),
            (r#"{"run":"forward","ttl_ms":0}"#, NotUnderstood),
            (r#"{"run":"forward","ttl_ms":60001}"#, NotUnderstood),
            (r#"{"run":"forward","ttl_ms":1.5}"#, NotUnderstood),
            (r#"{"run":"forward","issued_at":"now"}"#, NotUnderstood),
            (r#"{"run":"forward","epoch":-1}"#, NotUnderstood),
        ];
        for (text, expected) in table {
            assert_eq!(reason(text), expected, "{text}");
        }
        let many: Map<_, _> = (0..17)
            .map(|number| (format!("p{number}"), json!(1)))
            .collect();
        assert_eq!(reason(&json!({ "param": many }).to_string()), TooManyFrames);
        assert_eq!(
            reason(&json!({ "run": "forward", "id": "x".repeat(65) }).to_string()),
            NotUnderstood
        );
        assert_eq!(reason(&"[".repeat(8000)), NotUnderstood);
    }

    #[test]
    fn a_refusal_gives_the_id_back_and_names_the_key() {
        let (id, wish) = read(br#"{"id":"a:\"1","frequncy_hz":5}"#, &model());
        assert_eq!(id, Some(json!("a:\"1")));
        assert_eq!(
            wish.unwrap_err().message,
            "`frequncy_hz` is unknown; is it `frequency_hz`?"
        );
    }
}
