//! What a drive's control section allows: final values, checked against the model when the configuration is read.

use super::address::Address;
use super::command::Direction;
use super::frequency::Hertz;
use super::standby::OnGatewayLost;
use std::time::Duration;

/// What happens to a drive when its client is lost, or when the gateway is stopped on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FailSafe {
    /// The drive stops along its deceleration ramp.
    Stop,
    /// The drive's output is cut off.
    Coast,
    /// The drive is left as it is.
    Hold,
}

impl FailSafe {
    /// The word used in the configuration.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Coast => "coast",
            Self::Hold => "hold",
        }
    }
}

/// What happens when the output is outside the limits or far from the setpoint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum OnOutputOutside {
    /// The output is reported, and nothing makes the motor faster.
    #[default]
    Alarm,
    /// The output is reported, and the motor is stopped.
    Stop,
}

impl OnOutputOutside {
    /// The word used in the configuration.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Alarm => "alarm",
            Self::Stop => "stop",
        }
    }
}

/// Which functions of a drive come over the bus; the others are wired, to its terminals or its panel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BusFunctions {
    /// Run commands and the setpoint.
    #[default]
    Both,
    /// The setpoint alone: the drive is started and stopped elsewhere.
    Frequency,
    /// Run commands alone: the setpoint comes from elsewhere.
    Run,
}

impl BusFunctions {
    /// The word used in the configuration.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Both => "both",
            Self::Frequency => "frequency",
            Self::Run => "run",
        }
    }

    /// Whether run commands come over the bus.
    #[must_use]
    pub const fn has_run(self) -> bool {
        matches!(self, Self::Both | Self::Run)
    }

    /// Whether the setpoint comes over the bus.
    #[must_use]
    pub const fn has_frequency(self) -> bool {
        matches!(self, Self::Both | Self::Frequency)
    }
}

/// A control action that may rest on an unproven fact of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ControlAction {
    /// Stop, forward and the setpoint together: without them a drive accepts no orders at all.
    Basic,
    /// Running in reverse.
    Reverse,
    /// Cutting the output off.
    Coast,
    /// Resetting a trip.
    Reset,
    /// Handing control back to panel and terminals.
    Release,
}

impl ControlAction {
    /// All of them.
    pub const ALL: &[Self] = &[
        Self::Basic,
        Self::Reverse,
        Self::Coast,
        Self::Reset,
        Self::Release,
    ];

    /// The word used in the configuration.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Basic => "basic",
            Self::Reverse => "reverse",
            Self::Coast => "coast",
            Self::Reset => "reset",
            Self::Release => "release",
        }
    }
}

/// What was seen to work at one drive, by a person in front of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SiteEvidence {
    /// The unproven actions that were confirmed there and that the control section does not list.
    pub actions: Vec<ControlAction>,
    /// The identity register of that drive and its word at that time, if its model has one.
    pub identity: Option<(Address, u16)>,
}

/// Who may command while a client holds control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Ownership {
    /// Only its holder; all other clients are refused.
    #[default]
    One,
    /// Any client with the rights: control passes to the last one that commanded.
    Any,
}

/// What keeps the lease of a client alive that commands through the broker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LeaseMode {
    /// The probe returns through the broker and the alive topic does not say `offline` (for Sparkplug: the primary host
    /// is online). Commands and the lease topic count as well.
    #[default]
    Session,
    /// Only commands and the lease topic.
    Explicit,
}

/// A drive's control section.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ControlSettings {
    /// Commands are accepted from MQTT.
    pub from_mqtt: bool,
    /// Commands are accepted from Modbus TCP.
    pub from_modbus_tcp: bool,
    /// Commands are accepted from users signed in on the page.
    pub from_page: bool,
    /// Commands are accepted from Sparkplug B hosts.
    pub from_sparkplug: bool,
    /// Which functions come over the bus.
    pub bus: BusFunctions,
    /// Lowest setpoint.
    pub least: Hertz,
    /// Highest setpoint.
    pub most: Hertz,
    /// Directions in which the drive may run; at least one.
    pub directions: Vec<Direction>,
    /// A running motor may be reversed only at or below this output frequency.
    pub reverse_below: Hertz,
    /// What is done when the client in control is lost.
    pub on_commander_lost: FailSafe,
    /// The client is considered lost after this time without a heartbeat.
    pub lost_after: Duration,
    /// What is done when the gateway is stopped on purpose.
    pub on_shutdown: FailSafe,
    /// What is done when the output is outside the limits or far from the setpoint.
    pub on_output_outside: OnOutputOutside,
    /// Unproven actions that are accepted: those that the section lists, and those of `site`.
    pub accept_unverified: Vec<ControlAction>,
    /// Which of them rest on what was seen at this very drive.
    pub site: SiteEvidence,
    /// A command from the local socket may try one unproven action.
    pub qualify: bool,
    /// Control may be handed back to panel and terminals.
    pub allow_release: bool,
    /// RUN over MQTT requires an epoch or a time of issue.
    pub strict: bool,
    /// Plain RUN over MQTT or from the page is refused for this long after any event that inhibits the start.
    pub restart_delay: Duration,
    /// A stop without effect raises an alarm after this time.
    pub stop_effect_timeout: Duration,
    /// A stop for a drive that does not answer is repeated for this long.
    pub stop_pending_for: Duration,
    /// Native registers without a role that may be written.
    pub native_write: Vec<u16>,
    /// Who may command while a client holds control.
    pub ownership: Ownership,
    /// Control may be taken over from its holder.
    pub allow_take: bool,
    /// What keeps the lease of an MQTT client alive.
    pub lease: LeaseMode,
    /// Minimum time between two starts from standstill.
    pub min_start_interval: Duration,
    /// Minimum time between two writes of a stored register.
    pub stored_write_interval: Duration,
    /// What is written natively is also stored, where the drive stores parameters only after a word of its own.
    pub stores_native_writes: bool,
    /// RUN is accepted only while the drive's own watchdog is known to be on and short enough.
    pub require_watchdog: bool,
    /// The declared time of the drive's own watchdog; `None` if it is not declared.
    pub watchdog: Option<Duration>,
    /// After this time a declared stop without effect is left to the drive's own watchdog, if that can be relied on.
    pub failsafe_confirm_timeout: Duration,
    /// What happens to the drive when this gateway takes its line over from another; `None`: the line has no other.
    pub on_gateway_lost: Option<OnGatewayLost>,
}

impl ControlSettings {
    /// Default of [`restart_delay`](Self::restart_delay).
    pub const RESTART_DELAY: Duration = Duration::from_secs(3);
    /// Default of [`stop_effect_timeout`](Self::stop_effect_timeout).
    pub const STOP_EFFECT_TIMEOUT: Duration = Duration::from_secs(3);
    /// Default of [`stop_pending_for`](Self::stop_pending_for).
    pub const STOP_PENDING_FOR: Duration = Duration::from_secs(600);

    /// Default of [`stored_write_interval`](Self::stored_write_interval).
    pub const STORED_WRITE_INTERVAL: Duration = Duration::from_secs(10);
    /// Default of [`failsafe_confirm_timeout`](Self::failsafe_confirm_timeout).
    pub const FAILSAFE_CONFIRM_TIMEOUT: Duration = Duration::from_secs(5);

    /// The mandatory settings, and defaults for the rest: no commands accepted, forward only, proven facts only.
    #[must_use]
    pub fn new(
        (least, most): (Hertz, Hertz),
        (on_commander_lost, lost_after): (FailSafe, Duration),
        on_shutdown: FailSafe,
    ) -> Self {
        Self {
            from_mqtt: false,
            from_modbus_tcp: false,
            from_page: false,
            from_sparkplug: false,
            bus: BusFunctions::Both,
            least,
            most,
            directions: vec![Direction::Forward],
            reverse_below: Hertz::ZERO,
            on_commander_lost,
            lost_after,
            on_shutdown,
            on_output_outside: OnOutputOutside::Alarm,
            accept_unverified: Vec::new(),
            site: SiteEvidence::default(),
            qualify: false,
            allow_release: false,
            strict: false,
            restart_delay: Self::RESTART_DELAY,
            stop_effect_timeout: Self::STOP_EFFECT_TIMEOUT,
            stop_pending_for: Self::STOP_PENDING_FOR,
            native_write: Vec::new(),
            ownership: Ownership::One,
            allow_take: false,
            lease: LeaseMode::Session,
            min_start_interval: Duration::ZERO,
            stored_write_interval: Self::STORED_WRITE_INTERVAL,
            stores_native_writes: false,
            require_watchdog: false,
            watchdog: None,
            failsafe_confirm_timeout: Self::FAILSAFE_CONFIRM_TIMEOUT,
            on_gateway_lost: None,
        }
    }

    /// The drive that the unproven actions were seen at, if any rest on that: the register that tells it apart, and its
    /// word.
    #[must_use]
    pub fn qualified_drive(&self) -> Option<(Address, u16)> {
        if self.site.actions.is_empty() {
            None
        } else {
            self.site.identity
        }
    }

    /// The longest time to which the drive's own watchdog may be set: the declared time, or else `lost_after`.
    #[must_use]
    pub fn watchdog_at_most(&self) -> Duration {
        self.watchdog.unwrap_or(self.lost_after)
    }
}
