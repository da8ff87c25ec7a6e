//! The one integration binary. What belongs where:
//!
//! | folder | what lives there |
//! | --- | --- |
//! | `scenarios/` | one file per promise: what must happen, told with real frames or a whole gateway |
//! | `properties/` | what must hold for any input: random bytes, random lists of events, kept seeds |
//! | `support/` | what several of them need: rigs, transcripts, reference models |
//! | `golden/`, `data/` | texts and tables that tests compare with; no code |
//!
//! Tests that start the real program have a binary of their own. A file is added by a `mod` line here.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, its helpers too"
)]

#[path = "scenarios/frames.rs"]
mod frames;

#[path = "properties/assembler.rs"]
mod assembler;
#[path = "properties/connection.rs"]
mod connection;
