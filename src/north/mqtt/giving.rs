//! What was taken of messages, on its way to the lines.

use super::kept;
use super::payload::{InputCommand, Refused};
use super::pending::{Pending, What};
use super::results::Reply;
use super::seen::IdState;
use super::session::Session;
use super::types::{Act, Message, Moment};
use crate::domain::command::{CommandRequest, Manner, Order, Origin, Outcome, Owner, Reason, Report, Rights};
use crate::domain::ids::{AskerId, Ticket};
use crate::domain::native::{NativeAsk, NativeRequest};
use crate::domain::time::MonoTime;
use serde_json::Value;
use std::time::Duration;

/// How long a read may take: a line that is busy with a silent drive included.
const READ_WITHIN: Duration = Duration::from_secs(5);
/// How much longer than its deadline a command may stay without its last answer.
const ANSWERED_WITHIN: Duration = Duration::from_secs(60);
const RETAINED_STOP: &str = "executed, but published with the retain flag: it would be refused as a replay later";

/// Who asks, where the answer goes, and under which id.
pub(super) struct Asker {
    pub(super) by: Owner,
    pub(super) id: Value,
    pub(super) reply: Option<Reply>,
}

const fn origin(owner: Owner) -> Origin {
    Origin { owner, rights: Rights { write: true, stop: true }, manner: Manner::Once }
}

impl Session {
    /// Hands an order to its drive.
    pub(super) fn give(&mut self, at: Moment, drive: usize, asker: Asker, wish: InputCommand, message: &Message<'_>) {
        let is_a_stop = wish.order.is_stop();
        if is_a_stop {
            self.clear_the_way(at, drive);
        }
        let ticket = self.next_ticket();
        let is_new_id = || {
            let by_id = (asker.by, &asker.id);
            self.seen[drive].look(at.mono, by_id, &wish.order, wish.epoch) == IdState::New
        };
        if wish.id.is_some() && is_new_id() {
            self.seen[drive].add(at.mono, (asker.by, asker.id.clone()), wish.order.clone(), wish.epoch, ticket);
        }
        let is_retained_stop = is_a_stop && message.retain;
        self.counters.retained_stops += u64::from(is_retained_stop);
        self.counters.commands += 1;
        let request = self.request(at, (drive, ticket, asker.by), &wish, message.expiry);
        self.unanswered.add(Pending {
            ticket,
            drive,
            by: asker.by,
            id: asker.id,
            what: What::Order(wish.order),
            reply: asker.reply,
            remark: if is_retained_stop { Some(RETAINED_STOP.to_owned()) } else { wish.remark },
            forget_at: self.forget_at(drive, request.start_before, is_a_stop),
        });
        self.queue(Act::Command(self.drives[drive].place, request), is_a_stop);
    }

    fn request(
        &self,
        at: Moment,
        (drive, ticket, by): (usize, Ticket, Owner),
        wish: &InputCommand,
        expiry: Option<Duration>,
    ) -> CommandRequest {
        let ttl = wish.ttl.unwrap_or(self.settings.command_ttl);
        CommandRequest {
            asker: AskerId::MQTT,
            ticket,
            drive: self.drives[drive].place.drive,
            origin: origin(by),
            order: wish.order.clone(),
            start_before: at.mono + expiry.map_or(ttl, |expiry| expiry.min(ttl)),
            issued: wish.issued,
            epoch: wish.epoch,
        }
    }

    fn forget_at(&self, drive: usize, start_before: MonoTime, is_a_stop: bool) -> MonoTime {
        let control = self.drives[drive].control.as_ref().filter(|_| is_a_stop);
        start_before + control.map_or(Duration::ZERO, |it| it.stop_pending_for) + ANSWERED_WITHIN
    }

    /// Puts `act` behind what waits for the lines; a stop behind the stops that wait.
    fn queue(&mut self, act: Act, is_a_stop: bool) {
        let is_stop_act = |act: &Act| matches!(act, Act::Command(_, request) if request.order.is_stop());
        let stops = self.inward.iter().take_while(|act| is_stop_act(act) || **act == Act::PathOpened).count();
        let place = if is_a_stop { stops } else { self.inward.len() };
        self.inward.insert(place, act);
    }

    /// Before a stop: takes back what still waits here for its drive, and makes room if too many stops are unanswered.
    fn clear_the_way(&mut self, at: Moment, drive: usize) {
        let place = self.drives[drive].place;
        let motion = |act: &Act| match act {
            Act::Command(to, request) if *to == place => {
                let is_motion = !request.order.is_stop() && request.order != Order::Renew;
                is_motion.then_some(request.ticket)
            }
            _ => None,
        };
        let cut: Vec<_> = self.inward.iter().filter_map(motion).collect();
        for ticket in cut {
            let pending = self.unanswered.take(ticket);
            self.take_back(at, pending, Reason::Stopped);
        }
        let oldest = self.unanswered.take_surplus_stop(drive);
        self.take_back(at, oldest, Reason::Newer);
    }

    /// Ends a command that gives way to a newer one.
    fn take_back(&mut self, at: Moment, pending: Option<Pending>, reason: Reason) {
        let Some(pending) = pending else { return };
        let report = Report::new(Outcome::Superseded, reason);
        self.withdraw(&pending, report);
        self.end(at, &pending, report);
    }

    /// Takes a request out of what waits for the lines. If it waited there, no line accounts for it.
    pub(super) fn withdraw(&mut self, pending: &Pending, report: Report) {
        let waiting = self.inward.len();
        self.inward.retain(|act| match act {
            Act::Command(_, request) => request.ticket != pending.ticket,
            Act::Read(_, request) => request.ticket != pending.ticket,
            _ => true,
        });
        if self.inward.len() < waiting {
            self.keep_pending(pending, report);
        }
    }

    /// Accounts for a request that no line saw.
    pub(super) fn keep_pending(&mut self, pending: &Pending, report: Report) {
        if let What::Order(order) = &pending.what {
            self.keep(Some(pending.drive), pending.by, kept::of_order(order), report);
        }
    }

    pub(super) fn read(&mut self, at: Moment, drive: usize, asker: Asker, register: usize, message: &Message<'_>) {
        if !self.unanswered.has_room_for_read() {
            return self.refuse_for(at, drive, &asker, &Refused::plain(Reason::QueueFull), None);
        }
        let description = &self.drives[drive];
        let Some(address) = description.model.registers.get(register).map(|it| it.address) else { return };
        let (place, ticket) = (description.place, self.next_ticket());
        let deadline = at.mono + message.expiry.map_or(READ_WITHIN, |expiry| expiry.min(READ_WITHIN));
        self.unanswered.add(Pending {
            ticket,
            drive,
            by: asker.by,
            id: asker.id,
            what: What::Read(register),
            reply: asker.reply,
            remark: None,
            forget_at: deadline + ANSWERED_WITHIN,
        });
        let (origin, ask) = (origin(asker.by), NativeAsk::Read { address, count: 1 });
        let request = NativeRequest { asker: AskerId::MQTT, ticket, drive: place.drive, origin, ask, deadline };
        self.queue(Act::Read(place, request), false);
    }

    fn next_ticket(&mut self) -> Ticket {
        self.last_ticket += 1;
        Ticket(self.last_ticket)
    }

    /// An id for a commander that gave none.
    pub(super) fn next_id(&mut self) -> Value {
        let Ticket(number) = self.next_ticket();
        format!("{}-{number}", self.run).into()
    }
}
