//! Why a command ended as it did: one table for all interfaces.

macro_rules! reasons {
    ($($(#[$about:meta])* $name:ident = $number:literal, $word:literal, $text:literal;)*) => {
        /// Why a command ended as it did: one table for Modbus TCP (uniform word 261) and MQTT.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u16)]
        pub enum Reason {
            $($(#[$about])* $name = $number,)*
        }

        impl Reason {
            /// All reasons, in the order of their numbers.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// The word used in results.
            #[must_use]
            pub const fn keyword(self) -> &'static str {
                match self {
                    $(Self::$name => $word,)*
                }
            }

            /// The reason in plain words.
            #[must_use]
            pub const fn text(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                }
            }
        }
    };
}

reasons! {
    /// No reason.
    None = 0, "none", "no reason";
    /// The drive has no control section.
    ReadOnly = 1, "read_only", "the drive is read-only: it has no control section";
    /// The drive's `from` does not list this interface.
    NotFromHere = 2, "not_from_here", "the drive does not accept commands from this interface";
    /// The listener does not permit this client to write or stop.
    NotAllowed = 3, "not_allowed", "this client may not do this";
    /// The payload or the value is not a known one.
    NotUnderstood = 4, "not_understood", "unknown value";
    /// A number was expected.
    NotANumber = 5, "not_a_number", "a number with a decimal point was expected, such as 42.5";
    /// Outside the configured frequencies.
    OutsideLimits = 6, "outside_limits", "the frequency is outside the limits of the drive's control section";
    /// Finer than the register's resolution.
    BetweenSteps = 7, "between_steps", "the value is finer than the drive's steps or does not fit its register";
    /// The direction is not in `directions`.
    DirectionNotAllowed = 8, "direction_not_allowed", "the drive's control section does not allow this direction";
    /// The model has no such command.
    NotCapable = 9, "not_capable", "this drive model cannot do this";
    /// The fact behind the command is not proven and not accepted.
    Unverified = 10, "unverified", "the model marks this as unproven and the control section does not accept it";
    /// The register is not in the list of writable ones.
    NotListed = 11, "not_listed", "the register is not listed under the drive's native write";
    /// A stop, trip, lost lease or start of the gateway preceded it; stop first, then run.
    StartInhibited = 12, "start_inhibited", "the start is inhibited: command stop, then run again";
    /// An earlier stop is not effective yet.
    StopPending = 13, "stop_pending", "a stop is not effective yet";
    /// Another client holds control.
    OtherOwner = 14, "other_owner", "another client holds control of the drive";
    /// Too soon after an event that inhibits the start to be sure that it was sent after that.
    RestartDelay = 15, "restart_delay", "too soon after a stop, a trip, a lost lease or an outage: send run again, or with `epoch` or `issued_at`";
    /// The epoch is not the current one.
    StaleEpoch = 16, "stale_epoch", "the epoch is not the drive's current one";
    /// RUN without `epoch` or `issued_at` where one of them is required.
    EpochNeeded = 17, "epoch_needed", "run is accepted only with `epoch` or `issued_at`";
    /// The drive's setpoint could not be read, or is not within the limits.
    SetpointUnknown = 18, "setpoint_unknown", "no setpoint within the limits is known: give a frequency first";
    /// The drive is tripped.
    Tripped = 19, "tripped", "the drive is tripped: reset it first";
    /// Nothing to reset, or the motor may still turn.
    NotTripped = 20, "not_tripped", "the drive is not tripped, or the motor is not known to be at standstill";
    /// The motor turns the other way.
    Reversal = 21, "reversal", "the motor turns the other way: stop it first";
    /// Too many commands are waiting.
    QueueFull = 22, "queue_full", "too many commands are waiting";
    /// The line's port is closed.
    LineDown = 23, "line_down", "the line is down";
    /// The drive does not answer.
    Offline = 24, "offline", "the drive does not answer";
    /// The message is a retained one, hence a replay.
    Retained = 25, "retained", "a retained message is a replay, not a command";
    /// The message is older than it may be.
    Stale = 26, "stale", "the command was issued too long ago";
    /// The id was used before for another command.
    Duplicate = 27, "duplicate", "the id was used before";
    /// Its deadline passed.
    TooLate = 28, "too_late", "the command could not be sent before its deadline";
    /// Cancelled by a stop.
    Stopped = 29, "stopped", "cancelled by a stop";
    /// Replaced by a newer command.
    Newer = 30, "newer", "replaced by a newer command";
    /// The drive answered a write with the value it kept.
    KeptOldValue = 31, "kept_old_value", "the drive kept its old value";
    /// The drive answered with an exception.
    DriveException = 32, "drive_exception", "the drive answered with an exception";
    /// The drive did not answer in time.
    NoReply = 33, "no_reply", "the drive did not answer";
    /// The value read back differs.
    NotReadBack = 34, "not_read_back", "the value read back is not the commanded one";
    /// A stop without effect.
    NotEffective = 35, "not_effective", "acknowledged, but the drive shows no effect";
    /// No such drive.
    UnknownDrive = 36, "unknown_drive", "there is no such drive";
    /// More frames than one request may need.
    TooManyFrames = 37, "too_many_frames", "it would need more than 16 frames on the line";
    /// Parts that exclude each other.
    Conflict = 38, "conflict", "the parts of the command exclude each other";
    /// The message is larger than any command.
    TooLarge = 39, "too_large", "the message is larger than any command";
    /// A cyclic order that was in force already.
    Unchanged = 40, "unchanged", "there was nothing to change";
    /// The gateway is shutting down.
    ShuttingDown = 41, "shutting_down", "the gateway is shutting down";
    /// Its client was lost before it was sent.
    CommanderLost = 42, "commander_lost", "the client was lost before the command was sent";
    /// The control section does not allow a release.
    NoRelease = 43, "no_release", "the drive's control section has no `allow_release`";
    /// The motor may be turning.
    Moving = 44, "moving", "the motor is not known to be at standstill";
    /// The word is outside the register's range.
    OutsideRange = 45, "outside_range", "the value is outside the register's range";
    /// Too many exchanges of the line or the drive fail.
    LineQuality = 46, "line_quality", "too many exchanges of the line fail: only stops and lower frequencies are accepted";
    /// Started too often.
    StartsTooOften = 47, "starts_too_often", "the minimum time between two starts has not passed";
    /// The drive does not obey the bus.
    LocalControl = 48, "local_control", "the drive obeys its panel or terminals, not the bus";
    /// The drive's own watchdog is required, but off, too long or unknown.
    Watchdog = 49, "watchdog", "it is not known whether the drive's own watchdog is on and its \
                                time short enough";
    /// A stored register was written a moment ago.
    WrittenTooOften = 50, "written_too_often", "this register is stored in memory that wears out: write it less often";
    /// The control section does not allow control to be taken over.
    NoTake = 51, "no_take", "control cannot be taken over: the holder must release it or its lease must expire";
    /// The drive is being removed from the configuration.
    Removed = 52, "removed", "the drive is being removed from the configuration";
    /// The drive has refused a stop, and none has been effective since.
    StopRefused = 53, "stop_refused", "the drive has refused a stop: it is not started until a stop has been effective";
    /// Its time of issue is in the future.
    ClockAhead = 54, "clock_ahead", "the time of issue is ahead of the gateway's clock: set the client's clock";
    /// A setting of the drive on which the order rests is not what the model requires.
    Precondition = 55, "precondition", "a setting of the drive must be changed before it can be ordered to do this: see `verify`";
    /// The drive on this station is not the configured one.
    OtherDrive = 56, "other_drive", "the drive identifies itself as another model: it is read-only";
    /// The control section does not take this over the bus.
    NotOverBus = 57, "not_over_bus", "the control section says that this does not come over the bus (`bus`)";
    /// The setpoint is a fraction of a full scale that is not known since the drive came back, or has just changed.
    FullScaleUnknown = 58, "full_scale_unknown", "the full scale of the setpoint is not known yet: it is being read from the drive";
    /// The drive answered with the exception by which it says that it is busy.
    DriveBusy = 59, "drive_busy", "the drive answered that it is busy: order it again";
    /// The drive answered with the exception by which it says that it is locked.
    DriveLocked = 60, "drive_locked", "the drive answered that it is locked against this";
    /// The drive answered with the exception by which it says that a trip holds.
    DriveInTrip = 61, "drive_in_trip", "the drive answered that it does not do this during a trip";
    /// The drive did not show in time that it has followed a word of the start.
    NotReady = 62, "not_ready", "the drive did not become ready to start: the start was withdrawn";
    /// The sign of the setpoint would order a direction, and the one in force is another or not known.
    SignUnknown = 63, "sign_unknown", "the sign of a setpoint alone could turn the motor round: order run with it";
    /// One word of a value of two words: both are written together or not at all.
    HalfAValue = 64, "half_a_value", "the register is half of a value of two words: write both words in one request of function 10 hex";
    /// The drive did not take the word after which written parameters act or are stored.
    NotCommitted = 65, "not_committed", "the parameters were written, but the drive did not accept \
                                         the word that puts them into effect or stores them";
    /// Another gateway of the line is active.
    Standby = 66, "standby", "this gateway is on standby: another one is active on the line";
    /// The drive has not shown what every drive of its model shows.
    Implausible = 67, "implausible", "the drive does not show what every drive of its model shows: the addresses may be off by one, or it is another drive";
    /// The drive was seen running and then at rest, without an order from here.
    StoppedElsewhere = 68, "stopped_elsewhere", "the drive no longer follows its order to run: it was stopped elsewhere";
    /// The output was seen far from what was ordered.
    OutputOutside = 69, "output_outside_limits", "the output is outside the limits or far from the setpoint: only stops and lower setpoints are accepted";
}

impl Reason {
    /// The number used in uniform word 261.
    #[must_use]
    pub const fn number(self) -> u16 {
        self as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_words_of_reasons_are_unique() {
        for (index, reason) in (0..).zip(Reason::ALL) {
            assert_eq!(reason.number(), index, "numbers follow each other");
        }
        let words: std::collections::BTreeSet<_> =
            Reason::ALL.iter().map(|reason| reason.keyword()).collect();
        assert_eq!(words.len(), Reason::ALL.len());
    }
}
