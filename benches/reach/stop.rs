//! A STOP with a hundred thousand reads on offer: how long until its frame, and what is still sent before it.

use crate::bare;
use crate::commander::Commander;
use crate::offer::Offer;
use crate::pipeline::{Request, request};
use crate::plant::{Gateway, RUN, Setup, UNIFORM};
use crate::table::{Row, Times, part_of};
use crate::tapped::{Heard, TappedLine};
use std::time::Duration;
use vfd_gateway::config::{LineSettings, line_plan};
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::line::budget;
use vfd_gateway::sim::BusOptions;

/// Clients that read, and how many reads each offers: a hundred thousand in all. The gateway takes 16 of each client,
/// and 1024 different ones on the line.
const CLIENTS: usize = 400;
const OFFERED: u16 = 250;
const SETPOINT_WORD: u16 = 257;
const RUN_WORD: u16 = 256;
const PATIENCE: Duration = Duration::from_secs(5);

/// One STOP.
struct Stop {
    /// From the write to the socket until the first byte of the frame.
    took: Duration,
    /// The same from the end of the exchange in flight and its silence on, or from the write if that was later.
    beyond: Duration,
    /// How long after the write each frame before it began.
    overtaken_by: Vec<Duration>,
}

pub fn stop() -> Vec<Row> {
    let options = BusOptions::default();
    let line = TappedLine::start(1, options);
    let setup = Setup {
        device: line.path(),
        drives: 1,
        unpaced: false,
        poll: "500ms",
        mqtt: None,
        listen: 0,
    };
    let config = setup.config();
    let gateway = Gateway::start(&setup);
    let offer = Offer::start(gateway.address, CLIENTS, OFFERED, read_of);
    let timers =
        [true, false].map(|real_time| std::thread::spawn(move || bare::timer(1000, real_time)));
    let mut commander = Commander::connect(gateway.address);
    // A client that has commanded stop may start.
    commander.insist(UNIFORM, RUN_WORD, 0);
    let count = if crate::is_quick() { 10 } else { 150 };
    let stops: Vec<Stop> = (0..count)
        .map(|n| one_stop(&line, &mut commander, n))
        .collect();
    let timers = timers.map(|timer| timer.join().expect("the bare timer"));
    let answers = offer.stop();
    gateway.stop();
    let report = line.stop();
    let mut rows = rows(&stops, &config.lines[0], options.turnaround);
    let allowed = part_of(&timers[1], 0.99) + 1.0;
    let beyond = Times::new(stops.iter().map(|stop| stop.beyond));
    rows.push(Row::at_most(
        "stop: p99 beyond exchange in flight and silence, bare ordinary timer + 1 ms",
        allowed,
        beyond.at(0.99),
    ));
    for (kind, late) in ["real-time", "ordinary"].into_iter().zip(&timers) {
        rows.push(Row::told(
            format!("stop: bare {kind} timer thread in the same run, late p50 / p99 / max, ms"),
            format!(
                "{:.3} / {:.3} / {:.3}",
                part_of(late, 0.5),
                part_of(late, 0.99),
                part_of(late, 1.0)
            ),
        ));
    }
    rows.push(Row::told(
        "stop: reads answered / refused or timed out meanwhile",
        format!("{} / {}", answers.right, answers.exceptions),
    ));
    rows.push(Row::none(
        "stop: gaps shorter than the silence",
        report.gaps_too_short,
    ));
    rows
}

/// Slots read many registers, up to 8 words within one high byte.
fn read_of(client: usize, slot: u16) -> Request {
    let address = 0x3000 + (client as u16).wrapping_mul(OFFERED).wrapping_add(slot) % 0x03FC * 4;
    request(
        slot,
        1,
        3,
        [address, if address & 0xFF <= 0xF8 { 8 } else { 4 }],
    )
}

fn one_stop(line: &TappedLine, commander: &mut Commander, n: u32) -> Stop {
    commander.insist(UNIFORM, SETPOINT_WORD, 3000);
    commander.insist(UNIFORM, RUN_WORD, 1);
    // So that every moment of an exchange, which takes 42 ms, is equally likely.
    std::thread::sleep(Duration::from_micros(
        200_000 + u64::from(n) * 7_919 % 42_000,
    ));
    let asked = clock::now();
    commander.send(UNIFORM, RUN_WORD, 0);
    let mut before = Vec::new();
    let stop = line.wait_for(
        PATIENCE,
        |heard| is_stop(heard, asked),
        |heard| before.push(heard),
    );
    let stop = stop.expect("the STOP goes out");
    commander.answer().expect("the STOP is taken");
    let in_flight = before.last().map_or(asked, free_after);
    Stop {
        took: stop.at.since(asked),
        beyond: stop.at.since(in_flight.max(asked)),
        overtaken_by: before
            .iter()
            .filter(|heard| heard.at > asked)
            .map(|heard| heard.at.since(asked))
            .collect(),
    }
}

fn is_stop(heard: &Heard, asked: MonoTime) -> bool {
    heard.is_write(RUN, 0) && heard.at >= asked
}

/// When the line may carry the next request at the earliest.
fn free_after(heard: &Heard) -> MonoTime {
    let link = LinkSettings::DEFAULT;
    let words = u16::from_be_bytes([heard.frame[4], heard.frame[5]]);
    let reply = if heard.writes() {
        8
    } else {
        5 + 2 * usize::from(words)
    };
    heard.at
        + link.bytes(8)
        + BusOptions::default().turnaround
        + link.bytes(reply)
        + link.chars(4.5)
}

fn rows(stops: &[Stop], line: &LineSettings, turnaround: Duration) -> Vec<Row> {
    let times = Times::new(stops.iter().map(|stop| stop.took));
    let beyond = Times::new(stops.iter().map(|stop| stop.beyond));
    let read = budget::read_time(&line_plan::timing(line).0, 8, turnaround);
    let bound = (read + line_plan::timing(line).0.silence).as_secs_f64() * 1e3;
    let configured = line_plan::stop_bounds(line).one_silent.as_secs_f64() * 1e3;
    let offered = CLIENTS * usize::from(OFFERED);
    let late = Times::new(stops.iter().flat_map(|stop| &stop.overtaken_by).copied());
    let latest = if late.len() == 0 {
        String::new()
    } else {
        format!(" ({:.3})", late.at(1.0))
    };
    let more = stops
        .iter()
        .map(|stop| stop.overtaken_by.len().saturating_sub(1) as u64)
        .sum();
    vec![
        Row::told(
            format!(
                "stop: {} stops with {offered} reads on offer, p50 / p99 / max, ms",
                times.len()
            ),
            times.shown(),
        ),
        Row::at_most(
            "stop: p99, against one exchange of 8 words and two silences, ms",
            bound,
            times.at(0.99),
        ),
        Row::at_most("stop: longest, against the same, ms", bound, times.at(1.0)),
        Row::told(
            "stop: what the gateway promises, with the reply time-out, ms",
            format!("{configured:.1}"),
        ),
        Row::told(
            "stop: beyond exchange in flight and silence, p50 / p99 / max, ms",
            beyond.shown(),
        ),
        Row::told(
            "stop: frames that began while the request was on its way (latest, ms)",
            format!("{}{latest}", late.len()),
        ),
        Row::none("stop: other frames before it", more),
    ]
}
