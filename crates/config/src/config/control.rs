//! Checks a drive's control section against the abilities of its model and their confidence.

use super::acceptance::DriveAcceptance;
use super::file::{ControlFile, DriveFile, LimitsFile, LineFile};
use super::lists;
use super::mqtt::DriveDefaults;
use super::native;
use super::qualified::QualifiedStanding;
use super::standby;
use super::watchdog;
use super::words::CommandInterface;
use crate::domain::command::Direction;
use crate::domain::control::{ControlAction, ControlSettings, FailSafe};
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
    defaults: DriveDefaults,
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
    let (least, most) = limits?;
    let (accept_unverified, site) = accepted.settled(model);
    Some(Some(Arc::new(ControlSettings {
        from_mqtt: file.names(CommandInterface::Mqtt).is_some(),
        from_modbus_tcp: file.names(CommandInterface::ModbusTcp).is_some(),
        from_page: file.names(CommandInterface::Page).is_some(),
        from_sparkplug: file.names(CommandInterface::Sparkplug).is_some(),
        bus: file.bus()?,
        least,
        most,
        directions: directions?,
        reverse_below: file.reverse_below()?,
        on_commander_lost: file.on_commander_lost.as_ref()?.value,
        lost_after: file.lost_after.as_ref()?.value,
        on_shutdown: file.on_shutdown.as_ref()?.value,
        on_output_outside: file.on_output_outside()?,
        accept_unverified,
        site,
        qualify: file.qualify()?,
        allow_release: file.allow_release()?,
        strict: file.strict()?,
        restart_delay: file.restart_delay.or(defaults.restart_delay)?,
        stop_effect_timeout: file.stop_effect_timeout()?,
        stop_pending_for: file.stop_pending_for()?,
        native_write: native_write?,
        stored_write_interval: native::stored_write_interval(drive)?,
        stores_native_writes: native::stores(drive)?,
        ownership: file.ownership()?,
        allow_take: file.allow_take()?,
        lease: file.lease.or(defaults.lease)?,
        min_start_interval: file.min_start_interval()?,
        require_watchdog: file.require_watchdog()?,
        watchdog: file.watchdog.clone().optional()?,
        on_gateway_lost: on_gateway_lost?,
        failsafe_confirm_timeout: file.failsafe_confirm_timeout()?,
    })))
}

/// A drive that may be moved is polled often enough: old readings cannot show whether it is at standstill.
fn is_looked_at(drive: &DriveFile, problems: &mut Vec<Problem>) {
    if let Some(poll) = drive.poll.valid().filter(|poll| poll.value > SLOWEST_POLL) {
        let problem = poll
            .location
            .problem("too slow for a drive with a control section");
        problems.push(problem.right(format!("at most \"{}\"", duration_text(SLOWEST_POLL))));
    }
}

/// At least one interface is named, none twice, and keys for some interfaces require one of them.
fn ways(file: &ControlFile, problems: &mut Vec<Problem>) {
    let Some(from) = &file.from else { return };
    if from.value.is_empty() {
        let problem = from.location.problem("an empty list allows no commands");
        problems.push(
            problem
                .right("\"mqtt\", \"modbus-tcp\", \"page\", \"sparkplug\" or several of them, or no control section"),
        );
    }
    lists::once(&from.value, problems);
    let strict = file.strict.valid().map(|strict| &strict.location);
    let delay = file.restart_delay.valid().map(|delay| &delay.location);
    let lease = file.lease.valid().map(|lease| &lease.location);
    let by_broker = file
        .names(CommandInterface::Mqtt)
        .or(file.names(CommandInterface::Sparkplug));
    if !from.value.is_empty() && by_broker.is_none() {
        for location in [strict, lease].into_iter().flatten() {
            let problem = location.problem(
                "concerns commands over MQTT and Sparkplug only, and `from` names neither \"mqtt\" nor \"sparkplug\"",
            );
            problems.push(problem.right("leave it out").warning());
        }
        if let Some(location) = delay
            && file.names(CommandInterface::Page).is_none()
        {
            let what = "concerns commands over MQTT, Sparkplug and from the page only, and `from` names none of them";
            problems.push(location.problem(what).right("leave it out").warning());
        }
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
            let what = format!(
                "the drive is started and stopped elsewhere (bus = \"{}\"), so this cannot be relied on",
                bus.value.keyword()
            );
            let right = "\"hold\", with the stop wired to the drive's terminals, or bus = \"both\"";
            problems.push(action.location.problem(what).right(right));
        }
    }
    standby::wired(file, bus.value, problems);
    if let Some(strict) = file.directions.valid() {
        let problem = strict
            .location
            .problem("the direction is ordered elsewhere: `bus` takes the frequency alone");
        problems.push(problem.right("leave it out").warning());
    }
}

/// A drive that turns by the sign of its setpoint runs in reverse only if the setpoint comes over the bus.
fn sign_is_written(file: &ControlFile, model: &Model, problems: &mut Vec<Problem>) {
    let (Some(bus), Some(list)) = (file.bus.valid(), file.directions.valid()) else {
        return;
    };
    let reverse = list
        .value
        .iter()
        .find(|direction| direction.value == Direction::Reverse);
    if let Some(reverse) = reverse
        && model.turns_by_sign()
        && !bus.value.has_frequency()
    {
        let what = format!(
            "reverse is a setpoint below 0, and the setpoint does not come over the bus (bus = \"{}\")",
            bus.value.keyword()
        );
        problems.push(
            reverse
                .location
                .problem(what)
                .right("\"forward\" alone, or bus = \"both\""),
        );
    }
}

/// The directions in which the drive may run; `None` if it is invalid, see `problems`.
fn directions(file: &ControlFile, problems: &mut Vec<Problem>) -> Option<Vec<Direction>> {
    let directions = match &file.directions {
        OptionalKey::Absent => vec![Direction::Forward],
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(list) => {
            if list.value.is_empty() {
                let problem = list
                    .location
                    .problem("an empty list lets the drive run in no direction");
                problems.push(problem.right("\"forward\", \"reverse\" or both"));
                return None;
            }
            lists::once(&list.value, problems);
            list.value.iter().map(|direction| direction.value).collect()
        }
    };
    if let Some(below) = file.reverse_below.valid()
        && !goes_both_ways(&directions)
    {
        let problem = below
            .location
            .problem("there is nothing to reverse: `directions` allows one direction only");
        problems.push(
            problem
                .right("leave it out, or directions = [\"forward\", \"reverse\"]")
                .warning(),
        );
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
    let problem = location.problem(format!("{} cannot be controlled: {why}", model.id));
    problems.push(problem.right("leave `control` out; the drive is then read-only"));
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
    let (location, others) = match &file.accept_unverified {
        OptionalKey::Invalid => return,
        OptionalKey::Absent => (location.missing("accept_unverified"), Vec::new()),
        OptionalKey::Valid(list) => (
            list.location.clone(),
            list.value.iter().map(|accepted| accepted.value).collect(),
        ),
    };
    if unproven.is_empty() || accepted.accepts(ControlAction::Basic) {
        return;
    }
    let what: Vec<_> = unproven.iter().map(BasicFact::described).collect();
    let what = format!(
        "{} takes no orders: no manual of it proves {}",
        model.id,
        what.join(", ")
    );
    let words = std::iter::once(ControlAction::Basic).chain(others);
    let words: Vec<_> = words
        .map(|action| format!("\"{}\"", action.keyword()))
        .collect();
    let line = format!("accept_unverified = [{}]", words.join(", "));
    let right = format!(
        "{line} once you have seen a stop work, or no control section; the drive is then read-only"
    );
    problems.push(accepted.judged(location.problem(what).right(right)));
}

/// Lowest and highest setpoint; `None` if it is invalid, see `problems`.
fn limits(
    file: Option<&LimitsFile>,
    model: Option<&Model>,
    problems: &mut Vec<Problem>,
) -> Option<(Hertz, Hertz)> {
    let LimitsFile { min, max } = file?;
    if let Some(register) =
        model.and_then(|model| model.register_for(RegisterRole::FrequencyCommand))
    {
        can_be_set(min, register, problems);
        can_be_set(max, register, problems);
    }
    if let Some(max) = max.as_ref().filter(|max| max.value == Hertz::ZERO) {
        problems.push(
            max.location
                .problem("a drive with a maximum of 0 Hz never turns")
                .right("more than 0"),
        );
    }
    let min = min.as_ref()?;
    let max = max.as_ref()?;
    if min.value > max.value {
        let what = format!(
            "the lowest frequency, {} Hz, is above the highest, {} Hz",
            min.value, max.value
        );
        problems.push(
            min.location
                .problem(what)
                .right(format!("at most {}", max.value)),
        );
    }
    Some((min.value, max.value))
}

/// A limit must be a possible setpoint: one between two steps could never be reached.
fn can_be_set(limit: &RequiredKey<Hertz>, register: &Register, problems: &mut Vec<Problem>) {
    let Some(LocatedValue { value, location }) = limit else {
        return;
    };
    if register.form.pair.is_some() {
        if register.pair_of(*value).is_none() {
            let problem = location.problem(format!(
                "{value} Hz is between two steps of `{}`",
                register.name
            ));
            problems.push(problem.right(format!("a multiple of 1/{} Hz", register.scale)));
        }
        return;
    }
    if let Err(wrong) = to_raw(value.as_f64(), register) {
        let right = format!("a frequency that `{}` can represent", register.name);
        problems.push(
            location
                .problem(format!("{value} Hz is {wrong}"))
                .right(right),
        );
    }
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
    for LocatedValue {
        value: action,
        location,
    } in &listed.value
    {
        if let Some(what) = why_nothing_to_accept(*action, file, directions, model) {
            problems.push(location.problem(what).right("leave it out").warning());
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
    let reverse = file
        .directions
        .valid()
        .and_then(|list| list.value.iter().find(|it| it.value == Direction::Reverse));
    if let Some(LocatedValue { location, .. }) = reverse {
        can_do(
            accepted,
            ControlAction::Reverse,
            model,
            location,
            "leave it out",
            problems,
        );
    }
    for location in coasts(file) {
        can_do(
            accepted,
            ControlAction::Coast,
            model,
            location,
            "\"stop\" or \"hold\"",
            problems,
        );
    }
    if let Some(LocatedValue {
        value: true,
        location,
    }) = file.allow_release.valid()
    {
        match has(model, ControlAction::Release) {
            ActionSupport::No => problems.push(
                none_of(model, ControlAction::Release, location)
                    .right("leave it out")
                    .warning(),
            ),
            _ => can_do(
                accepted,
                ControlAction::Release,
                model,
                location,
                "leave it out",
                problems,
            ),
        }
    }
}

/// Why an acceptance of `action` has no effect; `None` if it has.
fn why_nothing_to_accept(
    action: ControlAction,
    file: &ControlFile,
    directions: Option<&[Direction]>,
    model: &Model,
) -> Option<String> {
    let word = action.keyword();
    match has(model, action) {
        ActionSupport::No => Some(format!(
            "{} has no {word}, so there is nothing to accept",
            model.id
        )),
        ActionSupport::Proven(it) => Some(format!(
            "{word} is proven for {} ({}), so there is nothing to accept",
            model.id,
            it.keyword()
        )),
        ActionSupport::Unproven(_)
            if action == ControlAction::Reverse && !may_reverse(directions) =>
        {
            Some(
                "`directions` does not allow \"reverse\", so there is nothing to accept".to_owned(),
            )
        }
        ActionSupport::Unproven(_) if action == ControlAction::Release && !may_release(file) => {
            Some("`allow_release` is not true, so there is nothing to accept".to_owned())
        }
        ActionSupport::Unproven(_) => None,
    }
}

/// Where the section says that the output is cut off.
fn coasts(file: &ControlFile) -> impl Iterator<Item = &KeyLocation> {
    let fail_safes = [&file.on_commander_lost, &file.on_shutdown]
        .into_iter()
        .flatten();
    let coasts = fail_safes
        .filter(|it| it.value == FailSafe::Coast)
        .map(|it| &it.location);
    let taken_over = file
        .on_gateway_lost
        .valid()
        .filter(|it| it.value == OnGatewayLost::Coast);
    coasts.chain(taken_over.map(|it| &it.location))
}

fn may_reverse(directions: Option<&[Direction]>) -> bool {
    directions.is_none_or(|directions| directions.contains(&Direction::Reverse))
}

fn none_of(model: &Model, action: ControlAction, location: &KeyLocation) -> Problem {
    location.problem(format!("{} has no {}", model.id, action.keyword()))
}

fn may_release(file: &ControlFile) -> bool {
    file.allow_release().unwrap_or(true)
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
        ActionSupport::No => problems.push(none_of(model, action, location).right(instead)),
        ActionSupport::Unproven(confidence) if !is_accepted => {
            let what = format!(
                "{word} is unproven for {} ({})",
                model.id,
                confidence.keyword()
            );
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
