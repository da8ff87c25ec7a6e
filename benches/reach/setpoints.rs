//! Ten thousand setpoints a second for one drive: the newest wins, others are still answered, and a STOP is sent in
//! time.

use crate::commander::Commander;
use crate::pipeline::{request, taken};
use crate::plant::{Gateway, RUN, Setup, UNIFORM};
use crate::table::{Row, Times};
use crate::tapped::TappedLine;
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use vfd_gateway::config::line_plan;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::sim::BusOptions;

const A_SECOND: u64 = 10_000;
const CONNECTIONS: usize = 50;
const RUN_WORD: u16 = 256;
const SETPOINT_WORD: u16 = 257;
/// The drive's register for it, in the same steps of 0.01 Hz.
const SETPOINT: u16 = 0x0004;
/// What is written last; no other setpoint is this one.
const LAST: u16 = 4999;
const PATIENCE: Duration = Duration::from_secs(5);

pub fn setpoints() -> Vec<Row> {
    let line = TappedLine::start(1, BusOptions::default());
    let setup = Setup {
        device: line.path(),
        drives: 1,
        unpaced: false,
        poll: "500ms",
        mqtt: None,
        listen: 0,
    };
    let bounds = line_plan::stop_bounds(&setup.config().lines[0]);
    let gateway = Gateway::start(&setup);
    let mut commander = Commander::connect(gateway.address);
    let mut reader = Commander::connect(gateway.address);
    // A client that has commanded stop may start.
    commander.insist(UNIFORM, RUN_WORD, 0);
    let flood = Flood::start(gateway.address);
    let rounds = if crate::is_quick() { 5 } else { 60 };
    let mut stops = Vec::new();
    let mut reads = Vec::new();
    for round in 0..rounds {
        commander.insist(UNIFORM, RUN_WORD, 1);
        // So that every moment of an exchange is equally likely.
        std::thread::sleep(Duration::from_micros(200_000 + round * 7_919 % 42_000));
        let asked = clock::now();
        commander.send(UNIFORM, RUN_WORD, 0);
        let is_stop = |heard: &crate::tapped::Heard| heard.is_write(RUN, 0) && heard.at >= asked;
        let stop = line
            .wait_for(PATIENCE, is_stop, |_| {})
            .expect("the STOP goes out");
        stops.push(stop.at.since(asked));
        commander.answer().expect("the STOP is taken");
        let asked = Instant::now();
        reader.read(1, 0x3000, 4).expect("the line is read");
        reads.push(asked.elapsed());
    }
    let (sent, time) = flood.stop();
    let last = line.wait_for(PATIENCE, |heard| heard.is_write(SETPOINT, LAST), |_| {});
    let behind = line.wait_for(
        Duration::from_millis(500),
        |heard| heard.writes() && heard.frame[3] == SETPOINT as u8,
        |_| {},
    );
    gateway.stop();
    line.stop();
    let stops = Times::new(stops);
    let reads = Times::new(reads);
    let in_ms = |bound: Duration| bound.as_secs_f64() * 1e3;
    vec![
        Row::rate(
            "setpoints: sent a second to one drive",
            A_SECOND as f64 * 0.95,
            sent as f64 / time.as_secs_f64(),
        ),
        Row::at_most(
            "setpoints: longest wait of a STOP, against its printed bound, ms",
            in_ms(bounds.all_healthy),
            stops.at(1.0),
        ),
        Row::told("setpoints: STOP p50 / p99 / max, ms", stops.shown()),
        Row::told(
            "setpoints: native reads of another p50 / p99 / max, ms",
            reads.shown(),
        ),
        Row::all(
            "setpoints: the newest one reaches the drive",
            1,
            usize::from(last.is_some()),
        ),
        Row::none(
            "setpoints: other ones behind it",
            u64::from(behind.is_some()),
        ),
    ]
}

/// Connections of one client that write setpoints and read no more of the answers than they must.
struct Flood {
    end: Arc<AtomicBool>,
    thread: JoinHandle<(u64, Duration)>,
}

impl Flood {
    fn start(address: SocketAddr) -> Self {
        let connect = |_| {
            let stream = TcpStream::connect(address).expect("the gateway accepts");
            stream.set_nodelay(true).expect("TCP_NODELAY");
            stream.set_nonblocking(true).expect("non-blocking");
            (stream, Vec::new())
        };
        let mut streams: Vec<(TcpStream, Vec<u8>)> = (0..CONNECTIONS).map(connect).collect();
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let thread = std::thread::spawn(move || {
            let begun = Instant::now();
            let mut sent = 0_u64;
            while !ended.load(Ordering::Relaxed) {
                while sent < begun.elapsed().as_micros() as u64 * A_SECOND / 1_000_000 {
                    let (stream, received) = &mut streams[sent as usize % CONNECTIONS];
                    taken(stream, received);
                    let value = 500 + (sent * 7_919 % 4_000) as u16;
                    let request = request(sent as u16, UNIFORM, 6, [SETPOINT_WORD, value]);
                    stream.write_all(&request).expect("room for one request");
                    sent += 1;
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            let time = begun.elapsed();
            // After all others under way, since they are processed in the order of arrival.
            std::thread::sleep(Duration::from_millis(200));
            let mut last = crate::commander::Commander::connect(address);
            last.insist(UNIFORM, SETPOINT_WORD, LAST);
            (sent, time)
        });
        Self { end, thread }
    }

    /// Ends it. Returns how many were sent, and in what time.
    fn stop(self) -> (u64, Duration) {
        self.end.store(true, Ordering::Relaxed);
        self.thread.join().expect("it ends")
    }
}
