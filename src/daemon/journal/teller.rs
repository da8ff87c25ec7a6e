//! Trip events on their way to the MQTT side: it asks when it has room, and is answered once when there are any.

use super::store::Store;
use crate::daemon::exchange::answers::{AnswerBox, News};
use crate::daemon::exchange::bell::Bell;
use std::sync::Arc;

/// Most events in one answer.
const TOLD_MAX: usize = 16;

/// Tells events to the MQTT side.
#[derive(Debug)]
pub struct Teller {
    /// Where to; nothing: there is no MQTT side, and events wait for one.
    mqtt: Option<Arc<AnswerBox>>,
    changed: Arc<Bell>,
    /// Events behind this one are wanted.
    wanted: Option<u64>,
    /// There may be some that were not there when it was looked last.
    is_due: bool,
}

impl Teller {
    /// Nobody has asked.
    #[must_use]
    pub const fn new(mqtt: Option<Arc<AnswerBox>>, changed: Arc<Bell>) -> Self {
        Self { mqtt, changed, wanted: None, is_due: false }
    }

    /// The MQTT side has room for the events behind `after`. This takes the place of what was wanted before.
    pub const fn want(&mut self, after: u64) {
        (self.wanted, self.is_due) = (Some(after), true);
    }

    /// Events were kept.
    pub const fn kept(&mut self) {
        self.is_due = true;
    }

    /// Answers what was asked for, once there is something.
    pub fn serve(&mut self, store: &mut Store) {
        let (Some(after), true, Some(mqtt)) = (self.wanted, self.is_due, &self.mqtt) else { return };
        let Some(database) = store.database() else { return };
        match database.events(after, TOLD_MAX) {
            Ok((events, more)) => {
                self.is_due = false;
                if !events.is_empty() {
                    self.wanted = None;
                    mqtt.put(&mut vec![News::Events { events, more }]);
                    self.changed.ring();
                }
            }
            Err(error) => store.troubled(error),
        }
    }
}
