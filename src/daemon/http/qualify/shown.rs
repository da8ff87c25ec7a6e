//! The documents of `vfd-gateway qualify`: what is unproven at a drive, what was found, and what the drive does.

use super::body::TrialOrder;
use super::{GatewayTrials, READ_WITHIN, frames};
use crate::config::qualified::{QualifiedFact, QualifiedStanding};
use crate::config::{is_tried, is_unproven};
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::host::clock;
use crate::domain::command::Direction;
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::link::Framing;
use crate::domain::units::UnitOfMeasure;
use crate::domain::version::PROGRAM_VERSION;
use crate::north::shown::{presence, run_state};
use crate::profile::model::{BasicFact, Model, OrderKind, RegisterRole};
use serde_json::{Map, Value, json};

/// The name of the register that holds the version of the drive's firmware, where a model has one.
const FIRMWARE: &str = "firmware";

/// Everything about the trials of `drive`. The identity and the firmware are read from the drive.
pub(super) async fn all(trials: &GatewayTrials, drive: &SharedDrive) -> Value {
    let description = &drive.description;
    let model = &*description.model;
    let qualified = trials.qualified().await;
    let damaged = qualified.as_ref().err().cloned();
    let qualified = qualified.unwrap_or_default();
    let as_it_is = trials.drive_as_it_is(description).await;
    let standing = trials.standing(description, &qualified);
    let station = trials.station(description.place);
    let kept = station.and_then(|station| qualified.facts(description.line.as_str(), station));
    let is_another = as_it_is
        .as_ref()
        .is_ok_and(|now| kept.is_some_and(|(then, _)| now != then));
    let void = match &standing {
        QualifiedStanding::Void(_, why) => Some(why.to_string()),
        _ => is_another.then(|| "the drive itself is another one now".to_owned()),
    };
    let control = description.control.as_deref();
    let facts = kept.map_or(&[][..], |(_, facts)| facts);
    let actions = ControlAction::ALL.iter().filter(|it| is_tried(model, **it));
    let mut shown = json!({
        "drive": description.name.as_str(),
        "line": description.line.as_str(),
        "model": model.id,
        "model_digest": format!("{:016x}", model.digest),
        "version": PROGRAM_VERSION,
        "identity": as_it_is.as_ref().ok().and_then(|it| it.identity).map(|(_, word)| word),
        "not_identified": as_it_is.as_ref().err().map(|report| report.message()),
        "firmware": firmware(trials, drive).await,
        "void": void,
        "damaged": damaged,
        "controlled": control.is_some(),
        "qualify": control.is_some_and(|control| control.qualify),
        "actions": actions.map(|it| action(*it, model, control, facts, void.is_none())).collect::<Vec<_>>(),
        "state": state(drive),
    });
    if let Some(control) = control {
        let framing = trials
            .side
            .shared()
            .line(description.place)
            .map_or(Framing::Rtu, |line| line.wiring.framing);
        let at = station.zip(Some(framing));
        let orders = OrderKind::ALL.into_iter().filter_map(|order| {
            let frames = frames::order_frames(TrialOrder::Sent(order), model, control, at?);
            (!frames.is_empty()).then(|| (order.keyword().to_owned(), Value::from(frames)))
        });
        shown["orders"] = orders.collect::<Map<_, _>>().into();
        shown["setpoint_hz"] = frames::trial_frequency(control).as_f64().into();
        shown["lost_after_ms"] = u64::try_from(control.lost_after.as_millis())
            .unwrap_or(u64::MAX)
            .into();
        shown["on_commander_lost"] = control.on_commander_lost.keyword().into();
        shown["may_reverse"] = control.directions.contains(&Direction::Reverse).into();
        shown["may_go_forward"] = control.directions.contains(&Direction::Forward).into();
        shown["may_release"] = control.allow_release.into();
    }
    shown
}

/// An action that is tried: what it rests on, and what was found.
fn action(
    action: ControlAction,
    model: &Model,
    control: Option<&ControlSettings>,
    facts: &[QualifiedFact],
    counts: bool,
) -> Value {
    let is_proven = !is_unproven(model, action);
    let rests_on = match action {
        ControlAction::Basic if is_proven => {
            model.basics().iter().map(BasicFact::described).collect()
        }
        ControlAction::Basic => model
            .unproven_basics()
            .iter()
            .map(BasicFact::described)
            .collect(),
        action => {
            let fact = model.run.as_ref().and_then(|run| run.action(action));
            fact.map(|fact| format!("{} ({})", action.keyword(), fact.confidence.keyword()))
                .into_iter()
                .collect::<Vec<_>>()
        }
    };
    let is_in_force = control.is_some_and(|control| control.accept_unverified.contains(&action));
    let is_site = control.is_some_and(|control| control.site.actions.contains(&action));
    let found = facts.iter().find(|it| it.action == action);
    json!({
        "action": action.keyword(),
        "rests_on": rests_on,
        "listed": is_in_force && !is_site,
        "in_force": is_in_force || is_proven,
        "proven": is_proven,
        "result": found.map(|it| it.result.keyword()),
        "by": found.map(|it| it.by.as_str()),
        "at": found.map(|it| it.at.as_str()),
        "counts": found.is_some() && counts,
    })
}

/// What the drive does, and how old that is.
pub(super) fn state(drive: &SharedDrive) -> Value {
    let view = drive.view.load();
    let now = clock::now();
    let output = drive
        .description
        .model
        .register_for(RegisterRole::OutputFrequency);
    let reading = output.and_then(|register| view.snapshot.value(register));
    let hertz = match (output, reading) {
        (Some(output), Some(reading)) if output.unit == UnitOfMeasure::Hertz => {
            Some(reading.value.value())
        }
        _ => None,
    };
    let control = view.control.as_ref();
    json!({
        "presence": presence(&view),
        "run_state": run_state(&view).keyword(),
        "output_hz": hertz,
        "age_ms": reading.map(|it| u64::try_from(now.since(it.at).as_millis()).unwrap_or(u64::MAX)),
        "tripped": view.trip.active,
        "local": view.status.is_local(),
        "stop_pending": control.is_some_and(|control| control.stop_pending),
        "epoch": control.map(|control| control.epoch),
    })
}

async fn firmware(trials: &GatewayTrials, drive: &SharedDrive) -> Option<u16> {
    let register = drive
        .description
        .model
        .registers
        .iter()
        .find(|it| it.name == FIRMWARE && it.access.can_read())?;
    trials
        .side
        .read(
            drive.description.place,
            register.address,
            clock::now() + READ_WITHIN,
        )
        .await
        .ok()
}
