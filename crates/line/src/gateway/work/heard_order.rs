//! The order of another gateway of the line, as heard there.

use crate::domain::command::Direction;
use crate::domain::time::MonoTime;

/// The last order that was heard on the line since this gateway listens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum HeardOrder {
    /// None.
    #[default]
    Nothing,
    /// To run, since this moment.
    Run(Direction, MonoTime),
    /// None: it runs, and was not started over the line, as the one that was active knows.
    Elsewhere,
    /// To stop, or to cut the output off.
    Stop { coast: bool },
}

/// What the drive does is not known although this gateway has taken the line: its first readings decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct UnsettledMotion {
    /// The line was handed over: a drive that runs goes on.
    pub goes_on: bool,
    /// Until this moment a reading is awaited that shows whether the drive obeys its panel.
    pub until: MonoTime,
}
