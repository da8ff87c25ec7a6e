//! `check`: all problems of a configuration at once, or what each of its lines will cost. Opens nothing.

use super::{Failure, input, print};
use crate::config::words::{DIRECTIONS, LEASES};
use crate::config::{Config, DriveSettings, LineSettings, ListenerSettings, MqttSettings, command_deadline};
use crate::daemon::build;
use crate::domain::control::ControlSettings;
use crate::domain::link::Framing;
use crate::line::budget::{ASSUMED_TURNAROUND, Budget};
use crate::profile::model::Model;
use crate::profile::values::duration_text;
use crate::profile::words::word_for;
use std::fmt::{Display, Write};
use std::path::PathBuf;
use std::time::Duration;

/// Arguments of `check`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The configuration file
    #[arg(short, long, value_name = "FILE")]
    config: PathBuf,
}

/// Checks the configuration and prints what it means.
pub fn check(args: &Args) -> Result<(), Failure> {
    let config = input::configuration(&args.config)?;
    print(&report(&config))
}

/// What a sound configuration means, line by line.
fn report(config: &Config) -> String {
    let mut text = String::new();
    for line in &config.lines {
        let _ = describe_line(&mut text, line, config.mqtt.as_ref());
    }
    for listener in &config.listeners {
        let _ = writeln!(text, "{}", of_listener(listener));
    }
    if let Some(mqtt) = &config.mqtt {
        let _ = writeln!(text, "{}", of_mqtt(mqtt, config));
    }
    if let Some(http) = &config.http {
        let _ = writeln!(text, "HTTP on {}", http.listen);
    }
    text
}

fn of_listener(listener: &ListenerSettings) -> String {
    let write = list(&listener.write);
    let stop = listener.stop.as_ref().map_or_else(|| write.clone(), |stop| list(stop));
    let rights = match (write.is_empty(), stop.is_empty()) {
        (true, true) => "read-only".to_owned(),
        (true, false) => format!("read-only, except that {stop} may stop"),
        (false, _) if write == stop => format!("{write} may write and stop"),
        (false, _) => format!("{write} may write, {stop} may stop"),
    };
    let renew = if listener.reads_renew { "; reads renew a lease" } else { "" };
    format!("Modbus TCP on {}: {rights}{renew}", listener.listen)
}

fn of_mqtt(mqtt: &MqttSettings, config: &Config) -> String {
    let gateway = config.gateway.name.as_ref().map_or("(name of this host)", |name| name.as_str());
    format!(
        "MQTT at {}: topics under {}/{gateway}, {} leases",
        mqtt.broker,
        mqtt.prefix,
        word_for(&LEASES, &mqtt.lease)
    )
}

/// The values with commas between them.
fn list<T: Display>(values: &[T]) -> String {
    values.iter().map(T::to_string).collect::<Vec<_>>().join(", ")
}

fn describe_line(text: &mut String, line: &LineSettings, mqtt: Option<&MqttSettings>) -> std::fmt::Result {
    let (timing, needs_pty) = build::timing(line);
    let budget = build::budget(line);
    let framing = if line.framing == Framing::Ascii { ", ASCII frames" } else { "" };
    writeln!(text, "line {} on {}: {}{framing}", line.name, line.port.display(), line.link)?;
    write!(text, "  silence before each frame {}", ms(timing.silence))?;
    writeln!(text, "{}", if needs_pty { " (shorter than the drives need: pseudo-terminal only)" } else { "" })?;
    writeln!(
        text,
        "  polls use {:.1} % of the line, at an assumed turnaround of {} where a model documents none",
        budget.use_of_line * 100.0,
        ms(ASSUMED_TURNAROUND)
    )?;
    if budget.stretch > 1.0 {
        writeln!(text, "  warning: the plan is over-full; every period is stretched {:.2} times", budget.stretch)?;
    }
    writeln!(text, "  a stop starts at most {} after it is accepted", ms(build::worst_stop(line)))?;
    for drive in &line.drives {
        describe_drive(text, drive, &budget)?;
        if let Some(control) = &drive.control {
            describe_control(text, control, &drive.model, mqtt)?;
        }
    }
    writeln!(text)
}

fn describe_drive(text: &mut String, drive: &DriveSettings, budget: &Budget) -> std::fmt::Result {
    let (name, model) = (&drive.name, &drive.model.id);
    let access = if drive.control.is_some() { "controlled" } else { "read-only" };
    let units = format!("unit {}, uniform unit {}", drive.unit, drive.uniform_unit);
    writeln!(text, "  drive {name}: {model}, station {}, {units}, {access}", drive.station)?;
    for (group, read) in build::planned(drive) {
        let period = read.period.mul_f64(budget.stretch);
        let age = period + budget.longest_exchange * 2;
        let names: Vec<_> = (0..group.count)
            .filter_map(|offset| drive.model.register_at(group.address.wrapping_add(offset)))
            .map(|register| register.name.as_str())
            .collect();
        writeln!(
            text,
            "    every {} a read of 0x{:04X} x{} ({}), age at most about {}",
            ms(period),
            group.address,
            group.count,
            names.join(", "),
            ms(age)
        )?;
    }
    Ok(())
}

fn describe_control(
    text: &mut String,
    control: &ControlSettings,
    model: &Model,
    mqtt: Option<&MqttSettings>,
) -> std::fmt::Result {
    let ways = [(control.from_mqtt, "mqtt"), (control.from_modbus_tcp, "modbus-tcp")];
    let ways: Vec<_> = ways.into_iter().filter_map(|(is_there, way)| is_there.then_some(way)).collect();
    let directions: Vec<_> = control.directions.iter().map(|it| word_for(&DIRECTIONS, it)).collect();
    let lost_after = duration_text(control.lost_after);
    writeln!(
        text,
        "    commands from {}: {} to {} Hz, {}",
        list(&ways),
        control.least,
        control.most,
        list(&directions)
    )?;
    writeln!(
        text,
        "    commander lost after {lost_after}: {}; gateway ended: {}",
        control.on_commander_lost.word(),
        control.on_shutdown.word()
    )?;
    let accepted: Vec<_> = control.accept_unverified.iter().map(|action| action.word()).collect();
    if !accepted.is_empty() {
        writeln!(text, "    unproven and accepted: {}", list(&accepted))?;
    }
    let registers = control.native_write.iter().filter_map(|address| model.register_at(*address));
    let registers: Vec<_> =
        registers.map(|register| format!("{} (0x{:04X})", register.name, register.address)).collect();
    if !registers.is_empty() {
        writeln!(text, "    native registers that may be written: {}", list(&registers))?;
    }
    let deadline = duration_text(command_deadline(control, mqtt));
    writeln!(text, "    command deadline {deadline} < lease {lost_after}")
}

fn ms(time: Duration) -> String {
    let millis = time.as_secs_f64() * 1000.0;
    if millis >= 100.0 { format!("{millis:.0} ms") } else { format!("{millis:.2} ms") }
}
