//! Sentences for people, in the language of the reader: one catalogue for the page, its advice and reports.
//!
//! The gateway makes a [`Sentence`] of a key and values. Its own documents and log are in English. The page fetches the
//! catalogue of its language (`en.json`, `de.json`) and puts the same key and values into it.

#[cfg(test)]
mod tests;

use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::LazyLock;

/// A catalogue: its language and its text, which is JSON of keys and sentences.
#[derive(Clone, Copy, Debug)]
pub struct TextCatalogue {
    /// The code of the language as in ISO 639-1.
    pub language: &'static str,
    /// The sentences.
    pub text: &'static str,
}

/// All languages. The page lists them too, in `texts.js`.
pub const CATALOGUES: [TextCatalogue; 2] = [
    TextCatalogue {
        language: "en",
        text: include_str!("en.json"),
    },
    TextCatalogue {
        language: "de",
        text: include_str!("de.json"),
    },
];

/// Part of a catalogue: a browser fetches what it shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextChapter {
    /// What the page itself says.
    Page,
    /// What set-up says.
    Setup,
    /// What the gateway says. In English it comes with the documents.
    Gateway,
}

/// The first words of the keys of set-up.
const OF_SETUP: [&str; 12] = [
    "setup",
    "found",
    "rules",
    "verify",
    "guess",
    "port",
    "link",
    "parity",
    "stop_bits",
    "way",
    "directions",
    "fail_safe",
];
/// The first words of the keys of the gateway.
const OF_GATEWAY: [&str; 8] = [
    "finding",
    "reason",
    "hint",
    "suspicion",
    "fault",
    "watchdog",
    "request",
    "unknown_reason",
];

impl TextChapter {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Page, Self::Setup, Self::Gateway];

    /// The word in file names.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Page => "page",
            Self::Setup => "setup",
            Self::Gateway => "gateway",
        }
    }

    fn of(key: &str) -> Self {
        let first = key.split('.').next().unwrap_or(key);
        if OF_SETUP.contains(&first) {
            Self::Setup
        } else if OF_GATEWAY.contains(&first) {
            Self::Gateway
        } else {
            Self::Page
        }
    }
}

impl TextCatalogue {
    /// All sentences by their keys.
    fn sentences(self) -> BTreeMap<String, String> {
        serde_json::from_str(self.text).unwrap_or_default()
    }

    /// One chapter as JSON.
    #[must_use]
    pub fn chapter(self, chapter: TextChapter) -> String {
        let mut sentences = self.sentences();
        sentences.retain(|key, _| TextChapter::of(key) == chapter);
        json!(sentences).to_string()
    }
}

static ENGLISH: LazyLock<BTreeMap<String, String>> = LazyLock::new(|| CATALOGUES[0].sentences());

/// The English sentence of `key`; `None` if the catalogue has none.
#[must_use]
pub fn english(key: &str) -> Option<&'static str> {
    ENGLISH.get(key).map(String::as_str)
}

/// A sentence without a language: a key of the catalogue, and the values for its places. `Display` gives the English
/// text.
#[derive(Clone, Debug, PartialEq)]
pub struct Sentence {
    key: Cow<'static, str>,
    values: Vec<(&'static str, SentencePart)>,
}

/// A value in a sentence.
#[derive(Clone, Debug, PartialEq)]
pub enum SentencePart {
    /// Names, and texts of manuals, which have no translation.
    Text(String),
    /// A whole number.
    Integer(u64),
    /// Any number.
    Number(f64),
    /// A part that has a translation of its own.
    Sentence(Sentence),
}

impl Sentence {
    /// The sentence of `key`.
    #[must_use]
    pub fn new(key: impl Into<Cow<'static, str>>) -> Self {
        Self {
            key: key.into(),
            values: Vec::new(),
        }
    }

    /// With a value for the place called `{name}`.
    #[must_use]
    pub fn with(mut self, name: &'static str, value: impl Into<SentencePart>) -> Self {
        self.values.push((name, value.into()));
        self
    }

    /// The key and the values, for clients that show another language.
    #[must_use]
    pub fn document(&self) -> Value {
        let values: Map<_, _> = self
            .values
            .iter()
            .map(|(name, part)| ((*name).to_owned(), part.document()))
            .collect();
        json!({ "key": self.key, "values": values })
    }
}

impl SentencePart {
    fn document(&self) -> Value {
        match self {
            Self::Text(text) => text.as_str().into(),
            Self::Integer(number) => (*number).into(),
            Self::Number(number) => (*number).into(),
            Self::Sentence(sentence) => sentence.document(),
        }
    }
}

impl fmt::Display for Sentence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest = english(&self.key).unwrap_or(&self.key);
        while let Some((before, behind)) = rest.split_once('{') {
            f.write_str(before)?;
            let (name, after) = behind.split_once('}').unwrap_or((behind, ""));
            if let Some((_, part)) = self.values.iter().find(|(of, _)| *of == name) {
                write!(f, "{part}")?;
            }
            rest = after;
        }
        f.write_str(rest)
    }
}

impl fmt::Display for SentencePart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::Integer(number) => write!(f, "{number}"),
            Self::Number(number) => write!(f, "{number}"),
            Self::Sentence(sentence) => write!(f, "{sentence}"),
        }
    }
}

impl From<&str> for SentencePart {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for SentencePart {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<u64> for SentencePart {
    fn from(number: u64) -> Self {
        Self::Integer(number)
    }
}

impl From<f64> for SentencePart {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

impl From<Sentence> for SentencePart {
    fn from(sentence: Sentence) -> Self {
        Self::Sentence(sentence)
    }
}
