//! Why the role on a line changes.

/// Why the line was given up, or taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StandbyChange {
    /// The line was silent for long enough: this gateway is active from now on.
    TakenOver,
    /// The line was handed over: this gateway is active from now on.
    HandedOver,
    /// This gateway has not sent for too long.
    Stalled,
    /// Another master was heard.
    Rival,
    /// What came instead of its first replies shows that another one sends as well.
    Collided,
    /// The partner was asked to take the line.
    Yielded,
    /// This gateway hears no drive.
    Deaf,
}
