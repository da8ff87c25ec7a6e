//! What a drive description may say, the proof that it is sound, and the catalogue of those that are built in.
//!
//! [`file`] mirrors the TOML as written, [`check`] turns it into a [`model::Model`] or into all its
//! problems at once, [`scale`] converts between raw words and values, [`catalog`] holds what is built in.

pub mod catalog;
pub mod check;
pub mod file;
pub mod model;
pub mod scale;
