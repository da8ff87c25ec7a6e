//! Trip events on their way to the MQTT side: told as they come as long as it keeps up, else when it asks.

use super::store::Store;
use crate::daemon::answers::{AnswerBox, News};
use crate::journal::StoredEvent;
use std::collections::BTreeSet;
use std::sync::Arc;
use tokio::sync::Notify;

/// Most events that the MQTT side is given before it has taken some.
const TOLD_MAX: usize = 16;

/// Tells events to the MQTT side.
#[derive(Debug)]
pub struct Teller {
    /// Where to; nothing: there is no MQTT side, and events wait for one.
    mqtt: Option<Arc<AnswerBox>>,
    changed: Arc<Notify>,
    /// Told and not taken.
    told: BTreeSet<u64>,
    /// Everything before the next event was told.
    is_caught_up: bool,
    /// What was asked for while nothing could be read.
    wanted: Option<u64>,
}

impl Teller {
    /// Nobody was told anything; `has_events` wait.
    #[must_use]
    pub fn new(mqtt: Option<Arc<AnswerBox>>, changed: Arc<Notify>, has_events: bool) -> Self {
        let teller = Self { mqtt, changed, told: BTreeSet::new(), is_caught_up: !has_events, wanted: None };
        if has_events {
            teller.tell(Vec::new(), true);
        }
        teller
    }

    /// These events are kept now.
    pub fn kept(&mut self, mut events: Vec<StoredEvent>) {
        if events.is_empty() || !self.is_caught_up {
            return;
        }
        let room = TOLD_MAX.saturating_sub(self.told.len());
        let more = events.len() > room;
        events.truncate(room);
        self.is_caught_up = !more;
        self.told.extend(events.iter().map(|event| event.seq));
        self.tell(events, more);
    }

    /// The MQTT side has room for the events behind `after`.
    pub const fn want(&mut self, after: u64) {
        self.wanted = Some(after);
    }

    /// The MQTT side has this event off its hands.
    pub fn taken(&mut self, seq: u64) {
        self.told.remove(&seq);
    }

    /// Answers what was asked for, once it can be read.
    pub fn serve(&mut self, store: &mut Store) {
        let Some(after) = self.wanted else { return };
        let Some(database) = store.database() else { return };
        match database.events(after, TOLD_MAX) {
            Ok((events, more)) => {
                self.wanted = None;
                self.is_caught_up = !more;
                self.told = events.iter().map(|event| event.seq).collect();
                self.tell(events, more);
            }
            Err(error) => store.troubled(error),
        }
    }

    fn tell(&self, events: Vec<StoredEvent>, more: bool) {
        if let Some(mqtt) = &self.mqtt {
            mqtt.put(&mut vec![News::Events { events, more }]);
            self.changed.notify_one();
        }
    }
}
