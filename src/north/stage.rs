//! Shared by the tests of both sessions with a broker: two drives of a real model, their views, and the time.

use super::broker::{BrokerLimits, BrokerMessage, SessionLine};
use super::clock::ClockMoment;
use crate::domain::control::ControlSettings;
use crate::domain::ids::{DriveIndex, Name, UnitId};
use crate::domain::report::{self, LineReport};
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::description::{DriveDescription, DriveRatings, DriveRef, PointSettings};
use crate::drive::plan::PollPace;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{ControlView, DriveView, RunState};
use crate::profile::model::Model;
use crate::vendors;
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

/// A session under test.
pub trait Staged {
    /// What it wants done.
    type Act;

    fn stage(&mut self) -> &mut Stage;
    /// When the session wants to be woken.
    fn next_wake(&self) -> Option<MonoTime>;
    /// Wakes it.
    fn tick(&mut self, at: ClockMoment);
    /// Everything that is to be done now. A probe returns at once.
    fn acts(&mut self) -> Vec<Self::Act>;

    /// Time passes, and the session is woken when it asked for it.
    fn pass(&mut self, millis: u64) -> Vec<Self::Act> {
        let until = self.stage().millis + millis;
        let mut all = Vec::new();
        while let Some(wake) = self
            .next_wake()
            .filter(|wake| *wake <= MonoTime::from_millis(until))
        {
            // A wake-up within a millisecond is rounded up; one in the past would be an endless loop.
            let wake = wake.as_nanos().div_ceil(1_000_000);
            assert!(all.len() < 10_000, "woken for ever");
            let stage = self.stage();
            stage.millis = wake.max(stage.millis);
            let at = stage.at();
            self.tick(at);
            let more = self.acts();
            let next = self.next_wake();
            assert!(
                next.is_none_or(|next| next > at.mono),
                "woken for nothing at {next:?}"
            );
            all.extend(more);
        }
        self.stage().millis = until;
        all.extend(self.acts());
        all
    }
}
