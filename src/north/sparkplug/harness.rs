//! What the tests of the session share: a broker and a host that are played by hand, two drives of a real model, and
//! pictures.

use super::payload::{Metric, Payload, Value};
use super::session::Session;
use super::types::{Act, Settings};
use crate::domain::command::{CommandAnswer, CommandRequest, Order, Outcome, Reason, Report};
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::ids::{AskerId, DriveIndex, Name, Ticket, UnitId};
use crate::domain::report::{self, LineReport};
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::description::{DriveDescription, DriveRef, Points};
use crate::drive::snapshot::Presence;
use crate::drive::view::{ControlView, DriveView, RunState};
use crate::journal::Attempt;
use crate::north::mqtt::{Broker, Event, LineState, Message, Moment, Publication, Version};
use crate::profile::check;
use crate::vendors;
use std::sync::Arc;
use std::time::Duration;

/// When the wall clock of the tests starts: 2026-01-01T00:00:00Z.
pub(super) const EPOCH_MS: i64 = 1_767_225_600_000;
/// The registers of the model: output frequency and output current.
pub(super) const OUTPUT: u16 = 0x0101;
pub(super) const PROBE: &str = "vfd/plant/sparkplug/probe";
pub(super) const STATE: &str = "spBv1.0/STATE/scada";

pub(super) fn name(text: &str) -> Name {
    Name::new(text).expect("a name")
}

pub(super) fn settings() -> Settings {
    Settings {
        group: "hall 1".into(),
        node: name("plant"),
        primary_host: Some("scada".into()),
        version: Version::V5,
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
    let model = Arc::new(check::model(vendors::texts()[0].1).expect("a sound model"));
    let drive = |place: u16, called: &str, control: Option<ControlSettings>| DriveDescription {
        place: DriveRef { line: 0, drive: DriveIndex(place) },
        name: name(called),
        line: name("hall"),
        model: model.clone(),
        unit: UnitId::new(1).expect("a unit"),
        uniform_unit: UnitId::new(101).expect("a unit"),
        pace: crate::drive::plan::Pace::new(Duration::from_millis(500), 1.0),
        ratings: crate::drive::description::Ratings::default(),
        control: control.map(Arc::new),
        points: Points { dead_bands: vec![("output_frequency".into(), 0.5)], ..Points::default() },
    };
    let accept_unverified = ControlAction::ALL.to_vec();
    let control = ControlSettings { accept_unverified, ..crate::drive::testing::control() };
    vec![drive(0, "pump", Some(control)), drive(1, "fan", None)]
}

/// A message as the broker would bring it to a host.
#[derive(Debug)]
pub(super) struct Sent {
    /// The kind, and the device behind it if it is one's.
    pub(super) kind: String,
    pub(super) payload: Payload,
    pub(super) publication: Publication,
}

impl Sent {
    /// The metric of this name or, by its birth, of this alias.
    pub(super) fn metric(&self, name: &str) -> &Metric {
        let found = self.payload.metrics.iter().find(|metric| metric.name.as_deref() == Some(name));
        found.unwrap_or_else(|| panic!("no {name} in {:?}", self.payload))
    }

    pub(super) fn value(&self, name: &str) -> Option<Value> {
        self.metric(name).value.clone()
    }
}

/// A session, the pictures it sees, and the time.
pub(super) struct Rig {
    pub(super) session: Session,
    pub(super) views: Vec<DriveView>,
    shown: Vec<Arc<DriveView>>,
    pub(super) lines: Vec<LineState>,
    pub(super) millis: u64,
    pub(super) broker: Broker,
    /// No probe comes back.
    pub(super) is_deaf: bool,
}

impl Rig {
    pub(super) fn new() -> Self {
        Self::with(settings())
    }

    pub(super) fn with(settings: Settings) -> Self {
        let started = Moment { mono: MonoTime::from_millis(1_000), wall: WallTime { unix_ms: EPOCH_MS } };
        let lines = vec![LineState {
            name: name("hall"),
            report: LineReport { state: report::LineState::Up, ..LineReport::default() },
            stations: Vec::new(),
        }];
        let mut rig = Self {
            session: Session::new(settings, drives(), &[name("hall")], started),
            views: vec![DriveView::default(); 2],
            shown: Vec::new(),
            lines,
            millis: 1_000,
            broker: Broker { maximum_packet_bytes: None, retains: true },
            is_deaf: false,
        };
        rig.views[0].control = Some(ControlView { epoch: 1, ..ControlView::default() });
        rig
    }

    /// A session that is born, with `pump` polled just now and the host there.
    pub(super) fn born() -> Self {
        let mut rig = Self::new();
        rig.poll(0, 3_000);
        rig.connect(0);
        rig.host(true, 1);
        rig
    }

    pub(super) fn at(&self) -> Moment {
        let since = i64::try_from(self.millis).expect("a moment") - 1_000;
        Moment { mono: MonoTime::from_millis(self.millis), wall: WallTime { unix_ms: EPOCH_MS + since } }
    }

    pub(super) fn unix_ms(&self) -> u64 {
        u64::try_from(self.at().wall.unix_ms).expect("after 1970")
    }

    /// Drive `index` answers now with this output frequency in 0.01 Hz.
    pub(super) fn poll(&mut self, index: usize, output: u16) {
        let now = self.at().mono;
        let view = &mut self.views[index];
        (view.line_is_up, view.snapshot.presence, view.run_state) = (true, Presence::Online, RunState::Stopped);
        (view.trip.active, view.trip_kept.count) = (Some(false), Some(2));
        view.snapshot.take(OUTPUT, &[output], now);
        view.snapshot.take(0x0112, &[2], now);
        view.snapshot.take(0x0201, &[4_000], now);
        view.snapshot.take(0x0211, &[3, 3], now);
    }

    pub(super) fn handle(&mut self, event: Event<'_>) {
        self.session.handle(self.at(), event);
    }

    /// Connects with this number, and the broker grants everything.
    pub(super) fn connect(&mut self, bdseq: u8) -> Vec<Act> {
        self.session.connecting(bdseq);
        self.handle(Event::Connected(self.broker));
        let acts = self.acts();
        let filters = acts.iter().find_map(|act| if let Act::Subscribe(it) = act { Some(it.len()) } else { None });
        self.handle(Event::Subscribed(vec![true; filters.expect("a subscription")]));
        self.acts()
    }

    /// The host says whether it is there.
    pub(super) fn host(&mut self, online: bool, timestamp: u64) -> Vec<Act> {
        let payload = format!(r#"{{"online":{online},"timestamp":{timestamp}}}"#);
        self.deliver(&Message { retain: true, ..message(STATE, payload.as_bytes()) })
    }

    pub(super) fn deliver(&mut self, message: &Message<'_>) -> Vec<Act> {
        self.handle(Event::Message(message.clone()));
        self.acts()
    }

    /// A host writes these metrics of `pump`.
    pub(super) fn command(&mut self, metrics: Vec<Metric>) -> Vec<Act> {
        let payload = Payload { timestamp: Some(self.unix_ms()), metrics, seq: None };
        self.deliver(&message("spBv1.0/hall 1/DCMD/plant/pump", &payload.bytes()))
    }

    /// A host writes these metrics of the edge node.
    pub(super) fn node_command(&mut self, metrics: Vec<Metric>) -> Vec<Act> {
        let payload = Payload { timestamp: Some(self.unix_ms()), metrics, seq: None };
        self.deliver(&message("spBv1.0/hall 1/NCMD/plant", &payload.bytes()))
    }

    /// Everything that is to be done now. A probe comes back at once.
    pub(super) fn acts(&mut self) -> Vec<Act> {
        let is_same = |(shown, view): (&Arc<DriveView>, &DriveView)| shown.as_ref() == view;
        if self.shown.len() != self.views.len() || !self.shown.iter().zip(&self.views).all(is_same) {
            self.shown = self.views.iter().cloned().map(Arc::new).collect();
        }
        let mut all = Vec::new();
        while let Some(act) = self.session.next_act(self.at(), &self.shown, &self.lines) {
            if let Act::Publish(it) = &act
                && it.topic == PROBE
                && !self.is_deaf
            {
                self.handle(Event::Message(message(PROBE, &it.payload)));
            }
            all.push(act);
            assert!(all.len() < 10_000, "no end of acts");
        }
        all
    }

    /// Time passes, and the session is woken when it asked for it.
    pub(super) fn pass(&mut self, millis: u64) -> Vec<Act> {
        let until = self.millis + millis;
        let mut all = Vec::new();
        while let Some(wake) = self.session.next_wake().filter(|wake| *wake <= MonoTime::from_millis(until)) {
            let wake = wake.as_nanos().div_ceil(1_000_000);
            assert!(all.len() < 10_000, "woken for ever");
            self.millis = wake.max(self.millis);
            self.session.tick(self.at());
            let more = self.acts();
            let next = self.session.next_wake();
            assert!(next.is_none_or(|next| next > self.at().mono), "woken for nothing at {next:?}");
            all.extend(more);
        }
        self.millis = until;
        all.extend(self.acts());
        all
    }

    pub(super) fn answer(&mut self, ticket: Ticket, outcome: Outcome, reason: Reason, is_final: bool) -> Vec<Act> {
        let report = Report::new(outcome, reason);
        let answer = CommandAnswer { asker: AskerId::SPARKPLUG, ticket, drive: DriveIndex(0), report, is_final };
        self.session.command_answer(&answer);
        self.acts()
    }
}

pub(super) fn message<'a>(topic: &'a str, payload: &'a [u8]) -> Message<'a> {
    let (retain, duplicate, expiry) = (false, false, None);
    Message { topic, payload, retain, duplicate, expiry, response_topic: None, correlation: None }
}

pub(super) fn metric(name: &str, value: Value) -> Metric {
    Metric { name: Some(name.to_owned()), value: Some(value), ..Metric::default() }
}

pub(super) fn text(name: &str, value: &str) -> Metric {
    metric(name, Value::Text(value.to_owned()))
}

/// What was published, the probe aside.
pub(super) fn sent(acts: &[Act]) -> Vec<Sent> {
    let published = acts.iter().filter_map(|act| if let Act::Publish(it) = act { Some(it) } else { None });
    let published = published.filter(|it| it.topic != PROBE);
    published
        .map(|publication| {
            let mut levels = publication.topic.split('/');
            assert_eq!((levels.next(), levels.next()), (Some("spBv1.0"), Some("hall 1")));
            let kind = levels.next().expect("a kind").to_owned();
            assert_eq!(levels.next(), Some("plant"));
            let kind = levels.next().map_or(kind.clone(), |device| format!("{kind} {device}"));
            let payload = Payload::parse(&publication.payload).expect("a payload");
            Sent { kind, payload, publication: publication.clone() }
        })
        .collect()
}

pub(super) fn kinds(acts: &[Act]) -> Vec<String> {
    sent(acts).into_iter().map(|sent| sent.kind).collect()
}

pub(super) fn commands(acts: &[Act]) -> Vec<&CommandRequest> {
    acts.iter().filter_map(|act| if let Act::Command(_, request) = act { Some(request) } else { None }).collect()
}

pub(super) fn orders(acts: &[Act]) -> Vec<&Order> {
    commands(acts).into_iter().map(|request| &request.order).collect()
}

pub(super) fn kept(acts: &[Act]) -> Vec<&Attempt> {
    acts.iter().filter_map(|act| if let Act::Keep(_, attempt) = act { Some(attempt) } else { None }).collect()
}
