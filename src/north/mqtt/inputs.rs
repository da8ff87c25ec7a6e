//! Messages from the broker: what each asks for, whether it is taken, and the command that comes of it.

use super::path::Returned;
use super::payload::{self, Asked, Refused, Wish, is_stop};
use super::pending::{Pending, What};
use super::results::Reply;
use super::seen::Known;
use super::session::Session;
use super::topics::{Inbound, Input};
use super::types::{Act, LeaseMode, Message, Moment, Version};
use crate::domain::command::{CommandRequest, Manner, Order, Origin, Outcome, Owner, Reason, Report, Rights};
use crate::domain::ids::{AskerId, Name, Ticket};
use crate::domain::native::{NativeAsk, NativeRequest};
use crate::domain::problem::nearest;
use crate::domain::time::MonoTime;
use serde_json::Value;
use std::time::Duration;

/// How long a read may take: a line that is busy with a silent drive included.
const READ_WITHIN: Duration = Duration::from_secs(5);
/// How much longer than its deadline a command may stay without its last answer.
const ANSWERED_WITHIN: Duration = Duration::from_secs(60);
/// How far ahead of ours the clock of a commander may be.
const AHEAD_MAX: Duration = Duration::from_secs(60);
/// The longest correlation data that is carried back.
const CORRELATION_MAX_BYTES: usize = 1_024;
const RETAINED_STOP: &str = "executed, but published with the retain flag: it would be refused as a replay later";

const ORIGIN: Origin = Origin { owner: Owner::Mqtt, rights: Rights { write: true, stop: true }, manner: Manner::Once };

/// Where the answer to a message goes, and under which id.
struct Asker {
    id: Value,
    reply: Option<Reply>,
}

impl Session {
    /// Takes a message. It gives at most one command, one for each drive if it is for all.
    pub(super) fn message(&mut self, at: Moment, message: &Message<'_>) {
        self.counters.messages_in += 1;
        match self.topics.parse(message.topic) {
            None => self.counters.ignored += 1,
            Some(Inbound::Probe) => self.probe(at, message),
            Some(Inbound::Alive) => {
                let says = std::str::from_utf8(message.payload).unwrap_or_default();
                self.are_commanders_gone = says.trim().eq_ignore_ascii_case("offline");
            }
            Some(Inbound::AllRun) => self.all_run(at, message),
            Some(Inbound::Drive(name, input)) => self.drive_input(at, name, input, message),
        }
    }

    fn probe(&mut self, at: Moment, message: &Message<'_>) {
        if message.retain || self.path.returned(at.mono, message.payload) == Returned::Foreign {
            return;
        }
        let is_sign_of_life = self.settings.lease == LeaseMode::Session && !self.are_commanders_gone;
        if is_sign_of_life && !self.inward.contains(&Act::PathAlive) {
            self.inward.push_back(Act::PathAlive);
        }
    }

    fn all_run(&mut self, at: Moment, message: &Message<'_>) {
        if message.payload.is_empty() {
            return;
        }
        let reply = self.reply_to(message);
        let asked = payload::read_all(message.payload).and_then(|()| self.live(message, true));
        let controlled: Vec<_> = (0..self.drives.len()).filter(|drive| self.drives[*drive].control.is_some()).collect();
        let refused = match asked {
            Err(refused) => refused,
            Ok(()) if controlled.is_empty() => Refused::plain(Reason::ReadOnly),
            Ok(()) => {
                for drive in controlled {
                    let asker = Asker { id: self.next_id(), reply: reply.clone() };
                    self.give(at, drive, asker, Wish::plain(Order::Stop { setpoint: None }), message);
                }
                return;
            }
        };
        let refused = if message.retain { self.live(message, false).err().unwrap_or(refused) } else { refused };
        let (topic, asker) = (self.topics.gateway("all/result"), Asker { id: self.next_id(), reply });
        self.refuse(at, "all", topic, &asker, &refused);
    }

    fn drive_input(&mut self, at: Moment, name: &str, input: Input<'_>, message: &Message<'_>) {
        if message.payload.is_empty() && (message.retain || !input.takes_empty()) {
            return;
        }
        let Some(drive) = self.drives.iter().position(|drive| drive.name.as_str() == name) else {
            return self.unknown_drive(at, name, message);
        };
        let (id, asked) = payload::read(input, message.payload, &self.drives[drive].model);
        let is_a_stop = matches!(&asked, Ok(Asked::Order(wish)) if is_stop(&wish.order));
        let taken = self.live(message, is_a_stop).and(asked).and_then(|asked| self.once(input, message, asked));
        let reply = self.reply_to(message);
        let asker = Asker { id: id.unwrap_or_else(|| self.next_id()), reply };
        match taken {
            Err(refused) => self.refuse_for(at, drive, &asker, &refused),
            Ok(Asked::Read(register)) => self.read(at, drive, asker, register, message),
            Ok(Asked::Order(wish)) if is_a_stop => self.give(at, drive, asker, wish, message),
            Ok(Asked::Order(wish)) => self.order(at, drive, asker, wish, message),
        }
    }

    /// Refuses replays. With MQTT 5 none is delivered at subscribe, so a stop with the retain flag is a live one.
    fn live(&self, message: &Message<'_>, is_a_stop: bool) -> Result<(), Refused> {
        let is_live = !message.retain || is_a_stop && self.settings.version == Version::V5;
        if is_live { Ok(()) } else { Err(Refused::plain(Reason::Retained)) }
    }

    /// Refuses repeats of what carries no id by which they could be told.
    fn once(&self, input: Input<'_>, message: &Message<'_>, asked: Asked) -> Result<Asked, Refused> {
        let is_exempt = match &asked {
            Asked::Read(_) => input.only_reads(),
            Asked::Order(wish) => wish.id.is_some() || is_stop(&wish.order),
        };
        if message.duplicate && !is_exempt {
            return Err(Refused::new(Reason::Duplicate, "a repeat of a message without an id, which may be old"));
        }
        Ok(asked)
    }

    fn unknown_drive(&mut self, at: Moment, name: &str, message: &Message<'_>) {
        if Name::new(name).is_none() {
            self.counters.ignored += 1;
            return;
        }
        let near = nearest(name, self.drives.iter().map(|drive| drive.name.as_str()));
        let hint = near.map_or_else(String::new, |near| format!("; is it `{near}`?"));
        let unknown = Refused::new(Reason::UnknownDrive, format!("there is no drive `{name}`{hint}"));
        let refused = self.live(message, false).err().unwrap_or(unknown);
        let asker = Asker { id: self.next_id(), reply: self.reply_to(message) };
        let topic = self.topics.drive(name, "result");
        self.refuse(at, name, topic, &asker, &refused);
    }

    /// An order that is held to deadline, ids and bounds.
    fn order(&mut self, at: Moment, drive: usize, asker: Asker, wish: Wish, message: &Message<'_>) {
        if wish.id.is_some() {
            match self.seen[drive].look(at.mono, &asker.id, &wish.order, wish.epoch) {
                Known::New => {}
                Known::UnderWay => return self.counters.duplicates += 1,
                Known::Ended(report) => return self.repeat(at, drive, &asker, &wish, report),
                Known::Other => return self.refuse_for(at, drive, &asker, &Refused::plain(Reason::Duplicate)),
            }
        }
        if self.is_stale(at, &wish) {
            return self.refuse_for(at, drive, &asker, &Refused::plain(Reason::Stale));
        }
        if !self.unanswered.has_room_for_command() {
            return self.refuse_for(at, drive, &asker, &Refused::plain(Reason::QueueFull));
        }
        self.give(at, drive, asker, wish, message);
    }

    fn repeat(&mut self, at: Moment, drive: usize, asker: &Asker, wish: &Wish, report: Report) {
        self.counters.duplicates += 1;
        let reply = asker.reply.as_ref();
        self.tell_again(at, drive, &asker.id, reply, &wish.order, report);
    }

    fn is_stale(&self, at: Moment, wish: &Wish) -> bool {
        let Some(issued_at) = wish.issued_at else { return false };
        let age_ms = at.wall.unix_ms.saturating_sub(issued_at);
        let ttl = wish.ttl.unwrap_or(self.settings.command_ttl);
        let millis = |span: Duration| i64::try_from(span.as_millis()).unwrap_or(i64::MAX);
        age_ms > millis(ttl) || age_ms < -millis(AHEAD_MAX)
    }

    /// Hands an order to its drive.
    fn give(&mut self, at: Moment, drive: usize, asker: Asker, wish: Wish, message: &Message<'_>) {
        let is_a_stop = is_stop(&wish.order);
        if is_a_stop {
            self.clear_the_way(at, drive);
        }
        let ticket = self.next_ticket();
        let is_new_id = || self.seen[drive].look(at.mono, &asker.id, &wish.order, wish.epoch) == Known::New;
        if wish.id.is_some() && is_new_id() {
            self.seen[drive].add(at.mono, asker.id.clone(), wish.order.clone(), wish.epoch, ticket);
        }
        let is_retained_stop = is_a_stop && message.retain;
        self.counters.retained_stops += u64::from(is_retained_stop);
        self.counters.commands += 1;
        let request = self.request(at, drive, ticket, &wish, message.expiry);
        self.unanswered.add(Pending {
            ticket,
            drive,
            id: asker.id,
            what: What::Order(wish.order),
            reply: asker.reply,
            remark: is_retained_stop.then_some(RETAINED_STOP),
            holder: None,
            forget_at: self.forget_at(drive, request.start_before, is_a_stop),
        });
        self.queue(Act::Command(self.drives[drive].place, request), is_a_stop);
    }

    fn request(
        &self,
        at: Moment,
        drive: usize,
        ticket: Ticket,
        wish: &Wish,
        expiry: Option<Duration>,
    ) -> CommandRequest {
        let ttl = wish.ttl.unwrap_or(self.settings.command_ttl);
        CommandRequest {
            asker: AskerId::MQTT,
            ticket,
            drive: self.drives[drive].place.drive,
            origin: ORIGIN,
            order: wish.order.clone(),
            start_before: at.mono + expiry.map_or(ttl, |expiry| expiry.min(ttl)),
            issued: wish.issued_at.map(|issued_at| issued(at, issued_at)),
            epoch: wish.epoch,
        }
    }

    fn forget_at(&self, drive: usize, start_before: MonoTime, is_a_stop: bool) -> MonoTime {
        let control = self.drives[drive].control.as_ref().filter(|_| is_a_stop);
        start_before + control.map_or(Duration::ZERO, |it| it.stop_pending_for) + ANSWERED_WITHIN
    }

    /// Puts `act` behind what waits for the lines; a stop behind the stops that wait.
    fn queue(&mut self, act: Act, is_a_stop: bool) {
        let is_stop_act = |act: &Act| matches!(act, Act::Command(_, request) if is_stop(&request.order));
        let stops = self.inward.iter().take_while(|act| is_stop_act(act) || **act == Act::PathOpened).count();
        let place = if is_a_stop { stops } else { self.inward.len() };
        self.inward.insert(place, act);
    }

    /// Before a stop: takes back what still waits here for its drive, and makes room if too many stops are unanswered.
    fn clear_the_way(&mut self, at: Moment, drive: usize) {
        let place = self.drives[drive].place;
        let motion = |act: &Act| match act {
            Act::Command(to, request) if *to == place => {
                let is_motion = !is_stop(&request.order) && request.order != Order::Renew;
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
        self.unqueue(pending.ticket);
        self.end(at, &pending, Report::new(Outcome::Superseded, reason));
    }

    /// Takes what has this ticket out of what waits for the lines.
    pub(super) fn unqueue(&mut self, ticket: Ticket) {
        self.inward.retain(|act| match act {
            Act::Command(_, request) => request.ticket != ticket,
            Act::Read(_, request) => request.ticket != ticket,
            _ => true,
        });
    }

    fn read(&mut self, at: Moment, drive: usize, asker: Asker, register: usize, message: &Message<'_>) {
        if !self.unanswered.has_room_for_read() {
            return self.refuse_for(at, drive, &asker, &Refused::plain(Reason::QueueFull));
        }
        let description = &self.drives[drive];
        let Some(address) = description.model.registers.get(register).map(|it| it.address) else { return };
        let (place, ticket) = (description.place, self.next_ticket());
        let deadline = at.mono + message.expiry.map_or(READ_WITHIN, |expiry| expiry.min(READ_WITHIN));
        self.unanswered.add(Pending {
            ticket,
            drive,
            id: asker.id,
            what: What::Read(register),
            reply: asker.reply,
            remark: None,
            holder: None,
            forget_at: deadline + ANSWERED_WITHIN,
        });
        let (asker, ask) = (AskerId::MQTT, NativeAsk::Read { address, count: 1 });
        let request = NativeRequest { asker, ticket, drive: place.drive, origin: ORIGIN, ask, deadline };
        self.queue(Act::Read(place, request), false);
    }

    fn refuse_for(&mut self, at: Moment, drive: usize, asker: &Asker, refused: &Refused) {
        let name = self.drives[drive].name.clone();
        let topic = self.topics.drive(name.as_str(), "result");
        self.refuse(at, name.as_str(), topic, asker, refused);
    }

    fn refuse(&mut self, at: Moment, drive: &str, topic: String, asker: &Asker, refused: &Refused) {
        self.counters.refused += 1;
        self.counters.refused_retained += u64::from(refused.reason == Reason::Retained);
        self.counters.duplicates += u64::from(refused.reason == Reason::Duplicate);
        self.tell_refusal(at, drive, topic, (&asker.id, asker.reply.as_ref()), refused);
    }

    /// Where the requester wants the response, if that is allowed.
    fn reply_to(&mut self, message: &Message<'_>) -> Option<Reply> {
        let topic = message.response_topic.filter(|_| self.settings.version == Version::V5)?;
        let allowed = self.settings.response_prefix.as_deref();
        let is_short = message.correlation.is_none_or(|it| it.len() <= CORRELATION_MAX_BYTES);
        if !is_short || !allowed.is_some_and(|allowed| self.topics.may_respond_to(topic, allowed)) {
            self.counters.responses_ignored += 1;
            return None;
        }
        Some(Reply { topic: topic.to_owned(), correlation: message.correlation.map(<[u8]>::to_vec) })
    }

    fn next_ticket(&mut self) -> Ticket {
        self.last_ticket += 1;
        Ticket(self.last_ticket)
    }

    /// An id for a commander that gave none.
    fn next_id(&mut self) -> Value {
        let Ticket(number) = self.next_ticket();
        format!("{}-{number}", self.run).into()
    }
}

/// When a command was issued, on our clock. Nothing is issued after it came.
fn issued(at: Moment, issued_at: i64) -> MonoTime {
    let age_ms = u64::try_from(at.wall.unix_ms.saturating_sub(issued_at)).unwrap_or(0);
    at.mono.before(Duration::from_millis(age_ms))
}
