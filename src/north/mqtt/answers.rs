//! Answers of the lines: each becomes a result, and a read its value.

use super::giving::Asker;
use super::params::label;
use super::payload::Refused;
use super::pending::{Pending, What};
use super::results::{Reply, ResultContent, named, values};
use super::session::Session;
use super::types::Moment;
use crate::domain::command::{CommandAnswer, Order, Outcome, Owner, Reason, Report};
use crate::domain::ids::{AskerId, Ticket};
use crate::domain::native::{NativeAnswer, NativeOutcome};
use crate::drive::snapshot::Reading;
use serde_json::{Map, Value};

impl Session {
    /// Takes what became of a command so far. Answers to others, or to what is no longer waited for, are ignored.
    pub fn command_answer(&mut self, at: Moment, answer: &CommandAnswer) {
        self.clock.see(at);
        if answer.asker != AskerId::MQTT {
            return;
        }
        if answer.is_final {
            if let Some(pending) = self.unanswered.take(answer.ticket) {
                self.end(at, &pending, answer.report);
            }
        } else if let Some(pending) = self.unanswered.get(answer.ticket).cloned() {
            self.tell_stage(at, &pending, answer.report, false);
        }
    }

    /// Takes the answer to a read. Answers to others, or to what is no longer waited for, are ignored.
    pub fn native_answer(&mut self, at: Moment, answer: &NativeAnswer) {
        self.clock.see(at);
        let pending = Some(answer.ticket).filter(|_| answer.asker == AskerId::MQTT);
        let Some(pending) = pending.and_then(|ticket| self.unanswered.take(ticket)) else { return };
        let (What::Read(register), NativeOutcome::Words(words)) = (&pending.what, &answer.outcome) else {
            return self.end(at, &pending, answer.outcome.read_failure());
        };
        match words.first() {
            Some(word) => self.end_read(at, &pending, *register, *word),
            None => self.end(at, &pending, Report::new(Outcome::Failed, Reason::NoReply)),
        }
    }

    /// Takes word that a line could not take the request with this ticket, because its inbox was full.
    pub fn refused_by_line(&mut self, at: Moment, ticket: Ticket) {
        self.clock.see(at);
        let Some(pending) = self.unanswered.take(ticket) else { return };
        let report = Report::refused(Reason::QueueFull);
        self.keep_pending(&pending, report);
        self.end(at, &pending, report);
    }

    /// Gives up what should have been answered long ago.
    pub(super) fn drop_overdue(&mut self, at: Moment) {
        while let Some(pending) = self.unanswered.take_overdue(at.mono) {
            self.counters.unanswered += 1;
            let outcome = if matches!(pending.what, What::Read(_)) { Outcome::Failed } else { Outcome::Unknown };
            let report = Report::new(outcome, Reason::NoReply);
            self.withdraw(&pending, report);
            self.end(at, &pending, report);
        }
    }

    /// Tells the last word on a command.
    pub(super) fn end(&mut self, at: Moment, pending: &Pending, report: Report) {
        self.seen[pending.drive].ended(pending.ticket, report);
        // Renewals come all the time; only their refusal is news.
        let is_done = matches!(report.outcome, Outcome::Acknowledged | Outcome::Confirmed);
        let is_renewal = pending.what == What::Order(Order::Renew);
        if !(is_renewal && is_done && pending.reply.is_none()) {
            self.tell_stage(at, pending, report, true);
        }
    }

    fn tell_stage(&mut self, at: Moment, pending: &Pending, report: Report, is_final: bool) {
        let values = match &pending.what {
            What::Order(order) => values(&self.drives[pending.drive].model, order, &report),
            What::Read(_) => Map::new(),
        };
        let message = self.limits_of(pending, report).or_else(|| report.holder.map(|_| report.message()));
        let own_words = || Some(report.reason.text().to_owned()).filter(|_| report.reason != Reason::None);
        // Beside why it was refused, if it was.
        let message = pending.remark.as_ref().map_or_else(
            || message.clone(),
            |remark| {
                Some(
                    message.clone().or_else(own_words).map_or_else(|| remark.clone(), |why| format!("{why}; {remark}")),
                )
            },
        );
        let asker = (pending.by, &pending.id, pending.reply.as_ref());
        let stage = Stage { report, is_final, is_repeat: false, message, values };
        self.tell(at, pending.drive, asker, stage);
    }

    /// A frequency outside the limits is refused with the limits.
    fn limits_of(&self, pending: &Pending, report: Report) -> Option<String> {
        let control = self.drives[pending.drive].control.as_ref()?;
        let What::Order(Order::Go(go)) = &pending.what else { return None };
        let frequency = go.frequency().filter(|_| report.reason == Reason::OutsideLimits)?;
        Some(format!("{frequency} Hz is outside the limits of {} to {} Hz", control.least, control.most))
    }

    fn end_read(&mut self, at: Moment, pending: &Pending, register: usize, word: u16) {
        let drive = &self.drives[pending.drive];
        let Some(found) = drive.model.registers.get(register) else { return };
        let topic = self.topics.drive(drive.name.as_str(), &format!("param/{}", label(found)));
        let values = [named(found, word)].into_iter().collect();
        self.telemetry.take_param(pending.drive, register, Reading { raw: word, at: at.mono }, topic);
        let report = Report::new(Outcome::Confirmed, Reason::None);
        let stage = Stage { report, is_final: true, is_repeat: false, message: None, values };
        self.tell(at, pending.drive, (pending.by, &pending.id, pending.reply.as_ref()), stage);
    }

    /// Tells the first outcome of a command that came again.
    pub(super) fn tell_again(&mut self, at: Moment, drive: usize, asker: &Asker, order: &Order, report: Report) {
        let values = values(&self.drives[drive].model, order, &report);
        let stage = Stage { report, is_final: true, is_repeat: true, message: None, values };
        self.tell(at, drive, (asker.by, &asker.id, asker.reply.as_ref()), stage);
    }

    fn tell(&mut self, at: Moment, drive: usize, (by, id, reply): (Owner, &Value, Option<&Reply>), stage: Stage) {
        let Stage { report, is_final, is_repeat, message, values } = stage;
        let (drive, at) = (self.drives[drive].name.as_str(), self.clock.text(at.mono));
        let topic = self.topics.drive(drive, "result");
        let message = message.as_deref();
        let told = ResultContent { id, drive, by, report, is_final, is_repeat, message, values, at };
        self.counters.results_dropped += self.results.tell(topic, reply, told);
    }

    /// Tells why an input is refused, which no line ever saw.
    pub(super) fn tell_refusal(&mut self, at: Moment, drive: &str, topic: String, asker: &Asker, refused: &Refused) {
        let Asker { by, id, reply } = asker;
        let (report, message) = (Report::refused(refused.reason), Some(refused.message.as_str()));
        let (values, at) = (Map::new(), self.clock.text(at.mono));
        let (by, is_final, is_repeat) = (*by, true, false);
        let told = ResultContent { id, drive, by, report, is_final, is_repeat, message, values, at };
        self.counters.results_dropped += self.results.tell(topic, reply.as_ref(), told);
    }
}

/// What there is to tell about a command that a line saw.
struct Stage {
    report: Report,
    is_final: bool,
    is_repeat: bool,
    /// Instead of the reason's own words.
    message: Option<String>,
    values: Map<String, Value>,
}
