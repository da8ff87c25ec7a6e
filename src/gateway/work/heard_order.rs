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
    /// To stop, or to cut the output off.
    Stop { coast: bool },
}
