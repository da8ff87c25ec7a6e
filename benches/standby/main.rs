//! What a second gateway that listens costs on a line: `cargo bench --bench standby`, about nine minutes.
//!
//! The program polls two drives on a played bus, alone and then with a second one that listens, in turn: exchanges a
//! second, use of the line, how long native reads take, and processor time. With `--quick` it is shorter.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::too_many_lines,
    missing_docs,
    reason = "a measurement may end by panicking, and is one story"
)]
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

#[path = "../../tests/process/hub/mod.rs"]
#[allow(
    dead_code,
    unused_imports,
    reason = "shared with the tests, which use more of it"
)]
mod hub;
#[path = "../../tests/process/standby/pair.rs"]
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
mod pair;
mod phase;
#[path = "../../tests/process/raw.rs"]
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
mod raw;
#[path = "../../tests/process/rig.rs"]
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
mod rig;
#[path = "../../tests/process/started.rs"]
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
mod started;

use phase::Phase;
use std::time::Duration;

fn main() {
    let is_quick = std::env::args().any(|arg| arg == "--quick");
    let (pairs, time) = if is_quick {
        (1, Duration::from_secs(3))
    } else {
        (5, Duration::from_secs(10))
    };
    println!(
        "{pairs} times {} s of polls, and as long with a client, of each kind in turn:\n",
        time.as_secs()
    );
    println!(
        "| bit/s | second gateway | polls: exchanges/s | line busy | with a client that reads: exchanges/s | line busy | \
         reads/s | answer after: median, 99 %, longest | processor: active, listening |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    let mut ratios = Vec::new();
    for baud in [9_600, 38_400] {
        let measured: Vec<[Phase; 2]> = (0..pairs)
            .map(|_| [true, false].map(|alone| Phase::measure(baud, alone, time)))
            .collect();
        for (place, which) in ["none", "listens"].into_iter().enumerate() {
            let phases: Vec<&Phase> = measured.iter().map(|pair| &pair[place]).collect();
            println!("| {baud} | {which} | {} |", row(&phases));
        }
        let of_pairs = measured
            .iter()
            .map(|[alone, with]| format!("{:.4}", with.reads_per_s / alone.reads_per_s));
        ratios.push(format!(
            "{baud}: reads/s with a second gateway, part of those without: {}",
            joined(of_pairs)
        ));
    }
    println!("\n{}", ratios.join("\n"));
}

/// The medians of the phases of one kind, and the times of all their reads.
fn row(phases: &[&Phase]) -> String {
    let median = |of: fn(&Phase) -> f64| part_of(phases.iter().map(|phase| of(phase)), 0.5);
    let answers = [0.5, 0.99, 1.0].map(|part| {
        part_of(
            phases.iter().flat_map(|phase| phase.answer_ms.clone()),
            part,
        )
    });
    let listening = median(|phase| phase.processor.1);
    let listening = if listening.is_nan() {
        String::new()
    } else {
        format!(", {listening:.1} %")
    };
    format!(
        "{:.2} | {:.2} % | {:.2} | {:.2} % | {:.2} | {} ms | {:.1} %{listening}",
        median(|phase| phase.polls.exchanges_per_s),
        median(|phase| phase.polls.busy),
        median(|phase| phase.reads.exchanges_per_s),
        median(|phase| phase.reads.busy),
        median(|phase| phase.reads_per_s),
        joined(answers.iter().map(|time| format!("{time:.1}"))),
        median(|phase| phase.processor.0),
    )
}

fn joined(words: impl IntoIterator<Item = String>) -> String {
    words.into_iter().collect::<Vec<_>>().join(", ")
}

/// What this part of `values` does not exceed.
fn part_of(values: impl IntoIterator<Item = f64>, part: f64) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * part) as usize]
}
