//! What the tests of the session share: a broker that is played by hand, two drives of a real model, and pictures.

use super::session::Session;
use super::types::{Act, Broker, Event, LeaseMode, LineState, Message, Moment, Publication, Settings, Tree, Version};
use crate::domain::command::{CommandAnswer, CommandRequest, Direction, Order, Outcome, Reason, Report};
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::ids::{AskerId, DriveIndex, Name, Ticket, UnitId};
use crate::domain::native::NativeRequest;
use crate::domain::report::{self, LineReport};
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::description::{DriveDescription, DriveRef, Points};
use crate::drive::snapshot::Presence;
use crate::drive::view::{ControlView, DriveView, RunState};
use crate::journal::Attempt;
use crate::profile::check;
use crate::profile::model::Model;
use crate::vendors;
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;

/// When the wall clock of the tests starts: 2026-01-01T00:00:00Z.
pub(super) const EPOCH_MS: i64 = 1_767_225_600_000;

pub(super) fn model() -> Model {
    check::model(vendors::texts()[0].1).expect("a sound model")
}

pub(super) fn name(text: &str) -> Name {
    Name::new(text).expect("a name")
}

pub(super) fn settings(version: Version) -> Settings {
    Settings {
        prefix: "vfd".into(),
        gateway: name("plant"),
        version,
        heartbeat: Duration::from_secs(60),
        lease: LeaseMode::Session,
        alive_topic: Some("home/status".into()),
        probe_interval: Duration::from_secs(5),
        probe_timeout: Duration::from_secs(10),
        command_ttl: Duration::from_secs(1),
        response_prefix: Some("vfd/answers".into()),
        keep_telemetry: 0,
        publish: Tree::ALL.to_vec(),
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
    let model = Arc::new(model());
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
    vec![drive(0, "pump", Some(control())), drive(1, "fan", None)]
}

/// A session, the pictures it sees, and the time.
pub(super) struct Rig {
    pub(super) session: Session,
    pub(super) views: Vec<DriveView>,
    shown: Vec<Arc<DriveView>>,
    pub(super) lines: Vec<LineState>,
    pub(super) millis: u64,
    /// By how much the wall clock was set, in milliseconds.
    pub(super) wall_set_by: i64,
    pub(super) broker: Broker,
}

impl Rig {
    pub(super) fn new(version: Version) -> Self {
        Self::with(settings(version))
    }

    pub(super) fn with(settings: Settings) -> Self {
        let started = Moment { mono: MonoTime::from_millis(1_000), wall: WallTime { unix_ms: EPOCH_MS } };
        let lines = vec![LineState {
            name: name("hall"),
            report: LineReport { state: report::LineState::Up, ..LineReport::default() },
            stations: Vec::new(),
        }];
        let mut rig = Self {
            session: Session::new(settings, drives(), vec![name("hall")], started),
            views: vec![DriveView::default(); 2],
            shown: Vec::new(),
            lines,
            millis: 1_000,
            wall_set_by: 0,
            broker: Broker { maximum_packet_bytes: None, retains: true },
        };
        rig.views[0].control = Some(idle_control());
        rig
    }

    /// A session that is born, with `pump` polled just now; what was published for it is left out.
    pub(super) fn born(version: Version) -> Self {
        let mut rig = Self::new(version);
        rig.poll(0, 3_000);
        rig.connect();
        rig
    }

    pub(super) fn at(&self) -> Moment {
        let millis = self.millis;
        let since = i64::try_from(millis).expect("a moment") - 1_000;
        Moment { mono: MonoTime::from_millis(millis), wall: WallTime { unix_ms: EPOCH_MS + since + self.wall_set_by } }
    }

    pub(super) fn now(&self) -> MonoTime {
        self.at().mono
    }

    /// Drive `index` answers now with this output frequency in 0.01 Hz.
    pub(super) fn poll(&mut self, index: usize, output: u16) {
        let now = self.now();
        let view = &mut self.views[index];
        (view.line_is_up, view.snapshot.presence, view.run_state) = (true, Presence::Online, RunState::Stopped);
        (view.trip.active, view.trip_kept.count) = (Some(false), Some(2));
        view.snapshot.take(0x0101, &[output], now);
        view.snapshot.take(0x0112, &[2], now);
        view.snapshot.take(0x0201, &[4_000], now);
        view.snapshot.take(0x0211, &[3, 3], now);
    }

    pub(super) fn handle(&mut self, event: Event<'_>) {
        self.session.handle(self.at(), event);
    }

    /// Connects and plays the broker up to the end of the birth. Gives back everything that was done.
    pub(super) fn connect(&mut self) -> Vec<Act> {
        self.handle(Event::Connected(self.broker));
        let mut all = self.acts();
        let granted = all.iter().find_map(|act| match act {
            Act::Subscribe(filters) => Some(vec![true; filters.len()]),
            _ => None,
        });
        self.handle(Event::Subscribed(granted.expect("a subscription")));
        all.extend(self.acts());
        all
    }

    /// Everything that is to be done now. A probe comes back at once.
    pub(super) fn acts(&mut self) -> Vec<Act> {
        let mut all = Vec::new();
        loop {
            let more = self.acts_without_echo();
            let probes: Vec<_> = more.iter().filter_map(probe_payload).collect();
            let is_over = probes.is_empty();
            all.extend(more);
            for payload in probes {
                self.handle(Event::Message(message("vfd/plant/probe", &payload)));
            }
            if is_over {
                return all;
            }
        }
    }

    /// Everything that is to be done now; no probe comes back.
    pub(super) fn acts_without_echo(&mut self) -> Vec<Act> {
        let is_same = |(shown, view): (&Arc<DriveView>, &DriveView)| shown.as_ref() == view;
        if self.shown.len() != self.views.len() || !self.shown.iter().zip(&self.views).all(is_same) {
            self.shown = self.views.iter().cloned().map(Arc::new).collect();
        }
        let mut all = Vec::new();
        while let Some(act) = self.session.next_act(self.at(), &self.shown, &self.lines) {
            all.push(act);
            assert!(all.len() < 10_000, "no end of acts");
        }
        all
    }

    /// Time passes, the session is woken when it asked for it, and probes come back.
    pub(super) fn pass(&mut self, millis: u64) -> Vec<Act> {
        let until = self.millis + millis;
        let mut all = Vec::new();
        while let Some(wake) = self.session.next_wake().filter(|wake| *wake <= MonoTime::from_millis(until)) {
            // A wake-up within a millisecond is rounded up; one that is past would be an endless loop.
            let wake = wake.as_nanos().div_ceil(1_000_000);
            assert!(all.len() < 10_000, "woken for ever");
            self.millis = wake.max(self.millis);
            self.session.tick(self.at());
            let more = self.acts();
            assert!(self.session.next_wake().is_none_or(|next| next > self.now()), "woken for nothing");
            all.extend(more);
        }
        self.millis = until;
        all.extend(self.acts());
        all
    }

    /// A message on `rest` below the gateway's topics, and what comes of it.
    pub(super) fn send(&mut self, rest: &str, payload: &[u8]) -> Vec<Act> {
        self.deliver(&Message { ..message(&format!("vfd/plant/{rest}"), payload) })
    }

    pub(super) fn deliver(&mut self, message: &Message<'_>) -> Vec<Act> {
        self.handle(Event::Message(message.clone()));
        self.acts()
    }

    /// The line answers.
    pub(super) fn answer(&mut self, ticket: Ticket, outcome: Outcome, reason: Reason, is_final: bool) -> Vec<Act> {
        self.report(ticket, Report::new(outcome, reason), is_final)
    }

    pub(super) fn report(&mut self, ticket: Ticket, report: Report, is_final: bool) -> Vec<Act> {
        let answer = CommandAnswer { asker: AskerId::MQTT, ticket, drive: DriveIndex(0), report, is_final };
        self.session.command_answer(self.at(), &answer);
        self.acts()
    }
}

pub(super) fn idle_control() -> ControlView {
    ControlView { epoch: 1, ..ControlView::default() }
}

pub(super) fn message<'a>(topic: &'a str, payload: &'a [u8]) -> Message<'a> {
    let (retain, duplicate, expiry) = (false, false, None);
    Message { topic, payload, retain, duplicate, expiry, response_topic: None, correlation: None }
}

fn probe_payload(act: &Act) -> Option<Vec<u8>> {
    match act {
        Act::Publish(it) if it.topic == "vfd/plant/probe" => Some(it.payload.clone()),
        _ => None,
    }
}

pub(super) fn publications(acts: &[Act]) -> Vec<&Publication> {
    let published = acts.iter().filter_map(|act| if let Act::Publish(it) = act { Some(it) } else { None });
    published.filter(|it| it.topic != "vfd/plant/probe").collect()
}

/// Topics below the gateway's with their payloads, as text.
pub(super) fn told(acts: &[Act]) -> Vec<(String, String)> {
    let text = |it: &&Publication| {
        let topic = it.topic.strip_prefix("vfd/plant/").unwrap_or(&it.topic).to_owned();
        (topic, String::from_utf8(it.payload.clone()).expect("text"))
    };
    publications(acts).iter().map(text).collect()
}

/// The payload on a topic; the last if there are several.
pub(super) fn on(acts: &[Act], topic: &str) -> Option<String> {
    told(acts).into_iter().rev().find(|(it, _)| it == topic).map(|(_, payload)| payload)
}

/// What was published on a drive's or the gateway's result topic.
pub(super) fn results(acts: &[Act]) -> Vec<Value> {
    let results = told(acts).into_iter().filter(|(topic, _)| topic.ends_with("/result"));
    results.map(|(_, payload)| serde_json::from_str(&payload).expect("JSON")).collect()
}

/// The one result, as outcome and reason.
pub(super) fn result(acts: &[Act]) -> (String, String) {
    let all = results(acts);
    assert_eq!(all.len(), 1, "{all:?}");
    let word = |key: &str| all[0][key].as_str().expect("a word").to_owned();
    (word("outcome"), word("reason"))
}

pub(super) fn commands(acts: &[Act]) -> Vec<&CommandRequest> {
    acts.iter().filter_map(|act| if let Act::Command(_, request) = act { Some(request) } else { None }).collect()
}

pub(super) fn orders(acts: &[Act]) -> Vec<&Order> {
    commands(acts).into_iter().map(|request| &request.order).collect()
}

/// Attempts that no line saw.
pub(super) fn kept(acts: &[Act]) -> Vec<&Attempt> {
    acts.iter().filter_map(|act| if let Act::Keep(_, attempt) = act { Some(attempt) } else { None }).collect()
}

pub(super) fn reads(acts: &[Act]) -> Vec<&NativeRequest> {
    acts.iter().filter_map(|act| if let Act::Read(_, request) = act { Some(request) } else { None }).collect()
}
