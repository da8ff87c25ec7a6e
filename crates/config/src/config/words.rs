//! Words that only the configuration uses: one table each, for reading and printing.

use super::ready::RemovalRule;
use super::ready_http::PageViewers;
use crate::domain::command::Direction;
use crate::domain::control::{BusFunctions, ControlAction, FailSafe, OnOutputOutside, Ownership};
use crate::domain::link::DirectionControl;
use crate::domain::standby::OnGatewayLost;
use crate::north::mqtt::{CombinedEntity, LeaseMode, TopicTree};
use crate::north::operator::rights::UserRole;
use crate::toml_file::values::ValueKind;

/// An interface that accepts commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandInterface {
    /// The broker of `[mqtt]`.
    Mqtt,
    /// The listeners of `[[modbus_tcp]]`.
    ModbusTcp,
    /// The page of `[http]`, for signed-in users.
    Page,
    /// Hosts of Sparkplug B, at the broker of `[mqtt]`.
    Sparkplug,
}

impl CommandInterface {
    /// Its meaning for a drive, for messages.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Mqtt => "clients of the broker in `[mqtt]` command",
            Self::ModbusTcp => {
                "clients of a `[[modbus_tcp]]` command, as far as its `write` lets them"
            }
            Self::Page => "users of `[http]` command from the page",
            Self::Sparkplug => "hosts of Sparkplug B command",
        }
    }
}

/// Interfaces that accept commands.
pub const WAYS: [(&str, CommandInterface); 4] = [
    ("mqtt", CommandInterface::Mqtt),
    ("modbus-tcp", CommandInterface::ModbusTcp),
    ("page", CommandInterface::Page),
    ("sparkplug", CommandInterface::Sparkplug),
];

/// A right of a Modbus Security role besides reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoleRight {
    /// Command and write.
    Write,
    /// Stop.
    Stop,
}

impl RoleRight {
    /// Its meaning, for messages.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Write => "starts, sets and writes",
            Self::Stop => "stops",
        }
    }
}

/// Rights of roles.
pub const ROLE_RIGHTS: [(&str, RoleRight); 2] =
    [("write", RoleRight::Write), ("stop", RoleRight::Stop)];

/// Roles of the page's users.
pub const ROLES: [(&str, UserRole); 4] = [
    (UserRole::View.keyword(), UserRole::View),
    (UserRole::Operate.keyword(), UserRole::Operate),
    (UserRole::Maintain.keyword(), UserRole::Maintain),
    (UserRole::Setup.keyword(), UserRole::Setup),
];

/// Who sees the drives on the page.
pub const VIEWERS: [(&str, PageViewers); 2] = [
    ("anyone", PageViewers::Anyone),
    ("signed-in", PageViewers::SignedIn),
];

impl PageViewers {
    /// Its meaning, for messages.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Anyone => "every client in `allow`",
            Self::SignedIn => "users who have signed in",
        }
    }
}

/// Directions.
pub const DIRECTIONS: [(&str, Direction); 2] = [
    ("forward", Direction::Forward),
    ("reverse", Direction::Reverse),
];

/// The meaning of a direction, for messages.
pub(super) const fn of_direction(direction: Direction) -> &'static str {
    match direction {
        Direction::Forward => "the motor may run forward",
        Direction::Reverse => "the motor may run in reverse",
    }
}

/// What switches the direction of an RS-485 adapter.
pub const DIRECTION_CONTROLS: [(&str, DirectionControl); 3] = [
    ("adapter", DirectionControl::Adapter),
    ("kernel", DirectionControl::Kernel),
    ("rts", DirectionControl::Rts),
];

/// Fail-safe actions.
pub const FAIL_SAFES: [(&str, FailSafe); 3] = [
    (FailSafe::Stop.keyword(), FailSafe::Stop),
    (FailSafe::Coast.keyword(), FailSafe::Coast),
    (FailSafe::Hold.keyword(), FailSafe::Hold),
];

/// Values of `on_output_outside`.
pub const ON_OUTPUT_OUTSIDE: [(&str, OnOutputOutside); 2] = [
    (OnOutputOutside::Alarm.keyword(), OnOutputOutside::Alarm),
    (OnOutputOutside::Stop.keyword(), OnOutputOutside::Stop),
];

/// The effect of each action on an output outside its limits, for messages.
#[must_use]
pub const fn of_output_outside(action: OnOutputOutside) -> &'static str {
    match action {
        OnOutputOutside::Alarm => "an alarm is raised",
        OnOutputOutside::Stop => "the motor is stopped as well",
    }
}

/// The effect of a fail-safe action, for messages.
#[must_use]
pub const fn of_fail_safe(action: FailSafe) -> &'static str {
    match action {
        FailSafe::Stop => "the motor is stopped by its ramp",
        FailSafe::Coast => "the output is cut off, the motor coasts",
        FailSafe::Hold => "no action: a running motor keeps running",
    }
}

/// Actions of a gateway that takes a line over.
const ON_GATEWAY_LOST: [(&str, OnGatewayLost); 4] = [
    (OnGatewayLost::Stop.keyword(), OnGatewayLost::Stop),
    (OnGatewayLost::Coast.keyword(), OnGatewayLost::Coast),
    (OnGatewayLost::Hold.keyword(), OnGatewayLost::Hold),
    (OnGatewayLost::Adopt.keyword(), OnGatewayLost::Adopt),
];

/// One of the actions of a gateway that takes a line over.
pub(super) fn on_gateway_lost() -> ValueKind<'static, OnGatewayLost> {
    ValueKind::choice(&ON_GATEWAY_LOST, |action| match action {
        OnGatewayLost::Stop => "the motor is stopped by its ramp",
        OnGatewayLost::Coast => "the output is cut off, the motor coasts",
        OnGatewayLost::Hold => "no action: a running motor keeps running",
        OnGatewayLost::Adopt => {
            "a running motor keeps running for `lost_after`, then `on_commander_lost` follows"
        }
    })
}

/// The effect on a drive that a reload would remove, for messages.
pub(super) const fn of_removal(removal: RemovalRule) -> &'static str {
    match removal {
        RemovalRule::Refuse => "the reload is refused, the motor keeps running",
        RemovalRule::Stop => "the motor is stopped first",
    }
}

/// Actions of a reload that would remove a drive in use.
pub const REMOVALS: [(&str, RemovalRule); 2] =
    [("refuse", RemovalRule::Refuse), ("stop", RemovalRule::Stop)];

/// Which functions come over the bus.
pub const BUS_FUNCTIONS: [(&str, BusFunctions); 3] = [
    (BusFunctions::Both.keyword(), BusFunctions::Both),
    (BusFunctions::Frequency.keyword(), BusFunctions::Frequency),
    (BusFunctions::Run.keyword(), BusFunctions::Run),
];

/// What comes over the bus.
pub(super) const fn of_bus(bus: BusFunctions) -> &'static str {
    match bus {
        BusFunctions::Both => "run commands and the setpoint",
        BusFunctions::Frequency => {
            "the setpoint alone; start and stop are wired, and a stop over the bus may have no effect"
        }
        BusFunctions::Run => "run commands alone; the setpoint is wired",
    }
}

/// Actions that may depend on an unproven fact.
pub const ACTIONS: [(&str, ControlAction); 5] = [
    (ControlAction::Basic.keyword(), ControlAction::Basic),
    (ControlAction::Reverse.keyword(), ControlAction::Reverse),
    (ControlAction::Reset.keyword(), ControlAction::Reset),
    (ControlAction::Coast.keyword(), ControlAction::Coast),
    (ControlAction::Release.keyword(), ControlAction::Release),
];

/// The meaning of an unproven action, for messages.
pub(super) const fn of_action(action: ControlAction) -> &'static str {
    match action {
        ControlAction::Basic => "stopping, running forward and setting the frequency",
        ControlAction::Reverse => "running in reverse",
        ControlAction::Reset => "resetting a trip",
        ControlAction::Coast => "cutting the output off",
        ControlAction::Release => "handing control back to panel and terminals",
    }
}

/// What a drive is announced to Home Assistant as besides its buttons.
pub const COMBINED: [(&str, CombinedEntity); 2] = [
    ("switch", CombinedEntity::Switch),
    ("fan", CombinedEntity::Fan),
];

/// Optional topics over MQTT.
pub const TREES: [(&str, TopicTree); 5] = [
    (TopicTree::State.keyword(), TopicTree::State),
    (TopicTree::Values.keyword(), TopicTree::Values),
    (TopicTree::Param.keyword(), TopicTree::Param),
    (TopicTree::Line.keyword(), TopicTree::Line),
    (TopicTree::Info.keyword(), TopicTree::Info),
];

/// Whether RUN over MQTT must state which stop it follows.
pub(super) const COMMANDS: [(&str, bool); 2] = [("plain", false), ("strict", true)];

/// The requirement for RUN over MQTT, for messages.
pub(super) const fn of_commands(is_strict: bool) -> &'static str {
    if is_strict {
        "RUN over MQTT only with `epoch` or `issued_at`"
    } else {
        "RUN over MQTT needs neither"
    }
}

/// The meaning of a kind of ownership, for messages.
pub(super) const fn of_ownership(ownership: Ownership) -> &'static str {
    match ownership {
        Ownership::One => "only the client that holds control commands",
        Ownership::Any => "control passes to the client that commands last",
    }
}

/// The meaning of a kind of lease, for messages.
pub(super) const fn of_lease(lease: LeaseMode) -> &'static str {
    match lease {
        LeaseMode::Session => "control lasts as long as the path through the broker",
        LeaseMode::Explicit => "control lasts only as long as it is renewed",
    }
}

/// Who may command while a client holds control.
pub const OWNERSHIPS: [(&str, Ownership); 2] = [("one", Ownership::One), ("any", Ownership::Any)];

/// What renews a lease over MQTT.
pub const LEASES: [(&str, LeaseMode); 2] = [
    ("session", LeaseMode::Session),
    ("explicit", LeaseMode::Explicit),
];
