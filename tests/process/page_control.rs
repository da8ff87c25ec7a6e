//! Control from the page: nothing without users; who signs in commands under a name of their own, as the guard allows; and
//! when the page is gone, the drive does what was declared.

use super::browser::Browser;
use super::half_open::Relay;
use super::outsiders::make_certificates;
use super::plant::{FREQUENCY, LOST_AFTER, MARGIN, Plant, RUN, Wish};
use super::raw::Raw;
use super::rig::{self, program, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::thread::sleep;
use std::time::{Duration, Instant};
use vfd_gateway::daemon::host::pty::Pty;

pub const PASSWORD: &str = "correct horse";
/// Longer than an order may be on its way.
const STALL: Duration = Duration::from_secs(2);

/// The hash of the password, as the program makes it.
pub fn hash() -> &'static str {
    static HASH: OnceLock<String> = OnceLock::new();
    HASH.get_or_init(|| {
        let mut child = program()
            .arg("password")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        writeln!(child.stdin.take().unwrap(), "{PASSWORD}").unwrap();
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success());
        let hash = String::from_utf8(output.stdout).unwrap();
        assert!(
            hash.starts_with("$argon2id$v=19$m=19456,t=2,p=1$") && hash.ends_with('\n'),
            "{hash}"
        );
        hash.trim().to_owned()
    })
}

pub fn users() -> String {
    let user = |name| {
        format!(
            "[[http.users]]\nname = \"{name}\"\npassword_hash = \"{}\"\n",
            hash()
        )
    };
    user("anna") + &user("bob")
}

/// A plant whose drive anna and bob may command, with `more` keys of its control section.
fn plant_with(more: &str, lost_after: &str) -> Plant {
    Plant::with(Wish {
        page: &users(),
        control: more,
        lost_after,
        ..Wish::default()
    })
}

/// Somebody who has signed in.
fn signed_in(plant: &Plant, user: &str) -> Browser {
    let mut browser = Browser::new(plant.http);
    assert_eq!(browser.sign_in(user, PASSWORD).status, 200);
    browser
}

/// Has the drive started by `browser`.
fn start(plant: &Plant, browser: &Browser) {
    let answer = browser
        .command(&json!({ "run": "forward", "frequency_hz": 30 }))
        .json();
    assert!(
        answer["outcome"] == "confirmed" || answer["outcome"] == "acknowledged",
        "{answer}"
    );
    plant.wait_until_it_turns();
}

fn audit(plant: &Plant) -> Vec<Value> {
    let data = plant.place.file("data");
    let args = [
        "journal",
        "audit",
        "--data-dir",
        data.to_str().unwrap(),
        "--json",
        "--last",
        "1000",
    ];
    let said = vfd_gateway(&args);
    String::from_utf8(said.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// Whether a row of the audit has all of these words.
fn has_row(rows: &[Value], words: &[&str]) -> bool {
    rows.iter()
        .map(Value::to_string)
        .any(|row| words.iter().all(|word| row.contains(word)))
}

#[test]
fn of_what_the_page_sent_while_the_gateway_stood_still_only_a_stop_is_carried_out() {
    let plant = plant_with("", "60s");
    let mut anna = signed_in(&plant, "anna");
    start(&plant, &anna);
    let seen = plant.written().len();
    anna.moment = anna.newest_moment();
    let [faster] =
        plant.while_it_stands_still([&mut || anna.command(&json!({ "frequency_hz": 44 })).json()]);
    assert_eq!(
        (&faster["outcome"], &faster["reason"]),
        (&json!("refused"), &json!("stale")),
        "{faster}"
    );
    let [stop] =
        plant.while_it_stands_still([&mut || anna.command(&json!({ "run": "stop" })).json()]);
    assert_ne!(stop["outcome"], "refused", "{stop}");
    plant.wait_until_it_stands();
    assert!(
        plant.written()[seen..].iter().all(|it| *it == (RUN, 0)),
        "{:?}",
        &plant.written()[seen..]
    );
}

#[test]
fn of_what_waited_between_page_and_gateway_only_a_stop_is_carried_out() {
    let plant = plant_with("", "60s");
    let relay = Relay::default();
    let way = SocketAddr::from((Ipv4Addr::LOCALHOST, relay.start(plant.http.port())));
    let mut anna = Browser::new(way);
    assert_eq!(anna.sign_in("anna", PASSWORD).status, 200);
    start(&plant, &anna);
    let seen = plant.written().len();
    let mut delayed = |body: Value| {
        anna.moment = anna.newest_moment();
        relay.hold(true);
        let held = Instant::now();
        std::thread::scope(|scope| {
            let asked = scope.spawn(|| anna.command(&body).json());
            until("it has waited for long enough", PATIENCE, || {
                (held.elapsed() > STALL).then_some(())
            });
            relay.hold(false);
            asked.join().unwrap()
        })
    };
    let faster = delayed(json!({ "frequency_hz": 44 }));
    assert_eq!(
        (&faster["outcome"], &faster["reason"]),
        (&json!("refused"), &json!("stale")),
        "{faster}"
    );
    assert!(
        faster["message"]
            .as_str()
            .unwrap()
            .contains("may have waited for"),
        "{faster}"
    );
    assert_eq!(plant.written().len(), seen);
    let stop = delayed(json!({ "run": "stop" }));
    assert_ne!(stop["outcome"], "refused", "{stop}");
    plant.wait_until_it_stands();
    assert_eq!(delayed(json!({ "run": "forward" }))["reason"], "stale");
    assert!(
        plant.written()[seen..].iter().all(|it| *it == (RUN, 0)),
        "{:?}",
        &plant.written()[seen..]
    );
    until("the journal has kept what was refused", PATIENCE, || {
        has_row(&audit(&plant), &["page anna", "stale"]).then_some(())
    });
}

#[test]
fn without_users_the_page_commands_nothing() {
    let plant = Plant::new();
    let mut browser = Browser::new(plant.http);
    let session = browser.get("/api/v1/session");
    let moment = session.json()["moment"].clone();
    assert_eq!(
        session.json(),
        json!({ "enabled": false, "private": false, "user": null, "token": null, "moment": moment })
    );
    for (name, value) in [
        ("cache-control", "no-store"),
        ("x-content-type-options", "nosniff"),
        ("referrer-policy", "no-referrer"),
    ] {
        assert_eq!(session.header(name), Some(value), "{}", session.head);
    }
    let policy = session.header("content-security-policy").unwrap();
    assert!(
        policy.contains("default-src 'self'") && policy.contains("frame-ancestors 'none'"),
        "{policy}"
    );
    assert_eq!(browser.sign_in("anna", PASSWORD).status, 403);
    browser.cookie = format!("vfd_session={}", "0".repeat(64));
    for path in [
        "/api/v1/drives/pump-1/command",
        "/api/v1/drives/pump-1/lease",
        "/api/v1/stop",
        "/api/v1/diagnostics",
    ] {
        assert_eq!(
            browser.post(path, &json!({ "run": "forward" })).status,
            403,
            "{path}"
        );
        assert_eq!(browser.get(path).status, 405, "{path}");
    }
    plant.assert_nothing_was_written_since(0);
}

#[test]
fn who_signs_in_commands_under_a_name_of_their_own() {
    let plant = plant_with("", "20s");
    let mut anna = Browser::new(plant.http);
    for (user, password) in [("anna", "wrong horse"), ("nobody", PASSWORD)] {
        assert_eq!(anna.sign_in(user, password).status, 401, "{user}");
    }
    let answer = anna.sign_in("anna", PASSWORD);
    assert_eq!(
        (answer.status, answer.json()["user"].as_str()),
        (200, Some("anna"))
    );
    let cookie = answer.header("set-cookie").unwrap();
    assert!(
        cookie.ends_with("; HttpOnly; SameSite=Strict; Path=/"),
        "{cookie}"
    );
    let session = anna.get("/api/v1/session").json();
    let moment = session["moment"].as_str().unwrap();
    let mut right = json!({ "enabled": true, "private": false, "user": "anna", "role": "maintain", "groups": null, "setup": false });
    right["token"] = anna.token.as_str().into();
    right["moment"] = moment.into();
    assert_eq!(session, right);
    refused_on_the_way(&plant, &anna);

    start(&plant, &anna);
    let seen = plant.written().len();
    assert!(
        plant.written().ends_with(&[(FREQUENCY, 3000), (RUN, 1)]),
        "{:X?}",
        plant.written()
    );
    let bob = signed_in(&plant, "bob");
    let refused = bob.command(&json!({ "frequency_hz": 20 }));
    assert_eq!(refused.status, 200);
    let refused = refused.json();
    assert_eq!(
        (&refused["outcome"], &refused["reason"]),
        (&json!("refused"), &json!("other_owner"))
    );
    assert_eq!(refused["message"], "page anna holds control of the drive");
    assert_eq!(refused["holder"], "page anna");
    assert_eq!(
        bob.post("/api/v1/drives/pump-1/lease", &json!({})).status,
        409,
        "it is not his"
    );
    let taken = bob
        .command(&json!({ "frequency_hz": 20, "take": true }))
        .json();
    assert_eq!(
        taken["reason"], "no_take",
        "the drive does not allow that: {taken}"
    );
    assert_eq!(
        plant.written().len(),
        seen,
        "nothing of that has reached the line"
    );

    // Whoever is signed in stops it, whoever holds control.
    let stopped = bob.command(&json!({ "run": "stop" })).json();
    assert!(
        stopped["outcome"] == "confirmed" || stopped["outcome"] == "acknowledged",
        "{stopped}"
    );
    plant.wait_until_it_stands();
    assert_eq!(plant.written()[seen], (RUN, 0));

    assert_eq!(anna.ask("DELETE", "/api/v1/session", "").status, 204);
    assert_eq!(anna.command(&json!({ "run": "forward" })).status, 401);
    assert_eq!(anna.get("/api/v1/session").json()["user"], Value::Null);
    let rows = until("the journal has kept everything", PATIENCE, || {
        Some(audit(&plant)).filter(|rows| has_row(rows, &["page bob", "stop", "ed\""]))
    });
    for words in [
        &["page anna", "run forward", "ed\""][..],
        &["page bob", "other_owner", "\"holder\":\"page anna\""],
        &["page bob", "no_take"],
        &["page anna", "not_understood", "speed"],
    ] {
        assert!(has_row(&rows, words), "{words:?} in {rows:#?}");
    }
}

/// What is refused before the guard sees it, or because it is no command.
fn refused_on_the_way(plant: &Plant, anna: &Browser) {
    let run = json!({ "run": "forward", "frequency_hz": 30 });
    let status = |browser: &Browser| browser.command(&run).status;
    let with = |change: &dyn Fn(&mut Browser)| {
        let mut browser = anna.clone();
        change(&mut browser);
        status(&browser)
    };
    assert_eq!(with(&|it| it.token.clear()), 403, "no token");
    assert_eq!(with(&|it| it.token = "0".repeat(64)), 403, "another token");
    assert_eq!(with(&|it| it.cookie.clear()), 401, "no session");
    assert_eq!(
        with(&|it| it.cookie = format!("vfd_session={}", "0".repeat(64))),
        401,
        "no session of ours"
    );
    for origin in ["http://evil.example", "null", "http://127.0.0.1:1"] {
        assert_eq!(
            with(&|it| it.origin = Some(origin.to_owned())),
            403,
            "{origin}"
        );
    }
    assert_eq!(
        with(&|it| it.host = "evil.example".to_owned()),
        421,
        "a name that somebody made to lead here"
    );
    for kind in ["text/plain", "application/x-www-form-urlencoded"] {
        assert_eq!(with(&|it| it.content_type = kind.to_owned()), 415, "{kind}");
    }
    let mut elsewhere = Browser::new(plant.http);
    elsewhere.origin = Some("http://evil.example".to_owned());
    assert_eq!(elsewhere.sign_in("anna", PASSWORD).status, 403);
    for (body, error) in [
        (json!({}), "orders nothing"),
        (json!({ "speed": 3 }), "`speed` is unknown"),
        (json!({ "run": "go" }), "`go` is not valid here"),
        (
            json!({ "run": "forward", "reset": true }),
            "`reset` stands alone",
        ),
    ] {
        let answer = anna.command(&body);
        let text = answer.json()["error"].as_str().unwrap().to_owned();
        assert!(answer.status == 400 && text.contains(error), "{text}");
    }
    assert_eq!(
        anna.ask("POST", "/api/v1/drives/pump-1/command", &"x".repeat(5000))
            .status,
        413
    );
    let unknown = anna.post("/api/v1/drives/pump-9/command", &run);
    assert_eq!(
        (unknown.status, &unknown.json()["drives"]),
        (404, &json!(["pump-1"]))
    );
    assert_eq!(plant.written(), [], "nothing of that has reached the line");
}

#[test]
fn control_is_taken_over_where_that_is_allowed() {
    let plant = plant_with("allow_take = true\n", "20s");
    let (anna, bob) = (signed_in(&plant, "anna"), signed_in(&plant, "bob"));
    start(&plant, &anna);
    let taken = bob
        .command(&json!({ "take": true, "frequency_hz": 20 }))
        .json();
    assert!(
        taken["outcome"] == "confirmed" || taken["outcome"] == "acknowledged",
        "{taken}"
    );
    assert_eq!(plant.written().last(), Some(&(FREQUENCY, 2000)));
    assert_eq!(
        anna.command(&json!({ "frequency_hz": 25 })).json()["holder"],
        "page bob"
    );
}

#[test]
fn the_drive_stops_when_the_page_is_gone_and_not_before() {
    let plant = plant_with("", "");
    let mut python = Command::new("python3");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/process/page_client.py");
    python
        .arg(script)
        .arg(plant.http.port().to_string())
        .args(["anna", PASSWORD, "pump-1"]);
    let mut page = Started::new(python);
    page.wait_for("that the drive was started", |line| {
        line.contains("ed\"").then_some(())
    });
    plant.wait_until_it_turns();
    let seen = plant.written().len();
    let renewed = || {
        page.find_all(|line| line.contains(r#"{"lease": 204}"#).then_some(()))
            .len()
    };
    until("control outlives two leases", PATIENCE, || {
        (renewed() > 2 * LOST_AFTER.as_secs() as usize * 2).then_some(())
    });
    assert_eq!(plant.written().len(), seen, "nothing stopped it meanwhile");
    page.kill();
    let killed = Instant::now();
    plant.wait_for_write(seen, (RUN, 0), LOST_AFTER + MARGIN);
    assert!(
        killed.elapsed() > LOST_AFTER / 2,
        "it is not the connection that counts"
    );
    plant.wait_until_it_stands();
    let rows = until("the journal says why", PATIENCE, || {
        Some(audit(&plant)).filter(|rows| has_row(rows, &["commander_lost", "page anna"]))
    });
    assert!(has_row(&rows, &["page anna", "run forward"]), "{rows:#?}");
}

#[test]
fn stop_of_all_stops_what_another_commands() {
    let plant = plant_with("", "20s");
    let seen = plant.run_over_mqtt();
    let anna = signed_in(&plant, "anna");
    // Many connections that say nothing do not hold it up.
    let silent: Vec<_> = (0..80)
        .map(|_| TcpStream::connect(plant.http).unwrap())
        .collect();
    let answer = anna.post("/api/v1/stop", &json!({}));
    assert_eq!(answer.status, 200, "{}", answer.body);
    let drives = answer.json()["drives"].clone();
    assert_eq!(
        (drives.as_array().unwrap().len(), &drives[0]["drive"]),
        (1, &json!("pump-1"))
    );
    assert!(
        drives[0]["outcome"] == "confirmed" || drives[0]["outcome"] == "acknowledged",
        "{drives}"
    );
    assert_eq!(plant.written()[seen], (RUN, 0));
    plant.wait_until_it_stands();
    drop(silent);
    let refused = anna.command(&json!({ "frequency_hz": 99 })).json();
    assert_eq!(
        (&refused["outcome"], &refused["reason"]),
        (&json!("refused"), &json!("outside_limits"))
    );
}

#[test]
fn a_drive_that_the_page_may_not_command_is_left_alone() {
    let users = users();
    let plant = Plant::with(Wish {
        page: &users,
        lost_after: "20s",
        ..Wish::default()
    });
    let file = std::fs::read_to_string(&plant.file).unwrap();
    let text = file.replace(", \"page\"]", "]");
    assert_ne!(text, file);
    let other = "\n[[line.drive]]\nname = \"pump-2\"\nmodel = \"hyundai-n700\"\nstation = 2\npoll = \"5s\"\n\
                 [line.drive.control]\nfrom = [\"page\"]\nfrequency_hz = { min = 5.0, max = 50.0 }\n\
                 on_commander_lost = \"stop\"\nlost_after = \"20s\"\non_shutdown = \"hold\"\n\n[mqtt]";
    std::fs::write(&plant.file, text.replacen("\n[mqtt]", other, 1)).unwrap();
    reload(&plant, "configuration reloaded");
    plant.wait_until_ready();
    let anna = signed_in(&plant, "anna");
    for body in [json!({ "run": "forward" }), json!({ "run": "stop" })] {
        assert_eq!(
            anna.command(&body).json()["reason"],
            "not_from_here",
            "{body}"
        );
    }
    let all = anna.post("/api/v1/stop", &json!({})).json();
    assert_eq!(all["drives"][0]["drive"], "pump-2", "{all}");
    assert_eq!(all["drives"].as_array().unwrap().len(), 1);
}

#[test]
fn guessing_takes_longer_and_longer() {
    let plant = plant_with("", "");
    let mut browser = Browser::new(plant.http);
    for _ in 0..3 {
        assert_eq!(browser.sign_in("anna", "wrong horse").status, 401);
    }
    let mut refused = browser.sign_in("anna", PASSWORD);
    assert_eq!(refused.status, 429, "the right one has to wait as well");
    let mut waits = Vec::new();
    for _ in 0..2 {
        let wait: u64 = refused.header("retry-after").unwrap().parse().unwrap();
        waits.push(wait);
        sleep(Duration::from_secs(wait));
        assert_eq!(browser.sign_in("anna", "wrong horse").status, 401);
        refused = browser.sign_in("anna", PASSWORD);
        assert_eq!(refused.status, 429);
    }
    assert!(waits[0] == 1 && waits[1] == 2, "{waits:?}");
    sleep(Duration::from_secs(
        refused.header("retry-after").unwrap().parse().unwrap(),
    ));
    assert_eq!(browser.sign_in("anna", PASSWORD).status, 200);
    assert_eq!(
        browser.sign_in("anna", "wrong horse").status,
        401,
        "what was before is forgotten"
    );
}

/// Has the configuration taken anew, and waits until the log says `message`.
fn reload(plant: &Plant, message: &str) {
    let before = plant
        .gateway
        .find_all(|line| line.contains(message).then_some(()))
        .len();
    plant.gateway.signal("HUP");
    until(message, PATIENCE, || {
        (plant
            .gateway
            .find_all(|line| line.contains(message).then_some(()))
            .len()
            > before)
            .then_some(())
    });
}

#[test]
fn users_and_certificates_change_while_others_stay_signed_in() {
    let plant = plant_with("", "20s");
    let (anna, bob) = (signed_in(&plant, "anna"), signed_in(&plant, "bob"));
    start(&plant, &anna);
    let seen = plant.written().len();
    let tls = plant.place.file("tls");
    make_certificates(&tls, &["gateway", "127.0.0.1"]);
    let text = std::fs::read_to_string(&plant.file).unwrap();
    let (before, _) = text.split_once("[[http.users]]\nname = \"bob\"").unwrap();
    let secured = |key: &str| {
        format!(
            "{before}[http.tls]\ncert_file = \"{}\"\nkey_file = \"{}\"\n",
            tls.join("gateway.pem").display(),
            tls.join(key).display()
        )
    };
    std::fs::write(&plant.file, secured("missing.key")).unwrap();
    reload(&plant, "configuration unchanged");
    assert_eq!(
        bob.get("/api/v1/session").json()["user"],
        "bob",
        "nothing has changed"
    );
    std::fs::write(&plant.file, secured("gateway.key")).unwrap();
    reload(&plant, "configuration reloaded");

    let through = |browser: Browser| browser.through_tls(&tls.join("ca.pem"));
    let (anna, bob) = (through(anna), through(bob));
    assert_eq!(
        anna.command(&json!({ "frequency_hz": 25 })).json()["drive"],
        "pump-1"
    );
    assert_eq!(plant.written()[seen..], [(FREQUENCY, 2500)], "anna goes on");
    assert_eq!(
        bob.command(&json!({ "run": "stop" })).status,
        401,
        "bob is not in it any more"
    );
    let mut again = through(Browser::new(plant.http));
    let cookie = again
        .sign_in("anna", PASSWORD)
        .header("set-cookie")
        .unwrap()
        .to_owned();
    assert!(cookie.ends_with("; Path=/; Secure"), "{cookie}");
    let mut plain = TcpStream::connect(plant.http).unwrap();
    plain.set_read_timeout(Some(PATIENCE)).unwrap();
    plain
        .write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .unwrap();
    let mut heard = Vec::new();
    // Whatever it is told, no answer comes.
    let _ = plain.read_to_end(&mut heard);
    assert!(!String::from_utf8_lossy(&heard).contains("ok"), "{heard:?}");
    let mut client = Raw::connect(plant.modbus);
    plant.write_uniform(&mut client, 256, 0);
}

/// What `password` makes of what is typed on its terminal: its exit code, what it says, and what the terminal shows.
fn typed(lines: &[&str]) -> (Option<i32>, String, String) {
    let pty = Pty::new().unwrap();
    let terminal = rig::terminal(pty.path());
    let mut shows = tcgetattr(&terminal).unwrap();
    shows
        .local_modes
        .insert(LocalModes::ECHO | LocalModes::ICANON | LocalModes::ISIG);
    tcsetattr(&terminal, OptionalActions::Now, &shows).unwrap();
    let mut command = program();
    command
        .arg("password")
        .stdin(terminal)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut said = Vec::new();
    let mut stderr = child.stderr.take().unwrap();
    while !said.ends_with(b"Password: ") {
        let mut byte = [0];
        assert_eq!(
            stderr.read(&mut byte).unwrap(),
            1,
            "{}",
            String::from_utf8_lossy(&said)
        );
        said.extend(byte);
    }
    for line in lines {
        rustix::io::write(pty.master(), format!("{line}\n").as_bytes()).unwrap();
    }
    stderr.read_to_end(&mut said).unwrap();
    let output = child.wait_with_output().unwrap();
    said.extend(output.stdout);
    let mut shown = [0; 1000];
    let length = rustix::io::read(pty.master(), &mut shown).unwrap_or(0);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let after = tcgetattr(rig::terminal(pty.path())).unwrap();
    assert!(
        after
            .local_modes
            .contains(LocalModes::ECHO | LocalModes::ISIG),
        "the terminal shows what is typed again"
    );
    (output.status.code(), text(&said), text(&shown[..length]))
}

#[test]
fn a_password_is_typed_twice_and_never_shown() {
    let (status, said, shown) = typed(&[PASSWORD, PASSWORD]);
    assert!(
        status == Some(0) && said.contains("$argon2id$") && said.contains("password_hash_file"),
        "{said}"
    );
    assert!(!shown.contains("horse"), "{shown}");
    let (status, said, _) = typed(&[PASSWORD, "another horse"]);
    assert!(
        status == Some(2) && said.contains("the passwords differ") && !said.contains("$argon2id$"),
        "{said}"
    );
    let (status, said, _) = typed(&["corr\u{3}"]);
    assert!(
        status == Some(1) && said.contains("nothing was made"),
        "{said}"
    );
    let (status, said, _) = typed(&["short", "short"]);
    assert!(
        status == Some(2) && said.contains("8 to 256 characters"),
        "{said}"
    );
}
