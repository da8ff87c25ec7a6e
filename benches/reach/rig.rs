//! A gateway of this process in front of a simulated line of this process: pseudo-terminal and loopback between.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;
use vfd_gateway::config;
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::lines::simulator;
use vfd_gateway::daemon::service::run;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::domain::report::LineCounters;
use vfd_gateway::sim::{BusOptions, BusPacing, BusReport, DriveOptions, SimBus, SimDrive};
use vfd_gateway::vendors;

use crate::support::{PROOF, n700};

/// The options of a rig.
pub struct Options {
    /// Drives at stations 1, 2, ...
    pub drives: u8,
    /// A drive that is switched off.
    pub dead: Option<u8>,
    /// Speed in bit/s, 8N1.
    pub baud: u32,
    /// The bus.
    pub bus: BusOptions,
    /// Further keys of the line, as they stand in a configuration.
    pub line_keys: &'static str,
    /// Further keys of each drive.
    pub drive_keys: &'static str,
    /// Period of the fast polls.
    pub poll: &'static str,
    /// Further keys of the listener.
    pub listener_keys: &'static str,
}

impl Options {
    /// Paced like 9600 8N1 with 2 ms turnaround.
    pub fn paced(drives: u8) -> Self {
        Self {
            drives,
            dead: None,
            baud: LinkSettings::DEFAULT.baud,
            bus: BusOptions::default(),
            line_keys: "",
            drive_keys: "",
            poll: "1h",
            listener_keys: "",
        }
    }

    /// Speed and character format of the line.
    pub fn link(&self) -> LinkSettings {
        LinkSettings {
            baud: self.baud,
            ..LinkSettings::DEFAULT
        }
    }

    /// Without character times and without silence.
    pub fn unpaced(drives: u8) -> Self {
        let bus = BusOptions {
            pacing: BusPacing::None,
            silence: Some(Duration::ZERO),
            ..BusOptions::default()
        };
        Self {
            bus,
            line_keys: "silence = \"0ms\"\n",
            ..Self::paced(drives)
        }
    }
}

/// The results after the end.
pub struct Outcome {
    pub bus: BusReport,
    pub line: LineCounters,
}

/// A running gateway and its line.
pub struct Rig {
    pub address: SocketAddr,
    /// Number of requests that the drive at station 1 has received.
    pub exchanges: Arc<AtomicU64>,
    /// Replies that came late so far.
    pub late: Arc<AtomicU64>,
    end: Arc<AtomicBool>,
    stop: tokio::sync::oneshot::Sender<()>,
    gateway: JoinHandle<LineCounters>,
    simulator: JoinHandle<BusReport>,
}

impl Rig {
    pub fn start(options: &Options) -> Self {
        let pty = Pty::new().expect("a pseudo-terminal");
        let text = configuration(&pty, options);
        let end = Arc::new(AtomicBool::new(false));
        let exchanges = Arc::new(AtomicU64::new(0));
        let late = Arc::new(AtomicU64::new(0));
        let mut bus = bus(options);
        let ended = Arc::clone(&end);
        let heard = Arc::clone(&exchanges);
        let seen_late = Arc::clone(&late);
        let simulator = std::thread::spawn(move || {
            let look = |bus: &mut SimBus, _| {
                heard.store(bus.exchange(Station(1)), Ordering::Release);
                seen_late.store(bus.report().replies_late, Ordering::Release);
            };
            simulator::play(&pty, &mut bus, &ended, look).expect("the simulated line");
            bus.report().clone()
        });
        let (told, listening) = mpsc::channel();
        let (stop, stopped) = tokio::sync::oneshot::channel();
        let gateway = std::thread::spawn(move || serve(&text, &told, stopped));
        let address = listening.recv().expect("the gateway listens");
        Self {
            address,
            exchanges,
            late,
            end,
            stop,
            gateway,
            simulator,
        }
    }

    pub fn stop(self) -> Outcome {
        let _ = self.stop.send(());
        let line = self.gateway.join().expect("the gateway ends");
        self.end.store(true, Ordering::Relaxed);
        Outcome {
            bus: self.simulator.join().expect("the simulator ends"),
            line,
        }
    }
}

pub fn serve(
    text: &str,
    told: &mpsc::Sender<SocketAddr>,
    stopped: tokio::sync::oneshot::Receiver<()>,
) -> LineCounters {
    let catalog = vendors::catalog();
    let config = config::load(text, &catalog).expect("the configuration is sound");
    let mut counters = LineCounters::default();
    run::run(&config, None, async |running| {
        told.send(running.listening[0]).expect("somebody waits");
        let _ = stopped.await;
        counters = running.counters()[0];
    })
    .expect("the gateway runs");
    counters
}

fn bus(options: &Options) -> SimBus {
    let mut bus = SimBus::new(options.link(), options.bus, 1);
    for station in 1..=options.drives {
        let drive = DriveOptions {
            proof_words: Some(PROOF..=PROOF + 0xFF),
            ..DriveOptions::default()
        };
        bus.connect(Station(station), SimDrive::new(n700(), drive));
    }
    if let Some(station) = options.dead {
        bus.set_powered(
            vfd_gateway::domain::time::MonoTime::ZERO,
            Station(station),
            false,
        );
    }
    bus
}

fn configuration(pty: &Pty, options: &Options) -> String {
    let mut text = format!(
        "[[line]]\nname = \"bench\"\nport = \"{}\"\nbaud = {}\n{}",
        pty.path().display(),
        options.baud,
        options.line_keys
    );
    for station in 1..=options.drives {
        text += &format!(
            "[[line.drive]]\nname = \"d{station}\"\nmodel = \"hyundai-n700\"\nstation = {station}\npoll = \"{}\"\n{}",
            options.poll, options.drive_keys
        );
    }
    format!(
        "{text}[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n{}",
        options.listener_keys
    )
}
