//! Passes what a broker session has for the lines to their inboxes. It never waits for the broker.

use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::exchange::shared::SharedPlant;
use crate::domain::command::{CommandRequest, Owner};
use crate::domain::ids::Ticket;
use crate::drive::description::DriveRef;
use crate::north::broker::ToLine;

/// Passes `requests` of `owner` to the lines, in order. Returns the tickets that no line accepted.
pub fn hand_over(
    shared: &SharedPlant,
    owner: Owner,
    requests: impl IntoIterator<Item = ToLine>,
) -> Vec<Ticket> {
    let mut way = LineDispatch {
        shared,
        stops: Vec::new(),
        refused: Vec::new(),
    };
    for request in requests {
        way.take(owner, request);
    }
    way.put_stops();
    way.refused
}

struct LineDispatch<'s> {
    shared: &'s SharedPlant,
    /// Consecutive stops.
    stops: Vec<(DriveRef, CommandRequest)>,
    refused: Vec<Ticket>,
}

impl LineDispatch<'_> {
    fn take(&mut self, owner: Owner, request: ToLine) {
        match request {
            ToLine::Command(place, command) if command.order.is_stop() => {
                return self.stops.push((place, command));
            }
            _ => self.put_stops(),
        }
        match request {
            ToLine::Command(place, command) => {
                self.put(place, command.ticket, LineMessage::Command(command))
            }
            ToLine::Read(place, request) => {
                self.put(place, request.ticket, LineMessage::Native(request))
            }
            ToLine::PathAlive => self.tell_all(&|| LineMessage::PathAlive(owner)),
            ToLine::PathOpened => self.tell_all(&|| LineMessage::PathOpened(owner)),
        }
    }

    /// Passes consecutive stops on together, so that each line finds all of its own at once.
    fn put_stops(&mut self) {
        let stops = std::mem::take(&mut self.stops);
        let tickets: Vec<_> = stops.iter().map(|(_, command)| command.ticket).collect();
        let taken = self.shared.put_together(stops);
        let refused = tickets
            .into_iter()
            .zip(taken)
            .filter(|(_, is_taken)| !is_taken);
        self.refused.extend(refused.map(|(ticket, _)| ticket));
    }

    fn put(&mut self, place: DriveRef, ticket: Ticket, message: LineMessage) {
        let is_taken = self
            .shared
            .inbox(place)
            .is_some_and(|inbox| inbox.put(message).is_ok());
        if !is_taken {
            self.refused.push(ticket);
        }
    }

    fn tell_all(&self, message: &dyn Fn() -> LineMessage) {
        for line in &self.shared.lines {
            // A full inbox holds commands that renew the lease themselves; otherwise the lease ends, which is safe.
            let _ = line.inbox.put(message());
        }
    }
}
