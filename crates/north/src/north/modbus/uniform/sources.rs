//! Where the uniform words of one drive come from, looked up once.

use super::column::{FreshValue, MeasurementSource, unit_of};
use crate::domain::command::RunIntent;
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::{DriveDescription, FreshnessLimits};
use crate::drive::usage::UsageParts;
use crate::drive::view::DriveView;
use crate::profile::model::{PollClass, Register, RegisterRole};
use crate::profile::words::ROLES;
use std::collections::BTreeMap;
use std::time::Duration;

/// The measurements that the model has, polls, and has in the unit of the map.
#[derive(Clone, Debug)]
pub(super) struct MeasurementSources {
    measurements: BTreeMap<RegisterRole, MeasurementSource>,
    /// Every register that is polled while it may change, with the age from which it is stale.
    pub(super) polled: Vec<(Register, FreshnessLimits)>,
    /// Trips are shown or counted.
    pub(super) has_trips: bool,
    /// The register of warnings.
    pub(super) warning: Option<(Register, FreshnessLimits)>,
    /// The drive has a control section.
    pub(super) has_control: bool,
    /// Which sums of what it has used there are.
    pub(super) usage: UsageParts,
}

fn is_live(register: &&Register) -> bool {
    register.poll.is_some_and(PollClass::is_live)
}

impl MeasurementSources {
    pub(super) fn new(drive: &DriveDescription) -> Self {
        let measured = ROLES.iter().map(|(_, role)| *role);
        let measured = measured.filter(|role| unit_of(*role) != UnitOfMeasure::None);
        let registers = drive.model.registers.iter();
        let has_trips = drive
            .model
            .trip_register()
            .is_some_and(|register| register.poll.is_some());
        Self {
            measurements: measured
                .filter_map(|role| Some((role, MeasurementSource::new(drive, role)?)))
                .collect(),
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

    /// The measurement with `role`.
    pub(super) fn measurement(&self, role: RegisterRole) -> Option<&MeasurementSource> {
        self.measurements.get(&role)
    }

    /// Whether the output frequency, which is fresh, is within 0.1 Hz of the setpoint that was ordered with the RUN in force.
    /// Without such an order, of the drive's own setting, which is fresh as well.
    pub(super) fn is_at_setpoint(&self, view: &DriveView, now: MonoTime) -> bool {
        let fresh = |role| Some(self.measurement(role)?.fresh(view, now)?.magnitude());
        let output = fresh(RegisterRole::OutputFrequency);
        let ordered = view
            .control
            .as_ref()
            .filter(|control| matches!(control.intent, RunIntent::Run(_)));
        let ordered = ordered
            .and_then(|control| control.setpoint)
            .map(FreshValue::of);
        let wanted = ordered.or_else(|| fresh(RegisterRole::FrequencySetting));
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
