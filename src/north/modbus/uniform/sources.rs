//! Where the uniform words of one drive come from, looked up once.

use super::column::{Column, Fresh};
use crate::domain::command::RunIntent;
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::{DriveDescription, Freshness};
use crate::drive::usage::UsageParts;
use crate::drive::view::DriveView;
use crate::profile::model::{PollClass, Register, Role};
use std::time::Duration;

/// The measurements that the model has, polls, and has in the unit of the map.
#[derive(Clone, Debug)]
pub(super) struct Sources {
    pub(super) output_frequency: Option<Column>,
    pub(super) setting: Option<Column>,
    pub(super) current: Option<Column>,
    pub(super) voltage: Option<Column>,
    pub(super) dc_voltage: Option<Column>,
    pub(super) power: Option<Column>,
    pub(super) torque: Option<Column>,
    pub(super) temperature: Option<Column>,
    pub(super) run_hours: Option<Column>,
    /// Every register that is polled while it may change, with the age from which it is stale.
    pub(super) polled: Vec<(Register, Freshness)>,
    /// Trips are shown or counted.
    pub(super) has_trips: bool,
    /// The register of warnings.
    pub(super) warning: Option<(Register, Freshness)>,
    /// The drive has a control section.
    pub(super) has_control: bool,
    /// Which sums of what it has used there are.
    pub(super) usage: UsageParts,
}

fn is_live(register: &&Register) -> bool {
    register.poll.is_some_and(PollClass::is_live)
}

impl Sources {
    pub(super) fn new(drive: &DriveDescription) -> Self {
        let column = |role, unit| Column::new(drive, role, unit);
        let registers = drive.model.registers.iter();
        let has_trips = drive
            .model
            .trip_register()
            .is_some_and(|register| register.poll.is_some());
        let setting = drive.model.setting_register();
        Self {
            output_frequency: column(Role::OutputFrequency, UnitOfMeasure::Hertz),
            setting: setting.and_then(|register| Column::of(drive, register, UnitOfMeasure::Hertz)),
            current: column(Role::OutputCurrent, UnitOfMeasure::Ampere),
            voltage: column(Role::OutputVoltage, UnitOfMeasure::Volt),
            dc_voltage: column(Role::DcLinkVoltage, UnitOfMeasure::Volt),
            power: column(Role::OutputPower, UnitOfMeasure::Kilowatt),
            torque: column(Role::Torque, UnitOfMeasure::Percent),
            temperature: column(Role::Temperature, UnitOfMeasure::Celsius),
            run_hours: column(Role::RunHours, UnitOfMeasure::Hour),
            polled: registers
                .filter(is_live)
                .filter_map(|it| Some((it.clone(), drive.freshness(it)?)))
                .collect(),
            has_trips,
            warning: drive
                .model
                .warning_register()
                .and_then(|it| Some((it.clone(), drive.freshness(it)?))),
            has_control: drive.control.is_some(),
            usage: UsageParts::of(&drive.model),
        }
    }

    /// Whether the output frequency, which is fresh, is within 0.1 Hz of the setpoint that was ordered with the RUN in force.
    /// Without such an order, of the drive's own setting, which is fresh as well.
    pub(super) fn is_at_setpoint(&self, view: &DriveView, now: MonoTime) -> bool {
        let fresh = |column: &Option<Column>| Some(column.as_ref()?.fresh(view, now)?.magnitude());
        let output = fresh(&self.output_frequency);
        let ordered = view
            .control
            .as_ref()
            .filter(|control| matches!(control.intent, RunIntent::Run(_)));
        let ordered = ordered.and_then(|control| control.setpoint).map(Fresh::of);
        let wanted = ordered.or_else(|| fresh(&self.setting));
        output
            .zip(wanted)
            .is_some_and(|(output, wanted)| output.is_near(wanted))
    }

    /// Whether a warning is active, by a fresh reading.
    pub(super) fn warns(&self, view: &DriveView, now: MonoTime) -> bool {
        self.warning.as_ref().is_some_and(|(register, freshness)| {
            let is_fresh = freshness
                .ends_at(register, &view.snapshot)
                .is_some_and(|ends_at| now < ends_at);
            let shown =
                register.code(|address| view.snapshot.reading(address).map(|reading| reading.raw));
            is_fresh && shown.is_some_and(|shown| shown != 0)
        })
    }

    /// Whether a polled value is stale or was never read.
    pub(super) fn is_stale(&self, view: &DriveView, now: MonoTime) -> bool {
        self.polled.iter().any(|(register, freshness)| {
            freshness
                .ends_at(register, &view.snapshot)
                .is_none_or(|ends_at| now >= ends_at)
        })
    }

    /// The age of the oldest polled value; `None` if one was never read, or none is polled.
    pub(super) fn oldest_age(&self, view: &DriveView, now: MonoTime) -> Option<Duration> {
        let mut oldest = None;
        for (register, _) in &self.polled {
            oldest = oldest.max(Some(now.since(view.snapshot.read_at(register)?)));
        }
        oldest
    }
}
