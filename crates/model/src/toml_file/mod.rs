//! Reads a TOML document table by table and reports every mistake, each with its location.
//!
//! A caller asks a [`TableReader`] for each key by name and passes a [`values::ValueKind`] that says which values are valid.
//! Mistakes go into the list of problems, and reading goes on. [`TableReader::finish`] then reports each key that the
//! caller did not ask for.
//!
//! ```
//! use vfd_model::toml_file::{TableReader, document};
//! use vfd_model::toml_file::values::ValueKind;
//!
//! let mut problems = Vec::new();
//! if let Some(root) = document("baud = 0\nparrot = 'none'", &mut problems) {
//!     let mut reader = TableReader::new(root.section(), &mut problems);
//!     let baud = reader.required("baud", &ValueKind::number(2400..=38_400_u32));
//!     let parity = reader.optional("parity", &ValueKind::one_of(&[("none", 0), ("even", 1)]));
//!     reader.finish();
//!     assert_eq!((baud, parity.or(0)), (None, Some(0)));
//! }
//! assert_eq!(problems.len(), 2);
//! ```

pub mod declare;
pub mod fill;
mod location;
mod reader;
pub mod values;
pub mod words;
pub mod written;

pub use location::{KeyLocation, LocatedValue, OptionalKey, RequiredKey};
pub use reader::{TableReader, TomlDocument, TomlEntry, TomlSection, document};
