//! The words of the configuration that no model file has: one table each, for reading and for showing.

use super::ready::Removal;
use crate::domain::command::Direction;
use crate::domain::control::{ControlAction, FailSafe, Ownership};
use crate::domain::link::DirectionControl;
use crate::north::mqtt::{LeaseMode, Tree};

/// A way by which commands come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// The broker of `[mqtt]`.
    Mqtt,
    /// The listeners of `[[modbus_tcp]]`.
    ModbusTcp,
    /// The page of `[http]`, by those who are signed in there.
    Page,
    /// Hosts of Sparkplug B, at the broker of `[mqtt]`.
    Sparkplug,
}

/// Ways by which commands come.
pub const WAYS: [(&str, Way); 4] =
    [("mqtt", Way::Mqtt), ("modbus-tcp", Way::ModbusTcp), ("page", Way::Page), ("sparkplug", Way::Sparkplug)];

/// What a role of Modbus Security may do besides reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoleRight {
    /// Command and write.
    Write,
    /// Stop.
    Stop,
}

/// Rights of roles.
pub const ROLE_RIGHTS: [(&str, RoleRight); 2] = [("write", RoleRight::Write), ("stop", RoleRight::Stop)];

/// Directions.
pub const DIRECTIONS: [(&str, Direction); 2] = [("forward", Direction::Forward), ("reverse", Direction::Reverse)];

/// Who turns the direction of an RS-485 adapter.
pub const DIRECTION_CONTROLS: [(&str, DirectionControl); 3] =
    [("adapter", DirectionControl::Adapter), ("kernel", DirectionControl::Kernel), ("rts", DirectionControl::Rts)];

/// What is done when nobody commands any more.
pub const FAIL_SAFES: [(&str, FailSafe); 3] = [
    (FailSafe::Stop.word(), FailSafe::Stop),
    (FailSafe::Coast.word(), FailSafe::Coast),
    (FailSafe::Hold.word(), FailSafe::Hold),
];

/// What a reload does about a drive in use that it would take away.
pub const REMOVALS: [(&str, Removal); 2] = [("refuse", Removal::Refuse), ("stop", Removal::Stop)];

/// Actions that may rest on an unproven fact.
pub const ACTIONS: [(&str, ControlAction); 4] = [
    (ControlAction::Reverse.word(), ControlAction::Reverse),
    (ControlAction::Reset.word(), ControlAction::Reset),
    (ControlAction::Coast.word(), ControlAction::Coast),
    (ControlAction::Release.word(), ControlAction::Release),
];

/// Parts of what is published over MQTT.
pub const TREES: [(&str, Tree); 5] = [
    (Tree::State.word(), Tree::State),
    (Tree::Values.word(), Tree::Values),
    (Tree::Param.word(), Tree::Param),
    (Tree::Line.word(), Tree::Line),
    (Tree::Info.word(), Tree::Info),
];

/// Whether RUN over MQTT must say which stop it follows.
pub(super) const COMMANDS: [(&str, bool); 2] = [("plain", false), ("strict", true)];

/// Who may command while somebody holds control.
pub const OWNERSHIPS: [(&str, Ownership); 2] = [("one", Ownership::One), ("any", Ownership::Any)];

/// What keeps a lease of the MQTT side alive.
pub const LEASES: [(&str, LeaseMode); 2] = [("session", LeaseMode::Session), ("explicit", LeaseMode::Explicit)];
