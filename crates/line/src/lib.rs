//! One line: the state machine of its wire, and the gateway that serves its drives.

#![cfg_attr(test, allow(clippy::too_many_lines, reason = "a test is one story"))]

pub mod gateway;
pub mod line;

use vfd_drive::{drive, guard, journal};
#[cfg(test)]
use vfd_model::vendors;
use vfd_model::{domain, profile, wire};
