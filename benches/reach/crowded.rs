//! Thousands of clients of the gateway as a process: each once a second, all at once, all silent, and one that floods.

use crate::brokers::free_port;
use crate::crowd::{Crowd, Seen};
use crate::memory::{resident_kb, wait_for};
use crate::pipeline::request;
use crate::plant::{Place, Setup, UNIFORM};
use crate::table::{Row, Times};
use crate::tapped::TappedLine;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Resource, getrlimit};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use vfd_gateway::sim::BusOptions;

const CLIENTS: usize = 10_000;
const IDLE: usize = 19_500;
/// Files of this process other than clients.
const OTHER_FILES: usize = 64;
const A_SECOND: u32 = 5_000;
/// Seconds at the beginning that do not count.
const WARM_UP_S: u32 = 3;

/// A gateway as a process of its own, with one drive.
struct Program {
    child: Running,
    address: SocketAddr,
    line: TappedLine,
    _place: Place,
}

impl Program {
    fn start() -> Self {
        let line = TappedLine::start(1, BusOptions::default());
        let listen = free_port();
        let setup = Setup {
            device: line.path(),
            drives: 1,
            unpaced: false,
            poll: "500ms",
            mqtt: None,
            listen,
        };
        let place = Place::new();
        let file = place.path().join("gateway.toml");
        // As many as the limit of open files allows: the default limit is lower.
        std::fs::write(&file, format!("{}connections_max = 65536\n", setup.text()))
            .expect("a file");
        let mut command = Command::new(env!("CARGO_BIN_EXE_vfd-gateway"));
        command
            .args(["run", "-c"])
            .arg(&file)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let child = Running(command.spawn().expect("the gateway starts"));
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, listen));
        wait_for(address);
        std::thread::sleep(Duration::from_secs(1));
        Self {
            child,
            address,
            line,
            _place: place,
        }
    }

    fn megabytes(&self) -> f64 {
        resident_kb(&self.child.0) as f64 / 1024.0
    }

    /// Processor time so far, in seconds.
    fn processor_s(&self) -> f64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.child.0.id()))
            .expect("its times");
        let (_, behind) = stat.rsplit_once(')').expect("its name");
        let ticks = behind
            .split_whitespace()
            .skip(11)
            .take(2)
            .map(|it| it.parse::<f64>().expect("ticks"));
        ticks.sum::<f64>() / 100.0
    }

    fn stop(self) {
        drop(self.child);
        self.line.stop();
    }
}

/// A process that is killed when this is dropped, so that a bench that panics leaves none behind. Its drive is not
/// running.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub fn crowd() -> Vec<Row> {
    let gateway = Program::start();
    let before = gateway.megabytes();
    let began = Instant::now();
    let mut crowd = Crowd::connect(gateway.address, CLIENTS, A_SECOND);
    let opened = began.elapsed();
    crowd.ask_for(WARM_UP_S);
    let began = Instant::now();
    let used = gateway.processor_s();
    let seen = crowd.ask_for(if crate::is_quick() { 3 } else { 20 });
    let busy = (gateway.processor_s() - used) / began.elapsed().as_secs_f64() * 100.0;
    let mut rows = vec![
        Row::told(
            format!("crowd: {CLIENTS} connections opened in, s"),
            format!("{:.2}", opened.as_secs_f64()),
        ),
        Row::at_most(
            format!("crowd: {CLIENTS} clients once a second, p99, ms"),
            10.0,
            seen.took().at(0.99),
        ),
        Row::told("crowd: p50 / p99 / max, ms", seen.took().shown()),
        Row::told(
            "crowd: requests sent late by this program, p50 / p99 / max, ms",
            seen.late().shown(),
        ),
        Row::none("crowd: requests without an answer", seen.lost),
        Row::told(
            "crowd: processor of the gateway, % of one core",
            format!("{busy:.1}"),
        ),
        Row::told(
            "crowd: resident before / with them, MB",
            format!("{before:.1} / {:.1}", gateway.megabytes()),
        ),
        Row::at_most("crowd: resident with them, MB", 60.0, gateway.megabytes()),
    ];
    let bursts: Vec<Seen> = (0..if crate::is_quick() { 1 } else { 5 })
        .map(|_| crowd.burst())
        .collect();
    let worst = bursts
        .iter()
        .map(Seen::took)
        .max_by(|a, b| a.at(0.99).total_cmp(&b.at(0.99)));
    rows.push(Row::told(
        "crowd: all at once, p50 / p99 / max, ms",
        worst.as_ref().map_or_else(String::new, Times::shown),
    ));
    rows.push(Row::none(
        "crowd: of that without an answer",
        bursts.iter().map(|seen| seen.lost).sum(),
    ));
    rows.push(Row::told(
        "crowd: resident after that, MB",
        format!("{:.1}", gateway.megabytes()),
    ));
    rows.extend(flooded(&gateway, &mut crowd));
    drop(crowd);
    gateway.stop();
    rows.extend(idle());
    rows
}

/// With a client that floods, without it, and with a program that is as busy but sends nothing, in turn: on a small
/// machine any flood takes a processor from all.
fn flooded(gateway: &Program, crowd: &mut Crowd) -> Vec<Row> {
    let seconds = if crate::is_quick() { 2 } else { 6 };
    let rounds = if crate::is_quick() { 1 } else { 5 };
    let mut quiet = Vec::new();
    let mut busy = Vec::new();
    let mut flooded = Vec::new();
    let mut answers = 0;
    let mut lost = 0;
    let mut p99 = |crowd: &mut Crowd| {
        let seen = crowd.ask_for(seconds);
        lost += seen.lost;
        seen.took().at(0.99)
    };
    for _ in 0..rounds {
        quiet.push(p99(crowd));
        let spinner = Spinner::start();
        busy.push(p99(crowd));
        spinner.stop();
        let flood = Flood::start(gateway.address);
        std::thread::sleep(Duration::from_millis(300));
        flooded.push(p99(crowd));
        answers += flood.stop();
    }
    let [quiet, busy, flooded] = [quiet, busy, flooded].map(median);
    let time = f64::from(seconds * rounds);
    vec![
        Row::told(
            "flood: p99 of the others without / beside a busy program / beside one that floods, ms",
            format!("{quiet:.3} / {busy:.3} / {flooded:.3}"),
        ),
        Row::at_most(
            "flood: p99 of the others grows by a factor of",
            2.0,
            flooded / quiet,
        ),
        Row::told(
            "flood: and against that beside a busy program by",
            format!("{:.2}", flooded / busy),
        ),
        Row::none(
            "flood: requests of the others without an answer within a second",
            lost,
        ),
        Row::told(
            "flood: answers/s to the one that floods",
            format!("{:.0}", answers as f64 / time),
        ),
    ]
}

fn median(mut of: Vec<f64>) -> f64 {
    of.sort_by(f64::total_cmp);
    of[of.len() / 2]
}

/// A thread that spins.
struct Spinner {
    end: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Spinner {
    fn start() -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let spin = move || {
            while !ended.load(Ordering::Relaxed) {
                std::hint::spin_loop();
            }
        };
        Self {
            end,
            thread: std::thread::spawn(spin),
        }
    }

    fn stop(self) {
        self.end.store(true, Ordering::Relaxed);
        self.thread.join().expect("it ends");
    }
}

/// As many clients that never send a request.
fn idle() -> Vec<Row> {
    let files = getrlimit(Resource::Nofile)
        .current
        .map_or(usize::MAX, |files| files as usize);
    let count = IDLE.min(files - OTHER_FILES);
    let gateway = Program::start();
    let mut crowd = Crowd::connect(gateway.address, count, A_SECOND);
    std::thread::sleep(Duration::from_secs(1));
    let connected = crowd.connected();
    let memory = gateway.megabytes();
    let seen = crowd.burst();
    drop(crowd);
    gateway.stop();
    vec![
        Row::all(
            format!("idle: connections held, with a limit of {files} files"),
            count,
            connected,
        ),
        Row::told("idle: resident with them, MB", format!("{memory:.1}")),
        Row::none("idle: then all ask at once: without an answer", seen.lost),
        Row::told("idle: then p50 / p99 / max, ms", seen.took().shown()),
    ]
}

/// A client that never stops sending requests.
struct Flood {
    end: Arc<AtomicBool>,
    answers: Arc<AtomicU64>,
    thread: JoinHandle<()>,
}

impl Flood {
    fn start(address: SocketAddr) -> Self {
        let mut stream = TcpStream::connect(address).expect("the gateway accepts");
        stream.set_nonblocking(true).expect("non-blocking");
        let end = Arc::new(AtomicBool::new(false));
        let answers = Arc::new(AtomicU64::new(0));
        let ended = Arc::clone(&end);
        let counted = Arc::clone(&answers);
        let requests: Vec<u8> = (0..512)
            .flat_map(|slot| request(slot, UNIFORM, 3, [0, 16]))
            .collect();
        let thread = std::thread::spawn(move || {
            let mut sent = 0;
            let mut buffer = vec![0; 64 * 1024];
            while !ended.load(Ordering::Relaxed) {
                let read = stream.read(&mut buffer).unwrap_or(0);
                counted.fetch_add(read as u64, Ordering::Relaxed);
                let written = stream.write(&requests[sent..]).unwrap_or(0);
                sent = (sent + written) % requests.len();
                if read == 0 && written == 0 {
                    let mut fds = [PollFd::new(&stream, PollFlags::IN | PollFlags::OUT)];
                    let _ = poll(
                        &mut fds,
                        Some(&Timespec {
                            tv_sec: 0,
                            tv_nsec: 50_000_000,
                        }),
                    );
                }
            }
        });
        Self {
            end,
            answers,
            thread,
        }
    }

    /// Ends it. Returns how many answers it received.
    fn stop(self) -> u64 {
        self.end.store(true, Ordering::Relaxed);
        self.thread.join().expect("it ends");
        self.answers.load(Ordering::Relaxed) / (9 + 32)
    }
}
