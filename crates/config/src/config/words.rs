//! Words that only the configuration uses: one table each, for reading and printing.

use super::ready::{PageViewers, RemovalRule};
use crate::domain::command::Direction;
use crate::domain::control::{BusFunctions, ControlAction, FailSafe, OnOutputOutside, Ownership};
use crate::domain::link::DirectionControl;
use crate::domain::standby::OnGatewayLost;
use crate::north::mqtt::{CombinedEntity, LeaseMode, TopicTree};
use crate::north::operator::rights::UserRole;
use crate::toml_file::words::word_for;

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

/// A right of a Modbus Security role besides reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoleRight {
    /// Command and write.
    Write,
    /// Stop.
    Stop,
}

/// A value that a file writes as a word.
pub(super) trait FileWord {
    /// The word that stands for it in a file.
    fn word(&self) -> &'static str;
}

impl FileWord for TopicTree {
    fn word(&self) -> &'static str {
        self.keyword()
    }
}

/// Declares enumerations whose words are explained in messages: the table of each with its words, and a function with what each
/// value means.
macro_rules! choices {
    ($(
        $(#[$about:meta])*
        $table:ident, $meaning:ident: $kind:ident, $count:literal {
            $($value:ident $word:expr => $means:literal,)+
        }
    )+) => {$(
        $(#[$about])*
        pub const $table: [(&str, $kind); $count] = [$(($word, $kind::$value)),+];

        /// What a value means, for messages.
        #[must_use]
        pub const fn $meaning(value: $kind) -> &'static str {
            match value {
                $($kind::$value => $means,)+
            }
        }

        impl FileWord for $kind {
            fn word(&self) -> &'static str {
                word_for(&$table, self)
            }
        }
    )+};
}

choices! {
    /// Interfaces that accept commands.
    WAYS, of_way: CommandInterface, 4 {
        Mqtt "mqtt" => "clients of the broker in `[mqtt]` command",
        ModbusTcp "modbus-tcp" => "clients of a `[[modbus_tcp]]` command, as far as its `write` lets them",
        Page "page" => "users of `[http]` command from the page",
        Sparkplug "sparkplug" => "hosts of Sparkplug B command",
    }

    /// Rights of roles.
    ROLE_RIGHTS, of_right: RoleRight, 2 {
        Write "write" => "starts, sets and writes",
        Stop "stop" => "stops",
    }

    /// Who sees the drives on the page.
    VIEWERS, of_viewers: PageViewers, 2 {
        Anyone "anyone" => "every client in `allow`",
        SignedIn "signed-in" => "users who have signed in",
    }

    /// Directions.
    DIRECTIONS, of_direction: Direction, 2 {
        Forward "forward" => "the motor may run forward",
        Reverse "reverse" => "the motor may run in reverse",
    }

    /// Fail-safe actions.
    FAIL_SAFES, of_fail_safe: FailSafe, 3 {
        Stop FailSafe::Stop.keyword() => "the motor is stopped by its ramp",
        Coast FailSafe::Coast.keyword() => "the output is cut off, the motor coasts",
        Hold FailSafe::Hold.keyword() => "no action: a running motor keeps running",
    }

    /// Values of `on_output_outside`.
    ON_OUTPUT_OUTSIDE, of_output_outside: OnOutputOutside, 2 {
        Alarm OnOutputOutside::Alarm.keyword() => "an alarm is raised",
        Stop OnOutputOutside::Stop.keyword() => "the motor is stopped as well",
    }

    /// Actions of a gateway that takes a line over.
    ON_GATEWAY_LOST, of_gateway_lost: OnGatewayLost, 4 {
        Stop OnGatewayLost::Stop.keyword() => "the motor is stopped by its ramp",
        Coast OnGatewayLost::Coast.keyword() => "the output is cut off, the motor coasts",
        Hold OnGatewayLost::Hold.keyword() => "no action: a running motor keeps running",
        Adopt OnGatewayLost::Adopt.keyword() =>
            "a running motor keeps running for `lost_after`, then `on_commander_lost` follows",
    }

    /// Actions of a reload that would remove a drive in use.
    REMOVALS, of_removal: RemovalRule, 2 {
        Refuse "refuse" => "the reload is refused, the motor keeps running",
        Stop "stop" => "the motor is stopped first",
    }

    /// Which functions come over the bus.
    BUS_FUNCTIONS, of_bus: BusFunctions, 3 {
        Both BusFunctions::Both.keyword() => "run commands and the setpoint",
        Frequency BusFunctions::Frequency.keyword() =>
            "the setpoint alone; start and stop are wired, and a stop over the bus may have no effect",
        Run BusFunctions::Run.keyword() => "run commands alone; the setpoint is wired",
    }

    /// Actions that may depend on an unproven fact.
    ACTIONS, of_action: ControlAction, 5 {
        Basic ControlAction::Basic.keyword() => "stopping, running forward and setting the frequency",
        Reverse ControlAction::Reverse.keyword() => "running in reverse",
        Reset ControlAction::Reset.keyword() => "resetting a trip",
        Coast ControlAction::Coast.keyword() => "cutting the output off",
        Release ControlAction::Release.keyword() => "handing control back to panel and terminals",
    }

    /// Who may command while a client holds control.
    OWNERSHIPS, of_ownership: Ownership, 2 {
        One "one" => "only the client that holds control commands",
        Any "any" => "control passes to the client that commands last",
    }

    /// What renews a lease over MQTT.
    LEASES, of_lease: LeaseMode, 2 {
        Session "session" => "control lasts as long as the path through the broker",
        Explicit "explicit" => "control lasts only as long as it is renewed",
    }
}

/// Roles of the page's users.
pub const ROLES: [(&str, UserRole); 4] = [
    (UserRole::View.keyword(), UserRole::View),
    (UserRole::Operate.keyword(), UserRole::Operate),
    (UserRole::Maintain.keyword(), UserRole::Maintain),
    (UserRole::Setup.keyword(), UserRole::Setup),
];

/// What switches the direction of an RS-485 adapter.
pub const DIRECTION_CONTROLS: [(&str, DirectionControl); 3] = [
    ("adapter", DirectionControl::Adapter),
    ("kernel", DirectionControl::Kernel),
    ("rts", DirectionControl::Rts),
];

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
