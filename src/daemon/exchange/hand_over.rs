//! Gives lines to the other gateway, and waits for what comes of it.

use super::inbox::LineMessage;
use super::shared::{SharedLine, StandbyShare};
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::standby::{LineRole, RANK_MAX, StandbyReport};
use crate::line::standby::RANK_STEP;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// How often the lines are looked at meanwhile.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Longest time for a line to give itself up: another gateway has to answer, and orders that are under way are carried out.
const GIVEN_UP_WITHIN: Duration = Duration::from_secs(7);

/// The outcome for one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandOver {
    /// Another gateway is heard on the line, and this one listens.
    HandedOver,
    /// No other gateway took the line: this one sends again, or will.
    TakenBack,
    /// No other gateway answers on the line: nothing has changed.
    NoOther,
    /// The line did not carry out the request.
    NoAnswer,
    /// This gateway does not send on the line.
    NotActive,
    /// The line has no other gateway.
    Alone,
    /// The line has no room for a message.
    QueueFull,
}

impl HandOver {
    /// The machine-readable word.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::HandedOver => "handed_over",
            Self::TakenBack => "taken_back",
            Self::NoOther => "no_other",
            Self::NoAnswer => "no_answer",
            Self::NotActive => "not_active",
            Self::Alone => "alone",
            Self::QueueFull => "queue_full",
        }
    }

    /// In words, with the name of the other gateway.
    #[must_use]
    pub fn message(self, partner: &str) -> String {
        match self {
            Self::HandedOver => "another gateway sends on the line now".to_owned(),
            Self::TakenBack => {
                format!(
                    "no other gateway took the line over: this one takes it back; does {partner} run?"
                )
            }
            Self::NoOther => {
                format!(
                    "no other gateway answers on the line: nothing has changed; does {partner} run, and listen?"
                )
            }
            Self::NoAnswer => {
                "the line was not handed over in time: orders were still being carried out"
                    .to_owned()
            }
            Self::NotActive => {
                "this gateway does not send on the line: there is nothing to hand over".to_owned()
            }
            Self::Alone => {
                "the line has no second gateway: `standby` is not true in its `[[line]]`".to_owned()
            }
            Self::QueueFull => "too many requests wait for the line".to_owned(),
        }
    }

    /// The outcome in the audit; `None` for what was not tried.
    #[must_use]
    pub const fn report(self) -> Option<Report> {
        match self {
            Self::HandedOver => Some(Report::new(Outcome::Confirmed, Reason::None)),
            Self::TakenBack | Self::NoOther | Self::NoAnswer => {
                Some(Report::new(Outcome::Failed, Reason::NotEffective))
            }
            Self::QueueFull => Some(Report::refused(Reason::QueueFull)),
            Self::NotActive => Some(Report::refused(Reason::Standby)),
            Self::Alone => None,
        }
    }
}

/// A line that was asked.
struct AskedLine {
    line: Arc<SharedLine>,
    begun: StandbyReport,
    /// Until when the line is to have given itself up.
    given_up_by: Instant,
    until: Instant,
}

impl AskedLine {
    /// The outcome, as far as it is known.
    fn ended(&self) -> Option<HandOver> {
        let now = self.line.report().standby;
        let at = Instant::now();
        let is_late = at >= self.until;
        match now {
            Some(now) if now.role == LineRole::Listening && now.hears_other => {
                Some(HandOver::HandedOver)
            }
            Some(now) if now.role == LineRole::Listening => is_late.then_some(HandOver::TakenBack),
            Some(now) if now.take_overs > self.begun.take_overs => Some(HandOver::TakenBack),
            Some(now) if now.kept > self.begun.kept => Some(HandOver::NoOther),
            _ => (at >= self.given_up_by).then_some(HandOver::NoAnswer),
        }
    }
}

/// Longest time until the other gateway is heard, or this one sends again: the other one may have any rank.
fn longest(share: &StandbyShare) -> Duration {
    (share.times.worst_take_over() + RANK_STEP * u32::from(RANK_MAX)) * 2
}

/// Hands over all `lines` at once; returns each with its outcome.
pub async fn hand_over(lines: &[Arc<SharedLine>]) -> Vec<(Arc<SharedLine>, HandOver)> {
    let begun: Vec<_> = lines.iter().map(begin).collect();
    let mut ended = Vec::with_capacity(lines.len());
    for (line, asked) in lines.iter().zip(begun) {
        let outcome = match asked {
            Ok(asked) => loop {
                if let Some(outcome) = asked.ended() {
                    break outcome;
                }
                sleep(LOOK_EVERY).await;
            },
            Err(outcome) => outcome,
        };
        ended.push((Arc::clone(line), outcome));
    }
    ended
}

fn begin(line: &Arc<SharedLine>) -> Result<AskedLine, HandOver> {
    let share = line.standby.as_ref().ok_or(HandOver::Alone)?;
    let report = line.report().standby;
    let begun = report
        .filter(|report| report.role == LineRole::Active)
        .ok_or(HandOver::NotActive)?;
    let given_up_by = Instant::now() + GIVEN_UP_WITHIN;
    let until = given_up_by + longest(share);
    line.inbox
        .put(LineMessage::Yield)
        .map_err(|_| HandOver::QueueFull)?;
    Ok(AskedLine {
        line: Arc::clone(line),
        begun,
        given_up_by,
        until,
    })
}
