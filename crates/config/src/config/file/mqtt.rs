//! The tables of the broker: `[mqtt]`, with `home_assistant` in it, and `[mqtt.sparkplug]`.

use super::super::broker::{self, BrokerAddress};
use super::super::lists;
use super::super::ready_broker::{MqttSettings, SparkplugSettings};
use super::super::words::{COMBINED, LEASES, TREES, of_lease};
use super::kinds::{ListKey, absolute_path, choice, flag, hours, minutes, ms, seconds, time};
use crate::north::broker::{MqttVersion, Qos};
use crate::north::mqtt::{
    CombinedEntity, HomeAssistant, LeaseMode, Settings as SessionSettings, TopicTree,
};
use crate::toml_file::declare::{
    KeyForm, RefusedKey, declare_table, list, optional, required, table,
};
use crate::toml_file::values::{ValueKind, WrongValue};
use crate::toml_file::{OptionalKey, RequiredKey};
use std::path::PathBuf;
use std::time::Duration;

declare_table! {
    /// `[mqtt]`
    MqttFile is "[mqtt]", refuses PASSWORD {
        /// The address of the broker. Ports 1883 and 8883 may be omitted. "embedded" is for trials only.
        broker: RequiredKey<BrokerAddress> = required(broker_address());
        /// The other nodes of a cluster. Each time a connection ends, the next one is tried.
        also_at: ListKey<BrokerAddress> =
            list(broker_address()).listed_as("list of \"mqtt://host:port\" or \"mqtts://host:port\""),
            without "none";
        /// The user name for the broker.
        user: OptionalKey<String> = optional(ValueKind::text()), without "anonymous";
        /// The file with the password.
        password_file: OptionalKey<PathBuf> = optional(absolute_path()), without "no password";
        /// The environment variable with the password, instead of a file.
        password_env: OptionalKey<String> = optional(variable()), without "no password";
        /// Whether user and password may be sent unencrypted, with `mqtt://`.
        allow_plain_password: OptionalKey<bool> = flag(), default false;
        /// The client identifier at the broker. Each gateway of a pair adds a `-` and its `half`.
        client_id: OptionalKey<String> = optional(client_id()),
            without "\"vfd-gateway-\" and the gateway's name";
        /// MQTT 5, or 4 for MQTT 3.1.1.
        version: OptionalKey<MqttVersion> = optional(version()), default 5 => version;
        /// The QoS of the command subscriptions.
        subscription_qos: OptionalKey<Qos> = optional(qos()), default 1 => subscription_qos;
        /// The prefix of all topics, before the gateway's name.
        prefix: OptionalKey<String> = optional(topics()), default "vfd" => prefix;
        /// Interval after which an unchanged value is published again.
        heartbeat: OptionalKey<Duration> = optional(heartbeat()), default "60s" => heartbeat;
        /// The keep-alive interval of MQTT.
        keep_alive: OptionalKey<Duration> = optional(keep_alive()), default "15s";
        /// What renews the lease: a working path through the broker, or only commands and the lease topic.
        lease: OptionalKey<LeaseMode> = choice(&LEASES, of_lease), default "session";
        /// The topic where `offline` means that the commanders are gone. Only with a session lease.
        alive_topic: OptionalKey<Option<String>> = optional(topic_or_none()),
            default "homeassistant/status";
        /// How often the path through the broker is probed. Three missing probes end the connection. At most 3.25 s where
        /// drives are commanded.
        probe_interval: OptionalKey<Duration> = time(ms(200)..=minutes(1)), default "1s" => probe_interval;
        /// How long a command without a time of its own may wait.
        command_ttl: OptionalKey<Duration> = time(ms(100)..=minutes(1)), default "1s" => command_ttl;
        /// The prefix of the response topics that a requester may name; MQTT 5 only.
        response_prefix: OptionalKey<String> = optional(topics()),
            without "no responses" => response_prefix;
        /// How many changes of run state, frequencies and measurements are kept while the broker is unreachable; 0 for none.
        keep_telemetry: OptionalKey<usize> = optional(kept_changes()), default 0 => keep_telemetry;
        /// Optional topics to publish.
        publish: ListKey<TopicTree> = list(ValueKind::one_of(&TREES)), without "all of them";
        /// Whether to announce drives and lines to Home Assistant; the discovery prefix, "homeassistant" by default; whether to
        /// announce whole devices instead of single entities, false by default; what each drive that may be commanded is
        /// announced as besides its buttons, nothing by default; and the address of the page, to which the devices lead.
        home_assistant: OptionalKey<HomeAssistantFile> = home_assistant(), without "nothing is announced";
        /// Sparkplug B for SCADA, on a separate connection to the same broker; needs `data_dir`.
        sparkplug: OptionalKey<SparkplugFile> = table(SparkplugFile::read), without "none: no Sparkplug B";
        /// The certificate authority of the broker; with `mqtts://` only.
        ca_file: OptionalKey<PathBuf> = optional(absolute_path()), without "what the system trusts";
        /// The gateway's own certificate; with `mqtts://` only.
        client_cert_file: OptionalKey<PathBuf> = optional(absolute_path()), without "none";
        /// The key of that certificate.
        client_key_file: OptionalKey<PathBuf> = optional(absolute_path()), without "none";
    // `MqttSettings` has the rest, which concerns the connection, such as `client_id` and `keep_alive`.
    } fills SessionSettings with |file, lease: LeaseMode, home_assistant: Option<HomeAssistant>| {
        alive_topic: match (file.alive_topic()?, lease) {
            (topic, LeaseMode::Session) => topic,
            (_, LeaseMode::Explicit) => None,
        },
        probe_timeout: file.probe_interval()? * MqttSettings::PROBES,
        publish: file.published()?,
        lease, home_assistant,
    }
}

declare_table! {
    /// `home_assistant` of `[mqtt]`
    HomeAssistantFile is "home_assistant" {
        /// Whether to announce drives and lines.
        discovery: RequiredKey<bool> = required(ValueKind::flag()) => discovery;
        /// The discovery prefix that Home Assistant is set to.
        prefix: OptionalKey<String> = optional(topics()), default "homeassistant" => prefix;
        /// Whether to announce whole devices instead of single entities.
        devices: OptionalKey<bool> = flag(), default false => devices;
        /// What each drive that may be commanded is announced as besides its buttons.
        combined: ListKey<CombinedEntity> = list(ValueKind::one_of(&COMBINED)), without "none";
        /// The address of the page, to which the devices lead.
        page: OptionalKey<String> = optional(page()), without "none";
    } fills HomeAssistant with |file, page: Option<String>| {
        combined: lists::values(&file.combined)?,
        page,
    }
}

declare_table! {
    /// `[mqtt.sparkplug]`
    SparkplugFile is "[mqtt.sparkplug]" at location {
        /// The group of the edge node. The edge node is named like the gateway.
        group: RequiredKey<String> = required(level()) => group;
        /// The primary host. Births are sent only while it is online, and its presence renews session leases.
        primary_host: OptionalKey<String> = optional(level()),
            without "none: waits for no host" => primary_host;
        /// The client identifier at the broker. The gateways of a pair share it.
        client_id: OptionalKey<String> = optional(client_id()),
            without "that of `[mqtt]` followed by \"-sparkplug\"" => client_id;
        /// Commands with an older timestamp are refused, except stops.
        max_command_age: OptionalKey<Duration> = time(seconds(1)..=minutes(5)),
            default "10s" => max_command_age;
        /// How many changes of run state, frequencies and measurements are kept while no host is online. Changes of trips are
        /// always kept.
        keep_telemetry: OptionalKey<usize> = optional(kept_changes()), default 10000 => keep_telemetry;
    } fills SparkplugSettings with |file| {}
}

impl MqttFile {
    /// What is published; `None` if it is invalid.
    pub fn published(&self) -> Option<Vec<TopicTree>> {
        Some(lists::some_values(&self.publish)?.unwrap_or_else(|| TopicTree::ALL.to_vec()))
    }
}

const PASSWORD: &[RefusedKey] = &[RefusedKey {
    name: "password",
    what: Some("a password must not be in this file, which others may read and copy"),
    instead: "`password_file` with an absolute path, or `password_env` with the name of an environment variable",
}];

/// Maximum bytes of a topic, a prefix or a client identifier: far below the limit of brokers.
const MAX_BYTES: usize = 128;

/// Interval after which an unchanged value is published again.
pub fn heartbeat() -> ValueKind<'static, Duration> {
    ValueKind::duration(seconds(1)..=hours(1))
}

fn home_assistant() -> KeyForm<'static, OptionalKey<HomeAssistantFile>> {
    let notation = "{ discovery = true or false, prefix = levels of a topic, devices = true or false, \
                    combined = [\"switch\", \"fan\"], page = URL }";
    KeyForm::new(notation, |reader, key| {
        reader.inner(key, HomeAssistantFile::read)
    })
}

fn broker_address() -> ValueKind<'static, BrokerAddress> {
    ValueKind::text()
        .and_then(|text| broker::parse(&text).map_err(WrongValue::from))
        .listed_as("\"mqtt://host:port\", \"mqtts://host:port\" or \"embedded\"")
}

fn version() -> ValueKind<'static, MqttVersion> {
    ValueKind::number(4..=5_u8).map(|version| match version {
        4 => MqttVersion::V4,
        _ => MqttVersion::V5,
    })
}

fn qos() -> ValueKind<'static, Qos> {
    ValueKind::number(0..=1_u8).map(|qos| match qos {
        0 => Qos::AtMostOnce,
        _ => Qos::AtLeastOnce,
    })
}

/// A number of kept changes: at most about ten megabytes.
fn kept_changes() -> ValueKind<'static, usize> {
    ValueKind::number(0..=100_000_u32).map(|count| count as usize)
}

/// The protocol uses whole seconds for this time.
fn keep_alive() -> ValueKind<'static, Duration> {
    let kind = ValueKind::duration(seconds(5)..=minutes(10));
    let notation = format!("{}, whole seconds", kind.notation());
    kind.and_then(|time| {
        if time.subsec_millis() == 0 {
            return Ok(time);
        }
        let what = "the protocol uses whole seconds for this time".to_owned();
        Err((what, format!("\"{}s\"", time.as_secs())).into())
    })
    .listed_as(notation)
}

fn variable() -> ValueKind<'static, String> {
    let fits = |text: &str| {
        text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && text
                .bytes()
                .all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
    };
    ValueKind::parsed("the name of an environment variable", move |text| {
        fits(text).then(|| text.to_owned())
    })
    .listed_as("name")
}

fn client_id() -> ValueKind<'static, String> {
    let fits = |text: &str| {
        (1..=MAX_BYTES).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_graphic())
    };
    let right = format!("1 to {MAX_BYTES} visible characters without blanks");
    ValueKind::parsed(right, move |text| fits(text).then(|| text.to_owned()))
}

/// One level of a topic.
fn level() -> ValueKind<'static, String> {
    ValueKind::parsed(
        "one level of a topic, without `/`, `+`, `#` or a first `$`: \"plant-a\"",
        |text| (is_topic(text) && !text.contains('/')).then(|| text.to_owned()),
    )
    .listed_as("one level of a topic")
}

/// The first levels of other topics.
fn topics() -> ValueKind<'static, String> {
    let right = "levels of a topic without `+`, `#`, a first `$`, or a slash at either end: \"vfd\", \"plant/vfd\"";
    ValueKind::parsed(right, |text| {
        let fits = is_topic(text) && text.split('/').all(|level| !level.is_empty());
        fits.then(|| text.to_owned())
    })
    .listed_as("levels of a topic")
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
    .listed_as("URL")
}

fn topic_or_none() -> ValueKind<'static, Option<String>> {
    ValueKind::parsed(
        "a topic without `+`, `#` or a first `$`, or \"\" for none",
        |text| match text {
            "" => Some(None),
            topic => is_topic(topic).then(|| Some(topic.to_owned())),
        },
    )
    .listed_as("topic, or \"\" for none")
}

/// One topic; not a filter, and not one of the broker's own.
fn is_topic(text: &str) -> bool {
    let is_wild = |c: char| matches!(c, '+' | '#') || c.is_control();
    (1..=MAX_BYTES).contains(&text.len()) && !text.contains(is_wild) && !text.starts_with('$')
}
