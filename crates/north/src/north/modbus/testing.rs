//! What the tests of this room share: a model with everything that a unit can show, and a drive of it.

use crate::domain::control::ControlSettings;
use crate::domain::ids::{DriveIndex, Name, UnitId};
use crate::domain::time::MonoTime;
use crate::drive::description::{DriveDescription, DriveRef, PointSettings};
use crate::drive::snapshot::DrivePresence;
use crate::drive::usage::{UsageParts, UsageTotals, UsageView};
use crate::drive::view::{ControlView, DriveView, RunState};
use crate::profile::catalog::Catalog;
use crate::profile::model::{Model, PollClass};
use crate::vendors::testing::head;
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;

/// The present of most tests.
pub(super) const NOW: MonoTime = MonoTime::from_millis(1_000_000);

const RUN: &str = r#"[run]
form = "values"
stop = { value = 0, confidence = "manual", source = "IM 5" }
forward = { value = 1, confidence = "manual", source = "IM 5" }
reverse = { value = 2, confidence = "second-source", source = "IM 5" }
coast = { value = 3, confidence = "sibling", source = "IM 5" }
reset = { value = 4, confidence = "inferred", source = "IM 5" }
reset_sequence = [0, 4, 0]
"#;

/// Role, address, scale and unit of each polled register.
pub(super) const POLLED: [(&str, u16, u32, &str); 10] = [
    ("output-frequency", 0x0101, 100, "Hz"),
    ("output-current", 0x0102, 100, "A"),
    ("output-voltage", 0x0103, 1, "V"),
    ("dc-link-voltage", 0x0104, 10, "V"),
    ("output-power", 0x0105, 1000, "kW"),
    ("torque", 0x0106, 10, "%"),
    ("temperature", 0x0107, 1, "degC"),
    ("run-hours", 0x0108, 1, "h"),
    ("trip-count", 0x0109, 1, "-"),
    ("frequency-setting", 0x010A, 10, "Hz"),
];

/// A model with every role of [`POLLED`], torque and temperature signed.
pub(super) fn model() -> Model {
    let mut text = format!("{}{RUN}", head());
    for (role, address, scale, unit) in POLLED {
        let name = role.replace('-', "_");
        let _ = write!(
            text,
            "[[register]]\nname = \"{name}\"\ntitle = \"T\"\naddress = {address}\nscale = {scale}\nunit = \"{unit}\"\n\
             access = \"read\"\nrole = \"{role}\"\npoll = \"fast\"\nconfidence = \"manual\"\nsource = \"IM 4\"\n"
        );
    }
    for (role, address, scale, unit) in [
        ("run-command", 2, 1, "-"),
        ("frequency-command", 4, 100, "Hz"),
    ] {
        let name = role.replace('-', "_");
        let _ = write!(
            text,
            "[[register]]\nname = \"{name}\"\ntitle = \"T\"\naddress = {address}\nscale = {scale}\nunit = \"{unit}\"\n\
             access = \"write\"\nrole = \"{role}\"\nconfidence = \"manual\"\nsource = \"IM 4\"\n"
        );
    }
    let catalog = Catalog::from_texts([("acme.toml", text.as_str())]).unwrap();
    let mut model = Model::clone(catalog.find("acme-1").unwrap());
    for register in &mut model.registers {
        register.signed = matches!(register.name.as_str(), "torque" | "temperature");
        register.poll = register.poll.map(|_| PollClass::Fast);
    }
    model
}

/// A drive of [`model`] with control, polled every second.
pub(super) fn description() -> DriveDescription {
    DriveDescription {
        place: DriveRef {
            line: 0,
            drive: DriveIndex(0),
        },
        name: Name::new("pump").unwrap(),
        line: Name::new("hall").unwrap(),
        model: Arc::new(model()),
        unit: UnitId::new(1).unwrap(),
        uniform_unit: UnitId::new(101).unwrap(),
        group: None,
        pace: crate::drive::plan::PollPace::new(Duration::from_secs(1), 1.0),
        ratings: crate::drive::description::DriveRatings::default(),
        control: Some(Arc::new(settings())),
        points: PointSettings::default(),
    }
}

/// 5 to 50 Hz, both directions, nothing unproven.
pub(super) fn settings() -> ControlSettings {
    ControlSettings {
        lost_after: Duration::from_secs(30),
        native_write: Vec::new(),
        ..crate::vendors::testing::control()
    }
}

/// A drive that runs forward at its setpoint of 42.5 Hz, every word read at [`NOW`]. It has used 7000 kWh in 1.5 h, with
/// 70,000 starts and 2 trips.
pub(super) fn view() -> DriveView {
    let mut view = DriveView {
        line_is_up: true,
        run_state: RunState::Forward,
        ..DriveView::default()
    };
    view.snapshot.presence = DrivePresence::Online;
    let words = [
        4250,
        1234,
        380,
        5401,
        7550,
        985,
        (-7_i16).cast_unsigned(),
        40_000,
        3,
        425,
    ];
    view.snapshot.take(0x0101_u16.into(), &words, NOW);
    view.trip.active = Some(false);
    view.control = Some(ControlView::default());
    let totals = UsageTotals {
        energy_mj: 7000 * 3_600_000_000,
        running: Duration::from_secs(5400),
        starts: 70_000,
        trips: 2,
    };
    view.usage = UsageView {
        parts: UsageParts::of(&model()),
        totals,
    };
    view
}
