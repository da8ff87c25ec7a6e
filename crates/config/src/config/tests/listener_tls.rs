//! Modbus Security: files, roles, and what they mean beside the lists of networks.

use super::*;
use crate::domain::command::Rights;
use ipnet::IpNet;

const FILES: &str =
    "cert_file = '/tls/own.pem'\nkey_file = '/tls/own.key'\nclient_ca_file = '/tls/ca.pem'";
const OPERATOR: &str = "operator = ['write', 'stop'], viewer = []";

/// `CONTROLLED` with `keys` of its listener in the place of `write`, and TLS with these roles.
fn secured(keys: &str, roles: &str) -> String {
    let tls = format!("{keys}\n[modbus_tcp.tls]\n{FILES}\nroles = {{ {roles} }}\n");
    with(CONTROLLED, "write = [\"127.0.0.1/32\"]", &tls)
}

fn networks(texts: &[&str]) -> Vec<IpNet> {
    texts.iter().map(|text| text.parse().unwrap()).collect()
}

#[test]
fn roles_have_the_rights_that_are_listed() {
    let config = good(&secured(
        "",
        "operator = ['stop', 'write'], 'on call' = ['stop'], '' = []",
    ));
    let tls = config.listeners[0].tls.as_ref().unwrap();
    let roles: Vec<_> = tls
        .roles
        .iter()
        .map(|(name, rights)| (name.as_str(), rights.write, rights.stop))
        .collect();
    assert_eq!(
        roles,
        [
            ("", false, false),
            ("on call", false, true),
            ("operator", true, true)
        ]
    );
    assert_eq!(tls.roles[""], Rights::NONE);
    assert_eq!(tls.client_ca_file.to_str(), Some("/tls/ca.pem"));
}

#[test]
fn without_a_list_the_role_decides_alone() {
    let allow = "allow = ['10.0.0.0/24', '10.1.0.0/24']";
    for (keys, roles, write, stop) in [
        ("", OPERATOR, &["0.0.0.0/0", "::/0"][..], None),
        (allow, OPERATOR, &["10.0.0.0/24", "10.1.0.0/24"], None),
        (
            allow,
            "watchman = ['stop']",
            &["10.0.0.0/24", "10.1.0.0/24"],
            None,
        ),
        (allow, "viewer = []", &[], None),
        (
            "write = ['127.0.0.1/32']",
            OPERATOR,
            &["127.0.0.1/32"],
            None,
        ),
        (
            "write = []\nstop = ['127.0.0.1/32']",
            OPERATOR,
            &[],
            Some(&["127.0.0.1/32"][..]),
        ),
    ] {
        let text = secured(keys, roles);
        // Nobody commands where nobody may.
        let text = if write.is_empty() || !roles.contains("write") {
            from_mqtt(&text)
        } else {
            text
        };
        let text = if write.is_empty() || !roles.contains("write") {
            text.replace("'write', ", "")
        } else {
            text
        };
        let listener = &good(&text).listeners[0];
        assert_eq!(
            (&listener.write, &listener.stop),
            (&networks(write), &stop.map(networks)),
            "{keys} {roles}"
        );
    }
}

fn from_mqtt(text: &str) -> String {
    with(
        text,
        "from = [\"mqtt\", \"modbus-tcp\"]",
        "from = [\"mqtt\"]",
    )
}

#[test]
fn files_are_named_by_absolute_paths_and_none_is_missing() {
    let text = with(
        CONTROLLED,
        "[http]",
        "[modbus_tcp.tls]\ncert_file = 'own.pem'\n[http]",
    );
    let found = problems(&text);
    for what in [
        "modbus_tcp[0].tls.key_file: `key_file` is missing; an absolute path",
        "modbus_tcp[0].tls.client_ca_file: `client_ca_file` is missing; an absolute path",
        "modbus_tcp[0].tls.roles: `roles` is missing; a table `roles`",
    ] {
        assert!(found.iter().any(|it| it == what), "{what}: {found:?}");
    }
    assert!(
        found
            .iter()
            .any(|it| it.starts_with("modbus_tcp[0].tls.cert_file: ")),
        "{found:?}"
    );
    assert_eq!(found.len(), 4, "{found:?}");
}

#[test]
fn roles_that_make_no_sense_are_refused_all_at_once() {
    let text = secured(
        "",
        "a = ['write'], b = ['stop', 'stop'], c = ['run'], d = 'write'",
    );
    assert_eq!(
        problems(&text),
        [
            "modbus_tcp[0].tls.roles.a: role `a` may write but not stop: a client that may start must be allowed to stop; [\"write\", \"stop\"]",
            "modbus_tcp[0].tls.roles.b[1]: \"stop\" is listed twice; each once",
            "modbus_tcp[0].tls.roles.c[0]: `run` is not an allowed value; one of \"write\" (starts, sets and writes), \"stop\" (stops)",
            "modbus_tcp[0].tls.roles.d: must be a list, not text; a list, each one of \"write\" (starts, sets and writes), \"stop\" (stops)",
        ]
    );
}

#[test]
fn a_listener_without_a_role_serves_nobody() {
    let found = problems(&secured("write = ['127.0.0.1/32']", ""));
    assert_eq!(
        found,
        [
            "modbus_tcp[0].tls.roles: no role is listed, so no client is answered; \
          `roles = { operator = [\"write\", \"stop\"], viewer = [] }` with your own roles"
        ]
    );
}

#[test]
fn a_right_that_no_role_or_no_drive_can_use_is_refused() {
    only(
        &secured("write = ['127.0.0.1/32']", "watchman = ['stop']"),
        "modbus_tcp[0].write: has no effect: no role of `tls` may write; \"write\" in the `roles` of those who may, or leave it out",
    );
    let found = problems(&secured("", "watchman = ['stop']"));
    assert!(
        found[0].contains("commands from \"modbus-tcp\" are impossible"),
        "{found:?}"
    );
    let found = problems(&from_mqtt(&secured("", OPERATOR)));
    assert_eq!(
        found,
        [
            "modbus_tcp[0].tls.roles.operator[0]: has no effect: no drive that is served here takes commands from \"modbus-tcp\"; \
          `from = [\"modbus-tcp\"]` in the `[line.drive.control]` of a drive, or leave it out"
        ]
    );
    let found = problems(&from_mqtt(&secured("reads_renew = true", "viewer = []")));
    assert!(
        found[0].contains("has no effect: no client may write here, so there is no lease to renew"),
        "{found:?}"
    );
}

#[test]
fn anyone_who_may_start_may_stop_without_a_list_as_well() {
    only(
        &secured("allow = ['10.0.0.0/24']\nstop = ['10.0.0.0/25']", OPERATOR),
        "modbus_tcp[0].stop: without `write` all of 10.0.0.0/24 may write, and it is not in `stop`: a client that may start \
         must be allowed to stop; `write` with the networks that may, or leave `stop` out as well",
    );
    good(&secured(
        "allow = ['10.0.0.0/24']\nstop = ['10.0.0.0/24']",
        OPERATOR,
    ));
}

#[test]
fn others_are_kept_out_with_tls_too() {
    let found = problems(&with(
        &secured("", OPERATOR),
        "listen = \"127.0.0.1:1502\"",
        "listen = \"10.0.0.5:802\"",
    ));
    assert!(
        found[0].contains("10.0.0.5:802 can be reached from other hosts"),
        "{found:?}"
    );
}
