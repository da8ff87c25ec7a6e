//! The HTTP listener: who reaches it, by which names, and who may sign in there.

use super::*;
use crate::config::{HashSource, HttpSettings, PageViewers};
use crate::domain::ids::Name;
use crate::north::operator::rights::{UserRights, UserRole};
use std::path::PathBuf;

/// Of "correct horse".
const HASH: &str = "$argon2id$v=19$m=19456,t=2,p=1$c2FsdHNhbHRzYWx0c2FsdA$AdweBLwcflnNX2HVW8i1Mtu7frrn4Ki7h/rYSGuU7Is";

/// `CONTROLLED` with a drive that is commanded from the page too, and `http` instead of its HTTP listener.
fn with_http(http: &str) -> String {
    let text = with(CONTROLLED, "\"modbus-tcp\"]", "\"modbus-tcp\", \"page\"]");
    with(
        &text,
        "[http]\nlisten = \"127.0.0.1:8080\"\n",
        &format!("[http]\n{http}\n"),
    )
}

/// `CONTROLLED` with a drive that is commanded from the page too, and an HTTP listener on loopback with one user, whose
/// keys are `user`.
fn with_user(user: &str) -> String {
    with_http(&format!(
        "listen = '127.0.0.1:8080'\n[[http.users]]\n{user}"
    ))
}

fn http(text: &str) -> HttpSettings {
    good(text).http.unwrap()
}

fn anna() -> String {
    format!("name = 'anna'\npassword_hash = '{HASH}'")
}

#[test]
fn without_users_the_page_only_shows() {
    let found = http(CONTROLLED);
    assert_eq!(
        (found.listen.port(), found.allow, found.hosts),
        (8080, None, Vec::new())
    );
    assert_eq!((found.users, found.tls), (Vec::new(), None));
    assert!(
        !good(CONTROLLED).lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .from_page
    );
}

#[test]
fn who_may_sign_in_is_listed() {
    let text = with_user(&format!(
        "{}\n[[http.users]]\nname = 'bob'\npassword_hash_file = '/etc/bob'",
        anna()
    ));
    let found = http(&text).users;
    let names: Vec<_> = found.iter().map(|user| user.name.to_string()).collect();
    assert_eq!(names, ["anna", "bob"]);
    assert!(matches!(&found[0].hash, HashSource::Text(hash) if hash.as_str() == HASH));
    assert_eq!(found[1].hash, HashSource::File(PathBuf::from("/etc/bob")));
    assert!(
        good(&text).lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .from_page
    );
    let short = format!(
        "listen = '127.0.0.1:8080'\nusers = [{{ name = 'anna', password_hash = '{HASH}' }}]"
    );
    assert_eq!(http(&with_http(&short)).users[0], found[0]);
}

#[test]
fn anyone_who_is_elsewhere_is_let_in_by_name_and_signs_in_through_tls() {
    let tls = "[http.tls]\ncert_file = '/tls/cert.pem'\nkey_file = '/tls/key.pem'";
    let text = |listen: &str, more: &str| with_http(&format!("listen = '{listen}'\n{more}"));
    let user = format!("[[http.users]]\n{}", anna());
    let found = http(&text(
        "0.0.0.0:8443",
        &format!("allow = ['10.0.0.0/24']\nhosts = ['GW.plant.example']\n{user}\n{tls}"),
    ));
    assert_eq!(found.hosts, ["gw.plant.example"]);
    assert_eq!(found.tls.unwrap().key_file, PathBuf::from("/tls/key.pem"));
    assert_eq!(
        problems(&text("0.0.0.0:8080", &user)),
        [
            "http.allow: 0.0.0.0:8080 can be reached from other hosts, and `allow` does not restrict them; \
             allow = [\"10.0.0.0/24\"] with your own networks, or a loopback address",
            "http.tls: 0.0.0.0:8080 can be reached from other hosts, and passwords would be sent unencrypted; \
             `[http.tls]` with `cert_file` and `key_file`, or a loopback address, or no `users`",
        ]
    );
    // Whoever only looks needs none.
    let read_only = format!("{MINIMAL}[http]\nlisten = '0.0.0.0:8080'\nallow = ['10.0.0.0/24']\n");
    assert_eq!(http(&read_only).allow.unwrap().len(), 1);
    assert!(http(&format!("{read_only}{tls}")).tls.is_some());
    only(
        &text("127.0.0.1:8080", &format!("allow = []\n{user}")),
        "http.allow: an empty list allows no client; networks as \"10.0.0.0/24\", or no listener at all",
    );
}

#[test]
fn a_user_has_one_password_that_is_kept_well() {
    let needed = "`password_hash_file` with the file that holds what `vfd-gateway password` prints, or `password_hash` with that itself";
    only(
        &with_user("name = 'anna'"),
        &format!("http.users[0].password_hash_file: the user has no password; {needed}"),
    );
    only(
        &with_user(&format!("{}\npassword_hash_file = '/etc/anna'", anna())),
        &format!(
            "http.users[0].password_hash_file: the user has a `password_hash` already; {needed}"
        ),
    );
    let reported = problems(&with_user("name = 'anna'\npassword_hash = 'correct horse'"));
    assert_eq!(
        reported,
        [
            "http.users[0].password_hash: the text is no hash in the PHC format; what `vfd-gateway password` prints"
        ],
        "it is not repeated"
    );
    let weak = problems(&with_user(&anna().replace("m=19456", "m=1024")));
    assert!(
        weak[0].contains("the text m = 1024 is out of range (19456 to 65536)"),
        "{weak:?}"
    );
}

#[test]
fn names_of_users_and_hosts_are_names() {
    let two = format!("{}\n[[http.users]]\n{}", anna(), anna());
    only(
        &with_user(&two),
        "http.users[1].name: the name `anna` is taken by http.users[0].name; a name that no other user uses",
    );
    assert!(
        problems(&with_user(&anna().replace("anna", "anna smith")))[0]
            .starts_with("http.users[0].name: ")
    );
    for wrong in ["gw:8080", "http://gw", "a b"] {
        only(
            &with_http(&format!(
                "listen = '127.0.0.1:8080'\nhosts = ['{wrong}']\n[[http.users]]\n{}",
                anna()
            )),
            &format!(
                "http.hosts[0]: `{wrong}` is not a host name; a name without a port, as \"gateway.plant.example\""
            ),
        );
    }
    let all: String = (0..65)
        .map(|number| format!("[[http.users]]\nname = 'u{number}'\npassword_hash = '{HASH}'\n"))
        .collect();
    only(
        &with_http(&format!("listen = '127.0.0.1:8080'\n{all}")),
        "http.users[64]: there are too many users; at most 64",
    );
}

#[test]
fn users_and_drives_go_together() {
    only(
        &with_http("listen = '127.0.0.1:8080'"),
        "line[0].drive[0].control.from[2]: commands from \"page\" are impossible: no user can sign in there; \
         `[[http.users]]` with `name` and `password_hash_file`, or leave it out",
    );
    only(
        &format!("{CONTROLLED}[[http.users]]\n{}\n", anna()),
        "http.users[0]: has no effect: no drive takes commands from \"page\"; \
         `from = [\"page\"]` in the `[line.drive.control]` of a drive, or no `users`",
    );
}

#[test]
fn a_user_has_a_role_and_groups_that_exist() {
    let found = http(&with_user(&anna()));
    assert_eq!(found.view, PageViewers::Anyone);
    assert_eq!(
        found.users[0].rights,
        UserRights {
            role: UserRole::Maintain,
            groups: None
        }
    );
    let of = |more: &str| {
        with(
            &with_user(&format!("{}\n{more}", anna())),
            "station = 1\n",
            "station = 1\ngroup = 'water'\n",
        )
    };
    let rights = http(&of("role = 'operate'\ngroups = ['water']")).users[0]
        .rights
        .clone();
    assert_eq!(
        rights,
        UserRights {
            role: UserRole::Operate,
            groups: Some([Name::new("water").unwrap()].into())
        }
    );
    let wrong = problems(&of("role = 'admin'\ngroups = ['air']"));
    assert!(
        wrong
            .iter()
            .any(|it| it.contains("`admin` is not an allowed value")),
        "{wrong:?}"
    );
    assert!(
        wrong
            .iter()
            .any(|it| it.contains("no drive is in the group `air`") && it.contains("\"water\"")),
        "{wrong:?}"
    );
    let nobody = problems(&with_http("listen = '127.0.0.1:8080'\nview = 'signed-in'"));
    assert!(
        nobody.iter().any(|it| it.contains("no one can sign in")),
        "{nobody:?}"
    );
}

#[test]
fn set_up_in_the_page_needs_a_user_with_the_role_for_it_and_the_other_way_round() {
    let text = |setup: &str, role: &str| {
        with_http(&format!(
            "listen = '127.0.0.1:8080'\n{setup}\n[[http.users]]\n{}\n{role}",
            anna()
        ))
    };
    let found = http(&text("setup = true", "role = 'setup'"));
    assert!(found.setup && found.users[0].rights.may_set_up());
    assert!(!http(&text("", "role = 'maintain'")).setup);
    let problems = problems(&text("setup = true", "role = 'maintain'"));
    assert!(
        problems
            .iter()
            .any(|it| it.contains("http.setup") && it.contains("no user may set up")),
        "{problems:?}"
    );
    let warnings = good(&text("", "role = 'setup'")).warnings;
    assert!(
        warnings.iter().any(|it| it.key == "http.users[0].role"),
        "{warnings:?}"
    );
}

#[test]
fn a_gateway_without_a_line_is_there_to_be_set_up() {
    let text = format!(
        "[http]\nlisten = '127.0.0.1:8080'\nsetup = true\n[[http.users]]\n{}\nrole = 'setup'",
        anna()
    );
    assert!(
        good(&text).lines.is_empty() && good(&text).warnings.is_empty(),
        "{:?}",
        good(&text).warnings
    );
}
