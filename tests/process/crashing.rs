//! The gateway is killed at any moment: no trip is lost or told under two numbers, and nothing moves by itself.
//!
//! A few times here; `CRASHES=500 cargo test --test process crashing` for longer.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::rig::{Place, program, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use super::yard::{Drive, FAMILIES, configuration};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

/// The uniform unit of the first drive.
const UNIFORM: u8 = 101;
/// Where trips are told.
const EVENTS: &str = "/trip/event";
/// More calls than a life of a second and a half makes on the journal.
const CALLS: u32 = 600;
/// What the gateway touches when it keeps something.
const JOURNAL: [&str; 3] = ["journal.db", "journal.db-wal", "journal.db-shm"];
/// What a controller writes to start a drive: reset, stop, setpoint, run. Some of it is refused, as it comes.
const START: [(u16, u16); 4] = [(256, 4), (256, 0), (257, 3000), (256, 1)];

/// The trips that are told of, by the numbers of their events: whose, and how many.
type Trips = BTreeMap<u64, (String, u64)>;

/// Everything around the gateway.
struct Site {
    events: Subscriber,
    file: PathBuf,
    modbus: SocketAddr,
    random: fastrand::Rng,
    drives: Vec<Drive>,
    /// Orders that were given to each.
    orders: Vec<u64>,
    _broker: Mosquitto,
    place: Place,
}

impl Site {
    fn new(seed: u64) -> Self {
        let place = Place::new();
        let broker = Mosquitto::start(&place.file(""));
        let drives: Vec<_> = FAMILIES
            .iter()
            .map(|family| Drive::new(family, &place))
            .collect();
        std::fs::create_dir(place.file("data")).unwrap();
        // The same address in every life, as in a plant.
        let modbus = SocketAddr::from(([127, 0, 0, 1], free_port()));
        let mqtt = format!("[mqtt]\nbroker = \"mqtt://{}\"\n", broker.address());
        let file = place.write(
            "gateway.toml",
            &configuration(&place, &FAMILIES, modbus, &mqtt),
        );
        let events = Subscriber::new(&broker, "mqttv5", "vfd/plant/drive/+/trip/event");
        let all = Subscriber::new(&broker, "mqttv5", "vfd/plant/#");
        let (random, orders) = (fastrand::Rng::with_seed(seed), vec![0; drives.len()]);
        let site = Self {
            events,
            file,
            modbus,
            random,
            drives,
            orders,
            _broker: broker,
            place,
        };
        // What counts begins with the first count that is kept: a drive that was never seen has no trips that could be missed.
        let _gateway = site.gateway();
        for drive in &site.drives {
            let topic = |rest| format!("drive/{}/{rest}", drive.family.name);
            all.wait_for_payload(&topic("run/state"), "stopped");
            if drive.family.counts {
                all.wait_for_payload(&topic("trip/count"), "0");
            }
        }
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
        command
            .args(["-D", "-f", "-qq", "-o", "/dev/null", "-e"])
            .arg(format!("inject=all:signal=KILL:when={n}"));
        for name in JOURNAL {
            command.arg("-P").arg(self.place.file("data").join(name));
        }
        command
            .arg(run.get_program())
            .args(run.get_args())
            .arg("run")
            .arg("-c")
            .arg(&self.file);
        Started::new(command)
    }

    /// One life: orders and trips until it is killed, by the observer or here. What runs before the first order of this
    /// life is nobody's. Returns whether it was the observer.
    fn live(&mut self, mut gateway: Started, is_observed: bool) -> bool {
        let born = Instant::now();
        let life = Duration::from_millis(self.random.u64(300..1800));
        // Half of them at any moment from the start on, the others when there is something to be cut off. One that is
        // observed starts slowly, and dies early if it makes the call early.
        let mut dies_at = if is_observed || self.random.bool() {
            None
        } else {
            Some(born + life)
        };
        let mut first_order = vec![None; self.drives.len()];
        while Instant::now() < dies_at.unwrap_or(born + PATIENCE) && !gateway.has_ended() {
            let place = self.random.usize(0..self.drives.len());
            if self.random.u8(0..6) == 0 {
                self.drives[place].trip();
            }
            for (register, word) in START {
                if (register, word) == (256, 1) {
                    first_order[place].get_or_insert_with(Instant::now);
                }
                if self.order(place, register, word) {
                    dies_at.get_or_insert_with(|| Instant::now() + life);
                }
            }
            std::thread::sleep(Duration::from_millis(self.random.u64(0..40)));
        }
        let was_observed = gateway.has_ended();
        gateway.kill();
        // What the dead one had handed over belongs to this life.
        self.drives.iter().for_each(Drive::wait_until_heard);
        for (drive, first_order) in self.drives.iter().zip(first_order) {
            let unordered = drive.runs_between(born, first_order.unwrap_or_else(Instant::now));
            let name = drive.family.name;
            assert_eq!(
                unordered,
                [],
                "{name}: RUN without an order since the gateway began again"
            );
        }
        was_observed
    }

    /// Orders something of a drive, if anybody is there, and waits for an answer for a moment. Whether one came.
    fn order(&mut self, place: usize, register: u16, word: u16) -> bool {
        self.orders[place] += 1;
        let unit = UNIFORM + u8::try_from(place).unwrap();
        let ([a, b], [c, d]) = (u16::to_be_bytes(register), u16::to_be_bytes(word));
        let asked = || {
            let mut stream = TcpStream::connect(self.modbus)?;
            stream.set_read_timeout(Some(Duration::from_millis(200)))?;
            stream.write_all(&[0, 1, 0, 0, 0, 6, unit, 6, a, b, c, d])?;
            stream.read(&mut [0; 16])
        };
        // A gateway that is dead or dying answers nothing, and that is what this is about.
        let answered: io::Result<usize> = asked();
        answered.is_ok_and(|count| count > 0)
    }

    /// The rows of one table of the journal.
    fn rows(&self, which: &str) -> Vec<Value> {
        let data = self.place.file("data");
        let args = [
            "journal",
            which,
            "--json",
            "--last",
            "100000",
            "--data-dir",
            data.to_str().unwrap(),
        ];
        let said = vfd_gateway(&args);
        assert!(
            said.status.success(),
            "{}",
            String::from_utf8_lossy(&said.stderr)
        );
        let text = String::from_utf8(said.stdout).unwrap();
        text.lines()
            .map(|line| serde_json::from_str::<Value>(line).unwrap())
            .collect()
    }

    /// What the journal says about trips.
    fn kept(&self) -> Trips {
        let mut kept = BTreeMap::new();
        for row in self
            .rows("trips")
            .iter()
            .filter(|row| row["kind"] == "tripped")
        {
            let trip = (
                row["name"].as_str().unwrap().to_owned(),
                row["body"]["trips"].as_u64().unwrap(),
            );
            let again = kept.insert(row["number"].as_u64().unwrap(), trip);
            assert_eq!(again, None, "a number twice: {row}");
        }
        kept
    }

    /// What the broker was told, in its order; what comes again is what came first.
    fn told(&self) -> Trips {
        let mut told: Vec<(u64, Value)> = Vec::new();
        for message in self.events.on(EVENTS) {
            let event: Value = serde_json::from_str(&message.payload).unwrap();
            let seq = event["seq"].as_u64().unwrap();
            match told.iter().find(|(number, _)| *number == seq) {
                Some((_, first)) => assert_eq!(*first, event, "one number, two events"),
                None => {
                    assert!(
                        told.last().is_none_or(|(last, _)| *last < seq),
                        "out of order: {event}"
                    );
                    told.push((seq, event));
                }
            }
        }
        let trips = told
            .into_iter()
            .filter(|(_, event)| event["kind"] == "tripped");
        let trip = |event: Value| {
            (
                event["drive"].as_str().unwrap().to_owned(),
                event["trips"].as_u64().unwrap(),
            )
        };
        trips.map(|(seq, event)| (seq, trip(event))).collect()
    }

    /// Whether some drive was run and some drive tripped.
    fn has_something_to_lose(&self) -> bool {
        self.drives.iter().any(|drive| drive.runs() > 0)
            && self.drives.iter().any(|drive| drive.trips() > 0)
    }

    /// Lives until there is something to lose, where each one before has died with nothing in hand, as on a slow machine, and
    /// a last life in peace: every trip of every drive is kept once, the broker is told of each, no attempt stands in two
    /// rows, and the motors whose commander does not come back are stopped.
    fn conclude(&mut self) {
        let end = Instant::now() + PATIENCE * 3;
        while !self.has_something_to_lose() && Instant::now() < end {
            let gateway = self.gateway();
            self.live(gateway, false);
        }
        for drive in &self.drives {
            let (name, trips, runs) = (drive.family.name, drive.trips(), drive.runs());
            println!("{name}: {trips} trips, {runs} orders to run reached the drive");
        }
        assert!(self.has_something_to_lose(), "there was nothing to lose");
        let _gateway = self.gateway();
        for drive in &self.drives {
            let name = drive.family.name;
            until(&format!("every trip of {name} is kept"), PATIENCE, || {
                let kept: u64 = self
                    .kept()
                    .values()
                    .filter(|(of, _)| of == name)
                    .map(|(_, trips)| trips)
                    .sum();
                assert!(
                    kept <= drive.trips(),
                    "{name}: {kept} trips are kept of {}",
                    drive.trips()
                );
                (kept == drive.trips()).then_some(())
            });
        }
        until("the broker was told of every trip", PATIENCE, || {
            (self.told() == self.kept()).then_some(())
        });
        until("the motors stand still", PATIENCE, || {
            self.drives.iter().all(|it| it.output() == 0).then_some(())
        });
        let audit = self.rows("audit");
        for (drive, orders) in self.drives.iter().zip(&self.orders) {
            let name = drive.family.name;
            let attempts = audit
                .iter()
                .filter(|row| row["kind"] == "attempt" && row["name"] == name);
            let counted: u64 = attempts
                .map(|row| row["body"]["count"].as_u64().unwrap())
                .sum();
            println!("{name}: {orders} orders were given, {counted} stand in the audit");
            assert!(
                counted <= *orders,
                "{name}: an attempt stands in the audit twice"
            );
        }
    }
}

#[test]
fn kills_under_load_lose_no_trip_and_start_nothing() {
    let mut site = Site::new(1);
    for _ in 0..crashes(8) {
        let gateway = site.gateway();
        assert!(!site.live(gateway, false), "it ended by itself");
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
        observed += u32::from(site.live(gateway, true));
    }
    assert!(
        observed * 4 >= lives,
        "the observer killed {observed} of {lives} only"
    );
    println!("{observed} of {lives} died at a call");
    site.conclude();
}

/// How many lives a test has.
fn crashes(usual: u32) -> u32 {
    std::env::var("CRASHES")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or(usual)
}
