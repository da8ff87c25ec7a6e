//! What a sound frame is that answers no open request.

use std::time::Duration;

/// A sound frame of a station that answers no open request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StrayFrame {
    /// A missing reply.
    Explained,
    /// A reply later than the maximum lateness: the time since its request.
    BeyondLimit(Duration),
    /// An excess reply, or a reply to another master: the time since the newest request.
    TooMany(Duration),
    /// The first frame after a request, and not its reply. If none follows, the drive answers in the wrong form.
    WrongForm(Duration),
}
