//! Second sources of facts, and how well stop, forward and the setpoint are known.

use super::{BasicFact, Model};

/// A second source of a fact, whose document is independent of the first one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SecondSource {
    /// The fact, as the file calls it: `run.stop`, `register.run_command`.
    pub key: String,
    /// Document and place.
    pub source: String,
}

impl Model {
    /// The second source of the fact `key`.
    #[must_use]
    pub fn second_source(&self, key: &str) -> Option<&str> {
        self.second_sources
            .iter()
            .find(|second| second.key == key)
            .map(|second| second.source.as_str())
    }
}

impl BasicFact<'_> {
    /// What it is and how well it is known: `stop (third-party)`, `stop (third-party, two independent sources)`.
    #[must_use]
    pub fn described(&self) -> String {
        let second = if self.also.is_some() {
            ", two independent sources"
        } else {
            ""
        };
        format!("{} ({}{second})", self.what, self.confidence.keyword())
    }
}
