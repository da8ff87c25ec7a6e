//! Shared by the tests of this room: drives of the built-in models, and views of them.

use super::drive::PageDrive;
use crate::domain::ids::{DriveIndex, Name, Station, UnitId};
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::description::{DriveDescription, DriveRatings, DriveRef, PointSettings};
use crate::drive::plan::PollPace;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{ControlView, DriveView, RunState};
use crate::north::clock::{ClockMoment, LabelClock};
use crate::profile::catalog::Catalog;
use crate::vendors;
use std::sync::Arc;
use std::time::Duration;

/// The present of most tests.
pub(super) const NOW: MonoTime = MonoTime::from_millis(1_000_000);
/// The wall-clock time at [`NOW`].
pub(super) const NOW_TEXT: &str = "2024-01-31T08:00:00.000Z";

/// A clock at which it is [`NOW`].
pub(super) fn clock() -> LabelClock {
    LabelClock::new(ClockMoment {
        mono: NOW,
        wall: WallTime {
            unix_ms: 1_706_688_000_000,
        },
    })
}

/// The identifiers of all built-in models.
pub(super) fn models() -> Vec<String> {
    vendors::reviewed()
        .iter()
        .map(|id| (*id).to_owned())
        .collect()
}

fn catalog() -> Catalog {
    vendors::catalog()
}

/// A drive of `model` at station 3, with control, polled every second.
pub(super) fn description(model: &str) -> DriveDescription {
    DriveDescription {
        place: DriveRef {
            line: 0,
            drive: DriveIndex(0),
        },
        name: Name::new("pump-1").unwrap(),
        line: Name::new("hall-1").unwrap(),
        model: Arc::clone(catalog().find(model).unwrap()),
        unit: UnitId::new(3).unwrap(),
        uniform_unit: UnitId::new(103).unwrap(),
        group: None,
        pace: PollPace::new(Duration::from_secs(1), 1.0),
        ratings: DriveRatings {
            current_ma: Some(10_000),
            voltage_mv: Some(400_000),
        },
        control: Some(Arc::new(crate::vendors::testing::control())),
        points: PointSettings::default(),
    }
}

/// A drive at standstill, every polled register of which held `word` at [`NOW`].
pub(super) fn view(description: &DriveDescription, word: u16) -> DriveView {
    let mut view = DriveView {
        line_is_up: true,
        run_state: RunState::Stopped,
        ..DriveView::default()
    };
    view.snapshot.presence = DrivePresence::Online;
    for register in description
        .model
        .registers
        .iter()
        .filter(|register| register.poll.is_some())
    {
        view.snapshot.take(register.address, &[word], NOW);
    }
    view.trip.active = Some(false);
    view.control = Some(ControlView::default());
    view
}

/// Both together.
pub(super) fn drive<'d>(description: &'d DriveDescription, view: &'d DriveView) -> PageDrive<'d> {
    PageDrive {
        description,
        view,
        station: Some(Station(3)),
        standby: None,
    }
}
