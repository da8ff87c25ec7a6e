//! Simulated drives on a simulated bus. It depends on nothing that it tests.

#![cfg_attr(test, allow(clippy::too_many_lines, reason = "a test is one story"))]

pub mod sim;

#[cfg(test)]
use vfd_model::vendors;
use vfd_model::{domain, profile, wire};
