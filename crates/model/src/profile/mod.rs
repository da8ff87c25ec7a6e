//! Drive models: what a model file may contain, the checks that prove it sound, and the catalog of models.
//!
//! [`check`] turns a model file into a [`model::Model`] or into all its problems. `like` merges a file with the one that it begins from. [`register`] reads one register of a
//! model file or of the configuration. [`scale`] converts between raw words and values, [`value`] works out the value of a register. [`words`] holds the words for
//! enumerations. [`catalog`] holds all models. [`summary`] prints a model for people.

pub mod catalog;
pub mod check;
mod file;
mod like;
pub mod model;
pub mod register;
pub mod scale;
pub mod summary;
pub mod value;
pub mod words;

#[cfg(test)]
mod reference;
#[cfg(test)]
pub mod testing;
