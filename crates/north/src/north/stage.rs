//! Shared by the tests of both sessions with a broker: two drives of a real model, their views, the time, and a broker
//! that is played by hand.

use super::broker::{
    BrokerEvent, BrokerLimits, BrokerMessage, BrokerSession, Publication, SessionAct, SessionLine,
    ToLine,
};
use super::clock::ClockMoment;
use crate::domain::command::{CommandAnswer, CommandRequest, Order, Outcome, Reason, Report};
use crate::domain::control::ControlSettings;
use crate::domain::ids::{DriveIndex, Name, Ticket, UnitId};
use crate::domain::report::{self, LineReport};
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::description::{DriveDescription, DriveRatings, DriveRef, PointSettings};
use crate::drive::plan::PollPace;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{ControlView, DriveView, RunState};
use crate::journal::WriteAttempt;
use crate::profile::model::Model;
use crate::vendors;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;
use std::time::Duration;

/// When the wall clock of the tests starts: 2026-01-01T00:00:00Z.
pub const EPOCH_MS: i64 = 1_767_225_600_000;
/// When their own clock starts.
const START_MS: u64 = 1_000;
/// The model's register of the output frequency, in 0.01 Hz.
const OUTPUT: u16 = 0x0101;

pub fn model() -> Model {
    Model::clone(
        vendors::catalog()
            .find("hyundai-n700")
            .expect("it is built in"),
    )
}

pub fn name(text: &str) -> Name {
    Name::new(text).expect("a name")
}

pub fn message<'a>(topic: &'a str, payload: &'a [u8]) -> BrokerMessage<'a> {
    let retain = false;
    let duplicate = false;
    let expiry = None;
    BrokerMessage {
        topic,
        payload,
        retain,
        duplicate,
        expiry,
        response_topic: None,
        correlation: None,
    }
}

pub fn idle_control() -> ControlView {
    ControlView {
        epoch: 1,
        ..ControlView::default()
    }
}

/// `pump`, which this controls, and `fan`, which no client may control, on line `hall`.
pub fn drives(control: ControlSettings) -> Vec<DriveDescription> {
    let model = Arc::new(model());
    let drive = |place: u16, called: &str, control: Option<ControlSettings>| DriveDescription {
        place: DriveRef {
            line: 0,
            drive: DriveIndex(place),
        },
        name: name(called),
        line: name("hall"),
        model: model.clone(),
        unit: UnitId::new(1).expect("a unit"),
        uniform_unit: UnitId::new(101).expect("a unit"),
        group: None,
        pace: PollPace::new(Duration::from_millis(500), 1.0),
        ratings: DriveRatings::default(),
        control: control.map(Arc::new),
        points: PointSettings {
            dead_bands: vec![("output_frequency".into(), 0.5)],
            ..PointSettings::default()
        },
    };
    vec![drive(0, "pump", Some(control)), drive(1, "fan", None)]
}

/// The plant and the broker as a session sees them, and the time.
pub struct Stage {
    pub views: Vec<DriveView>,
    /// The views as the session gets them: rebuilt only when one differs.
    pub shown: Vec<Arc<DriveView>>,
    pub lines: Vec<SessionLine>,
    pub millis: u64,
    /// By how much the wall clock was set, in milliseconds.
    pub wall_set_by: i64,
    pub broker: BrokerLimits,
}

impl Stage {
    pub fn new() -> Self {
        let lines = vec![SessionLine {
            name: name("hall"),
            report: LineReport {
                state: report::LineState::Up,
                ..LineReport::default()
            },
            stations: Vec::new(),
        }];
        let mut views = vec![DriveView::default(); 2];
        views[0].control = Some(idle_control());
        let broker = BrokerLimits {
            maximum_packet_bytes: None,
            retains: true,
        };
        Self {
            views,
            shown: Vec::new(),
            lines,
            millis: START_MS,
            wall_set_by: 0,
            broker,
        }
    }

    pub fn at(&self) -> ClockMoment {
        let since = i64::try_from(self.millis - START_MS).expect("a moment");
        let unix_ms = EPOCH_MS + since + self.wall_set_by;
        ClockMoment {
            mono: MonoTime::from_millis(self.millis),
            wall: WallTime { unix_ms },
        }
    }

    pub fn now(&self) -> MonoTime {
        self.at().mono
    }

    /// Drive `index` answers now with this output frequency in 0.01 Hz.
    pub fn poll(&mut self, index: usize, output: u16) {
        let now = self.now();
        let view = &mut self.views[index];
        view.line_is_up = true;
        view.snapshot.presence = DrivePresence::Online;
        view.run_state = RunState::Stopped;
        view.trip.active = Some(false);
        view.trip_kept.count = Some(2);
        view.snapshot.take(OUTPUT.into(), &[output], now);
        view.snapshot.take(0x0112_u16.into(), &[2], now);
        view.snapshot.take(0x0201_u16.into(), &[4_000], now);
        view.snapshot.take(0x0211_u16.into(), &[3, 3], now);
    }

    /// Shows the session the present drives.
    pub fn show(&mut self) {
        let is_same = |(shown, view): (&Arc<DriveView>, &DriveView)| shown.as_ref() == view;
        if self.shown.len() != self.views.len() || !self.shown.iter().zip(&self.views).all(is_same)
        {
            self.shown = self.views.iter().cloned().map(Arc::new).collect();
        }
    }
}

/// A session under test, with a broker that is played by hand.
pub struct Rig<S> {
    pub session: S,
    pub stage: Stage,
    /// The topic of its probe.
    probe: &'static str,
    /// No probe returns.
    pub is_deaf: bool,
}

impl<S> Deref for Rig<S> {
    type Target = Stage;

    fn deref(&self) -> &Stage {
        &self.stage
    }
}

impl<S> DerefMut for Rig<S> {
    fn deref_mut(&mut self) -> &mut Stage {
        &mut self.stage
    }
}

impl<S: BrokerSession> Rig<S> {
    /// A session with `drives` on line `hall`.
    pub fn of(settings: S::Settings, drives: Vec<DriveDescription>, probe: &'static str) -> Self {
        let stage = Stage::new();
        Self {
            session: S::new(settings, drives, vec![name("hall")], stage.at(), 7),
            stage,
            probe,
            is_deaf: false,
        }
    }

    pub fn handle(&mut self, event: BrokerEvent<'_>) {
        self.session.handle(self.stage.at(), event);
    }

    /// Connects, and the broker grants everything. Returns what is done before that, and after it.
    pub fn connect_and_grant(&mut self) -> [Vec<SessionAct>; 2] {
        self.handle(BrokerEvent::Connected(self.broker));
        let before = self.acts();
        let granted = before.iter().find_map(|act| match act {
            SessionAct::Subscribe(filters) => Some(vec![true; filters.len()]),
            _ => None,
        });
        self.handle(BrokerEvent::Subscribed(granted.expect("a subscription")));
        [before, self.acts()]
    }

    /// Everything that is to be done now. A probe returns at once, if the broker is not deaf.
    pub fn acts(&mut self) -> Vec<SessionAct> {
        self.stage.show();
        let mut all = Vec::new();
        while let Some(act) =
            self.session
                .next_act(self.stage.at(), &self.stage.shown, &self.stage.lines)
        {
            if let SessionAct::Publish(it) = &act
                && it.topic == self.probe
                && !self.is_deaf
            {
                self.handle(BrokerEvent::Message(message(self.probe, &it.payload)));
            }
            all.push(act);
            assert!(all.len() < 10_000, "no end of acts");
        }
        all
    }

    pub fn deliver(&mut self, message: &BrokerMessage<'_>) -> Vec<SessionAct> {
        self.handle(BrokerEvent::Message(message.clone()));
        self.acts()
    }

    /// The line answers.
    pub fn answer(
        &mut self,
        ticket: Ticket,
        outcome: Outcome,
        reason: Reason,
        is_final: bool,
    ) -> Vec<SessionAct> {
        self.report(ticket, Report::new(outcome, reason), is_final)
    }

    pub fn report(&mut self, ticket: Ticket, report: Report, is_final: bool) -> Vec<SessionAct> {
        let answer = CommandAnswer {
            asker: S::ASKER,
            ticket,
            drive: DriveIndex(0),
            report,
            is_final,
        };
        self.session.command_answer(self.stage.at(), &answer);
        self.acts()
    }

    /// Time passes, and the session is woken when it asked for it.
    pub fn pass(&mut self, millis: u64) -> Vec<SessionAct> {
        let until = self.millis + millis;
        let mut all = Vec::new();
        while let Some(wake) = self
            .session
            .next_wake()
            .filter(|wake| *wake <= MonoTime::from_millis(until))
        {
            // A wake-up within a millisecond is rounded up; one in the past would be an endless loop.
            let wake = wake.as_nanos().div_ceil(1_000_000);
            assert!(all.len() < 10_000, "woken for ever");
            self.millis = wake.max(self.millis);
            let at = self.at();
            self.session.tick(at);
            let more = self.acts();
            let next = self.session.next_wake();
            assert!(
                next.is_none_or(|next| next > at.mono),
                "woken for nothing at {next:?}"
            );
            all.extend(more);
        }
        self.millis = until;
        all.extend(self.acts());
        all
    }
}

/// What was published, except the probe.
pub fn publications(acts: &[SessionAct]) -> Vec<&Publication> {
    let published = acts.iter().filter_map(|act| match act {
        SessionAct::Publish(it) => Some(it),
        _ => None,
    });
    published
        .filter(|it| !it.topic.ends_with("/probe"))
        .collect()
}

pub fn commands(acts: &[SessionAct]) -> Vec<&CommandRequest> {
    acts.iter()
        .filter_map(|act| match act {
            SessionAct::ToLine(ToLine::Command(_, request)) => Some(request),
            _ => None,
        })
        .collect()
}

pub fn orders(acts: &[SessionAct]) -> Vec<&Order> {
    commands(acts)
        .into_iter()
        .map(|request| &request.order)
        .collect()
}

/// Attempts that no line saw.
pub fn kept(acts: &[SessionAct]) -> Vec<&WriteAttempt> {
    acts.iter()
        .filter_map(|act| match act {
            SessionAct::Keep(_, attempt) => Some(attempt),
            _ => None,
        })
        .collect()
}
