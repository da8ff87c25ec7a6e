//! One start of the program on a played bus, and what went over the bus meanwhile.

use crate::hub::Frame;
use crate::pair::{A, B, Pair, Wish};
use crate::raw::Raw;
use std::time::{Duration, Instant};
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::link::{Framing, LinkSettings};
use vfd_gateway::line::timing::LineTiming;
use vfd_gateway::vendors;

/// Where the drives are on the bus.
const DRIVES: usize = A + 1;
/// Requests behind which all that is read once at the start is over.
const BEGINNING: usize = 60;
/// The acceleration time, which is not polled.
const ASKED: u16 = 0x020C;
/// Ticks of a second in which the kernel counts processor time, on every architecture of Linux (`USER_HZ`).
const TICKS: f64 = 100.0;

/// What was measured between a start and an end.
pub struct Phase {
    /// While nothing but polls went over the line.
    pub polls: Use,
    /// While a client read as fast as it was answered.
    pub reads: Use,
    pub reads_per_s: f64,
    pub answer_ms: Vec<f64>,
    /// Processor time with that client in per cent of one core: of the gateway that sends, and of the one that listens,
    /// which is no number without one.
    pub processor: (f64, f64),
}

/// Use of the line.
pub struct Use {
    pub exchanges_per_s: f64,
    /// Time from the start of each request to the end of its reply and the silence behind that, in per cent.
    pub busy: f64,
}

impl Phase {
    /// Starts a gateway without a second one, or with one that listens, and measures each kind of use for `time`.
    pub fn measure(baud: u32, alone: bool, time: Duration) -> Self {
        let mut pair = Pair::with(Wish {
            alone,
            ..Wish::at(baud)
        });
        if alone {
            pair.start(A);
        } else {
            pair.start_one_behind_the_other();
        }
        pair.wait_for_requests(A, BEGINNING, 0);
        let (polls, ()) = used(&pair, baud, || std::thread::sleep(time));
        let ticks = |end| {
            if alone && end == B {
                f64::NAN
            } else {
                ticks(pair.program(end).id())
            }
        };
        let (before, begun) = ([A, B].map(ticks), Instant::now());
        let (reads, answer_ms) = used(&pair, baud, || read(&pair, time));
        let took = begun.elapsed().as_secs_f64();
        let after = [A, B].map(ticks);
        let [sends, listens] =
            [0, 1].map(|place| (after[place] - before[place]) / TICKS / took * 100.0);
        pair.assert_silent(B, 0..);
        let reads_per_s = answer_ms.len() as f64 / took;
        Self {
            polls,
            reads,
            reads_per_s,
            answer_ms,
            processor: (sends, listens),
        }
    }
}

/// Reads one word after the other from a drive for `time`. Returns how long each answer took, in ms.
fn read(pair: &Pair, time: Duration) -> Vec<f64> {
    let mut client = Raw::connect(pair.half(A).modbus);
    let begun = Instant::now();
    let mut times = Vec::new();
    while begun.elapsed() < time {
        let asked = Instant::now();
        client.read_unit(1, ASKED, 1).expect("the drive answers");
        times.push(asked.elapsed().as_secs_f64() * 1e3);
    }
    times
}

/// The use of the line while `work` lasts.
fn used<T>(pair: &Pair, baud: u32, work: impl FnOnce() -> T) -> (Use, T) {
    let (seen, begun) = (pair.hub.count(), clock::now());
    let done = work();
    let took = clock::now().since(begun).as_secs_f64();
    let mut frames = pair.hub.frames(seen);
    // The last one may not be complete.
    frames.pop();
    assert!(frames.iter().all(Frame::is_sound), "{frames:?}");
    let model = vendors::catalog()
        .find("hyundai-n700")
        .expect("the model is built in")
        .clone();
    let link = LinkSettings {
        baud,
        ..LinkSettings::DEFAULT
    };
    let silence =
        LineTiming::for_models(Framing::Rtu, link, [model.as_ref()], Duration::ZERO).silence;
    let requests = frames
        .iter()
        .enumerate()
        .filter(|(_, frame)| frame.from == A);
    let times = requests.map(|(place, request)| {
        let reply = frames.get(place + 1).filter(|frame| frame.from == DRIVES);
        reply.unwrap_or(request).end.since(request.start) + silence
    });
    let times: Vec<Duration> = times.collect();
    let busy = times.iter().sum::<Duration>().as_secs_f64() / took * 100.0;
    (
        Use {
            exchanges_per_s: times.len() as f64 / took,
            busy,
        },
        done,
    )
}

/// Processor time of all threads of a process so far, in ticks.
fn ticks(process: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).expect("a process");
    // The name in brackets may contain spaces; utime and stime are the 12th and 13th field after it.
    let (_, fields) = text.rsplit_once(')').expect("a name");
    fields
        .split_whitespace()
        .skip(11)
        .take(2)
        .map(|ticks| ticks.parse::<f64>().expect("a number"))
        .sum()
}
