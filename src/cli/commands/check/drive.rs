//! The part of `check` about one drive: its polls, what it can be ordered, and what has to be set on it.

use super::text::{list, ms};
use super::warnings::{feeds_watchdog, takes_control, trips_first};
use crate::cli::tools::model_facts::{BASICS, orders};
use crate::config::words::{DIRECTIONS, LEASES};
use crate::config::{DriveSettings, LineSettings, ListedRegister, MqttSettings};
use crate::config::{command_deadline, line_plan, listed, shown_in_per_cent};
use crate::domain::address::Address;
use crate::domain::control::{BusFunctions, ControlAction, ControlSettings, Ownership};
use crate::line::budget::{PlannedRead, PollBudget};
use crate::line::timeouts::RequestClass;
use crate::profile::model::{Model, ModelWatchdog, RegisterMemory, SetupItem};
use crate::toml_file::values::duration_text;
use crate::toml_file::words::word_for;
use std::fmt::{Result, Write};
use std::time::Duration;

/// Appends the meaning of the configuration for the drive at `place` of `line`.
pub(super) fn describe(
    text: &mut String,
    line: &LineSettings,
    place: usize,
    budget: &PollBudget,
    mqtt: Option<&MqttSettings>,
) -> Result {
    let (Some(drive), Some(reads)) = (line.drives.get(place), budget.stations.get(place)) else {
        return Ok(());
    };
    let name = &drive.name;
    let model = &drive.model;
    let access = if drive.control.is_some() {
        "controlled"
    } else {
        "read-only"
    };
    let units = format!("unit {}, uniform unit {}", drive.unit, drive.uniform_unit);
    writeln!(
        text,
        "  drive {name}: {}, station {}, {units}, {access}",
        model.id, drive.station
    )?;
    polls(text, drive, budget, reads)?;
    lateness(text, line, drive)?;
    for (what, key) in shown_in_per_cent(model, &drive.ratings) {
        writeln!(text, "    {what} is shown only in per cent: set {key}")?;
    }
    if let Some(control) = &drive.control {
        commands(text, control, model, mqtt)?;
        native(text, control, model)?;
        setup(text, model, line, control.bus)?;
        wired(text, control.bus)?;
    }
    if let Some(watchdog) = &model.watchdog {
        watchdog_of(text, watchdog, model)?;
    }
    if drive.control.is_some()
        && let Some(gap) = line_plan::longest_gap(line, place)
    {
        watchdog_chain(text, line, drive, gap)?;
    }
    Ok(())
}

/// How long a reply is awaited, and how long a missing one delays what could be mistaken for it.
fn lateness(text: &mut String, line: &LineSettings, drive: &DriveSettings) -> Result {
    let timeouts = line_plan::reply_timeouts(drive);
    let [read, write, stored] = RequestClass::ALL.map(|class| timeouts.of(class));
    let all_same = read == write && read == stored;
    let waits = if all_same {
        ms(read)
    } else {
        format!("{} (stored writes {})", ms(read.max(write)), ms(stored))
    };
    if line.framing.identifies_replies() {
        writeln!(
            text,
            "    a reply is waited for up to {waits}, behind a converter longer than the converter's own time-out;"
        )?;
        return writeln!(text, "    a late reply cannot be mistaken for another");
    }
    let learned = if timeouts.learns {
        ", shorter once its reply times are known"
    } else {
        ""
    };
    writeln!(text, "    a reply is waited for up to {waits}{learned}")?;
    let late = ms(drive.max_lateness);
    if drive.model.barriers.is_empty() {
        let longest = read.max(write).max(stored) + drive.max_lateness;
        writeln!(
            text,
            "    it may come {late} later, and no barrier settles that: a drive that misses one is left"
        )?;
        return writeln!(
            text,
            "    alone for so long, and a stop for it is confirmed up to {} later",
            ms(longest)
        );
    }
    writeln!(
        text,
        "    it may come {late} later; a barrier settles that sooner"
    )
}

fn polls(
    text: &mut String,
    drive: &DriveSettings,
    budget: &PollBudget,
    reads: &[PlannedRead],
) -> Result {
    for read in reads {
        let group = read.group;
        let period = read.period.mul_f64(budget.stretch);
        let age = budget.age(read);
        let addresses = group.address.onwards().take(group.count.into());
        let names: Vec<_> = addresses
            .filter_map(|address| drive.model.register_at(address))
            .map(|register| register.name.as_str())
            .collect();
        writeln!(
            text,
            "    every {} a read of {} x{} ({}), age at most about {}",
            ms(period),
            group.address,
            group.count,
            names.join(", "),
            ms(age)
        )?;
    }
    Ok(())
}

fn commands(
    text: &mut String,
    control: &ControlSettings,
    model: &Model,
    mqtt: Option<&MqttSettings>,
) -> Result {
    let ways = [
        (control.from_mqtt, "mqtt"),
        (control.from_modbus_tcp, "modbus-tcp"),
        (control.from_page, "page"),
        (control.from_sparkplug, "sparkplug"),
    ];
    let ways: Vec<_> = ways
        .into_iter()
        .filter_map(|(is_there, way)| is_there.then_some(way))
        .collect();
    let directions: Vec<_> = control
        .directions
        .iter()
        .map(|it| word_for(&DIRECTIONS, it))
        .collect();
    let lost_after = duration_text(control.lost_after);
    writeln!(
        text,
        "    commands from {}: {} to {} Hz, {}",
        list(&ways),
        control.least,
        control.most,
        list(&directions)
    )?;
    let deadline = duration_text(command_deadline(control, mqtt));
    writeln!(text, "    command deadline {deadline} < lease {lost_after}")?;
    ownership(text, control)?;
    writeln!(
        text,
        "    commander lost after {lost_after}: {}; gateway ended: {}; output outside limits: {}{}",
        control.on_commander_lost.keyword(),
        control.on_shutdown.keyword(),
        control.on_output_outside.keyword(),
        control
            .on_gateway_lost
            .map_or_else(String::new, |lost| format!(
                "; other gateway lost: {}",
                lost.keyword()
            ))
    )?;
    capabilities(text, control, model)?;
    start(text, model)?;
    if let Some(warning) = takes_control(model) {
        writeln!(text, "    warning: {warning}")?;
    }
    Ok(())
}

/// How long the drive may take to follow the words before the run word, and the pauses of a reset.
fn start(text: &mut String, model: &Model) -> Result {
    let pauses = model.reset_waits();
    if !pauses.is_zero() {
        let pauses = duration_text(pauses);
        writeln!(
            text,
            "    pauses between the words of a reset: {pauses}; a stop does not wait for them"
        )?;
    }
    let count = model.start_steps().len();
    if count == 0 {
        return Ok(());
    }
    let waits = duration_text(model.start_waits());
    writeln!(
        text,
        "    writes before the run word: {count}, at most {waits} for the drive to follow them; a stop is one frame"
    )
}

/// Which clients may command while another one holds control, and what keeps control.
fn ownership(text: &mut String, control: &ControlSettings) -> Result {
    let who = match control.ownership {
        Ownership::One => "one commander at a time",
        Ownership::Any => "any permitted client; the one that commanded last holds control",
    };
    let take = if control.allow_take {
        ", and it may be taken over"
    } else {
        ""
    };
    let lease = format!("; {} lease over mqtt", word_for(&LEASES, &control.lease));
    writeln!(
        text,
        "    {who}{take}{}",
        if control.from_mqtt { &lease } else { "" }
    )?;
    if control.min_start_interval > Duration::ZERO {
        writeln!(
            text,
            "    at least {} between two starts",
            duration_text(control.min_start_interval)
        )?;
    }
    Ok(())
}

/// What the drive can be ordered, and what of that is refused or rests on an acceptance.
fn capabilities(text: &mut String, control: &ControlSettings, model: &Model) -> Result {
    let orders = orders(model).unwrap_or_default();
    // Stop, frequency and forward are accepted under one word.
    let is_accepted = |word: &str| {
        let word = if BASICS.contains(&word) {
            ControlAction::Basic.keyword()
        } else {
            word
        };
        control
            .accept_unverified
            .iter()
            .any(|action| action.keyword() == word)
    };
    let is_wanted = |word: &str| match word {
        "release" => control.allow_release,
        word => DIRECTIONS
            .iter()
            .all(|(name, it)| *name != word || control.directions.contains(it)),
    };
    let wanted = orders.into_iter().filter(|(word, _)| is_wanted(word));
    let (open, closed): (Vec<_>, Vec<_>) =
        wanted.partition(|(word, confidence)| confidence.is_proven() || is_accepted(word));
    let words: Vec<_> = open.iter().map(|(word, _)| *word).collect();
    writeln!(text, "    can be ordered: {}", list(&words))?;
    let site = &control.site.actions;
    let words = |is_site: bool| {
        let those = control
            .accept_unverified
            .iter()
            .filter(|action| site.contains(action) == is_site);
        those.map(|action| action.keyword()).collect::<Vec<_>>()
    };
    let accepted = words(false);
    if !accepted.is_empty() {
        writeln!(text, "    unproven and accepted: {}", list(&accepted))?;
    }
    let qualified = words(true);
    if !qualified.is_empty() {
        writeln!(
            text,
            "    unproven, and qualified at this drive (site): {}",
            list(&qualified)
        )?;
    }
    if !closed.is_empty() {
        let closed: Vec<_> = closed
            .iter()
            .map(|(word, sure)| format!("{word} ({})", sure.keyword()))
            .collect();
        writeln!(text, "    unproven and refused: {}", list(&closed))?;
    }
    Ok(())
}

fn native(text: &mut String, control: &ControlSettings, model: &Model) -> Result {
    if control.native_write.is_empty() {
        return Ok(());
    }
    writeln!(text, "    native registers that may be written:")?;
    for listed in control
        .native_write
        .iter()
        .filter_map(|address| listed(model, *address))
    {
        writeln!(
            text,
            "      {} (0x{:04X}): {}",
            listed.register.name,
            listed.address,
            memory(listed)
        )?;
    }
    Ok(())
}

fn memory(listed: ListedRegister<'_>) -> &'static str {
    let is_itself = listed.register.address == listed.address;
    match (listed.twin_of, listed.register.memory) {
        (None, _) if !is_itself => "in RAM",
        (Some(_), _) | (None, Some(RegisterMemory::Stored)) => {
            "stored, in a memory that endures a limited number of writes"
        }
        (None, Some(RegisterMemory::Ram)) => "in RAM",
        (None, None) => "not known to be RAM: treated as stored",
    }
}

/// What the gateway cannot do on a drive of which a function is wired.
fn wired(text: &mut String, bus: BusFunctions) -> Result {
    match bus {
        BusFunctions::Both => Ok(()),
        BusFunctions::Frequency => {
            writeln!(
                text,
                "    only the setpoint comes over the bus: the drive is started and stopped elsewhere,"
            )?;
            writeln!(
                text,
                "    and a STOP that is sent may have no effect (`not_effective` then)"
            )
        }
        BusFunctions::Run => writeln!(
            text,
            "    only run commands come over the bus: the speed is set elsewhere"
        ),
    }
}

/// What must be set at a drive of `model` on `line`, in order.
pub(super) fn settings<'m>(
    model: &'m Model,
    line: &LineSettings,
    bus: BusFunctions,
) -> impl Iterator<Item = &'m SetupItem> {
    let interface = line.interface;
    let is_of_line = move |item: &&SetupItem| item.interface.is_none_or(|it| it == interface);
    model
        .setup
        .iter()
        .filter(is_of_line)
        .filter(move |item| item.concerns(model, bus))
}

fn setup(text: &mut String, model: &Model, line: &LineSettings, bus: BusFunctions) -> Result {
    let items: Vec<_> = settings(model, line, bus).collect();
    if !items.is_empty() {
        writeln!(text, "    must be set on the drive, in this order:")?;
    }
    for item in items {
        let place = item.address.map_or_else(
            || "at the drive itself".to_owned(),
            |address| {
                format!(
                    "{address} = {}",
                    item.values.value.first().copied().unwrap_or_default()
                )
            },
        );
        writeln!(text, "      {}: {} ({place})", item.what, item.text)?;
    }
    Ok(())
}

/// The least request rate of the drive, its watchdog and the lease, in relation to each other.
fn watchdog_chain(
    text: &mut String,
    line: &LineSettings,
    drive: &DriveSettings,
    gap: Duration,
) -> Result {
    let Some(control) = &drive.control else {
        return Ok(());
    };
    writeln!(
        text,
        "    its frames are at most {} apart while it answers; its own watchdog, where it",
        ms(gap)
    )?;
    writeln!(text, "    is used, needs more than {}", ms(gap * 2))?;
    let lost_after = duration_text(control.lost_after);
    let confirm = duration_text(control.failsafe_confirm_timeout);
    if let Some(time) = control.watchdog {
        let time = duration_text(time);
        writeln!(
            text,
            "    twice {} < watchdog {time} <= lease {lost_after}",
            ms(gap)
        )?;
    }
    if control.require_watchdog {
        writeln!(
            text,
            "    run only while its watchdog is on, more than {} and at most {}",
            ms(gap * 2),
            duration_text(control.watchdog_at_most())
        )?;
    }
    if drive.model.watchdog_is_proven() {
        writeln!(
            text,
            "    a declared stop without effect for {confirm} is left to its watchdog, if that is on"
        )?;
    }
    if let Some(warning) = feeds_watchdog(&drive.model, control) {
        writeln!(text, "    warning: {warning}")?;
    }
    match (
        trips_first(line, drive),
        control.watchdog.and(line.standby.as_ref()),
    ) {
        (Some(warning), _) => writeln!(text, "    warning: {warning}"),
        (None, Some(_)) => writeln!(
            text,
            "    its own watchdog does not act before the line is taken over"
        ),
        (None, None) => Ok(()),
    }
}

fn watchdog_of(text: &mut String, watchdog: &ModelWatchdog, model: &Model) -> Result {
    let called = |address: Address| {
        let register = model.register_at(address);
        let name = register.map_or("-", |register| {
            register.code.as_deref().unwrap_or(&register.name)
        });
        format!("{name} ({address})")
    };
    write!(
        text,
        "    the drive's own watchdog: {}, {} is off",
        called(watchdog.time),
        watchdog.off.value
    )?;
    match watchdog.action {
        Some(action) => writeln!(text, "; what it does then: {}", called(action)),
        None => writeln!(text),
    }
}

#[cfg(test)]
mod tests {
    use super::start;
    use crate::config;
    use crate::profile::catalog::Catalog;

    const CONFIGURATION: &str = r#"
[[line]]
name = "hall-1"
port = "/dev/ttyUSB0"
[[line.drive]]
name = "pump-1"
model = "acme-everything"
station = 1
[[line.drive.register]]
name = "ramp"
title = "Ramp"
address = 0x0110
unit = "s"
access = "read-write"
[line.drive.control]
from = ["modbus-tcp"]
frequency_hz = { min = 5.0, max = 50.0 }
accept_unverified = ["coast"]
allow_release = true
on_commander_lost = "stop"
lost_after = "10s"
on_shutdown = "hold"
[line.drive.native]
write = ["ramp", "0x8110"]
[[modbus_tcp]]
listen = "127.0.0.1:1502"
write = ["127.0.0.1/32"]
"#;

    #[test]
    fn a_start_in_several_words_is_reported_with_its_bound() {
        let model = crate::profile::check::model(include_str!(
            "../../../../tests/golden/models/start.toml"
        ))
        .unwrap();
        let mut text = String::new();
        start(&mut text, &model).unwrap();
        let expected = "    writes before the run word: 2, at most 4100ms for the drive to follow them; a stop is one frame\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn a_drive_is_reported_with_all_that_its_model_demands() {
        let model = include_str!("../../../../tests/golden/models/everything.toml");
        let catalog = Catalog::from_texts([("everything.toml", model)]).unwrap();
        let said = |text: &str| super::super::report(&config::load(text, &catalog).unwrap());
        let expected = "
    current is shown only in per cent: set rated_current_a
    commands from modbus-tcp: 5.00 to 50.00 Hz, forward
    command deadline 1s < lease 10s
    one commander at a time
    commander lost after 10s: stop; gateway ended: hold; output outside limits: alarm
    can be ordered: stop, frequency, forward, coast, release
    unproven and accepted: coast
    unproven and refused: reset (inferred)
    warning: every command, a stop too, takes control from panel and terminals (bits 0xC000)
    native registers that may be written:
      ramp (0x0110): not known to be RAM: treated as stored
      ramp (0x8110): stored, in a memory that endures a limited number of writes
    must be set on the drive, in this order:
      P.01: run commands from the bus (0x0101 = 2)
    the drive's own watchdog: P.06 (0x0106), 0 is off; what it does then: P.07 (0x0107)
    its frames are at most 3211 ms apart while it answers; its own watchdog, where it
    is used, needs more than 6422 ms
    a declared stop without effect for 5s is left to its watchdog, if that is on

";
        let found = said(CONFIGURATION);
        assert!(found.contains(expected), "{found}");
        assert!(
            found.contains("every 3600 s a read of 0x3009 x1 (firmware)"),
            "{found}"
        );

        let rs232 = said(&CONFIGURATION.replace("port =", "interface = \"rs232\"\nport ="));
        assert!(
            rs232.contains("      S1: the switch beside the plug: up (at the drive itself)\n"),
            "{rs232}"
        );
        let rated =
            said(&CONFIGURATION.replace("station = 1", "station = 1\nrated_current_a = 12.5"));
        assert!(!rated.contains("per cent"), "{rated}");

        let (drive, rest) = CONFIGURATION.split_once("[line.drive.control]").unwrap();
        let (_, listener) = rest.split_once("[[modbus_tcp]]").unwrap();
        let listener = listener.replace("write = [\"127.0.0.1/32\"]\n", "");
        let read_only = said(&format!("{drive}[[modbus_tcp]]{listener}"));
        assert!(
            read_only.contains("watchdog") && !read_only.contains("ordered"),
            "{read_only}"
        );
    }
}
