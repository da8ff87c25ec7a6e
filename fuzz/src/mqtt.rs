//! Messages from a broker: each is accepted or refused, a replay is never executed, and nothing is published on a
//! command topic.
//!
//! Input: flags (1 MQTT 5, 2 explicit leases, 4 a broker that accepts small packets only), then events.

use super::feed::Feed;
use super::plant;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use vfd_drive::drive::view::{ControlView, DriveView};
use vfd_model::domain::command::{CommandAnswer, CommandRequest, Order, Outcome, Reason, Report};
use vfd_model::domain::ids::{AskerId, DriveIndex, Ticket};
use vfd_model::domain::native::{NativeAnswer, NativeOutcome};
use vfd_model::domain::report::LineReport;
use vfd_model::domain::time::{MonoTime, WallTime};
use vfd_north::north::broker::{
    BrokerEvent, BrokerLimits, BrokerMessage, BrokerSession, MqttVersion, Publication, Qos,
    SessionAct, SessionLine, ToLine,
};
use vfd_north::north::clock::ClockMoment;
use vfd_north::north::mqtt::{
    CombinedEntity, GatewayIdentity, HomeAssistant, LeaseMode, MqttSession, Settings, TopicTree,
};

const BASE: &str = "vfd/plant/";
const RESPONSES: &str = "vfd/answers";
const TOPICS: [&str; 17] = [
    "vfd/plant/drive/pump/command",
    "vfd/plant/drive/pump/run/set",
    "vfd/plant/drive/pump/frequency/set",
    "vfd/plant/drive/pump/trip/reset",
    "vfd/plant/drive/pump/control/release",
    "vfd/plant/drive/pump/lease",
    "vfd/plant/drive/pump/param/F007/set",
    "vfd/plant/drive/pump/param/F007/get",
    "vfd/plant/drive/fan/run/set",
    "vfd/plant/drive/pumpe/command",
    "vfd/plant/all/run/set",
    "vfd/plant/probe",
    "home/status",
    "",
    "vfd/plant/drive/pump/control/take",
    "vfd/plant/by/plc-2/drive/pump/command",
    "vfd/plant/by/plc 2/drive/pump/run/set",
];
/// No command waits longer for its first frame.
const TTL_MAX: Duration = Duration::from_secs(60);
/// More than a session ever sends at once.
const ACTS_MAX: usize = 5_000;

pub fn run(bytes: &[u8]) {
    let mut feed = Feed::new(bytes);
    let mut rig = Rig::new(feed.byte());
    rig.connect();
    while !feed.is_empty() {
        rig.event(&mut feed);
    }
}

fn settings(flags: u8) -> Settings {
    Settings {
        prefix: "vfd".into(),
        version: if flags & 1 == 0 {
            MqttVersion::V4
        } else {
            MqttVersion::V5
        },
        heartbeat: Duration::from_secs(60),
        subscription_qos: Qos::AtLeastOnce,
        lease: if flags & 2 == 0 {
            LeaseMode::Session
        } else {
            LeaseMode::Explicit
        },
        alive_topic: Some("home/status".into()),
        probe_interval: Duration::from_secs(5),
        probe_timeout: Duration::from_secs(10),
        command_ttl: Duration::from_secs(1),
        response_prefix: Some(RESPONSES.into()),
        keep_telemetry: 50,
        publish: TopicTree::ALL.to_vec(),
        home_assistant: (flags & 16 != 0).then(|| HomeAssistant {
            discovery: flags & 32 == 0,
            prefix: "home".into(),
            devices: flags & 64 != 0,
            combined: vec![CombinedEntity::Switch, CombinedEntity::Fan],
            page: None,
        }),
    }
}

struct Rig {
    session: MqttSession,
    settings: Settings,
    broker: BrokerLimits,
    views: Vec<Arc<DriveView>>,
    lines: Vec<SessionLine>,
    millis: u64,
    /// Commands that the line has not ended.
    commands: BTreeMap<Ticket, CommandRequest>,
    reads: Vec<Ticket>,
}

impl Rig {
    fn new(flags: u8) -> Self {
        let settings = settings(flags);
        let model = plant::model(1);
        let drives = vec![
            plant::drive(&model, 0, "pump", true),
            plant::drive(&model, 1, "fan", false),
        ];
        let views = drives.iter().map(|drive| {
            let control = drive.control.is_some().then(ControlView::default);
            Arc::new(DriveView {
                line_is_up: true,
                control,
                ..DriveView::default()
            })
        });
        let lines = vec![SessionLine {
            name: plant::name("hall"),
            report: LineReport::default(),
            stations: Vec::new(),
        }];
        Self {
            views: views.collect(),
            session: MqttSession::new(
                (
                    GatewayIdentity {
                        name: plant::name("plant"),
                        standby: None,
                    },
                    settings.clone(),
                ),
                drives,
                vec![plant::name("hall")],
                moment(1_000),
                1,
            ),
            settings,
            broker: BrokerLimits {
                maximum_packet_bytes: (flags & 4 != 0).then_some(400),
                retains: flags & 8 == 0,
            },
            lines,
            millis: 1_000,
            commands: BTreeMap::new(),
            reads: Vec::new(),
        }
    }

    fn at(&self) -> ClockMoment {
        moment(self.millis)
    }

    fn connect(&mut self) {
        self.session
            .handle(self.at(), BrokerEvent::Connected(self.broker));
        let acts = self.acts();
        let filters = acts.iter().find_map(|act| {
            if let SessionAct::Subscribe(it) = act {
                Some(it.len())
            } else {
                None
            }
        });
        if let Some(filters) = filters {
            self.session
                .handle(self.at(), BrokerEvent::Subscribed(vec![true; filters]));
            self.acts();
        }
    }

    fn event(&mut self, feed: &mut Feed<'_>) {
        match feed.byte() % 10 {
            0..=4 => self.message(feed),
            5 => self.pass(feed.millis() / 4),
            6 | 7 => self.line_answers(feed),
            8 => self
                .session
                .handle(self.at(), BrokerEvent::Acknowledged(u64::from(feed.byte()))),
            _ => {
                self.session.handle(self.at(), BrokerEvent::Lost);
                self.acts();
                if feed.flag() {
                    self.connect();
                }
            }
        }
    }

    fn message(&mut self, feed: &mut Feed<'_>) {
        let topic = feed.one_of(&TOPICS);
        let flags = feed.byte();
        let own = if topic.is_empty() {
            String::from_utf8_lossy(feed.piece()).into_owned()
        } else {
            String::new()
        };
        let response = (flags & 8 != 0).then(|| String::from_utf8_lossy(feed.piece()).into_owned());
        let message = BrokerMessage {
            topic: if topic.is_empty() { &own } else { topic },
            retain: flags & 1 != 0,
            duplicate: flags & 2 != 0,
            expiry: (flags & 4 != 0).then(|| feed.millis()),
            correlation: (flags & 16 != 0).then(|| feed.piece()),
            response_topic: response.as_deref(),
            payload: feed.piece(),
        };
        let before = self.session.counters();
        self.session
            .handle(self.at(), BrokerEvent::Message(message.clone()));
        let acts = self.acts();
        let after = self.session.counters();
        self.acts_on(&message, &acts);
        let ends = (after.refused - before.refused) + (after.duplicates - before.duplicates);
        let taken = acts
            .iter()
            .filter(|act| {
                matches!(
                    act,
                    SessionAct::ToLine(ToLine::Command(..)) | SessionAct::ToLine(ToLine::Read(..))
                )
            })
            .count();
        let is_input = topic.starts_with("vfd/plant/drive/pump/") && !message.payload.is_empty();
        assert!(
            !is_input || ends + taken as u64 >= 1,
            "neither taken nor refused: {message:?}"
        );
        let kept = acts
            .iter()
            .filter(|act| matches!(act, SessionAct::Keep(..)))
            .count();
        let writes = is_input && !topic.ends_with("/get") && !topic.ends_with("/lease");
        let ordered = acts
            .iter()
            .filter(|act| matches!(act, SessionAct::ToLine(ToLine::Command(..))))
            .count();
        assert!(
            !writes || ordered + kept == 1,
            "accounted for {} times: {message:?}",
            ordered + kept
        );
        assert!(kept <= 1, "kept {kept} times: {message:?}");
        assert_eq!(after.messages_in, before.messages_in + 1);
    }

    /// Checks what one message has ordered.
    fn acts_on(&self, message: &BrokerMessage<'_>, acts: &[SessionAct]) {
        let orders: Vec<_> = acts
            .iter()
            .filter_map(|act| {
                if let SessionAct::ToLine(ToLine::Command(to, it)) = act {
                    Some((to, it))
                } else {
                    None
                }
            })
            .collect();
        assert!(
            orders.len() <= 1,
            "one message, several commands: {message:?}"
        );
        for (to, request) in orders {
            assert_eq!((to.line, to.drive), (0, request.drive));
            let is_stop = matches!(request.order, Order::Stop { .. } | Order::Coast);
            let is_replay =
                message.retain && !(is_stop && self.settings.version == MqttVersion::V5);
            assert!(!is_replay, "a replay acts: {message:?} {request:?}");
            let now = self.at().mono;
            assert!(
                request.start_before >= now && request.start_before <= now + TTL_MAX,
                "{request:?}"
            );
            assert!(
                request.issued.is_none_or(|issued| issued <= now),
                "{request:?}"
            );
        }
        let is_read = acts
            .iter()
            .any(|act| matches!(act, SessionAct::ToLine(ToLine::Read(..))));
        assert!(!(message.retain && is_read), "a replay reads: {message:?}");
    }

    fn line_answers(&mut self, feed: &mut Feed<'_>) {
        const OUTCOMES: [Outcome; 5] = [
            Outcome::Confirmed,
            Outcome::Acknowledged,
            Outcome::Unknown,
            Outcome::Refused,
            Outcome::Superseded,
        ];
        let outcome = feed.one_of(&OUTCOMES);
        let is_final = feed.flag();
        let place = usize::from(feed.byte());
        let asker = AskerId::MQTT;
        let ticket = if self.commands.is_empty() {
            None
        } else {
            self.commands.keys().nth(place % self.commands.len())
        };
        if let Some(ticket) = ticket.copied() {
            let drive = self
                .commands
                .get(&ticket)
                .map_or(DriveIndex(0), |it| it.drive);
            let report = Report {
                held: Some(feed.word()),
                ..Report::new(outcome, Reason::NoReply)
            };
            self.session.command_answer(
                self.at(),
                &CommandAnswer {
                    asker,
                    ticket,
                    drive,
                    report,
                    is_final,
                },
            );
            if is_final {
                self.commands.remove(&ticket);
            }
        }
        if let Some(ticket) = self.reads.pop() {
            let outcome = if feed.flag() {
                NativeOutcome::Words(feed.words(2).into())
            } else {
                NativeOutcome::NoReply
            };
            self.session.native_answer(
                self.at(),
                &NativeAnswer {
                    asker,
                    ticket,
                    outcome,
                },
            );
        }
        self.acts();
    }

    fn pass(&mut self, time: Duration) {
        let until = self.millis + time.as_millis() as u64;
        while let Some(wake) = self
            .session
            .next_wake()
            .map(|wake| wake.as_nanos().div_ceil(1_000_000))
            .filter(|it| *it <= until)
        {
            self.millis = wake.max(self.millis);
            self.session.tick(self.at());
            self.acts();
            assert!(
                self.session
                    .next_wake()
                    .is_none_or(|next| next > self.at().mono),
                "woken for ever"
            );
        }
        self.millis = until;
        self.acts();
    }

    /// All acts that are due now. Probes are delivered back.
    fn acts(&mut self) -> Vec<SessionAct> {
        let mut all = Vec::new();
        while let Some(act) = self.session.next_act(self.at(), &self.views, &self.lines) {
            match &act {
                SessionAct::Publish(it) if it.topic == "vfd/plant/probe" => {
                    let topic = it.topic.as_str();
                    let payload = it.payload.as_slice();
                    let back = BrokerMessage {
                        topic,
                        payload,
                        retain: false,
                        duplicate: false,
                        expiry: None,
                        response_topic: None,
                        correlation: None,
                    };
                    self.session.handle(self.at(), BrokerEvent::Message(back));
                }
                SessionAct::Publish(publication) => self.check_publication(publication),
                SessionAct::ToLine(ToLine::Command(_, request)) => {
                    let before = self.commands.insert(request.ticket, request.clone());
                    assert!(before.is_none(), "a ticket twice");
                }
                SessionAct::ToLine(ToLine::Read(_, request)) => self.reads.push(request.ticket),
                SessionAct::Keep(_, attempt) => {
                    assert!(attempt.report.is_some(), "no end follows: {attempt:?}")
                }
                SessionAct::Subscribe(_)
                | SessionAct::ToLine(ToLine::PathAlive)
                | SessionAct::ToLine(ToLine::PathOpened)
                | SessionAct::Reconnect(_)
                | SessionAct::Leave(_) => {}
                SessionAct::EventTaken(_) | SessionAct::WantEvents { .. } => {}
            }
            all.push(act);
            assert!(all.len() < ACTS_MAX, "no end of acts");
        }
        all
    }

    fn check_publication(&self, it: &Publication) {
        let is_ours = it.topic.starts_with(BASE);
        let is_response = it
            .topic
            .strip_prefix(RESPONSES)
            .is_some_and(|rest| rest.starts_with('/'));
        let is_announcement =
            it.topic.starts_with("home/") && it.topic.contains("/vfd-gateway-plant/");
        assert!(
            is_ours || is_announcement || is_response && !it.retain,
            "{it:?}"
        );
        let orders = [
            "/set",
            "/get",
            "/command",
            "/lease",
            "/trip/reset",
            "/control/release",
        ];
        assert!(
            !is_ours || !orders.iter().any(|end| it.topic.ends_with(end)),
            "{it:?}"
        );
        let most = self.broker.maximum_packet_bytes.unwrap_or(usize::MAX);
        assert!(
            it.topic.len() + it.payload.len() <= most,
            "too large for the broker: {it:?}"
        );
        if is_response || it.topic.ends_with("/result") {
            let result: Value = serde_json::from_slice(&it.payload).expect("a result is JSON");
            assert!(
                result["outcome"].is_string() && result["reason"].is_string(),
                "{result}"
            );
        }
    }
}

/// The moment `millis` milliseconds after the start of the clock.
fn moment(millis: u64) -> ClockMoment {
    let since = i64::try_from(millis).expect("a moment");
    ClockMoment {
        mono: MonoTime::from_millis(millis),
        wall: WallTime {
            unix_ms: 1_767_225_600_000 + since,
        },
    }
}
