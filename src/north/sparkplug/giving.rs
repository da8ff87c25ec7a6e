//! Commands on their way from a host to the lines, and what becomes of them.

use super::node::{self, NodeCommand};
use super::order;
use super::payload::{Payload, Value};
use super::session::Session;
use super::types::Act;
use crate::domain::command::{
    CommandAnswer, CommandRequest, Manner, Order, Origin, Outcome, Owner, Reason, Report, Rights,
};
use crate::domain::ids::{AskerId, Ticket};
use crate::domain::time::MonoTime;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::journal::{Attempt, AttemptId, Tried};
use crate::north::command_words::{Refused, RunWord, run_word, short};
use crate::north::mqtt::{Message, Moment, Version};
use std::collections::VecDeque;
use std::time::Duration;

/// Most commands without an answer over all drives, stops aside.
const COMMANDS_MAX: usize = 64;
/// Most stops of one drive without an answer.
const STOPS_MAX: usize = 4;
/// Most attempts that wait to be fetched.
const KEPT_MAX: usize = 256;
/// How much longer than its deadline a command may stay without its last answer.
const ANSWERED_WITHIN: Duration = Duration::from_secs(60);

const OWNER: Owner = Owner::Sparkplug;

/// One command that is not answered.
#[derive(Debug)]
struct Pending {
    ticket: Ticket,
    /// Place of the drive in the session's list.
    drive: usize,
    order: Order,
    forget_at: MonoTime,
}

/// What is under way to the lines.
#[derive(Debug, Default)]
pub(super) struct Giving {
    /// Stops first.
    inward: VecDeque<(Option<Ticket>, Act)>,
    kept: VecDeque<Act>,
    last_attempt: u64,
    unanswered: Vec<Pending>,
    last_ticket: u64,
}

impl Giving {
    pub(super) fn next(&mut self) -> Option<Act> {
        self.inward.pop_front().map(|(_, act)| act).or_else(|| self.kept.pop_front())
    }

    pub(super) fn path_alive(&mut self) {
        if !self.inward.iter().any(|(_, act)| *act == Act::PathAlive) {
            self.inward.push_back((None, Act::PathAlive));
        }
    }

    pub(super) fn lost(&mut self) {
        self.inward.retain(|(_, act)| *act != Act::PathAlive);
    }

    /// The drives have other places from now on. What those that are gone answer is of no interest.
    pub(super) fn replace(&mut self, old: &[DriveDescription], new: &[DriveDescription]) {
        let moved = |place: usize| new.iter().position(|drive| Some(drive) == old.get(place));
        self.unanswered = std::mem::take(&mut self.unanswered)
            .into_iter()
            .filter_map(|pending| Some(Pending { drive: moved(pending.drive)?, ..pending }))
            .collect();
    }

    pub(super) fn wake(&self) -> Option<MonoTime> {
        self.unanswered.iter().map(|pending| pending.forget_at).min()
    }

    fn take(&mut self, ticket: Ticket) -> Option<Pending> {
        let place = self.unanswered.iter().position(|pending| pending.ticket == ticket)?;
        Some(self.unanswered.remove(place))
    }

    fn has_room(&self) -> bool {
        self.unanswered.iter().filter(|pending| !pending.order.is_stop()).count() < COMMANDS_MAX
    }

    /// Keeps an attempt that no line sees. False if there is no room for it.
    fn keep(&mut self, place: Option<DriveRef>, tried: Tried, report: Report) -> bool {
        if self.kept.len() >= KEPT_MAX {
            return false;
        }
        self.last_attempt += 1;
        let id = AttemptId(self.last_attempt);
        self.kept.push_back(Act::Keep(place, Attempt { id, owner: OWNER, tried, report: Some(report) }));
        true
    }
}

impl Session {
    /// Tickets count on from here.
    pub const fn count_tickets_from(&mut self, first: Ticket) {
        self.giving.last_ticket = first.0;
    }

    /// A command for the edge node: births again, or STOP for all.
    pub(super) fn node_command(&mut self, at: Moment, message: &Message<'_>) {
        let payload = match Payload::read(message.payload) {
            Ok(payload) => payload,
            Err(why) => return self.refuse(None, Some(text("NCMD", &why)), &Refused::new(Reason::NotUnderstood, why)),
        };
        for metric in &payload.metrics {
            match node::asked(metric) {
                NodeCommand::Rebirth(Some(Value::Boolean(true))) if !message.retain => self.ask_for_rebirth(),
                NodeCommand::Rebirth(_) | NodeCommand::Unknown => self.counters.ignored += 1,
                NodeCommand::All(value) => self.stop_all(at, value, message),
            }
        }
    }

    fn stop_all(&mut self, at: Moment, value: Option<&Value>, message: &Message<'_>) {
        let says = if let Some(Value::Text(text)) = value { text.as_str() } else { "" };
        let tried = Some(text(node::STOP_ALL, says));
        if run_word(says) != Ok(RunWord::Stop) {
            let refused = Refused::new(Reason::NotUnderstood, format!("`{}` takes `stop` alone", node::STOP_ALL));
            return self.refuse(None, tried, &refused);
        }
        if self.is_replay(message, true) {
            return self.refuse(None, tried, &Refused::plain(Reason::Retained));
        }
        let may = |drive: &DriveDescription| drive.control.as_ref().is_some_and(|it| it.from_sparkplug);
        let drives: Vec<_> = (0..self.drives.len()).filter(|drive| may(&self.drives[*drive])).collect();
        if drives.is_empty() {
            return self.refuse(None, tried, &Refused::plain(Reason::ReadOnly));
        }
        for drive in drives {
            self.give(at, drive, Order::Stop { setpoint: None }, None);
        }
    }

    /// A command for a drive.
    pub(super) fn device_command(&mut self, at: Moment, device: &str, message: &Message<'_>) {
        let Some(drive) = self.drives.iter().position(|drive| drive.name.as_str() == device) else {
            let refused = Refused::plain(Reason::UnknownDrive);
            return self.refuse(None, Some(text("DCMD", device)), &refused);
        };
        let payload = match Payload::read(message.payload) {
            Ok(payload) => payload,
            Err(why) => {
                let refused = Refused::new(Reason::NotUnderstood, why);
                return self.refuse(Some(drive), Some(text("DCMD", &refused.message)), &refused);
            }
        };
        let asked = order::read(&self.devices[drive], &payload.metrics);
        if let Some(refused) = &asked.refused {
            let tried = said(&payload);
            self.refuse(Some(drive), Some(text("DCMD", &tried)), refused);
        }
        let Some(order) = asked.order else { return };
        match self.may_be_given(at, &order, &payload, message) {
            Ok(issued) => self.give(at, drive, order, issued),
            Err(refused) => self.refuse(Some(drive), tried(&order), &refused),
        }
    }

    /// Replays, what is too old, and what comes while nobody could be told of its outcome. Gives back when it was issued,
    /// on our clock; nothing for a stop.
    fn may_be_given(
        &mut self,
        at: Moment,
        order: &Order,
        payload: &Payload,
        message: &Message<'_>,
    ) -> Result<Option<MonoTime>, Refused> {
        let is_a_stop = order.is_stop();
        if self.is_replay(message, is_a_stop) {
            return Err(Refused::plain(Reason::Retained));
        }
        if is_a_stop {
            return Ok(None);
        }
        if message.duplicate {
            let why = "a repeat of a message, which may be old; commands go at quality of service 0";
            return Err(Refused::new(Reason::Duplicate, why));
        }
        let issued = self.issued(at, payload)?;
        if !self.is_path_alive(at) {
            let why = "the births of this connection are not told and proven yet, or the primary host is offline";
            return Err(Refused::new(Reason::CommanderLost, why));
        }
        if self.path.is_unproven() {
            let why =
                "the gateway's probe through the broker is late, so that the command may have waited: send it again";
            return Err(Refused::new(Reason::Stale, why));
        }
        if !self.giving.has_room() {
            return Err(Refused::plain(Reason::QueueFull));
        }
        Ok(Some(issued))
    }

    /// With MQTT 5 no retained message is delivered at subscribe, so a stop with the retain flag is a live one.
    fn is_replay(&self, message: &Message<'_>, is_a_stop: bool) -> bool {
        message.retain && !(is_a_stop && self.settings.version == Version::V5)
    }

    fn issued(&mut self, at: Moment, payload: &Payload) -> Result<MonoTime, Refused> {
        let Some(timestamp) = payload.timestamp.map(|it| i64::try_from(it).unwrap_or(i64::MAX)) else {
            let why = "the message has no timestamp, so nobody can tell whether it is an old one";
            return Err(Refused::new(Reason::Stale, why));
        };
        let issue = self.issued.take(at, timestamp)?;
        let most = self.settings.max_command_age;
        if issue.age > most {
            let why = format!(
                "by its timestamp it was issued {:.1} s ago; taken are {} s at most: are the clocks of host and gateway \
                 set?",
                issue.age.as_secs_f64(),
                most.as_secs_f64(),
            );
            return Err(Refused::new(Reason::Stale, why));
        }
        Ok(issue.moment)
    }

    fn give(&mut self, at: Moment, drive: usize, order: Order, issued: Option<MonoTime>) {
        let is_a_stop = order.is_stop();
        if is_a_stop {
            self.clear_the_way(drive);
        }
        self.giving.last_ticket += 1;
        let ticket = Ticket(self.giving.last_ticket);
        let start_before = at.mono + self.settings.command_ttl;
        let description = &self.drives[drive];
        let stays = description.control.as_ref().filter(|_| is_a_stop).map_or(Duration::ZERO, |it| it.stop_pending_for);
        let origin = Origin { owner: OWNER, rights: Rights { write: true, stop: true }, manner: Manner::Once };
        let request = CommandRequest {
            asker: AskerId::SPARKPLUG,
            ticket,
            drive: description.place.drive,
            origin,
            order: order.clone(),
            start_before,
            issued,
            epoch: None,
        };
        let act = (Some(ticket), Act::Command(description.place, request));
        let is_stop_act = |act: &Act| matches!(act, Act::Command(_, request) if request.order.is_stop());
        let stops = self.giving.inward.iter().take_while(|(_, act)| is_stop_act(act)).count();
        let place = if is_a_stop { stops } else { self.giving.inward.len() };
        self.giving.inward.insert(place, act);
        let forget_at = start_before + stays + ANSWERED_WITHIN;
        self.giving.unanswered.push(Pending { ticket, drive, order, forget_at });
        self.counters.commands += 1;
    }

    /// Before a stop: takes back what still waits here for its drive, and the oldest stop where too many wait.
    fn clear_the_way(&mut self, drive: usize) {
        let waiting: Vec<_> = self.giving.inward.iter().filter_map(|(ticket, _)| *ticket).collect();
        for ticket in waiting {
            let is_cut = |it: &Pending| it.ticket == ticket && it.drive == drive && !it.order.is_stop();
            if !self.giving.unanswered.iter().any(is_cut) {
                continue;
            }
            self.giving.inward.retain(|(waits, _)| *waits != Some(ticket));
            if let Some(pending) = self.giving.take(ticket) {
                let report = Report::new(Outcome::Superseded, Reason::Stopped);
                self.keep(Some(drive), tried(&pending.order), report);
                self.tell(drive, report, None);
            }
        }
        let its_stops = |it: &&Pending| it.drive == drive && it.order.is_stop();
        if self.giving.unanswered.iter().filter(its_stops).count() >= STOPS_MAX {
            let oldest = self.giving.unanswered.iter().find(its_stops).map(|it| it.ticket);
            // The line accounts for it.
            oldest.and_then(|ticket| self.giving.take(ticket));
        }
    }

    fn refuse(&mut self, drive: Option<usize>, tried: Option<Tried>, refused: &Refused) {
        self.counters.refused += 1;
        self.counters.refused_retained += u64::from(refused.reason == Reason::Retained);
        self.counters.refused_stale += u64::from(matches!(refused.reason, Reason::Stale | Reason::ClockAhead));
        let report = Report::refused(refused.reason);
        self.keep(drive, tried, report);
        if let Some(device) = drive.and_then(|drive| self.devices.get_mut(drive)) {
            device.tell(report, refused.message.clone());
        }
    }

    fn keep(&mut self, drive: Option<usize>, tried: Option<Tried>, report: Report) {
        let Some(tried) = tried else { return };
        let place = drive.and_then(|drive| self.drives.get(drive)).map(|drive| drive.place);
        self.counters.attempts_lost += u64::from(!self.giving.keep(place, tried, report));
    }

    /// Takes what became of a command so far. Answers to others, or to what is no longer waited for, are ignored.
    pub fn command_answer(&mut self, answer: &CommandAnswer) {
        if answer.asker != AskerId::SPARKPLUG {
            return;
        }
        let Some(pending) = self.giving.take(answer.ticket) else { return };
        let drive = pending.drive;
        // A renewal that is done is no news.
        if pending.order != Order::Renew || answer.report.outcome == Outcome::Refused {
            self.tell(drive, answer.report, Some(&pending));
        }
        if !answer.is_final {
            self.giving.unanswered.push(pending);
        }
    }

    /// Takes word that a line could not take the command with this ticket, because its inbox was full.
    pub fn refused_by_line(&mut self, ticket: Ticket) {
        let Some(pending) = self.giving.take(ticket) else { return };
        let report = Report::refused(Reason::QueueFull);
        self.keep(Some(pending.drive), tried(&pending.order), report);
        self.tell(pending.drive, report, Some(&pending));
    }

    /// Gives up what should have been answered long ago.
    pub(super) fn drop_overdue(&mut self, at: MonoTime) {
        while let Some(ticket) = self.giving.unanswered.iter().find(|it| it.forget_at <= at).map(|it| it.ticket) {
            let Some(pending) = self.giving.take(ticket) else { return };
            self.counters.unanswered += 1;
            self.tell(pending.drive, Report::new(Outcome::Unknown, Reason::NoReply), Some(&pending));
        }
    }

    fn tell(&mut self, drive: usize, report: Report, pending: Option<&Pending>) {
        let limits = pending.and_then(|pending| self.limits_of(pending, report));
        let message = limits.unwrap_or_else(|| report.message());
        if let Some(device) = self.devices.get_mut(drive) {
            device.tell(report, message);
        }
    }

    /// A frequency outside the limits is refused with the limits.
    fn limits_of(&self, pending: &Pending, report: Report) -> Option<String> {
        let control = self.drives.get(pending.drive)?.control.as_ref()?;
        let Order::Go(go) = &pending.order else { return None };
        let frequency = go.frequency().filter(|_| report.reason == Reason::OutsideLimits)?;
        Some(format!("{frequency} Hz is outside the limits of {} to {} Hz", control.least, control.most))
    }
}

/// What is tried by `order`. To renew a lease is no attempt.
fn tried(order: &Order) -> Option<Tried> {
    (*order != Order::Renew).then(|| Tried::Order(order.clone()))
}

/// What was tried by something that is no order, for the audit: on one line, and short.
fn text(place: &str, says: &str) -> Tried {
    let visible = |c: char| if c.is_control() { ' ' } else { c };
    Tried::Text(format!("{place}: {}", short(says)).chars().map(visible).collect())
}

/// The metrics of a command in words.
fn said(payload: &Payload) -> String {
    const METRICS_MAX: usize = 4;
    let metric = |metric: &super::payload::Metric| {
        let name = match (&metric.name, metric.alias) {
            (Some(name), _) => short(name),
            (None, Some(alias)) => format!("alias {alias}"),
            (None, None) => "?".to_owned(),
        };
        match &metric.value {
            Some(Value::Text(text)) => format!("{name} = {}", short(text)),
            Some(Value::Double(number)) => format!("{name} = {number}"),
            Some(Value::Float(number)) => format!("{name} = {number}"),
            Some(Value::Boolean(value)) => format!("{name} = {value}"),
            Some(Value::Int(bits)) => format!("{name} = {}", bits.cast_signed()),
            Some(Value::Long(bits)) => format!("{name} = {}", bits.cast_signed()),
            None => format!("{name} = null"),
        }
    };
    payload.metrics.iter().take(METRICS_MAX).map(metric).collect::<Vec<_>>().join(", ")
}
