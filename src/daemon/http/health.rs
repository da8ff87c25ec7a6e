//! The state of the gateway as JSON: for `/readyz` and for `vfd-gateway health`.

use super::state::HttpState;
use crate::daemon::exchange::shared::{SharedDrive, SharedLine};
use crate::daemon::host::clock;
use crate::domain::report::{LineReport, LineState};
use crate::domain::time::MonoTime;
use crate::domain::version::PROGRAM_VERSION;
use crate::drive::plan::RefusedRegister;
use crate::north::api::{
    BrokerHealthDocument, DriveHealthDocument, HealthDocument, HostHealthDocument,
    JournalHealthDocument, LineHealthDocument, OversizedDocument, ReadinessDocument,
    RefusedRegisterDocument, SocketHealthDocument,
};
use crate::north::broker::OversizedPublication;
use crate::north::clock::LabelClock;
use crate::north::shown::{self, presence, run_state, warning_text};
use crate::north::titles::PlantTitles;
use crate::profile::model::Model;

/// Why the gateway is ready or not: each line and the broker.
pub(super) fn readiness(state: &HttpState) -> ReadinessDocument {
    ReadinessDocument {
        ready: state.is_ready(),
        lines: lines(state),
        mqtt: mqtt(state),
        sparkplug: sparkplug(state),
    }
}

/// Everything that `vfd-gateway health` shows.
pub(super) fn health(state: &HttpState, now: MonoTime) -> HealthDocument {
    let shared = state.shared.load();
    HealthDocument {
        gateway: state.gateway.to_string().into(),
        version: PROGRAM_VERSION.into(),
        uptime_seconds: now.since(state.started).as_secs(),
        ready: state.is_ready(),
        lines: lines(state),
        drives: shared.drives.iter().map(|it| drive(it, now)).collect(),
        mqtt: mqtt(state),
        sparkplug: sparkplug(state),
        journal: journal(state),
        socket: socket(state),
        titles: PlantTitles::clone(&shared.titles),
    }
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

fn lines(state: &HttpState) -> Vec<LineHealthDocument> {
    let shared = state.shared.load();
    shared.lines.iter().map(|it| line(it)).collect()
}

fn line(line: &SharedLine) -> LineHealthDocument {
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
    let pair = line.standby.as_ref().map(|it| &it.pair);
    LineHealthDocument {
        name: line.name.to_string().into(),
        state: state.into(),
        reason,
        suspicion: suspicion.map(|suspicion| suspicion.to_string()),
        standby: shown::standby(standby.as_ref(), pair),
    }
}

fn drive(drive: &SharedDrive, now: MonoTime) -> DriveHealthDocument {
    let description = &drive.description;
    let view = drive.view.load();
    let control = view.control.as_ref();
    let clock = LabelClock::new(clock::moment());
    let undocumented = view.status.undocumented;
    let refused_registers = view.refused.iter();
    let site = description.control.as_ref().map(|it| shown::site(it));
    DriveHealthDocument {
        name: description.name.to_string().into(),
        line: description.line.to_string().into(),
        model: description.model.id.clone().into(),
        unit: description.unit.get(),
        uniform_unit: description.uniform_unit.get(),
        presence: presence(&view).into(),
        was_read: Some(view.snapshot.has_readings()),
        run_state: run_state(&view).keyword().into(),
        may_still_run: view.sight.may_still_run,
        last_seen: shown::last_seen(&view, &clock),
        failsafe: shown::fail_safe(control, &clock),
        output_outside: control.map(|control| control.output_outside),
        stopped_elsewhere: control.map(|control| control.stopped_elsewhere),
        warning: warning_text(description, &view, now),
        undocumented_state: undocumented.map(|it| format!("{} holds {}", it.address, it.word)),
        refused: refused_registers
            .map(|it| refused(&description.model, it))
            .collect(),
        watchdog: view.watchdog.map(|it| it.state.keyword().to_owned()),
        site: site.map(|words| words.into_iter().map(str::to_owned).collect()),
    }
}

/// A register that the drive refuses to show.
fn refused(model: &Model, refused: &RefusedRegister) -> RefusedRegisterDocument {
    let register = model.register_at(refused.address);
    RefusedRegisterDocument {
        register: refused.address.to_string().into(),
        name: register.map(|register| register.name.clone()),
        code: refused.code,
        essential: model.is_essential(refused.address),
    }
}

fn mqtt(state: &HttpState) -> Option<BrokerHealthDocument> {
    let mqtt = state.mqtt.load();
    let mqtt = mqtt.as_ref()?;
    let counters = mqtt.counters();
    Some(BrokerHealthDocument {
        connected: mqtt.is_connected(),
        reason: mqtt.lost_reason(),
        contested: mqtt.is_contested(),
        partner_online: counters.partner_online,
        events_waiting: counters.events_waiting,
        events_refused: counters.events_refused,
        oversized: oversized(&mqtt.oversized()),
        clients_gone: mqtt.clients_gone(),
    })
}

fn sparkplug(state: &HttpState) -> Option<HostHealthDocument> {
    let sparkplug = state.sparkplug.load();
    let sparkplug = sparkplug.as_ref()?;
    let counters = sparkplug.counters();
    Some(HostHealthDocument {
        connected: sparkplug.is_connected(),
        reason: sparkplug.lost_reason(),
        contested: sparkplug.is_contested(),
        host_awaited: counters.host_awaited > 0,
        host_behind_ms: counters.host_behind_ms,
        oversized: oversized(&sparkplug.oversized()),
        history_waiting: counters.history_waiting,
    })
}

fn oversized(all: &[OversizedPublication]) -> Vec<OversizedDocument> {
    let one = |it: &OversizedPublication| OversizedDocument {
        topic: it.topic.clone().into(),
        bytes: it.bytes,
        limit: it.limit,
    };
    all.iter().map(one).collect()
}

fn socket(state: &HttpState) -> Option<SocketHealthDocument> {
    let reason = state.socket.as_ref()?.refusal();
    Some(SocketHealthDocument {
        state: if reason.is_none() { "ok" } else { "missing" }.into(),
        reason,
    })
}

fn journal(state: &HttpState) -> Option<JournalHealthDocument> {
    let report = state.journal.as_ref()?.report();
    Some(JournalHealthDocument {
        state: report.state.keyword().into(),
        reason: report.reason,
        moved_aside: report.moved_aside,
        replaced: report.replaced,
        rows: report.rows,
        lost: report.lost,
        attempts_lost: report.attempts_lost,
        waiting: report.waiting,
        size_bytes: report.size_bytes,
        commit_ms: report.commit_time.as_secs_f64() * 1000.0,
        commit_ms_max: report.commit_time_max.as_secs_f64() * 1000.0,
    })
}
