//! Terms for drives and lines shared by all interfaces: how reliable a value is, what a drive does, what it may be
//! commanded.

use crate::domain::calendar::rfc3339;
use crate::domain::command::{Direction, Outcome, Reason, Report, RunIntent};
use crate::domain::control::{ControlAction, ControlSettings, FailSafe};
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::frequency::Hertz;
use crate::domain::standby::{StandbyPair, StandbyReport};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::sight::SeenAt;
use crate::drive::snapshot::{DrivePresence, ValueReading};
use crate::drive::usage::{EnergySource, UsagePart};
use crate::drive::view::{ControlView, DriveView, RunState};
use crate::drive::warnings;
use crate::north::api::{FailSafeDocument, LastSeenDocument, StandbyDocument, UsageDocument};
use crate::north::clock::LabelClock;
use crate::north::texts::Sentence;
use crate::profile::model::{Model, Register};
use crate::profile::scale::Decimal;
use std::time::Duration;

/// How reliable a value is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freshness {
    /// The value is not older than allowed.
    Good,
    /// The value is older than allowed.
    Stale,
    /// There is none yet.
    Never,
}

impl Freshness {
    /// The word as used in payloads.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Stale => "stale",
            Self::Never => "never",
        }
    }
}

/// What a drive has used.
#[must_use]
pub fn usage(view: &DriveView) -> UsageDocument {
    let value = |part| view.usage.value(part).map(Decimal::value);
    let energy_from = view.usage.parts.energy.map(EnergySource::keyword);
    UsageDocument {
        energy_kwh: value(UsagePart::Energy),
        energy_from: energy_from.map(str::to_owned),
        running_hours: value(UsagePart::RunningHours),
        starts: value(UsagePart::Starts).map(|it| it as u64),
        trips: value(UsagePart::Trips).map(|it| it as u64),
    }
}

/// Why a command or a read ended so, in plain words and, if the drive answered with an exception, in its vendor's.
#[must_use]
pub fn message(model: &Model, report: &Report) -> String {
    let said = report.message();
    match report.exception.and_then(|code| model.exception_text(code)) {
        Some(text) => format!("{said}: {}", text.marked()),
        None => said,
    }
}

/// Why a command or a read ended so, as a sentence for clients that show another language.
#[must_use]
pub fn said(model: &Model, report: &Report) -> Sentence {
    let said = said_alone(report);
    match report.exception.and_then(|code| model.exception_text(code)) {
        Some(text) => Sentence::new("reason.by_exception")
            .with("reason", said)
            .with("text", text.marked()),
        None => said,
    }
}

fn said_alone(report: &Report) -> Sentence {
    if let Some(holder) = report.holder {
        return Sentence::new("reason.held_by").with("holder", holder.to_string());
    }
    if (report.outcome, report.reason) == (Outcome::Unknown, Reason::LineDown) {
        return Sentence::new("reason.stop_waits_for_line");
    }
    let reason = Sentence::new(format!("reason.{}", report.reason.keyword()));
    match (report.register, report.held) {
        (Some(register), Some(held)) => {
            let holds = Sentence::new("reason.register_holds").with("reason", reason);
            holds
                .with("register", register.to_string())
                .with("held", held.to_string())
        }
        (Some(register), None) => Sentence::new("reason.register_unseen")
            .with("reason", reason)
            .with("register", register.to_string()),
        _ => reason,
    }
}

/// When the value of `register` grows stale; `None` if there is none.
#[must_use]
pub fn stale_at(
    drive: &DriveDescription,
    register: &Register,
    view: &DriveView,
) -> Option<MonoTime> {
    drive.stale_at(register, &view.snapshot)
}

/// The value of `register`, unless it is stale.
#[must_use]
pub fn fresh(
    drive: &DriveDescription,
    register: &Register,
    view: &DriveView,
    at: MonoTime,
) -> Option<ValueReading> {
    drive.fresh(register, &view.snapshot, at)
}

/// The number or the bits that the warning register shows; `None` if the model has none, or it is not known.
#[must_use]
pub fn warning(drive: &DriveDescription, view: &DriveView, at: MonoTime) -> Option<u32> {
    let register = drive.model.warning_register()?;
    fresh(drive, register, view, at)?;
    register.code(|address| view.snapshot.reading(address).map(|reading| reading.raw))
}

/// Whether a warning is active; `None` if the model has none, or it is not known.
#[must_use]
pub fn warns(drive: &DriveDescription, view: &DriveView, at: MonoTime) -> Option<bool> {
    if !view.is_online() {
        return None;
    }
    warning(drive, view, at).map(|word| word != 0)
}

/// The texts of the active warnings; `None` if there are none, or they are not known.
#[must_use]
pub fn warning_text(drive: &DriveDescription, view: &DriveView, at: MonoTime) -> Option<String> {
    if !view.is_online() {
        return None;
    }
    let word = warning(drive, view, at)?;
    warnings::text(&drive.model, word)
}

/// The state of the drive's own state machine in the vendor's words; `None` if the model has none, or it is not known.
#[must_use]
pub fn drive_state(drive: &DriveDescription, view: &DriveView, at: MonoTime) -> Option<String> {
    let reading = fresh(drive, drive.model.state_register()?, view, at)?;
    drive.model.drive_state(reading.raw)
}

/// How reliable the last reading of `register` is.
#[must_use]
pub fn quality(
    drive: &DriveDescription,
    register: &Register,
    view: &DriveView,
    at: MonoTime,
) -> Freshness {
    match stale_at(drive, register, view) {
        None => Freshness::Never,
        Some(stale_at) if at < stale_at => Freshness::Good,
        Some(_) => Freshness::Stale,
    }
}

/// What was last seen of a drive that is out of sight; `None` for one that is in sight, or of which nothing was seen.
#[must_use]
pub fn last_seen(view: &DriveView, clock: &LabelClock) -> Option<LastSeenDocument> {
    let seen = view.sight.last_seen?;
    let at = match seen.at {
        SeenAt::Here(at) => clock.text(at),
        SeenAt::Before(at) => rfc3339(at),
    };
    Some(LastSeenDocument {
        run_state: seen.run_state.keyword().into(),
        output_hz: seen.output.map(Hertz::as_f64),
        at: Some(at),
    })
}

/// The declared action that fell due since the last RUN, with the stage that it has reached; `None` if none did.
#[must_use]
pub fn fail_safe(control: Option<&ControlView>, clock: &LabelClock) -> Option<FailSafeDocument> {
    let run = control?.failsafe?;
    Some(FailSafeDocument {
        action: run.action.keyword().into(),
        cause: run.cause.keyword().into(),
        stage: run.stage.keyword().into(),
        at: clock.text(run.at).into(),
    })
}

/// The sentence that a drive out of sight may still run, and what was last seen of it.
#[must_use]
pub fn may_still_run(view: &DriveView) -> Sentence {
    let Some(seen) = view.sight.last_seen else {
        return Sentence::new("finding.may_still_run");
    };
    let state = Sentence::new(format!("finding.state.{}", seen.run_state.keyword()));
    match seen.output {
        Some(hertz) => Sentence::new("finding.may_still_run_at")
            .with("state", state)
            .with("output", hertz.as_f64()),
        None => Sentence::new("finding.may_still_run_seen").with("state", state),
    }
}

/// Why a declared action runs, and how far it has come.
#[must_use]
pub fn fail_safe_text(run: FailSafeRun) -> Sentence {
    let came = fail_safe_stage(run.action.keyword(), run.stage.keyword());
    Sentence::new("finding.failsafe")
        .with("cause", fail_safe_cause(run.cause.keyword()))
        .with("came", came)
}

/// Why a declared action runs, from its word.
#[must_use]
pub fn fail_safe_cause(cause: &str) -> Sentence {
    Sentence::new(format!("finding.cause.{cause}"))
}

/// How far a declared action has come, from the words for it and for its stage.
#[must_use]
pub fn fail_safe_stage(action: &str, stage: &str) -> Sentence {
    if action == FailSafe::Hold.keyword() {
        return Sentence::new("finding.failsafe.hold");
    }
    Sentence::new(format!("finding.failsafe.{stage}")).with("action", action)
}

/// The run state for clients that are also shown that the drive does not answer: such a drive may do anything.
#[must_use]
pub fn answered_run_state(view: &DriveView) -> RunState {
    if view.is_online() && view.run_state != RunState::Offline {
        view.run_state
    } else {
        RunState::Unknown
    }
}

/// The run state; offline while the drive cannot be reached, whatever was known before.
#[must_use]
pub fn run_state(view: &DriveView) -> RunState {
    let was_seen = view.snapshot.presence != DrivePresence::Unknown;
    if was_seen && !view.is_online() {
        RunState::Offline
    } else {
        view.run_state
    }
}

/// The word for whether the drive answers.
#[must_use]
pub fn presence(view: &DriveView) -> &'static str {
    match view.snapshot.presence {
        DrivePresence::Unknown => "unknown",
        DrivePresence::Online if view.line_is_up => "online",
        DrivePresence::Online | DrivePresence::Offline => "offline",
    }
}

/// What a drive's control section and model allow to be commanded, as words.
#[must_use]
pub fn capabilities(drive: &DriveDescription) -> Vec<&'static str> {
    let (Some(control), Some(run)) = (&drive.control, &drive.model.run) else {
        return Vec::new();
    };
    let may = |action| run.may(action, &control.accept_unverified);
    let has_run = control.bus.has_run();
    let table = [
        ("stop", true),
        ("frequency", control.bus.has_frequency()),
        (
            "forward",
            has_run && control.directions.contains(&Direction::Forward),
        ),
        (
            "reverse",
            has_run
                && control.directions.contains(&Direction::Reverse)
                && may(ControlAction::Reverse),
        ),
        ("coast", has_run && may(ControlAction::Coast)),
        ("reset", has_run && may(ControlAction::Reset)),
        (
            "release",
            has_run && control.allow_release && may(ControlAction::Release),
        ),
        ("take", control.allow_take),
    ];
    words(&table)
}

/// The unproven actions that are accepted because they were confirmed at this very drive, as words.
#[must_use]
pub fn site(control: &ControlSettings) -> Vec<&'static str> {
    control
        .site
        .actions
        .iter()
        .map(|action| action.keyword())
        .collect()
}

/// The sources from which commands are accepted, as named in the configuration.
#[must_use]
pub fn sources(control: &ControlSettings) -> Vec<&'static str> {
    words(&[
        ("mqtt", control.from_mqtt),
        ("modbus-tcp", control.from_modbus_tcp),
        ("page", control.from_page),
        ("sparkplug", control.from_sparkplug),
    ])
}

fn words(table: &[(&'static str, bool)]) -> Vec<&'static str> {
    table
        .iter()
        .filter(|(_, is_there)| *is_there)
        .map(|(word, _)| *word)
        .collect()
}

/// The word for what is ordered.
#[must_use]
pub const fn intent(intent: RunIntent) -> &'static str {
    match intent {
        RunIntent::Stop => "stop",
        RunIntent::Run(Direction::Forward) => "forward",
        RunIntent::Run(Direction::Reverse) => "reverse",
        RunIntent::Coast => "coast",
    }
}

/// The role of this gateway on a line that `pair` shares; `None` on a line of its own.
#[must_use]
pub fn standby(
    report: Option<&StandbyReport>,
    pair: Option<&StandbyPair>,
) -> Option<StandbyDocument> {
    let report = report?;
    Some(StandbyDocument {
        role: report.role.keyword().into(),
        half: pair.map(|pair| pair.half.to_string()),
        partner: pair.map(|pair| pair.partner.to_string()),
        take_overs: report.take_overs,
        given_up: report.given_up,
        rivals: report.rivals,
        hears_other: report.hears_other,
        listener: report.listener,
        deaf: report.trouble.is_deaf,
        files_differ: report.trouble.files_differ,
        unknown_station: report.trouble.unknown_station.map(|station| station.0),
    })
}

/// Milliseconds, rounded up: a bound is never shown smaller than it is.
#[must_use]
pub fn millis(time: Duration) -> u64 {
    u64::try_from(time.as_micros().div_ceil(1000)).unwrap_or(u64::MAX)
}
