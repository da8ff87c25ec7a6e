//! Titles: what people call the gateway, its lines, drives and groups. Names stay for topics, addresses and commands.

use serde::{Deserialize, Deserializer, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// What people call a part of the plant: 1 to 80 characters of any language on one line, of which none acts on the text
/// beside it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PartTitle(String);

impl PartTitle {
    /// The longest title, in characters.
    pub const MAX_CHARS: usize = 80;

    /// The title `text`, without spaces around it.
    ///
    /// # Errors
    /// What is wrong with it, in a sentence that does not repeat it.
    pub fn new(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let count = text.chars().count();
        if let Some(wrong) = text.chars().find(|c| acts_on_others(*c)) {
            let code = u32::from(wrong);
            return Err(format!(
                "contains the character U+{code:04X}, which is not shown and acts on other text"
            ));
        }
        if !text.chars().any(is_seen) {
            return Err("is empty".to_owned());
        }
        if count > Self::MAX_CHARS {
            return Err(format!("has {count} characters"));
        }
        Ok(Self(text.to_owned()))
    }

    /// The title as text, for a place of its own.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The title for a place beside other text: one with right-to-left letters is isolated, so that it moves nothing there.
    /// Others do not need that, and a terminal may show the marks.
    #[must_use]
    pub fn isolated(&self) -> Cow<'_, str> {
        if self.0.chars().any(is_right_to_left) {
            Cow::Owned(format!("\u{2068}{}\u{2069}", self.0))
        } else {
            Cow::Borrowed(&self.0)
        }
    }
}

impl<'de> Deserialize<'de> for PartTitle {
    /// Another version may allow other titles: what acts on other text is left out.
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let text = String::deserialize(from)?;
        Ok(Self(text.chars().filter(|c| !acts_on_others(*c)).collect()))
    }
}

/// The titles of a plant, by the names of its parts. A part without one is shown by its name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlantTitles {
    /// Those of drives.
    pub drives: BTreeMap<String, PartTitle>,
    /// That of the gateway.
    pub gateway: Option<PartTitle>,
    /// Those of groups.
    pub groups: BTreeMap<String, PartTitle>,
    /// Those of lines.
    pub lines: BTreeMap<String, PartTitle>,
}

impl PlantTitles {
    /// Whether no part has a title.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// The part called `name` in a sentence for people: its name, and its title in quotes if it has one.
#[must_use]
pub fn labelled(name: &str, title: Option<&PartTitle>) -> String {
    match title {
        // A quotation mark would end it early.
        Some(title) => format!("{name} \"{}\"", title.isolated().replace('"', "'")),
        None => name.to_owned(),
    }
}

/// Whether `c` controls a terminal, ends a line, or changes how text beside it is read or found: control characters, and what
/// is not shown except the marks that some scripts need between letters.
fn acts_on_others(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{AD}' | '\u{180E}' | '\u{200B}' | '\u{2028}'..='\u{202E}' | '\u{2060}'..='\u{206F}')
        || matches!(c, '\u{FEFF}' | '\u{FFF9}'..='\u{FFFB}' | '\u{E0000}'..='\u{E007F}')
}

/// What is seen of `text`, in small letters: two texts with the same are taken for one another.
#[must_use]
pub fn as_seen(text: &str) -> String {
    let seen = text.chars().filter(|c| is_seen(*c));
    seen.flat_map(char::to_lowercase).collect()
}

/// Whether `c` is more than a space or one of [`UNSEEN`].
fn is_seen(c: char) -> bool {
    !c.is_whitespace() && !UNSEEN.iter().any(|range| range.contains(&c))
}

/// Marks between letters, fillers, and marks that choose a variant of the letter before them.
const UNSEEN: [RangeInclusive<char>; 12] = [
    '\u{34F}'..='\u{34F}',
    '\u{61C}'..='\u{61C}',
    '\u{115F}'..='\u{1160}',
    '\u{17B4}'..='\u{17B5}',
    '\u{180B}'..='\u{180D}',
    '\u{180F}'..='\u{180F}',
    '\u{200C}'..='\u{200F}',
    '\u{2800}'..='\u{2800}',
    '\u{3164}'..='\u{3164}',
    '\u{FE00}'..='\u{FE0F}',
    '\u{FFA0}'..='\u{FFA0}',
    '\u{E0100}'..='\u{E01EF}',
];

/// Whether `c` is in a block of right-to-left letters (Unicode 16.0, DerivedBidiClass), or their mark.
const fn is_right_to_left(c: char) -> bool {
    matches!(c, '\u{590}'..='\u{8FF}' | '\u{200F}' | '\u{FB1D}'..='\u{FDFF}' | '\u{FE70}'..='\u{FEFC}')
        || matches!(c, '\u{10800}'..='\u{10FFF}' | '\u{1E800}'..='\u{1EFFF}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_letters_make_a_title() {
        for good in [
            "Umwälzpumpe Süd",
            "مضخة التدوير 2",
            "משאבה",
            "循環ポンプ",
            "می\u{200C}شود",
            "=SUM(A1), \"quoted\" <b>",
            &"ü".repeat(80),
        ] {
            assert_eq!(PartTitle::new(good).unwrap().as_str(), good);
        }
        assert_eq!(PartTitle::new("  a b\n").unwrap().as_str(), "a b");
    }

    #[test]
    fn what_acts_on_other_text_makes_none() {
        for bad in [
            '\0',
            '\u{7}',
            '\u{1b}',
            '\t',
            '\n',
            '\u{7f}',
            '\u{85}',
            '\u{9b}',
            '\u{200b}',
            '\u{2028}',
            '\u{2029}',
            '\u{202a}',
            '\u{202e}',
            '\u{2066}',
            '\u{2069}',
            '\u{feff}',
            '\u{e0041}',
        ] {
            let why = PartTitle::new(&format!("a{bad}b")).unwrap_err();
            let code = u32::from(bad);
            let expected = format!(
                "contains the character U+{code:04X}, which is not shown and acts on other text"
            );
            assert_eq!(why, expected);
        }
        for empty in [
            "",
            " ",
            "\u{a0}",
            "\u{200e}\u{200d}",
            "\u{3164}",
            "\u{fe0f}",
        ] {
            assert_eq!(PartTitle::new(empty).unwrap_err(), "is empty");
        }
        let long = PartTitle::new(&"ü".repeat(81)).unwrap_err();
        assert_eq!(long, "has 81 characters");
    }

    #[test]
    fn a_right_to_left_title_moves_nothing_beside_it() {
        let label = |title| labelled("pump-1", Some(&PartTitle::new(title).unwrap()));
        assert_eq!(label("مضخة 2"), "pump-1 \"\u{2068}مضخة 2\u{2069}\"");
        assert_eq!(label("Pumpe 2"), "pump-1 \"Pumpe 2\"");
        assert_eq!(labelled("pump-1", None), "pump-1");
    }

    #[test]
    fn the_titles_of_another_version_are_read_without_what_acts_on_other_text() {
        let sent = r#"{"drives":{"pump-1":"a\u001b[2Jb\u202e"},"newer":1}"#;
        let titles: PlantTitles = serde_json::from_str(sent).unwrap();
        assert_eq!(titles.drives["pump-1"].as_str(), "a[2Jb");
        assert_eq!((titles.gateway, titles.lines.len()), (None, 0));
    }
}
