//! The uniform words that are made of bits, and which of their bits a model can report.

use super::super::taken::RequestContext;
use super::MeasurementSources;
use crate::domain::command::Direction;
use crate::domain::control::{ControlAction, ControlSettings};
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{DriveView, RunState};
use crate::north::points::{FLAGS, alarm};
use crate::profile::model::{IndicatedState, Model, RegisterRole};

/// Status bits: uniform word 1 and the discrete inputs with the same numbers.
pub mod bit {
    /// The line is up and the drive answers.
    pub const ONLINE: u16 = 1;
    /// The output is known to be active.
    pub const RUNNING: u16 = 1 << 1;
    /// The drive runs in reverse.
    pub const REVERSE: u16 = 1 << 2;
    /// A trip is active.
    pub const TRIPPED: u16 = 1 << 3;
    /// The drive runs, and the output frequency, which is fresh, is within 0.1 Hz of the ordered setpoint; without an order to run, of
    /// the drive's own setting.
    pub const AT_SETPOINT: u16 = 1 << 4;
    /// The drive is online, has a control section, is not known to obey another source, and this gateway may send.
    pub const ACCEPTS: u16 = 1 << 5;
    /// A command is under way, or a stop is not effective yet.
    pub const PENDING: u16 = 1 << 6;
    /// A client holds control.
    pub const LEASED: u16 = 1 << 7;
    /// A polled value is stale, or none was read yet.
    pub const STALE: u16 = 1 << 8;
    /// RUN is refused until stop and then run are commanded again.
    pub const INHIBITED: u16 = 1 << 9;
    /// Panel or terminals give the run commands or the frequency.
    pub const LOCAL: u16 = 1 << 10;
    /// The drive itself reports an alarm.
    pub const ALARM: u16 = 1 << 11;
    /// The drive shows a warning, by its number or a bit.
    pub const WARNING: u16 = 1 << 12;
    /// This gateway only listens on the drive's line: another one is active, or may be.
    pub const STANDBY: u16 = 1 << 13;
}

/// Capability bits: uniform word 26.
pub mod capability {
    /// RUN forward.
    pub const FORWARD: u16 = 1;
    /// RUN reverse.
    pub const REVERSE: u16 = 1 << 1;
    /// COAST.
    pub const COAST: u16 = 1 << 2;
    /// RESET.
    pub const RESET: u16 = 1 << 3;
    /// A setpoint.
    pub const SETPOINT: u16 = 1 << 4;
    /// RELEASE.
    pub const RELEASE: u16 = 1 << 5;
    /// TAKE.
    pub const TAKE: u16 = 1 << 6;
}

/// The run state of the drive. It is unknown for a drive that is out of reach.
pub(super) fn run_state(view: &DriveView) -> RunState {
    if !view.line_is_up || view.snapshot.presence == DrivePresence::Offline {
        RunState::Offline
    } else {
        view.run_state
    }
}

/// Whether a trip is active; `None` while that is unknown.
pub(super) fn is_tripped(view: &DriveView) -> Option<bool> {
    if run_state(view) == RunState::Tripped {
        Some(true)
    } else {
        view.trip.active
    }
}

/// Uniform word 1.
pub(super) fn status(
    sources: &MeasurementSources,
    view: &DriveView,
    present: &RequestContext,
) -> u16 {
    let now = present.now;
    let listens = present.standby == Some(LineRole::Listening);
    let state = run_state(view);
    let control = if sources.has_control {
        view.control.as_ref()
    } else {
        None
    };
    let is_local = view.is_online() && view.status.is_local() == Some(true);
    let is_leased = control
        .and_then(|control| control.lease)
        .is_some_and(|(_, until)| now < until);
    [
        (view.is_online(), bit::ONLINE),
        (state.is_running(), bit::RUNNING),
        (state == RunState::Reverse, bit::REVERSE),
        (is_tripped(view) == Some(true), bit::TRIPPED),
        (
            state.is_running() && sources.is_at_setpoint(view, now),
            bit::AT_SETPOINT,
        ),
        (
            view.is_online() && sources.has_control && !is_local && !listens,
            bit::ACCEPTS,
        ),
        (
            control.is_some_and(|control| control.command_pending || control.stop_pending),
            bit::PENDING,
        ),
        (is_leased, bit::LEASED),
        (sources.is_stale(view, now), bit::STALE),
        (
            control.is_some_and(|control| control.start_inhibited),
            bit::INHIBITED,
        ),
        (is_local, bit::LOCAL),
        (
            view.is_online() && view.status.alarm == Some(true),
            bit::ALARM,
        ),
        (view.is_online() && sources.warns(view, now), bit::WARNING),
        (listens, bit::STANDBY),
    ]
    .into_iter()
    .filter_map(|(is_set, bit)| is_set.then_some(bit))
    .sum()
}

/// Uniform word 17.
pub(super) fn alarms(sources: &MeasurementSources, view: &DriveView, now: MonoTime) -> u16 {
    let flags = FLAGS.iter().filter(|flag| (flag.read)(view) == Some(true));
    let stale = if sources.is_stale(view, now) {
        alarm::STALE
    } else {
        0
    };
    let down = if view.line_is_up { 0 } else { alarm::LINE_DOWN };
    flags.map(|flag| flag.alarm).sum::<u16>() | stale | down
}

/// Uniform word 15: the status bits that can ever be set for this drive.
///
/// Online always; stale if anything is polled; running if the output frequency or a status word is; at setpoint if the
/// setting is as well or setpoints are ordered; tripped if the trips are shown or counted; local and alarm if a status word shows them; warning
/// if a polled register does; standby on a line with several gateways (added when it is read); reverse if a status word shows it, or the drive has control and its model can run in reverse, because then it is known from
/// what was ordered; and with control accepts, pending, leased and inhibited.
pub(super) fn reported(drive: &DriveDescription, sources: &MeasurementSources) -> u16 {
    let has_flag = |flag| drive.model.status_flag(flag).is_some();
    let has_reverse = sources.has_control
        && drive
            .model
            .run
            .as_ref()
            .is_some_and(|run| run.reverse.is_some());
    let measures = |role| sources.measurement(role).is_some();
    let shows_output = measures(RegisterRole::OutputFrequency);
    let turns = shows_output || has_flag(IndicatedState::Running);
    let with_control = bit::ACCEPTS | bit::PENDING | bit::LEASED | bit::INHIBITED;
    [
        (true, bit::ONLINE),
        (turns, bit::RUNNING),
        (
            has_reverse || has_flag(IndicatedState::Reverse),
            bit::REVERSE,
        ),
        (sources.has_trips, bit::TRIPPED),
        (
            shows_output && (measures(RegisterRole::FrequencySetting) || sources.has_control),
            bit::AT_SETPOINT,
        ),
        (sources.has_control, with_control),
        (!sources.polled.is_empty(), bit::STALE),
        (
            has_flag(IndicatedState::BusRun) || has_flag(IndicatedState::BusFrequency),
            bit::LOCAL,
        ),
        (has_flag(IndicatedState::Alarm), bit::ALARM),
        (sources.warning.is_some(), bit::WARNING),
    ]
    .into_iter()
    .filter_map(|(is_set, bits)| is_set.then_some(bits))
    .sum()
}

/// Uniform word 26: what the model can do and the control section allows.
pub(super) fn capabilities(model: &Model, control: Option<&ControlSettings>) -> u16 {
    let (Some(control), Some(run)) = (control, &model.run) else {
        return 0;
    };
    let may = |action| run.may(action, &control.accept_unverified);
    let turns = |direction| control.directions.contains(&direction);
    [
        (turns(Direction::Forward), capability::FORWARD),
        (
            turns(Direction::Reverse) && may(ControlAction::Reverse),
            capability::REVERSE,
        ),
        (may(ControlAction::Coast), capability::COAST),
        (may(ControlAction::Reset), capability::RESET),
        (
            model.register_for(RegisterRole::FrequencyCommand).is_some(),
            capability::SETPOINT,
        ),
        (
            control.allow_release && may(ControlAction::Release),
            capability::RELEASE,
        ),
        (control.allow_take, capability::TAKE),
    ]
    .into_iter()
    .filter_map(|(is_set, bit)| is_set.then_some(bit))
    .sum()
}
