//! Checks a drive's control section against the abilities of its model and their confidence.

use super::acceptance::DriveAcceptance;
use super::file::{ControlFile, DriveFile, LimitsFile, LineFile, MqttDefaults, SetpointLimits};
use super::lists;
use super::native;
use super::qualified::QualifiedStanding;
use super::standby;
use super::watchdog;
use super::words::CommandInterface;
use crate::domain::command::Direction;
use crate::domain::control::{BusFunctions, ControlAction, ControlSettings, FailSafe};
use crate::domain::frequency::Hertz;
use crate::domain::problem::Problem;
use crate::domain::standby::OnGatewayLost;
use crate::domain::units::UnitOfMeasure;
use crate::profile::model::{BasicFact, Confidence, Model, Register, RegisterRole};
use crate::profile::scale::to_raw;
use crate::toml_file::values::duration_text;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, RequiredKey};
use std::sync::Arc;
use std::time::Duration;

/// Longest fast poll period of a drive that may be commanded: a status older than 5 s is refused.
const SLOWEST_POLL: Duration = Duration::from_secs(5);

/// The ready control section of `drive` on `line`: `Some(None)` without one; `None` if it is invalid, see `problems`.
/// `defaults` fill in missing keys. Without a `model`, which is then reported as unknown, only checks that do not
/// depend on it are made. `standing`: what was tried at the drive.
pub(super) fn settle(
    (line, drive): (&LineFile, &DriveFile),
    model: Option<&Model>,
    defaults: MqttDefaults,
    standing: &QualifiedStanding,
    problems: &mut Vec<Problem>,
) -> Option<Option<Arc<ControlSettings>>> {
    let native_write = native::settle(drive, model, problems);
    let LocatedValue {
        value: file,
        location,
    } = match &drive.control {
        OptionalKey::Absent => return Some(None),
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(control) => control,
    };
    is_looked_at(drive, problems);
    ways(file, problems);
    let directions = directions(file, problems);
    let on_gateway_lost = standby::on_lost(file, location, line, problems);
    // A model that cannot be commanded at all is reported once, not for each key.
    let able = model.filter(|model| can_be_controlled(model, location, problems));
    let accepted = DriveAcceptance::new(file, standing);
    let limits = limits(file.limits.as_ref(), able, problems);
    if let Some(model) = able {
        wired(file, problems);
        sign_is_written(file, model, problems);
        basics(accepted, file, location, model, problems);
        actions(accepted, file, directions.as_deref(), model, problems);
        accepted.check(location, model, problems);
        watchdog::check(file, model, problems);
    }
    let settings = file.settings(
        limits?,
        on_gateway_lost?,
        accepted.evidence(model),
        native_write?,
        &drive.native.clone().optional()?.unwrap_or_default(),
        defaults,
    )?;
    Some(Some(Arc::new(settings)))
}

/// A drive that may be moved is polled often enough: old readings cannot show whether it is at standstill.
fn is_looked_at(drive: &DriveFile, problems: &mut Vec<Problem>) {
    if let Some(poll) = drive.poll.valid()
        && poll.value > SLOWEST_POLL
    {
        let right = format!("at most \"{}\"", duration_text(SLOWEST_POLL));
        poll.refuse(
            "too slow for a drive with a control section",
            right,
            problems,
        );
    }
}

/// At least one interface is named, none twice, and keys for some interfaces require one of them.
fn ways(file: &ControlFile, problems: &mut Vec<Problem>) {
    let Some(from) = &file.from else { return };
    if from.value.is_empty() {
        let right = "\"mqtt\", \"modbus-tcp\", \"page\", \"sparkplug\" or several of them, or no control section";
        from.refuse("an empty list allows no commands", right, problems);
    }
    lists::once(&from.value, problems);
    if from.value.is_empty() || file.by_broker().is_some() {
        return;
    }
    let keys = [file.strict.location(), file.lease.location()];
    for location in keys.into_iter().flatten() {
        let what = "concerns commands over MQTT and Sparkplug only, and `from` names neither \"mqtt\" nor \"sparkplug\"";
        location.warn(what, "leave it out", problems);
    }
    if let (Some(delay), None) = (
        file.restart_delay.valid(),
        file.names(CommandInterface::Page),
    ) {
        let what = "concerns commands over MQTT, Sparkplug and from the page only, and `from` names none of them";
        delay.warn(what, "leave it out", problems);
    }
}

/// A drive that is started and stopped at its terminals cannot be promised to be stopped over the bus.
fn wired(file: &ControlFile, problems: &mut Vec<Problem>) {
    let Some(bus) = file.bus.valid().filter(|bus| !bus.value.has_run()) else {
        return;
    };
    for action in [&file.on_commander_lost, &file.on_shutdown]
        .into_iter()
        .flatten()
    {
        if action.value != FailSafe::Hold {
            let right = "\"hold\", with the stop wired to the drive's terminals, or bus = \"both\"";
            action.refuse(cannot_be_relied_on(bus.value), right, problems);
        }
    }
    if let Some(lost) = file.on_gateway_lost.valid()
        && matches!(lost.value, OnGatewayLost::Stop | OnGatewayLost::Coast)
    {
        let right = "\"hold\" or \"adopt\", or bus = \"both\"";
        lost.refuse(cannot_be_relied_on(bus.value), right, problems);
    }
    if let Some(directions) = file.directions.valid() {
        let what = "the direction is ordered elsewhere: `bus` takes the frequency alone";
        directions.warn(what, "leave it out", problems);
    }
}

fn cannot_be_relied_on(bus: BusFunctions) -> String {
    format!(
        "the drive is started and stopped elsewhere (bus = \"{}\"), so this cannot be relied on",
        bus.keyword()
    )
}

/// A drive that turns by the sign of its setpoint runs in reverse only if the setpoint comes over the bus.
fn sign_is_written(file: &ControlFile, model: &Model, problems: &mut Vec<Problem>) {
    let (Some(bus), Some(reverse)) = (file.bus.valid(), reverse(file)) else {
        return;
    };
    if model.turns_by_sign() && !bus.value.has_frequency() {
        let what = format!(
            "reverse is a setpoint below 0, and the setpoint does not come over the bus (bus = \"{}\")",
            bus.value.keyword()
        );
        reverse.refuse(what, "\"forward\" alone, or bus = \"both\"", problems);
    }
}

/// Where the section allows reverse.
fn reverse(file: &ControlFile) -> Option<&LocatedValue<Direction>> {
    let mut directions = file.directions.valid()?.value.iter();
    directions.find(|direction| direction.value == Direction::Reverse)
}

/// The directions in which the drive may run; `None` if it is invalid, see `problems`.
fn directions(file: &ControlFile, problems: &mut Vec<Problem>) -> Option<Vec<Direction>> {
    if let Some(list) = file.directions.valid() {
        if list.value.is_empty() {
            let what = "an empty list lets the drive run in no direction";
            list.refuse(what, "\"forward\", \"reverse\" or both", problems);
        }
        lists::once(&list.value, problems);
    }
    let directions = file.directions()?;
    if let Some(below) = file.reverse_below.valid()
        && !goes_both_ways(&directions)
    {
        let what = "there is nothing to reverse: `directions` allows one direction only";
        let right = "leave it out, or directions = [\"forward\", \"reverse\"]";
        below.warn(what, right, problems);
    }
    Some(directions)
}

fn goes_both_ways(directions: &[Direction]) -> bool {
    [Direction::Forward, Direction::Reverse]
        .iter()
        .all(|direction| directions.contains(direction))
}

/// Whether a drive of this model can be commanded at all, whether its facts are proven or not.
fn can_be_controlled(model: &Model, location: &KeyLocation, problems: &mut Vec<Problem>) -> bool {
    let Some(why) = why_not(model) else {
        return true;
    };
    let what = format!("{} cannot be controlled: {why}", model.id);
    let right = "leave `control` out; the drive is then read-only";
    location.refuse(what, right, problems);
    false
}

/// Why drives of `model` cannot be controlled; `None` if they can.
#[must_use]
pub fn why_not(model: &Model) -> Option<String> {
    if model.run.is_none() {
        return Some("its description has no run commands".to_owned());
    }
    let role = |role| model.register_for(role);
    let (Some(_), Some(frequency)) = (
        role(RegisterRole::RunCommand),
        role(RegisterRole::FrequencyCommand),
    ) else {
        return Some("its description has no registers for run and frequency commands".to_owned());
    };
    if frequency.unit != UnitOfMeasure::Hertz {
        return Some("its frequency command is not in Hz".to_owned());
    }
    if role(RegisterRole::OutputFrequency).is_none_or(|output| output.poll.is_none()) {
        return Some(
            "its description has no output frequency that is polled, to see that a stop takes effect".to_owned(),
        );
    }
    None
}

/// Stop, forward and the setpoint are proven, or accepted together: no drive may be startable but not stoppable.
fn basics(
    accepted: DriveAcceptance<'_>,
    file: &ControlFile,
    location: &KeyLocation,
    model: &Model,
    problems: &mut Vec<Problem>,
) {
    let unproven = model.unproven_basics();
    let Some(others) = lists::values(&file.accept_unverified) else {
        return;
    };
    if unproven.is_empty() || accepted.accepts(ControlAction::Basic) {
        return;
    }
    let missing = location.missing("accept_unverified");
    let location = file.accept_unverified.location().unwrap_or(&missing);
    let what: Vec<_> = unproven.iter().map(BasicFact::described).collect();
    let what = format!(
        "{} takes no orders: no manual of it proves {}",
        model.id,
        what.join(", ")
    );
    let words = std::iter::once(ControlAction::Basic).chain(others);
    let words: Vec<_> = words.map(|it| format!("\"{}\"", it.keyword())).collect();
    let right = format!(
        "accept_unverified = [{}] once you have seen a stop work, or no control section; the drive is then read-only",
        words.join(", ")
    );
    problems.push(accepted.judged(location.problem(what).right(right)));
}

/// Lowest and highest setpoint; `None` if it is invalid, see `problems`.
fn limits(
    file: Option<&LimitsFile>,
    model: Option<&Model>,
    problems: &mut Vec<Problem>,
) -> Option<SetpointLimits> {
    let LimitsFile { min, max } = file?;
    if let Some(register) =
        model.and_then(|model| model.register_for(RegisterRole::FrequencyCommand))
    {
        can_be_set(min, register, problems);
        can_be_set(max, register, problems);
    }
    if let Some(max) = max.as_ref().filter(|max| max.value == Hertz::ZERO) {
        let what = "a drive with a maximum of 0 Hz never turns";
        max.refuse(what, "more than 0", problems);
    }
    let (min, most) = (min.as_ref()?, max.as_ref()?.value);
    let least = min.value;
    if least > most {
        let what = format!("the lowest frequency, {least} Hz, is above the highest, {most} Hz");
        min.refuse(what, format!("at most {most}"), problems);
    }
    Some(SetpointLimits { least, most })
}

/// A limit must be a possible setpoint: one between two steps could never be reached.
fn can_be_set(limit: &RequiredKey<Hertz>, register: &Register, problems: &mut Vec<Problem>) {
    let Some(LocatedValue { value, location }) = limit else {
        return;
    };
    let (what, right) = if register.form.pair.is_some() {
        if register.pair_of(*value).is_some() {
            return;
        }
        (
            format!("{value} Hz is between two steps of `{}`", register.name),
            format!("a multiple of 1/{} Hz", register.scale),
        )
    } else {
        let Err(wrong) = to_raw(value.as_f64(), register) else {
            return;
        };
        (
            format!("{value} Hz is {wrong}"),
            format!("a frequency that `{}` can represent", register.name),
        )
    };
    location.refuse(what, right, problems);
}

/// How a model supports an action.
enum ActionSupport {
    No,
    Unproven(Confidence),
    Proven(Confidence),
}

fn has(model: &Model, action: ControlAction) -> ActionSupport {
    if action == ControlAction::Basic {
        let unproven = model
            .unproven_basics()
            .into_iter()
            .map(|basic| basic.confidence)
            .max();
        let stop = model.run.as_ref().map(|run| run.stop.confidence);
        return match (unproven, stop) {
            (Some(confidence), _) => ActionSupport::Unproven(confidence),
            (None, Some(confidence)) => ActionSupport::Proven(confidence),
            (None, None) => ActionSupport::No,
        };
    }
    let fact = model.run.as_ref().and_then(|run| run.action(action));
    match fact.map(|fact| fact.confidence) {
        None => ActionSupport::No,
        Some(confidence) if confidence.is_proven() => ActionSupport::Proven(confidence),
        Some(confidence) => ActionSupport::Unproven(confidence),
    }
}

/// Each action that the section relies on is supported, and proven or accepted. An acceptance without effect is a
/// warning: the model may have proven the action since, and removing it changes nothing.
fn actions(
    accepted: DriveAcceptance<'_>,
    file: &ControlFile,
    directions: Option<&[Direction]>,
    model: &Model,
    problems: &mut Vec<Problem>,
) {
    named_actions(accepted, file, model, problems);
    let OptionalKey::Valid(listed) = &file.accept_unverified else {
        return;
    };
    lists::once(&listed.value, problems);
    for action in &listed.value {
        if let Some(what) = why_nothing_to_accept(action.value, file, directions, model) {
            action.warn(what, "leave it out", problems);
        }
    }
}

/// The actions that other keys of the section name.
fn named_actions(
    accepted: DriveAcceptance<'_>,
    file: &ControlFile,
    model: &Model,
    problems: &mut Vec<Problem>,
) {
    let mut needs = |action, location, instead| {
        can_do(accepted, action, model, location, instead, problems);
    };
    if let Some(reverse) = reverse(file) {
        needs(ControlAction::Reverse, &reverse.location, "leave it out");
    }
    for location in coasts(file) {
        needs(ControlAction::Coast, location, "\"stop\" or \"hold\"");
    }
    let Some(release) = file.allow_release.valid_as(&true) else {
        return;
    };
    match has(model, ControlAction::Release) {
        ActionSupport::No => {
            let what = none_of(model, ControlAction::Release);
            release.warn(what, "leave it out", problems);
        }
        _ => needs(ControlAction::Release, &release.location, "leave it out"),
    }
}

/// Why an acceptance of `action` has no effect; `None` if it has.
fn why_nothing_to_accept(
    action: ControlAction,
    file: &ControlFile,
    directions: Option<&[Direction]>,
    model: &Model,
) -> Option<String> {
    let (word, id) = (action.keyword(), &model.id);
    let why = match has(model, action) {
        ActionSupport::No => format!("{id} has no {word}"),
        ActionSupport::Proven(it) => format!("{word} is proven for {id} ({})", it.keyword()),
        ActionSupport::Unproven(_) => match action {
            ControlAction::Reverse if !may_reverse(directions) => {
                "`directions` does not allow \"reverse\"".to_owned()
            }
            ControlAction::Release if file.allow_release() == Some(false) => {
                "`allow_release` is not true".to_owned()
            }
            _ => return None,
        },
    };
    Some(format!("{why}, so there is nothing to accept"))
}

/// Where the section says that the output is cut off.
fn coasts(file: &ControlFile) -> impl Iterator<Item = &KeyLocation> {
    let fail_safes = [&file.on_commander_lost, &file.on_shutdown]
        .into_iter()
        .flatten();
    let coasts = fail_safes.filter(|it| it.value == FailSafe::Coast);
    let taken_over = file.on_gateway_lost.valid_as(&OnGatewayLost::Coast);
    coasts
        .map(|it| &it.location)
        .chain(taken_over.map(|it| &it.location))
}

fn may_reverse(directions: Option<&[Direction]>) -> bool {
    directions.is_none_or(|directions| directions.contains(&Direction::Reverse))
}

fn none_of(model: &Model, action: ControlAction) -> String {
    format!("{} has no {}", model.id, action.keyword())
}

/// Reports at `place` that `action` is missing, or unproven and not accepted. `instead` does not need the action. A
/// fail-safe action rests on what the section lists alone: it must not change its meaning when the drive does.
fn can_do(
    accepted: DriveAcceptance<'_>,
    action: ControlAction,
    model: &Model,
    location: &KeyLocation,
    instead: &str,
    problems: &mut Vec<Problem>,
) {
    let word = action.keyword();
    let is_fail_safe = action == ControlAction::Coast;
    let is_accepted = if is_fail_safe {
        accepted.lists(action)
    } else {
        accepted.accepts(action)
    };
    match has(model, action) {
        ActionSupport::No => location.refuse(none_of(model, action), instead, problems),
        ActionSupport::Unproven(confidence) if !is_accepted => {
            let (id, confidence) = (&model.id, confidence.keyword());
            let what = format!("{word} is unproven for {id} ({confidence})");
            let right = format!(
                "{instead}, or accept_unverified = [\"{word}\"] once you have seen it work"
            );
            let problem = location.problem(what).right(right);
            problems.push(if is_fail_safe {
                problem
            } else {
                accepted.judged(problem)
            });
        }
        ActionSupport::Unproven(_) | ActionSupport::Proven(_) => {}
    }
}
