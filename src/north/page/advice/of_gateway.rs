//! Advice on the gateway as a whole.

use super::Advice;
use crate::north::finding::{Finding, Sign};
use crate::north::page::gateway::{Gateway, JournalState};

impl Gateway {
    /// The advice on it.
    #[must_use]
    pub fn advice(&self) -> Vec<Finding> {
        let mut said = Advice::default();
        if let Some(way) = &self.mqtt {
            if way.is_contested {
                said.say(
                    Sign::BrokerContested,
                    "another client uses the gateway's client identifier at the broker, and each disconnects the other: \
                     give each gateway a `client_id` of its own in [mqtt]",
                );
            } else if !way.is_connected {
                let reason = way.lost_reason.as_deref().unwrap_or("no connection was tried yet");
                said.say(
                    Sign::BrokerUnreachable,
                    format!(
                        "the broker is not reached ({reason}): check that it runs, and `broker`, user, password and \
                         certificates in [mqtt]"
                    ),
                );
            }
        }
        self.journal.iter().for_each(|journal| of_journal(&mut said, journal));
        if let Some(reason) = &self.unreachable {
            said.say(Sign::SocketMissing, format!("the program's own commands (health, read, write, reload) do not reach the gateway: {reason}; let it write in \
                 `data_dir`. To reload, send it SIGHUP"
            ));
        }
        said.all
    }
}

fn of_journal(said: &mut Advice, journal: &JournalState) {
    if !journal.is_ok {
        let reason = journal.reason.as_deref().unwrap_or("no reason is known");
        said.say(Sign::JournalBroken, format!("the journal cannot be written ({reason}): the newest rows are in memory only; make room on the disk of \
             `data_dir`, and let the gateway write there"
        ));
    }
    if let Some(path) = &journal.moved_aside {
        said.say(
            Sign::JournalMovedAside,
            format!("the journal was damaged and a new one was begun; the old one is kept as {path}"),
        );
    }
    if journal.lost > 0 {
        said.say(Sign::JournalRowsLost, format!("{} rows of the journal were lost since the start", journal.lost));
    }
}
