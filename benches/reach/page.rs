//! Thirty-two drives of twenty points each, all of which change with every poll, and one browser that listens: the cost
//! beyond the polls themselves.

use crate::brokers::free_port;
use crate::memory::wait_for;
use crate::plant::Place;
use crate::table::Row;
use crate::telemetry::{
    Answered, DRIVES, LINES, POINTS, POLL, lines_text, per_cent, start_gateway, start_line, ticks,
};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const WARM_UP: Duration = Duration::from_secs(5);
/// Most per cent of a core for one listener.
const MOST_PER_CENT: f64 = 5.0;

/// What was received while listening.
#[derive(Default)]
struct Heard {
    bytes: usize,
    updates: usize,
    drives: usize,
}

pub fn page() -> Vec<Row> {
    let look = Duration::from_secs(if crate::is_quick() { 5 } else { 30 });
    let answered = Arc::new(Answered::new());
    let end = Arc::new(AtomicBool::new(false));
    let lines: Vec<_> = (0..LINES)
        .map(|line| start_line(line, &answered, &end))
        .collect();
    let ports: Vec<_> = lines.iter().map(|(port, _)| port.clone()).collect();
    let place = Place::new();
    let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
    let text = format!(
        "{}[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n[http]\nlisten = \"{http}\"\n",
        lines_text("[gateway]\nname = \"bench\"\n", &ports, POLL)
    );
    let mut gateway = start_gateway(&place, &text);
    wait_for(http);
    std::thread::sleep(WARM_UP);
    let alone = used(gateway.id(), || std::thread::sleep(look)).0;
    let mut stream = TcpStream::connect(http).expect("it accepts");
    stream
        .write_all(b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .expect("it reads");
    listen(&mut stream, WARM_UP);
    let (with, heard) = used(gateway.id(), || listen(&mut stream, look));
    gateway.kill().expect("killed");
    gateway.wait().expect("collected");
    end.store(true, Ordering::Relaxed);
    lines
        .into_iter()
        .for_each(|(_, line)| line.join().expect("a line ends"));
    let a_second = |count: usize| count as f64 / look.as_secs_f64();
    let drives = LINES * usize::from(DRIVES);
    vec![
        Row::told(
            "page: drives, points of each, poll",
            format!("{drives}, {POINTS}, {POLL:?}"),
        ),
        Row::told(
            "page: updates / drives in them a second",
            format!(
                "{:.1} / {:.0}",
                a_second(heard.updates),
                a_second(heard.drives)
            ),
        ),
        Row::told(
            "page: kB a second to one who listens",
            format!("{:.0}", a_second(heard.bytes) / 1000.0),
        ),
        Row::told(
            "page: CPU of the gateway without / with one who listens, % of a core",
            format!("{alone:.1} / {with:.1}"),
        ),
        Row::at_most(
            "page: CPU for one who listens, % of a core",
            MOST_PER_CENT,
            with - alone,
        ),
    ]
}

/// Processor time of the process while `what` runs, in per cent of a core, and its result.
fn used<T>(process: u32, what: impl FnOnce() -> T) -> (f64, T) {
    let before = ticks(process);
    let begun = Instant::now();
    let done = what();
    (per_cent(ticks(process) - before, begun.elapsed()), done)
}

/// Receives for `span`.
fn listen(stream: &mut TcpStream, span: Duration) -> Heard {
    let mut heard = Heard::default();
    let until = Instant::now() + span;
    let mut buffer = vec![0; 256 * 1024];
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return heard;
        }
        stream.set_read_timeout(Some(left)).expect("a time");
        let length = match stream.read(&mut buffer) {
            Ok(0) => panic!("the gateway has closed the connection"),
            Ok(length) => length,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return heard;
            }
            Err(error) => panic!("{error}"),
        };
        let text = String::from_utf8_lossy(&buffer[..length]);
        heard.bytes += length;
        heard.updates += text.matches("event: update").count();
        heard.drives += text.matches("\"uniform_unit\"").count();
    }
}
