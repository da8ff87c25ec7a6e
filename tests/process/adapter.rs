//! An adapter that can be pulled out and plugged in again: a pseudo-terminal with a drive behind it that comes and goes
//! under one name.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::host::timer::RawTimer;
use vfd_gateway::daemon::lines::simulated_end::LineEnd;
use vfd_gateway::daemon::lines::simulator;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::sim::{BusOptions, DriveOptions, SimBus, SimDrive};
use vfd_gateway::vendors;

/// How soon the one who plays notices that the adapter is out.
const NOTICE_WITHIN: Duration = Duration::from_millis(2);

/// The adapter. It is out until it is plugged in, and when it is dropped.
pub struct Adapter {
    link: PathBuf,
    plugged: Option<(Arc<AtomicBool>, JoinHandle<()>)>,
}

impl Adapter {
    /// One that appears as `link`.
    pub fn new(link: &Path) -> Self {
        Self {
            link: link.to_owned(),
            plugged: None,
        }
    }

    /// Plugs it in: another device, under the same name, with the drive at station 1 behind it.
    pub fn plug_in(&mut self) {
        assert!(self.plugged.is_none(), "it is plugged in already");
        let catalog = vendors::catalog();
        let model = Arc::clone(catalog.find("hyundai-n700").expect("the model is built in"));
        let mut bus = SimBus::new(LinkSettings::DEFAULT, BusOptions::default(), 1);
        bus.connect(Station(1), SimDrive::new(model, DriveOptions::default()));
        let mut pty = Pty::new().expect("a pseudo-terminal");
        pty.link_as(&self.link).expect("a link");
        let is_out = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&is_out);
        let player = std::thread::spawn(move || {
            let end = AtomicBool::new(false);
            let line = Pluggable {
                pty: &pty,
                is_out: &seen,
            };
            let played = simulator::play(line, &mut bus, &end, |_, _| {});
            assert!(
                seen.load(Ordering::Relaxed),
                "the simulated line ended by itself: {played:?}"
            );
        });
        self.plugged = Some((is_out, player));
    }

    /// Pulls it out, in the middle of whatever goes over it.
    pub fn pull_out(&mut self) {
        if let Some((is_out, player)) = self.plugged.take() {
            is_out.store(true, Ordering::Relaxed);
            player.join().expect("the player ends");
        }
    }
}

impl Drop for Adapter {
    fn drop(&mut self) {
        if let Some((is_out, player)) = self.plugged.take() {
            is_out.store(true, Ordering::Relaxed);
            // A test that fails already says why.
            let _ = player.join();
        }
    }
}

/// The end of the line at the drive; it fails as soon as the adapter is out.
struct Pluggable<'a> {
    pty: &'a Pty,
    is_out: &'a AtomicBool,
}

impl LineEnd for Pluggable<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>> {
        if self.is_out.load(Ordering::Relaxed) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.pty.read(buffer)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.pty.write(bytes)
    }

    fn wait(&mut self, timer: &mut RawTimer) -> io::Result<()> {
        timer.arm(clock::now() + NOTICE_WITHIN)?;
        self.pty.wait(timer)
    }
}
