//! From the configuration to what the line threads need.

use super::line_thread::LinePort;
use super::shared::Shared;
use crate::config::{Config, DriveSettings, LineSettings, Silence};
use crate::domain::ids::DriveIndex;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::gateway::{DriveSetup, LineSetup};
use crate::line::budget;
use crate::line::timing::Timing;
use std::sync::Arc;
use std::time::Duration;

/// Times of a line, and whether they are allowed only on a pseudo-terminal.
#[must_use]
pub fn timing(line: &LineSettings) -> (Timing, bool) {
    let gaps = line.drives.iter().map(|drive| drive.model.timing.gap_chars.value);
    let needed = Timing::for_models(line.link, gaps, line.min_request_gap);
    match line.silence {
        Silence::Fixed(silence) if silence < needed.silence => (Timing::unpaced(line.link, silence), true),
        Silence::Fixed(silence) => (Timing { silence, ..needed }, false),
        Silence::Auto => (needed, false),
    }
}

/// The pure side of a line, at a start of the gateway that no other start shares `first_epoch` with.
#[must_use]
pub fn line_setup(line: &LineSettings, first_epoch: u64) -> LineSetup {
    let drives = line.drives.iter().map(drive_setup).collect();
    let tells_traffic = tracing::enabled!(tracing::Level::TRACE);
    LineSetup { timing: timing(line).0, drives, tells_traffic, first_epoch }
}

/// Longest time from the acceptance of a stop for one drive of `line` to its first bit.
#[must_use]
pub fn worst_stop(line: &LineSettings) -> Duration {
    let drives = line.drives.iter().map(|drive| (reply_timeout(drive), drive.model.read.max_words.value));
    budget::worst_stop(&timing(line).0, drives)
}

fn reply_timeout(drive: &DriveSettings) -> Duration {
    drive.reply_timeout.unwrap_or(drive.model.timing.reply_timeout_cap.value)
}

/// What lines and north sides share.
#[must_use]
pub fn shared(config: &Config) -> Shared {
    let drives = (0..).zip(&config.lines).flat_map(|(number, line)| {
        (0..).zip(&line.drives).map(move |(index, drive)| {
            let place = DriveRef { line: number, drive: DriveIndex(index) };
            description(place, line, drive)
        })
    });
    Shared::new(config.lines.iter().map(|line| line.name.clone()).collect(), drives.collect())
}

fn description(place: DriveRef, line: &LineSettings, drive: &DriveSettings) -> DriveDescription {
    DriveDescription {
        place,
        name: drive.name.clone(),
        line: line.name.clone(),
        model: Arc::clone(&drive.model),
        unit: drive.unit,
        uniform_unit: drive.uniform_unit,
        poll: drive.poll,
        control: drive.control.clone(),
        dead_bands: drive.dead_bands.clone(),
    }
}

/// The port side of a line.
#[must_use]
pub fn line_port(line: &LineSettings) -> LinePort {
    LinePort {
        line: line.name.to_string(),
        drives: line.drives.iter().map(|drive| drive.name.to_string()).collect(),
        path: line.port.clone(),
        link: line.link,
        needs_pty: timing(line).1,
    }
}

fn drive_setup(drive: &DriveSettings) -> DriveSetup {
    DriveSetup {
        station: drive.station,
        model: Arc::clone(&drive.model),
        poll: drive.poll,
        reply_timeout: reply_timeout(drive),
        max_lateness: drive.max_lateness,
        control: drive.control.clone(),
    }
}
