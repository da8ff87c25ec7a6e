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
        Self {
            key: key.into(),
            span,
            what: what.into(),
            right: None,
            is_warning: false,
        }
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
        (
            before.matches('\n').count() + 1,
            before[line_start..].chars().count() + 1,
        )
    }
}

/// The name in `valid` that is closest to `wrong`, if one is close enough for a typing error.
#[must_use]
pub fn nearest<'a>(wrong: &str, valid: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let distances = valid
        .into_iter()
        .map(|name| (strsim::damerau_levenshtein(wrong, name), name));
    let close = distances.filter(|(distance, name)| *distance <= 1 + name.len() / 4);
    close
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

/// Most names that are offered for one.
const OFFERED_MAX: usize = 3;
/// Shortest text that may be meant as a part of a name.
const PART_LEAST: usize = 3;

/// The names in `valid`, of parts with hyphens between them, that may be meant by `wrong`, the nearest first and at most
/// three: those close enough for a typing error, or else those that contain it. The first parts may be left out.
#[must_use]
pub fn nearest_names<'a>(wrong: &str, valid: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let wrong = wrong.trim().to_lowercase().replace([' ', '_'], "-");
    let tails = |name: &'a str| name.match_indices('-').map(move |(at, _)| &name[at + 1..]);
    let typed = |name: &'a str| {
        let distances = std::iter::once(name)
            .chain(tails(name))
            .map(|it| (strsim::damerau_levenshtein(&wrong, it), it));
        let close = distances
            .filter(|(distance, it)| *distance <= if it.len() < 4 { 0 } else { 1 + it.len() / 4 });
        close.map(|(distance, _)| distance).min()
    };
    let has = |name: &'a str| {
        wrong.len() >= PART_LEAST && tails(name).next().is_some_and(|tail| tail.contains(&wrong))
    };
    let names: Vec<_> = valid.into_iter().collect();
    let mut near: Vec<_> = names
        .iter()
        .filter_map(|name| Some((typed(name)?, *name)))
        .collect();
    if near.is_empty() {
        near = names
            .iter()
            .filter(|name| has(name))
            .map(|name| (0, *name))
            .collect();
    }
    near.sort_unstable();
    let best = near.first().map_or(0, |(distance, _)| *distance);
    near.into_iter()
        .take_while(|(distance, _)| *distance <= best + 1)
        .map(|(_, name)| name)
        .take(OFFERED_MAX)
        .collect()
}

/// `names` with commas and an `or` between them.
#[must_use]
pub fn alternatives(names: &[String]) -> String {
    match names {
        [first @ .., last] if !first.is_empty() => format!("{} or {last}", first.join(", ")),
        _ => names.concat(),
    }
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

    #[test]
    fn several_names_are_offered_where_several_may_be_meant() {
        const NAMES: [&str; 8] = [
            "abb-acs355",
            "abb-acs380",
            "abb-acs550",
            "abb-acs580",
            "hyundai-n700",
            "rockwell-powerflex-4",
            "rockwell-powerflex-40",
            "rockwell-powerflex-525",
        ];
        let near = |wrong| nearest_names(wrong, NAMES);
        assert_eq!(near("hyundai-n70"), ["hyundai-n700"]);
        assert_eq!(
            near("abb-acs880"),
            ["abb-acs380", "abb-acs580", "abb-acs550"]
        );
        assert_eq!(near("N700"), ["hyundai-n700"], "the maker may be left out");
        assert_eq!(near("PowerFlex 525"), ["rockwell-powerflex-525"]);
        assert_eq!(
            near("flex"),
            [
                "rockwell-powerflex-4",
                "rockwell-powerflex-40",
                "rockwell-powerflex-525"
            ]
        );
        assert_eq!(near("generic"), [""; 0]);
        assert_eq!(near(""), [""; 0]);
    }

    #[test]
    fn alternatives_are_read_as_a_sentence() {
        let sentence = |names: &[&str]| {
            alternatives(
                &names
                    .iter()
                    .map(|name| (*name).to_owned())
                    .collect::<Vec<_>>(),
            )
        };
        assert_eq!(sentence(&[]), "");
        assert_eq!(sentence(&["a"]), "a");
        assert_eq!(sentence(&["a", "b", "c"]), "a, b or c");
    }
}
