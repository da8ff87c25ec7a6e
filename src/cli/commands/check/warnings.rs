//! What `check` warns about in a configuration that can be used.

use super::text::{list, ms};
use crate::config::{BEHIND_A_BRIDGE, DriveSettings, LineSettings, ListenerSettings, line_plan};
use crate::domain::control::{ControlSettings, FailSafe};
use crate::profile::model::{Model, RunForm};
use crate::toml_file::values::duration_text;

/// The polls of `line` do not fit on it.
pub(super) fn over_full(line: &LineSettings) -> Option<String> {
    let stretch = line_plan::budget(line).stretch;
    let longest = ms(line.max_status_age);
    (stretch > 1.0).then(|| {
        format!("the plan is over-full; every period is stretched {stretch:.2} times (values at most {longest} old)")
    })
}

/// The warnings about `drive` of `line`.
pub(super) fn of_drive(line: &LineSettings, drive: &DriveSettings) -> impl Iterator<Item = String> {
    let control = drive.control.as_ref();
    let takes_control = control.and_then(|_| takes_control(&drive.model));
    let feeds = control.and_then(|control| feeds_watchdog(&drive.model, control));
    takes_control
        .into_iter()
        .chain(feeds)
        .chain(trips_first(line, drive))
}

/// The drive's own watchdog acts before a gateway that takes its line over.
pub(super) fn trips_first(line: &LineSettings, drive: &DriveSettings) -> Option<String> {
    let pair = line.standby.as_ref()?;
    let watchdog = drive.control.as_ref()?.watchdog?;
    let begins = line_plan::take_over(line, pair).begins;
    (watchdog < begins).then(|| {
        format!(
            "its own watchdog of {} may act before gateway {} takes the line over (up to {} after {} is lost): then the \
             drive stops by itself, whatever `on_gateway_lost` says",
            duration_text(watchdog),
            pair.half,
            ms(begins),
            pair.partner,
        )
    })
}

/// Some bits make a drive of `model` obey the bus whatever its own settings.
pub(super) fn takes_control(model: &Model) -> Option<String> {
    let RunForm::Bits {
        priority: priority @ 1..,
        ..
    } = model.run.as_ref()?.form
    else {
        return None;
    };
    Some(format!(
        "every command, a stop too, takes control from panel and terminals (bits 0x{priority:04X})"
    ))
}

/// The polls keep the drive's own watchdog from noticing that its commander is gone.
pub(super) fn feeds_watchdog(model: &Model, control: &ControlSettings) -> Option<String> {
    let text = "with hold its polls continue, and keep its watchdog fed when the commander is gone";
    (model.watchdog.is_some() && control.on_commander_lost == FailSafe::Hold)
        .then(|| text.to_owned())
}

/// Addresses that `listener` allows and behind which a container's clients all look alike, with the warning.
pub(super) fn behind_a_bridge(listener: &ListenerSettings) -> Option<(String, &'static str)> {
    let bridges = listener.bridges();
    (!bridges.is_empty()).then(|| (list(bridges), BEHIND_A_BRIDGE))
}
