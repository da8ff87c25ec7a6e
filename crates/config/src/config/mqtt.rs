//! The broker connection: its ready settings, and rules between its keys.

use super::broker::BrokerAddress;
use super::client_ids;
use super::file::{ConfigFile, HomeAssistantFile, MqttDefaults, MqttFile, SparkplugFile};
use super::lists;
use super::ready::{
    BrokerCredentials, BrokerSettings, ClientCertificate, MqttSettings, PasswordSource, TlsSettings,
};
use super::words::CommandInterface;
use crate::domain::control::ControlSettings;
use crate::domain::problem::Problem;
use crate::north::broker::{MqttVersion, unnoticed};
use crate::north::mqtt::{LeaseMode, TopicTree};
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

/// The defaults for the drives of `file`.
pub(super) fn defaults(file: &ConfigFile) -> MqttDefaults {
    let mqtt = file.mqtt.valid().map(|mqtt| &mqtt.value);
    let least = mqtt
        .and_then(MqttFile::probe_interval)
        .map(least_restart_delay);
    let restart_delay = least
        .unwrap_or_default()
        .min(LONGEST_LEAST)
        .max(ControlSettings::RESTART_DELAY);
    MqttDefaults {
        lease: mqtt.and_then(MqttFile::lease).unwrap_or_default(),
        restart_delay,
    }
}

/// A path used for commands is probed often enough.
fn probed_often(file: &MqttFile, whole: &ConfigFile, problems: &mut Vec<Problem>) {
    let Some(interval) = file.probe_interval.valid() else {
        return;
    };
    let is_used = whole.controls().any(|it| it.by_broker().is_some());
    if least_restart_delay(interval.value) <= LONGEST_LEAST || !is_used {
        return;
    }
    let most = LONGEST_LEAST.saturating_sub(least_restart_delay(Duration::ZERO));
    let unnoticed = duration_text(unnoticed(interval.value));
    let longest = duration_text(LONGEST_LEAST);
    let what = format!(
        "a command could wait {unnoticed} at the broker before that is noticed, so no RUN could be \
         accepted for more than {longest} after a stop"
    );
    let right = format!("at most \"{}\"", duration_text(most));
    interval.refuse(what, right, problems);
}

/// What renews the leases of the drives: the session, if it renews that of any drive.
pub(super) fn session_lease(file: &ConfigFile, default: LeaseMode) -> LeaseMode {
    let of_mqtt = file
        .controls()
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
    // Announcements must not depend on which gateway makes them, and each has a page of its own.
    let has_page = whole.standby.is_absent();
    let home_assistant = file.home_assistant.settle(|it| {
        let page = it.page.clone().optional()?;
        it.settings(if has_page { page } else { None })
    })?;
    Some(MqttSettings {
        broker: broker(file)?,
        credentials: credentials(file)?,
        client_id: file.client_id.clone().optional()?,
        keep_alive: file.keep_alive()?,
        session: file.settings(lease, home_assistant)?,
        sparkplug: file.sparkplug.settle(SparkplugFile::settings)?,
    })
}

/// The nodes of a cluster are distinct and use the same scheme.
fn other_nodes(file: &MqttFile, problems: &mut Vec<Problem>) {
    let (Some(broker), Some(list)) = (&file.broker, file.also_at.valid()) else {
        return;
    };
    let only_one = "the embedded broker has only one node";
    for (index, node) in list.value.iter().enumerate() {
        let earlier = list.value.iter().take(index).chain([broker]);
        if broker.value == BrokerAddress::Embedded {
            let what = format!("has no effect: {only_one}");
            node.warn(what, "leave it out", problems);
        } else if node.value == BrokerAddress::Embedded {
            node.refuse(only_one, "leave it out", problems);
        } else if lists::has(earlier, &node.value) {
            node.warn("the node is listed twice", "leave it out", problems);
        } else if broker.value.is_tls() != node.value.is_tls() {
            let what = "the nodes of a broker are either all at mqtts:// or all at mqtt://";
            node.refuse(what, "as in `broker`", problems);
        }
    }
}

/// The session number must persist across restarts.
fn sparkplug_has_a_place(file: &ConfigFile, mqtt: &MqttFile, problems: &mut Vec<Problem>) {
    if let Some(sparkplug) = mqtt.sparkplug.valid()
        && file.gateway.data_dir.is_absent()
    {
        let what =
            "the number of each session, bdSeq, is kept in the data directory, and there is none";
        let right = "`data_dir` in `[gateway]`, or no `[mqtt.sparkplug]`";
        sparkplug.value.location.refuse(what, right, problems);
    }
}

fn broker(file: &MqttFile) -> Option<BrokerSettings> {
    Some(match file.broker.as_ref()?.value.clone() {
        BrokerAddress::Embedded => BrokerSettings::Embedded,
        BrokerAddress::Tcp { host, port, tls } => BrokerSettings::Tcp {
            also_at: also_at(file, (&host, port))?,
            host,
            port,
            tls: if tls { Some(tls_settings(file)?) } else { None },
        },
    })
}

/// The nodes of the broker's cluster besides `first`; `None` if the list is invalid, see `problems`.
fn also_at(file: &MqttFile, first: (&str, u16)) -> Option<Vec<(String, u16)>> {
    let mut nodes: Vec<(String, u16)> = Vec::new();
    for address in lists::values(&file.also_at)? {
        let BrokerAddress::Tcp { host, port, .. } = address else {
            return None;
        };
        let node = (host, port);
        if (node.0.as_str(), port) != first && !nodes.contains(&node) {
            nodes.push(node);
        }
    }
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
    let from_file = file.password_file.clone().optional()?;
    let from_env = file.password_env.clone().optional()?;
    let password = from_file.map(PasswordSource::File);
    let password = password.or(from_env.map(PasswordSource::Env));
    let user = file.user.clone().optional()?;
    Some(user.map(|user| BrokerCredentials { user, password }))
}

/// The keys that name a user or a password.
fn secrets(file: &MqttFile) -> impl Iterator<Item = &KeyLocation> {
    [
        file.user.location(),
        file.password_file.location(),
        file.password_env.location(),
    ]
    .into_iter()
    .flatten()
}

/// At most one source of a password, and only with a user.
fn password(file: &MqttFile, problems: &mut Vec<Problem>) {
    let from_file = file.password_file.location();
    let from_env = file.password_env.location();
    if let (Some(_), Some(from_env)) = (from_file, from_env) {
        let what = "the password is given twice: `password_file` is there as well";
        from_env.refuse(what, "one of the two", problems);
    }
    if let (Some(password), OptionalKey::Absent) = (from_file.or(from_env), &file.user) {
        let what = "a password belongs to a user, and `user` is left out";
        password.refuse(what, "add `user`", problems);
    }
}

/// A password is sent unencrypted over the network only if the file allows it explicitly.
fn plain_password(file: &MqttFile, problems: &mut Vec<Problem>) {
    let Some(broker) = &file.broker else { return };
    let others = file.also_at.valid().map_or(&[][..], |list| &list.value);
    let stays = |node: &LocatedValue<BrokerAddress>| node.value.is_tls() || node.value.is_local();
    let is_exposed = secrets(file).next().is_some() && !others.iter().chain([broker]).all(stays);
    if let Some(allowed) = file.allow_plain_password.valid_as(&true)
        && !is_exposed
    {
        let what = "has no effect: no user or password is sent unencrypted over the network";
        allowed.warn(what, "leave it out", problems);
    }
    if is_exposed && file.allow_plain_password() == Some(false) {
        let what = "user and password would be sent unencrypted over the network";
        let right = "`mqtts://`, or `allow_plain_password = true` on a network that you trust";
        broker.refuse(what, right, problems);
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
        if let (Some(location), OptionalKey::Absent) = (there.location(), other) {
            let what =
                format!("a client's certificate and its key go together: `{name}` is left out");
            location.refuse(what, "both or neither", problems);
        }
    }
    let Some(broker) = file.broker.as_ref().filter(|broker| !broker.value.is_tls()) else {
        return;
    };
    let right = match broker.value {
        BrokerAddress::Embedded => "leave it out",
        BrokerAddress::Tcp { .. } => "leave it out, or a broker at `mqtts://`",
    };
    let files: [&OptionalKey<PathBuf>; 3] = [&file.ca_file, cert, key];
    for location in files.into_iter().filter_map(OptionalKey::location) {
        let what = "the connection is not encrypted, so the file would not be used";
        location.refuse(what, right, problems);
    }
}

/// The embedded broker has no users.
fn embedded(file: &MqttFile, problems: &mut Vec<Problem>) {
    if matches!(&file.broker, Some(broker) if broker.value == BrokerAddress::Embedded) {
        for location in secrets(file) {
            let what = "the embedded broker has no users";
            location.refuse(what, "leave it out", problems);
        }
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
    let rest = prefix.value.strip_prefix(&own);
    if rest.is_some_and(|rest| rest.starts_with('/')) {
        let what = format!("`{}` lies among the gateway's own topics", prefix.value);
        let usual = HomeAssistantFile::default().prefix().unwrap_or_default();
        let right = format!(
            "the discovery prefix that Home Assistant is set to: \"{usual}\" unless it was changed there"
        );
        prefix.refuse(what, right, problems);
    }
}

/// Announced entities require published topics.
fn announced_is_published(file: &MqttFile, problems: &mut Vec<Problem>) {
    const NEEDED: [TopicTree; 4] = [
        TopicTree::State,
        TopicTree::Values,
        TopicTree::Line,
        TopicTree::Info,
    ];
    let (Some(home_assistant), Some(list)) = (file.home_assistant.valid(), file.publish.valid())
    else {
        return;
    };
    let discovery = home_assistant.value.discovery.as_ref();
    let is_announced = discovery.is_some_and(|discovery| discovery.value);
    let missing = NEEDED.iter().find(|tree| !lists::has(&list.value, *tree));
    if is_announced && let Some(tree) = missing {
        let what = format!(
            "Home Assistant would show entities of `{}`, which is not published",
            tree.keyword()
        );
        let all = NEEDED.map(|tree| format!("\"{}\"", tree.keyword()));
        let right = format!("a list with {}, or without discovery", all.join(", "));
        list.refuse(what, right, problems);
    }
}

/// Keys that have no effect in combination with others.
fn idle(file: &MqttFile, lease: LeaseMode, problems: &mut Vec<Problem>) {
    let topic = file.alive_topic.valid().filter(|it| it.value.is_some());
    if let (Some(topic), LeaseMode::Explicit) = (topic, lease) {
        let what = "has no effect: an explicit lease does not depend on a topic";
        topic.warn(what, "leave it out, or lease = \"session\"", problems);
    }
    if let (Some(prefix), Some(MqttVersion::V4)) = (file.response_prefix.valid(), file.version()) {
        let what = "has no effect: MQTT 3.1.1 has no response topics";
        prefix.warn(what, "leave it out, or version = 5", problems);
    }
}
