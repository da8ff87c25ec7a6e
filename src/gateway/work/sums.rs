//! What a drive has used: measured, and shown as far as it is durable.

use crate::drive::plan::Pace;
use crate::drive::usage::{KeptUsage, UsageMeter, UsageParts, UsageTotals, UsageView};
use crate::journal::RowNumber;
use crate::profile::model::Model;
use std::collections::VecDeque;

/// Most sums that wait for their rows. Beyond that, only the newest of them is shown.
const UNKEPT_MAX: usize = 8;

/// What a drive has used: measured, and shown as far as its rows are durable, so that no sum falls after a kill.
#[derive(Debug)]
pub(super) struct Sums {
    pub meter: UsageMeter,
    pub shown: UsageView,
    /// Sums to show once these rows are durable.
    unkept: VecDeque<(RowNumber, UsageTotals)>,
}

impl Sums {
    /// Nothing used so far.
    pub fn new(model: &Model, pace: Pace) -> Self {
        let shown = UsageView { parts: UsageParts::of(model), totals: UsageTotals::default() };
        Self { meter: UsageMeter::new(model, pace), shown, unkept: VecDeque::new() }
    }

    /// Continues from what an earlier process has kept.
    pub fn remember(&mut self, kept: KeptUsage) {
        self.meter.remember(kept);
        self.shown.totals = kept.totals;
    }

    /// Shows `totals` once `row` is durable; without a journal, at once.
    pub fn show(&mut self, row: Option<RowNumber>, totals: UsageTotals) {
        let is_full = self.unkept.len() >= UNKEPT_MAX;
        match (row, self.unkept.back_mut()) {
            (None, _) => self.shown.totals = totals,
            (Some(row), Some(newest)) if is_full => *newest = (row, totals),
            (Some(row), _) => self.unkept.push_back((row, totals)),
        }
    }

    /// Everything up to `row` is durable. Returns whether that changes what is shown.
    pub fn kept(&mut self, row: RowNumber) -> bool {
        let before = self.unkept.len();
        while let Some((_, totals)) = self.unkept.pop_front_if(|(it, _)| *it <= row) {
            self.shown.totals = totals;
        }
        self.unkept.len() != before
    }
}
