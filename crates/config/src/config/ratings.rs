//! Rated values of a drive, for models that report in percent of them, and the full scale of its frequencies, for models that do
//! not show it.

use super::file::DriveFile;
use crate::domain::frequency::Hertz;
use crate::domain::problem::Problem;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveRatings;
use crate::profile::model::{Model, RegisterRole};
use crate::toml_file::OptionalKey;
use std::sync::Arc;

/// A rated value, and the readings that are in percent of it.
struct RatedKey {
    key: &'static str,
    what: &'static str,
    roles: &'static [RegisterRole],
    value: fn(&DriveRatings) -> Option<u32>,
}

const CURRENT: RatedKey = RatedKey {
    key: "rated_current_a",
    what: "current",
    roles: &[RegisterRole::OutputCurrent, RegisterRole::TripCurrent],
    value: |ratings| ratings.current_ma,
};
const VOLTAGE: RatedKey = RatedKey {
    key: "rated_voltage_v",
    what: "voltage",
    roles: &[
        RegisterRole::OutputVoltage,
        RegisterRole::DcLinkVoltage,
        RegisterRole::TripDcLinkVoltage,
    ],
    value: |ratings| ratings.voltage_mv,
};

impl RatedKey {
    /// Whether `model` reports in percent of it.
    fn is_used_by(&self, model: &Model) -> bool {
        let is_relative = |role: &RegisterRole| {
            model
                .register_for(*role)
                .is_some_and(|register| register.unit == UnitOfMeasure::Percent)
        };
        model.quirks.percent_of_rated.is_some() && self.roles.iter().any(is_relative)
    }

    fn settle(
        &self,
        given: &OptionalKey<u32>,
        model: Option<&Model>,
        problems: &mut Vec<Problem>,
    ) -> Option<Option<u32>> {
        if let (Some(written), Some(model)) = (given.valid(), model)
            && !self.is_used_by(model)
        {
            let what = format!(
                "has no effect: {} reports no {} in percent of the rated one",
                model.id, self.what
            );
            written.warn(what, "leave it out", problems);
        }
        given.clone().optional()
    }
}

/// The rated values of `drive`; `None` if it is invalid, see `problems`.
pub(super) fn settle(
    drive: &DriveFile,
    model: Option<&Model>,
    problems: &mut Vec<Problem>,
) -> Option<DriveRatings> {
    let current_ma = CURRENT.settle(&drive.rated_current, model, problems);
    let voltage_mv = VOLTAGE.settle(&drive.rated_voltage, model, problems);
    Some(DriveRatings {
        current_ma: current_ma?,
        voltage_mv: voltage_mv?,
    })
}

/// `model` with the full scale that `drive` states. If it needs one and there is none, that is in `problems`, and the model is
/// good for finding the others.
pub(super) fn full_scale(
    drive: &DriveFile,
    model: Option<Arc<Model>>,
    problems: &mut Vec<Problem>,
) -> Option<Arc<Model>> {
    let model = model?;
    match &drive.full_scale {
        OptionalKey::Invalid => Some(model),
        OptionalKey::Valid(written) if model.needs_full_scale() => Some(Arc::new(
            model.with_full_scale(Hertz::from_millihertz(written.value)),
        )),
        OptionalKey::Valid(written) => {
            let what = format!(
                "has no effect: {} reports no fractions of a full scale that it does not show",
                model.id
            );
            written.warn(what, "leave it out", problems);
            Some(model)
        }
        OptionalKey::Absent if model.needs_full_scale() => {
            let parameter = model.full_scale_parameter();
            let parameter = parameter.map(|it| format!(", {it}")).unwrap_or_default();
            let right = format!("the frequency that stands for 100 % at the drive{parameter}");
            let location = drive.location.missing("full_scale_hz");
            location.refuse("`full_scale_hz` is missing", right, problems);
            Some(model)
        }
        OptionalKey::Absent => Some(model),
    }
}

/// The readings that can only be shown in percent on a drive of `model`, each with the key that changes that.
pub fn shown_in_per_cent(
    model: &Model,
    ratings: &DriveRatings,
) -> impl Iterator<Item = (&'static str, &'static str)> {
    let missing = |rated: &RatedKey| rated.is_used_by(model) && (rated.value)(ratings).is_none();
    [CURRENT, VOLTAGE]
        .into_iter()
        .filter(missing)
        .map(|rated| (rated.what, rated.key))
}
