//! What the north sides pass to the journal, if there is one.

use crate::drive::description::DriveRef;
use crate::journal::WriteAttempt;
use std::fmt::Debug;
use std::sync::Arc;

/// A journal as the north sides see it. No call blocks.
pub trait NorthJournal: Debug + Send + Sync {
    /// Keeps a write attempt that reached no line. `drive` is `None` if it was for all drives or for one that does not
    /// exist. The attempt carries its report: no end follows. Ids count within each side.
    fn keep(&self, drive: Option<DriveRef>, attempt: WriteAttempt);
    /// The broker has the event with this number.
    fn event_taken(&self, seq: u64);
    /// Requests the first events after this number that no broker has. Answered once, with
    /// [`LineNews::Events`](crate::daemon::exchange::answers::LineNews::Events): at once if there are any, else when there is
    /// one. A later request replaces one that is not answered.
    fn want_events(&self, after: u64);
}

/// The journal, if there is one. Without it, attempts are dropped and events are not requested.
pub type Journal = Option<Arc<dyn NorthJournal>>;
