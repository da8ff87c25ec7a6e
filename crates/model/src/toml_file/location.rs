//! Locations in a file, and values that carry theirs.

use crate::domain::problem::Problem;
use std::ops::Range;

/// The location of a key or value in a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KeyLocation {
    /// The key as a path, `line[0].drive[2].station`; empty for the file itself.
    pub key: String,
    /// Bytes of the text; empty at 0 for the file itself.
    pub span: Range<usize>,
}

impl KeyLocation {
    /// A problem at this location.
    #[must_use]
    pub fn problem(&self, what: impl Into<String>) -> Problem {
        Problem::new(self.key.clone(), self.span.clone(), what)
    }

    /// Reports in `problems` what is wrong here, and what would be right.
    pub fn refuse(
        &self,
        what: impl Into<String>,
        right: impl Into<String>,
        problems: &mut Vec<Problem>,
    ) {
        problems.push(self.problem(what).right(right));
    }

    /// Reports in `problems` what the file can be used with anyway, and what would be right.
    pub fn warn(
        &self,
        what: impl Into<String>,
        right: impl Into<String>,
        problems: &mut Vec<Problem>,
    ) {
        problems.push(self.problem(what).right(right).warning());
    }

    /// The location to report for `name`, a key that the table at this location lacks.
    #[must_use]
    pub fn missing(&self, name: &str) -> Self {
        self.inner(name, self.span.clone())
    }

    /// The location of the key `name` at `span`, in the table at this location.
    pub(super) fn inner(&self, name: &str, span: Range<usize>) -> Self {
        let key = if self.key.is_empty() {
            name.to_owned()
        } else {
            format!("{}.{name}", self.key)
        };
        Self { key, span }
    }

    /// The location of element `index` at `span`, in the list at this location.
    pub(super) fn element(&self, index: usize, span: Range<usize>) -> Self {
        Self {
            key: format!("{}[{index}]", self.key),
            span,
        }
    }
}

/// A value and its location.
#[derive(Clone, Debug, PartialEq)]
pub struct LocatedValue<T> {
    /// The value.
    pub value: T,
    /// Its location.
    pub location: KeyLocation,
}

impl<T> LocatedValue<T> {
    /// Reports in `problems` what is wrong with the value, and what would be right.
    pub fn refuse(
        &self,
        what: impl Into<String>,
        right: impl Into<String>,
        problems: &mut Vec<Problem>,
    ) {
        self.location.refuse(what, right, problems);
    }

    /// Reports in `problems` what the file can be used with anyway, and what would be right.
    pub fn warn(
        &self,
        what: impl Into<String>,
        right: impl Into<String>,
        problems: &mut Vec<Problem>,
    ) {
        self.location.warn(what, right, problems);
    }
}

/// The result of reading an optional key.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum OptionalKey<T> {
    /// The file does not have the key.
    #[default]
    Absent,
    /// The file has the key with an invalid value. The problem is already reported.
    Invalid,
    /// The file has the key with a valid value.
    Valid(LocatedValue<T>),
}

impl<T> OptionalKey<T> {
    /// The value if it is present and valid.
    pub const fn valid(&self) -> Option<&LocatedValue<T>> {
        match self {
            Self::Valid(written) => Some(written),
            Self::Absent | Self::Invalid => None,
        }
    }

    /// Its location if it is present and valid.
    pub const fn location(&self) -> Option<&KeyLocation> {
        match self {
            Self::Valid(written) => Some(&written.location),
            Self::Absent | Self::Invalid => None,
        }
    }

    /// Whether the file does not have the key.
    pub const fn is_absent(&self) -> bool {
        matches!(self, Self::Absent)
    }

    /// What `settle` makes of the value: `Some(None)` if the key is absent, `None` if its value is invalid or `settle`
    /// cannot use it.
    pub fn settle<U>(&self, settle: impl FnOnce(&T) -> Option<U>) -> Option<Option<U>> {
        match self {
            Self::Absent => Some(None),
            Self::Invalid => None,
            Self::Valid(written) => settle(&written.value).map(Some),
        }
    }

    /// `Some(None)` if the key is absent, `None` if its value is invalid.
    pub fn optional(self) -> Option<Option<T>> {
        match self {
            Self::Absent => Some(None),
            Self::Invalid => None,
            Self::Valid(written) => Some(Some(written.value)),
        }
    }
}

impl<T: PartialEq> OptionalKey<T> {
    /// The value with its location, if it is `value`.
    pub fn valid_as(&self, value: &T) -> Option<&LocatedValue<T>> {
        self.valid().filter(|written| written.value == *value)
    }
}

impl<T: Clone> OptionalKey<T> {
    /// The value, `default` if the key is absent, `None` if the value is invalid.
    pub fn or(&self, default: T) -> Option<T> {
        match self {
            Self::Absent => Some(default),
            Self::Invalid => None,
            Self::Valid(written) => Some(written.value.clone()),
        }
    }
}

/// The result of reading a required key. `None`: the problem is already reported.
pub type RequiredKey<T> = Option<LocatedValue<T>>;
