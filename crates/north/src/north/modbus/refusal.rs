//! Which exception explains to a client why a write was not done.

use crate::domain::command::{Outcome, Reason, Report};
use crate::wire::exception;

/// The exception for a command that was refused for `reason`:
///
/// | code | |
/// | --- | --- |
/// | 01 | never allowed: the drive, this client or the model does not take it |
/// | 02 | the register is not listed |
/// | 03 | the value: limits, direction, not known, parts that exclude each other |
/// | 04 | the drive refused |
/// | 06 | not now: later it may be accepted |
/// | 0A | no way to the drive |
/// | 0B | no reply, outcome unknown, too late |
#[must_use]
pub const fn exception_of(reason: Reason) -> u8 {
    match reason {
        Reason::ReadOnly
        | Reason::NotFromHere
        | Reason::NotAllowed
        | Reason::NotCapable
        | Reason::Unverified
        | Reason::NoRelease
        | Reason::NoTake
        | Reason::NotOverBus
        | Reason::Retained => exception::ILLEGAL_FUNCTION,
        Reason::NotListed => exception::ILLEGAL_DATA_ADDRESS,
        Reason::NotUnderstood
        | Reason::NotANumber
        | Reason::HalfAValue
        | Reason::OutsideLimits
        | Reason::OutsideRange
        | Reason::BetweenSteps
        | Reason::DirectionNotAllowed
        | Reason::TooManyFrames
        | Reason::Conflict
        | Reason::TooLarge => exception::ILLEGAL_DATA_VALUE,
        // Nothing to report and nothing to change are not refusals; as such they would be a bug.
        Reason::None
        | Reason::Unchanged
        | Reason::KeptOldValue
        | Reason::DriveException
        | Reason::DriveLocked
        | Reason::DriveInTrip
        | Reason::NotReadBack
        | Reason::NotReady
        | Reason::NotCommitted
        | Reason::NotEffective
        | Reason::StoppedElsewhere => exception::SERVER_DEVICE_FAILURE,
        Reason::StartInhibited
        | Reason::StopPending
        | Reason::StopRefused
        | Reason::OtherOwner
        | Reason::RestartDelay
        | Reason::StaleEpoch
        | Reason::EpochNeeded
        | Reason::SetpointUnknown
        | Reason::FullScaleUnknown
        | Reason::DriveBusy
        | Reason::Tripped
        | Reason::NotTripped
        | Reason::Reversal
        | Reason::SignUnknown
        | Reason::Moving
        | Reason::LineQuality
        | Reason::OutputOutside
        | Reason::StartsTooOften
        | Reason::LocalControl
        | Reason::Watchdog
        | Reason::Precondition
        | Reason::OtherDrive
        | Reason::Implausible
        | Reason::WrittenTooOften
        | Reason::Removed
        | Reason::QueueFull
        | Reason::Duplicate
        | Reason::Stopped
        | Reason::Newer
        | Reason::ShuttingDown
        | Reason::CommanderLost => exception::SERVER_DEVICE_BUSY,
        Reason::LineDown | Reason::Standby | Reason::Offline | Reason::UnknownDrive => {
            exception::GATEWAY_PATH_UNAVAILABLE
        }
        Reason::Stale | Reason::ClockAhead | Reason::TooLate | Reason::NoReply => {
            exception::GATEWAY_TARGET_FAILED
        }
    }
}

/// The exception for a command with this outcome; `None` if it succeeded.
#[must_use]
pub fn exception_for(report: &Report) -> Option<u8> {
    match report.outcome {
        Outcome::Acknowledged | Outcome::Confirmed => None,
        Outcome::Refused => Some(exception_of(report.reason)),
        Outcome::Failed => Some(report.exception.unwrap_or(exception::SERVER_DEVICE_FAILURE)),
        Outcome::Superseded => Some(exception::SERVER_DEVICE_BUSY),
        Outcome::Expired | Outcome::Unknown => Some(exception::GATEWAY_TARGET_FAILED),
    }
}

/// The exception that matters more to a client if there is one answer for several drives: an unknown outcome is worst,
/// then a drive that refused, then one that is out of reach.
#[must_use]
pub fn worst(one: Option<u8>, other: Option<u8>) -> Option<u8> {
    if weight(one) >= weight(other) {
        one
    } else {
        other
    }
}

const fn weight(code: Option<u8>) -> u16 {
    match code {
        None => 0,
        Some(exception::GATEWAY_TARGET_FAILED) => 0x103,
        Some(exception::SERVER_DEVICE_FAILURE) => 0x102,
        Some(exception::GATEWAY_PATH_UNAVAILABLE) => 0x101,
        Some(code) => 1 + code as u16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By number.
    #[rustfmt::skip]
    const CODES: [u8; 70] = [
        4, 1, 1, 1, 3, 3, 3, 3, 3, 1, // none, read_only, not_from_here, ... direction_not_allowed, not_capable
        1, 2, 6, 6, 6, 6, 6, 6, 6, 6, // unverified, not_listed, start_inhibited, ... tripped
        6, 6, 6, 10, 10, 1, 11, 6, 11, 6, // not_tripped, reversal, queue_full, line_down, ... stopped
        6, 4, 4, 11, 4, 4, 10, 3, 3, 3, // newer, kept_old_value, ... too_large
        4, 6, 6, 1, 6, 3, // unchanged, shutting_down, commander_lost, no_release, moving, outside_range
        6, 6, 6, 6, 6, 1, 6, 6, // line_quality, starts_too_often, ... no_take, removed, stop_refused
        11, 6, 6, 1, 6, // clock_ahead, precondition, other_drive, not_over_bus, full_scale_unknown
        6, 4, 4, 4, // drive_busy, drive_locked, drive_in_trip, not_ready
        6, 3, 4, 10, // sign_unknown, half_a_value, not_committed, standby
        6,  // implausible
        4, 6, // stopped_elsewhere, output_outside_limits
    ];

    #[test]
    fn every_reason_has_its_exception() {
        let found: Vec<u8> = Reason::ALL
            .iter()
            .map(|reason| exception_of(*reason))
            .collect();
        assert_eq!(found, CODES);
        assert_eq!(exception_of(Reason::DirectionNotAllowed), 3);
    }

    #[test]
    fn every_outcome_has_its_exception() {
        let ended = |outcome| exception_for(&Report::new(outcome, Reason::None));
        assert_eq!(ended(Outcome::Acknowledged), None);
        assert_eq!(ended(Outcome::Confirmed), None);
        assert_eq!(ended(Outcome::Failed), Some(4));
        assert_eq!(ended(Outcome::Superseded), Some(6));
        assert_eq!(ended(Outcome::Expired), Some(11));
        assert_eq!(ended(Outcome::Unknown), Some(11));
        assert_eq!(exception_for(&Report::refused(Reason::OtherOwner)), Some(6));
        let report = Report {
            exception: Some(0x21),
            ..Report::new(Outcome::Failed, Reason::DriveException)
        };
        assert_eq!(exception_for(&report), Some(0x21));
    }

    #[test]
    fn the_worst_exception_is_reported() {
        let order = [
            None,
            Some(1),
            Some(2),
            Some(3),
            Some(6),
            Some(0x21),
            Some(0x0A),
            Some(4),
            Some(0x0B),
        ];
        for (place, better) in order.iter().enumerate() {
            for bad in &order[place..] {
                assert_eq!(worst(*better, *bad), *bad);
                assert_eq!(worst(*bad, *better), *bad);
            }
        }
    }
}
