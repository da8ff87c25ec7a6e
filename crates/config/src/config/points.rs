//! Publication of a drive's polled registers over MQTT: dead bands, heartbeats and decimals.

use super::file::{ConfigFile, DriveFile, RegisterValues};
use crate::domain::problem::{Problem, nearest};
use crate::drive::description::PointSettings;
use crate::north::mqtt::TopicTree;
use crate::profile::model::{Model, Register};
use crate::toml_file::{LocatedValue, OptionalKey};

/// The tables of `drive`, by the names of registers that are polled; `None` if it is invalid, see `problems`. `is_published`: whether
/// there is a broker to publish to.
pub(super) fn settle(
    drive: &DriveFile,
    model: Option<&Model>,
    is_published: bool,
    problems: &mut Vec<Problem>,
) -> Option<PointSettings> {
    let dead_bands = table(
        &drive.dead_bands,
        "a dead band",
        (model, is_published),
        problems,
    );
    let heartbeats = table(
        &drive.heartbeats,
        "a heartbeat",
        (model, is_published),
        problems,
    );
    let decimals = table(
        &drive.decimals,
        "the count of decimals",
        (model, is_published),
        problems,
    );
    let mut points = PointSettings {
        dead_bands: dead_bands?,
        heartbeats: heartbeats?,
        decimals: decimals?,
    };
    if let (OptionalKey::Valid(table), Some(model)) = (&drive.decimals, model) {
        let left_out = too_fine(&table.value, model, problems);
        points
            .decimals
            .retain(|(name, _)| !left_out.contains(&name.as_str()));
    }
    Some(points)
}

/// The values of one table.
fn table<T: Copy>(
    given: &RegisterValues<T>,
    what: &str,
    (model, is_published): (Option<&Model>, bool),
    problems: &mut Vec<Problem>,
) -> Option<Vec<(String, T)>> {
    let table = match given {
        OptionalKey::Absent => return Some(Vec::new()),
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(table) => table,
    };
    if !is_published {
        let what =
            format!("has no effect: {what} applies only to a broker, and there is no `[mqtt]`");
        table.warn(what, "leave it out", problems);
    }
    let polled: Vec<&str> = polled(model?).map(|it| it.name.as_str()).collect();
    let mut values = Vec::new();
    for (name, written) in &table.value {
        if polled.contains(&name.as_str()) {
            values.push((name.clone(), written.value));
            continue;
        }
        let what = format!("has no effect: no register `{name}` is polled");
        let right = match nearest(name, polled.iter().copied()) {
            Some(near) => format!("`{near}`"),
            None => format!("one of {}", polled.join(", ")),
        };
        written.warn(what, right, problems);
    }
    Some(values)
}

fn polled(model: &Model) -> impl Iterator<Item = &Register> {
    model.registers.iter().filter(|it| it.poll.is_some())
}

/// The names of registers that would get more decimals than they have, which would only look precise.
fn too_fine<'t>(
    table: &'t [(String, LocatedValue<u8>)],
    model: &Model,
    problems: &mut Vec<Problem>,
) -> Vec<&'t str> {
    let mut left_out = Vec::new();
    for (name, written) in table {
        let register = polled(model).find(|it| it.name == *name);
        let Some(most) = register.map(Register::digits) else {
            continue;
        };
        if written.value > most {
            let what = format!("has no effect: `{name}` is not finer than {most} decimals");
            let right = match most {
                0 => "leave it out".to_owned(),
                most => format!("0 to {most}"),
            };
            written.warn(what, right, problems);
            left_out.push(name.as_str());
        }
    }
    left_out
}

/// Tables without effect, because their topics are not published.
pub(super) fn idle(file: &ConfigFile, problems: &mut Vec<Problem>) {
    let Some(mqtt) = file.mqtt.valid().map(|mqtt| &mqtt.value) else {
        return;
    };
    let Some(publish) = mqtt.published() else {
        return;
    };
    let has_values = publish.contains(&TopicTree::Values);
    let is_any_shown =
        has_values || publish.contains(&TopicTree::State) || mqtt.keep_telemetry() != Some(0);
    for drive in file.drives() {
        for (location, is_used) in [
            (drive.dead_bands.location(), is_any_shown),
            (drive.decimals.location(), is_any_shown),
            (drive.heartbeats.location(), has_values),
        ] {
            if let (Some(location), false) = (location, is_used) {
                let what =
                    "has no effect: it is about topics that `publish` in `[mqtt]` leaves out";
                let right = "leave it out, or add \"values\" there";
                location.warn(what, right, problems);
            }
        }
    }
}
