//! The documents of `vfd-gateway qualify`: what is unproven at a drive, what was found, and what the drive does.

use super::body::TrialOrder;
use super::{GatewayTrials, READ_WITHIN, frames};
use crate::config::qualified::{QualifiedFact, QualifiedStanding};
use crate::config::{is_tried, is_unproven};
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::host::clock;
use crate::domain::command::{Direction, Report};
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::link::Framing;
use crate::domain::units::UnitOfMeasure;
use crate::domain::version::PROGRAM_VERSION;
use crate::north::api::{TrialActionDocument, TrialDocument, TrialFrame, TrialStateDocument};
use crate::north::shown::{presence, run_state};
use crate::profile::model::{BasicFact, Model, OrderKind, RegisterRole};
use std::collections::BTreeMap;

/// The name of the register that holds the version of the drive's firmware, where a model has one.
const FIRMWARE: &str = "firmware";

/// Everything about the trials of `drive`. The identity and the firmware are read from the drive.
pub(super) async fn all(trials: &GatewayTrials, drive: &SharedDrive) -> TrialDocument {
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
    let shown = TrialDocument {
        drive: description.name.to_string().into(),
        line: description.line.to_string().into(),
        model: model.id.clone().into(),
        model_digest: Some(format!("{:016x}", model.digest)),
        version: Some(PROGRAM_VERSION.to_owned()),
        identity: as_it_is
            .as_ref()
            .ok()
            .and_then(|it| it.identity)
            .map(|(_, word)| word),
        not_identified: as_it_is.as_ref().err().map(Report::message),
        firmware: firmware(trials, drive).await,
        damaged,
        controlled: control.is_some(),
        qualify: control.is_some_and(|control| control.qualify),
        actions: actions
            .map(|it| action(*it, model, control, facts, void.is_none()))
            .collect(),
        void,
        state: state(drive),
        ..TrialDocument::default()
    };
    match control {
        None => shown,
        Some(control) => TrialDocument {
            orders: Some(orders(trials, drive, control)),
            setpoint_hz: Some(frames::trial_frequency(control).as_f64()),
            lost_after_ms: Some(u64::try_from(control.lost_after.as_millis()).unwrap_or(u64::MAX)),
            on_commander_lost: Some(control.on_commander_lost.keyword().to_owned()),
            may_reverse: Some(control.directions.contains(&Direction::Reverse)),
            may_go_forward: Some(control.directions.contains(&Direction::Forward)),
            may_release: Some(control.allow_release),
            ..shown
        },
    }
}

/// The frames of each order that the model has.
fn orders(
    trials: &GatewayTrials,
    drive: &SharedDrive,
    control: &ControlSettings,
) -> BTreeMap<String, Vec<TrialFrame>> {
    let description = &drive.description;
    let framing = trials
        .side
        .shared()
        .line(description.place)
        .map_or(Framing::Rtu, |line| line.wiring.framing);
    let Some(station) = trials.station(description.place) else {
        return BTreeMap::new();
    };
    let mut orders = BTreeMap::new();
    for order in OrderKind::ALL {
        let frames = frames::order_frames(
            TrialOrder::Sent(order),
            &description.model,
            control,
            (station, framing),
        );
        if !frames.is_empty() {
            orders.insert(order.keyword().to_owned(), frames);
        }
    }
    orders
}

/// An action that is tried: what it rests on, and what was found.
fn action(
    action: ControlAction,
    model: &Model,
    control: Option<&ControlSettings>,
    facts: &[QualifiedFact],
    counts: bool,
) -> TrialActionDocument {
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
    TrialActionDocument {
        action: action.keyword().into(),
        rests_on,
        listed: is_in_force && !is_site,
        in_force: is_in_force || is_proven,
        proven: is_proven,
        result: found.map(|it| it.result.keyword().to_owned()),
        by: found.map(|it| it.by.clone()),
        at: found.map(|it| it.at.clone()),
        counts: found.is_some() && counts,
    }
}

/// What the drive does, and how old that is.
pub(super) fn state(drive: &SharedDrive) -> TrialStateDocument {
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
    TrialStateDocument {
        presence: presence(&view).into(),
        run_state: Some(run_state(&view).keyword().to_owned()),
        output_hz: hertz,
        age_ms: reading.map(|it| u64::try_from(now.since(it.at).as_millis()).unwrap_or(u64::MAX)),
        tripped: view.trip.active,
        local: view.status.is_local(),
        stop_pending: control.is_some_and(|control| control.stop_pending),
        epoch: control.map(|control| control.epoch),
    }
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
