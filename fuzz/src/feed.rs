//! The bytes of the fuzzer, consumed as the values that a target needs. Past their end everything is 0 or empty.

use std::time::Duration;

/// The remaining bytes.
pub struct Feed<'a>(&'a [u8]);

impl<'a> Feed<'a> {
    /// Longest piece: longer than any protocol here accepts at once.
    pub const PIECE_MAX: usize = 16 * 1024;

    pub const fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else {
            return 0;
        };
        self.0 = rest;
        *first
    }

    pub fn flag(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    pub fn word(&mut self) -> u16 {
        u16::from_be_bytes([self.byte(), self.byte()])
    }

    pub fn millis(&mut self) -> Duration {
        Duration::from_millis(self.word().into())
    }

    /// One of `all`, which is not empty.
    pub fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[usize::from(self.byte()) % all.len()]
    }

    /// A byte for the length, then as many bytes; from 240 on it counts in kibibytes.
    pub fn piece(&mut self) -> &'a [u8] {
        let length = match usize::from(self.byte()) {
            small @ 0..240 => small,
            large => (large - 239) * 1024,
        };
        let (piece, rest) = self.0.split_at(length.min(self.0.len()));
        self.0 = rest;
        piece
    }

    /// A piece as words: at most `most`.
    pub fn words(&mut self, most: usize) -> Vec<u16> {
        let count = usize::from(self.byte()) % (most + 1);
        (0..count).map(|_| self.word()).collect()
    }

    /// All remaining bytes.
    pub const fn rest(self) -> &'a [u8] {
        self.0
    }
}

/// `stream` in chunks whose lengths follow from `seed`: 0 gives single bytes.
pub fn chunks(stream: &[u8], seed: u8) -> impl Iterator<Item = &[u8]> {
    let mut rest = stream;
    let mut state = u32::from(seed);
    std::iter::from_fn(move || {
        let length = 1 + (state >> 3) as usize % 40;
        state = if seed == 0 {
            0
        } else {
            state.wrapping_mul(1_103_515_245).wrapping_add(12_345) >> 1
        };
        let (chunk, behind) = rest.split_at(length.min(rest.len()));
        rest = behind;
        (!chunk.is_empty()).then_some(chunk)
    })
}
