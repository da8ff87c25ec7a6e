//! Shared by the tests of the session: a broker that is played by hand, and helpers that read what the session does.

use super::session::MqttSession;
use super::types::{GatewayIdentity, LeaseMode, MqttAct, Settings, TopicTree};
use crate::domain::command::{
    CommandAnswer, CommandRequest, Direction, Order, Outcome, Reason, Report,
};
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::ids::{AskerId, DriveIndex, Ticket};
use crate::domain::native::NativeRequest;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::journal::WriteAttempt;
use crate::north::broker::{BrokerEvent, BrokerMessage, MqttVersion, Publication, Qos, ToLine};
use crate::north::clock::ClockMoment;
use crate::north::stage::{self, Stage};
pub(super) use crate::north::stage::{EPOCH_MS, Staged, idle_control, message, model, name};
use serde_json::Value;
use std::ops::{Deref, DerefMut};
use std::time::Duration;

pub(super) fn identity() -> GatewayIdentity {
    GatewayIdentity {
        name: name("plant"),
        standby: None,
    }
}

pub(super) fn settings(version: MqttVersion) -> Settings {
    Settings {
        prefix: "vfd".into(),
        version,
        heartbeat: Duration::from_secs(60),
        lease: LeaseMode::Session,
        alive_topic: Some("home/status".into()),
        subscription_qos: Qos::AtLeastOnce,
        probe_interval: Duration::from_secs(5),
        probe_timeout: Duration::from_secs(10),
        command_ttl: Duration::from_secs(1),
        response_prefix: Some("vfd/answers".into()),
        keep_telemetry: 0,
        publish: TopicTree::ALL.to_vec(),
        home_assistant: None,
    }
}

pub(super) fn control() -> ControlSettings {
    ControlSettings {
        directions: vec![Direction::Forward],
        lost_after: Duration::from_secs(30),
        on_shutdown: FailSafe::Hold,
        native_write: Vec::new(),
        ..crate::drive::testing::control()
    }
}

/// `pump` with control and `fan` without, on line `hall`.
pub(super) fn drives() -> Vec<DriveDescription> {
    stage::drives(control())
}

/// A session with its surroundings.
pub(super) struct Rig {
    pub(super) session: MqttSession,
    pub(super) stage: Stage,
}

impl Deref for Rig {
    type Target = Stage;

    fn deref(&self) -> &Stage {
        &self.stage
    }
}

impl DerefMut for Rig {
    fn deref_mut(&mut self) -> &mut Stage {
        &mut self.stage
    }
}

impl Staged for Rig {
    type Act = MqttAct;

    fn stage(&mut self) -> &mut Stage {
        &mut self.stage
    }

    fn next_wake(&self) -> Option<MonoTime> {
        self.session.next_wake()
    }

    fn tick(&mut self, at: ClockMoment) {
        self.session.tick(at);
    }

    fn acts(&mut self) -> Vec<MqttAct> {
        let mut all = Vec::new();
        loop {
            let more = self.acts_without_echo();
            let probes: Vec<_> = more.iter().filter_map(probe_payload).collect();
            let is_over = probes.is_empty();
            all.extend(more);
            for payload in probes {
                self.handle(BrokerEvent::Message(message("vfd/plant/probe", &payload)));
            }
            if is_over {
                return all;
            }
        }
    }
}

impl Rig {
    pub(super) fn new(version: MqttVersion) -> Self {
        Self::with(settings(version))
    }

    pub(super) fn with(settings: Settings) -> Self {
        Self::of(identity(), settings)
    }

    pub(super) fn of(gateway: GatewayIdentity, settings: Settings) -> Self {
        let stage = Stage::new();
        let lines = vec![name("hall")];
        Self {
            session: MqttSession::new(gateway, settings, drives(), lines, stage.at(), 7),
            stage,
        }
    }

    /// A session that is born, with `pump` polled just now; what was published for it is omitted.
    pub(super) fn born(version: MqttVersion) -> Self {
        let mut rig = Self::new(version);
        rig.poll(0, 3_000);
        rig.connect();
        rig
    }

    pub(super) fn handle(&mut self, event: BrokerEvent<'_>) {
        self.session.handle(self.stage.at(), event);
    }

    /// Connects and plays the broker up to the end of the birth. Returns everything that was done.
    pub(super) fn connect(&mut self) -> Vec<MqttAct> {
        self.handle(BrokerEvent::Connected(self.broker));
        let mut all = self.acts();
        let granted = all.iter().find_map(|act| match act {
            MqttAct::Subscribe(filters) => Some(vec![true; filters.len()]),
            _ => None,
        });
        self.handle(BrokerEvent::Subscribed(granted.expect("a subscription")));
        all.extend(self.acts());
        all
    }

    /// Everything that is to be done now; no probe returns.
    pub(super) fn acts_without_echo(&mut self) -> Vec<MqttAct> {
        self.stage.show();
        let mut all = Vec::new();
        while let Some(act) =
            self.session
                .next_act(self.stage.at(), &self.stage.shown, &self.stage.lines)
        {
            all.push(act);
            assert!(all.len() < 10_000, "no end of acts");
        }
        all
    }

    /// Delivers a message on `rest` below the gateway's topics, and returns its effects.
    pub(super) fn send(&mut self, rest: &str, payload: &[u8]) -> Vec<MqttAct> {
        self.deliver(&BrokerMessage {
            ..message(&format!("vfd/plant/{rest}"), payload)
        })
    }

    pub(super) fn deliver(&mut self, message: &BrokerMessage<'_>) -> Vec<MqttAct> {
        self.handle(BrokerEvent::Message(message.clone()));
        self.acts()
    }

    /// The line answers.
    pub(super) fn answer(
        &mut self,
        ticket: Ticket,
        outcome: Outcome,
        reason: Reason,
        is_final: bool,
    ) -> Vec<MqttAct> {
        self.report(ticket, Report::new(outcome, reason), is_final)
    }

    pub(super) fn report(
        &mut self,
        ticket: Ticket,
        report: Report,
        is_final: bool,
    ) -> Vec<MqttAct> {
        let answer = CommandAnswer {
            asker: AskerId::MQTT,
            ticket,
            drive: DriveIndex(0),
            report,
            is_final,
        };
        self.session.command_answer(self.stage.at(), &answer);
        self.acts()
    }
}

fn probe_payload(act: &MqttAct) -> Option<Vec<u8>> {
    match act {
        MqttAct::Publish(it) if it.topic == "vfd/plant/probe" => Some(it.payload.clone()),
        _ => None,
    }
}

pub(super) fn publications(acts: &[MqttAct]) -> Vec<&Publication> {
    let published = acts.iter().filter_map(|act| {
        if let MqttAct::Publish(it) = act {
            Some(it)
        } else {
            None
        }
    });
    published
        .filter(|it| it.topic != "vfd/plant/probe")
        .collect()
}

/// Topics below the gateway's with their payloads, as text.
pub(super) fn published_texts(acts: &[MqttAct]) -> Vec<(String, String)> {
    let text = |it: &&Publication| {
        let topic = it
            .topic
            .strip_prefix("vfd/plant/")
            .unwrap_or(&it.topic)
            .to_owned();
        (topic, String::from_utf8(it.payload.clone()).expect("text"))
    };
    publications(acts).iter().map(text).collect()
}

/// The payload on a topic; the last if there are several.
pub(super) fn on(acts: &[MqttAct], topic: &str) -> Option<String> {
    published_texts(acts)
        .into_iter()
        .rev()
        .find(|(it, _)| it == topic)
        .map(|(_, payload)| payload)
}

/// What was published on a drive's or the gateway's result topic.
pub(super) fn results(acts: &[MqttAct]) -> Vec<Value> {
    let results = published_texts(acts)
        .into_iter()
        .filter(|(topic, _)| topic.ends_with("/result"));
    results
        .map(|(_, payload)| serde_json::from_str(&payload).expect("JSON"))
        .collect()
}

/// The one result, as outcome and reason.
pub(super) fn result(acts: &[MqttAct]) -> (String, String) {
    let all = results(acts);
    assert_eq!(all.len(), 1, "{all:?}");
    let word = |key: &str| all[0][key].as_str().expect("a word").to_owned();
    (word("outcome"), word("reason"))
}

pub(super) fn commands(acts: &[MqttAct]) -> Vec<&CommandRequest> {
    acts.iter()
        .filter_map(|act| {
            if let MqttAct::ToLine(ToLine::Command(_, request)) = act {
                Some(request)
            } else {
                None
            }
        })
        .collect()
}

pub(super) fn orders(acts: &[MqttAct]) -> Vec<&Order> {
    commands(acts)
        .into_iter()
        .map(|request| &request.order)
        .collect()
}

/// Attempts that no line saw.
pub(super) fn kept(acts: &[MqttAct]) -> Vec<&WriteAttempt> {
    acts.iter()
        .filter_map(|act| {
            if let MqttAct::Keep(_, attempt) = act {
                Some(attempt)
            } else {
                None
            }
        })
        .collect()
}

pub(super) fn reads(acts: &[MqttAct]) -> Vec<&NativeRequest> {
    acts.iter()
        .filter_map(|act| {
            if let MqttAct::ToLine(ToLine::Read(_, request)) = act {
                Some(request)
            } else {
                None
            }
        })
        .collect()
}
