//! The ids that a drive's commanders used lately, so that a repeat is answered and not executed.

use crate::domain::command::{Order, Owner, Report};
use crate::domain::ids::Ticket;
use crate::domain::time::MonoTime;
use serde_json::Value;
use std::collections::VecDeque;
use std::time::Duration;

/// Most ids that are remembered per drive.
const IDS_MAX: usize = 256;
/// How long an id is remembered.
const KEPT_FOR: Duration = Duration::from_secs(600);

/// The ids of one drive, oldest first.
#[derive(Debug, Default)]
pub(super) struct Seen {
    ids: VecDeque<Used>,
}

#[derive(Debug)]
struct Used {
    /// Each commander has ids of its own.
    by: Owner,
    id: Value,
    order: Order,
    epoch: Option<u64>,
    at: MonoTime,
    ticket: Ticket,
    outcome: Option<Report>,
}

/// What is known of an id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Known {
    /// It was not used.
    New,
    /// The same command is under way.
    UnderWay,
    /// The same command ended so.
    Ended(Report),
    /// Another command had it.
    Other,
}

impl Seen {
    pub(super) fn look(&self, at: MonoTime, (by, id): (Owner, &Value), order: &Order, epoch: Option<u64>) -> Known {
        let is_known = |used: &&Used| used.by == by && used.id == *id && at.since(used.at) < KEPT_FOR;
        let used = self.ids.iter().find(is_known);
        match used {
            None => Known::New,
            Some(used) if used.order != *order || used.epoch != epoch => Known::Other,
            Some(used) => used.outcome.map_or(Known::UnderWay, Known::Ended),
        }
    }

    /// Remembers a new id.
    pub(super) fn add(
        &mut self,
        at: MonoTime,
        (by, id): (Owner, Value),
        order: Order,
        epoch: Option<u64>,
        ticket: Ticket,
    ) {
        while self.ids.front().is_some_and(|used| at.since(used.at) >= KEPT_FOR) || self.ids.len() >= IDS_MAX {
            self.ids.pop_front();
        }
        self.ids.push_back(Used { by, id, order, epoch, at, ticket, outcome: None });
    }

    /// Remembers what became of a command.
    pub(super) fn ended(&mut self, ticket: Ticket, report: Report) {
        if let Some(used) = self.ids.iter_mut().find(|used| used.ticket == ticket) {
            used.outcome = Some(report);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::{Outcome, Reason};
    use crate::domain::ids::CommanderName;
    use serde_json::json;

    const MQTT: Owner = Owner::Mqtt;

    #[test]
    fn ids_are_remembered_for_ten_minutes_and_256_at_most() {
        let mut seen = Seen::default();
        let at = |minutes: u64| MonoTime::from_millis(minutes * 60_000);
        let look = |seen: &Seen, minutes, id: u64| seen.look(at(minutes), (MQTT, &json!(id)), &Order::Reset, None);
        seen.add(at(0), (MQTT, json!(0)), Order::Reset, None, Ticket(0));
        assert_eq!(look(&seen, 9, 0), Known::UnderWay);
        assert_eq!(look(&seen, 10, 0), Known::New);
        for id in 1..=256 {
            seen.add(at(1), (MQTT, json!(id)), Order::Reset, None, Ticket(id));
        }
        assert_eq!((look(&seen, 1, 0), look(&seen, 1, 1)), (Known::New, Known::UnderWay));
        let report = Report::new(Outcome::Confirmed, Reason::None);
        seen.ended(Ticket(1), report);
        assert_eq!(look(&seen, 1, 1), Known::Ended(report));
        assert_eq!(seen.look(at(1), (MQTT, &json!(1)), &Order::Coast, None), Known::Other);
        assert_eq!(seen.look(at(1), (MQTT, &json!(1)), &Order::Reset, Some(1)), Known::Other);
        let other = Owner::MqttBy(CommanderName::new("plc").unwrap());
        assert_eq!(seen.look(at(1), (other, &json!(1)), &Order::Reset, None), Known::New, "the id of somebody else");
    }
}
