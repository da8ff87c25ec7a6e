//! The tables of a drive for commands and writes: `[line.drive.control]` and `[line.drive.native]`.

use super::super::lists;
use super::super::words::{
    self, ACTIONS, BUS_FUNCTIONS, COMMANDS, CommandInterface, DIRECTIONS, FAIL_SAFES, LEASES,
    ON_GATEWAY_LOST, ON_OUTPUT_OUTSIDE, OWNERSHIPS, WAYS,
};
use super::kinds::{ListKey, choice, flag, hours, minutes, ms, seconds, time};
use crate::domain::command::Direction;
use crate::domain::control::{
    BusFunctions, ControlAction, ControlSettings, FailSafe, OnOutputOutside, Ownership,
    SiteEvidence,
};
use crate::domain::frequency::Hertz;
use crate::domain::standby::OnGatewayLost;
use crate::north::mqtt::LeaseMode;
use crate::toml_file::declare::{KeyForm, declare_table, list, optional, required, required_list};
use crate::toml_file::values::{ValueKind, WrongValue};
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, RequiredKey, TableReader};
use std::time::Duration;

declare_table! {
    /// `[line.drive.control]`
    ControlFile is "[line.drive.control]" {
        /// The interfaces that accept commands; each must be enabled.
        from: RequiredKey<Vec<LocatedValue<CommandInterface>>> =
            required_list(ValueKind::choice(&WAYS, words::of_way));
        /// Which functions come over the bus; the others are wired to the drive. With "frequency" the drive is started and
        /// stopped elsewhere: a stop is sent, but may have no effect, and both fail-safe actions must be "hold";
        /// `on_gateway_lost` too, or "adopt".
        bus: OptionalKey<BusFunctions> = choice(&BUS_FUNCTIONS, words::of_bus), default "both" => bus;
        /// Minimum and maximum setpoint. Values outside are refused, never clamped.
        limits as "frequency_hz": Option<LimitsFile> = limits();
        /// The directions in which the motor may run.
        directions: ListKey<Direction> = list(ValueKind::choice(&DIRECTIONS, words::of_direction)),
            without "[\"forward\"]";
        /// A running motor may be reversed only at or below this output frequency. Only with both directions.
        reverse_below as "reverse_below_hz": OptionalKey<Hertz> = optional(hertz()),
            default 0.0 => reverse_below;
        /// The fail-safe action when the commander vanishes.
        on_commander_lost: RequiredKey<FailSafe> = required(fail_safe()) => on_commander_lost;
        /// How long the commander may be silent before the fail-safe action. It must exceed the time a command may wait and, with
        /// a session lease, three probes.
        lost_after: RequiredKey<Duration> = required(lost_after()) => lost_after;
        /// The action when the gateway shuts down on request.
        on_shutdown: RequiredKey<FailSafe> = required(fail_safe()) => on_shutdown;
        /// What happens when the motor runs by an order and its output is above `frequency_hz`, or stays away from the setpoint:
        /// only the alarm `output_outside_limits`, which refuses RUN and higher setpoints, or a stop as well.
        on_output_outside: OptionalKey<OnOutputOutside> =
            choice(&ON_OUTPUT_OUTSIDE, words::of_output_outside), default "alarm" => on_output_outside;
        /// What happens to a drive that was ordered to run, when this gateway takes its line over: it is stopped by its ramp, its
        /// output is cut off, it goes on, or it goes on for `lost_after` so that its client can come back.
        on_gateway_lost: OptionalKey<OnGatewayLost> = optional(on_gateway_lost()),
            without "none: required on a line with `standby = true`";
        /// Actions that the model marks as unproven but that you accept. "basic" is stop, forward and the setpoint together.
        accept_unverified: ListKey<ControlAction> = list(ValueKind::choice(&ACTIONS, words::of_action)),
            without "[]";
        /// Whether `vfd-gateway qualify` may try what the model leaves unproven, one command at a time. For the day of the trials
        /// only.
        qualify: OptionalKey<bool> = flag(), default false => qualify;
        /// Whether control may be returned to panel and terminals. A closed terminal may then start the motor.
        allow_release: OptionalKey<bool> = flag(), default false => allow_release;
        /// Strict: RUN over MQTT only with `epoch` or `issued_at`.
        strict as "commands": OptionalKey<bool> = choice(&COMMANDS, words::of_commands),
            default "plain" => strict;
        /// RUN over MQTT without `epoch` and `issued_at`, or from the page, is refused for this long after a stop, a trip, a lost
        /// lease or an outage; over MQTT at least 1.75 s more than `probe_interval`, from the page at least 2.5 s.
        restart_delay: OptionalKey<Duration> = time(Duration::ZERO..=minutes(1)),
            without "\"3s\"; with `[mqtt]` 1.75 s more than `probe_interval` if that is longer, at most \"5s\"";
        /// A stop without effect for this long raises an alarm.
        stop_effect_timeout: OptionalKey<Duration> = time(ms(500)..=minutes(1)),
            constant ControlSettings::STOP_EFFECT_TIMEOUT => stop_effect_timeout;
        /// How long a stop waits for a drive that does not answer.
        stop_pending_for: OptionalKey<Duration> = time(seconds(1)..=hours(1)),
            constant ControlSettings::STOP_PENDING_FOR => stop_pending_for;
        /// Who may command while a client holds control: only that client, or every client with the rights.
        ownership: OptionalKey<Ownership> = choice(&OWNERSHIPS, words::of_ownership),
            default "one" => ownership;
        /// Whether a client may take control from its holder. The drive keeps running as it is.
        allow_take: OptionalKey<bool> = flag(), default false => allow_take;
        /// What renews the lease over MQTT: a working path through the broker, or only commands and the lease topic.
        lease: OptionalKey<LeaseMode> = choice(&LEASES, words::of_lease), without "that of `[mqtt]`";
        /// Minimum time between two starts from standstill.
        min_start_interval: OptionalKey<Duration> = time(Duration::ZERO..=hours(1)),
            default "0s" => min_start_interval;
        /// The time-out to which the drive's own watchdog is set: more than twice the longest gap between frames, at most
        /// `lost_after`.
        watchdog: OptionalKey<Duration> = time(ms(100)..=hours(1)), without "unknown" => watchdog;
        /// Allow RUN only while the drive's own watchdog was read as enabled and in order. For models where that is proven.
        require_watchdog: OptionalKey<bool> = flag(), default false => require_watchdog;
        /// A fail-safe stop without effect for this long is left to the drive's own watchdog, if it was read as enabled: no more
        /// frames are sent.
        failsafe_confirm_timeout: OptionalKey<Duration> = time(seconds(1)..=minutes(1)),
            constant ControlSettings::FAILSAFE_CONFIRM_TIMEOUT => failsafe_confirm_timeout;
    } fills ControlSettings with |
        file, limits: SetpointLimits, on_gateway_lost: Option<OnGatewayLost>, site: SiteEvidence,
        native_write: Vec<u16>, native: &NativeFile, defaults: MqttDefaults
    | {
        from_mqtt: file.is_from(CommandInterface::Mqtt)?,
        from_modbus_tcp: file.is_from(CommandInterface::ModbusTcp)?,
        from_page: file.is_from(CommandInterface::Page)?,
        from_sparkplug: file.is_from(CommandInterface::Sparkplug)?,
        least: limits.least,
        most: limits.most,
        directions: file.directions()?,
        accept_unverified: [lists::values(&file.accept_unverified)?, site.actions.clone()].concat(),
        restart_delay: file.restart_delay.or(defaults.restart_delay)?,
        stored_write_interval: native.stored_write_interval()?,
        stores_native_writes: native.store()?,
        lease: file.lease.or(defaults.lease)?,
        on_gateway_lost, site, native_write,
    }
}

declare_table! {
    /// `[line.drive.native]`
    NativeFile is "[line.drive.native]" {
        /// The registers that may be written; none that `control` uses.
        write: RequiredKey<Vec<LocatedValue<String>>> =
            required_list(ValueKind::text()).listed_as("list of codes, names or addresses");
        /// Minimum time between two writes of a register that is stored, or not known to be in RAM.
        stored_write_interval: OptionalKey<Duration> = time(seconds(1)..=hours(24)),
            constant ControlSettings::STORED_WRITE_INTERVAL;
        /// Whether each write is followed by the word that stores parameters, for models with `[commit.store]`: no more often
        /// than `stored_write_interval`.
        store: OptionalKey<bool> = flag(), default false;
    }
}

/// The lowest and the highest setpoint.
pub struct SetpointLimits {
    pub least: Hertz,
    pub most: Hertz,
}

/// Defaults that drives take from `[mqtt]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MqttDefaults {
    /// What renews a lease.
    pub lease: LeaseMode,
    /// How long plain RUN is refused after a stop.
    pub restart_delay: Duration,
}

impl Default for MqttDefaults {
    fn default() -> Self {
        Self {
            lease: LeaseMode::default(),
            restart_delay: ControlSettings::RESTART_DELAY,
        }
    }
}

declare_table! {
    /// `frequency_hz` of a control section.
    LimitsFile is "frequency_hz" {
        /// The lowest setpoint.
        min: RequiredKey<Hertz> = required(hertz());
        /// The highest setpoint.
        max: RequiredKey<Hertz> = required(hertz());
    }
}

impl ControlFile {
    /// Whether `from` names `way`; `None` if it is invalid.
    fn is_from(&self, way: CommandInterface) -> Option<bool> {
        Some(lists::has(&self.from.as_ref()?.value, &way))
    }

    /// The directions in which the motor may run; `None` if the list is invalid or empty.
    pub fn directions(&self) -> Option<Vec<Direction>> {
        let listed = lists::some_values(&self.directions)?;
        Some(listed.unwrap_or_else(|| vec![Direction::Forward])).filter(|list| !list.is_empty())
    }

    /// The location of `way` in `from`, if it is named there.
    pub fn names(&self, way: CommandInterface) -> Option<&KeyLocation> {
        let from = self.from.as_ref()?;
        from.value
            .iter()
            .find(|named| named.value == way)
            .map(|named| &named.location)
    }

    /// The location of the first interface in `from` that is reached through the broker.
    pub fn by_broker(&self) -> Option<&KeyLocation> {
        self.names(CommandInterface::Mqtt)
            .or(self.names(CommandInterface::Sparkplug))
    }
}

fn fail_safe() -> ValueKind<'static, FailSafe> {
    ValueKind::choice(&FAIL_SAFES, words::of_fail_safe)
}

/// What happens to a drive when its gateway is lost.
pub fn on_gateway_lost() -> ValueKind<'static, OnGatewayLost> {
    ValueKind::choice(&ON_GATEWAY_LOST, words::of_gateway_lost)
}

fn lost_after() -> ValueKind<'static, Duration> {
    let kind = ValueKind::duration(seconds(1)..=hours(1));
    let notation = format!("{}, more than \"1s\"", kind.notation());
    kind.listed_as(notation)
}

/// A frequency in exact steps: it is compared with setpoints, so it must not be rounded. The model narrows its range.
fn hertz() -> ValueKind<'static, Hertz> {
    let kind = ValueKind::decimal(0.0..=10_000.0);
    let notation = format!("{} Hz", kind.notation());
    kind.and_then(|value| {
        Hertz::from_f64(value).map_err(|wrong| {
            let right = "at most three decimals".to_owned();
            WrongValue::from((format!("{value} is {wrong}"), right))
        })
    })
    .listed_as(notation)
}

fn limits() -> KeyForm<'static, Option<LimitsFile>> {
    let range = hertz();
    let notation = format!("{{ min = {0}, max = {0} }}", range.notation());
    KeyForm::new(notation, |reader: &mut TableReader<'_, '_>, key| {
        let section = reader.required_table(key)?;
        Some(LimitsFile::read(reader.open(section)))
    })
}
