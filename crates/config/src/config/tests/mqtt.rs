//! The broker connection: what it becomes, and each rule between its keys.

use super::*;
use crate::domain::ids::Name;
use crate::north::broker::{MqttVersion, Qos};
use crate::north::mqtt::LeaseMode;
use std::path::PathBuf;

fn mqtt(text: &str) -> MqttSettings {
    good(text).mqtt.unwrap()
}

/// `MINIMAL` with a broker on the network and `lines`.
fn over(broker: &str, lines: &str) -> String {
    format!("{MINIMAL}[mqtt]\nbroker = '{broker}'\n{lines}\n")
}

#[test]
fn a_broker_is_all_that_must_be_named() {
    let found = mqtt(&over("mqtt://broker", ""));
    assert_eq!(
        found.broker,
        BrokerSettings::Tcp {
            host: "broker".to_owned(),
            port: 1883,
            also_at: Vec::new(),
            tls: None
        }
    );
    assert_eq!(
        (
            found.credentials.clone(),
            found.client_id.clone(),
            found.session.version
        ),
        (None, None, MqttVersion::V5)
    );
    assert_eq!(
        (found.session.prefix.as_str(), found.session.lease),
        ("vfd", LeaseMode::Session)
    );
    assert_eq!(found.session.subscription_qos, Qos::AtLeastOnce);
    assert_eq!(
        (found.session.heartbeat, found.keep_alive),
        (Duration::from_secs(60), Duration::from_secs(15))
    );
    assert_eq!(
        (found.session.probe_interval, found.session.command_ttl),
        (Duration::from_secs(1), Duration::from_secs(1))
    );
    assert_eq!(found.session.home_assistant, None);
    assert_eq!(
        (
            found.session.alive_topic.as_deref(),
            &found.session.response_prefix,
            found.session.keep_telemetry
        ),
        (Some("homeassistant/status"), &None, 0)
    );
    let name = Name::new("plant-a").unwrap();
    assert_eq!(found.client_id(&name, None), "vfd-gateway-plant-a");
    assert_eq!(found.session.probe_timeout, Duration::from_secs(3));
    assert_eq!(good(MINIMAL).mqtt, None);
    only(
        &format!("{MINIMAL}[mqtt]"),
        "mqtt.broker: `broker` is missing; text, not empty",
    );
}

#[test]
fn everything_that_is_written_is_taken() {
    let found = mqtt(&over(
        "mqtts://[fd00::7]",
        "also_at = ['mqtts://node-2', 'mqtts://10.0.0.3:8884']\nsubscription_qos = 0\n\
         user = 'vfd'\npassword_file = '/run/secrets/mqtt'\nclient_id = 'gw'\nversion = 5\nprefix = 'plant/vfd'\n\
         heartbeat = '10s'\nkeep_alive = '30s'\nalive_topic = ''\nprobe_interval = '500ms'\ncommand_ttl = '2s'\n\
         response_prefix = 'scada/answers'\nkeep_telemetry = 100000\nca_file = '/etc/ca.pem'\nclient_cert_file = '/etc/gw.pem'\n\
         client_key_file = '/etc/gw.key'",
    ));
    let cert_file = PathBuf::from("/etc/gw.pem");
    let key_file = PathBuf::from("/etc/gw.key");
    let client = Some(ClientCertificate {
        cert_file,
        key_file,
    });
    let tls = Some(TlsSettings {
        ca_file: Some(PathBuf::from("/etc/ca.pem")),
        client,
    });
    let also_at = vec![("node-2".to_owned(), 8883), ("10.0.0.3".to_owned(), 8884)];
    assert_eq!(
        found.broker,
        BrokerSettings::Tcp {
            host: "fd00::7".to_owned(),
            port: 8883,
            also_at,
            tls
        }
    );
    assert_eq!(found.session.subscription_qos, Qos::AtMostOnce);
    assert_eq!(found.broker.to_string(), "mqtts://[fd00::7]:8883");
    let password = Some(PasswordSource::File(PathBuf::from("/run/secrets/mqtt")));
    assert_eq!(
        found.credentials,
        Some(BrokerCredentials {
            user: "vfd".to_owned(),
            password
        })
    );
    assert_eq!(
        (
            found.client_id(&Name::new("x").unwrap(), None).as_str(),
            found.session.alive_topic
        ),
        ("gw", None)
    );
    let explicit = mqtt(&over("embedded", "version = 4\nlease = 'explicit'"));
    assert_eq!(
        (explicit.broker, explicit.session.version),
        (BrokerSettings::Embedded, MqttVersion::V4)
    );
    assert_eq!(
        (explicit.session.lease, explicit.session.alive_topic),
        (LeaseMode::Explicit, None)
    );
    let from_env = mqtt(&over(
        "mqtt://localhost",
        "user = 'vfd'\npassword_env = 'MQTT_PASSWORD'",
    ));
    assert_eq!(
        from_env.credentials.unwrap().password,
        Some(PasswordSource::Env("MQTT_PASSWORD".to_owned()))
    );
}

#[test]
fn the_nodes_of_a_cluster_are_different_ones_and_reached_alike() {
    let twice = "the node is listed twice; leave it out";
    let embedded = "the embedded broker has only one node; leave it out";
    let mixed =
        "the nodes of a broker are either all at mqtts:// or all at mqtt://; as in `broker`";
    for (broker, node, problem) in [
        ("mqtts://a", "'mqtts://a:8883'", twice),
        ("mqtts://a", "'mqtt://b'", mixed),
        ("mqtt://a", "'mqtts://b'", mixed),
        ("mqtt://a", "'embedded'", embedded),
        (
            "embedded",
            "'mqtt://a'",
            "has no effect: the embedded broker has only one node; leave it out",
        ),
    ] {
        only(
            &over(broker, &format!("also_at = [{node}]")),
            &format!("mqtt.also_at[0]: {problem}"),
        );
    }
    only(
        &over("mqtt://a", "also_at = ['mqtt://b', 'mqtt://b']"),
        &format!("mqtt.also_at[1]: {twice}"),
    );
    let in_plain = "a user or a password must not be in the address; \
                    `user`, and `password_file` or `password_env`, beside it";
    only(
        &over("mqtt://a", "also_at = ['mqtt://vfd:secret@b']"),
        &format!("mqtt.also_at[0]: {in_plain}"),
    );
}

#[test]
fn a_password_is_as_secret_at_every_node() {
    let text = over("mqtt://localhost", "also_at = ['mqtt://b']\nuser = 'vfd'");
    let problem = "user and password would be sent unencrypted over the network; \
                   `mqtts://`, or `allow_plain_password = true` on a network that you trust";
    only(&text, &format!("mqtt.broker: {problem}"));
    good(&text.replace("user =", "allow_plain_password = true\nuser ="));
}

#[test]
fn a_broker_has_a_scheme_a_host_and_a_port() {
    let right = "\"mqtts://broker.example:8883\", \"mqtt://127.0.0.1:1883\", or \"embedded\" for trying out";
    for (broker, problem) in [
        (
            "broker:1883",
            format!("`broker:1883` is not the address of a broker; {right}"),
        ),
        (
            "embeded",
            "`embeded` is not the address of a broker; \"embedded\"".to_owned(),
        ),
        (
            "tcp://broker",
            format!("a broker over `tcp://` is not served; {right}"),
        ),
        (
            "mqtt://broker:0",
            format!("`mqtt://broker:0` has no usable port; {right}"),
        ),
        ("mqtt://", format!("`mqtt://` has no usable host; {right}")),
        (
            "mqtt://broker/vfd",
            format!("`mqtt://broker/vfd` has more than a host and a port; {right}"),
        ),
        (
            "mqtt://vfd:secret@broker",
            "a user or a password must not be in the address; \
             `user`, and `password_file` or `password_env`, beside it"
                .to_owned(),
        ),
    ] {
        only(&over(broker, ""), &format!("mqtt.broker: {problem}"));
    }
}

#[test]
fn a_password_never_stands_in_the_file() {
    let found = problems(&over("mqtts://broker", "user = 'vfd'\npassword = 'secret'"));
    assert_eq!(
        found,
        [
            "mqtt.password: a password must not be in this file, which others may read and copy; \
          `password_file` with an absolute path, or `password_env` with the name of an environment variable"
        ]
    );
    only(
        &over(
            "mqtts://broker",
            "user = 'vfd'\npassword_file = '/run/secrets/mqtt'\npassword_env = 'MQTT'",
        ),
        "mqtt.password_env: the password is given twice: `password_file` is there as well; one of \
         the two",
    );
    only(
        &over("mqtts://broker", "password_env = 'MQTT'"),
        "mqtt.password_env: a password belongs to a user, and `user` is left out; add `user`",
    );
    only(
        &over("mqtts://broker", "user = 'vfd'\npassword_env = '$MQTT'"),
        "mqtt.password_env: `***` is not valid; the name of an environment variable",
    );
    only(
        &over("mqtts://broker", "user = 'vfd'\npassword_file = 'mqtt'"),
        "mqtt.password_file: `***` is not valid; an absolute path",
    );
}

#[test]
fn a_password_in_plain_view_must_be_meant() {
    let exposed = "mqtt.broker: user and password would be sent unencrypted over the network; \
                   `mqtts://`, or `allow_plain_password = true` on a network that you trust";
    only(
        &over("mqtt://broker", "user = 'vfd'\npassword_env = 'MQTT'"),
        exposed,
    );
    only(
        &over(
            "mqtt://10.0.0.7",
            "user = 'vfd'\nallow_plain_password = false",
        ),
        exposed,
    );
    good(&over(
        "mqtt://broker",
        "user = 'vfd'\npassword_env = 'MQTT'\nallow_plain_password = true",
    ));
    good(&over(
        "mqtt://127.0.0.1",
        "user = 'vfd'\npassword_env = 'MQTT'",
    ));
    good(&over(
        "mqtts://broker",
        "user = 'vfd'\nallow_plain_password = false",
    ));
    for (broker, lines) in [
        ("mqtts://broker", "user = 'vfd'"),
        ("mqtt://[::1]", "user = 'vfd'"),
        ("mqtt://broker", ""),
    ] {
        only(
            &over(broker, &format!("{lines}\nallow_plain_password = true")),
            "mqtt.allow_plain_password: has no effect: no user or password is sent unencrypted over the \
             network; leave it out",
        );
    }
}

#[test]
fn files_for_tls_come_with_tls_and_in_pairs() {
    only(
        &over("mqtt://broker", "ca_file = '/etc/ca.pem'"),
        "mqtt.ca_file: the connection is not encrypted, so the file would not be used; \
         leave it out, or a broker at `mqtts://`",
    );
    only(
        &over("mqtts://broker", "client_cert_file = '/etc/gw.pem'"),
        "mqtt.client_cert_file: a client's certificate and its key go together: `client_key_file` is left out; \
         both or neither",
    );
    only(
        &over("mqtts://broker", "client_key_file = '/etc/gw.key'"),
        "mqtt.client_key_file: a client's certificate and its key go together: `client_cert_file` is left out; \
         both or neither",
    );
}

#[test]
fn the_embedded_broker_knows_nobody() {
    let at = |key: &str| format!("mqtt.{key}: the embedded broker has no users; leave it out");
    assert_eq!(
        problems(&over("embedded", "user = 'vfd'\npassword_env = 'MQTT'\nca_file = '/etc/ca.pem'")),
        [
            at("user"),
            at("password_env"),
            "mqtt.ca_file: the connection is not encrypted, so the file would not be used; leave it out".to_owned(),
        ]
    );
}

#[test]
fn a_key_that_another_makes_idle_is_refused() {
    only(
        &over(
            "mqtt://broker",
            "lease = 'explicit'\nalive_topic = 'homeassistant/status'",
        ),
        "mqtt.alive_topic: has no effect: an explicit lease does not depend on a topic; \
         leave it out, or lease = \"session\"",
    );
    only(
        &over("mqtt://broker", "version = 4\nresponse_prefix = 'scada'"),
        "mqtt.response_prefix: has no effect: MQTT 3.1.1 has no response topics; leave it out, or version = 5",
    );
}

#[test]
fn topics_are_topics() {
    let right = "levels of a topic without `+`, `#`, a first `$`, or a slash at either end: \"vfd\", \"plant/vfd\"";
    for wrong in [
        "", "/vfd", "vfd/", "a//b", "vfd/#", "+/vfd", "$SYS", "a\\tb",
    ] {
        for key in ["prefix", "response_prefix"] {
            let found = problems(&over("mqtt://broker", &format!("{key} = \"{wrong}\"")));
            assert!(found.len() == 1 && found[0].ends_with(right), "{found:?}");
        }
    }
    only(
        &over("mqtt://broker", "alive_topic = 'homeassistant/+'"),
        "mqtt.alive_topic: `homeassistant/+` is not valid; a topic without `+`, `#` or a first `$`, or \"\" for none",
    );
    only(
        &over("mqtt://broker", "client_id = 'a b'"),
        "mqtt.client_id: `a b` is not valid; 1 to 128 visible characters without blanks",
    );
}

#[test]
fn times_and_versions_stay_in_their_range() {
    for (line, problem) in [
        (
            "version = 3",
            "version: 3 is out of range; a whole number from 4 to 5",
        ),
        (
            "heartbeat = '500ms'",
            "heartbeat: 500ms is out of range; a time from \"1s\" to \"1h\"",
        ),
        (
            "keep_alive = '1s'",
            "keep_alive: 1s is out of range; a time from \"5s\" to \"10min\"",
        ),
        (
            "keep_alive = '5500ms'",
            "keep_alive: the protocol uses whole seconds for this time; \"5s\"",
        ),
        (
            "keep_telemetry = 100001",
            "keep_telemetry: 100001 is out of range; a whole number from 0 to 100000",
        ),
        (
            "probe_interval = '100ms'",
            "probe_interval: 100ms is out of range; a time from \"200ms\" to \"1min\"",
        ),
        (
            "command_ttl = '2min'",
            "command_ttl: 2min is out of range; a time from \"100ms\" to \"1min\"",
        ),
        (
            "lease = 'sesion'",
            "lease: `sesion` is not an allowed value; one of \"session\" (control lasts as long as the path through the broker), \
             \"explicit\" (control lasts only as long as it is renewed)",
        ),
        ("brocker = 1", "brocker: unknown key `brocker`; `broker`"),
    ] {
        only(&over("mqtt://broker", line), &format!("mqtt.{problem}"));
    }
}

proptest! {
    #[test]
    fn any_broker_is_shown_as_it_is_read(broker in "(mqtts?|tcp)://[a-z0-9.:@/\\[\\]-]{0,20}") {
        match load(&over(&broker, ""), &catalog()) {
            Ok(config) => {
                let shown = config.mqtt.unwrap().broker.to_string();
                prop_assert!(shown.starts_with(&broker), "{} {}", shown, broker);
                prop_assert_eq!(mqtt(&over(&shown, "")).broker.to_string(), shown);
            }
            Err(problems) => prop_assert!(problems.len() == 1 && problems[0].key == "mqtt.broker"),
        }
    }
}

#[test]
fn what_is_announced_to_home_assistant_is_published() {
    let with = |list: &str, discovery: bool| {
        let keys = format!("home_assistant = {{ discovery = {discovery} }}\npublish = {list}");
        over("embedded", &keys)
    };
    good(&with("['state', 'values', 'line', 'info']", true));
    good(&with("['state']", false));
    let found = problems(&with("['state', 'values', 'info']", true));
    let right = "a list with \"state\", \"values\", \"line\", \"info\", or without discovery";
    let what = "mqtt.publish: Home Assistant would show entities of `line`, which is not published";
    assert_eq!(found, [format!("{what}; {right}")]);
}

#[test]
fn discovery_by_home_assistant_is_taken_and_checked() {
    let found = |written: &str| {
        mqtt(&over("embedded", &format!("home_assistant = {written}")))
            .session
            .home_assistant
            .unwrap()
    };
    let plain = found("{ discovery = true }");
    assert_eq!(
        (plain.discovery, plain.prefix.as_str(), plain.devices),
        (true, "homeassistant", false)
    );
    let all = found("{ discovery = false, prefix = 'ha/new', devices = true }");
    assert_eq!(
        (all.discovery, all.prefix.as_str(), all.devices),
        (false, "ha/new", true)
    );
    let levels = "levels of a topic without `+`, `#`, a first `$`, or a slash at either end: \"vfd\", \"plant/vfd\"";
    for (written, problem) in [
        ("{}", "mqtt.home_assistant.discovery: `discovery` is missing; true or false".to_owned()),
        ("{ discovery = true, prefix = 'a/#' }", format!("mqtt.home_assistant.prefix: `a/#` is not valid; {levels}")),
        ("{ discovery = true, prefix = 'a/' }", format!("mqtt.home_assistant.prefix: `a/` is not valid; {levels}")),
        (
            "{ discovery = true, prefix = 'vfd/plant' }",
            "mqtt.home_assistant.prefix: `vfd/plant` lies among the gateway's own topics; the discovery prefix that Home \
             Assistant is set to: \"homeassistant\" unless it was changed there"
                .to_owned(),
        ),
    ] {
        only(&over("embedded", &format!("home_assistant = {written}")), &problem);
    }
    let two = problems(&over(
        "embedded",
        "home_assistant = { discovery = 1, device = true }",
    ));
    assert_eq!(two.len(), 2, "{two:?}");
}

const SPARKPLUG: &str = "[mqtt.sparkplug]\ngroup = 'hall 1'\n";

/// `over`, with a data directory.
fn kept(text: &str) -> String {
    format!(
        "[gateway]\ndata_dir = '/var/lib/vfd-gateway'\n{}",
        text.replacen("[gateway]\n", "", 1)
    )
}

#[test]
fn of_sparkplug_only_the_group_must_be_named() {
    let found = mqtt(&kept(&over("mqtt://broker", SPARKPLUG)));
    let sparkplug = found.sparkplug.clone().unwrap();
    assert_eq!(
        (
            sparkplug.group.as_str(),
            sparkplug.primary_host,
            sparkplug.client_id
        ),
        ("hall 1", None, None)
    );
    assert_eq!(
        (sparkplug.max_command_age, sparkplug.keep_telemetry),
        (Duration::from_secs(10), 10_000)
    );
    let name = Name::new("plant-a").unwrap();
    assert_eq!(
        found.sparkplug_client_id(&name),
        "vfd-gateway-plant-a-sparkplug"
    );
    let session = found.sparkplug_session(name.clone(), false).unwrap();
    assert_eq!(
        (session.node, session.probe_topic.as_str()),
        (name.clone(), "vfd/plant-a/sparkplug/probe")
    );
    assert_eq!(
        mqtt(&over("mqtt://broker", "")).sparkplug_session(name, false),
        None
    );
    only(
        &kept(&over("mqtt://broker", "[mqtt.sparkplug]\ngroup = 'a/b'")),
        "mqtt.sparkplug.group: `a/b` is not valid; one level of a topic, without `/`, `+`, `#` or a first `$`: \"plant-a\"",
    );
}

#[test]
fn sparkplug_needs_a_place_for_its_numbers_and_an_identifier_of_its_own() {
    only(
        &over("mqtt://broker", SPARKPLUG),
        "mqtt.sparkplug: the number of each session, bdSeq, is kept in the data directory, and there is none; `data_dir` in \
         `[gateway]`, or no `[mqtt.sparkplug]`",
    );
    only(
        &kept(&over(
            "mqtt://broker",
            &format!("client_id = 'a'\n{SPARKPLUG}client_id = 'a'"),
        )),
        "mqtt.sparkplug.client_id: the same as `client_id` in `[mqtt]`: the broker would close one \
         connection when the other opens; another one, or leave it out",
    );
}

#[test]
fn the_connections_of_a_pair_have_an_identifier_each_but_that_of_sparkplug() {
    let pair = |half: &str, partner: &str, mqtt: &str, sparkplug: &str| {
        let standby = format!(
            "[standby]\nhalf = '{half}'\npartner = '{partner}'\n[[line]]\nstandby = true\n"
        );
        let text = kept(&over(
            "mqtt://broker",
            &format!("{mqtt}{SPARKPLUG}{sparkplug}"),
        ));
        with(&text, "[[line]]\n", &standby)
    };
    let ended = "the broker would close one connection when the other opens";
    for (own, whose) in [("x-a", "a"), ("x-b", "b")] {
        only(
            &pair(
                "a",
                "b",
                "client_id = 'x'\n",
                &format!("client_id = '{own}'"),
            ),
            &format!(
                "mqtt.sparkplug.client_id: the gateway `{whose}` has this one for `[mqtt]`, with its `half` behind it: {ended}; \
                 another one, or leave it out"
            ),
        );
    }
    for (half, partner, key) in [("sparkplug", "b", "half"), ("a", "sparkplug", "partner")] {
        for (mqtt, id) in [
            ("client_id = 'x'\n", "x-sparkplug"),
            ("", "vfd-gateway-plant-a-sparkplug"),
        ] {
            let text = pair(half, partner, mqtt, "");
            let text = text.replace("[gateway]\n", "[gateway]\nname = 'plant-a'\n");
            only(
                &text,
                &format!(
                    "standby.{key}: `{id}` would be the identifier for `[mqtt]` and for Sparkplug: {ended}; another name, or \
                     `client_id` in `[mqtt.sparkplug]`"
                ),
            );
        }
    }
    // With a half behind it the one for MQTT differs, and nothing is wrong with these.
    good(&pair("a", "b", "client_id = 'x'\n", "client_id = 'x'"));
    good(&pair("a", "b", "client_id = 'x'\n", "client_id = 'x-c'"));
    good(&pair("a", "b", "", ""));
    // The name of the gateway stands in what is left out.
    let named = kept(&over(
        "mqtt://broker",
        &format!("{SPARKPLUG}client_id = 'vfd-gateway-plant-a'"),
    ));
    only(
        &named.replace("[gateway]\n", "[gateway]\nname = 'plant-a'\n"),
        &format!(
            "mqtt.sparkplug.client_id: the same as `client_id` in `[mqtt]`: {ended}; another one, or leave it out"
        ),
    );
}

#[test]
fn a_drive_that_a_host_commands_needs_a_sign_of_life_of_it() {
    let control = |from: &str, lease: &str| {
        format!(
            "[line.drive.control]\nfrom = [{from}]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\non_commander_lost = 'stop'\n\
             lost_after = '30s'\non_shutdown = 'stop'\n{lease}\n"
        )
    };
    let with = |control: &str, sparkplug: &str| {
        kept(&format!(
            "{MINIMAL}{control}[mqtt]\nbroker = 'mqtt://broker'\n{sparkplug}\n"
        ))
    };
    only(
        &with(&control("'sparkplug'", ""), ""),
        "line[0].drive[0].control.from[0]: commands from \"sparkplug\" are impossible: there is no `[mqtt.sparkplug]`; \
         `[mqtt.sparkplug]` with `group` and `primary_host`, or leave it out",
    );
    only(
        &with(&control("'sparkplug'", ""), SPARKPLUG),
        "line[0].drive[0].control.from[0]: a session lease of a Sparkplug host lasts while it is online, and no host is \
         named; `primary_host` in `[mqtt.sparkplug]`, or lease = \"explicit\"",
    );
    let by_itself = good(&with(
        &control("'sparkplug'", "lease = 'explicit'"),
        SPARKPLUG,
    ));
    let hosted = good(&with(
        &control("'mqtt', 'sparkplug'", ""),
        &format!("{SPARKPLUG}primary_host = 'scada'"),
    ));
    for config in [by_itself, hosted] {
        assert!(
            config.lines[0].drives[0]
                .control
                .as_ref()
                .unwrap()
                .from_sparkplug
        );
    }
}
