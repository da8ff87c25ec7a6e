//! Publication of a drive's polled registers over MQTT: dead bands, heartbeats and decimals.

use super::file::{ConfigFile, DriveFile};
use super::mqtt;
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
    let dead_bands = read_point_table(
        &drive.dead_bands,
        "a dead band",
        model,
        is_published,
        problems,
    );
    let heartbeats = read_point_table(
        &drive.heartbeats,
        "a heartbeat",
        model,
        is_published,
        problems,
    );
    let decimals = read_point_table(
        &drive.decimals,
        "the count of decimals",
        model,
        is_published,
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
fn read_point_table<T: Copy>(
    given: &OptionalKey<Vec<(String, LocatedValue<T>)>>,
    what: &str,
    model: Option<&Model>,
    is_published: bool,
    problems: &mut Vec<Problem>,
) -> Option<Vec<(String, T)>> {
    let LocatedValue {
        value: table,
        location,
    } = match given {
        OptionalKey::Absent => return Some(Vec::new()),
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(table) => table,
    };
    if !is_published {
        let problem = location.problem(format!(
            "has no effect: {what} applies only to a broker, and there is no `[mqtt]`"
        ));
        problems.push(problem.right("leave it out").warning());
    }
    let polled: Vec<&str> = polled(model?).map(|it| it.name.as_str()).collect();
    for (name, written) in table
        .iter()
        .filter(|(name, _)| !polled.contains(&name.as_str()))
    {
        let problem = written
            .location
            .problem(format!("has no effect: no register `{name}` is polled"))
            .warning();
        problems.push(match nearest(name, polled.iter().copied()) {
            Some(near) => problem.right(format!("`{near}`")),
            None => problem.right(format!("one of {}", polled.join(", "))),
        });
    }
    let of_polled = table
        .iter()
        .filter(|(name, _)| polled.contains(&name.as_str()));
    Some(
        of_polled
            .map(|(name, written)| (name.clone(), written.value))
            .collect(),
    )
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
        let Some(most) = register
            .map(Register::digits)
            .filter(|most| written.value > *most)
        else {
            continue;
        };
        let problem = written.location.problem(format!(
            "has no effect: `{name}` is not finer than {most} decimals"
        ));
        let right = if most == 0 {
            "leave it out".to_owned()
        } else {
            format!("0 to {most}")
        };
        problems.push(problem.right(right).warning());
        left_out.push(name.as_str());
    }
    left_out
}

/// Tables without effect, because their topics are not published.
pub(super) fn idle(file: &ConfigFile, problems: &mut Vec<Problem>) {
    let Some(written) = file.mqtt.valid().map(|written| &written.value) else {
        return;
    };
    let Some(publish) = mqtt::publish(written) else {
        return;
    };
    let has_values = publish.contains(&TopicTree::Values);
    let is_any_shown =
        has_values || publish.contains(&TopicTree::State) || written.keep_telemetry() != Some(0);
    for drive in file.lines.iter().flat_map(|line| &line.drives) {
        let tables = [
            (
                drive.dead_bands.valid().map(|it| &it.location),
                is_any_shown,
            ),
            (drive.decimals.valid().map(|it| &it.location), is_any_shown),
            (drive.heartbeats.valid().map(|it| &it.location), has_values),
        ];
        for location in tables
            .into_iter()
            .filter(|(_, is_used)| !is_used)
            .filter_map(|(location, _)| location)
        {
            let problem = location
                .problem("has no effect: it is about topics that `publish` in `[mqtt]` leaves out");
            problems.push(
                problem
                    .right("leave it out, or add \"values\" there")
                    .warning(),
            );
        }
    }
}
