//! Thirty-two drives of twenty points each, all of which change with every poll: how soon a subscriber has them, and what
//! that costs. The gateway is a process of its own, so that only its own time is counted.

use crate::bare_mqtt::Talker;
use crate::brokers::Broker;
use crate::plant::Place;
use crate::support::{PROOF, n700};
use crate::table::{Row, Times};
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::lines::simulator;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::sim::{BusOptions, BusPacing, DriveOptions, SimBus, SimDrive};

pub const LINES: usize = 8;
pub const DRIVES: u8 = 4;
pub const POINTS: u16 = 20;
pub const POLL: Duration = Duration::from_millis(500);
const WARM_UP: Duration = Duration::from_secs(5);
/// Exchanges of a drive that are remembered: longer than any message is under way.
const REMEMBERED: usize = 4096;
/// Ticks a second in which the system counts the time of a process.
const TICKS: f64 = 100.0;

/// When each exchange of each drive was answered, in nanoseconds from `begun`.
pub struct Answered {
    begun: Instant,
    drives: Vec<Vec<AtomicU64>>,
}

impl Answered {
    pub fn new() -> Self {
        let times = || (0..REMEMBERED).map(|_| AtomicU64::new(0)).collect();
        Self {
            begun: Instant::now(),
            drives: (0..LINES * usize::from(DRIVES)).map(|_| times()).collect(),
        }
    }

    fn note(&self, drive: usize, exchange: u64) {
        let now = u64::try_from(self.begun.elapsed().as_nanos()).expect("a short measurement");
        self.drives[drive][exchange as usize % REMEMBERED].store(now, Ordering::Release);
    }

    /// How long ago that was.
    fn age(&self, drive: usize, word: u64) -> Duration {
        let at = self.drives[drive][word as usize % REMEMBERED].load(Ordering::Acquire);
        self.begun
            .elapsed()
            .saturating_sub(Duration::from_nanos(at))
    }
}

/// What the subscriber received during the measurement.
#[derive(Default)]
struct Seen {
    ages: Vec<Duration>,
    states: u64,
}

pub fn telemetry() -> Vec<Row> {
    let look = Duration::from_secs(if crate::is_quick() { 5 } else { 30 });
    let answered = Arc::new(Answered::new());
    let end = Arc::new(AtomicBool::new(false));
    let lines: Vec<_> = (0..LINES)
        .map(|line| start_line(line, &answered, &end))
        .collect();
    let ports: Vec<_> = lines.iter().map(|(port, _)| port.clone()).collect();
    let broker = Broker::start(false);
    let place = Place::new();
    let mut gateway = start_gateway(&place, &configuration(&ports, broker.port));
    let mut subscriber =
        Talker::connect(broker.port, "bench-watch", &["vfd/bench/drive/#"]).expect("it accepts");
    watch(&mut subscriber, &answered, WARM_UP);
    let ticks = ticks(gateway.id());
    let threads = thread_ticks(gateway.id());
    let begun = Instant::now();
    let seen = watch(&mut subscriber, &answered, look);
    let took = begun.elapsed();
    let used = self::ticks(gateway.id()) - ticks;
    let threads = thread_ticks(gateway.id()) - threads;
    gateway.kill().expect("killed");
    gateway.wait().expect("collected");
    end.store(true, Ordering::Relaxed);
    lines
        .into_iter()
        .for_each(|(_, line)| line.join().expect("a line ends"));
    rows(&seen, took, used, threads, broker.name())
}

fn rows(seen: &Seen, took: Duration, used: f64, of_lines: f64, broker: &str) -> Vec<Row> {
    let polls = took.as_secs_f64() / POLL.as_secs_f64();
    let points = LINES as f64 * f64::from(DRIVES) * f64::from(POINTS);
    let in_time = seen.ages.iter().filter(|age| **age <= POLL).count();
    let times = Times::new(seen.ages.iter().copied());
    vec![
        Row::told(
            "telemetry: drives, points of each, poll, broker",
            format!("32, {POINTS}, {POLL:?}, {broker}"),
        ),
        Row::told(
            "telemetry: answer of the drive to subscriber, p50 / p99 / max, ms",
            times.shown(),
        ),
        Row::all(
            "telemetry: changes that came within one poll",
            seen.ages.len(),
            in_time,
        ),
        Row::at_least(
            "telemetry: changes that came, of all that there were",
            0.98,
            seen.ages.len() as f64 / (polls * points),
        ),
        Row::told(
            "telemetry: values / states published a second",
            format!(
                "{:.0} / {:.0}",
                seen.ages.len() as f64 / took.as_secs_f64(),
                seen.states as f64 / took.as_secs_f64()
            ),
        ),
        Row::at_most(
            "telemetry: CPU of the gateway, % of a core",
            10.0,
            per_cent(used, took),
        ),
        Row::told(
            "telemetry: of that for its lines, % of a core",
            format!("{:.1}", per_cent(of_lines, took)),
        ),
    ]
}

/// Receives for `span`.
fn watch(subscriber: &mut Talker, answered: &Answered, span: Duration) -> Seen {
    let mut seen = Seen::default();
    let until = Instant::now() + span;
    while let Some(message) = subscriber
        .next(until.saturating_duration_since(Instant::now()))
        .expect("it is there")
    {
        let mut levels = message.topic.split('/').skip(3);
        let drive = levels
            .next()
            .and_then(|name| name.strip_prefix('d'))
            .and_then(|number| number.parse().ok());
        let (Some(drive), Some(level)) = (drive, levels.next()) else {
            continue;
        };
        seen.states += u64::from(level == "state");
        let is_point =
            level == "measure" && levels.next().is_some_and(|name| name.starts_with('v'));
        let word = std::str::from_utf8(&message.payload)
            .ok()
            .and_then(|text| text.parse().ok());
        if let Some(word) = word.filter(|_| is_point && !message.retain) {
            seen.ages.push(answered.age(drive, word));
        }
    }
    seen
}

/// A line whose drives record when they answered each exchange.
pub fn start_line(
    line: usize,
    answered: &Arc<Answered>,
    end: &Arc<AtomicBool>,
) -> (PathBuf, JoinHandle<()>) {
    let pty = Pty::new().expect("a pseudo-terminal");
    let port = pty.path().to_owned();
    let answered = Arc::clone(answered);
    let end = Arc::clone(end);
    let thread = std::thread::spawn(move || {
        let options = BusOptions {
            pacing: BusPacing::None,
            silence: Some(Duration::ZERO),
            ..BusOptions::default()
        };
        let mut bus = SimBus::new(LinkSettings::DEFAULT, options, 1);
        for station in 1..=DRIVES {
            let drive = DriveOptions {
                proof_words: Some(PROOF..=PROOF + 0xFF),
                ..DriveOptions::default()
            };
            bus.connect(Station(station), SimDrive::new(n700(), drive));
        }
        let mut last = [0; DRIVES as usize];
        let look = |bus: &mut SimBus, _| {
            for (place, last) in last.iter_mut().enumerate() {
                let exchange = bus.exchange(Station(place as u8 + 1));
                if exchange != *last {
                    *last = exchange;
                    answered.note(line * usize::from(DRIVES) + place, exchange & 0xFFFF);
                }
            }
        };
        simulator::play(&pty, &mut bus, &end, look).expect("the simulated line");
    });
    (port, thread)
}

/// The program with this configuration, as a process of its own.
pub fn start_gateway(place: &Place, text: &str) -> Child {
    let file = place.path().join("gateway.toml");
    fs::write(&file, text).expect("a file");
    let mut command = Command::new(env!("CARGO_BIN_EXE_vfd-gateway"));
    command
        .args(["run", "-c"])
        .arg(file)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.spawn().expect("the gateway starts")
}

fn configuration(ports: &[PathBuf], broker: u16) -> String {
    let mut text = lines_text("[gateway]\nname = \"bench\"\n", ports, POLL);
    let _ = write!(text, "[mqtt]\nbroker = \"mqtt://127.0.0.1:{broker}\"\n");
    text + "[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n"
}

/// `head`, followed by a line with its drives at each of `ports`, polled at the period `poll`.
pub fn lines_text(head: &str, ports: &[PathBuf], poll: Duration) -> String {
    let mut text = head.to_owned();
    // Writing to a String cannot fail.
    for (line, port) in ports.iter().enumerate() {
        let _ = write!(
            text,
            "[[line]]\nname = \"l{line}\"\nport = \"{}\"\nsilence = \"0ms\"\n",
            port.display()
        );
        for station in 1..=usize::from(DRIVES) {
            let drive = line * usize::from(DRIVES) + station - 1;
            let unit = drive + 1;
            let uniform = drive + 101;
            let _ = write!(
                text,
                "[[line.drive]]\nname = \"d{drive}\"\nmodel = \"hyundai-n700\"\nstation = {station}\n\
                 poll = \"{}ms\"\nunit = {unit}\nuniform_unit = {uniform}\n",
                poll.as_millis(),
            );
            for point in 0..POINTS {
                let _ = write!(
                    text,
                    "[[line.drive.register]]\nname = \"v{point}\"\ntitle = \"v\"\naddress = {}\nunit = \"-\"\n\
                     access = \"read\"\npoll = \"fast\"\n",
                    PROOF + point,
                );
            }
        }
    }
    text
}

/// Processor time of a process so far, in ticks.
pub fn ticks(process: u32) -> f64 {
    used(&format!("/proc/{process}/stat"))
}

/// That of its threads that serve lines.
pub fn thread_ticks(process: u32) -> f64 {
    let tasks = fs::read_dir(format!("/proc/{process}/task")).expect("a process");
    let stats = tasks.filter_map(Result::ok).map(|task| task.path());
    let is_line = |path: &PathBuf| {
        fs::read_to_string(path.join("comm")).is_ok_and(|name| name.starts_with("line "))
    };
    stats
        .filter(is_line)
        .map(|path| used(&path.join("stat").to_string_lossy()))
        .sum()
}

fn used(path: &str) -> f64 {
    let text = fs::read_to_string(path).expect("a process");
    // The name in brackets may contain blanks.
    let (_, rest) = text.rsplit_once(") ").expect("fields behind the name");
    let fields: Vec<&str> = rest.split(' ').collect();
    fields[11..13]
        .iter()
        .map(|field| field.parse::<f64>().expect("a number"))
        .sum()
}

/// Ticks within `took` in per cent of a core.
pub fn per_cent(ticks: f64, took: Duration) -> f64 {
    ticks / TICKS / took.as_secs_f64() * 100.0
}
