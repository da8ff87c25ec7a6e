//! What several targets need: the built-in models, a control section, drives on one line.

use std::sync::{Arc, LazyLock};
use std::time::Duration;
use vfd_drive::drive::description::{DriveDescription, DriveRatings, DriveRef, PointSettings};
use vfd_model::domain::command::Direction;
use vfd_model::domain::control::{ControlAction, ControlSettings, FailSafe};
use vfd_model::domain::frequency::Hertz;
use vfd_model::domain::ids::{DriveIndex, Name, UnitId};
use vfd_model::profile::catalog::Catalog;
use vfd_model::profile::model::Model;
use vfd_model::vendors;

/// The built-in models.
pub fn catalog() -> &'static Catalog {
    static CATALOG: LazyLock<Catalog> = LazyLock::new(vendors::catalog);
    &CATALOG
}

/// The built-in model at `place`, wrapping around.
pub fn model(place: u8) -> Arc<Model> {
    let ids: Vec<&str> = catalog().ids().collect();
    Arc::clone(
        catalog()
            .find(ids[usize::from(place) % ids.len()])
            .expect("an identifier of the catalogue"),
    )
}

pub fn name(text: &str) -> Name {
    Name::new(text).expect("a name")
}

/// Everything allowed from everywhere, 5 to 50 Hz, 3 s of lease, stops at the end.
pub fn control() -> ControlSettings {
    let limits = (Hertz::from_centihertz(500), Hertz::from_centihertz(5000));
    ControlSettings {
        from_mqtt: true,
        from_modbus_tcp: true,
        from_sparkplug: true,
        directions: vec![Direction::Forward, Direction::Reverse],
        accept_unverified: ControlAction::ALL.to_vec(),
        allow_release: true,
        native_write: vec![0x020C, 0x020E],
        ..ControlSettings::new(
            limits,
            (FailSafe::Stop, Duration::from_secs(3)),
            FailSafe::Stop,
        )
    }
}

/// A drive of `model` at `place` on the only line, with control or without.
pub fn drive(model: &Arc<Model>, place: u16, called: &str, has_control: bool) -> DriveDescription {
    DriveDescription {
        place: DriveRef {
            line: 0,
            drive: DriveIndex(place),
        },
        name: name(called),
        line: name("hall"),
        model: Arc::clone(model),
        unit: UnitId::new(1).expect("a unit"),
        uniform_unit: UnitId::new(101).expect("a unit"),
        group: None,
        pace: vfd_drive::drive::plan::PollPace::new(Duration::from_millis(500), 1.0),
        ratings: DriveRatings::default(),
        control: has_control.then(|| Arc::new(control())),
        points: PointSettings::default(),
    }
}
