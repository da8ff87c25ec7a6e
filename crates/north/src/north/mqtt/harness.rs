//! Shared by the tests of the session: a broker that is played by hand, and helpers that read what the session does.

use super::session::MqttSession;
use super::types::{GatewayIdentity, LeaseMode, Settings, TopicTree};
use crate::domain::command::Direction;
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::native::NativeRequest;
use crate::drive::description::DriveDescription;
pub(super) use crate::north::broker::{BrokerSession, SessionAct};
use crate::north::broker::{MqttVersion, Publication, Qos, ToLine};
use crate::north::stage;
pub(super) use crate::north::stage::{
    EPOCH_MS, commands, idle_control, kept, message, model, name, orders, publications,
};
use serde_json::Value;
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
        ..crate::vendors::testing::control()
    }
}

/// `pump` with control and `fan` without, on line `hall`.
pub(super) fn drives() -> Vec<DriveDescription> {
    stage::drives(control())
}

/// A session with its surroundings.
pub(super) type Rig = stage::Rig<MqttSession>;

impl Rig {
    pub(super) fn new(version: MqttVersion) -> Self {
        Self::with(settings(version))
    }

    pub(super) fn with(settings: Settings) -> Self {
        Self::as_gateway(identity(), settings)
    }

    pub(super) fn as_gateway(gateway: GatewayIdentity, settings: Settings) -> Self {
        Self::of((gateway, settings), drives(), "vfd/plant/probe")
    }

    /// A session that is born, with `pump` polled just now; what was published for it is omitted.
    pub(super) fn born(version: MqttVersion) -> Self {
        let mut rig = Self::new(version);
        rig.poll(0, 3_000);
        rig.connect();
        rig
    }

    /// Connects and plays the broker up to the end of the birth. Returns everything that was done.
    pub(super) fn connect(&mut self) -> Vec<SessionAct> {
        self.connect_and_grant().concat()
    }

    /// Everything that is to be done now; no probe returns.
    pub(super) fn acts_without_echo(&mut self) -> Vec<SessionAct> {
        self.is_deaf = true;
        let all = self.acts();
        self.is_deaf = false;
        all
    }

    /// Delivers a message on `rest` below the gateway's topics, and returns its effects.
    pub(super) fn send(&mut self, rest: &str, payload: &[u8]) -> Vec<SessionAct> {
        self.deliver(&message(&format!("vfd/plant/{rest}"), payload))
    }
}

/// Topics below the gateway's with their payloads, as text.
pub(super) fn published_texts(acts: &[SessionAct]) -> Vec<(String, String)> {
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
pub(super) fn on(acts: &[SessionAct], topic: &str) -> Option<String> {
    published_texts(acts)
        .into_iter()
        .rev()
        .find(|(it, _)| it == topic)
        .map(|(_, payload)| payload)
}

/// What was published on a drive's or the gateway's result topic.
pub(super) fn results(acts: &[SessionAct]) -> Vec<Value> {
    let results = published_texts(acts)
        .into_iter()
        .filter(|(topic, _)| topic.ends_with("/result"));
    results
        .map(|(_, payload)| serde_json::from_str(&payload).expect("JSON"))
        .collect()
}

/// The one result, as outcome and reason.
pub(super) fn result(acts: &[SessionAct]) -> (String, String) {
    let all = results(acts);
    assert_eq!(all.len(), 1, "{all:?}");
    let word = |key: &str| all[0][key].as_str().expect("a word").to_owned();
    (word("outcome"), word("reason"))
}

pub(super) fn reads(acts: &[SessionAct]) -> Vec<&NativeRequest> {
    acts.iter()
        .filter_map(|act| {
            if let SessionAct::ToLine(ToLine::Read(_, request)) = act {
                Some(request)
            } else {
                None
            }
        })
        .collect()
}
