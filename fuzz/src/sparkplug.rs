//! Commands of Sparkplug hosts: each gives at most one order, a replay is never executed, and sequence numbers have no
//! gap.
//!
//! Input: flags (1 MQTT 5, 2 a primary host, 4 a broker that accepts small packets only), then events.

use super::feed::Feed;
use super::plant;
use std::sync::Arc;
use std::time::Duration;
use vfd_drive::drive::snapshot::DrivePresence;
use vfd_drive::drive::view::{ControlView, DriveView};
use vfd_model::domain::command::{CommandAnswer, Order, Outcome, Reason, Report};
use vfd_model::domain::ids::{AskerId, DriveIndex, Ticket};
use vfd_model::domain::report::LineReport;
use vfd_model::domain::time::{MonoTime, WallTime};
use vfd_north::north::broker::{
    BrokerEvent, BrokerLimits, BrokerMessage, BrokerSession, MqttVersion, Publication, SessionAct,
    SessionLine, ToLine,
};
use vfd_north::north::clock::ClockMoment;
use vfd_north::north::sparkplug::payload::{PayloadMetric, PayloadValue, SparkplugPayload};
use vfd_north::north::sparkplug::{Settings, SparkplugSession};

const PROBE: &str = "vfd/plant/sparkplug/probe";
const STATE: &str = "spBv1.0/STATE/scada";
const DCMD: &str = "spBv1.0/g/DCMD/plant/pump";
const TOPICS: [&str; 6] = [
    DCMD,
    "spBv1.0/g/NCMD/plant",
    STATE,
    "spBv1.0/g/DCMD/plant/fan",
    PROBE,
    "spBv1.0/g/DCMD/plant/x/y",
];
const NAMES: [&str; 8] = [
    "run/set",
    "frequency/set",
    "trip/reset",
    "lease",
    "control/release",
    "all/run/set",
    "run/state",
    "Node Control/Rebirth",
];
const WORDS: [&str; 6] = ["stop", "forward", "reverse", "coast", "STOP ", "start"];
const EPOCH_MS: i64 = 1_767_225_600_000;
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

struct Rig {
    session: SparkplugSession,
    version: MqttVersion,
    broker: BrokerLimits,
    views: Vec<Arc<DriveView>>,
    lines: Vec<SessionLine>,
    millis: u64,
    bdseq: u8,
    /// The number of the next message; `None` before the first birth.
    next: Option<u64>,
    tickets: Vec<Ticket>,
}

impl Rig {
    fn new(flags: u8) -> Self {
        let version = if flags & 1 == 0 {
            MqttVersion::V4
        } else {
            MqttVersion::V5
        };
        let settings = Settings {
            group: "g".into(),
            node: plant::name("plant"),
            standby: false,
            primary_host: (flags & 2 != 0).then(|| "scada".into()),
            version,
            probe_topic: PROBE.into(),
            probe_interval: Duration::from_secs(5),
            probe_timeout: Duration::from_secs(10),
            command_ttl: Duration::from_secs(1),
            max_command_age: Duration::from_secs(10),
            keep_telemetry: 50,
        };
        let model = plant::model(1);
        let drives = vec![
            plant::drive(&model, 0, "pump", true),
            plant::drive(&model, 1, "fan", false),
        ];
        let views = drives.iter().map(|drive| {
            let mut view = DriveView {
                line_is_up: true,
                ..DriveView::default()
            };
            view.control = drive.control.is_some().then(ControlView::default);
            view.snapshot.presence = DrivePresence::Online;
            Arc::new(view)
        });
        Self {
            views: views.collect(),
            session: SparkplugSession::new(
                settings,
                drives,
                vec![plant::name("hall")],
                moment(1_000),
                1,
            ),
            version,
            broker: BrokerLimits {
                maximum_packet_bytes: (flags & 4 != 0).then_some(1_500),
                retains: true,
            },
            lines: vec![SessionLine {
                name: plant::name("hall"),
                report: LineReport::default(),
                stations: Vec::new(),
            }],
            millis: 1_000,
            bdseq: 0,
            next: None,
            tickets: Vec::new(),
        }
    }

    fn at(&self) -> ClockMoment {
        moment(self.millis)
    }

    fn connect(&mut self) {
        self.session.connecting(self.bdseq);
        self.bdseq = self.bdseq.wrapping_add(1);
        self.session
            .handle(self.at(), BrokerEvent::Connected(self.broker));
        self.next = None;
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
            0 | 1 => {
                let payload = feed.piece().to_vec();
                self.message(feed, &payload);
            }
            2..=4 => {
                let payload = self.command(feed);
                self.message(feed, &payload);
            }
            5 => self.pass(feed.millis() / 4),
            6 => self.line_answers(feed),
            7 => self.state(feed),
            8 => self.poll(feed),
            _ => {
                self.session.handle(self.at(), BrokerEvent::Lost);
                self.acts();
                if feed.flag() {
                    self.connect();
                }
            }
        }
    }

    /// A payload that a host might write.
    fn command(&self, feed: &mut Feed<'_>) -> Vec<u8> {
        let metrics = (0..feed.byte() % 4).map(|_| {
            let name = feed.flag().then(|| feed.one_of(&NAMES).to_owned());
            let value = match feed.byte() % 6 {
                0 => PayloadValue::Text(feed.one_of(&WORDS).to_owned()),
                1 => PayloadValue::Double(f64::from(feed.word()) / 100.0),
                2 => PayloadValue::Float(f32::from_bits(u32::from(feed.word()) << 16)),
                3 => PayloadValue::Boolean(feed.flag()),
                4 => PayloadValue::Int(feed.word().into()),
                _ => PayloadValue::Long(u64::from(feed.word()) << (feed.byte() % 49)),
            };
            let alias = name.is_none().then(|| feed.word().into());
            let is_null = feed.flag().then_some(true);
            PayloadMetric {
                name,
                alias,
                is_null,
                value: Some(value),
                ..PayloadMetric::default()
            }
        });
        let metrics = metrics.collect();
        let age_ms = u64::from(feed.word()) / 4;
        let now = u64::try_from(self.at().wall.unix_ms).expect("after 1970");
        SparkplugPayload {
            timestamp: feed.flag().then_some(now - age_ms),
            metrics,
            seq: None,
        }
        .bytes()
    }

    fn message(&mut self, feed: &mut Feed<'_>, payload: &[u8]) {
        let topic = feed.one_of(&TOPICS);
        let flags = feed.byte();
        let retain = flags & 1 != 0;
        let duplicate = flags & 2 != 0;
        let message = message(topic, payload, retain, duplicate);
        self.session
            .handle(self.at(), BrokerEvent::Message(message));
        let acts = self.acts();
        let orders: Vec<_> = acts
            .iter()
            .filter_map(|act| {
                if let SessionAct::ToLine(ToLine::Command(_, it)) = act {
                    Some(it)
                } else {
                    None
                }
            })
            .collect();
        assert!(
            orders.len() <= 1 || topic.contains("NCMD"),
            "one message, several commands: {orders:?}"
        );
        assert!(
            orders.is_empty() || topic == DCMD || topic.contains("NCMD"),
            "{topic}: {orders:?}"
        );
        for request in orders {
            let is_stop = matches!(request.order, Order::Stop { .. } | Order::Coast);
            let is_replay = retain && !(is_stop && self.version == MqttVersion::V5);
            assert!(!is_replay, "a replay acts: {request:?}");
            assert!(is_stop || !duplicate, "a repeat acts: {request:?}");
            assert!(
                is_stop || self.session.is_path_alive(self.at()),
                "no client could get the result: {request:?}"
            );
            assert_eq!(
                request.start_before,
                self.at().mono + Duration::from_secs(1)
            );
            assert!(
                request.issued.is_none_or(|issued| issued <= self.at().mono),
                "{request:?}"
            );
        }
        let kept = acts
            .iter()
            .filter(|act| matches!(act, SessionAct::Keep(..)))
            .count();
        assert!(kept <= 4, "one message, {kept} rows of the audit");
    }

    fn state(&mut self, feed: &mut Feed<'_>) {
        let payload = format!(
            r#"{{"online":{},"timestamp":{}}}"#,
            feed.flag(),
            feed.byte()
        );
        self.session.handle(
            self.at(),
            BrokerEvent::Message(message(STATE, payload.as_bytes(), true, false)),
        );
        self.acts();
    }

    /// A drive answers, or stops responding.
    fn poll(&mut self, feed: &mut Feed<'_>) {
        let place = usize::from(feed.byte()) % self.views.len();
        let at = self.at().mono;
        let mut view = self.views[place].as_ref().clone();
        view.snapshot.presence = if feed.byte() < 200 {
            DrivePresence::Online
        } else {
            DrivePresence::Offline
        };
        view.trip.active = Some(feed.flag());
        view.snapshot.take(0x0101_u16.into(), &[feed.word()], at);
        self.views[place] = Arc::new(view);
        self.acts();
    }

    fn line_answers(&mut self, feed: &mut Feed<'_>) {
        const OUTCOMES: [Outcome; 3] =
            [Outcome::Confirmed, Outcome::Acknowledged, Outcome::Refused];
        let outcome = feed.one_of(&OUTCOMES);
        let is_final = feed.flag();
        let Some(ticket) = self.tickets.last().copied() else {
            return;
        };
        let asker = AskerId::SPARKPLUG;
        let report = Report::new(outcome, Reason::NoReply);
        let answer = CommandAnswer {
            asker,
            ticket,
            drive: DriveIndex(0),
            report,
            is_final,
        };
        self.session.command_answer(self.at(), &answer);
        if is_final {
            self.tickets.pop();
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

    /// All acts that are due now. Probes are delivered back; a connection that is to be left stays until it is lost.
    fn acts(&mut self) -> Vec<SessionAct> {
        let mut all = Vec::new();
        while let Some(act) = self.session.next_act(self.at(), &self.views, &self.lines) {
            match &act {
                SessionAct::Publish(it) if it.topic == PROBE => {
                    let payload = it.payload.clone();
                    self.session.handle(
                        self.at(),
                        BrokerEvent::Message(message(PROBE, &payload, false, false)),
                    );
                }
                SessionAct::Publish(publication) => self.check_publication(publication),
                SessionAct::ToLine(ToLine::Command(_, request)) => {
                    self.tickets.push(request.ticket)
                }
                SessionAct::Keep(_, attempt) => {
                    assert!(attempt.report.is_some(), "no end follows: {attempt:?}")
                }
                SessionAct::ToLine(ToLine::Read(..) | ToLine::PathOpened)
                | SessionAct::EventTaken(_)
                | SessionAct::WantEvents { .. } => {
                    panic!("no host asks for this: {act:?}")
                }
                SessionAct::Subscribe(_)
                | SessionAct::ToLine(ToLine::PathAlive)
                | SessionAct::Reconnect(_)
                | SessionAct::Leave(_) => {}
            }
            all.push(act);
            assert!(all.len() < ACTS_MAX, "no end of acts");
        }
        all
    }

    fn check_publication(&mut self, it: &Publication) {
        assert!(it.topic.starts_with("spBv1.0/g/") && !it.retain, "{it:?}");
        let most = self.broker.maximum_packet_bytes.unwrap_or(usize::MAX);
        assert!(
            it.topic.len() + it.payload.len() <= most,
            "too large for the broker: {it:?}"
        );
        let payload = SparkplugPayload::parse(&it.payload).expect("a payload");
        let seq = payload.seq.expect("a number");
        let is_birth = it.topic.contains("/NBIRTH/");
        let expected = if is_birth { Some(0) } else { self.next };
        assert_eq!(Some(seq), expected, "{}", it.topic);
        self.next = Some((seq + 1) % 256);
    }
}

fn message<'a>(
    topic: &'a str,
    payload: &'a [u8],
    retain: bool,
    duplicate: bool,
) -> BrokerMessage<'a> {
    BrokerMessage {
        topic,
        payload,
        retain,
        duplicate,
        expiry: None,
        response_topic: None,
        correlation: None,
    }
}

/// The moment `millis` milliseconds after the start of the clock.
fn moment(millis: u64) -> ClockMoment {
    let since = i64::try_from(millis).expect("a moment");
    ClockMoment {
        mono: MonoTime::from_millis(millis),
        wall: WallTime {
            unix_ms: EPOCH_MS + since,
        },
    }
}
