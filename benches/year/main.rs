//! A simulated line-year: `cargo bench --bench year`. See `tests/simulation/mod.rs` for what is simulated and checked.
//!
//! `-- --exchanges N --seed S --shards K --minutes M`: how many exchanges in total, the first seed, on how many threads,
//! and for how long at most.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    missing_docs,
    reason = "a measurement may end by panicking"
)]
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

#[path = "../../tests/simulation/mod.rs"]
#[allow(dead_code, reason = "shared with the tests, which use more of it")]
mod simulation;

use std::time::Instant;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let number = |name: &str| {
        let place = args.iter().position(|arg| arg == name)?;
        args.get(place + 1)?.parse::<u64>().ok()
    };
    let exchanges = number("--exchanges").unwrap_or(100_000);
    let seed = number("--seed").unwrap_or(1);
    let begun = Instant::now();
    let mut done = 0;
    let mut at = seed;
    while done < exchanges {
        let here = simulation::WORLD.min(exchanges);
        match simulation::run(at, here) {
            Ok((tally, _)) => {
                done += tally.exchanges;
                if args.iter().any(|arg| arg == "--show") {
                    println!("{at}: {tally:?}");
                }
            }
            Err(text) => {
                println!("{text}");
                std::process::exit(1);
            }
        }
        at += 1;
    }
    let wall = begun.elapsed();
    println!("{done} exchanges in {wall:?}: {:.2} us each", wall.as_secs_f64() * 1e6 / done as f64);
}
