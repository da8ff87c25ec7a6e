//! Advice on the gateway as a whole.

use super::Advice;
use crate::north::finding::{Finding, Sign};
use crate::north::page::gateway::{Gateway, JournalState};
use crate::north::texts::{Part, Sentence};

impl Gateway {
    /// The advice on it.
    #[must_use]
    pub fn advice(&self) -> Vec<Finding> {
        let mut said = Advice::default();
        if let Some(way) = &self.mqtt {
            if way.is_contested {
                said.say(
                    Sign::BrokerContested,
                    Sentence::new("finding.broker_contested"),
                );
            } else if !way.is_connected {
                let unreachable = Sentence::new("finding.broker_unreachable");
                said.say(
                    Sign::BrokerUnreachable,
                    unreachable.with(
                        "reason",
                        reason_or(way.lost_reason.as_deref(), "unknown_reason.broker"),
                    ),
                );
            } else if way.is_partner_missing {
                said.say(
                    Sign::PartnerMissing,
                    Sentence::new("finding.partner_missing"),
                );
            }
            if let Some(first) = way.oversized.first() {
                let text =
                    Sentence::new("finding.oversized").with("topics", way.oversized.len() as u64);
                let text = text
                    .with("limit", first.limit as u64)
                    .with("bytes", first.bytes as u64);
                said.say(Sign::Oversized, text.with("topic", first.topic.clone()));
            }
            if let Some(topic) = &way.clients_gone {
                said.say(
                    Sign::ClientsGone,
                    Sentence::new("finding.clients_gone").with("topic", topic.clone()),
                );
            }
        }
        self.journal
            .iter()
            .for_each(|journal| of_journal(&mut said, journal));
        if let Some(reason) = &self.unreachable {
            said.say(
                Sign::SocketMissing,
                Sentence::new("finding.socket_missing").with("reason", reason.to_string()),
            );
        }
        said.all
    }
}

/// The reason as the operating system or the other side gave it; `key` says that none is known.
fn reason_or(reason: Option<&str>, key: &'static str) -> Part {
    reason.map_or_else(|| Sentence::new(key).into(), Part::from)
}

fn of_journal(said: &mut Advice, journal: &JournalState) {
    if !journal.is_ok {
        let reason = reason_or(journal.reason.as_deref(), "unknown_reason.journal");
        said.say(
            Sign::JournalBroken,
            Sentence::new("finding.journal_broken").with("reason", reason),
        );
    }
    if let Some(path) = &journal.moved_aside {
        said.say(
            Sign::JournalMovedAside,
            Sentence::new("finding.journal_moved_aside").with("path", path.to_string()),
        );
    }
    if let Some(what) = &journal.replaced {
        said.say(
            Sign::JournalReplaced,
            Sentence::new("finding.journal_replaced").with("what", what.clone()),
        );
    }
    if journal.lost > 0 {
        said.say(
            Sign::JournalRowsLost,
            Sentence::new("finding.journal_rows_lost").with("rows", journal.lost),
        );
    }
}
