//! The knowledge of drives and of the frames on their lines; pure data and its proof.

#![cfg_attr(test, allow(clippy::too_many_lines, reason = "a test is one story"))]

pub mod domain;
pub mod profile;
pub mod toml_file;
pub mod vendors;
pub mod wire;
