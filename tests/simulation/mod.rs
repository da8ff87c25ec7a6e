//! A whole gateway under one seed and one virtual clock: line, drives, clients and broker, with everything that can go
//! wrong, and an independent checker that looks at every step.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `plan`, `extras` | what a seed stands for, and what beside the line goes wrong in its world |
//! | `world`, `tally` | the clock and the line, and what has happened |
//! | `client`, `serve` | Modbus TCP clients, and what the daemon does for them |
//! | `mqtt` | the MQTT session and a small broker |
//! | `trouble` | what goes wrong beside replies |
//! | `others`, `stalls` | what others do to the drives; ways in, and a gateway, that stand still |
//! | `journal`, `kills` | what outlives the gateway, and its ends |
//! | `trials`, `bursts`, `audit`, `stale`, `holders` | single promises, counted |
//! | `checker` | who looks on |
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
/// What was seen that must not be, in words, with the command that shows it again.
pub fn run(seed: u64, exchanges: u64, extras: Extras) -> Result<(Tally, u64), String> {
    let mut world = World::new(seed, extras);
    match world.run(exchanges) {
        None => Ok((world.tally, world.checker.log.hash())),
        Some(it) => Err(told(seed, exchanges, &world, &it)),
    }
}

/// A violation in words, with the command that shows it again.
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
