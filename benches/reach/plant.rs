//! A gateway of this process with everything that a configuration can have: control, a broker, Modbus TCP.

use std::fmt::Write as _;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use vfd_gateway::config::{self, Config};
use vfd_gateway::domain::report::LineCounters;
use vfd_gateway::vendors;

use crate::rig;

/// The configuration of a gateway with one line.
#[derive(Clone)]
pub struct Setup<'a> {
    /// The line's device.
    pub device: &'a Path,
    /// Drives at the stations from 1 on.
    pub drives: u8,
    /// Without character times and silence.
    pub unpaced: bool,
    /// Period of the polls.
    pub poll: &'a str,
    /// The broker's port on this machine, and the version of the protocol: 4 or 5.
    pub mqtt: Option<(u16, u8)>,
    /// The port of the Modbus TCP listener; 0 for any.
    pub listen: u16,
}

/// The register of the N700 that runs and stops it.
pub const RUN: u16 = 0x0002;
/// Unit of the uniform registers of the drive at station 1.
pub const UNIFORM: u8 = 101;

impl Setup<'_> {
    pub fn text(&self) -> String {
        let mut text = format!(
            "[gateway]\nname = \"bench\"\n[[line]]\nname = \"bench\"\nport = \"{}\"\n{}",
            self.device.display(),
            if self.unpaced {
                "silence = \"0ms\"\n"
            } else {
                ""
            }
        );
        // Writing to a String cannot fail.
        for station in 1..=self.drives {
            let _ = write!(
                text,
                "[[line.drive]]\nname = \"d{station}\"\nmodel = \"hyundai-n700\"\nstation = {station}\npoll = \"{}\"\n\
                 unit = {station}\nuniform_unit = {}\n[line.drive.control]\nfrom = [{}\"modbus-tcp\"]\n\
                 frequency_hz = {{ min = 5.0, max = 50.0 }}\ndirections = [\"forward\", \"reverse\"]\n\
                 on_commander_lost = \"stop\"\nlost_after = \"3s\"\non_shutdown = \"stop\"\n",
                self.poll,
                UNIFORM - 1 + station,
                if self.mqtt.is_some() {
                    "\"mqtt\", "
                } else {
                    ""
                },
            );
        }
        if let Some((port, version)) = self.mqtt {
            let _ = write!(
                text,
                "[mqtt]\nbroker = \"mqtt://127.0.0.1:{port}\"\nversion = {version}\n"
            );
        }
        let _ = write!(
            text,
            "[[modbus_tcp]]\nlisten = \"127.0.0.1:{}\"\nwrite = [\"127.0.0.1/32\"]\n",
            self.listen
        );
        text
    }

    pub fn config(&self) -> Config {
        let catalog = vendors::catalog();
        config::load(&self.text(), &catalog).expect("the configuration is sound")
    }
}

/// A running gateway.
pub struct Gateway {
    pub address: SocketAddr,
    stop: tokio::sync::oneshot::Sender<()>,
    thread: JoinHandle<LineCounters>,
}

impl Gateway {
    pub fn start(setup: &Setup<'_>) -> Self {
        let text = setup.text();
        let (told, listening) = mpsc::channel();
        let (stop, stopped) = tokio::sync::oneshot::channel();
        let thread = std::thread::spawn(move || rig::serve(&text, &told, stopped));
        Self {
            address: listening.recv().expect("the gateway listens"),
            stop,
            thread,
        }
    }

    pub fn stop(self) -> LineCounters {
        let _ = self.stop.send(());
        self.thread.join().expect("the gateway ends")
    }
}

/// A temporary directory that is removed when this is dropped.
pub struct Place(PathBuf);

impl Place {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!(
            "vfd-reach-{}-{}",
            std::process::id(),
            COUNT.fetch_add(1, Ordering::Relaxed)
        );
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir(&path).expect("a directory");
        Self(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        // Leftovers in the temporary directory do no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
