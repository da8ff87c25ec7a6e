//! Retained messages on every command topic, and a broker that is killed and restarts with them, many times.
//!
//! Several gateways run in parallel, each with a broker of its own: one whose broker breaks repeatedly backs off, and
//! would wait most of the time.

use crate::bare_mqtt::Talker;
use crate::brokers::{Broker, mosquitto};
use crate::plant::{Gateway, Setup};
use crate::table::{Row, Times};
use crate::tapped::TappedLine;
use std::time::{Duration, Instant};
use vfd_gateway::sim::BusOptions;

const LANES: u64 = 10;
const PATIENCE: Duration = Duration::from_secs(30);
/// How long it is checked that a message is not obeyed.
const WATCH: Duration = Duration::from_millis(300);
/// The retained messages on the command topics below `vfd/bench/`.
const RETAINED: [(&str, &str); 7] = [
    ("drive/d1/run/set", "forward"),
    ("drive/d1/frequency/set", "42.5"),
    (
        "drive/d1/command",
        r#"{"run":"forward","frequency_hz":42.5}"#,
    ),
    ("drive/d1/trip/reset", "reset"),
    ("drive/d1/lease", "x"),
    ("drive/d1/param/F007/set", "12.5"),
    ("all/run/set", "stop"),
];

/// What a restart showed.
struct Restart {
    /// How many of the retained messages the broker still had.
    kept: usize,
    /// From the start of the broker until the first new state of the drive.
    telemetry: Option<Duration>,
    /// Whether a command was answered.
    hears: bool,
}

/// One gateway and its restarts.
struct Lane {
    restarts: Vec<Restart>,
    writes: u64,
}

pub fn retained() -> Vec<Row> {
    if mosquitto().is_none() {
        return vec![Row::told("retained: needs mosquitto", "not measured")];
    }
    let each = if crate::is_quick() { 1 } else { 10 };
    let lanes: Vec<_> = (0..LANES)
        .map(|number| std::thread::spawn(move || lane(number, each)))
        .collect();
    let lanes: Vec<Lane> = lanes
        .into_iter()
        .map(|lane| lane.join().expect("a lane ends"))
        .collect();
    rows(&lanes)
}

fn rows(lanes: &[Lane]) -> Vec<Row> {
    let restarts = || lanes.iter().flat_map(|lane| &lane.restarts);
    let count = restarts().count();
    let times = |from: usize, to: usize| {
        let some = lanes
            .iter()
            .flat_map(|lane| lane.restarts.iter().skip(from).take(to - from));
        Times::new(some.filter_map(|restart| restart.telemetry))
    };
    let all = times(0, usize::MAX);
    let of = |times: Times| {
        format!(
            "{:.0} / {:.0} / {:.0}",
            times.at(0.5),
            times.at(0.99),
            times.at(1.0)
        )
    };
    let mut rows = vec![
        Row::none(
            format!("retained: writes on the wire in {count} restarts"),
            lanes.iter().map(|lane| lane.writes).sum(),
        ),
        Row::all(
            "retained: restarts after which all retained messages were there",
            count,
            {
                restarts()
                    .filter(|restart| restart.kept == RETAINED.len())
                    .count()
            },
        ),
        Row::all(
            "retained: restarts after which telemetry came back",
            count,
            all.len(),
        ),
        Row::all(
            "retained: restarts after which a command was heard",
            count,
            restarts().filter(|it| it.hears).count(),
        ),
        Row::told(
            "retained: telemetry back, 1st restart, p50 / p99 / max, ms",
            of(times(0, 1)),
        ),
    ];
    if !crate::is_quick() {
        rows.push(Row::told(
            "retained: telemetry back, 2nd to 4th restart, p50 / p99 / max, ms",
            of(times(1, 4)),
        ));
        rows.push(Row::told(
            "retained: telemetry back, 5th to 10th restart, p50 / p99 / max, ms",
            of(times(4, 10)),
        ));
        rows.push(Row::told(
            "retained: telemetry back, all, p50 / p99 / max, ms",
            of(all),
        ));
    }
    rows
}

fn lane(number: u64, count: usize) -> Lane {
    let mut broker = Broker::start(true);
    put_messages(&broker);
    let line = TappedLine::start(1, BusOptions::default());
    let mqtt = Some((broker.port, if number.is_multiple_of(2) { 5 } else { 4 }));
    let gateway = Gateway::start(&Setup {
        device: line.path(),
        drives: 1,
        unpaced: false,
        poll: "500ms",
        mqtt,
        listen: 0,
    });
    let mut watcher =
        Talker::connect(broker.port, "bench-watch", &["vfd/bench/#"]).expect("the broker accepts");
    assert!(
        fresh_picture(&mut watcher, Instant::now()).is_some(),
        "no telemetry at all"
    );
    let mut lane = Lane {
        restarts: Vec::new(),
        writes: 0,
    };
    for _ in 0..count {
        lane.restarts.push(restart(&mut broker));
        std::thread::sleep(WATCH);
        lane.writes += line.forget();
    }
    gateway.stop();
    line.stop();
    lane
}

fn put_messages(broker: &Broker) {
    let mut talker =
        Talker::connect(broker.port, "bench-put", &["vfd/bench/#"]).expect("the broker accepts");
    for (topic, payload) in RETAINED {
        talker
            .publish(&format!("vfd/bench/{topic}"), payload.as_bytes(), true)
            .expect("published");
    }
    // Messages that are delivered were kept.
    for _ in RETAINED {
        talker
            .next(PATIENCE)
            .expect("the broker is there")
            .expect("a message");
    }
}

fn restart(broker: &mut Broker) -> Restart {
    broker.kill();
    let begun = Instant::now();
    broker.restart();
    let mut watcher =
        Talker::connect(broker.port, "bench-watch", &["vfd/bench/#"]).expect("the broker accepts");
    let mut kept = 0;
    let telemetry = loop {
        match watcher.next(PATIENCE).expect("the broker is there") {
            None => break None,
            Some(message) if message.retain => kept += usize::from(is_command(&message.topic)),
            Some(message) if message.topic.ends_with("/d1/state") => break Some(begun.elapsed()),
            Some(_) => {}
        }
    };
    Restart {
        kept,
        telemetry,
        hears: hears(&mut watcher),
    }
}

fn is_command(topic: &str) -> bool {
    RETAINED
        .iter()
        .any(|(rest, _)| topic.strip_prefix("vfd/bench/") == Some(*rest))
}

fn fresh_picture(watcher: &mut Talker, begun: Instant) -> Option<Duration> {
    while let Some(message) = watcher.next(PATIENCE).expect("the broker is there") {
        if !message.retain && message.topic.ends_with("/d1/state") {
            return Some(begun.elapsed());
        }
    }
    None
}

/// Whether an invalid command is refused, which needs the subscription and writes nothing.
fn hears(talker: &mut Talker) -> bool {
    talker
        .publish("vfd/bench/drive/d1/run/set", b"sideways", false)
        .expect("published");
    let until = Instant::now() + Duration::from_secs(5);
    while let Some(message) = talker
        .next(until.saturating_duration_since(Instant::now()))
        .expect("the broker is there")
    {
        if !message.retain
            && message.topic.ends_with("/d1/result")
            && contains(&message.payload, b"sideways")
        {
            return true;
        }
    }
    false
}

fn contains(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|window| window == word)
}
