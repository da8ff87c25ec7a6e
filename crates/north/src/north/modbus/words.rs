//! A reusable buffer for the words of one answer.

use crate::wire::pdu::MAX_READ_WORDS;

const WORDS: usize = MAX_READ_WORDS as usize;

/// Up to 125 words, without heap memory.
#[derive(Clone, Debug)]
pub struct WordBuffer {
    words: [u16; WORDS],
    len: usize,
}

impl Default for WordBuffer {
    fn default() -> Self {
        Self {
            words: [0; WORDS],
            len: 0,
        }
    }
}

impl WordBuffer {
    /// Fills in the words that `word` has for each of `count` addresses from `address` on. Returns whether it had one
    /// for each and all fit.
    pub fn fill(
        &mut self,
        address: u16,
        count: u16,
        mut word: impl FnMut(u16) -> Option<u16>,
    ) -> bool {
        self.len = 0;
        for offset in 0..count {
            let found = address.checked_add(offset).and_then(&mut word);
            let (Some(found), Some(place)) = (found, self.words.get_mut(self.len)) else {
                return false;
            };
            *place = found;
            self.len += 1;
        }
        true
    }

    /// The words that were filled in last.
    #[must_use]
    pub fn as_slice(&self) -> &[u16] {
        self.words.get(..self.len).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_no_partial_answer() {
        let mut words = WordBuffer::default();
        assert!(words.fill(7, 125, Some));
        assert_eq!(words.as_slice(), (7..132).collect::<Vec<u16>>());
        assert!(words.fill(1, 2, Some));
        assert_eq!(words.as_slice(), [1, 2]);
        assert!(!words.fill(7, 126, Some));
        assert!(!words.fill(0xFFFF, 2, Some));
        assert!(!words.fill(1, 3, |address| (address != 3).then_some(0)));
    }
}
