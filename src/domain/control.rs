//! What a drive's control section allows: ready values, checked against the model by whoever reads them.

use super::command::Direction;
use super::frequency::Hertz;
use std::time::Duration;

/// What happens to a drive whose commander is gone, or whose gateway is stopped on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FailSafe {
    /// It is stopped by its deceleration ramp.
    Stop,
    /// Its output is cut off.
    Coast,
    /// It is left as it is.
    Hold,
}

impl FailSafe {
    /// The word as it stands in the configuration.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Coast => "coast",
            Self::Hold => "hold",
        }
    }
}

/// A control action that may rest on an unproven fact of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ControlAction {
    /// Stop, forward and the setpoint together: without them a drive takes no orders at all.
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
    pub const ALL: &[Self] = &[Self::Basic, Self::Reverse, Self::Coast, Self::Reset, Self::Release];

    /// The word as it stands in the configuration.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Basic => "basic",
            Self::Reverse => "reverse",
            Self::Coast => "coast",
            Self::Reset => "reset",
            Self::Release => "release",
        }
    }
}

/// Who may command while somebody holds control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Ownership {
    /// Only the one who holds it; everybody else is refused.
    #[default]
    One,
    /// Whoever has the rights: control passes to the last one who commanded.
    Any,
}

/// What keeps a lease of those who command through the broker alive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LeaseMode {
    /// The probe through the broker comes back, and the alive topic does not say `offline`, or, for Sparkplug, the primary
    /// host is online; commands and the lease topic as well.
    #[default]
    Session,
    /// Only commands and the lease topic.
    Explicit,
}

/// A drive's control section.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ControlSettings {
    /// Commands are taken from MQTT.
    pub from_mqtt: bool,
    /// Commands are taken from Modbus TCP.
    pub from_modbus_tcp: bool,
    /// Commands are taken from those who are signed in on the page.
    pub from_page: bool,
    /// Commands are taken from hosts of Sparkplug B.
    pub from_sparkplug: bool,
    /// Lowest setpoint.
    pub least: Hertz,
    /// Highest setpoint.
    pub most: Hertz,
    /// Directions in which it may run; at least one.
    pub directions: Vec<Direction>,
    /// A running motor may be ordered the other way only at or below this output frequency.
    pub reverse_below: Hertz,
    /// What is done when the commander is lost.
    pub on_commander_lost: FailSafe,
    /// After this time without a sign of the commander it is lost.
    pub lost_after: Duration,
    /// What is done when the gateway is stopped on purpose.
    pub on_shutdown: FailSafe,
    /// Unproven actions that are accepted.
    pub accept_unverified: Vec<ControlAction>,
    /// Control may be handed back to panel and terminals.
    pub allow_release: bool,
    /// RUN over MQTT only with an epoch or a moment of issue.
    pub strict: bool,
    /// Plain RUN over MQTT or from the page is refused for this long after everything that inhibits the start.
    pub restart_delay: Duration,
    /// A stop without effect is an alarm after this time.
    pub stop_effect_timeout: Duration,
    /// A stop for a drive that does not answer is repeated for this long.
    pub stop_pending_for: Duration,
    /// Native registers without a role that may be written.
    pub native_write: Vec<u16>,
    /// Who may command while somebody holds control.
    pub ownership: Ownership,
    /// Control may be taken over from the one who holds it.
    pub allow_take: bool,
    /// What keeps a lease of the MQTT side alive.
    pub lease: LeaseMode,
    /// Minimum time between two starts from standstill.
    pub min_start_interval: Duration,
    /// Least time between two writes of a register that is stored.
    pub stored_write_interval: Duration,
    /// RUN only while the drive's own watchdog is known to be on and in order.
    pub require_watchdog: bool,
    /// The time to which the drive's own watchdog is said to be set; nothing: nobody says.
    pub watchdog: Option<Duration>,
    /// A declared stop without effect is left to the drive's own watchdog after this time, where that can be relied on.
    pub failsafe_confirm_timeout: Duration,
}

impl ControlSettings {
    /// How long plain RUN over MQTT or from the page is refused after what inhibits the start, where nothing else is said.
    pub const RESTART_DELAY: Duration = Duration::from_secs(3);
    /// When a stop without effect is an alarm, where nothing else is said.
    pub const STOP_EFFECT_TIMEOUT: Duration = Duration::from_secs(3);
    /// How long a stop waits for a drive that does not answer, where nothing else is said.
    pub const STOP_PENDING_FOR: Duration = Duration::from_secs(600);

    /// Least time between two writes of a stored register, where nothing else is said.
    pub const STORED_WRITE_INTERVAL: Duration = Duration::from_secs(10);
    /// When a declared stop without effect is left to the drive's own watchdog, where nothing else is said.
    pub const FAILSAFE_CONFIRM_TIMEOUT: Duration = Duration::from_secs(5);

    /// What must be said, and defaults for the rest: nobody commands yet, forward alone, on proven facts alone.
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
            least,
            most,
            directions: vec![Direction::Forward],
            reverse_below: Hertz::ZERO,
            on_commander_lost,
            lost_after,
            on_shutdown,
            accept_unverified: Vec::new(),
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
            require_watchdog: false,
            watchdog: None,
            failsafe_confirm_timeout: Self::FAILSAFE_CONFIRM_TIMEOUT,
        }
    }

    /// The longest time to which the drive's own watchdog may be set: as long as a commander may be silent, or as it is
    /// said to be.
    #[must_use]
    pub fn watchdog_at_most(&self) -> Duration {
        self.watchdog.unwrap_or(self.lost_after)
    }
}
