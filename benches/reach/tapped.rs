//! A simulated line of this process that reports when each request of the gateway reached its wire.

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::host::sys;
use vfd_gateway::daemon::host::timer::RawTimer;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::sim::{BusOptions, BusReport, DriveOptions, SimBus, SimDrive};

use crate::support::n700;

/// Longest wait of the simulator.
const LOOK_UP: Duration = Duration::from_millis(200);
/// Bytes of a request of the functions 03 and 06.
const REQUEST_BYTES: usize = 8;
/// How fast the drives start and stop, so that many of both fit into a measurement.
const RAMP: Duration = Duration::from_millis(100);

/// A request.
pub struct Heard {
    /// When its first byte was in the port.
    pub at: MonoTime,
    pub frame: Vec<u8>,
}

impl Heard {
    /// Whether it writes `value` to the register at `address`.
    pub fn is_write(&self, address: u16, value: u16) -> bool {
        self.writes()
            && self.frame[2..4] == address.to_be_bytes()
            && self.frame[4..6] == value.to_be_bytes()
    }

    pub fn writes(&self) -> bool {
        self.frame[1] != 3
    }
}

/// The playing line.
pub struct TappedLine {
    path: PathBuf,
    pub heard: Receiver<Heard>,
    end: Arc<AtomicBool>,
    player: JoinHandle<BusReport>,
}

impl TappedLine {
    /// Drives at the stations from 1 on, whose registers from 3000 to 3FFF hex can all be read.
    pub fn start(drives: u8, options: BusOptions) -> Self {
        let pty = Pty::new().expect("a pseudo-terminal");
        let path = pty.path().to_owned();
        let mut bus = SimBus::new(LinkSettings::DEFAULT, options, 1);
        for station in 1..=drives {
            let proof_words = Some(0x3000..=0x3FFF);
            let drive = DriveOptions {
                proof_words,
                acceleration: RAMP,
                deceleration: RAMP,
                ..DriveOptions::default()
            };
            bus.connect(Station(station), SimDrive::new(n700(), drive));
        }
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let (tell, heard) = channel();
        let player = std::thread::spawn(move || play(&pty, &mut bus, &ended, &tell));
        Self {
            path,
            heard,
            end,
            player,
        }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits for the first request that satisfies `is_it`; `None` if it does not arrive in time. Requests before it are
    /// passed to `other`.
    pub fn wait_for(
        &self,
        patience: Duration,
        is_it: impl Fn(&Heard) -> bool,
        mut other: impl FnMut(Heard),
    ) -> Option<Heard> {
        let until = clock::now() + patience;
        loop {
            let heard = self.heard.recv_timeout(until.since(clock::now())).ok()?;
            if is_it(&heard) {
                return Some(heard);
            }
            other(heard);
        }
    }

    /// Waits until no request has arrived for `time`. Returns how many writes arrived meanwhile.
    pub fn quiet(&self, time: Duration) -> u64 {
        let mut writes = 0;
        while let Ok(heard) = self.heard.recv_timeout(time) {
            writes += u64::from(heard.writes());
        }
        writes
    }

    /// Drops the requests so far. Returns how many of them were writes.
    pub fn forget(&self) -> u64 {
        self.heard
            .try_iter()
            .map(|heard| u64::from(heard.writes()))
            .sum()
    }

    pub fn stop(self) -> BusReport {
        self.end.store(true, Ordering::Relaxed);
        self.player.join().expect("the player ends")
    }
}

fn play(pty: &Pty, bus: &mut SimBus, end: &AtomicBool, tell: &Sender<Heard>) -> BusReport {
    if bus.is_paced() {
        let _ = sys::ask_for_real_time();
    }
    let mut timer = RawTimer::new().expect("a timer");
    let mut buffer = [0; 512];
    let mut out = Vec::new();
    let mut begun = Vec::new();
    let mut first = MonoTime::ZERO;
    while !end.load(Ordering::Relaxed) {
        bus.take_due(clock::now(), |_, bytes| out.extend_from_slice(bytes));
        if !out.is_empty() {
            let _ = rustix::io::write(pty.master(), &out);
            out.clear();
        }
        match rustix::io::read(pty.master(), &mut buffer) {
            Ok(bytes) => {
                let at = clock::now();
                bus.receive(at, &buffer[..bytes]);
                for byte in &buffer[..bytes] {
                    first = if begun.is_empty() { at } else { first };
                    begun.push(*byte);
                    if begun.len() == REQUEST_BYTES {
                        // The receiver is gone at the end.
                        let _ = tell.send(Heard {
                            at: first,
                            frame: std::mem::take(&mut begun),
                        });
                    }
                }
            }
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => wait(pty, bus, &mut timer),
            Err(error) => panic!("the pseudo-terminal: {error}"),
        }
    }
    bus.report().clone()
}

fn wait(pty: &Pty, bus: &SimBus, timer: &mut RawTimer) {
    let now = clock::now();
    let wake = bus.next_due().unwrap_or(now + LOOK_UP).min(now + LOOK_UP);
    if wake <= now {
        return;
    }
    timer.arm(wake).expect("armed");
    let mut fds = [
        PollFd::from_borrowed_fd(pty.master().as_fd(), PollFlags::IN),
        PollFd::new(&*timer, PollFlags::IN),
    ];
    let _ = poll(&mut fds, None);
    if fds[1].revents().contains(PollFlags::IN) {
        timer.acknowledge();
    }
}
