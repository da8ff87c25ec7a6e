//! The adapter is unplugged and replugged, with the program as a process: leaks, recovery time, and the cost while the
//! adapter is missing.

use crate::adapter::Adapter;
use crate::brokers::free_port;
use crate::plant::{Place, Setup};
use crate::table::{Row, Times};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The frequency source: read only when a client asks.
const F010: [u8; 2] = [0x02, 0x11];
/// Requests in flight when an adapter is unplugged.
const IN_FLIGHT: usize = 8;
/// Longer than anything here takes.
const PATIENCE: Duration = Duration::from_secs(10);
/// Ticks of a second in which the kernel counts processor time, on every architecture of Linux (`USER_HZ`).
const TICKS: f64 = 100.0;

pub fn unplug() -> Vec<Row> {
    let (cycles, away) = if crate::is_quick() {
        (50, Duration::from_secs(3))
    } else {
        (500, Duration::from_secs(10))
    };
    let place = Place::new();
    let device = place.path().join("line");
    let mut adapter = Adapter::new(&device);
    adapter.plug_in();
    let listen = free_port();
    let setup = Setup {
        device: &device,
        drives: 1,
        unpaced: false,
        poll: "500ms",
        mqtt: None,
        listen,
    };
    let file = place.path().join("gateway.toml");
    std::fs::write(&file, setup.text()).expect("a file");
    let mut command = Command::new(env!("CARGO_BIN_EXE_vfd-gateway"));
    command
        .args(["run", "-c"])
        .arg(&file)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut gateway = command.spawn().expect("the gateway starts");
    let mut client = Client::connect(SocketAddr::from((Ipv4Addr::LOCALHOST, listen)));
    client.wait_until(true);
    let before = descriptors(&gateway);
    let mut unanswered = 0;
    let spans: Vec<Duration> = (0..cycles)
        .map(|cycle| {
            if cycle % 2 == 1 {
                client.send(IN_FLIGHT);
                adapter.pull_out();
                unanswered += IN_FLIGHT - client.answers(IN_FLIGHT);
            } else {
                adapter.pull_out();
            }
            client.wait_until(false);
            // Varies the moment between two attempts.
            std::thread::sleep(Duration::from_millis(cycle * 37 % 500));
            adapter.plug_in();
            let plugged = Instant::now();
            client.wait_until(true);
            plugged.elapsed()
        })
        .collect();
    let after = descriptors(&gateway);
    adapter.pull_out();
    client.wait_until(false);
    let begun = Instant::now();
    let used = ticks(&gateway);
    std::thread::sleep(away);
    let used = (ticks(&gateway) - used) as f64 / TICKS / begun.elapsed().as_secs_f64() * 100.0;
    // It may be killed: its drive is not running.
    gateway.kill().expect("killed");
    gateway.wait().expect("collected");
    let times = Times::new(spans);
    vec![
        Row::all(
            "unplug: cycles in which the drive came back",
            cycles as usize,
            times.len(),
        ),
        Row::none(
            "unplug: descriptors more than before",
            after.saturating_sub(before) as u64,
        ),
        Row::none(
            "unplug: requests in flight without an answer",
            unanswered as u64,
        ),
        Row::told(
            "unplug: device back until the first good answer, p50 / p99 / max, ms",
            times.shown(),
        ),
        Row::at_most("unplug: longest of them, ms", 1000.0, times.at(1.0)),
        Row::at_most("unplug: processor while the device is away, %", 2.0, used),
    ]
}

/// A Modbus TCP client that tolerates everything.
struct Client {
    stream: TcpStream,
}

impl Client {
    fn connect(address: SocketAddr) -> Self {
        let until = Instant::now() + PATIENCE;
        loop {
            if let Ok(stream) = TcpStream::connect(address) {
                stream.set_nodelay(true).expect("an option");
                stream.set_read_timeout(Some(PATIENCE)).expect("an option");
                return Self { stream };
            }
            assert!(Instant::now() < until, "the gateway does not listen");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Sends `count` reads of one register.
    fn send(&mut self, count: usize) {
        let request = [0, 1, 0, 0, 0, 6, 1, 3, F010[0], F010[1], 0, 1];
        self.stream.write_all(&request.repeat(count)).expect("sent");
    }

    /// How many of `count` answers arrive.
    fn answers(&mut self, count: usize) -> usize {
        (0..count).take_while(|_| self.answer().is_some()).count()
    }

    /// Whether the next answer contains a word; `None` if there is no answer.
    fn answer(&mut self) -> Option<bool> {
        let mut header = [0; 8];
        self.stream.read_exact(&mut header).ok()?;
        let mut rest = vec![0; usize::from(header[5]) - 2];
        self.stream.read_exact(&mut rest).ok()?;
        Some(header[7] == 3)
    }

    /// Reads until it succeeds, or fails, as `succeeds` says.
    fn wait_until(&mut self, succeeds: bool) {
        let until = Instant::now() + PATIENCE;
        loop {
            self.send(1);
            if self.answer().expect("an answer") == succeeds {
                return;
            }
            assert!(Instant::now() < until, "the line does not change");
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

fn descriptors(program: &Child) -> usize {
    std::fs::read_dir(format!("/proc/{}/fd", program.id()))
        .expect("its descriptors")
        .count()
}

/// Processor time of all its threads so far, in ticks.
fn ticks(program: &Child) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", program.id())).expect("its times");
    // The name in brackets may contain spaces; utime and stime are the 12th and 13th field after it.
    let (_, fields) = stat.rsplit_once(')').expect("a name");
    fields
        .split_whitespace()
        .skip(11)
        .take(2)
        .map(|ticks| ticks.parse::<u64>().expect("a number"))
        .sum()
}
