//! The full scale of a drive's frequencies, for models whose drives do not show it.

use super::file::DriveFile;
use crate::domain::frequency::Hertz;
use crate::domain::problem::Problem;
use crate::profile::model::Model;
use crate::toml_file::OptionalKey;
use std::sync::Arc;

/// `model` with the full scale that `drive` states. If it needs one and there is none, that is in `problems`, and the model is
/// good for finding the others.
pub(super) fn settle(
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
            problems.push(
                written
                    .location
                    .problem(what)
                    .right("leave it out")
                    .warning(),
            );
            Some(model)
        }
        OptionalKey::Absent if model.needs_full_scale() => {
            let problem = drive
                .location
                .missing("full_scale_hz")
                .problem("`full_scale_hz` is missing");
            let parameter = model
                .full_scale_parameter()
                .map(|it| format!(", {it}"))
                .unwrap_or_default();
            let right = format!("the frequency that stands for 100 % at the drive{parameter}");
            problems.push(problem.right(right));
            Some(model)
        }
        OptionalKey::Absent => Some(model),
    }
}
