//! The metrics of a drive, with their names and units.
//!
//! What MQTT publishes on a topic below the drive has the name of that topic here.

use super::payload::{PayloadType, PropertyScalar, PropertySet};
use crate::domain::control::ControlSettings;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::drive::usage::UsagePart;
use crate::north::points::{DriveFlag, DrivePoint, FLAGS, FlagGroup, PointForm, points_of};
use crate::north::shown::capabilities;

/// Where the value of a metric comes from.
#[derive(Clone, Copy, Debug)]
pub(super) enum MetricSource {
    /// A point of the drive, which MQTT publishes on a topic.
    Point(DrivePoint),
    /// Trips that are kept.
    TripTotal,
    /// What is or is not so.
    Flag(&'static DriveFlag),
    /// The state of the drive's own watchdog.
    Watchdog,
    /// The last command from a host.
    Result(ResultPart),
    /// The id of the drive's model, which does not change.
    Model,
    /// The name of the drive's line, which does not change.
    Line,
    /// The drive's native unit on Modbus TCP, which does not change.
    Unit,
    /// An input that a host writes.
    Input(MetricInput),
}

/// A part of the outcome of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ResultPart {
    Outcome,
    Reason,
    Message,
    Count,
}

/// An input that a host writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum MetricInput {
    Frequency,
    Run,
    Reset,
    Take,
    Release,
    Lease,
}

/// One metric of a drive.
#[derive(Debug)]
pub(super) struct MetricDefinition {
    pub(super) name: String,
    pub(super) source: MetricSource,
    pub(super) datatype: PayloadType,
    unit: Option<&'static str>,
    /// Lowest and highest value.
    range: Option<(f64, f64)>,
}

impl MetricDefinition {
    fn new(name: impl Into<String>, source: MetricSource, datatype: PayloadType) -> Self {
        Self {
            name: name.into(),
            source,
            datatype,
            unit: None,
            range: None,
        }
    }

    /// Its changes are published at once, and not gathered with measured values.
    pub(super) const fn is_prompt(&self) -> bool {
        !matches!(
            self.source,
            MetricSource::Point(
                DrivePoint::Polled(_) | DrivePoint::Rated(_) | DrivePoint::Usage(_)
            )
        )
    }

    /// Whether its changes are kept while no host can be reached.
    pub(super) fn is_recorded(&self) -> bool {
        matches!(self.source, MetricSource::Point(point) if point.is_recorded()) || self.is_trip()
    }

    /// Whether it concerns trips.
    pub(super) fn is_trip(&self) -> bool {
        match self.source {
            MetricSource::Point(point) => point.is_trip(),
            MetricSource::TripTotal => true,
            _ => false,
        }
    }

    /// The input that a host writes here; `None`: it may not.
    pub(super) const fn input(&self) -> Option<MetricInput> {
        if let MetricSource::Input(input) = self.source {
            Some(input)
        } else {
            None
        }
    }

    /// What a birth says of it besides its value: the property names that hosts know.
    pub(super) fn properties(&self) -> PropertySet {
        let number = |set: PropertySet, key, value: Option<f64>| match value {
            Some(value) => set.with(key, PayloadType::Double, PropertyScalar::Double(value)),
            None => set,
        };
        let set = PropertySet::default();
        let set = match self.unit {
            Some(unit) => set.with(
                "engUnit",
                PayloadType::Text,
                PropertyScalar::Text(unit.to_owned()),
            ),
            None => set,
        };
        let set = number(set, "engLow", self.range.map(|(low, _)| low));
        let set = number(set, "engHigh", self.range.map(|(_, high)| high));
        set.with(
            "readOnly",
            PayloadType::Boolean,
            PropertyScalar::Boolean(self.input().is_none()),
        )
    }
}

/// The metrics of `drive`, always in the same order.
pub(super) fn of_drive(drive: &DriveDescription) -> Vec<MetricDefinition> {
    let points = points_of(drive)
        .into_iter()
        .filter(|(point, _)| *point != DrivePoint::Availability);
    let mut all: Vec<_> = points
        .map(|(point, name)| of_point(drive, point, name))
        .collect();
    all.push(MetricDefinition::new(
        "trip/total",
        MetricSource::TripTotal,
        PayloadType::Int64,
    ));
    all.extend(flags(drive, "status"));
    if drive.model.watchdog.is_some() {
        all.push(MetricDefinition::new(
            "watchdog/state",
            MetricSource::Watchdog,
            PayloadType::Text,
        ));
    }
    all.extend(flags(drive, "control"));
    if let Some(control) = &drive.control
        && control.from_sparkplug
    {
        all.extend(inputs(drive, control));
        all.extend(results());
    }
    all.push(MetricDefinition::new(
        "Properties/model",
        MetricSource::Model,
        PayloadType::Text,
    ));
    all.push(MetricDefinition::new(
        "Properties/line",
        MetricSource::Line,
        PayloadType::Text,
    ));
    all.push(MetricDefinition::new(
        "Properties/unit",
        MetricSource::Unit,
        PayloadType::Int32,
    ));
    all
}

fn of_point(drive: &DriveDescription, point: DrivePoint, name: String) -> MetricDefinition {
    let datatype = match point {
        DrivePoint::Polled(_)
        | DrivePoint::Rated(_)
        | DrivePoint::Setpoint
        | DrivePoint::Param(_) => PayloadType::Double,
        DrivePoint::Usage(UsagePart::Energy | UsagePart::RunningHours) => PayloadType::Double,
        DrivePoint::Usage(UsagePart::Starts | UsagePart::Trips) => PayloadType::Int64,
        DrivePoint::Availability | DrivePoint::RunState => PayloadType::Text,
        DrivePoint::Plain(point) => match point.form {
            PointForm::Flag => PayloadType::Boolean,
            PointForm::Number => PayloadType::Int32,
            PointForm::Text => PayloadType::Text,
        },
    };
    let unit = point
        .unit(drive)
        .filter(|unit| *unit != UnitOfMeasure::None)
        .map(UnitOfMeasure::symbol);
    MetricDefinition {
        unit,
        ..MetricDefinition::new(name, MetricSource::Point(point), datatype)
    }
}

/// The flags of `drive` that are shown below `folder`.
fn flags(drive: &DriveDescription, folder: &str) -> impl Iterator<Item = MetricDefinition> {
    let mut flags: Vec<_> = FLAGS
        .iter()
        .filter(|flag| flag.birth.is_some() && folder_of(flag) == folder && flag.is_of(drive))
        .collect();
    flags.sort_by_key(|flag| flag.birth);
    flags.into_iter().map(move |flag| {
        let name = format!("{folder}/{}", flag.key);
        MetricDefinition::new(name, MetricSource::Flag(flag), PayloadType::Boolean)
    })
}

fn folder_of(flag: &DriveFlag) -> &'static str {
    match flag.group {
        FlagGroup::Drive | FlagGroup::Status => "status",
        FlagGroup::Control => "control",
    }
}

fn inputs(drive: &DriveDescription, control: &ControlSettings) -> Vec<MetricDefinition> {
    let capable = capabilities(drive);
    let may = |word: &str| capable.contains(&word);
    let input = |name: &str, input, datatype| {
        MetricDefinition::new(name, MetricSource::Input(input), datatype)
    };
    let frequency = MetricDefinition {
        unit: Some(UnitOfMeasure::Hertz.symbol()),
        range: Some((control.least.as_f64(), control.most.as_f64())),
        ..input("frequency/set", MetricInput::Frequency, PayloadType::Double)
    };
    let mut all = vec![
        frequency,
        input("run/set", MetricInput::Run, PayloadType::Text),
    ];
    let buttons = [
        ("trip/reset", MetricInput::Reset, may("reset")),
        ("control/take", MetricInput::Take, may("take")),
        ("control/release", MetricInput::Release, may("release")),
        ("lease", MetricInput::Lease, true),
    ];
    let buttons = buttons.into_iter().filter(|(_, _, may)| *may);
    all.extend(buttons.map(|(name, which, _)| input(name, which, PayloadType::Boolean)));
    all
}

fn results() -> impl Iterator<Item = MetricDefinition> {
    let parts = [
        ("result/outcome", ResultPart::Outcome, PayloadType::Text),
        ("result/reason", ResultPart::Reason, PayloadType::Text),
        ("result/message", ResultPart::Message, PayloadType::Text),
        ("result/count", ResultPart::Count, PayloadType::Int64),
    ];
    parts.into_iter().map(|(name, part, datatype)| {
        MetricDefinition::new(name, MetricSource::Result(part), datatype)
    })
}
