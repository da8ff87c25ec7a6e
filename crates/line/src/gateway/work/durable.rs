//! What is shown only once the journal has it.

use crate::journal::RowNumber;
use std::collections::VecDeque;

/// A picture as far as its rows are durable. At most `MAX` newer ones wait for theirs; beyond that, the newest two are
/// merged.
#[derive(Debug, Default)]
pub(super) struct DurablePicture<T, const MAX: usize> {
    shown: T,
    /// Pictures to show once these rows are durable.
    unkept: VecDeque<(RowNumber, T)>,
}

impl<T, const MAX: usize> DurablePicture<T, MAX> {
    /// Shows `shown`, with nothing newer.
    pub const fn new(shown: T) -> Self {
        Self {
            shown,
            unkept: VecDeque::new(),
        }
    }

    /// What is shown.
    pub const fn shown(&self) -> &T {
        &self.shown
    }

    /// The newest picture, shown or not.
    pub fn newest(&self) -> &T {
        self.unkept
            .back()
            .map_or(&self.shown, |(_, picture)| picture)
    }

    /// Adds a picture to show once `row` is durable; without a row, at once, unless others are pending.
    pub fn show(&mut self, row: Option<RowNumber>, picture: T) {
        let is_full = self.unkept.len() >= MAX;
        match (row, self.unkept.back_mut()) {
            (None, None) => self.shown = picture,
            (None, Some(newest)) => newest.1 = picture,
            (Some(row), Some(newest)) if is_full => *newest = (row, picture),
            (Some(row), _) => self.unkept.push_back((row, picture)),
        }
    }

    /// Everything up to `row` is durable. Returns whether that changes what is shown.
    pub fn kept(&mut self, row: RowNumber) -> bool {
        let before = self.unkept.len();
        while let Some((_, picture)) = self.unkept.pop_front_if(|(it, _)| *it <= row) {
            self.shown = picture;
        }
        self.unkept.len() != before
    }
}
