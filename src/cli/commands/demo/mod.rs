//! `demo`: everything at once on loopback, without any other software.

mod data_dir;
pub mod plant;

use crate::cli::tools::keyboard::EnterPresses;
use crate::cli::tools::{CommandFailure, print};
use crate::config;
use crate::daemon::host::pty::Pty;
use crate::daemon::lines::simulator;
use crate::daemon::service::run::{self as daemon, RunningInfo};
use crate::daemon::service::signals::told_to_end;
use crate::daemon::service::start_error::StartError;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::north::operator::password::StoredHash;
use crate::sim::{BusOptions, DriveOptions, SimBus, SimDrive};
use crate::vendors;
use data_dir::DataDir;
use plant::DemoLine;
use std::fmt::Write as _;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Cause number of the trips. Any number will do: its meaning is not known for every model.
const TRIP_CAUSE: u16 = 1;

/// When the last drive trips by itself and when it is reset at its panel, so that the journal has something to show.
const TRIPS_AT: Duration = Duration::from_secs(10);
const RESET_AT: Duration = Duration::from_secs(20);

/// The user of the page. The password is printed, and works from this host only.
const USER: &str = "demo";
const PASSWORD: &str = "demo-demo";
/// Two demos may have the same hash: it protects nothing.
const SALT: [u8; 16] = [0; 16];

/// Arguments of `demo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Port for Modbus TCP on 127.0.0.1; if it is in use, another one is chosen
    #[arg(long, default_value_t = 1502)]
    port: u16,
    /// Port for HTTP (/metrics, /healthz) on 127.0.0.1; if it is in use, another one is chosen
    #[arg(long, default_value_t = 8080)]
    http_port: u16,
}

/// What the demo's gateway stands in front of, and where it keeps its journal.
#[derive(Clone, Copy)]
struct DemoPlant<'p> {
    lines: &'p [DemoLine],
    /// The pseudo-terminal of each line.
    devices: &'p [PathBuf],
    data_dir: &'p Path,
}

/// Simulates drives with the gateway and a broker in front of them, until SIGINT or SIGTERM.
pub fn demo(args: &Args) -> Result<(), CommandFailure> {
    let lines = plant::lines();
    let mut played = Vec::new();
    for line in &lines {
        let mut bus = SimBus::new(line.link, BusOptions::default(), 1);
        for drive in &line.drives {
            bus.connect(
                drive.station,
                SimDrive::new(Arc::clone(&drive.model), DriveOptions::default()),
            );
        }
        played.push((Pty::new().map_err(CommandFailure::failed)?, bus));
    }
    let devices: Vec<_> = played
        .iter()
        .map(|(pty, _)| pty.path().to_owned())
        .collect();
    let enter = EnterPresses::listen().map_err(CommandFailure::failed)?;
    let actors = DemoActors {
        first: lines
            .first()
            .and_then(|line| line.drives.first())
            .map(|drive| drive.station),
        last: lines
            .last()
            .and_then(|line| line.drives.last())
            .map(|drive| drive.station),
    };
    let data_dir = DataDir::make().map_err(CommandFailure::failed)?;
    let plant = DemoPlant {
        lines: &lines,
        devices: &devices,
        data_dir: data_dir.path(),
    };
    play(&mut played, &enter, actors, || gateway(args, plant)).map_err(CommandFailure::failed)?
}

/// The drives that do something of their own.
#[derive(Clone, Copy)]
struct DemoActors {
    /// The station on the first line that Enter trips.
    first: Option<Station>,
    /// The station on the last line that trips once, and is reset at its panel.
    last: Option<Station>,
}

/// Simulates every line as long as `work` lasts.
fn play<T>(
    lines: &mut [(Pty, SimBus)],
    enter: &EnterPresses,
    DemoActors { first, last }: DemoActors,
    work: impl FnOnce() -> T,
) -> io::Result<T> {
    let Some(((pty, bus), others)) = lines.split_first_mut() else {
        return Ok(work());
    };
    let of_this_line = if others.is_empty() { last } else { None };
    let mut story = TripStory::default();
    let act = |bus: &mut SimBus, at: MonoTime| {
        if let Some(station) = first
            && enter.was_pressed()
            && let Some(drive) = bus.drive_mut(station)
        {
            drive.trip(at, TRIP_CAUSE);
        }
        if let Some(drive) = of_this_line.and_then(|station| bus.drive_mut(station)) {
            story.go_on(drive, at);
        }
    };
    simulator::play_beside(&*pty, bus, act, || {
        play(others, enter, DemoActors { first: None, last }, work)
    })?
}

/// A trip that ends at the drive's own panel.
#[derive(Default)]
struct TripStory {
    begun: Option<MonoTime>,
    is_tripped: bool,
    is_over: bool,
}

impl TripStory {
    fn go_on(&mut self, drive: &mut SimDrive, at: MonoTime) {
        let since = at.since(*self.begun.get_or_insert(at));
        if !self.is_tripped && since >= TRIPS_AT {
            self.is_tripped = true;
            drive.trip(at, TRIP_CAUSE);
        }
        if !self.is_over && since >= RESET_AT {
            self.is_over = true;
            drive.clear_trip(at, None);
        }
    }
}

/// The gateway in front of the simulated lines; on other ports if the wanted ones are taken.
fn gateway(args: &Args, plant: DemoPlant<'_>) -> Result<(), CommandFailure> {
    let mut modbus = args.port;
    let mut http = args.http_port;
    loop {
        let error = match serve(modbus, http, plant) {
            Err(StartError::Listen { address, error })
                if error.kind() == io::ErrorKind::AddrInUse =>
            {
                address
            }
            other => return other.map_err(CommandFailure::failed),
        };
        print(&format!("{error} is taken; using another port\n"))?;
        match error.port() {
            port if port == modbus && modbus != 0 => modbus = 0,
            _ => http = 0,
        }
    }
}

fn serve(modbus: u16, http: u16, plant: DemoPlant<'_>) -> Result<(), StartError> {
    let text = configuration(modbus, http, plant);
    let config = config::load(&text, &vendors::catalog())
        .ok()
        .ok_or_else(|| {
            StartError::System(io::Error::other("the demo's own configuration is refused"))
        })?;
    daemon::run(&config, None, async |running| {
        let stop_signal = match told_to_end() {
            Ok(stop_signal) => stop_signal,
            Err(error) => return tracing::error!(%error, "cannot wait for Ctrl-C"),
        };
        // The reader of the output may be gone; the demo continues.
        let _ = print(&welcome(running, plant));
        stop_signal.await;
    })
}

fn configuration(modbus: u16, http: u16, plant: DemoPlant<'_>) -> String {
    let DemoPlant {
        lines,
        devices,
        data_dir,
    } = plant;
    format!(
        r#"
[gateway]
name = "demo"
data_dir = {data_dir:?}
{}
[mqtt]
broker = "embedded"
home_assistant = {{ discovery = true }}

[[modbus_tcp]]
listen = "127.0.0.1:{modbus}"
write = ["127.0.0.1/32"]

[http]
listen = "127.0.0.1:{http}"
{}"#,
        plant::configuration(
            lines.iter().zip(devices.iter().map(PathBuf::as_path)),
            &plant::FROM
        ),
        user(),
    )
}

/// The section of the user that may sign in.
fn user() -> String {
    let hash = StoredHash::make(PASSWORD, &SALT);
    let hash = hash.as_ref().map_or("", StoredHash::as_str);
    format!("\n[[http.users]]\nname = \"{USER}\"\npassword_hash = \"{hash}\"\n")
}

fn welcome(running: &RunningInfo<'_>, plant: DemoPlant<'_>) -> String {
    let DemoPlant {
        lines,
        devices,
        data_dir,
    } = plant;
    let nowhere = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let modbus = running.listening.first().copied().unwrap_or(nowhere);
    let broker = running.broker.unwrap_or(nowhere);
    let http = running.http.unwrap_or(nowhere);
    let at_broker = format!("-h {} -p {}", broker.ip(), broker.port());
    let first = lines
        .first()
        .and_then(|line| line.drives.first())
        .map_or("", |drive| &drive.name);
    let last = lines
        .last()
        .and_then(|line| line.drives.last())
        .map_or("", |drive| &drive.name);
    let mut text = String::from("vfd-gateway demo: simulated drives of several vendors\n");
    // Writing to a String cannot fail.
    let mut unit = 0;
    for (line, device) in lines.iter().zip(devices) {
        let _ = writeln!(
            text,
            "{} at {} on {}",
            line.name,
            line.link,
            device.display()
        );
        for drive in &line.drives {
            unit += 1;
            let title = format!("{} {}", drive.model.vendor, drive.model.title);
            let units = format!("unit {unit} native, {} uniform", unit + 100);
            let _ = writeln!(
                text,
                "  {:8} {title:20} station {:3} {units}",
                drive.name,
                drive.station.to_string()
            );
        }
    }
    let _ = write!(
        text,
        "MQTT broker {broker}, topics under vfd/demo/\n\
         Modbus TCP {modbus}\n\
         Page http://{http}/ beside /metrics, /healthz, /readyz; user {USER}, password {PASSWORD}\n\
         Journal in {}, removed at the end\n\n\
         Try in other terminals:\n\
         \x20 mosquitto_sub {at_broker} -v -t 'vfd/demo/#'\n\
         \x20 mosquitto_pub {at_broker} -t vfd/demo/drive/{first}/command -m '{{\"frequency_hz\": 42.5, \"run\": \"forward\"}}'\n\
         \x20 mbpoll -0 -a 101 -t 4 -r 0 -c 16 -p {} {}\n\n\
         Enter trips {first}; trip/reset with the payload reset clears that. {last} trips once after 10 s and is\n\
         reset at its panel. If the broker ends, every drive is stopped within 5 s. Not a safety function.\n\
         Ctrl-C stops the drives and ends the demo.\n",
        data_dir.display(),
        modbus.port(),
        modbus.ip()
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::DriveOptions;

    #[test]
    fn the_last_drive_trips_once_and_is_reset_at_its_panel() {
        let model = plant::lines().pop().unwrap().drives.pop().unwrap().model;
        let mut drive = SimDrive::new(model, DriveOptions::default());
        let mut story = TripStory::default();
        let begun = MonoTime::ZERO;
        let mut tripped = |seconds| {
            story.go_on(&mut drive, begun + Duration::from_secs(seconds));
            drive.is_tripped()
        };
        let seen = [0, 9, 10, 19, 20, 100].map(&mut tripped);
        assert_eq!(seen, [false, false, true, true, false, false]);
    }
}
