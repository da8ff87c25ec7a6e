//! Commands and reads that were taken from messages, on their way to the lines.

use super::command_ids::IdState;
use super::payload::{InputCommand, RefusedCommand};
use super::results::ReplyTopic;
use super::session::MqttSession;
use crate::domain::command::{Owner, Reason, Report};
use crate::domain::ids::Ticket;
use crate::north::broker::{BrokerMessage, NewCommand, NewRead, PendingRequest};
use crate::north::clock::ClockMoment;
use serde_json::Value;
use std::time::Duration;

/// How long a read may take, including a line that is busy with a silent drive.
const READ_WITHIN: Duration = Duration::from_secs(5);
const RETAINED_STOP: &str =
    "executed, but published with the retain flag: it would be refused as a replay later";

/// Who sent the request, where the answer is sent, and under which id.
pub(super) struct MqttAsker {
    pub(super) by: Owner,
    pub(super) id: Value,
    pub(super) reply: Option<ReplyTopic>,
}

/// What the answer to a command or read needs.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AnswerContext {
    pub(super) id: Value,
    pub(super) reply: Option<ReplyTopic>,
    /// Additional content of its results.
    pub(super) remark: Option<String>,
}

impl MqttSession {
    /// Hands an order to its drive.
    pub(super) fn give(
        &mut self,
        at: ClockMoment,
        drive: usize,
        asker: MqttAsker,
        wish: InputCommand,
        message: &BrokerMessage<'_>,
    ) {
        let is_a_stop = wish.order.is_stop();
        if is_a_stop {
            while let Some((pending, report)) = self.link.commands.give_way_to_stop(drive) {
                self.end(at, &pending, report);
            }
        }
        let ticket = self.link.commands.next_ticket();
        let is_new_id = || {
            let by_id = (asker.by, &asker.id);
            self.seen[drive].look(at.mono, by_id, &wish.order, wish.epoch) == IdState::New
        };
        if wish.id.is_some() && is_new_id() {
            self.seen[drive].add(
                at.mono,
                (asker.by, asker.id.clone()),
                wish.order.clone(),
                wish.epoch,
                ticket,
            );
        }
        let is_retained_stop = is_a_stop && message.retain;
        self.counters.retained_stops += u64::from(is_retained_stop);
        self.counters.commands += 1;
        let ttl = wish.ttl.unwrap_or(self.settings.command_ttl);
        let remark = if is_retained_stop {
            Some(RETAINED_STOP.to_owned())
        } else {
            wish.remark
        };
        let command = NewCommand {
            ticket,
            drive,
            by: asker.by,
            order: wish.order,
            start_before: at.mono + message.expiry.map_or(ttl, |expiry| expiry.min(ttl)),
            issued: wish.issued,
            epoch: wish.epoch,
            context: AnswerContext {
                id: asker.id,
                reply: asker.reply,
                remark,
            },
        };
        self.link.commands.give(&self.drives[drive], command);
    }

    pub(super) fn read(
        &mut self,
        at: ClockMoment,
        drive: usize,
        asker: MqttAsker,
        register: usize,
        message: &BrokerMessage<'_>,
    ) {
        if !self.link.commands.has_room_for_read() {
            return self.refuse_for(
                at,
                drive,
                &asker,
                &RefusedCommand::plain(Reason::QueueFull),
                None,
            );
        }
        let description = &self.drives[drive];
        let Some(address) = description
            .model
            .registers
            .get(register)
            .map(|it| it.address)
        else {
            return;
        };
        let read = NewRead {
            ticket: self.link.commands.next_ticket(),
            drive,
            by: asker.by,
            register,
            address,
            deadline: at.mono
                + message
                    .expiry
                    .map_or(READ_WITHIN, |expiry| expiry.min(READ_WITHIN)),
            context: AnswerContext {
                id: asker.id,
                reply: asker.reply,
                remark: None,
            },
        };
        self.link.commands.read(description, read);
    }

    /// Gives up what should have been answered long ago.
    pub(super) fn drop_overdue(&mut self, at: ClockMoment) {
        while let Some((pending, report)) = self.link.commands.take_overdue(at.mono) {
            self.counters.unanswered += 1;
            self.end(at, &pending, report);
        }
    }

    /// Publishes the final result of a command or read.
    pub(super) fn end(
        &mut self,
        at: ClockMoment,
        pending: &PendingRequest<AnswerContext>,
        report: Report,
    ) {
        if self.is_left_to_another(pending, report) {
            return self.seen[pending.drive].forget(pending.ticket);
        }
        self.seen[pending.drive].ended(pending.ticket, report);
        self.publish_end(at, pending, report);
    }

    /// An id for a client that gave none.
    pub(super) fn next_id(&mut self) -> Value {
        let Ticket(number) = self.link.commands.next_ticket();
        format!("{}-{number}", self.run).into()
    }
}
