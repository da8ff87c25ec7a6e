//! A whole gateway under one seed and one virtual clock: line, drives, clients and broker, with everything that can go
//! wrong, and an independent checker of every step.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `plan`, `extras` | the parameters of a seed, and the faults beyond the line in its world |
//! | `world`, `tally` | the clock and the line, and counts of what has happened |
//! | `client`, `serve` | Modbus TCP clients, and the daemon's part for them |
//! | `mqtt` | the MQTT session and a small broker |
//! | `trouble` | faults other than those of replies |
//! | `others`, `stalls` | other parties at the drives; stalled connections, and a suspended gateway |
//! | `journal`, `kills` | what outlives the gateway, and its ends |
//! | `trials`, `bursts`, `audit`, `stale`, `holders` | single promises, counted |
//! | `checker` | the observer |
//! | `tests` | that the checker objects, that a seed is a world, found seeds, a million exchanges |

pub mod audit;
pub mod bursts;
pub mod checker;
mod client;
pub mod extras;
pub mod holders;
mod journal;
pub mod kills;
mod mqtt;
mod others;
pub mod plan;
mod serve;
pub mod stale;
mod stalls;
pub mod tally;
pub mod trials;
pub mod trouble;
pub mod world;

use checker::Violation;
use extras::Extras;
use tally::Tally;
use world::World;

/// Exchanges of one world.
pub const WORLD: u64 = 20_000;

/// Runs the world of `seed` for `exchanges` exchanges, with those of `extras` that the seed draws.
///
/// # Errors
/// The violation as text, with the command that reproduces it.
pub fn run(seed: u64, exchanges: u64, extras: Extras) -> Result<(Tally, u64), String> {
    let mut world = World::new(seed, extras);
    match world.run(exchanges) {
        None => Ok((world.tally, world.checker.log.hash())),
        Some(it) => Err(told(seed, exchanges, &world, &it)),
    }
}

/// A violation as text, with the command that reproduces it.
fn told(seed: u64, exchanges: u64, world: &World, it: &Violation) -> String {
    format!(
        "{} is violated by seed {seed} at exchange {} ({:.6} s): {}\n{:?}\n{}\nagain: cargo bench --bench year -- --seed \
         {seed} --shards 1 --exchanges {exchanges}",
        it.rule,
        it.exchange,
        it.at as f64 / 1e9,
        it.text,
        world.plan,
        it.events,
    )
}
