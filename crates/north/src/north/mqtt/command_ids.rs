//! The ids that a drive's clients used recently, so that a repeat is answered and not executed.

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
pub(super) struct CommandIds {
    ids: VecDeque<UsedId>,
    /// Ids of commands that no drive ever saw. They have room of their own, so that a flood of them displaces no
    /// executed id.
    refused: VecDeque<UsedId>,
}

#[derive(Debug)]
struct UsedId {
    /// Each client has ids of its own.
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
pub(super) enum IdState {
    /// It was not used.
    New,
    /// The id is in use by an equal command that is under way.
    UnderWay,
    /// The id was used by an equal command that ended with this outcome.
    Ended(Report),
    /// Another command had it.
    Other,
}

impl CommandIds {
    pub(super) fn look(
        &self,
        at: MonoTime,
        (by, id): (Owner, &Value),
        order: &Order,
        epoch: Option<u64>,
    ) -> IdState {
        let is_known =
            |used: &&UsedId| used.by == by && used.id == *id && at.since(used.at) < KEPT_FOR;
        let used = self.ids.iter().chain(&self.refused).find(is_known);
        match used {
            None => IdState::New,
            Some(used) if used.order != *order || used.epoch != epoch => IdState::Other,
            Some(used) => used.outcome.map_or(IdState::UnderWay, IdState::Ended),
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
        push(
            &mut self.ids,
            UsedId {
                by,
                id,
                order,
                epoch,
                at,
                ticket,
                outcome: None,
            },
        );
    }

    /// Remembers a new id whose command is refused without being given to a drive.
    pub(super) fn add_refused(
        &mut self,
        at: MonoTime,
        (by, id): (Owner, Value),
        order: Order,
        epoch: Option<u64>,
        report: Report,
    ) {
        let ticket = Ticket(0);
        let outcome = Some(report);
        push(
            &mut self.refused,
            UsedId {
                by,
                id,
                order,
                epoch,
                at,
                ticket,
                outcome,
            },
        );
    }

    /// Forgets the id of a command that another gateway carries out.
    pub(super) fn forget(&mut self, ticket: Ticket) {
        self.ids.retain(|used| used.ticket != ticket);
    }

    /// Remembers the outcome of a command.
    pub(super) fn ended(&mut self, ticket: Ticket, report: Report) {
        if let Some(used) = self.ids.iter_mut().find(|used| used.ticket == ticket) {
            used.outcome = Some(report);
        }
    }
}

fn push(ids: &mut VecDeque<UsedId>, used: UsedId) {
    while ids
        .front()
        .is_some_and(|oldest| used.at.since(oldest.at) >= KEPT_FOR)
        || ids.len() >= IDS_MAX
    {
        ids.pop_front();
    }
    ids.push_back(used);
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
        let mut seen = CommandIds::default();
        let at = |minutes: u64| MonoTime::from_millis(minutes * 60_000);
        let look = |seen: &CommandIds, minutes, id: u64| {
            seen.look(at(minutes), (MQTT, &json!(id)), &Order::Reset, None)
        };
        seen.add(at(0), (MQTT, json!(0)), Order::Reset, None, Ticket(0));
        assert_eq!(look(&seen, 9, 0), IdState::UnderWay);
        assert_eq!(look(&seen, 10, 0), IdState::New);
        for id in 1..=256 {
            seen.add(at(1), (MQTT, json!(id)), Order::Reset, None, Ticket(id));
        }
        assert_eq!(
            (look(&seen, 1, 0), look(&seen, 1, 1)),
            (IdState::New, IdState::UnderWay)
        );
        let report = Report::new(Outcome::Confirmed, Reason::None);
        seen.ended(Ticket(1), report);
        assert_eq!(look(&seen, 1, 1), IdState::Ended(report));
        assert_eq!(
            seen.look(at(1), (MQTT, &json!(1)), &Order::Coast, None),
            IdState::Other
        );
        assert_eq!(
            seen.look(at(1), (MQTT, &json!(1)), &Order::Reset, Some(1)),
            IdState::Other
        );
        let other = Owner::MqttBy(CommanderName::new("plc").unwrap());
        assert_eq!(
            seen.look(at(1), (other, &json!(1)), &Order::Reset, None),
            IdState::New,
            "the id of another client"
        );
        let refused = Report::refused(Reason::Stale);
        for id in 1_000..2_000 {
            seen.add_refused(at(2), (MQTT, json!(id)), Order::Reset, None, refused);
        }
        assert_eq!(
            (look(&seen, 2, 1_743), look(&seen, 2, 1_744)),
            (IdState::New, IdState::Ended(refused))
        );
        assert_eq!(
            look(&seen, 2, 1),
            IdState::Ended(report),
            "refused ones take no room of executed ones"
        );
    }
}
