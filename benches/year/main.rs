//! A simulated line-year, checked at every step: `cargo bench --bench year`. See
//! `tests/simulation/mod.rs` for what is simulated and what is checked.
//!
//! | argument | meaning, default |
//! | --- | --- |
//! | `--what year` | everything: clients, broker, faults; 316,000,000 exchanges, which is a year at 10 a second |
//! | `--what late` | 10,000,000 late replies, none of them taken for another request |
//! | `--what bursts` | 10,000,000 reads among bytes in the shape of requests and replies, none answered with others' words |
//! | `--what gaps` | 10,000,000 frames, no silence before one too short |
//! | `--what stop` | 10,000 stops while reads crowd, each to the nanosecond |
//! | `--what kills` | 10,000 kills of the gateway at any moment |
//! | `--what audit` | 1,000,000 attempts to write, each accounted for once |
//! | `--what stale` | 1,000,000 stale, retained, duplicate and reordered commands, none executed |
//! | `--what holders` | 1,024 lease holders vanish, all of a line at once |
//! | `--extras LIST` | further faults beyond the line: `on`, `all`, `none`, or names from `tests/simulation/extras.rs` |
//! | `--exchanges N` | another number |
//! | `--seed S` | the first seed, 1 |
//! | `--shards K` | threads, one for each processor |
//! | `--minutes M` | ends after this time in any case |

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::too_many_lines,
    missing_docs,
    reason = "a measurement may end by panicking, and is one story"
)]
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

#[path = "../../tests/simulation/mod.rs"]
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
mod simulation;

use simulation::bursts::BurstTally;
use simulation::extras::Extras;
use simulation::tally::Tally;
use simulation::trouble::Trouble;
use simulation::{WORLD, audit, bursts, holders, kills, stale, trials};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The simulation to run, and its limits.
struct Job {
    what: String,
    extras: Extras,
    wanted: u64,
    seed: AtomicU64,
    done: AtomicU64,
    until: Instant,
    is_over: AtomicBool,
    tally: Mutex<Tally>,
    worst_stop: Mutex<Duration>,
    bursts: Mutex<BurstTally>,
    failures: Mutex<Vec<String>>,
}

impl Job {
    /// Runs one seed after the other, until enough is done.
    fn work(&self) {
        while self.done.load(Ordering::Relaxed) < self.wanted && Instant::now() < self.until {
            let seed = self.seed.fetch_add(1, Ordering::Relaxed);
            let left = self
                .wanted
                .saturating_sub(self.done.load(Ordering::Relaxed))
                .max(1);
            match self.one(seed, left) {
                Ok(done) => _ = self.done.fetch_add(done, Ordering::Relaxed),
                Err(text) => {
                    println!("{text}\n");
                    self.failures.lock().expect("no thread panics").push(text);
                    self.done.fetch_add(WORLD, Ordering::Relaxed);
                }
            }
        }
    }

    fn one(&self, seed: u64, left: u64) -> Result<u64, String> {
        let (tally, done) = match self.what.as_str() {
            "late" => {
                let tally = trials::late(seed, left.min(20_000))?;
                (tally, tally.late)
            }
            "bursts" => {
                let tally = bursts::bursts(seed, left.min(20_000))?;
                self.bursts.lock().expect("no thread panics").add(&tally);
                return Ok(tally.reads);
            }
            "gaps" => {
                let tally = trials::gaps(seed, left.min(50_000))?;
                (tally, tally.exchanges)
            }
            "kills" => {
                let tally = kills::kills(seed, left)?;
                (tally, tally.kills)
            }
            "audit" => return audit::audit(seed, left.min(20_000)).map(|(_, attempts)| attempts),
            "stale" => return stale::stale(seed, left.min(20_000)).map(|(bad, _)| bad),
            "holders" => {
                let (count, worst, bound) = holders::holders(seed)?;
                println!("{count} holders: {worst:?} at most, {bound:?} printed");
                return Ok(count);
            }
            "stop" => {
                let count = left.min(500);
                let (worst, _) = trials::stops(seed, count)?;
                let mut longest = self.worst_stop.lock().expect("no thread panics");
                *longest = worst.max(*longest);
                return Ok(count);
            }
            _ => {
                let (tally, _) = simulation::run(seed, WORLD.min(left), self.extras)?;
                (tally, tally.exchanges)
            }
        };
        self.tally.lock().expect("no thread panics").add(&tally);
        Ok(done)
    }
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let text = |name: &str| {
        let place = args.iter().position(|arg| arg == name)?;
        args.get(place + 1).cloned()
    };
    let number = |name: &str| text(name).and_then(|text| text.replace('_', "").parse::<u64>().ok());
    let what = text("--what").unwrap_or_else(|| "year".to_owned());
    let wanted = match what.as_str() {
        "late" | "bursts" | "gaps" => 10_000_000,
        "stop" | "kills" => 10_000,
        "audit" | "stale" => 1_000_000,
        "holders" => 1_024,
        _ => 316_000_000,
    };
    let shards = number("--shards")
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, |it| it.get() as u64));
    let extras = text("--extras").map_or_else(Extras::on, |text| {
        Extras::named(&text).expect("names of extras")
    });
    let begun = Instant::now();
    let job = Job {
        wanted: number("--exchanges").unwrap_or(wanted),
        seed: AtomicU64::new(number("--seed").unwrap_or(1)),
        done: AtomicU64::new(0),
        until: begun + Duration::from_secs(60 * number("--minutes").unwrap_or(24 * 60)),
        is_over: AtomicBool::new(false),
        tally: Mutex::new(Tally {
            shortest_excess: u64::MAX,
            ..Tally::default()
        }),
        worst_stop: Mutex::new(Duration::ZERO),
        bursts: Mutex::new(BurstTally::default()),
        failures: Mutex::new(Vec::new()),
        what,
        extras,
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..shards).map(|_| scope.spawn(|| job.work())).collect();
        scope.spawn(|| progress(&job, begun));
        workers
            .into_iter()
            .for_each(|worker| worker.join().expect("a shard"));
        job.is_over.store(true, Ordering::Relaxed);
    });
    report(&job, begun.elapsed());
    if !job.failures.lock().expect("no thread panics").is_empty() {
        std::process::exit(1);
    }
}

/// One line of the report.
fn row(name: &str, value: impl std::fmt::Display) {
    println!("{name:<34}{value:>20}");
}

fn days(virtual_ns: u64) -> String {
    format!("{:.1} days", virtual_ns as f64 / 86_400e9)
}

/// What happened among bursts, and what they cost a line on which one exchange in a hundred has one.
fn report_bursts(tally: &BurstTally) {
    for (name, value) in [
        ("reads", tally.reads),
        ("reads with words, all right", tally.right),
        ("bursts", tally.bursts),
        ("late replies", tally.late),
        ("frames that answered nothing", tally.strays),
        ("requests on the wire", tally.requests),
    ] {
        row(name, value);
    }
    row("virtual time", days(tally.virtual_ns));
    println!("\nreads a second of a line without bursts, and with one at each hundredth exchange:");
    match bursts::costs(20_000) {
        Ok(rows) => {
            for (name, clean, noisy, longest) in rows {
                let lost = 100.0 * (1.0 - noisy / clean);
                println!(
                    "{name:<34}{clean:>8.1}{noisy:>8.1}{lost:>7.1} % less, longest read {longest:?}"
                );
            }
        }
        Err(text) => println!("{text}"),
    }
}

fn progress(job: &Job, begun: Instant) {
    let mut next = begun + Duration::from_secs(10);
    while !job.is_over.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(100));
        if Instant::now() >= next {
            next += Duration::from_secs(10);
            let done = job.done.load(Ordering::Relaxed);
            let wall = begun.elapsed().as_secs_f64();
            eprintln!(
                "{done} of {} in {wall:.0} s, {:.0} a second",
                job.wanted,
                done as f64 / wall
            );
        }
    }
}

fn report(job: &Job, wall: Duration) {
    let tally = job.tally.lock().expect("no thread panics");
    let done = job.done.load(Ordering::Relaxed);
    row(&format!("{} done", job.what), done);
    row("wall time", format!("{:.1} s", wall.as_secs_f64()));
    row(
        "rate",
        format!("{:.0} /s", done as f64 / wall.as_secs_f64()),
    );
    if job.what == "stop" {
        row(
            "longest wait of a stop",
            format!(
                "{:.3} ms",
                job.worst_stop
                    .lock()
                    .expect("no thread panics")
                    .as_secs_f64()
                    * 1e3
            ),
        );
    }
    if job.what == "bursts" {
        report_bursts(&job.bursts.lock().expect("no thread panics"));
    }
    for (name, value) in [
        ("worlds", tally.worlds),
        ("exchanges", tally.exchanges),
        ("client events", tally.client_events),
        ("requests", tally.checked.requests),
        ("answers", tally.checked.answers),
        ("exceptions", tally.checked.exceptions),
        ("words checked", tally.checked.words_checked),
        ("pictures checked", tally.checked.pictures),
        ("writes on the wire", tally.checked.writes),
        ("MQTT messages", tally.messages),
        ("MQTT results", tally.checked.results),
        ("clients gone", tally.clients_gone),
        ("kills", tally.kills),
        ("run states checked", tally.checked.states),
        ("acts of others", tally.others),
        ("stalls of the way to the broker", tally.broker_stalls),
        ("stalls of connections", tally.client_stalls),
        ("standstills of the process", tally.standstills),
        ("steps of clocks", tally.clock_steps),
        ("late replies", tally.late),
        ("lost replies", tally.lost),
        ("collisions", tally.collisions),
        ("mistakable replies heard", tally.checked.mistakable),
    ] {
        if value > 0 {
            row(name, value);
        }
    }
    if tally.exchanges > 0 {
        row("virtual time", days(tally.virtual_ns));
        row(
            "shortest silence too long by",
            format!("{} ns", tally.shortest_excess),
        );
    }
    for (name, count) in Trouble::NAMES
        .iter()
        .zip(tally.troubles)
        .filter(|(_, count)| *count > 0)
    {
        row(&format!("trouble: {name}"), count);
    }
    row(
        "violations",
        job.failures.lock().expect("no thread panics").len(),
    );
}
