//! Rated values of a drive, for models that report in percent of them.

use super::file::DriveFile;
use crate::domain::problem::Problem;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::Ratings;
use crate::profile::model::{Model, Role};
use crate::toml_file::OptionalKey;

/// A rated value, and the readings that are in percent of it.
struct Rated {
    key: &'static str,
    what: &'static str,
    roles: &'static [Role],
    value: fn(&Ratings) -> Option<u32>,
}

const CURRENT: Rated = Rated {
    key: "rated_current_a",
    what: "current",
    roles: &[Role::OutputCurrent, Role::TripCurrent],
    value: |ratings| ratings.current_ma,
};
const VOLTAGE: Rated = Rated {
    key: "rated_voltage_v",
    what: "voltage",
    roles: &[
        Role::OutputVoltage,
        Role::DcLinkVoltage,
        Role::TripDcLinkVoltage,
    ],
    value: |ratings| ratings.voltage_mv,
};

impl Rated {
    /// Whether `model` reports in percent of it.
    fn is_used_by(&self, model: &Model) -> bool {
        let is_relative = |role: &Role| {
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
        if let (OptionalKey::Valid(written), Some(model)) = (given, model)
            && !self.is_used_by(model)
        {
            let what = format!(
                "has no effect: {} reports no {} in percent of the rated one",
                model.id, self.what
            );
            problems.push(
                written
                    .location
                    .problem(what)
                    .right("leave it out")
                    .warning(),
            );
        }
        given.clone().optional()
    }
}

/// The rated values of `drive`; `None` if it is invalid, see `problems`.
pub(super) fn settle(
    drive: &DriveFile,
    model: Option<&Model>,
    problems: &mut Vec<Problem>,
) -> Option<Ratings> {
    let current_ma = CURRENT.settle(&drive.rated_current, model, problems);
    let voltage_mv = VOLTAGE.settle(&drive.rated_voltage, model, problems);
    Some(Ratings {
        current_ma: current_ma?,
        voltage_mv: voltage_mv?,
    })
}

/// The readings that can only be shown in percent on a drive of `model`, each with the key that changes that.
pub fn shown_in_per_cent(
    model: &Model,
    ratings: &Ratings,
) -> impl Iterator<Item = (&'static str, &'static str)> {
    let missing = |rated: &Rated| rated.is_used_by(model) && (rated.value)(ratings).is_none();
    [CURRENT, VOLTAGE]
        .into_iter()
        .filter(missing)
        .map(|rated| (rated.what, rated.key))
}
