//! What a drive has used: measured, and shown as far as its rows are durable, so that no sum falls after a kill.

use super::durable::DurablePicture;
use crate::drive::plan::PollPace;
use crate::drive::usage::{KeptUsage, UsageMeter, UsageParts, UsageTotals, UsageView};
use crate::profile::model::Model;

/// Most sums that wait for their rows.
const UNKEPT_MAX: usize = 8;

/// The sums of one drive.
#[derive(Debug)]
pub(super) struct UsageSums {
    pub meter: UsageMeter,
    parts: UsageParts,
    pub totals: DurablePicture<UsageTotals, UNKEPT_MAX>,
}

impl UsageSums {
    /// Nothing used so far.
    pub fn new(model: &Model, pace: PollPace) -> Self {
        let totals = DurablePicture::new(UsageTotals::default());
        Self {
            meter: UsageMeter::new(model, pace),
            parts: UsageParts::of(model),
            totals,
        }
    }

    /// Continues from what an earlier process has kept.
    pub fn remember(&mut self, kept: KeptUsage) {
        self.meter.remember(kept);
        self.totals = DurablePicture::new(kept.totals);
    }

    /// What is shown.
    pub const fn view(&self) -> UsageView {
        UsageView {
            parts: self.parts,
            totals: *self.totals.shown(),
        }
    }
}
