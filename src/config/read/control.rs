//! The tables of a drive for commands and writes: `control` and `native`.

use super::super::file::{ControlFile, LimitsFile, NativeFile};
use super::super::keys::ConfigSection;
use super::super::words::{
    self, ACTIONS, BUS_FUNCTIONS, COMMANDS, CommandInterface, DIRECTIONS, FAIL_SAFES, LEASES,
    ON_OUTPUT_OUTSIDE, OWNERSHIPS, WAYS, on_gateway_lost,
};
use super::tables::refuse_not_served;
use crate::domain::frequency::Hertz;
use crate::domain::problem::Problem;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader};
use std::ops::RangeInclusive;
use std::time::Duration;

/// The range of frequencies, before the check against the model.
const HERTZ: RangeInclusive<f64> = 0.0..=10_000.0;
const LOST_AFTER: RangeInclusive<Duration> = Duration::from_secs(1)..=Duration::from_secs(3600);
const RESTART_DELAY: RangeInclusive<Duration> = Duration::ZERO..=Duration::from_secs(60);
const STOP_EFFECT: RangeInclusive<Duration> = Duration::from_millis(500)..=Duration::from_secs(60);
const START_INTERVAL: RangeInclusive<Duration> = Duration::ZERO..=Duration::from_secs(3600);
const WATCHDOG: RangeInclusive<Duration> = Duration::from_millis(100)..=Duration::from_secs(3600);
const FAILSAFE_CONFIRM: RangeInclusive<Duration> = Duration::from_secs(1)..=Duration::from_secs(60);
const STORED_WRITE: RangeInclusive<Duration> =
    Duration::from_secs(1)..=Duration::from_secs(24 * 3600);
const STOP_PENDING: RangeInclusive<Duration> = Duration::from_secs(1)..=Duration::from_secs(3600);

/// `[line.drive.control]`
pub(super) fn read_control(mut reader: TableReader<'_, '_>) -> ControlFile {
    refuse_not_served(&mut reader, ConfigSection::Control);
    let control = ControlFile {
        from: reader.required_list("from", &ValueKind::choice(&WAYS, CommandInterface::meaning)),
        bus: reader.optional("bus", &ValueKind::choice(&BUS_FUNCTIONS, words::of_bus)),
        limits: read_limits(&mut reader),
        directions: reader.list(
            "directions",
            &ValueKind::choice(&DIRECTIONS, words::of_direction),
        ),
        reverse_below: read_hertz(&mut reader, "reverse_below_hz"),
        on_commander_lost: reader.required(
            "on_commander_lost",
            &ValueKind::choice(&FAIL_SAFES, words::of_fail_safe),
        ),
        lost_after: reader.required("lost_after", &ValueKind::duration(LOST_AFTER)),
        on_shutdown: reader.required(
            "on_shutdown",
            &ValueKind::choice(&FAIL_SAFES, words::of_fail_safe),
        ),
        on_output_outside: reader.optional(
            "on_output_outside",
            &ValueKind::choice(&ON_OUTPUT_OUTSIDE, words::of_output_outside),
        ),
        on_gateway_lost: reader.optional("on_gateway_lost", &on_gateway_lost()),
        accept_unverified: reader.list(
            "accept_unverified",
            &ValueKind::choice(&ACTIONS, words::of_action),
        ),
        qualify: reader.optional("qualify", &ValueKind::flag()),
        allow_release: reader.optional("allow_release", &ValueKind::flag()),
        strict: reader.optional(
            "commands",
            &ValueKind::choice(&COMMANDS, words::of_commands),
        ),
        restart_delay: reader.optional("restart_delay", &ValueKind::duration(RESTART_DELAY)),
        stop_effect_timeout: reader
            .optional("stop_effect_timeout", &ValueKind::duration(STOP_EFFECT)),
        stop_pending_for: reader.optional("stop_pending_for", &ValueKind::duration(STOP_PENDING)),
        ownership: reader.optional(
            "ownership",
            &ValueKind::choice(&OWNERSHIPS, words::of_ownership),
        ),
        allow_take: reader.optional("allow_take", &ValueKind::flag()),
        lease: reader.optional("lease", &ValueKind::choice(&LEASES, words::of_lease)),
        min_start_interval: reader
            .optional("min_start_interval", &ValueKind::duration(START_INTERVAL)),
        watchdog: reader.optional("watchdog", &ValueKind::duration(WATCHDOG)),
        require_watchdog: reader.optional("require_watchdog", &ValueKind::flag()),
        failsafe_confirm_timeout: reader.optional(
            "failsafe_confirm_timeout",
            &ValueKind::duration(FAILSAFE_CONFIRM),
        ),
    };
    reader.finish();
    control
}

/// `[line.drive.native]`
pub(super) fn read_native(mut reader: TableReader<'_, '_>) -> NativeFile {
    refuse_not_served(&mut reader, ConfigSection::Native);
    let native = NativeFile {
        write: reader.required_list("write", &ValueKind::text()),
        stored_write_interval: reader
            .optional("stored_write_interval", &ValueKind::duration(STORED_WRITE)),
        store: reader.optional("store", &ValueKind::flag()),
    };
    reader.finish();
    native
}

fn read_limits(reader: &mut TableReader<'_, '_>) -> Option<LimitsFile> {
    let section = reader.required_table("frequency_hz")?;
    let mut reader = reader.open(section);
    let kind = ValueKind::decimal(HERTZ);
    let min = reader.required("min", &kind);
    let max = reader.required("max", &kind);
    let limits = LimitsFile {
        min: exact(min, reader.problems()),
        max: exact(max, reader.problems()),
    };
    reader.finish();
    Some(limits)
}

fn read_hertz(reader: &mut TableReader<'_, '_>, key: &'static str) -> OptionalKey<Hertz> {
    match reader.optional(key, &ValueKind::decimal(HERTZ)) {
        OptionalKey::Absent => OptionalKey::Absent,
        OptionalKey::Invalid => OptionalKey::Invalid,
        OptionalKey::Valid(written) => {
            exact(Some(written), reader.problems()).map_or(OptionalKey::Invalid, OptionalKey::Valid)
        }
    }
}

/// The frequency in exact steps: it is compared with setpoints, so it must not be rounded.
fn exact(written: RequiredKey<f64>, problems: &mut Vec<Problem>) -> RequiredKey<Hertz> {
    let LocatedValue { value, location } = written?;
    match Hertz::from_f64(value) {
        Ok(value) => Some(LocatedValue { value, location }),
        Err(wrong) => {
            problems.push(
                location
                    .problem(format!("{value} is {wrong}"))
                    .right("at most three decimals"),
            );
            None
        }
    }
}
