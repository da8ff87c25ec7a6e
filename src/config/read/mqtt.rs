//! The table `[mqtt]`.

use super::super::broker::{self, BrokerAddress};
use super::super::file::{HomeAssistantFile, MqttFile, SparkplugFile};
use super::super::keys::ConfigSection;
use super::super::words::{COMBINED, LEASES, TREES, of_lease};
use super::tables::{absolute_path, inner, refuse_not_served, turned};
use crate::north::broker::{MqttVersion, Qos};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader};
use std::ops::RangeInclusive;
use std::time::Duration;

/// Range of heartbeats.
pub(super) const HEARTBEAT: RangeInclusive<Duration> =
    Duration::from_secs(1)..=Duration::from_secs(3600);
const KEEP_ALIVE: RangeInclusive<Duration> = Duration::from_secs(5)..=Duration::from_secs(600);
const PROBE_INTERVAL: RangeInclusive<Duration> =
    Duration::from_millis(200)..=Duration::from_secs(60);
/// Range of the maximum age of a Sparkplug command.
const COMMAND_AGE: RangeInclusive<Duration> = Duration::from_secs(1)..=Duration::from_secs(300);
const COMMAND_TTL: RangeInclusive<Duration> = Duration::from_millis(100)..=Duration::from_secs(60);
/// Maximum number of kept changes: about ten megabytes.
const KEEP_TELEMETRY_MAX: u32 = 100_000;

/// Maximum bytes of a topic, a prefix or a client identifier: far below the limit of brokers.
const MAX_BYTES: usize = 128;

/// `[mqtt]`
pub(super) fn read_mqtt(mut reader: TableReader<'_, '_>) -> MqttFile {
    refuse_not_served(&mut reader, ConfigSection::Mqtt);
    reader.refuse(
        "password",
        "a password must not be in this file, which others may read and copy",
        "`password_file` with an absolute path, or `password_env` with the name of an environment variable",
    );
    let mqtt = MqttFile {
        broker: read_broker(&mut reader),
        also_at: read_also_at(&mut reader),
        user: reader.optional("user", &ValueKind::text()),
        password_file: reader.optional("password_file", &absolute_path()),
        password_env: reader.optional(
            "password_env",
            &ValueKind::parsed("the name of an environment variable", variable),
        ),
        allow_plain_password: reader.optional("allow_plain_password", &ValueKind::flag()),
        client_id: reader.optional("client_id", &client_id()),
        version: turned(
            reader.optional("version", &ValueKind::number(4..=5_u8)),
            |version| {
                Some(if version == 4 {
                    MqttVersion::V4
                } else {
                    MqttVersion::V5
                })
            },
        ),
        subscription_qos: turned(
            reader.optional("subscription_qos", &ValueKind::number(0..=1_u8)),
            |qos| {
                Some(if qos == 0 {
                    Qos::AtMostOnce
                } else {
                    Qos::AtLeastOnce
                })
            },
        ),
        prefix: reader.optional("prefix", &topics()),
        heartbeat: reader.optional("heartbeat", &ValueKind::duration(HEARTBEAT)),
        keep_alive: read_keep_alive(&mut reader),
        lease: reader.optional("lease", &ValueKind::choice(&LEASES, of_lease)),
        alive_topic: reader.optional("alive_topic", &topic_or_none()),
        probe_interval: reader.optional("probe_interval", &ValueKind::duration(PROBE_INTERVAL)),
        command_ttl: reader.optional("command_ttl", &ValueKind::duration(COMMAND_TTL)),
        response_prefix: reader.optional("response_prefix", &topics()),
        keep_telemetry: reader
            .optional("keep_telemetry", &ValueKind::number(0..=KEEP_TELEMETRY_MAX)),
        publish: reader.list("publish", &ValueKind::one_of(&TREES)),
        home_assistant: inner(&mut reader, "home_assistant", read_home_assistant),
        sparkplug: inner(&mut reader, "sparkplug", read_sparkplug),
        ca_file: reader.optional("ca_file", &absolute_path()),
        client_cert_file: reader.optional("client_cert_file", &absolute_path()),
        client_key_file: reader.optional("client_key_file", &absolute_path()),
    };
    reader.finish();
    mqtt
}

fn read_home_assistant(mut reader: TableReader<'_, '_>) -> HomeAssistantFile {
    let home_assistant = HomeAssistantFile {
        discovery: reader.required("discovery", &ValueKind::flag()),
        prefix: reader.optional("prefix", &topics()),
        devices: reader.optional("devices", &ValueKind::flag()),
        combined: reader.list("combined", &ValueKind::one_of(&COMBINED)),
        page: reader.optional("page", &page()),
    };
    reader.finish();
    home_assistant
}

/// `[mqtt.sparkplug]`
fn read_sparkplug(mut reader: TableReader<'_, '_>) -> SparkplugFile {
    let sparkplug = SparkplugFile {
        location: reader.location().clone(),
        group: reader.required("group", &level()),
        primary_host: reader.optional("primary_host", &level()),
        client_id: reader.optional("client_id", &client_id()),
        max_command_age: reader.optional("max_command_age", &ValueKind::duration(COMMAND_AGE)),
        keep_telemetry: reader
            .optional("keep_telemetry", &ValueKind::number(0..=KEEP_TELEMETRY_MAX)),
    };
    reader.finish();
    sparkplug
}

/// One level of a topic.
fn level() -> ValueKind<'static, String> {
    ValueKind::parsed(
        "one level of a topic, without `/`, `+`, `#` or a first `$`: \"plant-a\"",
        |text| (is_topic(text) && !text.contains('/')).then(|| text.to_owned()),
    )
}

fn read_broker(reader: &mut TableReader<'_, '_>) -> RequiredKey<BrokerAddress> {
    let written = reader.required("broker", &ValueKind::text())?;
    read_address(reader, written)
}

fn read_also_at(reader: &mut TableReader<'_, '_>) -> OptionalKey<Vec<LocatedValue<BrokerAddress>>> {
    let LocatedValue { value, location } = match reader.list("also_at", &ValueKind::text()) {
        OptionalKey::Absent => return OptionalKey::Absent,
        OptionalKey::Invalid => return OptionalKey::Invalid,
        OptionalKey::Valid(list) => list,
    };
    let read: Option<Vec<_>> = value
        .into_iter()
        .map(|text| read_address(reader, text))
        .collect();
    read.map_or(OptionalKey::Invalid, |value| {
        OptionalKey::Valid(LocatedValue { value, location })
    })
}

fn read_address(
    reader: &mut TableReader<'_, '_>,
    LocatedValue { value, location }: LocatedValue<String>,
) -> RequiredKey<BrokerAddress> {
    match broker::parse(&value) {
        Ok(value) => Some(LocatedValue { value, location }),
        Err((what, right)) => {
            reader.problems().push(location.problem(what).right(right));
            None
        }
    }
}

/// The protocol uses whole seconds for this time.
fn read_keep_alive(reader: &mut TableReader<'_, '_>) -> OptionalKey<Duration> {
    let keep_alive = reader.optional("keep_alive", &ValueKind::duration(KEEP_ALIVE));
    if let Some(written) = keep_alive
        .valid()
        .filter(|written| written.value.subsec_millis() != 0)
    {
        let problem = written
            .location
            .problem("the protocol uses whole seconds for this time");
        reader
            .problems()
            .push(problem.right(format!("\"{}s\"", written.value.as_secs())));
        return OptionalKey::Invalid;
    }
    keep_alive
}

fn variable(text: &str) -> Option<String> {
    let fits = text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && text
            .bytes()
            .all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
    fits.then(|| text.to_owned())
}

fn client_id() -> ValueKind<'static, String> {
    let fits = |text: &str| {
        (1..=MAX_BYTES).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_graphic())
    };
    ValueKind::parsed(
        format!("1 to {MAX_BYTES} visible characters without blanks"),
        move |text| fits(text).then(|| text.to_owned()),
    )
}

/// The first levels of other topics.
fn topics() -> ValueKind<'static, String> {
    let right = "levels of a topic without `+`, `#`, a first `$`, or a slash at either end: \"vfd\", \"plant/vfd\"";
    ValueKind::parsed(right, |text| {
        let fits = is_topic(text) && text.split('/').all(|level| !level.is_empty());
        fits.then(|| text.to_owned())
    })
}

/// The address of a page.
fn page() -> ValueKind<'static, String> {
    ValueKind::parsed("an address such as \"https://192.168.1.5:8443\"", |text| {
        let host = text
            .strip_prefix("http://")
            .or_else(|| text.strip_prefix("https://"))?;
        let fits = !host.is_empty()
            && text.len() <= MAX_BYTES
            && text.bytes().all(|byte| byte.is_ascii_graphic());
        fits.then(|| text.to_owned())
    })
}

fn topic_or_none() -> ValueKind<'static, Option<String>> {
    ValueKind::parsed(
        "a topic without `+`, `#` or a first `$`, or \"\" for none",
        |text| match text {
            "" => Some(None),
            topic => is_topic(topic).then(|| Some(topic.to_owned())),
        },
    )
}

/// One topic; not a filter, and not one of the broker's own.
fn is_topic(text: &str) -> bool {
    let is_wild = |c: char| matches!(c, '+' | '#') || c.is_control();
    (1..=MAX_BYTES).contains(&text.len()) && !text.contains(is_wild) && !text.starts_with('$')
}
