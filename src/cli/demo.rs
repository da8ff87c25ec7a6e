//! `demo`: everything at once on loopback, with nothing else installed.

use super::{Failure, input, print};
use crate::config;
use crate::daemon::pty::Pty;
use crate::daemon::run::{self as daemon, Running, StartError, told_to_end};
use crate::daemon::simulator;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::profile::model::Model;
use crate::sim::{BusOptions, DriveOptions, SimBus, SimDrive};
use std::fmt::Write as _;
use std::io::{self, BufRead};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

const STATION: Station = Station(1);
/// Cause number of the trips. Any will do: what the numbers mean is not known for every model.
const TRIP_CAUSE: u16 = 1;

/// Arguments of `demo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Port for Modbus TCP on 127.0.0.1; if it is taken, another one is found
    #[arg(long, default_value_t = 1502)]
    port: u16,
    /// Port for HTTP (/metrics, /healthz) on 127.0.0.1; if it is taken, another one is found
    #[arg(long, default_value_t = 8080)]
    http_port: u16,
}

/// Plays a drive with the gateway and a broker in front of it, until SIGINT or SIGTERM.
pub fn demo(args: &Args) -> Result<(), Failure> {
    let catalog = input::catalog()?;
    let id = catalog.ids().next().ok_or_else(|| Failure::failed("no model is built in"))?;
    let model = catalog.find(id).cloned().ok_or_else(|| Failure::failed("no model is built in"))?;
    let pty = Pty::new().map_err(Failure::failed)?;
    let mut bus = SimBus::new(model.link.default.value, BusOptions::default(), 1);
    bus.connect(STATION, SimDrive::new(Arc::clone(&model), DriveOptions::default()));
    let trips = Arc::new(AtomicU32::new(0));
    listen_for_enter(Arc::clone(&trips)).map_err(Failure::failed)?;
    let trip = |bus: &mut SimBus, at: MonoTime| {
        if trips.swap(0, Ordering::Relaxed) > 0
            && let Some(drive) = bus.drive_mut(STATION)
        {
            drive.trip(at, TRIP_CAUSE);
        }
    };
    let done = simulator::play_beside(&pty, &mut bus, trip, || gateway(args, &pty, &model));
    done.map_err(Failure::failed)?
}

/// Counts lines on stdin: whoever presses Enter trips the drive. The thread ends with stdin or with the program.
fn listen_for_enter(trips: Arc<AtomicU32>) -> io::Result<()> {
    let listen = move || {
        for _ in io::stdin().lock().lines().map_while(Result::ok) {
            trips.fetch_add(1, Ordering::Relaxed);
        }
    };
    std::thread::Builder::new().name("enter".to_owned()).spawn(listen).map(drop)
}

/// The gateway in front of the simulated line; on other ports if the wanted ones are taken.
fn gateway(args: &Args, pty: &Pty, model: &Model) -> Result<(), Failure> {
    let (mut modbus, mut http) = (args.port, args.http_port);
    loop {
        let error = match serve(modbus, http, pty.path(), model) {
            Err(StartError::Listen { address, error }) if error.kind() == io::ErrorKind::AddrInUse => address,
            other => return other.map_err(Failure::failed),
        };
        print(&format!("{error} is taken; another port is used\n"))?;
        match error.port() {
            port if port == modbus && modbus != 0 => modbus = 0,
            _ => http = 0,
        }
    }
}

fn serve(modbus: u16, http: u16, device: &Path, model: &Model) -> Result<(), StartError> {
    let text = configuration(modbus, http, device, model);
    let config = input::catalog()
        .ok()
        .and_then(|catalog| config::load(&text, &catalog).ok())
        .ok_or_else(|| StartError::System(io::Error::other("the demo's own configuration is refused")))?;
    daemon::run(&config, async |running| {
        let told = match told_to_end() {
            Ok(told) => told,
            Err(error) => return tracing::error!(%error, "cannot wait for Ctrl-C"),
        };
        // Whoever reads the output may be gone; the demo goes on.
        let _ = print(&welcome(running, device, model));
        told.await;
    })
}

fn configuration(modbus: u16, http: u16, device: &Path, model: &Model) -> String {
    format!(
        r#"
[gateway]
name = "demo"

[[line]]
name = "demo"
port = "{}"

[[line.drive]]
name = "pump-1"
model = "{}"
station = {STATION}
unit = 1
uniform_unit = 101
poll = "250ms"

[line.drive.control]
from = ["mqtt", "modbus-tcp"]
frequency_hz = {{ min = 5.0, max = 50.0 }}
directions = ["forward", "reverse"]
on_commander_lost = "stop"
lost_after = "5s"
on_shutdown = "stop"

[mqtt]
broker = "embedded"

[[modbus_tcp]]
listen = "127.0.0.1:{modbus}"
write = ["127.0.0.1/32"]

[http]
listen = "127.0.0.1:{http}"
"#,
        device.display(),
        model.id
    )
}

fn welcome(running: &Running<'_>, device: &Path, model: &Model) -> String {
    let nowhere = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let modbus = running.listening.first().copied().unwrap_or(nowhere);
    let broker = running.broker.unwrap_or(nowhere);
    let http = running.http.unwrap_or(nowhere);
    let (title, device) = (format!("{} {}", model.vendor, model.title), device.display());
    let at_broker = format!("-h {} -p {}", broker.ip(), broker.port());
    let mut text = format!("vfd-gateway demo: one simulated {title}, pump-1, station {STATION} on {device}\n");
    // Writing to a String cannot fail.
    let _ = write!(
        text,
        "MQTT broker {broker}, topics under vfd/demo/\n\
         Modbus TCP {modbus}: unit 1 as the vendor describes it, unit 101 uniform\n\
         HTTP http://{http}/metrics, /healthz, /readyz\n\n\
         Try in other terminals:\n\
         \x20 mosquitto_sub {at_broker} -v -t 'vfd/demo/#'\n\
         \x20 mosquitto_pub {at_broker} -t vfd/demo/drive/pump-1/command -m '{{\"frequency_hz\": 42.5, \"run\": \"forward\"}}'\n\
         \x20 mbpoll -0 -a 101 -t 4 -r 0 -c 16 -p {} {}\n\n\
         Enter trips the drive; trip/reset with the payload reset clears that. If the broker ends, the drive is\n\
         stopped within 5 s. Not a safety function. Ctrl-C stops the drive and ends the demo.\n",
        modbus.port(),
        modbus.ip()
    );
    text
}
