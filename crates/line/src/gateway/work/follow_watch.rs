//! What a drive has shown since it was ordered to run.

use crate::domain::time::MonoTime;

/// What the drive has shown since it was ordered to run.
#[derive(Debug, Default)]
pub(super) struct FollowWatch {
    /// It was seen running.
    pub(super) has_run: bool,
    /// The last readings in a row that show it at rest, and when the first of them arrived.
    pub(super) at_rest: u8,
    pub(super) since: MonoTime,
}
