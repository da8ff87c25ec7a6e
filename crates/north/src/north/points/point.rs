//! Which points a drive has, each with its name and its content.

use super::content::{PointContent, PointContext};
use super::plain::{PLAIN_POINTS, PlainPoint, PointGroup};
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::drive::rated::RatedConversion;
use crate::drive::usage::{UsagePart, UsageParts};
use crate::north::shown::{answered_run_state, fresh};
use crate::profile::model::{Register, RegisterRole};

/// One point of a drive. Numbers are indices of registers in the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrivePoint {
    /// Whether the drive answers.
    Availability,
    /// The run state.
    RunState,
    /// A polled register.
    Polled(usize),
    /// The register at this index, which is in per cent of a rated value, in the unit of that value.
    Rated(usize),
    /// The setpoint that was commanded, if the drive's own is not polled.
    Setpoint,
    /// A row of the table of what is no register.
    Plain(&'static PlainPoint),
    /// One of the sums of what the drive has used.
    Usage(UsagePart),
    /// A register that was read on demand.
    Param(usize),
}

impl DrivePoint {
    /// Whether its changes are kept while there is no broker to publish to.
    pub const fn is_recorded(self) -> bool {
        matches!(
            self,
            Self::RunState | Self::Polled(_) | Self::Rated(_) | Self::Setpoint
        )
    }

    /// Whether it concerns trips.
    pub fn is_trip(self) -> bool {
        matches!(self, Self::Plain(point) if matches!(point.group, PointGroup::Trip | PointGroup::TripRecord))
    }

    /// The index of the register that it shows.
    pub const fn register(self) -> Option<usize> {
        match self {
            Self::Polled(register) | Self::Rated(register) | Self::Param(register) => {
                Some(register)
            }
            _ => None,
        }
    }

    /// The register whose age decides whether it is known; `None` if it is known whatever was read.
    pub fn rests_on(self, drive: &DriveDescription) -> Option<&Register> {
        match self {
            Self::Plain(point) => point.rests_on(&drive.model),
            _ => drive.model.registers.get(self.register()?),
        }
    }

    /// Its unit of measure; `None` for words and yes or no.
    pub fn unit(self, drive: &DriveDescription) -> Option<UnitOfMeasure> {
        let register = |place: usize| drive.model.registers.get(place);
        match self {
            Self::Polled(place) => register(place).map(|it| it.unit),
            Self::Rated(place) => register(place)
                .and_then(|it| RatedConversion::of(it, &drive.ratings))
                .map(|rated| rated.unit),
            Self::Setpoint => Some(UnitOfMeasure::Hertz),
            Self::Usage(part) => Some(part.unit()),
            Self::Availability | Self::RunState | Self::Plain(_) | Self::Param(_) => None,
        }
    }

    /// What it shows now. A register that was read on demand shows what polls have read.
    pub fn content(self, now: &PointContext<'_>) -> PointContent {
        let PointContext { drive, view, .. } = *now;
        match self {
            Self::Availability if view.is_online() => PointContent::Text("online".into()),
            Self::Availability => PointContent::Text("offline".into()),
            Self::RunState => PointContent::Text(answered_run_state(view).keyword().into()),
            Self::Polled(place) | Self::Rated(place) | Self::Param(place) => {
                let register = drive.model.registers.get(place);
                let reading = register.and_then(|register| fresh(drive, register, view, now.at));
                reading.map_or(PointContent::Unknown, |it| PointContent::Value(it.value))
            }
            Self::Setpoint => {
                let setpoint = view.control.as_ref().and_then(|control| control.setpoint);
                setpoint.map_or(PointContent::Unknown, PointContent::Hertz)
            }
            Self::Plain(point) => point.content(now),
            Self::Usage(part) => view
                .usage
                .value(part)
                .map_or(PointContent::Unknown, PointContent::Sum),
        }
    }
}

/// The points of `drive` in the order in which they are shown, each with its name: its topic below the drive's.
pub fn points_of(drive: &DriveDescription) -> Vec<(DrivePoint, String)> {
    let mut points = vec![
        (DrivePoint::Availability, "availability".into()),
        (DrivePoint::RunState, "run/state".into()),
    ];
    let polled = |(_, register): &(usize, &Register)| register.poll.is_some();
    let values = drive.model.registers.iter().enumerate().filter(polled);
    points.extend(
        values.filter_map(|(place, register)| {
            Some((DrivePoint::Polled(place), value_name(register)?))
        }),
    );
    let in_per_cent = drive
        .model
        .registers
        .iter()
        .enumerate()
        .filter(polled)
        .filter_map(|(place, register)| {
            let rated = RatedConversion::of(register, &drive.ratings)?;
            Some((
                DrivePoint::Rated(place),
                format!("measure/{}", measure_name(register.role?, rated.unit)?),
            ))
        });
    points.extend(in_per_cent);
    let has_setpoint = points.iter().any(|(_, name)| name == SETPOINT);
    if drive.control.is_some() && !has_setpoint {
        points.push((DrivePoint::Setpoint, SETPOINT.into()));
    }
    let plain = PLAIN_POINTS.iter().filter(|point| point.is_of(drive));
    points.extend(plain.map(|point| (DrivePoint::Plain(point), point.name.to_owned())));
    let parts = UsageParts::of(&drive.model);
    let used = UsagePart::ALL.into_iter().filter(|part| parts.has(*part));
    points.extend(used.map(|part| (DrivePoint::Usage(part), format!("usage/{}", part.keyword()))));
    points
}

const SETPOINT: &str = "frequency/setpoint";

/// The name of a polled register; `None` for the trip count, which is shown as interpreted.
fn value_name(register: &Register) -> Option<String> {
    match register.role {
        Some(RegisterRole::OutputFrequency) => Some("frequency/output".to_owned()),
        Some(RegisterRole::FrequencySetting | RegisterRole::FrequencyCommand) => {
            Some(SETPOINT.to_owned())
        }
        Some(
            RegisterRole::TripCount
            | RegisterRole::TripCode
            | RegisterRole::TripBits
            | RegisterRole::TripCause
            | RegisterRole::TripHistory,
        ) => None,
        Some(RegisterRole::WarningCode | RegisterRole::WarningBits) => None,
        Some(role) => Some(format!(
            "measure/{}",
            measure_name(role, register.unit).unwrap_or(&register.name)
        )),
        None => Some(format!("measure/{}", register.name)),
    }
}

/// The vendor-independent name of a measurement, if it is in its vendor-independent unit.
fn measure_name(role: RegisterRole, unit: UnitOfMeasure) -> Option<&'static str> {
    let (name, usual) = role.measurement()?;
    (unit == usual).then_some(name)
}
