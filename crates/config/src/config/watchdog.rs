//! Checks the settings of the drive's own watchdog in a control section: whether it is known, and whether the times fit.

use super::file::{ControlFile, DriveFile};
use super::line_plan;
use super::ready::LineSettings;
use crate::domain::problem::Problem;
use crate::profile::model::Model;
use crate::toml_file::values::duration_text;

/// Settings that rely on a watchdog require a model with a proven one. A time that only limits a wait does not rely on it,
/// so it is merely without effect.
pub(super) fn check(file: &ControlFile, model: &Model, problems: &mut Vec<Problem>) {
    let id = &model.id;
    if !model.watchdog_is_proven() {
        let why = match model.watchdog {
            None => format!("no watchdog of its own is known for {id}"),
            Some(_) => format!("the watchdog of {id} is unproven and cannot be relied on"),
        };
        let required = file.require_watchdog.valid_as(&true).map(|it| &it.location);
        for location in required.into_iter().chain(file.watchdog.location()) {
            location.refuse(why.clone(), "leave it out", problems);
        }
        if let Some(timeout) = file.failsafe_confirm_timeout.valid() {
            timeout.warn(format!("has no effect: {why}"), "leave it out", problems);
        }
        return;
    }
    let Some(written) = file.watchdog.valid() else {
        return;
    };
    let time = duration_text(written.value);
    if model.watchdog_word(Some(written.value)).is_none() {
        let what = format!("the watchdog of {id} cannot be set to {time}");
        let right = "a time in its steps and within its range";
        written.refuse(what, right, problems);
    }
    if let Some(lost_after) = &file.lost_after
        && lost_after.value < written.value
    {
        let lease = duration_text(lost_after.value);
        let what = format!("a watchdog of {time} takes longer than `lost_after`, {lease}");
        let right = format!("at most \"{lease}\", or a longer `lost_after`");
        written.refuse(what, right, problems);
    }
}

/// The watchdog of `drive`, at index `location` of `line`, is fed in time whatever delays its frames.
pub(super) fn is_fed(
    drive: &DriveFile,
    line: &LineSettings,
    location: usize,
    problems: &mut Vec<Problem>,
) {
    let control = drive.control.valid();
    let (Some(written), Some(gap)) = (
        control.and_then(|control| control.value.watchdog.valid()),
        line_plan::longest_gap(line, location),
    ) else {
        return;
    };
    let least = gap * 2;
    if written.value <= least {
        let what = format!(
            "a watchdog of {} may stop the motor without cause: its frames may be {:.1} s apart",
            duration_text(written.value),
            gap.as_secs_f64()
        );
        let right = format!(
            "more than {:.1} s, a shorter `poll`, `reply_timeout` or `max_lateness`",
            least.as_secs_f64()
        );
        written.refuse(what, right, problems);
    }
}
