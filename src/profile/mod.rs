//! What a drive description may say, the proof that it is sound, and the catalogue of those that are built in.
//!
//! [`words`] holds the words of a model file for enumerations. [`check`] turns a model file into a [`model::Model`] or into all its problems, [`register`] reads one register of a model file
//! or of the configuration, [`scale`] converts between raw words and values, [`catalog`] holds what is built in,
//! [`summary`] shows a model to people.

pub mod catalog;
pub mod check;
mod file;
pub mod model;
pub mod register;
pub mod scale;
pub mod summary;
pub mod words;

#[cfg(test)]
pub mod testing;
