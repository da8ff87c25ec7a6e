//! Checks that the configured clients can reach a drive, and that a lease outlasts a command.

use super::file::{
    ConfigFile, ControlFile, DriveFile, DriveUnits, HttpFile, LineFile, ListenerFile, MqttFile,
};
use super::listen::may_be_written;
use super::listener_tls;
use super::mqtt::{AFTER_UNNOTICED, least_restart_delay};
use super::ready::MqttSettings;
use super::words::{CommandInterface, RoleRight};
use crate::domain::problem::Problem;
use crate::guard::COMMAND_DEADLINE;
use crate::north::broker::unnoticed;
use crate::north::mqtt::LeaseMode;
use crate::north::operator::moments;
use crate::toml_file::OptionalKey;
use crate::toml_file::values::duration_text;
use std::collections::BTreeSet;

/// Compares every control section with `[mqtt]` and the listeners. `served` holds, per listener of `file`, the
/// indices of the lines it serves, and `units` the units of each drive of each line.
pub(super) fn check(
    file: &ConfigFile,
    served: &[BTreeSet<usize>],
    units: &[Vec<DriveUnits>],
    problems: &mut Vec<Problem>,
) {
    let at = |line: usize, drive: usize| units.get(line)?.get(drive).copied();
    let mqtt = file.mqtt.valid().map(|mqtt| &mqtt.value);
    for (index, line) in file.lines.iter().enumerate() {
        for (location, drive) in line.drives.iter().enumerate() {
            let Some(control) = drive.control.valid() else {
                continue;
            };
            let control = &control.value;
            mqtt_reaches(control, &file.mqtt, problems);
            sparkplug_reaches(control, &file.mqtt, problems);
            page_reaches(control, &file.http, problems);
            // A listener that serves nothing has an invalid list, which is reported separately.
            let servers = file.units_servers();
            let mut serving = servers.into_iter().zip(served).filter(|(listener, lines)| {
                (lines.is_empty() || lines.contains(&index))
                    && answers(listener, at(index, location))
            });
            let is_reached = serving.any(|(listener, _)| may_be_written(listener));
            modbus_reaches(control, line, is_reached, problems);
            tells_old_from_new(control, mqtt, problems);
            tells_old_from_new_on_the_page(control, problems);
            outlasts(control, mqtt, problems);
        }
    }
    for (listener, lines) in file.units_servers().into_iter().zip(served) {
        let drives = lines
            .iter()
            .filter_map(|line| Some((*line, file.lines.get(*line)?)));
        let drives = drives.flat_map(|(index, line)| {
            let drives = line.drives.iter().enumerate();
            drives
                .filter(move |(location, _)| answers(listener, at(index, *location)))
                .map(|(_, drive)| drive)
        });
        rights_matter(listener, &drives.collect::<Vec<_>>(), problems);
    }
}

/// Whether a drive with these units answers at the listener, once all problems are fixed.
fn answers(listener: &ListenerFile, units: Option<DriveUnits>) -> bool {
    let Some(listed) = listener.units.valid() else {
        return true;
    };
    let Some(DriveUnits {
        native: Some(native),
        uniform: Some(uniform),
    }) = units
    else {
        return true;
    };
    listed
        .value
        .iter()
        .any(|unit| unit.value == native || unit.value == uniform)
}

fn mqtt_reaches(control: &ControlFile, mqtt: &OptionalKey<MqttFile>, problems: &mut Vec<Problem>) {
    if let (Some(location), OptionalKey::Absent) = (control.names(CommandInterface::Mqtt), mqtt) {
        let what = "commands from \"mqtt\" are impossible: there is no `[mqtt]`";
        let right = "`[mqtt]` with `broker`, or leave it out";
        location.refuse(what, right, problems);
    }
}

/// A host announces its own presence: without that, only commands can renew control.
fn sparkplug_reaches(
    control: &ControlFile,
    mqtt: &OptionalKey<MqttFile>,
    problems: &mut Vec<Problem>,
) {
    let Some(location) = control.names(CommandInterface::Sparkplug) else {
        return;
    };
    let found = match mqtt {
        OptionalKey::Absent => None,
        OptionalKey::Invalid => return,
        OptionalKey::Valid(mqtt) => match &mqtt.value.sparkplug {
            OptionalKey::Absent => None,
            OptionalKey::Invalid => return,
            OptionalKey::Valid(sparkplug) => Some((&mqtt.value, &sparkplug.value)),
        },
    };
    let Some((mqtt, sparkplug)) = found else {
        let what = "commands from \"sparkplug\" are impossible: there is no `[mqtt.sparkplug]`";
        let right = "`[mqtt.sparkplug]` with `group` and `primary_host`, or leave it out";
        location.refuse(what, right, problems);
        return;
    };
    let lease = mqtt.lease().and_then(|default| control.lease.or(default));
    if lease == Some(LeaseMode::Session) && sparkplug.primary_host.is_absent() {
        let what =
            "a session lease of a Sparkplug host lasts while it is online, and no host is named";
        let right = "`primary_host` in `[mqtt.sparkplug]`, or lease = \"explicit\"";
        location.refuse(what, right, problems);
    }
}

fn page_reaches(control: &ControlFile, http: &OptionalKey<HttpFile>, problems: &mut Vec<Problem>) {
    let Some(location) = control.names(CommandInterface::Page) else {
        return;
    };
    let signs_in = match http {
        OptionalKey::Absent => false,
        OptionalKey::Invalid => true,
        OptionalKey::Valid(http) => !http.value.users.is_empty(),
    };
    if !signs_in {
        let what = "commands from \"page\" are impossible: no user can sign in there";
        let right = "`[[http.users]]` with `name` and `password_hash_file`, or leave it out";
        location.refuse(what, right, problems);
    }
}

fn modbus_reaches(
    control: &ControlFile,
    line: &LineFile,
    is_reached: bool,
    problems: &mut Vec<Problem>,
) {
    if let Some(location) = control.names(CommandInterface::ModbusTcp)
        && !is_reached
    {
        let what = format!(
            "commands from \"modbus-tcp\" are impossible: no listener of {} allows any client to write",
            line.label()
        );
        let right = "`write = [\"10.0.0.10/32\"]` in a `[[modbus_tcp]]`, or leave it out";
        location.refuse(what, right, problems);
    }
}

/// A plain message that was delayed unnoticed must not be mistaken for one sent after a stop. With
/// `commands = "strict"` no plain message is accepted at all.
fn tells_old_from_new(control: &ControlFile, mqtt: Option<&MqttFile>, problems: &mut Vec<Problem>) {
    let (Some(mqtt), Some(_), Some(false)) = (mqtt, control.by_broker(), control.strict()) else {
        return;
    };
    let (Some(delay), Some(interval)) = (control.restart_delay.valid(), mqtt.probe_interval())
    else {
        return;
    };
    let least = least_restart_delay(interval);
    if delay.value < least {
        let what = format!(
            "{} is too short to distinguish a RUN that waited at the broker from one that was sent \
             after the stop: with `probe_interval` = \"{}\" a RUN may wait {} before that is \
             noticed",
            duration_text(delay.value),
            duration_text(interval),
            duration_text(unnoticed(interval)),
        );
        let right = format!("at least \"{}\", or leave it out", duration_text(least));
        delay.refuse(what, right, problems);
    }
}

/// A RUN from the page that was delayed must not be mistaken for one sent after a stop: a page order does not refer to
/// a stop that it has seen.
fn tells_old_from_new_on_the_page(control: &ControlFile, problems: &mut Vec<Problem>) {
    let least = moments::AGE_MAX + AFTER_UNNOTICED;
    let (Some(delay), Some(_)) = (
        control.restart_delay.valid(),
        control.names(CommandInterface::Page),
    ) else {
        return;
    };
    if delay.value < least {
        let what = format!(
            "{} is too short to distinguish a RUN of the page that waited on its way from one that \
             was sent after the stop: a RUN may wait {} before that is noticed",
            duration_text(delay.value),
            duration_text(moments::AGE_MAX),
        );
        let right = format!("at least \"{}\", or leave it out", duration_text(least));
        delay.refuse(what, right, problems);
    }
}

/// A lease lasts longer than a command may wait; a session lease also lasts longer than the tolerated missing probes.
fn outlasts(control: &ControlFile, mqtt: Option<&MqttFile>, problems: &mut Vec<Problem>) {
    let Some(lost_after) = &control.lost_after else {
        return;
    };
    let time = lost_after.value;
    let lease = duration_text(time);
    if time <= COMMAND_DEADLINE {
        let deadline = duration_text(COMMAND_DEADLINE);
        let what =
            format!("a lease of {lease} is not longer than the deadline of a command, {deadline}");
        lost_after.refuse(what, "a longer time, as \"5s\"", problems);
    }
    let (Some(mqtt), Some(_)) = (mqtt, control.by_broker()) else {
        return;
    };
    if let Some(ttl) = mqtt.command_ttl()
        && ttl > COMMAND_DEADLINE
        && time <= ttl
    {
        let ttl = duration_text(ttl);
        let what = format!("a lease of {lease} is not longer than `command_ttl`, {ttl}");
        let right = format!("more than \"{ttl}\", or a shorter `command_ttl`");
        lost_after.refuse(what, right, problems);
    }
    if mqtt.lease().and_then(|default| control.lease.or(default)) != Some(LeaseMode::Session) {
        return;
    }
    let probes = MqttSettings::PROBES;
    if let Some(least) = mqtt.probe_interval().map(|probe| probe * probes)
        && time < least
    {
        let least = duration_text(least);
        let what = format!(
            "a session lease of {lease} is shorter than {probes} probes of the way through the broker, {least}"
        );
        let right = format!("at least \"{least}\", or a shorter `probe_interval`");
        lost_after.refuse(what, right, problems);
    }
}

/// A right to write requires drives that accept commands from here; a right to stop requires drives with a control
/// section.
fn rights_matter(listener: &ListenerFile, drives: &[&DriveFile], problems: &mut Vec<Problem>) {
    let takes_from_here = |control: &ControlFile| {
        control.from.is_none() || control.names(CommandInterface::ModbusTcp).is_some()
    };
    let any = |matters: &dyn Fn(&ControlFile) -> bool| {
        drives.is_empty()
            || drives.iter().any(|drive| match &drive.control {
                OptionalKey::Absent => false,
                OptionalKey::Invalid => true,
                OptionalKey::Valid(control) => matters(&control.value),
            })
    };
    let right =
        "`from = [\"modbus-tcp\"]` in the `[line.drive.control]` of a drive, or leave it out";
    let commands = any(&takes_from_here);
    let stops = any(&|_| true);
    let effect_of = |granted: RoleRight| match granted {
        RoleRight::Write => (
            commands,
            "has no effect: no drive that is served here takes commands from \"modbus-tcp\"",
        ),
        RoleRight::Stop => (
            stops,
            "has no effect: no drive that is served here has a control section",
        ),
    };
    for role_right in listener_tls::rights(listener) {
        let (matters, what) = effect_of(role_right.value);
        if !matters {
            role_right.warn(what, right, problems);
        }
    }
    for (list, granted) in [
        (&listener.write, RoleRight::Write),
        (&listener.stop, RoleRight::Stop),
    ] {
        let (matters, what) = effect_of(granted);
        if let Some(list) = list.valid()
            && !matters
            && !list.value.is_empty()
        {
            list.warn(what, right, problems);
        }
    }
}
