//! A drive of each family, each at a port that outlives every gateway, and what was really written to it.

use super::rig::{Place, terminal};
use super::started::{PATIENCE, until};
use std::fmt::Write as _;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::host::timer::RawTimer;
use vfd_gateway::daemon::lines::simulated_end::LineEnd;
use vfd_gateway::daemon::lines::simulator;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::{LinkSettings, Parity};
use vfd_gateway::sim::{BusOptions, DriveOptions, SimBus, SimDrive};
use vfd_gateway::vendors;

const STATION: Station = Station(1);
/// What no gateway sends and no drive understands.
const MARK: [u8; 8] = [0; 8];
/// How long a commander may be silent.
pub const LOST_AFTER: Duration = Duration::from_secs(2);

/// A family: how its line is set, its run register, and which words there run, typed from the documents' sheets.
pub struct Family {
    pub name: &'static str,
    model: &'static str,
    link: LinkSettings,
    run: u16,
    runs: fn(u16) -> bool,
    /// It counts its trips. One that does not shows only whether one holds, and which.
    pub counts: bool,
    /// What of it is unproven.
    unproven: &'static [&'static str],
    /// Keys that its drive needs.
    keys: &'static str,
}

const fn link(baud: u32, parity: Parity, stop_bits: u8) -> LinkSettings {
    LinkSettings {
        baud,
        data_bits: 8,
        parity,
        stop_bits,
    }
}

#[rustfmt::skip]
pub const FAMILIES: [Family; 5] = [
    Family { name: "n700", model: "hyundai-n700", link: link(38_400, Parity::None, 1), run: 0x0002, runs: |word| matches!(word, 1 | 2), counts: true, unproven: &[], keys: "" },
    Family { name: "n100plus", model: "hyundai-n100plus", link: link(9_600, Parity::None, 1), run: 0x0002, runs: |word| word & 0b11 != 0, counts: true, unproven: &[], keys: "" },
    Family { name: "vf-s15", model: "toshiba-vf-s15", link: link(19_200, Parity::Even, 1), run: 0xFA00, runs: |word| word & 0x0400 != 0, counts: false, unproven: &["basic", "reset"], keys: "rated_current_a = 11.0\nrated_voltage_v = 400.0" },
    Family { name: "e510", model: "teco-e510", link: link(38_400, Parity::None, 1), run: 0x2501, runs: |word| word & 1 != 0, counts: false, unproven: &["basic", "reset"], keys: "" },
    Family { name: "fr500a", model: "frecon-fr500a", link: link(57_600, Parity::None, 2), run: 0x2000, runs: |word| matches!(word, 1 | 2), counts: false, unproven: &[], keys: "" },
];

/// A drive at its port.
pub struct Drive {
    pub family: &'static Family,
    port: PathBuf,
    seen: Arc<Seen>,
    player: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Seen {
    end: AtomicBool,
    /// Trips that are still to happen, and that have happened.
    to_trip: AtomicU32,
    trips: AtomicU32,
    output: AtomicI64,
    marks: AtomicU32,
    /// Words of the run command, each with its moment.
    runs: Mutex<Vec<(Instant, u16)>>,
}

impl Drive {
    /// A drive of `family` whose port is reached in `place`, with ramps of a second.
    pub fn new(family: &'static Family, place: &Place) -> Self {
        let catalog = vendors::catalog();
        let model = Arc::clone(catalog.find(family.model).expect("the model is built in"));
        let mut bus = SimBus::new(family.link, BusOptions::default(), 1);
        let ramp = Duration::from_secs(1);
        let options = DriveOptions {
            acceleration: ramp,
            deceleration: ramp,
            ..DriveOptions::default()
        };
        bus.connect(STATION, SimDrive::new(model, options));
        let mut pty = Pty::new().expect("a pseudo-terminal");
        let port = place.file(family.name);
        pty.link_as(&port).expect("a link");
        let seen = Arc::new(Seen::default());
        let ours = Arc::clone(&seen);
        let player = std::thread::spawn(move || {
            let line = Watched {
                pty: &pty,
                seen: &ours,
                family,
            };
            simulator::play(line, &mut bus, &ours.end, |bus, now| {
                let drive = bus.drive_mut(STATION).expect("the drive");
                ours.output.store(drive.output(now), Ordering::SeqCst);
                if ours.to_trip.load(Ordering::SeqCst) == 0 {
                    return;
                }
                // A second trip while the first holds is none that such a drive could show.
                if family.counts || !drive.is_tripped() {
                    // Another cause than before: a trip of the same kind could not be told from the one that was there.
                    let cause = 1 + ours.trips.fetch_add(1, Ordering::SeqCst) % 5;
                    drive.trip(now, u16::try_from(cause).expect("a small number"));
                }
                ours.to_trip.fetch_sub(1, Ordering::SeqCst);
            })
            .expect("the line is played");
        });
        Self {
            family,
            port,
            seen,
            player: Some(player),
        }
    }

    /// Waits until everything is read that was sent to the drive up to this moment. Nobody may be at its port.
    pub fn wait_until_heard(&self) {
        let heard = || self.seen.marks.load(Ordering::SeqCst);
        let before = heard();
        terminal(&self.port).write_all(&MARK).unwrap();
        until("the drive has heard everything", PATIENCE, || {
            (heard() > before).then_some(())
        });
    }

    pub fn trip(&self) {
        self.seen.to_trip.fetch_add(1, Ordering::SeqCst);
    }

    /// How many trips there were, when all have happened.
    pub fn trips(&self) -> u64 {
        until("the trips have happened", PATIENCE, || {
            (self.seen.to_trip.load(Ordering::SeqCst) == 0).then_some(())
        });
        self.seen.trips.load(Ordering::SeqCst).into()
    }

    /// The output frequency in microhertz.
    pub fn output(&self) -> i64 {
        self.seen.output.load(Ordering::SeqCst)
    }

    /// How many words that run were written.
    pub fn runs(&self) -> usize {
        let runs = self.seen.runs.lock().unwrap();
        runs.iter()
            .filter(|(_, word)| (self.family.runs)(*word))
            .count()
    }

    /// The words that run and were written between two moments.
    pub fn runs_between(&self, from: Instant, to: Instant) -> Vec<(Instant, u16)> {
        let runs = self.seen.runs.lock().unwrap();
        runs.iter()
            .copied()
            .filter(|(at, word)| (from..to).contains(at) && (self.family.runs)(*word))
            .collect()
    }
}

impl Drop for Drive {
    fn drop(&mut self) {
        self.seen.end.store(true, Ordering::Relaxed);
        let ended = self.player.take().map(JoinHandle::join);
        assert!(
            std::thread::panicking() || ended.is_none_or(|ended| ended.is_ok()),
            "the player failed"
        );
    }
}

/// The end of the line at the drive, with somebody who listens. The gateway hands a frame over as a whole.
struct Watched<'a> {
    pty: &'a Pty,
    seen: &'a Seen,
    family: &'a Family,
}

impl LineEnd for Watched<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>> {
        let read = self.pty.read(buffer)?;
        let word = read.and_then(|count| written(&buffer[..count], self.family.run));
        if let Some(word) = word {
            self.seen.runs.lock().unwrap().push((Instant::now(), word));
        }
        if read.is_some_and(|count| buffer[..count].ends_with(&MARK)) {
            self.seen.marks.fetch_add(1, Ordering::SeqCst);
        }
        Ok(read)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.pty.write(bytes)
    }

    fn wait(&mut self, timer: &mut RawTimer) -> io::Result<()> {
        self.pty.wait(timer)
    }
}

/// The word that `frame` writes to `register`.
fn written(frame: &[u8], register: u16) -> Option<u16> {
    let number = |at: usize| Some(u16::from_be_bytes([*frame.get(at)?, *frame.get(at + 1)?]));
    match frame.get(1)? {
        0x06 if number(2)? == register => number(4),
        0x10 => {
            let place = usize::from(register.checked_sub(number(2)?)?);
            if place < usize::from(number(4)?) {
                number(7 + 2 * place)
            } else {
                None
            }
        }
        _ => None,
    }
}

/// The configuration of a gateway with `families`, each on a line of its own at units 1, 2, ... and 101, 102, ...
pub fn configuration<'f>(
    place: &Place,
    families: impl IntoIterator<Item = &'f Family>,
    modbus: SocketAddr,
    more: &str,
) -> String {
    let mut text = format!(
        "[gateway]\nname = \"plant\"\ndata_dir = \"{}\"\n\n[[modbus_tcp]]\nlisten = \"{modbus}\"\n\
         write = [\"127.0.0.1/32\"]\n\n{more}\n",
        place.file("data").display()
    );
    for (unit, family) in (1..).zip(families) {
        let Family {
            name,
            model,
            link,
            unproven,
            keys,
            ..
        } = family;
        let unproven: Vec<_> = unproven
            .iter()
            .map(|action| format!("\"{action}\""))
            .collect();
        let parity = if link.parity == Parity::Even {
            "even"
        } else {
            "none"
        };
        write!(
            text,
            "\n[[line]]\nname = \"{name}\"\nport = \"{}\"\nbaud = {}\nparity = \"{parity}\"\nstop_bits = {}\n\n\
             [[line.drive]]\nname = \"{name}\"\nmodel = \"{model}\"\nstation = 1\nunit = {unit}\nuniform_unit = {}\n\
             poll = \"100ms\"\n{keys}\n\n[line.drive.control]\nfrom = [\"modbus-tcp\"]\n\
             frequency_hz = {{ min = 5.0, max = 50.0 }}\non_commander_lost = \"stop\"\nlost_after = \"{}s\"\n\
             on_shutdown = \"stop\"\naccept_unverified = [{}]\n",
            place.file(name).display(),
            link.baud,
            link.stop_bits,
            100 + unit,
            LOST_AFTER.as_secs(),
            unproven.join(", ")
        )
        .unwrap();
    }
    text
}
