//! Passes trip events to the MQTT side, which requests them when it has room and is answered once when there are any.

use super::store::JournalStore;
use crate::daemon::exchange::answers::{AnswerBox, LineNews};
use crate::daemon::exchange::bell::BrokerBell;
use std::sync::Arc;

/// Most events in one answer.
const EVENTS_MAX: usize = 16;

/// Passes events to the MQTT side.
#[derive(Debug)]
pub struct EventSender {
    /// Where to; `None` without an MQTT side: events then wait for one.
    mqtt: Option<Arc<AnswerBox>>,
    changed: Arc<BrokerBell>,
    /// The number after which events are requested.
    wanted: Option<u64>,
    /// There may be new events since the last look.
    is_due: bool,
}

impl EventSender {
    /// Without a request so far.
    #[must_use]
    pub const fn new(mqtt: Option<Arc<AnswerBox>>, changed: Arc<BrokerBell>) -> Self {
        Self {
            mqtt,
            changed,
            wanted: None,
            is_due: false,
        }
    }

    /// The MQTT side has room for the events after `after`. Replaces an earlier request.
    pub const fn want(&mut self, after: u64) {
        self.wanted = Some(after);
        self.is_due = true;
    }

    /// Events were kept.
    pub const fn kept(&mut self) {
        self.is_due = true;
    }

    /// Answers the request, once there are events.
    pub fn serve(&mut self, store: &mut JournalStore) {
        let (Some(after), true, Some(mqtt)) = (self.wanted, self.is_due, &self.mqtt) else {
            return;
        };
        let Some(database) = store.database() else {
            return;
        };
        match database.events(after, EVENTS_MAX) {
            Ok((events, more)) => {
                self.is_due = false;
                if !events.is_empty() {
                    self.wanted = None;
                    mqtt.put(&mut vec![LineNews::Events { events, more }]);
                    self.changed.ring();
                }
            }
            Err(error) => store.troubled(error),
        }
    }
}
