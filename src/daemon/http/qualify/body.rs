//! Bodies of the requests of `vfd-gateway qualify`.

use crate::config::qualified::{TrialFinding, action_of};
use crate::domain::command::{Direction, GoOrder, Order};
use crate::domain::control::ControlAction;
use crate::domain::frequency::Hertz;
use crate::north::api::{FindingBody, PersonBody, TrialBody, read_exactly};
use crate::profile::model::OrderKind;

/// What the body of an order looks like, for people.
pub(super) const TRIAL_EXAMPLE: &str = r#"{"order": "forward", "epoch": 7}"#;
/// What the body of a result looks like, for people.
pub(super) const RESULT_EXAMPLE: &str =
    r#"{"action": "basic", "result": "confirmed", "by": "anna"}"#;
/// Most characters of a person's name.
const NAME_CHARS_MAX: usize = 64;

/// An order of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum TrialOrder {
    /// The order writes to the drive.
    Sent(OrderKind),
    /// The motor is still watched.
    Renew,
}

impl TrialOrder {
    fn from_word(word: &str) -> Option<Self> {
        let sent = || {
            OrderKind::ALL
                .into_iter()
                .find(|kind| kind.keyword() == word)
                .map(Self::Sent)
        };
        if word == "renew" {
            Some(Self::Renew)
        } else {
            sent()
        }
    }

    /// Whether it starts the motor.
    pub const fn runs(self) -> bool {
        matches!(self, Self::Sent(OrderKind::Forward | OrderKind::Reverse))
    }

    /// The unproven action that it may use. A stop is never refused, so it needs none.
    pub const fn action(self) -> Option<ControlAction> {
        match self {
            Self::Sent(OrderKind::Stop) | Self::Renew => None,
            Self::Sent(OrderKind::Forward) => Some(ControlAction::Basic),
            Self::Sent(OrderKind::Reverse) => Some(ControlAction::Reverse),
            Self::Sent(OrderKind::Coast) => Some(ControlAction::Coast),
            Self::Sent(OrderKind::Reset) => Some(ControlAction::Reset),
            Self::Sent(OrderKind::Release) => Some(ControlAction::Release),
        }
    }

    /// The orders without which `action` was not tried.
    pub const fn of_action(action: ControlAction) -> &'static [Self] {
        match action {
            ControlAction::Basic => &[Self::Sent(OrderKind::Stop), Self::Sent(OrderKind::Forward)],
            ControlAction::Reverse => &[Self::Sent(OrderKind::Reverse)],
            ControlAction::Coast => &[Self::Sent(OrderKind::Coast)],
            ControlAction::Reset => &[Self::Sent(OrderKind::Reset)],
            ControlAction::Release => &[Self::Sent(OrderKind::Release)],
        }
    }

    /// The order itself; the motor runs at `frequency`.
    pub fn order(self, frequency: Hertz) -> Option<Order> {
        let run =
            |direction| GoOrder::new(Vec::new(), Some(frequency), Some(direction)).map(Order::Go);
        match self {
            Self::Sent(OrderKind::Stop) => Some(Order::Stop { setpoint: None }),
            Self::Sent(OrderKind::Forward) => run(Direction::Forward),
            Self::Sent(OrderKind::Reverse) => run(Direction::Reverse),
            Self::Sent(OrderKind::Coast) => Some(Order::Coast),
            Self::Sent(OrderKind::Reset) => Some(Order::Reset),
            Self::Sent(OrderKind::Release) => Some(Order::Release),
            Self::Renew => Some(Order::Renew),
        }
    }
}

/// The order that `body` names, and the epoch of the drive as it was last shown.
pub(super) fn trial(body: &[u8]) -> Option<(TrialOrder, Option<u64>)> {
    let TrialBody { order, epoch } = read_exactly(body)?;
    let order = TrialOrder::from_word(&order)?;
    // A start without one could be older than the last stop.
    (epoch.is_some() || !order.runs()).then_some((order, epoch))
}

/// The result that `body` names, and who found it.
pub(super) fn result(body: &[u8]) -> Option<(ControlAction, TrialFinding, String)> {
    let FindingBody { action, result, by } = read_exactly(body)?;
    Some((action_of(&action)?, TrialFinding::of(&result)?, name(by)?))
}

/// Who asks.
pub(super) fn by(body: &[u8]) -> Option<String> {
    let PersonBody { by } = read_exactly(body)?;
    name(by)
}

fn name(name: String) -> Option<String> {
    let is_fit =
        (1..=NAME_CHARS_MAX).contains(&name.chars().count()) && !name.chars().any(char::is_control);
    is_fit.then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_is_named_and_a_start_names_its_epoch() {
        assert_eq!(
            trial(TRIAL_EXAMPLE.as_bytes()),
            Some((TrialOrder::Sent(OrderKind::Forward), Some(7)))
        );
        assert_eq!(
            trial(br#"{"order": "stop"}"#),
            Some((TrialOrder::Sent(OrderKind::Stop), None))
        );
        for wrong in [
            "",
            "[]",
            r#"{"order": "jog"}"#,
            r#"{"order": "forward"}"#,
            r#"{"order": "reverse", "epoch": null}"#,
            r#"{"order": "stop", "frequency": 5}"#,
            r#"{"order": "forward", "epoch": -1}"#,
        ] {
            assert_eq!(trial(wrong.as_bytes()), None, "{wrong}");
        }
    }

    #[test]
    fn a_result_names_what_came_of_it_and_who_saw_it() {
        let expected = (
            ControlAction::Basic,
            TrialFinding::Confirmed,
            "anna".to_owned(),
        );
        assert_eq!(result(RESULT_EXAMPLE.as_bytes()), Some(expected));
        for (from, to) in [
            ("basic", "jog"),
            ("confirmed", "sure"),
            ("anna", ""),
            ("anna", "a\\n"),
            ("}", ", \"x\": 1}"),
        ] {
            let wrong = RESULT_EXAMPLE.replace(from, to);
            assert_eq!(result(wrong.as_bytes()), None, "{wrong}");
        }
        assert_eq!(by(br#"{"by": "anna"}"#).as_deref(), Some("anna"));
        assert_eq!(by(br#"{"by": 1}"#), None);
    }
}
