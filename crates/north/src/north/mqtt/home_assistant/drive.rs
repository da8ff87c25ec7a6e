//! What a drive shows in Home Assistant: a sensor for each topic with a value, and more from its state.

use super::entity::{DiscoveryEntity, EntityComponent, EntityNeeds, json_at, title};
use super::{combined, control};
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::drive::usage::UsagePart;
use crate::north::mqtt::topics::MqttTopics;
use crate::north::mqtt::types::CombinedEntity;
use crate::north::points::{
    DrivePoint, FLAGS, FlagGroup, FlagLook, PlainPoint, PointLook, RATED_DIGITS, points_of,
};
use crate::profile::model::{Model, Register, RegisterRole};

const RUN_STATES: [&str; 7] = [
    "unknown", "stopped", "forward", "reverse", "running", "stopping", "tripped",
];
pub(super) const RUNNING: &str = "{{ None if value in ('', 'unknown') else value in ('forward', 'reverse', 'running', 'stopping') }}";
const WATCHDOG: &str = "{% set dog = value_json.watchdog if value else None %}\
                        {{ None if not dog or dog.state == 'unknown' else dog.state != 'in_order' }}";
/// What was last seen of a drive that is out of sight.
const LAST_SEEN: &str = "{% set seen = value_json.last_seen if value else None %}\
                         {{ 'unknown' if not value else 'in sight' if value_json.online else 'nothing' if not seen \
                         else seen.run_state ~ (' ' ~ seen.output_hz ~ ' Hz' if seen.output_hz is not none else '') ~ ', ' ~ seen.at }}";
/// A topic that is cleared while control has no owner could not say so to later subscribers.
const OWNER: &str = "{{ (value_json.control.owner or 'nobody') if value else 'unknown' }}";
const TRIP_EVENT: &str = "{{ dict(value_json, event_type=value_json.kind) | to_json }}";

/// The entities of `drive`, in the order in which they are announced.
pub(super) fn entities(
    topics: &MqttTopics,
    drive: &DriveDescription,
    combined: &[CombinedEntity],
) -> Vec<DiscoveryEntity> {
    let topic = |rest: &str| topics.drive(drive.name.as_str(), rest);
    let mut entities = vec![connected(topic("availability"))];
    for (point, rest) in points_of(drive) {
        entities.extend(shown(drive, point, &rest, topic(&rest)));
    }
    entities.extend(state_entities(drive, &topic("state")));
    if drive.model.trip_register().is_some() {
        let event =
            DiscoveryEntity::new(EntityComponent::Event, "trip", "Trip", EntityNeeds::Drive);
        let event = event
            .made_of(topic("trip/event"), TRIP_EVENT)
            .icon("mdi:alert-octagon");
        entities.push(
            event
                .with("event_types", vec!["tripped", "cleared"])
                .with("qos", 1),
        );
    }
    entities.extend(control::entities(topics, drive));
    entities.extend(combined::entities(topics, drive, combined));
    entities
}

fn connected(topic: String) -> DiscoveryEntity {
    let entity = DiscoveryEntity::new(
        EntityComponent::BinarySensor,
        "connected",
        "Connected",
        EntityNeeds::Gateway,
    );
    entity
        .showing(topic)
        .words("online", "offline")
        .class("connectivity")
        .diagnostic()
}

/// The content of the topic that shows `point`.
fn shown(
    drive: &DriveDescription,
    point: DrivePoint,
    rest: &str,
    topic: String,
) -> Vec<DiscoveryEntity> {
    let entity = match point {
        DrivePoint::RunState => return run_state(&topic).into(),
        DrivePoint::Polled(place) => drive
            .model
            .registers
            .get(place)
            .map(|it| measured(drive, it, rest, topic)),
        DrivePoint::Rated(_) => point
            .unit(drive)
            .map(|unit| value(rest, topic, unit, Some(RATED_DIGITS.into()))),
        DrivePoint::Setpoint => Some(value(rest, topic, UnitOfMeasure::Hertz, None)),
        DrivePoint::Plain(point) => plain(&drive.model, point, topic),
        DrivePoint::Usage(part) => Some(used(part, topic)),
        // A parameter is read by those who know it.
        DrivePoint::Availability | DrivePoint::Param(_) => None,
    };
    entity.into_iter().collect()
}

/// What a row of the table of points says of its entity.
fn plain(model: &Model, point: &PlainPoint, topic: String) -> Option<DiscoveryEntity> {
    let shown = point.entity.as_ref()?;
    point.rests_on(model)?;
    let entity =
        |component| DiscoveryEntity::new(component, shown.key, shown.title, EntityNeeds::Drive);
    let problem = |topic| {
        let entity = entity(EntityComponent::BinarySensor).showing(topic);
        entity.words("true", "false").class("problem")
    };
    let sensor = || entity(EntityComponent::Sensor).diagnostic();
    Some(match shown.look {
        PointLook::Problem => problem(topic),
        PointLook::Notice => problem(topic).diagnostic(),
        PointLook::Text => sensor().showing_text(topic),
        PointLook::TripCount => {
            model.register_for(RegisterRole::TripCount)?;
            let count = sensor().showing(topic);
            count.with("state_class", "total_increasing")
        }
    })
}

/// A sum of what the drive has used. It is known while the drive is off, too.
fn used(part: UsagePart, topic: String) -> DiscoveryEntity {
    let (name, decimals, icon) = match part {
        UsagePart::Energy => ("Energy used", Some(2), None),
        UsagePart::RunningHours => ("Running hours", Some(1), None),
        UsagePart::Starts => ("Starts", None, Some("mdi:counter")),
        UsagePart::Trips => ("Trips in total", None, Some("mdi:counter")),
    };
    let entity = DiscoveryEntity::new(
        EntityComponent::Sensor,
        format!("usage_{}", part.keyword()),
        name,
        EntityNeeds::Gateway,
    );
    let entity = entity
        .showing(topic)
        .measured_in(part.unit(), decimals)
        .with("state_class", "total_increasing");
    icon.map_or(entity.clone(), |icon| entity.icon(icon))
}

fn run_state(topic: &str) -> [DiscoveryEntity; 2] {
    let state = DiscoveryEntity::new(
        EntityComponent::Sensor,
        "run_state",
        "Run state",
        EntityNeeds::Drive,
    );
    let running = DiscoveryEntity::new(
        EntityComponent::BinarySensor,
        "running",
        "Running",
        EntityNeeds::Drive,
    );
    [
        state
            .showing_text(topic.to_owned())
            .class("enum")
            .with("options", RUN_STATES.to_vec())
            .icon("mdi:engine"),
        running
            .made_of(topic.to_owned(), RUNNING)
            .words("True", "False")
            .class("running"),
    ]
}

/// A polled register. One that holds codes or bits is for experts.
fn measured(
    drive: &DriveDescription,
    register: &Register,
    rest: &str,
    topic: String,
) -> DiscoveryEntity {
    let digits = register.scale.ilog10();
    let is_decimal =
        10_u32.checked_pow(digits) == Some(register.scale) || !register.form.is_plain();
    let exact = is_decimal.then(|| u32::from(register.digits()));
    let decimals = drive.points.decimals_of(register).map(u32::from).or(exact);
    let entity = value(rest, topic, register.unit, decimals);
    match register.role {
        Some(RegisterRole::RunHours) => entity.with("state_class", "total_increasing"),
        _ if counts_energy(register.unit) => entity.with("state_class", "total_increasing"),
        _ if register.name.starts_with("rated_") => entity.diagnostic(),
        _ => entity,
    }
}

/// Whether the unit is that of a meter, which only rises, or is set back to 0.
const fn counts_energy(unit: UnitOfMeasure) -> bool {
    matches!(
        unit,
        UnitOfMeasure::KilowattHour | UnitOfMeasure::MegawattHour
    )
}

/// A value on the topic `rest` below the drive's.
fn value(rest: &str, topic: String, unit: UnitOfMeasure, decimals: Option<u32>) -> DiscoveryEntity {
    let (key, name) = match rest {
        "frequency/output" => ("output_frequency".to_owned(), "Output frequency".to_owned()),
        "frequency/setpoint" => ("setpoint".to_owned(), "Setpoint".to_owned()),
        rest => {
            let name = rest.rsplit('/').next().unwrap_or(rest);
            (format!("measure_{name}"), title(name))
        }
    };
    let entity = DiscoveryEntity::new(EntityComponent::Sensor, key, name, EntityNeeds::Drive);
    match unit {
        UnitOfMeasure::None => entity
            .showing_text(topic)
            .diagnostic()
            .with("enabled_by_default", false),
        unit => entity
            .showing(topic)
            .measured_in(unit, decimals)
            .with("state_class", "measurement"),
    }
}

/// What only the drive's JSON document shows.
fn state_entities(drive: &DriveDescription, topic: &str) -> Vec<DiscoveryEntity> {
    // It is about a drive that is not there.
    let unseen = DiscoveryEntity::new(
        EntityComponent::BinarySensor,
        "may_still_run",
        "May still run",
        EntityNeeds::Gateway,
    );
    let unseen = unseen
        .made_of(topic.to_owned(), json_at("may_still_run"))
        .words("True", "False");
    let last_seen = DiscoveryEntity::new(
        EntityComponent::Sensor,
        "last_seen",
        "Last seen",
        EntityNeeds::Gateway,
    );
    let mut entities = vec![
        unseen.class("problem"),
        last_seen
            .made_of(topic.to_owned(), LAST_SEEN)
            .diagnostic()
            .icon("mdi:eye-off"),
    ];
    let sensor = |key: &str, name: &str, template: String| {
        let entity =
            DiscoveryEntity::new(EntityComponent::BinarySensor, key, name, EntityNeeds::Drive);
        entity
            .made_of(topic.to_owned(), template)
            .words("True", "False")
            .diagnostic()
    };
    let flags = |group, path: &'static str| {
        let flags = FLAGS
            .iter()
            .filter(move |it| it.group == group && it.is_of(drive));
        flags.filter_map(move |flag| {
            let (look, title) = flag.entity?;
            let entity = sensor(flag.key, title, json_at(&format!("{path}{}", flag.key)));
            Some(match look {
                FlagLook::Plain => entity,
                FlagLook::Problem => entity.class("problem"),
            })
        })
    };
    entities.extend(flags(FlagGroup::Status, ""));
    if drive.model.watchdog.is_some() {
        entities.push(
            sensor("watchdog", "Watchdog of the drive", WATCHDOG.to_owned()).class("problem"),
        );
    }
    entities.extend(flags(FlagGroup::Control, "control."));
    if drive.control.is_some() {
        let owner = DiscoveryEntity::new(
            EntityComponent::Sensor,
            "owner",
            "Control held by",
            EntityNeeds::Drive,
        );
        entities.push(
            owner
                .made_of(topic.to_owned(), OWNER)
                .diagnostic()
                .icon("mdi:account-key"),
        );
    }
    entities
}
