//! `check`: all problems of a configuration at once, or what each of its lines will cost. Opens nothing.

mod drive;

use super::{Failure, input, print};
use crate::config::words::LEASES;
use crate::config::{Config, LineSettings, ListenerSettings, MqttSettings, PortAddress};
use crate::daemon::build;
use crate::domain::link::{DirectionControl, Framing, Interface};
use crate::line::budget::ASSUMED_TURNAROUND;
use crate::profile::words::{INTERFACES, word_for};
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
    let (timing, needs_virtual) = build::timing(line);
    let budget = build::budget(line);
    let framing = if line.framing == Framing::Ascii { ", ASCII frames" } else { "" };
    writeln!(text, "line {} on {}: {}{framing}", line.name, line.port, line.link)?;
    writeln!(text, "  {}", of_port(line))?;
    write!(text, "  silence before each frame {}", ms(timing.silence))?;
    writeln!(
        text,
        "{}",
        if needs_virtual { " (shorter than the drives need: pseudo-terminal or tcp:// only)" } else { "" }
    )?;
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
        drive::describe(text, drive, line, &budget, mqtt)?;
    }
    writeln!(text)
}

/// What the line is reached through.
fn of_port(line: &LineSettings) -> String {
    let PortAddress::Device(_) = line.port else {
        let lateness_s = line.port.max_lateness().as_secs();
        return format!(
            "network: frames go to a serial device server, whose line is set to {}; a reply may be {lateness_s} s late",
            line.link
        );
    };
    let interface = word_for(&INTERFACES, &line.interface);
    let direction = match (line.interface, line.direction) {
        (Interface::Rs232, _) => "",
        (_, DirectionControl::Adapter) => ", direction turned by the adapter",
        (_, DirectionControl::Kernel) => ", direction turned by the driver (TIOCSRS485)",
        (_, DirectionControl::Rts) => ", direction turned by the gateway with RTS",
    };
    let latency = if line.low_latency { "asked for" } else { "left as it is" };
    format!("serial device: {interface}{direction}; low latency {latency}")
}

fn ms(time: Duration) -> String {
    let millis = time.as_secs_f64() * 1000.0;
    if time >= Duration::from_secs(10) {
        format!("{:.0} s", time.as_secs_f64())
    } else if millis >= 100.0 {
        format!("{millis:.0} ms")
    } else {
        format!("{millis:.2} ms")
    }
}
