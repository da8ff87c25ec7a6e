//! The configuration file, from text to ready values or to all its problems.

#![cfg_attr(test, allow(clippy::too_many_lines, reason = "a test is one story"))]

pub mod config;

use vfd_drive::{drive, guard};
use vfd_line::line;
use vfd_model::{domain, profile, toml_file, vendors, wire};
use vfd_north::north;
