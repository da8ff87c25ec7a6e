//! What the gateway reaches, measured and printed as a table: `cargo bench --bench reach`, about four minutes.
//!
//! A part of the table by name: `cargo bench --bench reach -- paced`. Parts: paced, unpaced, shared, fair, dead,
//! late. Everything stays on this machine: pseudo-terminals and loopback.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    missing_docs,
    reason = "a measurement may end by panicking"
)]
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

mod bare;
mod clients;
mod rig;
mod rows;
#[path = "../../tests/support/mod.rs"]
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
mod support;

use rows::Row;

/// Measures one part of the table.
type Part = fn() -> Vec<Row>;

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let parts: [(&str, Part); 6] = [
        ("paced", rows::paced),
        ("unpaced", rows::unpaced),
        ("shared", rows::shared),
        ("fair", rows::fair),
        ("dead", rows::dead),
        ("late", rows::late),
    ];
    println!("{:<58} {:>14} {:>14}  reached", "what", "wanted", "measured");
    for (name, part) in parts {
        if wanted.is_empty() || wanted.iter().any(|part| part == name) {
            part().iter().for_each(Row::print);
        }
    }
}
