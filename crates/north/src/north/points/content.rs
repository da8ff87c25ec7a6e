//! What a point shows at a moment, compared without being written out.

use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::{DriveView, TripView};
use crate::north::clock::LabelClock;
use crate::north::shown;
use crate::profile::scale::{Decimal, ScaledValue};
use std::borrow::Cow;

/// The content of a point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PointContent {
    /// Nothing reliable.
    Unknown,
    /// The value of a register.
    Value(ScaledValue),
    /// A yes or no.
    Flag(bool),
    /// A code or a count.
    Number(i64),
    /// A frequency that was ordered.
    Hertz(Hertz),
    /// One of the sums of what the drive has used.
    Sum(Decimal),
    /// A word, a name or a document.
    Text(Cow<'static, str>),
}

impl PointContent {
    /// This text, if there is one.
    pub fn text(text: Option<impl Into<Cow<'static, str>>>) -> Self {
        text.map_or(Self::Unknown, |text| Self::Text(text.into()))
    }

    /// This yes or no, if it is known.
    pub fn flag(flag: Option<bool>) -> Self {
        flag.map_or(Self::Unknown, Self::Flag)
    }
}

/// Where the content of a point is looked up.
#[derive(Clone, Copy)]
pub struct PointContext<'l> {
    /// The present.
    pub at: MonoTime,
    /// The clock for times in documents.
    pub clock: LabelClock,
    /// The drive.
    pub drive: &'l DriveDescription,
    /// What is known of it.
    pub view: &'l DriveView,
}

impl PointContext<'_> {
    /// What is known of trips, if that is as recent as the register that shows them has to be. One that is not polled is
    /// read in another way.
    pub(super) fn trip(&self) -> Option<&TripView> {
        let polled = self
            .drive
            .model
            .trip_register()
            .filter(|register| register.poll.is_some());
        let is_fresh = polled.is_none_or(|register| {
            shown::fresh(self.drive, register, self.view, self.at).is_some()
        });
        is_fresh.then_some(&self.view.trip)
    }

    /// The number or the bits of the active warnings, if they are known.
    pub(super) fn warning(&self) -> Option<u32> {
        shown::warning(self.drive, self.view, self.at)
    }
}
