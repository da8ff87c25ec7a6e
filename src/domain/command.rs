//! Commands: who orders what of a drive, until when, and what became of it. One vocabulary for all ways in.

use super::frequency::Hertz;
use super::ids::{AskerId, CommanderName, DriveIndex, Ticket};
use super::native::FRAMES_MAX;
use super::time::MonoTime;
use std::fmt;
use std::net::IpAddr;

/// A direction in which a motor turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// The direction that the drive calls forward.
    Forward,
    /// The other one.
    Reverse,
}

/// What was last ordered and is still in force: uniform word 256.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum RunIntent {
    /// Stopped, or nothing ordered.
    #[default]
    Stop,
    /// Run in this direction.
    Run(Direction),
    /// The output is cut off.
    Coast,
}

/// What is ordered of a drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Order {
    /// Decelerate and stop.
    Stop {
        /// A setpoint that came in the same write. It is taken only if this stop changes nothing any more, because
        /// no setpoint follows a stop that is not effective.
        setpoint: Option<Hertz>,
    },
    /// Cut the output off, so that the motor coasts.
    Coast,
    /// Reset a trip. It never carries a run order.
    Reset,
    /// Registers, then the setpoint, then run.
    Go(Go),
    /// Hand control back to panel or terminals. A closed terminal may then start the motor.
    Release,
    /// Set what the drive needs before it obeys the bus: the registers at these addresses, each to the word that its
    /// model demands.
    Setup(Vec<u16>),
    /// Take control over from the one who holds it. It moves nothing.
    Take,
    /// Only renew the lease. It is no attempt to write.
    Renew,
}

/// An order that sets something: at least one part is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Go {
    registers: Vec<RegisterWrite>,
    frequency: Option<Hertz>,
    run: Option<Direction>,
}

impl Go {
    /// Most registers in one order. Each part may be a frame of its own, so that a setpoint and RUN leave room for
    /// fewer.
    pub const REGISTERS_MAX: usize = FRAMES_MAX;

    /// The order of these parts; nothing if there is none, or more than fit into [`FRAMES_MAX`] frames.
    #[must_use]
    pub fn new(registers: Vec<RegisterWrite>, frequency: Option<Hertz>, run: Option<Direction>) -> Option<Self> {
        let parts = registers.len() + usize::from(frequency.is_some()) + usize::from(run.is_some());
        (1..=FRAMES_MAX).contains(&parts).then_some(Self { registers, frequency, run })
    }

    /// Registers without a role of their own, in the order in which they are written.
    #[must_use]
    pub fn registers(&self) -> &[RegisterWrite] {
        &self.registers
    }

    /// The setpoint.
    #[must_use]
    pub const fn frequency(&self) -> Option<Hertz> {
        self.frequency
    }

    /// The direction in which to run.
    #[must_use]
    pub const fn run(&self) -> Option<Direction> {
        self.run
    }
}

/// One register by its address on the wire, and the word for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RegisterWrite {
    /// Address on the wire.
    pub address: u16,
    /// The word.
    pub value: u16,
}

/// Who holds control of a drive: an identity, not a socket.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Owner {
    /// A Modbus TCP client by its address. All its connections are the same owner.
    ModbusTcp(IpAddr),
    /// Whoever may publish to the command topics.
    Mqtt,
    /// Whoever may publish to the command topics of this commander.
    MqttBy(CommanderName),
    /// Whoever may open the gateway's own socket on its host.
    Local,
}

impl fmt::Display for Owner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ModbusTcp(address) => write!(f, "modbus-tcp {address}"),
            Self::Mqtt => f.write_str("mqtt"),
            Self::MqttBy(name) => write!(f, "mqtt {name}"),
            Self::Local => f.write_str("local"),
        }
    }
}

/// What the listener or the broker connection grants to a commander.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rights {
    /// It may command.
    pub write: bool,
    /// It may stop.
    pub stop: bool,
}

/// How orders repeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Manner {
    /// Registers and coils that controllers write again and again: an order acts when it changes something.
    Cyclic,
    /// Messages: each is sent once, also when it changes nothing.
    Once,
}

/// Who commands, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Origin {
    /// The identity.
    pub owner: Owner,
    /// What it may do.
    pub rights: Rights,
    /// How its orders repeat.
    pub manner: Manner,
}

/// One command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandRequest {
    /// Where the answer goes.
    pub asker: AskerId,
    /// The asker's number for this command.
    pub ticket: Ticket,
    /// Which drive of the line.
    pub drive: DriveIndex,
    /// Who commands.
    pub origin: Origin,
    /// What is ordered.
    pub order: Order,
    /// Its first frame leaves before this moment or never. A stop has no deadline.
    pub start_before: MonoTime,
    /// When it was issued, if the commander says so in a way that can be compared with our clock.
    pub issued: Option<MonoTime>,
    /// The drive's epoch that the commander had seen, if it says so.
    pub epoch: Option<u64>,
}

/// What became of a command, so far or for good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandAnswer {
    /// Who commanded.
    pub asker: AskerId,
    /// The asker's number for the command.
    pub ticket: Ticket,
    /// Which drive of the line.
    pub drive: DriveIndex,
    /// What became of it.
    pub report: Report,
    /// Whether nothing follows. An acknowledged command may still be confirmed.
    pub is_final: bool,
}

/// An outcome with what there is to say about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// What became of the command.
    pub outcome: Outcome,
    /// Why.
    pub reason: Reason,
    /// The word that the drive holds instead of the commanded one, where it said so.
    pub held: Option<u16>,
    /// The drive's own exception code.
    pub exception: Option<u8>,
}

impl Report {
    /// An outcome with its reason and nothing else to say.
    #[must_use]
    pub const fn new(outcome: Outcome, reason: Reason) -> Self {
        Self { outcome, reason, held: None, exception: None }
    }

    /// A refusal.
    #[must_use]
    pub const fn refused(reason: Reason) -> Self {
        Self::new(Outcome::Refused, reason)
    }
}

/// What became of a command. The number stands in uniform word 259.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum Outcome {
    /// Never sent.
    Refused = 1,
    /// Its deadline passed before its first frame.
    Expired = 2,
    /// A newer command took its place before it was sent.
    Superseded = 3,
    /// The drive said no.
    Failed = 4,
    /// Sent and not answered: what the drive does is being found out.
    Unknown = 5,
    /// The drive answered.
    Acknowledged = 6,
    /// Read back from the drive.
    Confirmed = 7,
}

impl Outcome {
    /// The word as it stands in results.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Refused => "refused",
            Self::Expired => "expired",
            Self::Superseded => "superseded",
            Self::Failed => "failed",
            Self::Unknown => "unknown",
            Self::Acknowledged => "acknowledged",
            Self::Confirmed => "confirmed",
        }
    }

    /// The number as it stands in uniform word 259; 0 there means that there was no command yet.
    #[must_use]
    pub const fn number(self) -> u16 {
        self as u16
    }
}

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

            /// The word as it stands in results.
            #[must_use]
            pub const fn word(self) -> &'static str {
                match self {
                    $(Self::$name => $word,)*
                }
            }

            /// The reason in words for people.
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
    /// Nothing to say.
    None = 0, "none", "nothing to say";
    /// The drive has no control section.
    ReadOnly = 1, "read_only", "the drive is read-only: it has no control section";
    /// The drive's `from` does not name this way in.
    NotFromHere = 2, "not_from_here", "the drive does not take commands from this side";
    /// The listener does not let this client write or stop.
    NotAllowed = 3, "not_allowed", "this client may not do this";
    /// The payload or the value is none of those that are known.
    NotUnderstood = 4, "not_understood", "the value is not one that is known here";
    /// A number was expected.
    NotANumber = 5, "not_a_number", "a number with a decimal point was expected, such as 42.5";
    /// Outside the configured frequencies.
    OutsideLimits = 6, "outside_limits", "the frequency is outside the limits of the drive's control section";
    /// Finer than the register's steps.
    BetweenSteps = 7, "between_steps", "the value is finer than the drive's steps or does not fit its register";
    /// The direction is not in `directions`.
    DirectionNotAllowed = 8, "direction_not_allowed", "the drive's control section does not allow this direction";
    /// The model has no such command.
    NotCapable = 9, "not_capable", "this drive model cannot do this";
    /// The fact behind the command is not proven and not accepted.
    Unverified = 10, "unverified", "the model marks this as unproven and the control section does not accept it";
    /// The register is not in the list of writable ones.
    NotListed = 11, "not_listed", "the register is not listed under the drive's native write";
    /// A stop, trip, lost lease or start came before; stop first, then run.
    StartInhibited = 12, "start_inhibited", "the start is inhibited: command stop, then run again";
    /// An earlier stop is not effective yet.
    StopPending = 13, "stop_pending", "a stop is not effective yet";
    /// Somebody else holds control.
    OtherOwner = 14, "other_owner", "somebody else holds control of the drive";
    /// Too soon after a stop to know that it was sent after it.
    RestartDelay = 15, "restart_delay", "too soon after a stop: send run again, or with `epoch` or `issued_at`";
    /// The epoch is not the present one.
    StaleEpoch = 16, "stale_epoch", "the epoch is not the drive's present one";
    /// RUN without `epoch` or `issued_at` where they are demanded.
    EpochNeeded = 17, "epoch_needed", "run is accepted only with `epoch` or `issued_at`";
    /// The drive's setpoint could not be read, or is not within the limits.
    SetpointUnknown = 18, "setpoint_unknown", "no setpoint within the limits is known: give a frequency first";
    /// The drive is tripped.
    Tripped = 19, "tripped", "the drive is tripped: reset it first";
    /// Nothing to reset, or the motor may still turn.
    NotTripped = 20, "not_tripped", "the drive is not tripped, or not known to stand still";
    /// The motor turns the other way.
    Reversal = 21, "reversal", "the motor turns the other way: stop it first";
    /// Too many commands wait.
    QueueFull = 22, "queue_full", "too many commands are waiting";
    /// The line's port is closed.
    LineDown = 23, "line_down", "the line is down";
    /// The drive does not answer.
    Offline = 24, "offline", "the drive does not answer";
    /// A retained message is a replay.
    Retained = 25, "retained", "a retained message is a replay, not a command";
    /// The message is older than it may be.
    Stale = 26, "stale", "the command was issued too long ago";
    /// The id was used before for another command.
    Duplicate = 27, "duplicate", "the id was used before";
    /// Its deadline passed.
    TooLate = 28, "too_late", "it could not be sent before its deadline";
    /// A stop cut it.
    Stopped = 29, "stopped", "a stop came after it";
    /// A newer one replaced it.
    Newer = 30, "newer", "a newer command took its place";
    /// The drive answered a write with the value it kept.
    KeptOldValue = 31, "kept_old_value", "the drive kept its old value";
    /// The drive answered with an exception.
    DriveException = 32, "drive_exception", "the drive answered with an exception";
    /// The drive did not answer in time.
    NoReply = 33, "no_reply", "the drive did not answer";
    /// The value read back is another one.
    NotReadBack = 34, "not_read_back", "the value read back is not the commanded one";
    /// A stop without effect.
    NotEffective = 35, "not_effective", "the drive acknowledged and shows no effect";
    /// No such drive.
    UnknownDrive = 36, "unknown_drive", "there is no such drive";
    /// More frames than one request may need.
    TooManyFrames = 37, "too_many_frames", "it would need more than 16 frames on the line";
    /// Parts that exclude each other.
    Conflict = 38, "conflict", "the parts of the command exclude each other";
    /// The message is larger than any command.
    TooLarge = 39, "too_large", "the message is larger than any command";
    /// A cyclic order that was in force already.
    Unchanged = 40, "unchanged", "nothing was to be changed";
    /// The gateway ends.
    ShuttingDown = 41, "shutting_down", "the gateway is ending";
    /// Whoever gave it was lost before it was sent.
    CommanderLost = 42, "commander_lost", "its commander was lost before it was sent";
    /// The control section does not allow a release.
    NoRelease = 43, "no_release", "the drive's control section does not allow a release";
    /// The motor may turn.
    Moving = 44, "moving", "the motor is not known to stand still";
    /// The word is outside what the register takes.
    OutsideRange = 45, "outside_range", "the value is outside what the register takes";
    /// Too many exchanges of the line or the drive fail.
    LineQuality = 46, "line_quality", "too many exchanges of the line fail: only stops and lower frequencies are taken";
    /// Started too often.
    StartsTooOften = 47, "starts_too_often", "the time between two starts is not over yet";
    /// The drive obeys somebody else.
    LocalControl = 48, "local_control", "the drive obeys its panel or terminals, not the bus";
    /// The drive's own watchdog is off, too long or unknown, and it is demanded.
    Watchdog = 49, "watchdog", "the drive's own watchdog is not known to be on and short enough";
    /// A stored register was written a moment ago.
    WrittenTooOften = 50, "written_too_often", "this register is kept in a memory that wears out: write it less often";
    /// The control section does not allow to take control over.
    NoTake = 51, "no_take", "control cannot be taken over: its holder has to release it, or its lease to end";
    /// The drive leaves the configuration.
    Removed = 52, "removed", "the drive is leaving the configuration";
}

impl Reason {
    /// The number as it stands in uniform word 261.
    #[must_use]
    pub const fn number(self) -> u16 {
        self as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_that_sets_nothing_cannot_be_built() {
        assert_eq!(Go::new(Vec::new(), None, None), None);
    }

    #[test]
    fn an_order_never_needs_more_than_its_frames() {
        let registers = |count| vec![RegisterWrite { address: 1, value: 1 }; count];
        let (setpoint, run) = (Some(Hertz::ZERO), Some(Direction::Forward));
        assert!(Go::new(registers(Go::REGISTERS_MAX), None, None).is_some());
        assert!(Go::new(registers(Go::REGISTERS_MAX - 2), setpoint, run).is_some());
        assert_eq!(Go::new(registers(Go::REGISTERS_MAX + 1), None, None), None);
        assert_eq!(Go::new(registers(Go::REGISTERS_MAX), None, run), None);
        assert_eq!(Go::new(registers(Go::REGISTERS_MAX - 1), setpoint, run), None);
    }

    #[test]
    fn reasons_are_told_apart_by_number_and_word() {
        for (index, reason) in (0..).zip(Reason::ALL) {
            assert_eq!(reason.number(), index, "numbers follow each other");
        }
        let words: std::collections::BTreeSet<_> = Reason::ALL.iter().map(|reason| reason.word()).collect();
        assert_eq!(words.len(), Reason::ALL.len());
    }
}
