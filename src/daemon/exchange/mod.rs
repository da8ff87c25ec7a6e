//! What the threads hand each other: requests, answers, views of drives, counts, traffic. Nothing here waits for a
//! client.

pub mod answers;
pub mod bell;
pub mod hand_over;
pub mod inbox;
pub mod keeper;
pub mod north_journal;
pub mod north_sides;
pub mod origin;
pub mod rate_limited_log;
pub mod reload_request;
pub mod role;
pub mod router;
pub mod shared;
pub(super) mod to_lines;
pub mod totals;
pub mod traffic;
