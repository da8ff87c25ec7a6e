//! Bodies of requests from the page: everything that is not exactly known is refused by name.

use crate::domain::command::Order;
use crate::north::api::{EmptyBody, read_exactly};
use crate::north::command_words::{
    OrderWords, RefusedCommand, RunWord, beside_a_stop, exact_keys, object, only_true,
    orders_nothing, stop_in,
};
use crate::profile::scale::Decimal;

/// Longest body in bytes: a password and some more.
pub const BODY_BYTES_MAX: usize = 4096;

const KEYS: [&str; 4] = ["run", "frequency_hz", "reset", "take"];
const EXAMPLE: &str = r#"{"run": "forward", "frequency_hz": 42.5}"#;
/// What a sign-in looks like, for people.
pub const SIGN_IN_EXAMPLE: &str = r#"{"user": "anna", "password": "..."}"#;

/// What an operator on the page requests of a drive; at least one of both.
#[derive(Clone, Debug, PartialEq)]
pub struct PageCommand {
    /// Take control over first.
    pub takes: bool,
    /// The order.
    pub order: Option<Order>,
    /// What is wrong with the rest of a message with a stop, for people.
    pub beside: Option<String>,
}

/// The wish in `body`, for a drive whose setpoint has this step. A stop counts whatever else the body contains, and nothing else of that body does.
///
/// # Errors
/// Why it is none.
pub fn parse_command(body: &[u8], step: Option<Decimal>) -> Result<PageCommand, RefusedCommand> {
    let wish = parse_whole_command(body, step);
    let Some(stop) = stop_in(body) else {
        return wish;
    };
    let order = if stop == RunWord::Coast {
        Order::Coast
    } else {
        Order::Stop { setpoint: None }
    };
    Ok(PageCommand {
        takes: false,
        order: Some(order),
        beside: wish.err().map(|refused| beside_a_stop(&refused)),
    })
}

fn parse_whole_command(body: &[u8], step: Option<Decimal>) -> Result<PageCommand, RefusedCommand> {
    let object = object(body, EXAMPLE)?;
    exact_keys(body, &object, &KEYS)?;
    let words = OrderWords::read(&object, step)?;
    // Nothing else of a body with a stop counts.
    let takes = !matches!(words, OrderWords::Stop(_)) && only_true(&object, "take")?;
    let order = words.order(Vec::new())?;
    if order.is_none() && !takes {
        return Err(orders_nothing(EXAMPLE));
    }
    Ok(PageCommand {
        takes,
        order,
        beside: None,
    })
}

/// Whether `body` is empty: absent, or an empty object.
#[must_use]
pub fn is_empty(body: &[u8]) -> bool {
    body.is_empty() || read_exactly::<EmptyBody>(body).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::{Direction, GoOrder, Reason};
    use crate::domain::frequency::Hertz;
    use crate::north::api::SignInBody;

    #[test]
    fn a_body_orders_what_it_says() {
        let go = |frequency, run| GoOrder::new(Vec::new(), frequency, run).map(Order::Go);
        let thirty = Some(Hertz::from_millihertz(30_000));
        let forward = Some(Direction::Forward);
        for (body, takes, order) in [
            (r#"{"run": "forward"}"#, false, go(None, forward)),
            (
                r#"{"run": "forward", "frequency_hz": 30}"#,
                false,
                go(thirty, forward),
            ),
            (
                r#"{"frequency_hz": 30.0, "take": true}"#,
                true,
                go(thirty, None),
            ),
            (r#"{"take": true}"#, true, None),
            (r#"{"reset": true}"#, false, Some(Order::Reset)),
            (
                r#"{"run": "stop"}"#,
                false,
                Some(Order::Stop { setpoint: None }),
            ),
            // A stop is carried out whatever else the body contains.
            (
                r#"{"run": "stop", "frequency_hz": "x", "reset": 1, "take": true}"#,
                false,
                Some(Order::Stop { setpoint: None }),
            ),
            (
                r#"{"run": "coast", "frequency_hz": 5}"#,
                false,
                Some(Order::Coast),
            ),
        ] {
            assert_eq!(
                parse_command(body.as_bytes(), None),
                Ok(PageCommand {
                    takes,
                    order,
                    beside: None
                }),
                "{body}"
            );
        }
        for body in [
            r#"{"run": "stop", "speed": 3}"#,
            r#"{"run": "stop", "run": "forward"}"#,
            r#"{"run": "forward", "run": "stop"}"#,
            r#"{"run": "stop""#,
            r#"{"run": "stop"} x"#,
        ] {
            let wish = parse_command(body.as_bytes(), None).expect(body);
            assert_eq!(
                (wish.takes, wish.order),
                (false, Some(Order::Stop { setpoint: None })),
                "{body}"
            );
            assert!(wish.beside.is_some(), "{body}");
        }
    }

    #[test]
    fn what_is_not_exactly_known_is_refused() {
        for (body, reason) in [
            ("", Reason::NotUnderstood),
            ("[]", Reason::NotUnderstood),
            ("{}", Reason::NotUnderstood),
            (r#"{"run": "start"}"#, Reason::NotUnderstood),
            (r#"{"run": true}"#, Reason::NotUnderstood),
            (r#"{"run": "forward", "speed": 3}"#, Reason::NotUnderstood),
            (
                r#"{"run": "reverse", "run": "forward"}"#,
                Reason::NotUnderstood,
            ),
            (r#"{"reset": true, "run": "forward"}"#, Reason::Conflict),
            (r#"{"reset": true, "frequency_hz": 5}"#, Reason::Conflict),
            (r#"{"reset": false}"#, Reason::NotUnderstood),
            (r#"{"take": 1}"#, Reason::NotUnderstood),
            (r#"{"frequency_hz": "30"}"#, Reason::NotANumber),
            (r#"{"frequency_hz": -1}"#, Reason::OutsideLimits),
            (r#"{"frequency_hz": 30.0001}"#, Reason::BetweenSteps),
        ] {
            assert_eq!(
                parse_command(body.as_bytes(), None).map_err(|refused| refused.reason),
                Err(reason),
                "{body}"
            );
        }
    }

    #[test]
    fn a_sign_in_is_a_user_and_a_password() {
        let sign_in = |body: &[u8]| {
            let SignInBody { user, password } = read_exactly(body)?;
            Some((user, password))
        };
        let found = sign_in(SIGN_IN_EXAMPLE.as_bytes());
        assert_eq!(found, Some(("anna".to_owned(), "...".to_owned())));
        for wrong in [
            "",
            "[]",
            r#"{"user": "a"}"#,
            r#"{"user": "a", "password": 1}"#,
            r#"{"user": "a", "password": "b", "c": 1}"#,
        ] {
            assert_eq!(sign_in(wrong.as_bytes()), None, "{wrong}");
        }
        assert!(is_empty(b"") && is_empty(b" {} ") && !is_empty(b"[]") && !is_empty(b"{\"a\":1}"));
    }
}
