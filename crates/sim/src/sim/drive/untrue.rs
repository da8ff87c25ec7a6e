//! A drive that does not show what is so: registers that hold a foreign word, a memory that reads as one word everywhere,
//! registers whose reads are refused, and replies that are too long.

use crate::domain::address::Address;
use std::collections::BTreeMap;

/// What reads show instead of the truth.
#[derive(Clone, Debug, Default)]
pub(super) struct UntrueReads {
    /// Everywhere.
    everywhere: Option<u16>,
    /// At single addresses; `None` refuses the read.
    single: BTreeMap<Address, Option<u16>>,
    /// Reads from here on are answered with a word too many.
    too_long_at: Option<Address>,
}

/// What a read of one address shows.
pub(super) enum ShownWord {
    /// What is so.
    Truth,
    /// This word.
    Word(u16),
    /// Nothing: the read is refused.
    Nothing,
}

impl UntrueReads {
    /// Reads of `address` show `word`; without one they are refused.
    pub(super) fn show_at(&mut self, address: Address, word: Option<u16>) {
        self.single.insert(address, word);
    }

    /// All reads show `word`.
    pub(super) const fn show_everywhere(&mut self, word: u16) {
        self.everywhere = Some(word);
    }

    /// Reads that begin at `address` are answered with a word too many.
    pub(super) const fn answer_too_long_at(&mut self, address: Address) {
        self.too_long_at = Some(address);
    }

    /// Whether a read from `first` on is answered with a word too many.
    pub(super) fn is_too_long(&self, first: Address) -> bool {
        self.too_long_at == Some(first)
    }

    pub(super) fn at(&self, address: Address) -> ShownWord {
        match (self.single.get(&address), self.everywhere) {
            (Some(Some(word)), _) => ShownWord::Word(*word),
            (None, Some(word)) => ShownWord::Word(word),
            (Some(None), _) => ShownWord::Nothing,
            (None, None) => ShownWord::Truth,
        }
    }
}
