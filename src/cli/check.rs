//! `check`: all problems of a configuration at once, or what each of its lines will cost. Opens nothing.

use super::{Failure, input, print};
use crate::config::{Config, DriveSettings, LineSettings};
use crate::daemon::build;
use crate::drive::plan::{self, PollGroup};
use crate::line::budget::{self, ASSUMED_TURNAROUND, Budget, PlannedRead};
use crate::line::timing::Timing;
use std::fmt::Write;
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
        let _ = describe_line(&mut text, line);
    }
    for listener in &config.listeners {
        let _ = writeln!(text, "Modbus TCP on {}: native units, read-only", listener.listen);
    }
    text
}

fn describe_line(text: &mut String, line: &LineSettings) -> std::fmt::Result {
    let (timing, needs_pty) = build::timing(line);
    let plan: Vec<_> = line.drives.iter().flat_map(|drive| planned(drive).map(|(_, read)| read)).collect();
    let budget = budget::of_plan(&timing, &plan);
    writeln!(text, "line {} on {}: {}", line.name, line.port.display(), line.link)?;
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
    let longest_wait = longest_exchange(&timing, line);
    writeln!(text, "  longest wait for an exchange in flight {}", ms(longest_wait))?;
    for drive in &line.drives {
        describe_drive(text, drive, &budget)?;
    }
    writeln!(text)
}

fn describe_drive(text: &mut String, drive: &DriveSettings, budget: &Budget) -> std::fmt::Result {
    let (name, model) = (&drive.name, &drive.model.id);
    writeln!(text, "  drive {name}: {model}, station {}, unit {}, read-only", drive.station, drive.unit)?;
    for (group, read) in planned(drive) {
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

fn planned(drive: &DriveSettings) -> impl Iterator<Item = (PollGroup, PlannedRead)> + '_ {
    let turnaround =
        drive.model.timing.processing_max.as_ref().map_or(ASSUMED_TURNAROUND, |processing| processing.value);
    plan::groups(&drive.model)
        .into_iter()
        .map(move |group| (group, PlannedRead { count: group.count, period: group.period(drive.poll), turnaround }))
}

/// The longest a frame may have to wait for the one before it: a full read whose reply stays out.
fn longest_exchange(timing: &Timing, line: &LineSettings) -> Duration {
    let of_drive = |drive: &DriveSettings| {
        let timeout = drive.reply_timeout.unwrap_or(drive.model.timing.reply_timeout_cap.value);
        budget::read_time(timing, drive.model.read.max_words.value, timeout)
    };
    line.drives.iter().map(of_drive).max().unwrap_or_default()
}

fn ms(time: Duration) -> String {
    let millis = time.as_secs_f64() * 1000.0;
    if millis >= 100.0 { format!("{millis:.0} ms") } else { format!("{millis:.2} ms") }
}
