//! How soon the program serves after its start, and how much memory it needs: thirty-two drives, a journal, a broker,
//! ten Modbus clients and an open page.
//!
//! The goals are those of a release, which is linked differently from measured builds. `VFD_GATEWAY` names the program
//! to measure: `cargo build --profile dist --bin vfd-gateway`, then `VFD_GATEWAY=target/dist/vfd-gateway cargo bench
//! --bench reach -- footprint`.

use crate::bare_mqtt::Talker;
use crate::brokers::{Broker, free_port};
use crate::clients;
use crate::plant::Place;
use crate::table::{Row, Times};
use crate::telemetry::{Answered, DRIVES, LINES, POINTS, POLL, lines_text, start_line};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const STARTS: usize = 50;
const CLIENTS: usize = 10;
/// From the start of the process to the answer that everything is open.
const START_MS: f64 = 200.0;
const RESIDENT_MB: f64 = 20.0;
const PROGRAM_MB: f64 = 15.0;
/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(20);
/// Interval of checks whether it serves: small compared with the goal.
const LOOK: Duration = Duration::from_millis(1);
/// What the page requests when it is opened, besides its files.
const DOCUMENTS: [&str; 4] = [
    "/api/v1/state",
    "/api/v1/advice",
    "/api/v1/journal?last=200",
    "/api/v1/health",
];

pub fn footprint() -> Vec<Row> {
    let answered = Arc::new(Answered::new());
    let end = Arc::new(AtomicBool::new(false));
    let lines: Vec<_> = (0..LINES)
        .map(|line| start_line(line, &answered, &end))
        .collect();
    let ports: Vec<_> = lines.iter().map(|(port, _)| port.clone()).collect();
    let broker = Broker::start(false);
    let place = Place::new();
    let plant = Plant::new(&place, &ports, broker.port);
    let mut rows = vec![
        Row::told(
            "footprint: drives on lines, points of each, poll",
            drives_told(),
        ),
        Row::at_most(
            "footprint: size of the program, MB",
            PROGRAM_MB,
            plant.program_mb(),
        ),
    ];
    rows.extend(plant.starts(if crate::is_quick() { 10 } else { STARTS }));
    rows.extend(plant.memory(
        broker.port,
        Duration::from_secs(if crate::is_quick() { 5 } else { 30 }),
    ));
    end.store(true, Ordering::Relaxed);
    lines
        .into_iter()
        .for_each(|(_, line)| line.join().expect("a line ends"));
    rows
}

fn drives_told() -> String {
    format!(
        "{} on {LINES}, {POINTS}, {POLL:?}",
        LINES * usize::from(DRIVES)
    )
}

/// The program, and how it is started.
struct Plant {
    program: PathBuf,
    file: PathBuf,
    http: SocketAddr,
    modbus: SocketAddr,
}

impl Plant {
    fn new(place: &Place, ports: &[PathBuf], broker: u16) -> Self {
        let program = program();
        let [http, modbus] =
            [free_port(), free_port()].map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
        let data = place.path().join("data");
        std::fs::create_dir(&data).expect("a directory");
        let head = format!(
            "[gateway]\nname = \"bench\"\ndata_dir = \"{}\"\n",
            data.display()
        );
        let text = format!(
            "{}[mqtt]\nbroker = \"mqtt://127.0.0.1:{broker}\"\n[[modbus_tcp]]\nlisten = \"{modbus}\"\n\
             [http]\nlisten = \"{http}\"\n",
            lines_text(&head, ports, POLL)
        );
        let file = place.path().join("gateway.toml");
        std::fs::write(&file, text).expect("a file");
        Self {
            program,
            file,
            http,
            modbus,
        }
    }

    fn program_mb(&self) -> f64 {
        std::fs::metadata(&self.program).expect("the program").len() as f64 / 1e6
    }

    fn start(&self) -> Child {
        start(&self.program, &self.file)
    }

    /// How long it takes until a Modbus client has its first words, and until all lines and the broker are connected.
    fn starts(&self, count: usize) -> Vec<Row> {
        let mut answered = Vec::new();
        let mut ready = Vec::new();
        for _ in 0..count {
            let begun = Instant::now();
            let mut gateway = self.start();
            answered.push(until(begun, || has_words(self.modbus)));
            ready.push(until(begun, || is_ready(self.http)));
            end(&mut gateway);
        }
        let answered = Times::new(answered);
        let ready = Times::new(ready);
        vec![
            Row::told(
                format!(
                    "footprint: {count} starts to the first Modbus answer, p50 / p99 / max, ms"
                ),
                answered.shown(),
            ),
            Row::told(
                "footprint: to all lines and the broker, p50 / p99 / max, ms",
                ready.shown(),
            ),
            Row::at_most(
                "footprint: to all lines and the broker, p99, ms",
                START_MS,
                ready.at(0.99),
            ),
        ]
    }

    /// What it needs under that load. The broker is a process of its own and is not counted.
    fn memory(&self, broker: u16, span: Duration) -> Vec<Row> {
        let begun = Instant::now();
        let mut gateway = self.start();
        until(begun, || is_ready(self.http));
        let _subscriber =
            Talker::connect(broker, "bench-watch", &["vfd/bench/#"]).expect("it accepts");
        std::thread::sleep(span);
        let alone = Memory::of(gateway.id());
        let http = self.http;
        let over = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&over);
        let page = std::thread::spawn(move || open_page(http, &is_over));
        let load = clients::run(
            self.modbus,
            CLIENTS,
            Duration::ZERO,
            span,
            |client, request| {
                // Every client reads all words of every drive's uniform unit.
                (
                    101 + ((client as u64 + request) % (LINES as u64 * u64::from(DRIVES))) as u8,
                    0,
                    16,
                )
            },
        );
        let busy = Memory::of(gateway.id());
        over.store(true, Ordering::Relaxed);
        let events = page.join().expect("the page");
        end(&mut gateway);
        vec![
            Row::told(
                "footprint: resident with 32 drives and a broker, MB",
                alone.shown(),
            ),
            Row::told(
                format!("footprint: {CLIENTS} clients' answers a second / events of the page"),
                format!("{:.0} / {events}", load.rate()),
            ),
            Row::told(
                format!("footprint: the same with the page and {CLIENTS} clients, MB"),
                busy.shown(),
            ),
            Row::at_most(
                format!("footprint: resident with the page and {CLIENTS} clients, MB"),
                RESIDENT_MB,
                busy.resident_mb,
            ),
        ]
    }
}

/// The program to measure.
pub fn program() -> PathBuf {
    std::env::var_os("VFD_GATEWAY")
        .map_or_else(|| env!("CARGO_BIN_EXE_vfd-gateway").into(), PathBuf::from)
}

/// The gateway of a configuration, as a process of its own.
pub fn start(program: &Path, file: &Path) -> Child {
    let mut command = Command::new(program);
    command
        .args(["run", "-c"])
        .arg(file)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.spawn().expect("the gateway starts")
}

/// Polls until `is_so`. Returns the time since `begun`.
pub fn until(begun: Instant, mut is_so: impl FnMut() -> bool) -> Duration {
    while !is_so() {
        assert!(begun.elapsed() < PATIENCE, "the gateway does not serve");
        std::thread::sleep(LOOK);
    }
    begun.elapsed()
}

pub fn has_words(modbus: SocketAddr) -> bool {
    TcpStream::connect(modbus)
        .is_ok_and(|mut stream| clients::once(&mut stream, (101, 0, 1)).is_ok())
}

pub fn is_ready(http: SocketAddr) -> bool {
    TcpStream::connect(http).is_ok_and(|stream| get(stream, "/readyz").starts_with("HTTP/1.1 200"))
}

fn get(mut stream: TcpStream, path: &str) -> String {
    let request = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).expect("it reads");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("it answers");
    String::from_utf8_lossy(&answer).into_owned()
}

/// Loads what a browser loads, and then reads events until `is_over`. Returns how many there were.
fn open_page(http: SocketAddr, is_over: &AtomicBool) -> usize {
    let ask = |path: &str| {
        let answer = get(TcpStream::connect(http).expect("it accepts"), path);
        assert!(answer.starts_with("HTTP/1.1 200"), "{path}: {answer:.200}");
        answer
    };
    let index = ask("/");
    let files: Vec<_> = index
        .split('"')
        .filter(|path| path.contains("assets/"))
        .collect();
    assert!(!files.is_empty(), "a page names its files");
    files
        .iter()
        .for_each(|path| drop(ask(&format!("/{}", path.trim_start_matches(['.', '/'])))));
    DOCUMENTS.iter().for_each(|path| drop(ask(path)));
    (0..LINES * usize::from(DRIVES))
        .for_each(|drive| drop(ask(&format!("/api/v1/trend?drive=d{drive}"))));
    let mut stream = TcpStream::connect(http).expect("it accepts");
    stream
        .write_all(b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .expect("it reads");
    let mut events = 0;
    let mut buffer = vec![0; 64 * 1024];
    while !is_over.load(Ordering::Relaxed) {
        let length = stream.read(&mut buffer).expect("events");
        assert!(length > 0, "the gateway has closed the connection");
        events += String::from_utf8_lossy(&buffer[..length])
            .matches("event: ")
            .count();
    }
    events
}

/// It may be killed: its drives are not running.
pub fn end(gateway: &mut Child) {
    gateway.kill().expect("killed");
    gateway.wait().expect("collected");
}

/// The memory of a process as reported by the system.
pub struct Memory {
    pub resident_mb: f64,
    /// Of that, anonymous memory; the rest are mapped pages of the program's file.
    own_mb: f64,
    most_mb: f64,
    threads: u64,
}

impl Memory {
    pub fn of(process: u32) -> Self {
        let status =
            std::fs::read_to_string(Path::new("/proc").join(process.to_string()).join("status"))
                .expect("a process");
        let number = |key: &str| -> u64 {
            let line = status
                .lines()
                .find_map(|line| line.strip_prefix(key))
                .expect("its size");
            line.trim()
                .trim_end_matches(" kB")
                .parse()
                .expect("a number")
        };
        let mb = |key: &str| number(key) as f64 * 1024.0 / 1e6;
        Self {
            resident_mb: mb("VmRSS:"),
            own_mb: mb("RssAnon:"),
            most_mb: mb("VmHWM:"),
            threads: number("Threads:"),
        }
    }

    pub fn shown(&self) -> String {
        format!(
            "{:.1}, own {:.1}, most {:.1}, {} threads",
            self.resident_mb, self.own_mb, self.most_mb, self.threads
        )
    }
}
