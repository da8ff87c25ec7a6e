//! Advice on the gateway as a whole.

use super::SubjectAdvice;
use crate::north::finding::{Finding, FindingSign};
use crate::north::page::gateway::{PageGateway, PageJournal};
use crate::north::texts::{Sentence, SentencePart};

impl PageGateway {
    /// The advice on it.
    #[must_use]
    pub fn advice(&self) -> Vec<Finding> {
        let mut said = SubjectAdvice::default();
        if let Some(way) = &self.mqtt {
            if way.is_contested {
                said.say(
                    FindingSign::BrokerContested,
                    Sentence::new("finding.broker_contested"),
                );
            } else if !way.is_connected {
                let unreachable = Sentence::new("finding.broker_unreachable");
                said.say(
                    FindingSign::BrokerUnreachable,
                    unreachable.with(
                        "reason",
                        reason_or(way.lost_reason.as_deref(), "unknown_reason.broker"),
                    ),
                );
            } else if way.is_partner_missing {
                said.say(
                    FindingSign::PartnerMissing,
                    Sentence::new("finding.partner_missing"),
                );
            }
            if let Some(first) = way.oversized.first() {
                let text =
                    Sentence::new("finding.oversized").with("topics", way.oversized.len() as u64);
                let text = text
                    .with("limit", first.limit as u64)
                    .with("bytes", first.bytes as u64);
                said.say(
                    FindingSign::Oversized,
                    text.with("topic", first.topic.clone()),
                );
            }
            if let Some(topic) = &way.clients_gone {
                said.say(
                    FindingSign::ClientsGone,
                    Sentence::new("finding.clients_gone").with("topic", topic.clone()),
                );
            }
        }
        self.journal
            .iter()
            .for_each(|journal| of_journal(&mut said, journal));
        if let Some(reason) = &self.unreachable {
            said.say(
                FindingSign::SocketMissing,
                Sentence::new("finding.socket_missing").with("reason", reason.to_string()),
            );
        }
        said.all
    }
}

/// The reason as the operating system or the other side gave it; `key` says that none is known.
fn reason_or(reason: Option<&str>, key: &'static str) -> SentencePart {
    reason.map_or_else(|| Sentence::new(key).into(), SentencePart::from)
}

fn of_journal(said: &mut SubjectAdvice, journal: &PageJournal) {
    if !journal.is_ok {
        let reason = reason_or(journal.reason.as_deref(), "unknown_reason.journal");
        said.say(
            FindingSign::JournalBroken,
            Sentence::new("finding.journal_broken").with("reason", reason),
        );
    }
    if let Some(path) = &journal.moved_aside {
        said.say(
            FindingSign::JournalMovedAside,
            Sentence::new("finding.journal_moved_aside").with("path", path.to_string()),
        );
    }
    if let Some(what) = &journal.replaced {
        said.say(
            FindingSign::JournalReplaced,
            Sentence::new("finding.journal_replaced").with("what", what.clone()),
        );
    }
    if journal.lost > 0 {
        said.say(
            FindingSign::JournalRowsLost,
            Sentence::new("finding.journal_rows_lost").with("rows", journal.lost),
        );
    }
}
