//! `demo`: everything at once on loopback, with nothing else installed.

use super::{Failure, input, print};
use crate::config;
use crate::daemon::pty::Pty;
use crate::daemon::run::{self as daemon, StartError, told_to_end};
use crate::daemon::simulator;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, Role};
use crate::sim::{BusOptions, DriveOptions, SimBus, SimDrive};
use crate::wire::pdu::Request;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Arguments of `demo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Port for Modbus TCP on 127.0.0.1; if it is taken, another one is found
    #[arg(long, default_value_t = 1502)]
    port: u16,
}

/// Plays a drive that runs up and down, with the gateway in front of it, until SIGINT or SIGTERM.
pub fn demo(args: &Args) -> Result<(), Failure> {
    let catalog = input::catalog()?;
    let id = catalog.ids().next().ok_or_else(|| Failure::failed("no model is built in"))?;
    let model = catalog.find(id).cloned().ok_or_else(|| Failure::failed("no model is built in"))?;
    let pty = Pty::new().map_err(Failure::failed)?;
    let station = Station(1);
    let mut bus = SimBus::new(model.link.default.value, BusOptions::default(), 1);
    bus.connect(station, SimDrive::new(Arc::clone(&model), DriveOptions::default()));
    let end = AtomicBool::new(false);
    let mut operator = Operator { station, begun: None, running: None };
    std::thread::scope(|scope| {
        let player = scope.spawn(|| simulator::play(&pty, &mut bus, &end, |bus, at| operator.look(bus, at)));
        let done = gateway(args.port, &pty, &model);
        end.store(true, Ordering::Relaxed);
        let played = player.join().unwrap_or_else(|_| Err(std::io::Error::other("the simulator panicked")));
        done.and(played.map_err(Failure::failed))
    })
}

/// The gateway in front of the simulated line; on another port if the wanted one is taken.
fn gateway(port: u16, pty: &Pty, model: &Model) -> Result<(), Failure> {
    match serve(port, pty.path(), model) {
        Err(StartError::Listen { address, error }) if error.kind() == std::io::ErrorKind::AddrInUse => {
            print(&format!("{address} is taken; another port is used\n"))?;
            serve(0, pty.path(), model)
        }
        other => other,
    }
    .map_err(Failure::failed)
}

fn serve(port: u16, device: &Path, model: &Model) -> Result<(), StartError> {
    let text = configuration(port, device, model);
    let config = input::catalog()
        .ok()
        .and_then(|catalog| config::load(&text, &catalog).ok())
        .ok_or_else(|| StartError::System(std::io::Error::other("the demo's own configuration is refused")))?;
    daemon::run(&config, async |running| {
        let told = match told_to_end() {
            Ok(told) => told,
            Err(error) => return tracing::error!(%error, "cannot wait for Ctrl-C"),
        };
        if let Some(address) = running.listening.first() {
            // Whoever reads the output may be gone; the demo goes on.
            let _ = print(&welcome(*address, device, model));
        }
        told.await;
    })
}

fn configuration(port: u16, device: &Path, model: &Model) -> String {
    format!(
        "[[line]]\nname = \"demo\"\nport = \"{}\"\n\n[[line.drive]]\nname = \"pump-1\"\nmodel = \"{}\"\n\
         station = 1\n\n[[modbus_tcp]]\nlisten = \"127.0.0.1:{port}\"\n",
        device.display(),
        model.id
    )
}

fn welcome(address: SocketAddr, device: &Path, model: &Model) -> String {
    let place = |role| model.register_for(role).map_or(0, |register| register.address);
    let (port, ip) = (address.port(), address.ip());
    let output = place(Role::OutputFrequency);
    let setting = place(Role::FrequencySetting);
    format!(
        "vfd-gateway demo: one simulated {} {} (station 1) on {}, running up and down\n\
         Modbus TCP on {address}, unit 1, read-only\n\n\
         Try in another terminal (mbpoll counts addresses from 0 with -0):\n\
         \x20 mbpoll -0 -a 1 -t 4 -r {output} -c 1 -p {port} {ip}        # output frequency, 0.01 Hz\n\
         \x20 mbpoll -0 -a 1 -t 4 -r {setting} -c 1 -1 -p {port} {ip}  # frequency setting, once\n\n\
         Not a safety function. Ctrl-C ends it.\n",
        model.vendor,
        model.title,
        device.display()
    )
}

/// Somebody who commands the simulated drive past the gateway, which is read-only: at once up for 30 s, then down
/// for 30 s, and so on.
struct Operator {
    station: Station,
    begun: Option<MonoTime>,
    running: Option<bool>,
}

impl Operator {
    fn look(&mut self, bus: &mut SimBus, at: MonoTime) {
        let begun = *self.begun.get_or_insert(at);
        let running = (at.since(begun).as_secs() / 30).is_multiple_of(2);
        if self.running.replace(running) == Some(running) {
            return;
        }
        let Some(drive) = bus.drive_mut(self.station) else { return };
        let Some(run) = drive.model().run.clone() else { return };
        let command = if running { run.forward.value } else { run.stop.value };
        for (role, value) in [(Role::FrequencyCommand, 5000), (Role::RunCommand, command)] {
            if let Some(address) = drive.model().register_for(role).map(|register| register.address) {
                let mut pdu = Vec::new();
                Request::WriteSingle { address, value }.encode(&mut pdu);
                drive.obey(at, &pdu);
            }
        }
    }
}
