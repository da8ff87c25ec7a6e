//! What is probably wrong with a line, as far as the pattern of what is heard tells, and what to do about it.

use super::ids::Station;

/// One suspicion. Its text is for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Suspicion {
    /// Nothing at all comes back from anybody.
    #[error(
        "nothing is heard from any drive: check the power, the wiring (A and B swapped?), speed, parity and the station \
         numbers"
    )]
    NothingHeard,
    /// Bytes come and make no frame; there are fewer of them than in the replies that are due.
    #[error("bytes come but never a frame, and too few: the drives are probably set to a higher speed than the line")]
    DrivesAreFaster,
    /// Bytes come and make no frame; there are more of them than in the replies that are due.
    #[error("bytes come but never a frame, and too many: the drives are probably set to a lower speed than the line")]
    DrivesAreSlower,
    /// Replies of the right length come and their check is always wrong.
    #[error(
        "replies of the right length come and are always damaged: check parity, data bits and stop bits, then the \
         termination and the shield"
    )]
    AlwaysDamaged,
    /// One drive is silent and others answer.
    #[error("station {} was never heard while others answer: check its station number, speed, parity and power", .0.0)]
    OneSilent(Station),
    /// More replies than requests.
    #[error(
        "more answers come from station {} than requests go to it: two drives probably have this number; its trips are not \
         believed until that is over (duplicate_station)", .0.0
    )]
    DuplicateStation(Station),
    /// Replies that come later than the longest lateness that is declared.
    #[error(
        "station {} answers later than its `max_lateness` allows: raise that, or find what holds the replies back \
         (late_beyond_limit)", .0.0
    )]
    LateBeyondLimit(Station),
    /// Somebody else asks drives on this line.
    #[error("somebody else sends requests on this line: a serial line takes one master only; disconnect the other one")]
    OtherMaster,
    /// What is sent comes back.
    #[error("the adapter sends back what is sent: switch its echo off, or say `echo = \"strip\"` for the line")]
    Echo,
    /// Somebody never stops talking.
    #[error("something on the line never stops talking: disconnect drives one by one until it is silent")]
    Jam,
}

impl Suspicion {
    /// The word for programs.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::NothingHeard => "nothing_heard",
            Self::DrivesAreFaster => "drives_are_faster",
            Self::DrivesAreSlower => "drives_are_slower",
            Self::AlwaysDamaged => "always_damaged",
            Self::OneSilent(_) => "one_silent",
            Self::DuplicateStation(_) => "duplicate_station",
            Self::LateBeyondLimit(_) => "late_beyond_limit",
            Self::OtherMaster => "other_master",
            Self::Echo => "echo",
            Self::Jam => "jam",
        }
    }
}
