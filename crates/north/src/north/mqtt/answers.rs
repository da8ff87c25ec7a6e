//! Answers of the lines: each becomes a result, and a read also its value.

use super::dispatch::{AnswerContext, MqttAsker};
use super::params::label;
use super::payload::RefusedCommand;
use super::results::{ReplyTopic, ResultContent, values};
use super::session::MqttSession;
use crate::domain::command::{CommandAnswer, Order, Outcome, Owner, Reason, Report};
use crate::domain::native::{NativeAnswer, NativeOutcome};
use crate::drive::snapshot::ValueReading;
use crate::north::broker::{DriveRequest, PendingRequest, refused_frequency};
use crate::north::clock::ClockMoment;
use crate::north::shown::message;
use serde_json::{Map, Value, json};

impl MqttSession {
    /// Takes the current outcome of one of our commands.
    pub(super) fn answered(&mut self, at: ClockMoment, answer: &CommandAnswer) {
        if answer.is_final {
            if let Some(pending) = self.link.commands.take(answer.ticket) {
                self.end(at, &pending, answer.report);
            }
        } else if let Some(pending) = self.link.commands.get(answer.ticket).cloned()
            && !self.is_left_to_another(&pending, answer.report)
        {
            self.publish_stage(at, &pending, answer.report, false);
        }
    }

    /// Takes the answer to one of our reads.
    pub(super) fn read_answered(&mut self, at: ClockMoment, answer: &NativeAnswer) {
        let Some(pending) = self.link.commands.take(answer.ticket) else {
            return;
        };
        let (DriveRequest::Read(register), NativeOutcome::Words(words)) =
            (&pending.request, &answer.outcome)
        else {
            return self.end(at, &pending, answer.outcome.read_failure());
        };
        let found = self
            .drives
            .get(pending.drive)
            .and_then(|drive| drive.model.registers.get(*register));
        let value =
            found.and_then(|found| found.value(|address| address.word_in(found.address, words)));
        match (value, words.first()) {
            (Some(value), Some(raw)) => {
                self.end_read(
                    at,
                    &pending,
                    *register,
                    ValueReading {
                        value,
                        raw: *raw,
                        at: at.mono,
                    },
                );
            }
            _ => self.end(at, &pending, Report::new(Outcome::Failed, Reason::NoReply)),
        }
    }

    /// Publishes the final result of a command or read.
    pub(super) fn publish_end(
        &mut self,
        at: ClockMoment,
        pending: &PendingRequest<AnswerContext>,
        report: Report,
    ) {
        // Renewals arrive all the time; only their refusal is published.
        let is_done = matches!(report.outcome, Outcome::Acknowledged | Outcome::Confirmed);
        let is_renewal = pending.request == DriveRequest::Order(Order::Renew);
        if !(is_renewal && is_done && pending.context.reply.is_none()) {
            self.publish_stage(at, pending, report, true);
        }
    }

    fn publish_stage(
        &mut self,
        at: ClockMoment,
        pending: &PendingRequest<AnswerContext>,
        report: Report,
        is_final: bool,
    ) {
        let values = match &pending.request {
            DriveRequest::Order(order) => values(&self.drives[pending.drive].model, order, &report),
            DriveRequest::Read(_) => Map::new(),
        };
        let message = refused_frequency(&self.drives[pending.drive], &pending.request, report)
            .or_else(|| {
                Some(message(&self.drives[pending.drive].model, &report))
                    .filter(|it| it != report.reason.text())
            });
        // In addition to why it was refused, if it was.
        let message = match &pending.context.remark {
            None => message,
            Some(remark) => Some(match message {
                Some(why) => format!("{why}; {remark}"),
                None if report.reason == Reason::None => remark.clone(),
                None => format!("{}; {remark}", report.reason.text()),
            }),
        };
        let asker = (
            pending.by,
            &pending.context.id,
            pending.context.reply.as_ref(),
        );
        let stage = ResultStage {
            report,
            is_final,
            is_repeat: false,
            message,
            values,
        };
        self.publish(at, pending.drive, asker, stage);
    }

    fn end_read(
        &mut self,
        at: ClockMoment,
        pending: &PendingRequest<AnswerContext>,
        register: usize,
        reading: ValueReading,
    ) {
        let drive = &self.drives[pending.drive];
        let Some(found) = drive.model.registers.get(register) else {
            return;
        };
        let topic = self
            .topics
            .drive(drive.name.as_str(), &format!("param/{}", label(found)));
        let values = [(label(found).to_owned(), json!(reading.value.value()))]
            .into_iter()
            .collect();
        self.telemetry
            .take_param(pending.drive, register, reading, topic);
        let report = Report::new(Outcome::Confirmed, Reason::None);
        let stage = ResultStage {
            report,
            is_final: true,
            is_repeat: false,
            message: None,
            values,
        };
        self.publish(
            at,
            pending.drive,
            (
                pending.by,
                &pending.context.id,
                pending.context.reply.as_ref(),
            ),
            stage,
        );
    }

    /// Publishes the first outcome of a repeated command.
    pub(super) fn publish_again(
        &mut self,
        at: ClockMoment,
        drive: usize,
        asker: &MqttAsker,
        order: &Order,
        report: Report,
    ) {
        let values = values(&self.drives[drive].model, order, &report);
        let stage = ResultStage {
            report,
            is_final: true,
            is_repeat: true,
            message: None,
            values,
        };
        self.publish(
            at,
            drive,
            (asker.by, &asker.id, asker.reply.as_ref()),
            stage,
        );
    }

    fn publish(
        &mut self,
        at: ClockMoment,
        drive: usize,
        (by, id, reply): (Owner, &Value, Option<&ReplyTopic>),
        stage: ResultStage,
    ) {
        let ResultStage {
            report,
            is_final,
            is_repeat,
            message,
            values,
        } = stage;
        let drive = self.drives[drive].name.as_str();
        let at = self.link.clock.text(at.mono);
        let topic = self.topics.drive(drive, "result");
        let message = message.as_deref();
        let content = ResultContent {
            id,
            drive,
            by,
            report,
            is_final,
            is_repeat,
            message,
            values,
            at,
        };
        self.counters.results_dropped += self.results.add(topic, reply, content);
    }

    /// Publishes why an input is refused that no line ever saw.
    pub(super) fn publish_refusal(
        &mut self,
        at: ClockMoment,
        drive: &str,
        topic: String,
        asker: &MqttAsker,
        refused: &RefusedCommand,
    ) {
        let MqttAsker { by, id, reply } = asker;
        let report = Report::refused(refused.reason);
        let message = Some(refused.message.as_str());
        let values = Map::new();
        let at = self.link.clock.text(at.mono);
        let by = *by;
        let is_final = true;
        let is_repeat = false;
        let content = ResultContent {
            id,
            drive,
            by,
            report,
            is_final,
            is_repeat,
            message,
            values,
            at,
        };
        self.counters.results_dropped += self.results.add(topic, reply.as_ref(), content);
    }
}

/// The result of a command that a line saw.
struct ResultStage {
    report: Report,
    is_final: bool,
    is_repeat: bool,
    /// In place of the reason's own message.
    message: Option<String>,
    values: Map<String, Value>,
}
