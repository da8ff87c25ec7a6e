//! Commands of hosts: what each requests, whether it is accepted, and its outcome.

use super::node::{self, NodeCommand};
use super::order;
use super::payload::{PayloadValue, SparkplugPayload};
use super::session::SparkplugSession;
use crate::domain::command::{CommandAnswer, Order, Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::journal::TriedWrite;
use crate::north::broker::{
    BrokerMessage, BrokerSession, DriveRequest, MqttVersion, NewCommand, PendingRequest,
    refused_frequency, tried_by, tried_text,
};
use crate::north::clock::ClockMoment;
use crate::north::command_words::{RefusedCommand, RunWord, run_word, short};
use crate::north::shown::message;

impl SparkplugSession {
    /// A command for the edge node: births again, or STOP for all.
    pub(super) fn node_command(&mut self, at: ClockMoment, message: &BrokerMessage<'_>) {
        let payload = match SparkplugPayload::read(message.payload) {
            Ok(payload) => payload,
            Err(why) => {
                return self.refuse(
                    None,
                    Some(tried_text("NCMD", &why)),
                    &RefusedCommand::new(Reason::NotUnderstood, why),
                );
            }
        };
        for metric in &payload.metrics {
            match node::asked(metric) {
                NodeCommand::Rebirth(Some(PayloadValue::Boolean(true))) if !message.retain => {
                    self.ask_for_rebirth()
                }
                NodeCommand::Rebirth(_) | NodeCommand::Unknown => self.counters.ignored += 1,
                NodeCommand::All(value) => self.stop_all(at, value, message),
            }
        }
    }

    fn stop_all(
        &mut self,
        at: ClockMoment,
        value: Option<&PayloadValue>,
        message: &BrokerMessage<'_>,
    ) {
        let says = if let Some(PayloadValue::Text(text)) = value {
            text.as_str()
        } else {
            ""
        };
        let tried = Some(tried_text(node::STOP_ALL, says));
        if run_word(says) != Ok(RunWord::Stop) {
            let refused = RefusedCommand::new(
                Reason::NotUnderstood,
                format!("`{}` takes `stop` alone", node::STOP_ALL),
            );
            return self.refuse(None, tried, &refused);
        }
        if self.is_replay(message, true) {
            return self.refuse(None, tried, &RefusedCommand::plain(Reason::Retained));
        }
        let may =
            |drive: &DriveDescription| drive.control.as_ref().is_some_and(|it| it.from_sparkplug);
        let drives: Vec<_> = (0..self.drives.len())
            .filter(|drive| may(&self.drives[*drive]))
            .collect();
        if drives.is_empty() {
            return self.refuse(None, tried, &RefusedCommand::plain(Reason::ReadOnly));
        }
        for drive in drives {
            self.give(at, drive, Order::Stop { setpoint: None }, None);
        }
    }

    /// A command for a drive.
    pub(super) fn device_command(
        &mut self,
        at: ClockMoment,
        device: &str,
        message: &BrokerMessage<'_>,
    ) {
        let Some(drive) = self
            .drives
            .iter()
            .position(|drive| drive.name.as_str() == device)
        else {
            let refused = RefusedCommand::plain(Reason::UnknownDrive);
            return self.refuse(None, Some(tried_text("DCMD", device)), &refused);
        };
        let payload = match SparkplugPayload::read(message.payload) {
            Ok(payload) => payload,
            Err(why) => {
                let refused = RefusedCommand::new(Reason::NotUnderstood, why);
                return self.refuse(
                    Some(drive),
                    Some(tried_text("DCMD", &refused.message)),
                    &refused,
                );
            }
        };
        let asked = order::read(&self.devices[drive], &payload.metrics);
        if let Some(refused) = &asked.refused {
            let tried = metrics_text(&payload);
            self.refuse(Some(drive), Some(tried_text("DCMD", &tried)), refused);
        }
        let Some(order) = asked.order else { return };
        match self.may_be_given(at, &order, &payload, message) {
            Ok(issued) => self.give(at, drive, order, issued),
            Err(refused) => self.refuse(Some(drive), tried_by(&order), &refused),
        }
    }

    /// Refuses replays, commands that are too old, and those that arrive while their outcome could not be published.
    /// Returns when it was issued, on our clock; `None` for a stop.
    fn may_be_given(
        &mut self,
        at: ClockMoment,
        order: &Order,
        payload: &SparkplugPayload,
        message: &BrokerMessage<'_>,
    ) -> Result<Option<MonoTime>, RefusedCommand> {
        let is_a_stop = order.is_stop();
        if self.is_replay(message, is_a_stop) {
            return Err(RefusedCommand::plain(Reason::Retained));
        }
        if is_a_stop {
            return Ok(None);
        }
        if message.duplicate {
            let why =
                "a repeat of a message, which may be old; commands go at quality of service 0";
            return Err(RefusedCommand::new(Reason::Duplicate, why));
        }
        let issued = self.issued(at, payload)?;
        if !self.is_path_alive(at) {
            let why = "the births of this connection are not published and proven yet, or the primary host is offline";
            return Err(RefusedCommand::new(Reason::CommanderLost, why));
        }
        if self.link.path.is_unproven() {
            let why = "the gateway's probe through the broker is late, so that the command may have waited: send it again";
            return Err(RefusedCommand::new(Reason::Stale, why));
        }
        if !self.link.commands.has_room_for_command() {
            return Err(RefusedCommand::plain(Reason::QueueFull));
        }
        Ok(Some(issued))
    }

    /// With MQTT 5 no retained message is delivered at subscribe, so a stop with the retain flag is a live one.
    fn is_replay(&self, message: &BrokerMessage<'_>, is_a_stop: bool) -> bool {
        message.retain && !(is_a_stop && self.settings.version == MqttVersion::V5)
    }

    fn issued(
        &mut self,
        at: ClockMoment,
        payload: &SparkplugPayload,
    ) -> Result<MonoTime, RefusedCommand> {
        let Some(timestamp) = payload
            .timestamp
            .map(|it| i64::try_from(it).unwrap_or(i64::MAX))
        else {
            let why = "the message has no timestamp, so its age is unknown";
            return Err(RefusedCommand::new(Reason::Stale, why));
        };
        let issue = self.link.issued.take(at, timestamp)?;
        let most = self.settings.max_command_age;
        if issue.age > most {
            let why = format!(
                "by its timestamp it was issued {:.1} s ago; at most {} s are allowed: are the clocks of host and gateway \
                 set?",
                issue.age.as_secs_f64(),
                most.as_secs_f64(),
            );
            return Err(RefusedCommand::new(Reason::Stale, why));
        }
        Ok(issue.moment)
    }

    fn give(&mut self, at: ClockMoment, drive: usize, order: Order, issued: Option<MonoTime>) {
        if order.is_stop() {
            while let Some((pending, report)) = self.link.commands.give_way_to_stop(drive) {
                // The newer stop is reported.
                let is_stop =
                    matches!(&pending.request, DriveRequest::Order(order) if order.is_stop());
                if !is_stop {
                    self.publish_result(drive, report, None);
                }
            }
        }
        let command = NewCommand {
            ticket: self.link.commands.next_ticket(),
            drive,
            by: Self::OWNER,
            order,
            start_before: at.mono + self.settings.command_ttl,
            issued,
            epoch: None,
            context: (),
        };
        self.link.commands.give(&self.drives[drive], command);
        self.counters.commands += 1;
    }

    fn refuse(
        &mut self,
        drive: Option<usize>,
        tried: Option<TriedWrite>,
        refused: &RefusedCommand,
    ) {
        self.counters.refused += 1;
        self.counters.refused_retained += u64::from(refused.reason == Reason::Retained);
        self.counters.refused_stale +=
            u64::from(matches!(refused.reason, Reason::Stale | Reason::ClockAhead));
        let report = Report::refused(refused.reason);
        let target = drive.and_then(|drive| self.drives.get(drive));
        self.link
            .commands
            .keep_attempt(target, Self::OWNER, tried, report);
        if let Some(device) = drive.and_then(|drive| self.devices.get_mut(drive)) {
            device.set_result(report, refused.message.clone());
        }
    }

    /// Takes the outcome of one of our commands.
    pub(super) fn answered(&mut self, answer: &CommandAnswer) {
        let Some(pending) = self.link.commands.get(answer.ticket).cloned() else {
            return;
        };
        // A successful renewal is no news.
        if pending.request != DriveRequest::Order(Order::Renew)
            || answer.report.outcome == Outcome::Refused
        {
            self.publish_result(pending.drive, answer.report, Some(&pending));
        }
        if answer.is_final {
            self.link.commands.take(answer.ticket);
        }
    }

    /// Gives up what should have been answered long ago.
    pub(super) fn drop_overdue(&mut self, at: MonoTime) {
        while let Some((pending, report)) = self.link.commands.take_overdue(at) {
            self.counters.unanswered += 1;
            self.publish_result(pending.drive, report, Some(&pending));
        }
    }

    pub(super) fn publish_result(
        &mut self,
        drive: usize,
        report: Report,
        pending: Option<&PendingRequest<()>>,
    ) {
        let description = self.drives.get(drive);
        let limits = pending
            .zip(description)
            .and_then(|(it, drive)| refused_frequency(drive, &it.request, report));
        let said = limits.unwrap_or_else(|| match description {
            Some(drive) => message(&drive.model, &report),
            None => report.message(),
        });
        if let Some(device) = self.devices.get_mut(drive) {
            device.set_result(report, said);
        }
    }
}

/// The metrics of a command in words.
fn metrics_text(payload: &SparkplugPayload) -> String {
    const METRICS_MAX: usize = 4;
    let metric = |metric: &super::payload::PayloadMetric| {
        let name = match (&metric.name, metric.alias) {
            (Some(name), _) => short(name),
            (None, Some(alias)) => format!("alias {alias}"),
            (None, None) => "?".to_owned(),
        };
        match &metric.value {
            Some(PayloadValue::Text(text)) => format!("{name} = {}", short(text)),
            Some(PayloadValue::Double(number)) => format!("{name} = {number}"),
            Some(PayloadValue::Float(number)) => format!("{name} = {number}"),
            Some(PayloadValue::Boolean(value)) => format!("{name} = {value}"),
            Some(PayloadValue::Int(bits)) => format!("{name} = {}", bits.cast_signed()),
            Some(PayloadValue::Long(bits)) => format!("{name} = {}", bits.cast_signed()),
            None => format!("{name} = null"),
        }
    };
    payload
        .metrics
        .iter()
        .take(METRICS_MAX)
        .map(metric)
        .collect::<Vec<_>>()
        .join(", ")
}
