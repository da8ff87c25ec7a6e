//! One drive: what is known about it, what is kept of it, and the guard that every command passes.

#![cfg_attr(test, allow(clippy::too_many_lines, reason = "a test is one story"))]

pub mod drive;
pub mod guard;
pub mod journal;

#[cfg(test)]
use vfd_model::vendors;
use vfd_model::{domain, profile, wire};
