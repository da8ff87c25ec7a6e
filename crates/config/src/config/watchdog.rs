//! Checks the settings of the drive's own watchdog in a control section: whether it is known, and whether the times fit.

use super::file::{ControlFile, DriveFile};
use super::line_plan;
use super::ready::LineSettings;
use crate::domain::problem::Problem;
use crate::profile::model::Model;
use crate::toml_file::LocatedValue;
use crate::toml_file::values::duration_text;

/// Settings that rely on a watchdog require a model with a proven one. A time that only limits a wait does not rely on it,
/// so it is merely without effect.
pub(super) fn check(file: &ControlFile, model: &Model, problems: &mut Vec<Problem>) {
    let why = if model.watchdog.is_none() {
        Some(format!("no watchdog of its own is known for {}", model.id))
    } else if !model.watchdog_is_proven() {
        Some(format!(
            "the watchdog of {} is unproven and cannot be relied on",
            model.id
        ))
    } else {
        None
    };
    if let Some(why) = why {
        let required = file
            .require_watchdog
            .valid()
            .filter(|required| required.value)
            .map(|it| &it.location);
        for location in required
            .into_iter()
            .chain(file.watchdog.valid().map(|it| &it.location))
        {
            problems.push(location.problem(why.clone()).right("leave it out"));
        }
        if let Some(timeout) = file.failsafe_confirm_timeout.valid() {
            let problem = timeout.location.problem(format!("has no effect: {why}"));
            problems.push(problem.right("leave it out").warning());
        }
    }
    if !model.watchdog_is_proven() {
        return;
    }
    let Some(LocatedValue {
        value: time,
        location,
    }) = file.watchdog.valid()
    else {
        return;
    };
    if model.watchdog_word(Some(*time)).is_none() {
        let what = format!(
            "the watchdog of {} cannot be set to {}",
            model.id,
            duration_text(*time)
        );
        problems.push(
            location
                .problem(what)
                .right("a time in its steps and within its range"),
        );
    }
    if let Some(lost_after) = file
        .lost_after
        .as_ref()
        .filter(|lost_after| lost_after.value < *time)
    {
        let time = duration_text(*time);
        let lease = duration_text(lost_after.value);
        let problem = location.problem(format!(
            "a watchdog of {time} takes longer than `lost_after`, {lease}"
        ));
        problems.push(problem.right(format!("at most \"{lease}\", or a longer `lost_after`")));
    }
}

/// The watchdog of `drive`, at index `location` of `line`, is fed in time whatever delays its frames.
pub(super) fn is_fed(
    drive: &DriveFile,
    line: &LineSettings,
    location: usize,
    problems: &mut Vec<Problem>,
) {
    let written = drive
        .control
        .valid()
        .and_then(|control| control.value.watchdog.valid());
    let (
        Some(LocatedValue {
            value: time,
            location: at,
        }),
        Some(gap),
    ) = (written, line_plan::longest_gap(line, location))
    else {
        return;
    };
    let least = gap * 2;
    if *time <= least {
        let what = format!(
            "a watchdog of {} may stop the motor without cause: its frames may be {:.1} s apart",
            duration_text(*time),
            gap.as_secs_f64()
        );
        let right = format!(
            "more than {:.1} s, a shorter `poll`, `reply_timeout` or `max_lateness`",
            least.as_secs_f64()
        );
        problems.push(at.problem(what).right(right));
    }
}
