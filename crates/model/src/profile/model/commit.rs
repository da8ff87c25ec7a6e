//! The words by which a drive takes over or stores what was written to its parameters.

use super::Fact;
use crate::domain::address::Address;

/// What such a word does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CommitEffect {
    /// What was written acts from then on.
    Apply,
    /// What was written outlasts the drive's power, and acts from then on.
    Store,
}

impl CommitEffect {
    /// The word used in files and answers.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Apply => "apply",
            Self::Store => "store",
        }
    }
}

/// One word that takes over or stores parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommitWord {
    /// The register, which only the gateway writes.
    pub address: Address,
    /// What it does.
    pub effect: CommitEffect,
    /// The word.
    pub value: u16,
    /// The word is never sent while the motor may turn.
    pub at_standstill: bool,
}

/// The words of a model, each at most once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CommitWords {
    /// The word that applies.
    pub apply: Option<Fact<CommitWord>>,
    /// The word that stores.
    pub store: Option<Fact<CommitWord>>,
}

impl CommitWords {
    /// The stated word for `effect`, proven or not.
    #[must_use]
    pub const fn stated(&self, effect: CommitEffect) -> Option<&Fact<CommitWord>> {
        match effect {
            CommitEffect::Apply => self.apply.as_ref(),
            CommitEffect::Store => self.store.as_ref(),
        }
    }

    /// All stated words.
    pub fn all(&self) -> impl Iterator<Item = &Fact<CommitWord>> {
        self.apply.iter().chain(&self.store)
    }
}
