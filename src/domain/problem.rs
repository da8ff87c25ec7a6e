//! A mistake in a file written by a person: where it is, what is wrong, what would be right, and whether the file can
//! be used anyway.

use std::ops::Range;

/// One mistake in a TOML file. A check reports all mistakes at once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The key, as a path: `line[0].drive[2].station`.
    pub key: String,
    /// The wrong bytes of the file's text; empty at 0 if there is no location.
    pub span: Range<usize>,
    /// What is wrong, in one sentence.
    pub what: String,
    /// What would be right: a range, the nearest valid name, a key to add.
    pub right: Option<String>,
    /// The file can be used anyway: the entry has no effect.
    pub is_warning: bool,
}

impl Problem {
    /// A problem with `key`, located at `span`.
    #[must_use]
    pub fn new(key: impl Into<String>, span: Range<usize>, what: impl Into<String>) -> Self {
        Self { key: key.into(), span, what: what.into(), right: None, is_warning: false }
    }

    /// Adds what would be right.
    #[must_use]
    pub fn right(mut self, right: impl Into<String>) -> Self {
        self.right = Some(right.into());
        self
    }

    /// Makes it a warning: the entry has no effect and could be left out.
    #[must_use]
    pub fn warning(mut self) -> Self {
        self.is_warning = true;
        self
    }

    /// Line and column of the problem in `text`, both from 1.
    #[must_use]
    pub fn place_in(&self, text: &str) -> (usize, usize) {
        let before = text.get(..self.span.start).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }
}

/// The name in `valid` that is closest to `wrong`, if one is close enough for a typing error.
#[must_use]
pub fn nearest<'a>(wrong: &str, valid: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let distances = valid.into_iter().map(|name| (strsim::damerau_levenshtein(wrong, name), name));
    let close = distances.filter(|(distance, name)| *distance <= 1 + name.len() / 4);
    close.min_by_key(|(distance, _)| *distance).map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_from_one() {
        let text = "a = 1\nb = ü2\n";
        let at = text.find('2').unwrap();
        assert_eq!(Problem::new("b", at..at + 1, "x").place_in(text), (2, 6));
        assert_eq!(Problem::new("a", 0..0, "x").place_in(text), (1, 1));
    }

    #[test]
    fn only_a_near_name_is_offered() {
        assert_eq!(nearest("buad", ["baud", "parity"]), Some("baud"));
        assert_eq!(nearest("colour", ["baud", "parity"]), None);
    }
}
