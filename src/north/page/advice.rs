//! What is wrong or could be better: what, where, and what would be right. It follows from what is known already.

mod of_drive;
mod of_gateway;
mod of_line;

use crate::domain::ids::Name;
use serde_json::{Value, json};

/// How much it matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// A drive is tripped: what somebody who looks at the page has to see first.
    Trip,
    /// Something does not work.
    Problem,
    /// It works, and would be better otherwise.
    Advice,
}

impl Severity {
    /// The word as it stands in documents.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Trip | Self::Problem => "problem",
            Self::Advice => "advice",
        }
    }
}

/// One piece of advice, for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Advice {
    /// How much it matters.
    pub severity: Severity,
    /// The line that it is about.
    pub line: Option<Name>,
    /// The drive that it is about.
    pub drive: Option<Name>,
    /// What is wrong and what would be right.
    pub text: String,
}

impl Advice {
    /// The document.
    #[must_use]
    pub fn document(&self) -> Value {
        json!({
            "severity": self.severity.word(),
            "line": self.line.as_ref().map(Name::as_str),
            "drive": self.drive.as_ref().map(Name::as_str),
            "text": self.text,
        })
    }
}

/// All of `said`, what matters most first; otherwise in its order.
#[must_use]
pub fn ranked(said: impl IntoIterator<Item = Advice>) -> Vec<Advice> {
    let mut all: Vec<_> = said.into_iter().collect();
    all.sort_by_key(|advice| advice.severity);
    all
}

/// What there is to say about one thing.
#[derive(Debug, Default)]
struct AdviceText {
    line: Option<Name>,
    drive: Option<Name>,
    all: Vec<Advice>,
}

impl AdviceText {
    fn say(&mut self, severity: Severity, text: impl Into<String>) {
        let (line, drive) = (self.line.clone(), self.drive.clone());
        self.all.push(Advice { severity, line, drive, text: text.into() });
    }

    fn problem(&mut self, text: impl Into<String>) {
        self.say(Severity::Problem, text);
    }

    fn advice(&mut self, text: impl Into<String>) {
        self.say(Severity::Advice, text);
    }
}
