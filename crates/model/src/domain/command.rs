//! Commands: who orders what of a drive, until when, and the outcome. One vocabulary for all interfaces.

use super::address::Address;
use super::control::ControlAction;
use super::frequency::Hertz;
use super::ids::{AskerId, CommanderName, DriveIndex, Ticket};
use super::native::FRAMES_MAX;
pub use super::reason::Reason;
use super::time::MonoTime;
use std::fmt;
use std::net::IpAddr;

/// A direction in which a motor turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// The direction that the drive calls forward.
    Forward,
    /// The opposite direction.
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
        /// A setpoint from the same write. It is accepted only if this stop changes nothing, because no setpoint
        /// follows a stop that is not yet effective.
        setpoint: Option<Hertz>,
    },
    /// Cut the output off, so that the motor coasts.
    Coast,
    /// Reset a trip. It never carries a run order.
    Reset,
    /// Registers, then the setpoint, then run.
    Go(GoOrder),
    /// Hand control back to the panel or terminals. A closed terminal may then start the motor.
    Release,
    /// Set what the drive needs before it obeys the bus: the registers at these addresses, each to the word that its
    /// model requires.
    Setup(Vec<Address>),
    /// Take control over from its holder. It moves nothing.
    Take,
    /// Only renew the lease. It is not an attempt to write.
    Renew,
    /// Withdraw the order to reset, so that the next one counts as new. It is not an attempt to write.
    EndReset,
}

impl Order {
    /// Whether the order writes nothing to the drive.
    #[must_use]
    pub const fn is_no_attempt(&self) -> bool {
        matches!(self, Self::Renew | Self::EndReset)
    }

    /// Whether the order removes energy from the motor. Such an order is exempt from what delays others.
    #[must_use]
    pub const fn is_stop(&self) -> bool {
        matches!(self, Self::Stop { .. } | Self::Coast)
    }
}

/// An order that sets something: it has at least one part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GoOrder {
    registers: Vec<RegisterWrite>,
    frequency: Option<Hertz>,
    run: Option<Direction>,
    toward: Option<Direction>,
}

impl GoOrder {
    /// Maximum number of registers in one order. Each part may need a frame of its own, so a setpoint and RUN leave
    /// room for fewer.
    pub const REGISTERS_MAX: usize = FRAMES_MAX;

    /// An order of these parts. `None` if there are none, or more than fit into [`FRAMES_MAX`] frames.
    #[must_use]
    pub fn new(
        registers: Vec<RegisterWrite>,
        frequency: Option<Hertz>,
        run: Option<Direction>,
    ) -> Option<Self> {
        let parts = registers.len() + usize::from(frequency.is_some()) + usize::from(run.is_some());
        (1..=FRAMES_MAX).contains(&parts).then_some(Self {
            registers,
            frequency,
            run,
            toward: None,
        })
    }

    /// The order with a setpoint for direction `toward`, for a drive that turns by the sign of its setpoint.
    #[must_use]
    pub fn with_sign(self, toward: Option<Direction>) -> Self {
        Self { toward, ..self }
    }

    /// The direction for which the setpoint is meant, if its sign orders one.
    #[must_use]
    pub const fn toward(&self) -> Option<Direction> {
        self.toward
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
    pub address: Address,
    /// The word.
    pub value: u16,
    /// The word for the next address, of a value of two words: both go out in one frame.
    pub second: Option<u16>,
}

impl RegisterWrite {
    /// One word.
    #[must_use]
    pub fn new(address: impl Into<Address>, value: u16) -> Self {
        Self {
            address: address.into(),
            value,
            second: None,
        }
    }

    /// Its words with their addresses.
    pub fn words(self) -> impl Iterator<Item = (Address, u16)> {
        let second = self
            .second
            .and_then(|word| Some((self.address.checked_add(1)?, word)));
        [(self.address, self.value)].into_iter().chain(second)
    }

    /// Both words of a value, in the order of their addresses.
    #[must_use]
    pub fn pair(address: impl Into<Address>, [value, second]: [u16; 2]) -> Self {
        Self {
            address: address.into(),
            value,
            second: Some(second),
        }
    }
}

/// Who holds control of a drive: an identity, not a socket.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Owner {
    /// A Modbus TCP client by its address. All its connections are the same owner.
    ModbusTcp(IpAddr),
    /// A Modbus TCP client by the subject of its certificate, wherever it connects from.
    ModbusSecurity(CommanderName),
    /// The serial master at the port of this `[[modbus_rtu]]`.
    ModbusRtu(CommanderName),
    /// Any client that may publish to the command topics.
    Mqtt,
    /// Any client that may publish to the command topics of this name.
    MqttBy(CommanderName),
    /// The user signed in by this name on the gateway's page, on any number of screens.
    Page(CommanderName),
    /// Any client that may publish Sparkplug B commands for this edge node.
    Sparkplug,
    /// Any process that may open the gateway's own socket on its host.
    Local,
}

impl Owner {
    /// Whether this owner's commands arrive through `way`, so that a heartbeat of `way` counts for the owner: all MQTT
    /// clients share the path through the broker, which is [`Owner::Mqtt`].
    #[must_use]
    pub fn comes_by(self, way: Self) -> bool {
        self == way || matches!((self, way), (Self::MqttBy(_), Self::Mqtt))
    }
}

impl fmt::Display for Owner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ModbusTcp(address) => write!(f, "modbus-tcp {address}"),
            Self::ModbusSecurity(name) => write!(f, "modbus-security {name}"),
            Self::ModbusRtu(name) => write!(f, "modbus-rtu {name}"),
            Self::Mqtt => f.write_str("mqtt"),
            Self::MqttBy(name) => write!(f, "mqtt {name}"),
            Self::Page(name) => write!(f, "page {name}"),
            Self::Sparkplug => f.write_str("sparkplug"),
            Self::Local => f.write_str("local"),
        }
    }
}

/// What the listener or the broker connection permits a client to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rights {
    /// The client may command.
    pub write: bool,
    /// The client may stop.
    pub stop: bool,
}

impl Rights {
    /// Read only.
    pub const NONE: Self = Self {
        write: false,
        stop: false,
    };
}

/// How a client repeats its orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OrderManner {
    /// Registers and coils that controllers write cyclically: an order acts when it changes something.
    Cyclic,
    /// Messages: each is sent to the drive once, even if it changes nothing.
    Once,
}

/// Who sent a command, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Origin {
    /// The client's identity.
    pub owner: Owner,
    /// What the client may do.
    pub rights: Rights,
    /// How its orders repeat.
    pub manner: OrderManner,
}

/// One command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandRequest {
    /// Where to send the answer.
    pub asker: AskerId,
    /// The asker's number for this command.
    pub ticket: Ticket,
    /// Which drive of the line.
    pub drive: DriveIndex,
    /// Who sent the command.
    pub origin: Origin,
    /// What is ordered.
    pub order: Order,
    /// The first frame is sent before this moment or never. A stop has no deadline.
    pub start_before: MonoTime,
    /// When the command was issued, if the client states it in a way that can be compared with our clock.
    pub issued: Option<MonoTime>,
    /// The drive's epoch as the client last saw it, if stated.
    pub epoch: Option<u64>,
    /// An unproven action that this one command may use, if it comes from the local socket and the drive is being
    /// qualified.
    pub trial: Option<ControlAction>,
}

/// The outcome of a command, provisional or final.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandAnswer {
    /// Who asked.
    pub asker: AskerId,
    /// The asker's number for the command.
    pub ticket: Ticket,
    /// Which drive of the line.
    pub drive: DriveIndex,
    /// The outcome and its details.
    pub report: Report,
    /// Whether no further answer follows. An acknowledged command may still be confirmed.
    pub is_final: bool,
}

/// An outcome with its details.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// The outcome of the command.
    pub outcome: Outcome,
    /// Why.
    pub reason: Reason,
    /// The word that the drive holds instead of the commanded one, if it reported that.
    pub held: Option<u16>,
    /// The register that holds `held`, if it is not the one that was written; or the one on which the order rests, if the
    /// drive refused to show it.
    pub register: Option<Address>,
    /// The drive's own exception code.
    pub exception: Option<u8>,
    /// Who holds control, if the command was refused for that.
    pub holder: Option<Owner>,
}

impl Report {
    /// An outcome with its reason and no further details.
    #[must_use]
    pub const fn new(outcome: Outcome, reason: Reason) -> Self {
        Self {
            outcome,
            reason,
            held: None,
            register: None,
            exception: None,
            holder: None,
        }
    }

    /// The reason in plain words. A refusal because another client holds control names the holder.
    #[must_use]
    pub fn message(&self) -> String {
        match self.holder {
            Some(holder) => format!("{holder} holds control of the drive"),
            // A stop is never refused for that.
            None if (self.outcome, self.reason) == (Outcome::Unknown, Reason::LineDown) => {
                "the line is down: the stop is pending and is sent as soon as the line is back"
                    .to_owned()
            }
            None => match (self.register, self.held) {
                (Some(register), Some(held)) => {
                    format!("{}: register {register} holds {held}", self.reason.text())
                }
                (Some(register), None) => {
                    format!(
                        "{}: the order rests on register {register}, which the drive did not show",
                        self.reason.text()
                    )
                }
                _ => self.reason.text().to_owned(),
            },
        }
    }

    /// A refusal because `holder` holds control.
    #[must_use]
    pub const fn held_by(holder: Owner) -> Self {
        let refused = Self::refused(Reason::OtherOwner);
        Self {
            holder: Some(holder),
            ..refused
        }
    }

    /// A refusal.
    #[must_use]
    pub const fn refused(reason: Reason) -> Self {
        Self::new(Outcome::Refused, reason)
    }
}

/// The outcome of a command. Uniform word 259 holds its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum Outcome {
    /// Never sent.
    Refused = 1,
    /// Its deadline passed before its first frame.
    Expired = 2,
    /// Replaced by a newer command before it was sent.
    Superseded = 3,
    /// The drive refused it.
    Failed = 4,
    /// Sent but not answered: the drive is read to find out what it does.
    Unknown = 5,
    /// The drive answered.
    Acknowledged = 6,
    /// Read back from the drive.
    Confirmed = 7,
}

impl Outcome {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 7] = [
        Self::Refused,
        Self::Expired,
        Self::Superseded,
        Self::Failed,
        Self::Unknown,
        Self::Acknowledged,
        Self::Confirmed,
    ];

    /// The word used in results.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
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

    /// The number used in uniform word 259; 0 there means that there was no command yet.
    #[must_use]
    pub const fn number(self) -> u16 {
        self as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_names_the_holder_of_control() {
        assert_eq!(
            Report::held_by(Owner::Mqtt).message(),
            "mqtt holds control of the drive"
        );
        assert_eq!(
            Report::refused(Reason::OtherOwner).message(),
            "another client holds control of the drive"
        );
        assert_eq!(
            Report::refused(Reason::Moving).message(),
            Reason::Moving.text()
        );
    }

    #[test]
    fn an_order_that_sets_nothing_cannot_be_built() {
        assert_eq!(GoOrder::new(Vec::new(), None, None), None);
    }

    #[test]
    fn every_mqtt_client_arrives_through_the_broker() {
        let by = |name| Owner::MqttBy(CommanderName::new(name).unwrap());
        for owner in [Owner::Mqtt, by("a"), by("b")] {
            assert!(owner.comes_by(Owner::Mqtt), "{owner}");
        }
        let certified = Owner::ModbusSecurity(CommanderName::new("a").unwrap());
        let signed_in = Owner::Page(CommanderName::new("a").unwrap());
        for owner in [
            Owner::Local,
            Owner::Sparkplug,
            Owner::ModbusTcp(IpAddr::from([10, 0, 0, 1])),
            certified,
            signed_in,
        ] {
            assert!(
                owner.comes_by(owner) && !owner.comes_by(Owner::Mqtt),
                "{owner}"
            );
        }
        assert!(!by("a").comes_by(by("b")) && !Owner::Mqtt.comes_by(by("a")));
    }

    #[test]
    fn an_order_never_needs_more_than_its_frames() {
        let registers = |count| vec![RegisterWrite::new(1_u16, 1); count];
        let setpoint = Some(Hertz::ZERO);
        let run = Some(Direction::Forward);
        assert!(GoOrder::new(registers(GoOrder::REGISTERS_MAX), None, None).is_some());
        assert!(GoOrder::new(registers(GoOrder::REGISTERS_MAX - 2), setpoint, run).is_some());
        assert_eq!(
            GoOrder::new(registers(GoOrder::REGISTERS_MAX + 1), None, None),
            None
        );
        assert_eq!(
            GoOrder::new(registers(GoOrder::REGISTERS_MAX), None, run),
            None
        );
        assert_eq!(
            GoOrder::new(registers(GoOrder::REGISTERS_MAX - 1), setpoint, run),
            None
        );
    }
}
