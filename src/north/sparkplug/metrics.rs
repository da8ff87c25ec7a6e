//! The metrics of a drive, with their names and units.
//!
//! What MQTT publishes on a topic below the drive has the name of that topic here.

use super::payload::{Datatype, PropertyScalar, PropertySet};
use crate::domain::control::ControlSettings;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::drive::rated::Rated;
use crate::drive::usage::UsagePart;
use crate::north::mqtt::{Kind, kinds};
use crate::north::shown::capabilities;
use crate::profile::model::{Flag, Register};

/// Where the value of a metric comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// The content of an MQTT topic.
    Topic(Kind),
    /// Trips that are kept.
    TripTotal,
    /// A part of control.
    Control(Control),
    /// A part of a status register.
    Status(Status),
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
    Input(Input),
}

/// A part of control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Control {
    StartInhibited,
    StopPending,
    NotEffective,
    OutputOutside,
    StoppedElsewhere,
    FailSafe,
}

/// A part of a status register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Status {
    Local,
    Alarm,
    Ready,
    MayStillRun,
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
pub(super) enum Input {
    Frequency,
    Run,
    Reset,
    Take,
    Release,
    Lease,
}

/// One metric of a drive.
#[derive(Debug)]
pub(super) struct Definition {
    pub(super) name: String,
    pub(super) source: Source,
    pub(super) datatype: Datatype,
    unit: Option<&'static str>,
    /// Lowest and highest value.
    range: Option<(f64, f64)>,
}

impl Definition {
    fn new(name: impl Into<String>, source: Source, datatype: Datatype) -> Self {
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
            Source::Topic(Kind::Polled(_) | Kind::Rated(_) | Kind::Usage(_))
        )
    }

    /// Whether its changes are kept while no host can be reached.
    pub(super) const fn is_recorded(&self) -> bool {
        let is_measured = matches!(
            self.source,
            Source::Topic(Kind::RunState | Kind::Polled(_) | Kind::Rated(_) | Kind::Setpoint)
        );
        is_measured || self.is_trip()
    }

    /// Whether it concerns trips.
    pub(super) const fn is_trip(&self) -> bool {
        use Kind::{TripActive, TripCode, TripCount, TripLast, TripText};
        let topic = matches!(
            self.source,
            Source::Topic(TripActive | TripCode | TripCount | TripLast | TripText)
        );
        topic || matches!(self.source, Source::TripTotal)
    }

    /// The input that a host writes here; `None`: it may not.
    pub(super) const fn input(&self) -> Option<Input> {
        if let Source::Input(input) = self.source {
            Some(input)
        } else {
            None
        }
    }

    /// What a birth says of it besides its value: the property names that hosts know.
    pub(super) fn properties(&self) -> PropertySet {
        let number = |set: PropertySet, key, value: Option<f64>| match value {
            Some(value) => set.with(key, Datatype::Double, PropertyScalar::Double(value)),
            None => set,
        };
        let set = PropertySet::default();
        let set = match self.unit {
            Some(unit) => set.with(
                "engUnit",
                Datatype::Text,
                PropertyScalar::Text(unit.to_owned()),
            ),
            None => set,
        };
        let set = number(set, "engLow", self.range.map(|(low, _)| low));
        let set = number(set, "engHigh", self.range.map(|(_, high)| high));
        set.with(
            "readOnly",
            Datatype::Boolean,
            PropertyScalar::Boolean(self.input().is_none()),
        )
    }
}

/// The metrics of `drive`, always in the same order.
pub(super) fn of_drive(drive: &DriveDescription) -> Vec<Definition> {
    let topics = kinds(drive)
        .into_iter()
        .filter(|(kind, _)| *kind != Kind::Availability);
    let mut all: Vec<_> = topics
        .map(|(kind, name)| of_topic(drive, kind, name))
        .collect();
    all.push(Definition::new(
        "trip/total",
        Source::TripTotal,
        Datatype::Int64,
    ));
    let flags = [
        ("status/may_still_run", Status::MayStillRun, true),
        (
            "status/local",
            Status::Local,
            drive.model.status_flag(Flag::BusRun).is_some(),
        ),
        (
            "status/alarm",
            Status::Alarm,
            drive.model.status_flag(Flag::Alarm).is_some(),
        ),
        (
            "status/ready",
            Status::Ready,
            drive.model.status_flag(Flag::Ready).is_some(),
        ),
    ];
    let flags = flags.into_iter().filter(|(_, _, has_it)| *has_it);
    all.extend(
        flags.map(|(name, status, _)| {
            Definition::new(name, Source::Status(status), Datatype::Boolean)
        }),
    );
    if drive.model.watchdog.is_some() {
        all.push(Definition::new(
            "watchdog/state",
            Source::Watchdog,
            Datatype::Text,
        ));
    }
    if let Some(control) = &drive.control {
        all.extend(of_control());
        if control.from_sparkplug {
            all.extend(inputs(drive, control));
            all.extend(results());
        }
    }
    all.push(Definition::new(
        "Properties/model",
        Source::Model,
        Datatype::Text,
    ));
    all.push(Definition::new(
        "Properties/line",
        Source::Line,
        Datatype::Text,
    ));
    all.push(Definition::new(
        "Properties/unit",
        Source::Unit,
        Datatype::Int32,
    ));
    all
}

fn of_topic(drive: &DriveDescription, kind: Kind, name: String) -> Definition {
    let datatype = match kind {
        Kind::Polled(_) | Kind::Rated(_) | Kind::Setpoint | Kind::Param(_) => Datatype::Double,
        Kind::TripActive | Kind::WarningActive => Datatype::Boolean,
        Kind::TripCode | Kind::TripCount | Kind::WarningCode => Datatype::Int32,
        Kind::Usage(UsagePart::Energy | UsagePart::RunningHours) => Datatype::Double,
        Kind::Usage(UsagePart::Starts | UsagePart::Trips) => Datatype::Int64,
        Kind::Availability
        | Kind::RunState
        | Kind::Owner
        | Kind::TripText
        | Kind::TripLast
        | Kind::WarningText => Datatype::Text,
    };
    let register = |place: usize| drive.model.registers.get(place);
    let unit = match kind {
        Kind::Polled(place) => register(place).map(|it| it.unit),
        Kind::Rated(place) => register(place)
            .and_then(|it| Rated::of(it, &drive.ratings))
            .map(|rated| rated.unit),
        Kind::Setpoint => Some(UnitOfMeasure::Hertz),
        Kind::Usage(part) => Some(part.unit()),
        _ => None,
    };
    let unit = unit
        .filter(|unit| *unit != UnitOfMeasure::None)
        .map(UnitOfMeasure::symbol);
    Definition {
        unit,
        ..Definition::new(name, Source::Topic(kind), datatype)
    }
}

fn of_control() -> impl Iterator<Item = Definition> {
    let parts = [
        ("control/start_inhibited", Control::StartInhibited),
        ("control/stop_pending", Control::StopPending),
        ("control/not_effective", Control::NotEffective),
        ("control/output_outside", Control::OutputOutside),
        ("control/stopped_elsewhere", Control::StoppedElsewhere),
        ("control/failsafe", Control::FailSafe),
    ];
    parts
        .into_iter()
        .map(|(name, part)| Definition::new(name, Source::Control(part), Datatype::Boolean))
}

fn inputs(drive: &DriveDescription, control: &ControlSettings) -> Vec<Definition> {
    let capable = capabilities(drive);
    let may = |word: &str| capable.contains(&word);
    let input = |name: &str, input, datatype| Definition::new(name, Source::Input(input), datatype);
    let frequency = Definition {
        unit: Some(UnitOfMeasure::Hertz.symbol()),
        range: Some((control.least.as_f64(), control.most.as_f64())),
        ..input("frequency/set", Input::Frequency, Datatype::Double)
    };
    let mut all = vec![frequency, input("run/set", Input::Run, Datatype::Text)];
    let buttons = [
        ("trip/reset", Input::Reset, may("reset")),
        ("control/take", Input::Take, may("take")),
        ("control/release", Input::Release, may("release")),
        ("lease", Input::Lease, true),
    ];
    let buttons = buttons.into_iter().filter(|(_, _, may)| *may);
    all.extend(buttons.map(|(name, which, _)| input(name, which, Datatype::Boolean)));
    all
}

fn results() -> impl Iterator<Item = Definition> {
    let parts = [
        ("result/outcome", ResultPart::Outcome, Datatype::Text),
        ("result/reason", ResultPart::Reason, Datatype::Text),
        ("result/message", ResultPart::Message, Datatype::Text),
        ("result/count", ResultPart::Count, Datatype::Int64),
    ];
    parts
        .into_iter()
        .map(|(name, part, datatype)| Definition::new(name, Source::Result(part), datatype))
}

/// The register that a metric shows.
pub(super) fn register(drive: &DriveDescription, source: Source) -> Option<&Register> {
    let Source::Topic(kind) = source else {
        return None;
    };
    drive.model.registers.get(kind.register()?)
}
