//! How close a paced line gets to what its own gap allows, and how long its gaps are.

use crate::bare;
use crate::clients;
use crate::rig::{Options, Rig};
use crate::support::{PROOF, n700};
use crate::table::{Row, part_of};
use std::time::Duration;
use vfd_gateway::domain::link::{Framing, LinkSettings};
use vfd_gateway::line::budget;
use vfd_gateway::line::timing::LineTiming;

const SECOND: Duration = Duration::from_secs(1);
const TURNAROUND: Duration = Duration::from_millis(2);
/// Words of each read.
const WORDS: u16 = 8;
/// Clients that read each its own registers, so that a read waits whenever the line is free and what is measured is the
/// line. A single client would have to be woken, send and be received within the gap.
const CLIENTS: usize = 4;

/// A simulated line.
struct Line {
    link: LinkSettings,
    /// Part of what its gap allows that it should reach, in per cent.
    wanted: f64,
    time: Duration,
}

/// Lines at 9600 and 38400 bit/s, 10 bits a character, 2 ms turnaround, reads of 8 words back to back.
pub fn paced() -> Vec<Row> {
    let part = if crate::is_quick() { 10 } else { 1 };
    let line = |baud, wanted, seconds| Line {
        link: LinkSettings {
            baud,
            ..LinkSettings::DEFAULT
        },
        wanted,
        time: SECOND * seconds / part,
    };
    // Together more than 10,000 gaps.
    let mut all = 0;
    let mut rows = Vec::new();
    for line in [line(9600, 99.0, 120), line(38_400, 97.0, 80)] {
        let (gaps, more) = play(&line);
        all += gaps;
        rows.extend(more);
    }
    let wanted = if crate::is_quick() { 500.0 } else { 10_000.0 };
    rows.push(Row::rate(
        "paced: gaps measured on both lines",
        wanted,
        all as f64,
    ));
    rows
}

fn play(line: &Line) -> (usize, Vec<Row>) {
    let baud = line.link.baud;
    let rig = Rig::start(&Options {
        baud,
        ..Options::paced(1)
    });
    let bare = std::thread::spawn(|| bare::timer(500, true));
    let hop = std::thread::spawn(|| bare::hop(1000));
    let ask = |client: usize, _| (1, PROOF + client as u16 * WORDS, WORDS);
    let load = clients::run(rig.address, CLIENTS, SECOND, line.time, ask);
    let alone = clients::run(rig.address, 1, SECOND, line.time / 5, ask);
    let outcome = rig.stop();
    let bare = bare.join().expect("the bare timer");
    let hop = hop.join().expect("the bare hop");
    let model = n700();
    let timing = LineTiming::for_models(Framing::Rtu, line.link, [model.as_ref()], Duration::ZERO);
    let busy =
        |rate: f64| rate * budget::read_time(&timing, WORDS, TURNAROUND).as_secs_f64() * 100.0;
    // The first gap is the start, not the line.
    let mut gaps: Vec<f64> = outcome
        .bus
        .gaps()
        .iter()
        .skip(1)
        .map(|gap| gap.as_secs_f64() * 1e3)
        .collect();
    gaps.sort_by(f64::total_cmp);
    let silence = timing.silence.as_secs_f64() * 1e3;
    let beyond = |part| part_of(&gaps, part) - silence;
    let rows = vec![
        Row::at_least(
            format!("paced {baud}: line busy, % of what its gap allows"),
            line.wanted,
            busy(load.rate()),
        ),
        Row::told(
            format!("paced {baud}: the same with one client that waits"),
            format!("{:.3}", busy(alone.rate())),
        ),
        Row::at_most(
            format!("paced {baud}: gap p50 beyond {silence:.4} ms, in ms"),
            0.3,
            beyond(0.5),
        ),
        Row::told(
            format!("paced {baud}: gap min / p50 / p99 / max beyond that, ms"),
            format!(
                "{:.3} / {:.3} / {:.3} / {:.3}",
                beyond(0.0),
                beyond(0.5),
                beyond(0.99),
                beyond(1.0)
            ),
        ),
        Row::told(
            format!("paced {baud}: bare real-time timer in the same run, late p50 / p99 / max, ms"),
            format!(
                "{:.3} / {:.3} / {:.3}",
                part_of(&bare, 0.5),
                part_of(&bare, 0.99),
                part_of(&bare, 1.0)
            ),
        ),
        Row::told(
            format!(
                "paced {baud}: bare pseudo-terminal, one byte one way in the same run, p50 / p99 / max, ms"
            ),
            format!(
                "{:.3} / {:.3} / {:.3}",
                part_of(&hop, 0.5),
                part_of(&hop, 0.99),
                part_of(&hop, 1.0)
            ),
        ),
        Row::none(
            format!("paced {baud}: gaps shorter than the silence"),
            outcome.bus.gaps_too_short,
        ),
        Row::told(
            format!("paced {baud}: gaps measured"),
            gaps.len().to_string(),
        ),
    ];
    (gaps.len(), rows)
}
