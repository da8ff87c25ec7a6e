//! The state of the gateway as JSON: for `/readyz` and for `vfd-gateway health`.

use super::state::HttpState;
use crate::daemon::exchange::shared::{SharedDrive, SharedLine};
use crate::daemon::host::clock;
use crate::domain::report::{LineReport, LineState};
use crate::domain::time::MonoTime;
use crate::domain::version::PROGRAM_VERSION;
use crate::drive::plan::RefusedRegister;
use crate::north::broker::OversizedPublication;
use crate::north::clock::LabelClock;
use crate::north::shown::{self, presence, run_state, warning_text};
use crate::profile::model::Model;
use serde_json::{Value, json};

/// Why the gateway is ready or not: each line and the broker.
pub(super) fn readiness(state: &HttpState) -> Value {
    json!({
        "ready": state.is_ready(),
        "lines": state.shared.load().lines.iter().map(|it| line(it)).collect::<Vec<_>>(),
        "mqtt": mqtt(state),
        "sparkplug": sparkplug(state),
    })
}

/// Everything that `vfd-gateway health` shows.
pub(super) fn health(state: &HttpState, now: MonoTime) -> Value {
    json!({
        "gateway": state.gateway,
        "version": PROGRAM_VERSION,
        "uptime_seconds": now.since(state.started).as_secs(),
        "ready": state.is_ready(),
        "lines": state.shared.load().lines.iter().map(|it| line(it)).collect::<Vec<_>>(),
        "drives": state.shared.load().drives.iter().map(|it| drive(it, now)).collect::<Vec<_>>(),
        "mqtt": mqtt(state),
        "sparkplug": sparkplug(state),
        "journal": journal(state),
        "socket": socket(state),
    })
}

/// The names of all lines.
pub(super) fn line_names(state: &HttpState) -> Vec<String> {
    state
        .shared
        .load()
        .lines
        .iter()
        .map(|line| line.name.to_string())
        .collect()
}

fn line(line: &SharedLine) -> Value {
    let report = line.report();
    let reason = report.down_reason();
    let LineReport {
        state,
        suspicion,
        standby,
        ..
    } = report;
    let state = match state {
        LineState::Up => "up",
        LineState::Down => "down",
    };
    json!({ "name": line.name.as_str(), "state": state, "reason": reason,
        "suspicion": suspicion.map(|suspicion| suspicion.to_string()),
        "standby": shown::standby(standby.as_ref(), line.standby.as_ref().map(|it| &it.pair)) })
}

fn drive(drive: &SharedDrive, now: MonoTime) -> Value {
    let description = &drive.description;
    let view = drive.view.load();
    json!({
        "name": description.name.as_str(),
        "line": description.line.as_str(),
        "model": description.model.id,
        "unit": description.unit.get(),
        "uniform_unit": description.uniform_unit.get(),
        "presence": presence(&view),
        "was_read": view.snapshot.has_readings(),
        "run_state": run_state(&view).keyword(),
        "may_still_run": view.sight.may_still_run,
        "last_seen": shown::last_seen(&view, &LabelClock::new(clock::moment())),
        "failsafe": shown::fail_safe(view.control.as_ref(), &LabelClock::new(clock::moment())),
        "output_outside": view.control.as_ref().map(|control| control.output_outside),
        "stopped_elsewhere": view.control.as_ref().map(|control| control.stopped_elsewhere),
        "warning": warning_text(description, &view, now),
        "undocumented_state": view.status.undocumented.map(|it| format!("{} holds {}", it.address, it.word)),
        "refused": view.refused.iter().map(|it| refused(&description.model, it)).collect::<Vec<_>>(),
        "watchdog": view.watchdog.map(|watchdog| watchdog.state.keyword()),
        "site": description.control.as_ref().map(|control| shown::site(control)),
    })
}

/// A register that the drive refuses to show.
fn refused(model: &Model, refused: &RefusedRegister) -> Value {
    json!({
        "register": refused.address.to_string(),
        "name": model.register_at(refused.address).map(|register| register.name.as_str()),
        "code": refused.code,
        "essential": model.is_essential(refused.address),
    })
}

fn mqtt(state: &HttpState) -> Value {
    state.mqtt.load().as_ref().map_or(Value::Null, |mqtt| {
        json!({
            "connected": mqtt.is_connected(),
            "reason": mqtt.lost_reason(),
            "contested": mqtt.is_contested(),
            "partner_online": mqtt.counters().partner_online,
            "events_waiting": mqtt.counters().events_waiting,
            "events_refused": mqtt.counters().events_refused,
            "oversized": oversized(&mqtt.oversized()),
            "clients_gone": mqtt.clients_gone(),
        })
    })
}

fn sparkplug(state: &HttpState) -> Value {
    state
        .sparkplug
        .load()
        .as_ref()
        .map_or(Value::Null, |sparkplug| {
            json!({
                "connected": sparkplug.is_connected(),
                "reason": sparkplug.lost_reason(),
                "contested": sparkplug.is_contested(),
                "host_awaited": sparkplug.counters().host_awaited > 0,
                "host_behind_ms": sparkplug.counters().host_behind_ms,
                "oversized": oversized(&sparkplug.oversized()),
                "history_waiting": sparkplug.counters().history_waiting,
            })
        })
}

fn oversized(all: &[OversizedPublication]) -> Vec<Value> {
    let one = |OversizedPublication {
                   topic,
                   bytes,
                   limit,
               }: &OversizedPublication| json!({ "topic": topic, "bytes": bytes, "limit": limit });
    all.iter().map(one).collect()
}

fn socket(state: &HttpState) -> Value {
    let Some(socket) = &state.socket else {
        return Value::Null;
    };
    let reason = socket.refusal();
    json!({ "state": if reason.is_none() { "ok" } else { "missing" }, "reason": reason })
}

fn journal(state: &HttpState) -> Value {
    let Some(journal) = &state.journal else {
        return Value::Null;
    };
    let report = journal.report();
    json!({
        "state": report.state.keyword(),
        "reason": report.reason,
        "moved_aside": report.moved_aside,
        "replaced": report.replaced,
        "rows": report.rows,
        "lost": report.lost,
        "attempts_lost": report.attempts_lost,
        "waiting": report.waiting,
        "size_bytes": report.size_bytes,
        "commit_ms": report.commit_time.as_secs_f64() * 1000.0,
        "commit_ms_max": report.commit_time_max.as_secs_f64() * 1000.0,
    })
}
