//! The gateway is killed at any moment: no trip is lost or told under two numbers, and nothing moves by itself.
//!
//! A few times here; `CRASHES=500 cargo test --test process crashing` for longer.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::rig::{Place, program, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use vfd_gateway::daemon::line_end::LineEnd;
use vfd_gateway::daemon::pty::Pty;
use vfd_gateway::daemon::simulator;
use vfd_gateway::daemon::timer::RawTimer;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::profile::catalog::Catalog;
use vfd_gateway::sim::{BusOptions, DriveOptions, SimBus, SimDrive};
use vfd_gateway::vendors;

const STATION: Station = Station(1);
/// The uniform unit of the drive.
const UNIFORM: u8 = 101;
/// The drive's run command, and the words of it that run (N700, table 2-1).
const RUN: u16 = 0x0002;
const RUNS: [u16; 2] = [1, 2];
/// The cause of every trip here: overvoltage.
const CAUSE: u16 = 7;
/// Where trips are told.
const EVENTS: &str = "vfd/plant/drive/pump-1/trip/event";
/// More calls than a life of a second and a half makes on the journal.
const CALLS: u32 = 400;
/// What the gateway touches when it keeps something.
const JOURNAL: [&str; 3] = ["journal.db", "journal.db-wal", "journal.db-shm"];

/// A drive on a port that outlives every gateway, and what was really written to it.
struct Plant {
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
    /// Words of the run command, each with its moment.
    runs: Mutex<Vec<(Instant, u16)>>,
}

impl Plant {
    fn new(link: &Path) -> Self {
        let catalog = Catalog::from_texts(vendors::texts().iter().copied()).expect("built-in models are sound");
        let model = Arc::clone(catalog.find("hyundai-n700").expect("the model is built in"));
        let settings = LinkSettings { baud: 38_400, ..LinkSettings::DEFAULT };
        let mut bus = SimBus::new(settings, BusOptions::default(), 1);
        bus.connect(STATION, SimDrive::new(model, DriveOptions::default()));
        let mut pty = Pty::new().expect("a pseudo-terminal");
        pty.link_as(link).expect("a link");
        let seen = Arc::new(Seen::default());
        let ours = Arc::clone(&seen);
        let player = std::thread::spawn(move || {
            let line = Watched { pty: &pty, seen: &ours };
            simulator::play(line, &mut bus, &ours.end, |bus, now| {
                let drive = bus.drive_mut(STATION).expect("the drive");
                ours.output.store(drive.output(now), Ordering::SeqCst);
                if ours.to_trip.load(Ordering::SeqCst) > 0 {
                    drive.trip(now, CAUSE);
                    ours.trips.fetch_add(1, Ordering::SeqCst);
                    ours.to_trip.fetch_sub(1, Ordering::SeqCst);
                }
            })
            .expect("the line is played");
        });
        Self { seen, player: Some(player) }
    }

    fn trip(&self) {
        self.seen.to_trip.fetch_add(1, Ordering::SeqCst);
    }

    /// How many trips there were, when all have happened.
    fn trips(&self) -> u64 {
        until("the trips have happened", PATIENCE, || (self.seen.to_trip.load(Ordering::SeqCst) == 0).then_some(()));
        self.seen.trips.load(Ordering::SeqCst).into()
    }

    /// The output frequency, in 0.01 Hz.
    fn output(&self) -> i64 {
        self.seen.output.load(Ordering::SeqCst)
    }

    /// How many words that run were written.
    fn runs(&self) -> usize {
        let runs = self.seen.runs.lock().unwrap();
        runs.iter().filter(|(_, word)| RUNS.contains(word)).count()
    }

    /// The words that run and were written between two moments.
    fn runs_between(&self, from: Instant, to: Instant) -> Vec<(Instant, u16)> {
        let runs = self.seen.runs.lock().unwrap();
        runs.iter().copied().filter(|(at, word)| (from..to).contains(at) && RUNS.contains(word)).collect()
    }
}

impl Drop for Plant {
    fn drop(&mut self) {
        self.seen.end.store(true, Ordering::Relaxed);
        let ended = self.player.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || ended.is_none_or(|ended| ended.is_ok()), "the player failed");
    }
}

/// The end of the line at the drive, with somebody who listens. The gateway hands a frame over as a whole.
struct Watched<'a> {
    pty: &'a Pty,
    seen: &'a Seen,
}

impl LineEnd for Watched<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<Option<usize>> {
        let read = self.pty.read(buffer)?;
        if let Some(count) = read
            && let [_, 0x06, a0, a1, v0, v1, ..] = buffer[..count]
            && u16::from_be_bytes([a0, a1]) == RUN
        {
            self.seen.runs.lock().unwrap().push((Instant::now(), u16::from_be_bytes([v0, v1])));
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

/// Everything around the gateway.
struct Site {
    events: Subscriber,
    file: PathBuf,
    modbus: SocketAddr,
    random: fastrand::Rng,
    plant: Plant,
    _broker: Mosquitto,
    place: Place,
}

impl Site {
    fn new(seed: u64) -> Self {
        let place = Place::new();
        let broker = Mosquitto::start(&place.file(""));
        let plant = Plant::new(&place.file("line"));
        std::fs::create_dir(place.file("data")).unwrap();
        // The same address in every life, as in a plant.
        let modbus = SocketAddr::from(([127, 0, 0, 1], free_port()));
        let file = place.write("gateway.toml", &configuration(&place, broker.address().port(), modbus));
        let events = Subscriber::new(&broker, "mqttv5", EVENTS);
        let count = Subscriber::new(&broker, "mqttv5", "vfd/plant/drive/pump-1/trip/count");
        let random = fastrand::Rng::with_seed(seed);
        let site = Self { events, file, modbus, random, plant, _broker: broker, place };
        // A drive that was never seen has no trips that could be missed: what counts begins with the first count that is kept.
        let _gateway = site.gateway();
        count.wait_for_payload("trip/count", "0");
        site
    }

    fn gateway(&self) -> Started {
        let mut command = program();
        command.arg("run").arg("-c").arg(&self.file);
        Started::new(command)
    }

    /// The gateway before an observer that kills it at the `n`th call of the system that touches the journal.
    fn gateway_that_dies_at(&self, n: u32) -> Started {
        let run = program();
        let mut command = Command::new("strace");
        // As a grandchild, so that the gateway is the process that is started here and ends with the test.
        command.args(["-D", "-f", "-qq", "-o", "/dev/null", "-e"]).arg(format!("inject=all:signal=KILL:when={n}"));
        for name in JOURNAL {
            command.arg("-P").arg(self.place.file("data").join(name));
        }
        command.arg(run.get_program()).args(run.get_args()).arg("run").arg("-c").arg(&self.file);
        Started::new(command)
    }

    /// One life: orders and trips until it is killed, by the observer or here. What runs before the first order of this
    /// life is nobody's. Returns whether it was the observer.
    fn live(&mut self, mut gateway: Started) -> bool {
        let born = Instant::now();
        let dies_at = born + Duration::from_millis(self.random.u64(200..1500));
        let mut first_order = None;
        while Instant::now() < dies_at && !gateway.has_ended() {
            if self.random.u8(0..8) == 0 {
                self.plant.trip();
            }
            // Reset, stop, setpoint, run: some of it is refused, as it comes.
            for (register, word) in [(256, 4), (256, 0), (257, 3000), (256, 1)] {
                if (register, word) == (256, 1) {
                    first_order.get_or_insert_with(Instant::now);
                }
                self.order(register, word);
            }
            std::thread::sleep(Duration::from_millis(self.random.u64(0..60)));
        }
        let was_observed = gateway.has_ended();
        gateway.kill();
        // What the dead one had handed over is read by now.
        std::thread::sleep(Duration::from_millis(50));
        let unordered = self.plant.runs_between(born, first_order.unwrap_or_else(Instant::now));
        assert_eq!(unordered, [], "RUN without an order since the gateway began again");
        was_observed
    }

    /// Orders something, if anybody is there, and waits for an answer for a moment.
    fn order(&self, register: u16, word: u16) {
        let ([a, b], [c, d]) = (u16::to_be_bytes(register), u16::to_be_bytes(word));
        let asked = || {
            let mut stream = TcpStream::connect(self.modbus)?;
            stream.set_read_timeout(Some(Duration::from_millis(200)))?;
            stream.write_all(&[0, 1, 0, 0, 0, 6, UNIFORM, 6, a, b, c, d])?;
            stream.read(&mut [0; 16])
        };
        // A gateway that is dead or dying answers nothing, and that is what this is about.
        let _: io::Result<usize> = asked();
    }

    /// What the journal says about trips: the number of each event, and how many trips it tells of.
    fn kept(&self) -> BTreeMap<u64, u64> {
        let data = self.place.file("data");
        let args = ["journal", "trips", "--json", "--last", "100000", "--data-dir", data.to_str().unwrap()];
        let said = vfd_gateway(&args);
        assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
        let text = String::from_utf8(said.stdout).unwrap();
        let rows = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let mut kept = BTreeMap::new();
        for row in rows.filter(|row| row["kind"] == "tripped") {
            let again = kept.insert(row["number"].as_u64().unwrap(), row["body"]["trips"].as_u64().unwrap());
            assert_eq!(again, None, "a number twice: {row}");
        }
        kept
    }

    /// What the broker was told, in its order; what comes again is what came first.
    fn told(&self) -> BTreeMap<u64, u64> {
        let mut told: Vec<(u64, Value)> = Vec::new();
        for message in self.events.on(EVENTS) {
            let event: Value = serde_json::from_str(&message.payload).unwrap();
            let seq = event["seq"].as_u64().unwrap();
            match told.iter().find(|(number, _)| *number == seq) {
                Some((_, first)) => assert_eq!(*first, event, "one number, two events"),
                None => {
                    assert!(told.last().is_none_or(|(last, _)| *last < seq), "out of order: {event}");
                    told.push((seq, event));
                }
            }
        }
        let trips = told.into_iter().filter(|(_, event)| event["kind"] == "tripped");
        trips.map(|(seq, event)| (seq, event["trips"].as_u64().unwrap())).collect()
    }

    /// A last life in peace: every trip is kept once, the broker is told of each, and the motor whose commander does not
    /// come back is stopped.
    fn conclude(&self) {
        let (trips, runs) = (self.plant.trips(), self.plant.runs());
        println!("{trips} trips, {runs} orders to run reached the drive");
        assert!(trips > 0 && runs > 0, "there was nothing to lose");
        let _gateway = self.gateway();
        until("every trip is kept", PATIENCE, || {
            let kept: u64 = self.kept().values().sum();
            assert!(kept <= self.plant.trips(), "{kept} trips are kept of {}", self.plant.trips());
            (kept == self.plant.trips()).then_some(())
        });
        until("the broker was told of every trip", PATIENCE, || (self.told() == self.kept()).then_some(()));
        until("the motor stands still", PATIENCE, || (self.plant.output() == 0).then_some(()));
    }
}

#[test]
fn kills_under_load_lose_no_trip_and_start_nothing() {
    let mut site = Site::new(1);
    for _ in 0..crashes(8) {
        let gateway = site.gateway();
        assert!(!site.live(gateway), "it ended by itself");
    }
    site.conclude();
}

#[test]
fn a_kill_at_any_call_that_touches_the_journal_loses_no_trip_and_starts_nothing() {
    let mut site = Site::new(2);
    let lives = crashes(8);
    let mut observed = 0;
    for life in 0..lives {
        // Evenly over what a life of that length does, the start included.
        let gateway = site.gateway_that_dies_at(1 + life * CALLS / lives);
        observed += u32::from(site.live(gateway));
    }
    assert!(observed * 4 >= lives, "the observer killed {observed} of {lives} only");
    println!("{observed} of {lives} died at a call");
    site.conclude();
}

/// How many lives a test has.
fn crashes(usual: u32) -> u32 {
    std::env::var("CRASHES").ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

fn configuration(place: &Place, broker: u16, modbus: SocketAddr) -> String {
    format!(
        "[gateway]\nname = \"plant\"\ndata_dir = \"{}\"\n\n[[line]]\nname = \"hall-1\"\nport = \"{}\"\nbaud = 38400\n\n\
         [[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\nstation = 1\nunit = 1\npoll = \"100ms\"\n\n\
         [line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
         on_commander_lost = \"stop\"\nlost_after = \"2s\"\non_shutdown = \"stop\"\n\n\
         [mqtt]\nbroker = \"mqtt://127.0.0.1:{broker}\"\n\n\
         [[modbus_tcp]]\nlisten = \"{modbus}\"\nwrite = [\"127.0.0.1/32\"]\n",
        place.file("data").display(),
        place.file("line").display()
    )
}
