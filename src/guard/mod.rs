//! The only door for writes: each attempt is reviewed here and becomes [`Approved`] or a refusal.
//!
//! In this version no drive can be given a control section, so every attempt is refused. The line accepts
//! nothing but [`Approved`], which only this room can make, so the refusal holds by construction.

use crate::domain::command::Reason;
use crate::domain::ids::DriveIndex;
use crate::domain::native::Refusal;
use crate::domain::time::MonoTime;
use crate::wire::pdu::Request;

/// What kind of write it is, in the order in which they go to the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Class {
    /// A stop. It waits for nothing but the exchange in flight and has no deadline.
    Stop,
    /// Any other write.
    Command,
}

/// What a drive's configuration allows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Control {
    /// No control section: read-only from everywhere.
    None,
    /// Stands for the control sections that are to come, so that the path behind the door is tested.
    #[cfg(test)]
    Anything,
}

/// Somebody wants to write.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attempt {
    /// Which drive of the line.
    pub drive: DriveIndex,
    /// First register.
    pub address: u16,
    /// The words.
    pub values: Vec<u16>,
    /// After this moment it must no longer reach the wire.
    pub deadline: MonoTime,
}

/// A write that may go to the line until its deadline. It can be made only by [`review`], and not copied:
/// one approval is one frame.
#[derive(Debug, PartialEq, Eq)]
pub struct Approved {
    class: Class,
    drive: DriveIndex,
    request: Request,
    deadline: MonoTime,
}

impl Approved {
    /// What kind of write it is.
    #[must_use]
    pub const fn class(&self) -> Class {
        self.class
    }

    /// Which drive of the line.
    #[must_use]
    pub const fn drive(&self) -> DriveIndex {
        self.drive
    }

    /// What goes on the wire.
    #[must_use]
    pub const fn request(&self) -> &Request {
        &self.request
    }

    /// Whether it may still reach the wire at `now`.
    #[must_use]
    pub fn may_be_sent(&self, now: MonoTime) -> bool {
        self.class == Class::Stop || now < self.deadline
    }
}

/// Reviews an attempt to write to a drive whose configuration allows `control`.
///
/// # Errors
/// The reason why nothing may be put on the line.
pub fn review(attempt: &Attempt, control: &Control) -> Result<Approved, Refusal> {
    match (control, attempt.values.as_slice()) {
        #[cfg(test)]
        (Control::Anything, [value]) => Ok(Approved {
            class: if *value == 0 { Class::Stop } else { Class::Command },
            drive: attempt.drive,
            request: Request::WriteSingle { address: attempt.address, value: *value },
            deadline: attempt.deadline,
        }),
        _ => Err(Refusal::Guard(Reason::ReadOnly)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_control_section_nothing_may_be_written() {
        let attempt = Attempt { drive: DriveIndex(0), address: 2, values: vec![0], deadline: MonoTime::from_millis(1) };
        assert_eq!(review(&attempt, &Control::None), Err(Refusal::Guard(Reason::ReadOnly)));
    }
}
