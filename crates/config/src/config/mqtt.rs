//! The broker connection: its ready settings, and rules between its keys.

use super::broker::BrokerAddress;
use super::client_ids;
use super::file::{ConfigFile, HomeAssistantFile, MqttFile};
use super::lists;
use super::ready::{
    BrokerCredentials, BrokerSettings, ClientCertificate, MqttSettings, PasswordSource,
    SparkplugSettings, TlsSettings,
};
use super::words::CommandInterface;
use crate::domain::control::ControlSettings;
use crate::domain::problem::Problem;
use crate::north::broker::{MqttVersion, unnoticed};
use crate::north::mqtt::{HomeAssistant, LeaseMode, Settings, TopicTree};
use crate::toml_file::values::duration_text;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
use std::path::PathBuf;
use std::time::Duration;

/// Margin by which `restart_delay` exceeds the longest unnoticed delay of a message, so that a delayed message is not
/// mistaken for one sent after a stop.
pub(super) const AFTER_UNNOTICED: Duration = Duration::from_secs(1);
/// Upper limit of the restart delay that rare probes of the path through the broker may require.
const LONGEST_LEAST: Duration = Duration::from_secs(5);

/// The shortest `restart_delay` if the path through the broker is probed every `probe_interval`.
pub(super) const fn least_restart_delay(probe_interval: Duration) -> Duration {
    unnoticed(probe_interval).saturating_add(AFTER_UNNOTICED)
}

/// Defaults that drives take from the section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct DriveDefaults {
    /// What renews a lease.
    pub lease: LeaseMode,
    /// How long plain RUN is refused after a stop.
    pub restart_delay: Duration,
}

impl Default for DriveDefaults {
    fn default() -> Self {
        Self {
            lease: LeaseMode::default(),
            restart_delay: ControlSettings::RESTART_DELAY,
        }
    }
}

/// The defaults for the drives of `file`.
pub(super) fn defaults(file: &ConfigFile) -> DriveDefaults {
    let mqtt = file.mqtt.valid().map(|mqtt| &mqtt.value);
    let least = mqtt
        .and_then(MqttFile::probe_interval)
        .map(least_restart_delay);
    let restart_delay = least
        .unwrap_or_default()
        .min(LONGEST_LEAST)
        .max(ControlSettings::RESTART_DELAY);
    DriveDefaults {
        lease: default_lease(file),
        restart_delay,
    }
}

/// A path used for commands is probed often enough.
pub(super) fn probed_often(file: &MqttFile, whole: &ConfigFile, problems: &mut Vec<Problem>) {
    let Some(LocatedValue {
        value: interval,
        location,
    }) = file.probe_interval.valid()
    else {
        return;
    };
    let controls = whole
        .lines
        .iter()
        .flat_map(|line| &line.drives)
        .filter_map(|drive| drive.control.valid());
    let mut by_broker = controls.filter(|it| {
        it.value
            .names(CommandInterface::Mqtt)
            .or(it.value.names(CommandInterface::Sparkplug))
            .is_some()
    });
    if least_restart_delay(*interval) <= LONGEST_LEAST || by_broker.next().is_none() {
        return;
    }
    let most = LONGEST_LEAST.saturating_sub(least_restart_delay(Duration::ZERO));
    let unnoticed = duration_text(unnoticed(*interval));
    let longest = duration_text(LONGEST_LEAST);
    let what = format!(
        "a command could wait {unnoticed} at the broker before that is noticed, so no RUN could be \
         accepted for more than {longest} after a stop"
    );
    problems.push(
        location
            .problem(what)
            .right(format!("at most \"{}\"", duration_text(most))),
    );
}

/// What renews an MQTT lease if a drive has no setting of its own.
fn default_lease(file: &ConfigFile) -> LeaseMode {
    let mqtt = file.mqtt.valid().map(|mqtt| &mqtt.value);
    mqtt.and_then(MqttFile::lease).unwrap_or_default()
}

/// What renews the leases of the drives: the session, if it renews that of any drive.
pub(super) fn session_lease(file: &ConfigFile, default: LeaseMode) -> LeaseMode {
    let controls = file
        .lines
        .iter()
        .flat_map(|line| &line.drives)
        .filter_map(|drive| drive.control.valid());
    let of_mqtt = controls
        .map(|control| &control.value)
        .filter(|control| control.names(CommandInterface::Mqtt).is_some());
    let leases: Vec<_> = of_mqtt
        .map(|control| control.lease.or(default).unwrap_or(default))
        .collect();
    match leases.is_empty() {
        true => default,
        false if leases.contains(&LeaseMode::Session) => LeaseMode::Session,
        false => LeaseMode::Explicit,
    }
}

/// The ready settings; `None` if it is invalid, see `problems`.
/// `lease` is what renews the leases of the drives.
pub(super) fn settle(
    file: &MqttFile,
    whole: &ConfigFile,
    lease: LeaseMode,
    problems: &mut Vec<Problem>,
) -> Option<MqttSettings> {
    other_nodes(file, problems);
    sparkplug_has_a_place(whole, file, problems);
    client_ids::are_distinct(whole, file, problems);
    password(file, problems);
    plain_password(file, problems);
    tls_files(file, problems);
    embedded(file, problems);
    idle(file, lease, problems);
    probed_often(file, whole, problems);
    if let OptionalKey::Valid(list) = &file.publish {
        lists::once(&list.value, problems);
    }
    discovery_prefix(file, problems);
    announced_is_published(file, problems);
    file.lease()?;
    Some(MqttSettings {
        broker: broker(file)?,
        credentials: credentials(file)?,
        client_id: file.client_id.clone().optional()?,
        keep_alive: file.keep_alive()?,
        session: session(file, whole, lease)?,
        sparkplug: sparkplug(file)?,
    })
}

/// What the session needs to know; `lease` is what renews the leases of the drives.
fn session(file: &MqttFile, whole: &ConfigFile, lease: LeaseMode) -> Option<Settings> {
    let alive_topic = file.alive_topic()?;
    let probe_interval = file.probe_interval()?;
    Some(Settings {
        prefix: file.prefix()?,
        version: file.version()?,
        heartbeat: file.heartbeat()?,
        subscription_qos: file.subscription_qos()?,
        lease,
        alive_topic: if lease == LeaseMode::Session {
            alive_topic
        } else {
            None
        },
        probe_interval,
        probe_timeout: probe_interval * MqttSettings::PROBES,
        command_ttl: file.command_ttl()?,
        response_prefix: file.response_prefix.clone().optional()?,
        keep_telemetry: file.keep_telemetry()?,
        publish: publish(file)?,
        home_assistant: home_assistant(file, whole)?,
    })
}

fn home_assistant(file: &MqttFile, whole: &ConfigFile) -> Option<Option<HomeAssistant>> {
    let Some(file) = file.home_assistant.clone().optional()? else {
        return Some(None);
    };
    Some(Some(HomeAssistant {
        discovery: file.discovery.as_ref()?.value,
        prefix: file.prefix()?,
        devices: file.devices()?,
        combined: lists::values(&file.combined)?,
        page: match whole.standby {
            OptionalKey::Absent => file.page.optional()?,
            // Announcements must not depend on which gateway makes them, and each has a page of its own.
            _ => None,
        },
    }))
}

fn sparkplug(file: &MqttFile) -> Option<Option<SparkplugSettings>> {
    let file = match &file.sparkplug {
        OptionalKey::Absent => return Some(None),
        OptionalKey::Invalid => return None,
        OptionalKey::Valid(sparkplug) => &sparkplug.value,
    };
    Some(Some(SparkplugSettings {
        group: file.group.as_ref()?.value.clone(),
        primary_host: file.primary_host.clone().optional()?,
        client_id: file.client_id.clone().optional()?,
        max_command_age: file.max_command_age()?,
        keep_telemetry: file.keep_telemetry()?,
    }))
}

/// The nodes of a cluster are distinct and use the same scheme.
fn other_nodes(file: &MqttFile, problems: &mut Vec<Problem>) {
    let (Some(broker), Some(list)) = (&file.broker, file.also_at.valid()) else {
        return;
    };
    for (index, node) in list.value.iter().enumerate() {
        let mut earlier = list.value.iter().take(index).chain([broker]);
        let problem = if broker.value == BrokerAddress::Embedded {
            node.location
                .problem("has no effect: the embedded broker has only one node")
                .right("leave it out")
                .warning()
        } else if node.value == BrokerAddress::Embedded {
            node.location
                .problem("the embedded broker has only one node")
                .right("leave it out")
        } else if earlier.any(|earlier| earlier.value == node.value) {
            node.location
                .problem("the node is listed twice")
                .right("leave it out")
                .warning()
        } else if broker.value.is_tls() != node.value.is_tls() {
            let problem = node
                .location
                .problem("the nodes of a broker are either all at mqtts:// or all at mqtt://");
            problem.right("as in `broker`")
        } else {
            continue;
        };
        problems.push(problem);
    }
}

/// The session number must persist across restarts.
fn sparkplug_has_a_place(file: &ConfigFile, mqtt: &MqttFile, problems: &mut Vec<Problem>) {
    let Some(sparkplug) = mqtt.sparkplug.valid() else {
        return;
    };
    if matches!(file.gateway.data_dir, OptionalKey::Absent) {
        let what =
            "the number of each session, bdSeq, is kept in the data directory, and there is none";
        let problem = sparkplug.value.location.problem(what);
        problems.push(problem.right("`data_dir` in `[gateway]`, or no `[mqtt.sparkplug]`"));
    }
}

/// What is published; `None` if it is invalid, see `problems`.
pub(super) fn publish(file: &MqttFile) -> Option<Vec<TopicTree>> {
    match &file.publish {
        OptionalKey::Absent => Some(TopicTree::ALL.to_vec()),
        list => lists::values(list),
    }
}

fn broker(file: &MqttFile) -> Option<BrokerSettings> {
    Some(match &file.broker.as_ref()?.value {
        BrokerAddress::Embedded => BrokerSettings::Embedded,
        BrokerAddress::Tcp { host, port, tls } => {
            let host = host.clone();
            let port = *port;
            let also_at = also_at(file)?;
            BrokerSettings::Tcp {
                host,
                port,
                also_at,
                tls: if *tls {
                    Some(tls_settings(file)?)
                } else {
                    None
                },
            }
        }
    })
}

/// The other nodes of the broker's cluster; `None` if the list is invalid, see `problems`.
fn also_at(file: &MqttFile) -> Option<Vec<(String, u16)>> {
    let location = |address| match address {
        BrokerAddress::Embedded => None,
        BrokerAddress::Tcp { host, port, .. } => Some((host, port)),
    };
    let mut nodes: Vec<(String, u16)> = lists::values(&file.also_at)?
        .into_iter()
        .map(location)
        .collect::<Option<_>>()?;
    let first = location(file.broker.as_ref()?.value.clone())?;
    let mut earlier = vec![first];
    nodes.retain(|node| {
        let is_new = !earlier.contains(node);
        earlier.push(node.clone());
        is_new
    });
    Some(nodes)
}

fn tls_settings(file: &MqttFile) -> Option<TlsSettings> {
    let cert_file = file.client_cert_file.clone().optional()?;
    let key_file = file.client_key_file.clone().optional()?;
    let client = cert_file
        .zip(key_file)
        .map(|(cert_file, key_file)| ClientCertificate {
            cert_file,
            key_file,
        });
    Some(TlsSettings {
        ca_file: file.ca_file.clone().optional()?,
        client,
    })
}

fn credentials(file: &MqttFile) -> Option<Option<BrokerCredentials>> {
    let from_file = file
        .password_file
        .clone()
        .optional()?
        .map(PasswordSource::File);
    let from_env = file
        .password_env
        .clone()
        .optional()?
        .map(PasswordSource::Env);
    let user = file.user.clone().optional()?;
    Some(user.map(|user| BrokerCredentials {
        user,
        password: from_file.or(from_env),
    }))
}

/// The location of a key that is present, valid or not.
fn location<T>(given: &OptionalKey<T>) -> Option<&KeyLocation> {
    given.valid().map(|written| &written.location)
}

/// At most one source of a password, and only with a user.
fn password(file: &MqttFile, problems: &mut Vec<Problem>) {
    let from_file = location(&file.password_file);
    let from_env = location(&file.password_env);
    if let (Some(_), Some(from_env)) = (from_file, from_env) {
        let problem =
            from_env.problem("the password is given twice: `password_file` is there as well");
        problems.push(problem.right("one of the two"));
    }
    if let (Some(password), OptionalKey::Absent) = (from_file.or(from_env), &file.user) {
        problems.push(
            password
                .problem("a password belongs to a user, and `user` is left out")
                .right("add `user`"),
        );
    }
}

/// A password is sent unencrypted over the network only if the file allows it explicitly.
fn plain_password(file: &MqttFile, problems: &mut Vec<Problem>) {
    let Some(broker) = &file.broker else { return };
    let secret = location(&file.user)
        .or(location(&file.password_file))
        .or(location(&file.password_env));
    let others = file.also_at.valid().map_or(&[][..], |list| &list.value);
    let stays = |node: &LocatedValue<BrokerAddress>| node.value.is_tls() || node.value.is_local();
    let is_exposed = secret.is_some() && !others.iter().chain([broker]).all(stays);
    if let OptionalKey::Valid(allowed) = &file.allow_plain_password
        && allowed.value
        && !is_exposed
    {
        let what = "has no effect: no user or password is sent unencrypted over the network";
        let problem = allowed.location.problem(what).right("leave it out");
        problems.push(problem.warning());
    }
    if is_exposed && file.allow_plain_password() == Some(false) {
        let problem = broker
            .location
            .problem("user and password would be sent unencrypted over the network");
        problems.push(
            problem
                .right("`mqtts://`, or `allow_plain_password = true` on a network that you trust"),
        );
    }
}

/// Files for TLS require TLS, and a certificate requires its key.
fn tls_files(file: &MqttFile, problems: &mut Vec<Problem>) {
    let cert = &file.client_cert_file;
    let key = &file.client_key_file;
    for (there, other, name) in [
        (cert, key, "client_key_file"),
        (key, cert, "client_cert_file"),
    ] {
        if let (Some(location), OptionalKey::Absent) = (location(there), other) {
            let problem = location.problem(format!(
                "a client's certificate and its key go together: `{name}` is left out"
            ));
            problems.push(problem.right("both or neither"));
        }
    }
    let Some(broker) = file.broker.as_ref().filter(|broker| !broker.value.is_tls()) else {
        return;
    };
    let is_embedded = broker.value == BrokerAddress::Embedded;
    let files: [&OptionalKey<PathBuf>; 3] = [&file.ca_file, cert, key];
    for location in files.into_iter().filter_map(location) {
        let problem =
            location.problem("the connection is not encrypted, so the file would not be used");
        problems.push(problem.right(if is_embedded {
            "leave it out"
        } else {
            "leave it out, or a broker at `mqtts://`"
        }));
    }
}

/// The embedded broker has no users.
fn embedded(file: &MqttFile, problems: &mut Vec<Problem>) {
    if file
        .broker
        .as_ref()
        .is_none_or(|broker| broker.value != BrokerAddress::Embedded)
    {
        return;
    }
    for location in [
        location(&file.user),
        location(&file.password_file),
        location(&file.password_env),
    ]
    .into_iter()
    .flatten()
    {
        problems.push(
            location
                .problem("the embedded broker has no users")
                .right("leave it out"),
        );
    }
}

/// Announcements, and Home Assistant's own status, must lie outside the gateway's topics.
fn discovery_prefix(file: &MqttFile, problems: &mut Vec<Problem>) {
    let Some(home_assistant) = file.home_assistant.valid() else {
        return;
    };
    let (Some(prefix), Some(own)) = (home_assistant.value.prefix.valid(), file.prefix()) else {
        return;
    };
    if prefix
        .value
        .strip_prefix(&own)
        .is_some_and(|rest| rest.starts_with('/'))
    {
        let problem = prefix.location.problem(format!(
            "`{}` lies among the gateway's own topics",
            prefix.value
        ));
        let usual = HomeAssistantFile::default().prefix().unwrap_or_default();
        problems.push(problem.right(format!(
            "the discovery prefix that Home Assistant is set to: \"{usual}\" unless it was changed there"
        )));
    }
}

/// Announced entities require published topics.
fn announced_is_published(file: &MqttFile, problems: &mut Vec<Problem>) {
    let (Some(home_assistant), Some(list)) = (file.home_assistant.valid(), file.publish.valid())
    else {
        return;
    };
    let is_announced = home_assistant
        .value
        .discovery
        .as_ref()
        .is_some_and(|discovery| discovery.value);
    let needed = [
        TopicTree::State,
        TopicTree::Values,
        TopicTree::Line,
        TopicTree::Info,
    ];
    let missing = needed
        .into_iter()
        .find(|tree| !list.value.iter().any(|listed| listed.value == *tree));
    if is_announced && let Some(tree) = missing {
        let what = format!(
            "Home Assistant would show entities of `{}`, which is not published",
            tree.keyword()
        );
        let all: Vec<_> = needed
            .iter()
            .map(|tree| format!("\"{}\"", tree.keyword()))
            .collect();
        problems.push(list.location.problem(what).right(format!(
            "a list with {}, or without discovery",
            all.join(", ")
        )));
    }
}

/// Keys that have no effect in combination with others.
fn idle(file: &MqttFile, lease: LeaseMode, problems: &mut Vec<Problem>) {
    let alive_topic = file
        .alive_topic
        .valid()
        .filter(|topic| topic.value.is_some());
    if let (Some(topic), LeaseMode::Explicit) = (alive_topic, lease) {
        let problem = topic
            .location
            .problem("has no effect: an explicit lease does not depend on a topic");
        problems.push(
            problem
                .right("leave it out, or lease = \"session\"")
                .warning(),
        );
    }
    if let (Some(prefix), Some(MqttVersion::V4)) = (location(&file.response_prefix), file.version())
    {
        let problem = prefix.problem("has no effect: MQTT 3.1.1 has no response topics");
        problems.push(problem.right("leave it out, or version = 5").warning());
    }
}
