//! Builds from the configuration what the line threads need.

use crate::config::{Config, DriveSettings, LineSettings, line_plan};
use crate::daemon::exchange::shared::{SharedLine, SharedPlant, StandbyShare};
use crate::daemon::line_thread::LinePort;
use crate::daemon::port::PortSettings;
use crate::domain::ids::DriveIndex;
use crate::domain::link::Wiring;
use crate::domain::report::LineReport;
use crate::domain::standby::{LineRole, StandbyReport, StandbyTrouble};
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::plan::PollPace;
use crate::gateway::{DriveSetup, LineSetup};
use crate::journal::RememberedDrive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The core of a line. `first_epoch` must be different at each start of the gateway. `keeps` is whether there is a
/// journal, whose remembered state is not known yet; `joins_late` whether commands are accepted already.
#[must_use]
pub fn line_setup(
    line: &LineSettings,
    first_epoch: u64,
    keeps: bool,
    joins_late: bool,
) -> LineSetup {
    let drives = line.drives.iter().map(drive_setup).collect();
    let tells_traffic = tracing::enabled!(tracing::Level::TRACE);
    LineSetup {
        timing: line_plan::timing(line).0,
        drives,
        echo: line.echo,
        tells_traffic,
        first_epoch,
        asked_before: true,
        joins_late,
        standby: line
            .standby
            .as_ref()
            .map(|pair| line_plan::standby_times(line, pair)),
        keeps,
    }
}

/// What lines and north sides share, with lines that are not served yet.
#[must_use]
pub fn shared(config: &Config) -> SharedPlant {
    let lines = (0..)
        .zip(&config.lines)
        .map(|(number, line)| Arc::new(shared_line(number, line)));
    SharedPlant::of(lines.collect(), Arc::default()).titled(&config.titles)
}

/// What one line and the north sides share, before the line is served, with a `number` that no other line of the
/// process has.
#[must_use]
pub fn shared_line(number: u16, line: &LineSettings) -> SharedLine {
    let stretch = line_plan::budget(line).stretch;
    let drives = (0..).zip(&line.drives).map(|(index, drive)| {
        let place = DriveRef {
            line: number,
            drive: DriveIndex(index),
        };
        description(place, line, drive, stretch)
    });
    let standby = line.standby.clone().map(|pair| StandbyShare {
        times: line_plan::standby_times(line, &pair),
        pair,
    });
    let shared =
        SharedLine::new(number, line.name.clone(), line.interface, drives).wired(wiring(line));
    if standby.is_some() {
        // Before the first report of its thread it must not be taken for the only gateway there.
        let role = LineRole::Listening;
        let standby = StandbyReport {
            role,
            take_overs: 0,
            given_up: 0,
            rivals: 0,
            hears_other: false,
            listener: None,
            kept: 0,
            trouble: StandbyTrouble::default(),
        };
        shared.set_report(LineReport {
            standby: Some(standby),
            ..LineReport::default()
        });
    }
    shared.shared_with(standby)
}

fn wiring(line: &LineSettings) -> Wiring {
    let stations = line.drives.iter().map(|drive| drive.station).collect();
    Wiring {
        port: line.port.to_string(),
        link: line.link,
        framing: line.framing,
        stations,
    }
}

/// Values age by the period that an overloaded line can actually keep.
fn description(
    place: DriveRef,
    line: &LineSettings,
    drive: &DriveSettings,
    stretch: f64,
) -> DriveDescription {
    DriveDescription {
        place,
        name: drive.name.clone(),
        line: line.name.clone(),
        model: Arc::clone(&drive.model),
        unit: drive.unit,
        uniform_unit: drive.uniform_unit,
        group: drive.group.clone(),
        pace: PollPace::new(drive.poll, stretch),
        ratings: drive.ratings,
        control: drive.control.clone(),
        points: drive.points.clone(),
    }
}

/// The port side of a line of the gateway whose data is in `data_dir`.
#[must_use]
pub fn line_port(line: &LineSettings, data_dir: Option<&Path>) -> LinePort {
    LinePort {
        line: line.name.to_string(),
        drives: line
            .drives
            .iter()
            .map(|drive| drive.name.to_string())
            .collect(),
        settings: PortSettings {
            line: line.name.to_string(),
            address: line.port.clone(),
            link: line.link,
            direction: line.direction,
            low_latency: line.low_latency,
            needs_virtual: line_plan::timing(line).1,
            lock_dirs: lock_dirs(data_dir),
        },
    }
}

/// Directories for the locks of serial devices: where terminal programs look for them, then one that an unprivileged
/// gateway may write.
#[must_use]
pub fn lock_dirs(data_dir: Option<&Path>) -> Vec<PathBuf> {
    let of_session = std::env::var_os("XDG_RUNTIME_DIR")
        .map(PathBuf::from)
        .filter(|dir| dir.is_absolute());
    [PathBuf::from("/run/lock")]
        .into_iter()
        .chain(of_session)
        .chain(data_dir.map(Path::to_owned))
        .collect()
}

fn drive_setup(drive: &DriveSettings) -> DriveSetup {
    DriveSetup {
        station: drive.station,
        model: Arc::clone(&drive.model),
        poll: drive.poll,
        timeouts: line_plan::reply_timeouts(drive),
        max_lateness: drive.max_lateness,
        control: drive.control.clone(),
        remembered: RememberedDrive::default(),
    }
}
