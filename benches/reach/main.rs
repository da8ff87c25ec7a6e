//! Measures the performance of the gateway and prints it as a table: `cargo bench --bench reach`, about twenty minutes.
//!
//! A part of the table by name: `cargo bench --bench reach -- paced`. Parts: paced, unpaced, shared, fair, along,
//! dead, late, stop, command, lost, retained, telemetry, sparkplug, page, uniform, crowd, setpoints, journal, memory, footprint,
//! library, unplug; most are shorter with `--quick`. Everything stays on this machine: pseudo-terminals and loopback. The
//! brokers are processes started here: mosquitto if it is installed.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::too_many_lines,
    missing_docs,
    reason = "a measurement may end by panicking, and is one story"
)]
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

#[path = "../../tests/process/adapter.rs"]
mod adapter;
mod bare;
mod bare_mqtt;
mod brokers;
mod clients;
mod command;
mod commander;
mod crowd;
mod crowded;
mod footprint;
mod journal;
mod library;
mod lost;
mod memory;
mod offer;
mod paced;
mod page;
mod pipeline;
mod plant;
mod relay;
mod retained;
mod rig;
mod rows;
mod setpoints;
mod sparkplug;
mod stop;
#[path = "../../tests/support/mod.rs"]
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
mod support;
mod table;
mod tapped;
mod telemetry;
mod uniform;
mod unplug;

use table::Row;

/// Measures one part of the table.
type Part = fn() -> Vec<Row>;

const PARTS: [(&str, Part); 22] = [
    ("paced", paced::paced),
    ("unpaced", rows::unpaced),
    ("shared", rows::shared),
    ("fair", rows::fair),
    ("along", rows::along),
    ("dead", rows::dead),
    ("late", rows::late),
    ("stop", stop::stop),
    ("command", command::command),
    ("lost", lost::lost),
    ("retained", retained::retained),
    ("telemetry", telemetry::telemetry),
    ("sparkplug", sparkplug::sparkplug),
    ("page", page::page),
    ("uniform", uniform::uniform),
    ("crowd", crowded::crowd),
    ("setpoints", setpoints::setpoints),
    ("journal", journal::journal),
    ("memory", memory::memory),
    ("footprint", footprint::footprint),
    ("library", library::library),
    ("unplug", unplug::unplug),
];

fn main() {
    let wanted: Vec<String> = std::env::args()
        .skip(1)
        .filter(|arg| !arg.starts_with('-'))
        .collect();
    table::print_heading();
    for (name, part) in PARTS {
        if wanted.is_empty() || wanted.iter().any(|part| part == name) {
            part().iter().for_each(Row::print);
        }
    }
}

/// Whether fewer rounds of the newer parts are requested.
fn is_quick() -> bool {
    std::env::args().any(|arg| arg == "--quick")
}
