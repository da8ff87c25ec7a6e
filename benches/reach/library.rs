//! What a library of many models costs: thirty-two drives of one model against two drives each of sixteen makers, in memory and
//! in time to serve. The program and `VFD_GATEWAY` are those of `footprint`.

use crate::brokers::free_port;
use crate::footprint::{Memory, end, has_words, is_ready, program, start, until};
use crate::plant::Place;
use crate::table::{Row, Times};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::lines::simulator;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::{Framing, Parity};
use vfd_gateway::profile::model::Model;
use vfd_gateway::sim::{BusOptions, BusPacing, DriveOptions, SimBus, SimDrive};
use vfd_gateway::vendors;

/// One line for each model, with two drives.
const LINES: usize = 16;
const DRIVES: u8 = 2;
/// From the start of the process to the first Modbus answer.
const START_MS: f64 = 100.0;
/// What sixteen models may need beyond one.
const MORE_MB: f64 = 2.0;

pub fn library() -> Vec<Row> {
    let catalog = vendors::catalog();
    let one = catalog.find("hyundai-n700").expect("it is built in");
    let mut makers = BTreeSet::new();
    let fits = |model: &&Arc<Model>| {
        let link = &model.link;
        link.framings.value.contains(&Framing::Rtu) && link.played().data_bits == 8
    };
    let many: Vec<_> = catalog
        .models()
        .filter(fits)
        .filter(|model| makers.insert(model.vendor.clone()))
        .take(LINES)
        .cloned()
        .collect();
    let (first, of_one) = measured("one model", &vec![Arc::clone(one); LINES]);
    let (second, of_many) = measured("16 models", &many);
    let more = Row::at_most(
        "library: resident with 16 models, beyond one, MB",
        MORE_MB,
        of_many - of_one,
    );
    first.into_iter().chain(second).chain([more]).collect()
}

/// Rows, and the resident memory.
fn measured(label: &str, models: &[Arc<Model>]) -> (Vec<Row>, f64) {
    let over = Arc::new(AtomicBool::new(false));
    let lines: Vec<_> = models.iter().map(|model| line(model, &over)).collect();
    let place = Place::new();
    let [http, modbus] =
        [free_port(), free_port()].map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    let data = place.path().join("data");
    std::fs::create_dir(&data).expect("a directory");
    let file = place.path().join("gateway.toml");
    let ports = lines.iter().map(|(port, _)| port);
    std::fs::write(&file, text(&data, models.iter().zip(ports), http, modbus)).expect("a file");
    let mut starts = Vec::new();
    for _ in 0..if crate::is_quick() { 10 } else { 50 } {
        let begun = Instant::now();
        let mut gateway = start(&program(), &file);
        starts.push(until(begun, || has_words(modbus)));
        end(&mut gateway);
    }
    let starts = Times::new(starts);
    let mut gateway = start(&program(), &file);
    until(Instant::now(), || is_ready(http));
    std::thread::sleep(Duration::from_secs(if crate::is_quick() { 5 } else { 20 }));
    let memory = Memory::of(gateway.id());
    end(&mut gateway);
    over.store(true, Ordering::Relaxed);
    lines
        .into_iter()
        .for_each(|(_, line)| line.join().expect("a line ends"));
    let rows = vec![
        Row::told(
            format!("library: {label}, start to first Modbus answer, p50 / p99 / max, ms"),
            starts.shown(),
        ),
        Row::at_most(
            format!("library: {label}, start to first Modbus answer, p50, ms"),
            START_MS,
            starts.at(0.5),
        ),
        Row::told(
            format!("library: {label}, resident with 32 drives, MB"),
            memory.shown(),
        ),
    ];
    (rows, memory.resident_mb)
}

/// A line with simulated drives of `model`.
fn line(model: &Arc<Model>, over: &Arc<AtomicBool>) -> (PathBuf, JoinHandle<()>) {
    let pty = Pty::new().expect("a pseudo-terminal");
    let port = pty.path().to_owned();
    let model = Arc::clone(model);
    let over = Arc::clone(over);
    let thread = std::thread::spawn(move || {
        let options = BusOptions {
            pacing: BusPacing::None,
            ..BusOptions::default()
        };
        let mut bus = SimBus::new(model.link.played(), options, 1);
        for station in 1..=DRIVES {
            bus.connect(
                Station(station),
                SimDrive::new(Arc::clone(&model), DriveOptions::default()),
            );
        }
        simulator::play(&pty, &mut bus, &over, |_, _| ()).expect("the simulated line");
    });
    (port, thread)
}

fn text<'m>(
    data: &std::path::Path,
    lines: impl Iterator<Item = (&'m Arc<Model>, &'m PathBuf)>,
    http: SocketAddr,
    modbus: SocketAddr,
) -> String {
    let mut text = format!(
        "[gateway]\nname = \"bench\"\ndata_dir = \"{}\"\n",
        data.display()
    );
    for (number, (model, port)) in lines.enumerate() {
        let link = model.link.played();
        let parity = match link.parity {
            Parity::None => "none",
            Parity::Even => "even",
            Parity::Odd => "odd",
        };
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "[[line]]\nname = \"l{number}\"\nport = \"{}\"\nbaud = {}\nparity = \"{parity}\"\nstop_bits = {}\n",
            port.display(),
            link.baud,
            link.stop_bits,
        );
        for station in 1..=usize::from(DRIVES) {
            let unit = number * usize::from(DRIVES) + station;
            let uniform = unit + 100;
            let _ = write!(
                text,
                "[[line.drive]]\nname = \"d{unit}\"\nmodel = \"{}\"\nstation = {station}\nunit = {unit}\n\
                 uniform_unit = {uniform}\n",
                model.id
            );
            if model.needs_full_scale() {
                text.push_str("full_scale_hz = 50.0\n");
            }
        }
    }
    let _ = write!(
        text,
        "[[modbus_tcp]]\nlisten = \"{modbus}\"\n[http]\nlisten = \"{http}\"\n"
    );
    text
}
