//! Shared by the tests of the session: a broker and a host that are played by hand, and helpers that read what the
//! session does.

use super::payload::{PayloadMetric, PayloadValue, SparkplugPayload};
use super::session::SparkplugSession;
use super::types::{Settings, SparkplugAct};
use crate::domain::command::{CommandAnswer, CommandRequest, Order, Outcome, Reason, Report};
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::ids::{AskerId, DriveIndex, Ticket};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::journal::WriteAttempt;
use crate::north::broker::{BrokerEvent, BrokerMessage, MqttVersion, Publication, ToLine};
use crate::north::clock::ClockMoment;
use crate::north::stage::{self, Stage};
pub(super) use crate::north::stage::{EPOCH_MS, Staged, message, name};
use std::ops::{Deref, DerefMut};
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
        ..crate::drive::testing::control()
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
pub(super) struct Rig {
    pub(super) session: SparkplugSession,
    stage: Stage,
    /// No probe returns.
    pub(super) is_deaf: bool,
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
    type Act = SparkplugAct;

    fn stage(&mut self) -> &mut Stage {
        &mut self.stage
    }

    fn next_wake(&self) -> Option<MonoTime> {
        self.session.next_wake()
    }

    fn tick(&mut self, at: ClockMoment) {
        self.session.tick(at);
    }

    fn acts(&mut self) -> Vec<SparkplugAct> {
        self.stage.show();
        let mut all = Vec::new();
        while let Some(act) =
            self.session
                .next_act(self.stage.at(), &self.stage.shown, &self.stage.lines)
        {
            if let SparkplugAct::Publish(it) = &act
                && it.topic == PROBE
                && !self.is_deaf
            {
                self.handle(BrokerEvent::Message(message(PROBE, &it.payload)));
            }
            all.push(act);
            assert!(all.len() < 10_000, "no end of acts");
        }
        all
    }
}

impl Rig {
    pub(super) fn new() -> Self {
        Self::with(settings())
    }

    pub(super) fn with(settings: Settings) -> Self {
        let stage = Stage::new();
        Self {
            session: SparkplugSession::new(settings, drives(), &[name("hall")], stage.at(), 7),
            stage,
            is_deaf: false,
        }
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

    pub(super) fn handle(&mut self, event: BrokerEvent<'_>) {
        self.session.handle(self.stage.at(), event);
    }

    /// Connects with this number, and the broker grants everything.
    pub(super) fn connect(&mut self, bdseq: u8) -> Vec<SparkplugAct> {
        self.session.connecting(bdseq);
        self.handle(BrokerEvent::Connected(self.stage.broker));
        let acts = self.acts();
        let filters = acts.iter().find_map(|act| {
            if let SparkplugAct::Subscribe(it) = act {
                Some(it.len())
            } else {
                None
            }
        });
        self.handle(BrokerEvent::Subscribed(vec![
            true;
            filters
                .expect("a subscription")
        ]));
        self.acts()
    }

    /// The host says whether it is online.
    pub(super) fn host(&mut self, online: bool, timestamp: u64) -> Vec<SparkplugAct> {
        let payload = format!(r#"{{"online":{online},"timestamp":{timestamp}}}"#);
        self.deliver(&BrokerMessage {
            retain: true,
            ..message(STATE, payload.as_bytes())
        })
    }

    pub(super) fn deliver(&mut self, message: &BrokerMessage<'_>) -> Vec<SparkplugAct> {
        self.handle(BrokerEvent::Message(message.clone()));
        self.acts()
    }

    /// A host writes these metrics of `pump`.
    pub(super) fn command(&mut self, metrics: Vec<PayloadMetric>) -> Vec<SparkplugAct> {
        let payload = SparkplugPayload {
            timestamp: Some(self.unix_ms()),
            metrics,
            seq: None,
        };
        self.deliver(&message("spBv1.0/hall 1/DCMD/plant/pump", &payload.bytes()))
    }

    /// A host writes these metrics of the edge node.
    pub(super) fn node_command(&mut self, metrics: Vec<PayloadMetric>) -> Vec<SparkplugAct> {
        let payload = SparkplugPayload {
            timestamp: Some(self.unix_ms()),
            metrics,
            seq: None,
        };
        self.deliver(&message("spBv1.0/hall 1/NCMD/plant", &payload.bytes()))
    }

    pub(super) fn answer(
        &mut self,
        ticket: Ticket,
        outcome: Outcome,
        reason: Reason,
        is_final: bool,
    ) -> Vec<SparkplugAct> {
        let report = Report::new(outcome, reason);
        let answer = CommandAnswer {
            asker: AskerId::SPARKPLUG,
            ticket,
            drive: DriveIndex(0),
            report,
            is_final,
        };
        self.session.command_answer(&answer);
        self.acts()
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
pub(super) fn sent(acts: &[SparkplugAct]) -> Vec<Sent> {
    let published = acts.iter().filter_map(|act| {
        if let SparkplugAct::Publish(it) = act {
            Some(it)
        } else {
            None
        }
    });
    let published = published.filter(|it| it.topic != PROBE);
    published
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

pub(super) fn kinds(acts: &[SparkplugAct]) -> Vec<String> {
    sent(acts).into_iter().map(|sent| sent.kind).collect()
}

pub(super) fn commands(acts: &[SparkplugAct]) -> Vec<&CommandRequest> {
    acts.iter()
        .filter_map(|act| {
            if let SparkplugAct::ToLine(ToLine::Command(_, request)) = act {
                Some(request)
            } else {
                None
            }
        })
        .collect()
}

pub(super) fn orders(acts: &[SparkplugAct]) -> Vec<&Order> {
    commands(acts)
        .into_iter()
        .map(|request| &request.order)
        .collect()
}

pub(super) fn kept(acts: &[SparkplugAct]) -> Vec<&WriteAttempt> {
    acts.iter()
        .filter_map(|act| {
            if let SparkplugAct::Keep(_, attempt) = act {
                Some(attempt)
            } else {
                None
            }
        })
        .collect()
}
