//! Shared by the tests of the session: a broker and a host that are played by hand, and helpers that read what the
//! session does.

use super::payload::{PayloadMetric, PayloadValue, SparkplugPayload};
use super::session::SparkplugSession;
use super::types::Settings;
use crate::domain::control::{ControlAction, ControlSettings};
use crate::drive::description::DriveDescription;
use crate::north::broker::{BrokerMessage, MqttVersion, Publication};
pub(super) use crate::north::broker::{BrokerSession, SessionAct};
use crate::north::stage;
pub(super) use crate::north::stage::{
    EPOCH_MS, commands, kept, message, name, orders, publications,
};
use std::time::Duration;

pub(super) const PROBE: &str = "vfd/plant/sparkplug/probe";
pub(super) const STATE: &str = "spBv1.0/STATE/scada";

pub(super) fn settings() -> Settings {
    Settings {
        group: "hall 1".into(),
        node: name("plant"),
        standby: false,
        primary_host: Some("scada".into()),
        version: MqttVersion::V5,
        probe_topic: PROBE.into(),
        probe_interval: Duration::from_secs(1),
        probe_timeout: Duration::from_secs(3),
        command_ttl: Duration::from_secs(1),
        max_command_age: Duration::from_secs(10),
        keep_telemetry: 100,
    }
}

/// `pump` with control and `fan` without, on line `hall`.
pub(super) fn drives() -> Vec<DriveDescription> {
    let accept_unverified = ControlAction::ALL.to_vec();
    stage::drives(ControlSettings {
        accept_unverified,
        ..crate::vendors::testing::control()
    })
}

/// A message as the broker would deliver it to a host.
#[derive(Debug)]
pub(super) struct Sent {
    /// The kind, followed by the device if it concerns one.
    pub(super) kind: String,
    pub(super) payload: SparkplugPayload,
    pub(super) publication: Publication,
}

impl Sent {
    /// The metric of this name or, by its birth, of this alias.
    pub(super) fn metric(&self, name: &str) -> &PayloadMetric {
        let found = self
            .payload
            .metrics
            .iter()
            .find(|metric| metric.name.as_deref() == Some(name));
        found.unwrap_or_else(|| panic!("no {name} in {:?}", self.payload))
    }

    pub(super) fn value(&self, name: &str) -> Option<PayloadValue> {
        self.metric(name).value.clone()
    }
}

/// A session with its surroundings.
pub(super) type Rig = stage::Rig<SparkplugSession>;

impl Rig {
    pub(super) fn new() -> Self {
        Self::with(settings())
    }

    pub(super) fn with(settings: Settings) -> Self {
        Self::of(settings, drives(), PROBE)
    }

    /// A session that is born, with `pump` polled just now and the host online.
    pub(super) fn born() -> Self {
        let mut rig = Self::new();
        rig.poll(0, 3_000);
        rig.connect(0);
        rig.host(true, 1);
        rig
    }

    pub(super) fn unix_ms(&self) -> u64 {
        u64::try_from(self.at().wall.unix_ms).expect("after 1970")
    }

    /// Connects with this number, and the broker grants everything.
    pub(super) fn connect(&mut self, bdseq: u8) -> Vec<SessionAct> {
        self.session.connecting(bdseq);
        let [_, acts] = self.connect_and_grant();
        acts
    }

    /// The host says whether it is online.
    pub(super) fn host(&mut self, online: bool, timestamp: u64) -> Vec<SessionAct> {
        let payload = format!(r#"{{"online":{online},"timestamp":{timestamp}}}"#);
        self.deliver(&BrokerMessage {
            retain: true,
            ..message(STATE, payload.as_bytes())
        })
    }

    /// A host writes these metrics of `pump`.
    pub(super) fn command(&mut self, metrics: Vec<PayloadMetric>) -> Vec<SessionAct> {
        let payload = SparkplugPayload {
            timestamp: Some(self.unix_ms()),
            metrics,
            seq: None,
        };
        self.deliver(&message("spBv1.0/hall 1/DCMD/plant/pump", &payload.bytes()))
    }

    /// A host writes these metrics of the edge node.
    pub(super) fn node_command(&mut self, metrics: Vec<PayloadMetric>) -> Vec<SessionAct> {
        let payload = SparkplugPayload {
            timestamp: Some(self.unix_ms()),
            metrics,
            seq: None,
        };
        self.deliver(&message("spBv1.0/hall 1/NCMD/plant", &payload.bytes()))
    }
}

pub(super) fn metric(name: &str, value: PayloadValue) -> PayloadMetric {
    PayloadMetric {
        name: Some(name.to_owned()),
        value: Some(value),
        ..PayloadMetric::default()
    }
}

pub(super) fn text(name: &str, value: &str) -> PayloadMetric {
    metric(name, PayloadValue::Text(value.to_owned()))
}

/// What was published, except the probe.
pub(super) fn sent(acts: &[SessionAct]) -> Vec<Sent> {
    publications(acts)
        .into_iter()
        .map(|publication| {
            let mut levels = publication.topic.split('/');
            assert_eq!(
                (levels.next(), levels.next()),
                (Some("spBv1.0"), Some("hall 1"))
            );
            let kind = levels.next().expect("a kind").to_owned();
            assert_eq!(levels.next(), Some("plant"));
            let kind = levels
                .next()
                .map_or(kind.clone(), |device| format!("{kind} {device}"));
            let payload = SparkplugPayload::parse(&publication.payload).expect("a payload");
            Sent {
                kind,
                payload,
                publication: publication.clone(),
            }
        })
        .collect()
}

pub(super) fn kinds(acts: &[SessionAct]) -> Vec<String> {
    sent(acts).into_iter().map(|sent| sent.kind).collect()
}
