//! The web page's content as JSON documents: state, changes, the trend of the last hour, advice. Everything is read
//! from existing views and reports, so that viewing the page causes no traffic on a line.

mod advice;
pub mod changes;
pub mod drive;
pub mod gateway;
pub mod history;
pub mod kept;
pub mod line;
pub mod line_use;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
pub mod trend;
pub mod trips;

pub use drive::PageDrive;
pub use gateway::PageGateway;
pub use line::PageLine;
pub use line_use::LineUse;
pub use trend::DriveTrends;

use super::clock::LabelClock;
use crate::domain::time::MonoTime;

/// The present, and the format of its moments.
#[derive(Clone, Copy, Debug)]
pub struct PageMoment<'c> {
    /// Now.
    pub now: MonoTime,
    /// Writes moments.
    pub clock: &'c LabelClock,
}

impl PageMoment<'_> {
    /// Now, as RFC 3339 in UTC.
    #[must_use]
    pub fn text(&self) -> String {
        self.clock.text(self.now)
    }
}
