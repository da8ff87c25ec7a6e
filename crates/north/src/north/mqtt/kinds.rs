//! Which topics a drive has, and what each shows.

use super::types::TopicTree;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::drive::rated::RatedConversion;
use crate::drive::usage::{UsagePart, UsageParts};
use crate::profile::model::{Register, RegisterRole};

/// What a topic shows. Numbers are indices of registers in the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::north) enum TopicKind {
    Availability,
    RunState,
    /// A polled register.
    Polled(usize),
    /// The register at this index, which is in per cent of a rated value, in the unit of that value.
    Rated(usize),
    /// The setpoint that was commanded, if the drive's own is not polled.
    Setpoint,
    /// The owner of control.
    Owner,
    TripActive,
    TripCode,
    TripText,
    TripCount,
    TripLast,
    /// Whether a warning is active; the drive goes on.
    WarningActive,
    WarningCode,
    WarningText,
    /// One of the sums of what the drive has used.
    Usage(UsagePart),
    /// A register that was read on demand.
    Param(usize),
}

impl TopicKind {
    /// Whether its changes are kept while there is no broker to publish to.
    pub(super) const fn is_recorded(self) -> bool {
        matches!(
            self,
            Self::RunState | Self::Polled(_) | Self::Rated(_) | Self::Setpoint
        )
    }

    /// The tree it is part of; `None`: it is always published.
    pub(super) const fn tree(self) -> Option<TopicTree> {
        match self {
            Self::Availability => None,
            Self::Param(_) => Some(TopicTree::Param),
            _ => Some(TopicTree::Values),
        }
    }

    /// The register that it shows.
    pub(in crate::north) const fn register(self) -> Option<usize> {
        match self {
            Self::Polled(register) | Self::Rated(register) | Self::Param(register) => {
                Some(register)
            }
            _ => None,
        }
    }
}

/// What is shown of `drive`, each with its topic below the drive's.
pub(in crate::north) fn kinds(drive: &DriveDescription) -> Vec<(TopicKind, String)> {
    let mut kinds = vec![
        (TopicKind::Availability, "availability".into()),
        (TopicKind::RunState, "run/state".into()),
    ];
    let polled = |(_, register): &(usize, &Register)| register.poll.is_some();
    let values = drive.model.registers.iter().enumerate().filter(polled);
    kinds.extend(
        values.filter_map(|(place, register)| {
            Some((TopicKind::Polled(place), value_topic(register)?))
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
                TopicKind::Rated(place),
                format!("measure/{}", measure_name(register.role?, rated.unit)?),
            ))
        });
    kinds.extend(in_per_cent);
    let has_setpoint = kinds.iter().any(|(_, rest)| rest == SETPOINT);
    if drive.control.is_some() && !has_setpoint {
        kinds.push((TopicKind::Setpoint, SETPOINT.into()));
    }
    if drive.control.is_some() {
        kinds.push((TopicKind::Owner, "control/owner".into()));
    }
    let trips = [
        (TopicKind::TripActive, "active"),
        (TopicKind::TripCode, "code"),
        (TopicKind::TripText, "text"),
        (TopicKind::TripCount, "count"),
        (TopicKind::TripLast, "last"),
    ];
    kinds.extend(trips.map(|(kind, rest)| (kind, format!("trip/{rest}"))));
    if drive.model.warning_register().is_some() {
        let warnings = [
            (TopicKind::WarningActive, "active"),
            (TopicKind::WarningCode, "code"),
            (TopicKind::WarningText, "text"),
        ];
        kinds.extend(warnings.map(|(kind, rest)| (kind, format!("warning/{rest}"))));
    }
    let parts = UsageParts::of(&drive.model);
    let used = UsagePart::ALL.into_iter().filter(|part| parts.has(*part));
    kinds.extend(used.map(|part| (TopicKind::Usage(part), format!("usage/{}", part.keyword()))));
    kinds
}

const SETPOINT: &str = "frequency/setpoint";

/// The topic of a polled register; `None` for the trip count, which is shown as interpreted.
fn value_topic(register: &Register) -> Option<String> {
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
const fn measure_name(role: RegisterRole, unit: UnitOfMeasure) -> Option<&'static str> {
    Some(match (role, unit) {
        (RegisterRole::OutputCurrent, UnitOfMeasure::Ampere) => "current",
        (RegisterRole::OutputVoltage, UnitOfMeasure::Volt) => "voltage",
        (RegisterRole::DcLinkVoltage, UnitOfMeasure::Volt) => "dc_voltage",
        (RegisterRole::OutputPower, UnitOfMeasure::Kilowatt) => "power",
        (RegisterRole::Torque, UnitOfMeasure::Percent) => "torque",
        (RegisterRole::Temperature, UnitOfMeasure::Celsius) => "temperature",
        (RegisterRole::RunHours, UnitOfMeasure::Hour) => "run_hours",
        (RegisterRole::Energy, UnitOfMeasure::KilowattHour) => "energy",
        _ => return None,
    })
}
