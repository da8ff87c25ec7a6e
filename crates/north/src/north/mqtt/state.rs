//! The `state` of a drive: everything that is known of it, in one retained JSON document.

use super::slot::{RenderContext, retained};
use crate::domain::command::Owner;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::snapshot::ValueReading;
use crate::drive::view::{ControlView, DriveView};
use crate::drive::warnings;
use crate::drive::watchdog::WatchdogView;
use crate::journal::trip;
use crate::journal::trip::unit;
use crate::north::broker::{Publication, Qos};
use crate::north::points::{PublishedPoints, control_flags, status_flags, with_flags};
use crate::north::shown;
use crate::profile::model::{Confidence, IndicatedState, Register};
use serde_json::{Map, Value, json};
use std::sync::Arc;
use std::time::Duration;

/// Shortest time between two publications of one drive's state: it is large, and what changes faster has topics of its
/// own.
const HOLD_OFF: Duration = Duration::from_millis(500);

/// The topic `state` of one drive.
#[derive(Debug)]
pub(super) struct StateSlot {
    topic: String,
    published: Option<PublishedState>,
    /// Something changed too soon after the last publication.
    is_held: bool,
}

/// What was published last.
#[derive(Debug)]
struct PublishedState {
    at: MonoTime,
    view: Arc<DriveView>,
}

impl StateSlot {
    pub(super) const fn new(topic: String) -> Self {
        Self {
            topic,
            published: None,
            is_held: false,
        }
    }

    pub(super) fn topic(&self) -> &str {
        &self.topic
    }

    pub(super) fn forget(&mut self) {
        self.published = None;
    }

    /// The publication of `view`, if one is due.
    pub(super) fn offer(
        &mut self,
        now: &RenderContext,
        drive: &DriveDescription,
        view: &Arc<DriveView>,
        points: &PublishedPoints,
    ) -> Option<Publication> {
        self.is_held = false;
        if let Some(last) = &self.published {
            let age = now.at.since(last.at);
            let has_changed = || has_changed(now, drive, last, view, points);
            if age < now.heartbeat && !has_changed() {
                return None;
            }
            self.is_held = age < HOLD_OFF;
            if self.is_held {
                return None;
            }
        }
        self.published = Some(PublishedState {
            at: now.at,
            view: view.clone(),
        });
        let payload = document(now, drive, view, points).to_string().into_bytes();
        Some(retained(now, self.topic.clone(), payload, Qos::AtMostOnce))
    }

    /// When it may be due although nothing changes.
    pub(super) fn due(&self, heartbeat: Duration) -> MonoTime {
        let Some(last) = &self.published else {
            return MonoTime::NEVER;
        };
        if self.is_held {
            return last.at + HOLD_OFF;
        }
        let lease = lease_until(&last.view).filter(|until| *until > last.at);
        lease.into_iter().fold(last.at + heartbeat, MonoTime::min)
    }
}

fn has_changed(
    now: &RenderContext,
    drive: &DriveDescription,
    last: &PublishedState,
    view: &DriveView,
    points: &PublishedPoints,
) -> bool {
    let old = last.view.as_ref();
    let has_value_changed = |(place, register): (usize, &Register)| {
        let was = shown::quality(drive, register, old, last.at);
        let values = (old.snapshot.value(register), view.snapshot.value(register));
        let has_moved =
            matches!(values, (Some(old), Some(new)) if points.differ(place, old.value, new.value));
        was != shown::quality(drive, register, view, now.at) || has_moved
    };
    let trip = |view: &DriveView| (view.trip.active, view.trip.seen);
    polled(drive).any(has_value_changed)
        || old.is_online() != view.is_online()
        || shown::answered_run_state(old) != shown::answered_run_state(view)
        || trip(old) != trip(view)
        || old.status != view.status
        || old.sight != view.sight
        || shown::drive_state(drive, old, last.at) != shown::drive_state(drive, view, now.at)
        || old.watchdog != view.watchdog
        || old.trip_kept != view.trip_kept
        || old.usage != view.usage
        || lasting(old) != lasting(view)
        || has_published_lease_ended(now, last, view)
}

/// Control without the end of the lease, which every heartbeat moves.
fn lasting(view: &DriveView) -> Option<(ControlView, Option<Owner>)> {
    let control = view.control.as_ref()?;
    Some((
        ControlView {
            lease: None,
            ..control.clone()
        },
        control.lease.map(|(owner, _)| owner),
    ))
}

fn lease_until(view: &DriveView) -> Option<MonoTime> {
    view.control.as_ref()?.lease.map(|(_, until)| until)
}

/// Whether the published end of the lease has passed and another one is valid.
fn has_published_lease_ended(now: &RenderContext, last: &PublishedState, view: &DriveView) -> bool {
    let old = lease_until(&last.view);
    let new = lease_until(view);
    old != new && old.is_some_and(|until| until <= now.at)
}

/// The polled registers with their places in the model.
fn polled(drive: &DriveDescription) -> impl Iterator<Item = (usize, &Register)> {
    drive
        .model
        .registers
        .iter()
        .enumerate()
        .filter(|(_, register)| register.poll.is_some())
}

fn document(
    now: &RenderContext,
    drive: &DriveDescription,
    view: &DriveView,
    points: &PublishedPoints,
) -> Value {
    let value = |(place, register): (usize, &Register)| {
        let number = |it: ValueReading| points.value(place, it.value);
        (
            register.name.clone(),
            value(now, drive, register, view, number),
        )
    };
    let values: Map<_, _> = polled(drive).map(value).collect();
    let document = json!({
        "at": now.clock.text(now.at),
        "online": view.is_online(),
        "run_state": shown::answered_run_state(view).keyword(),
        "run_state_confidence": run_state_confidence(drive),
        "may_still_run": view.sight.may_still_run,
        "last_seen": shown::last_seen(view, &now.clock),
        "failsafe": shown::fail_safe(view.control.as_ref(), &now.clock),
        "drive_state": shown::drive_state(drive, view, now.at),
        "watchdog": view.watchdog.as_ref().map(watchdog),
        "values": values,
        "trip": trip_state(now, drive, view),
        "warning": warning_state(now, drive, view),
        "control": view.control.as_ref().map(|it| control(now, view, it)),
        "usage": shown::usage(view),
        "capabilities": shown::capabilities(drive),
    });
    with_flags(document, status_flags(view))
}

fn watchdog(watchdog: &WatchdogView) -> Value {
    json!({
        "state": watchdog.state.keyword(),
        "seconds": watchdog.time.map(|time| time.as_secs_f64()),
        "proven": watchdog.is_proven,
    })
}

/// Without a status word it follows from the output frequency and from what was ordered here.
fn run_state_confidence(drive: &DriveDescription) -> &'static str {
    drive
        .model
        .status_flag(IndicatedState::Running)
        .map_or(Confidence::Inferred, |flag| flag.confidence)
        .keyword()
}

fn value(
    now: &RenderContext,
    drive: &DriveDescription,
    register: &Register,
    view: &DriveView,
    number: impl Fn(ValueReading) -> f64,
) -> Value {
    let reading = view.snapshot.value(register);
    json!({
        "value": reading.map(number),
        "unit": unit(register),
        "at": reading.map(|it| now.clock.text(it.at)),
        "quality": shown::quality(drive, register, view, now.at).keyword(),
    })
}

fn trip_state(now: &RenderContext, drive: &DriveDescription, view: &DriveView) -> Value {
    json!({
        "active": view.trip.active,
        "count": view.trip_kept.count,
        "seen": view.trip.seen,
        "total": view.trip_kept.total,
        "last": view.trip_kept.last.as_ref().map(|it| trip::record(drive, &|at| now.clock.text(at), it)),
    })
}

/// `null` for a drive that shows no warnings; its parts are `null` while they are not known.
fn warning_state(now: &RenderContext, drive: &DriveDescription, view: &DriveView) -> Value {
    if drive.model.warning_register().is_none() {
        return Value::Null;
    }
    let word = shown::warning(drive, view, now.at);
    json!({
        "active": word.map(|word| word != 0),
        "code": word.map(|word| warnings::code(&drive.model, word)),
        "text": word.and_then(|word| warnings::text(&drive.model, word)),
    })
}

fn control(now: &RenderContext, view: &DriveView, control: &ControlView) -> Value {
    let lease_until = control
        .lease
        .map(|(_, until)| until)
        .filter(|until| *until != MonoTime::NEVER);
    let document = json!({
        "owner": control.lease.map(|(owner, _)| owner.to_string()),
        "lease_until": lease_until.map(|until| now.clock.text(until)),
        "intent": shown::intent(control.intent),
        "setpoint_hz": control.setpoint.map(Hertz::as_f64),
        "epoch": control.epoch,
        "outcome": control.last.map(|report| report.outcome.keyword()),
        "reason": control.last.map(|report| report.reason.keyword()),
    });
    with_flags(document, control_flags(view))
}
