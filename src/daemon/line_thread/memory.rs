//! What a journal remembers of the drives of a line.

use crate::domain::ids::Name;
use crate::journal::RememberedDrive;
use std::collections::BTreeMap;

/// What a journal remembers of each drive, by its name.
pub type Memory = BTreeMap<Name, RememberedDrive>;
