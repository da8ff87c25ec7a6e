//! The client side without sockets.

#![cfg_attr(test, allow(clippy::too_many_lines, reason = "a test is one story"))]

pub mod north;

use vfd_drive::{drive, guard, journal};
#[cfg(test)]
use vfd_model::vendors;
use vfd_model::{domain, profile, toml_file, wire};
