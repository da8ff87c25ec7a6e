//! Commissioning over HTTP: from a gateway without a line to drives that are read, with the file's comments in place.

use super::browser::{Answer, Browser};
use super::initialising::{MODELS, Yard};
use super::page_control::{PASSWORD, hash};
use super::rig::{Place, fields, start};
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::PathBuf;
use vfd_gateway::sim::BusPacing;

/// A gateway without a line, whose users are anna, who may set up, and bob, who may not.
pub struct Site {
    _gateway: Started,
    _place: Place,
    pub file: PathBuf,
    pub http: SocketAddr,
}

const COMMENT: &str = "# The plant by the river.";

impl Site {
    pub fn new(setup: bool) -> Self {
        let place = Place::new();
        let user = |name, role| {
            format!(
                "[[http.users]]\nname = \"{name}\"\npassword_hash = \"{}\"\nrole = \"{role}\"\n",
                hash()
            )
        };
        let role = if setup { "setup" } else { "maintain" };
        let (anna, bob) = (user("anna", role), user("bob", "maintain"));
        let line = if setup {
            ""
        } else {
            "[[line]]\nname = \"old\"\nport = \"/nowhere\"\n[[line.drive]]\nname = \"d\"\nmodel = \"hyundai-n700\"\nstation = 1\n"
        };
        let text = format!(
            "{COMMENT}\n[gateway]\nname = \"plant\"\ndata_dir = \"{}\" # here\n{line}[http]\nlisten = \"127.0.0.1:0\"\nsetup = {setup}\n{anna}{bob}",
            place.file("data").display()
        );
        let file = place.write("plant.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        let http = gateway.wait_for("the page's address", |line| {
            let fields = fields(line)?;
            (fields["message"] == "HTTP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        Self {
            _gateway: gateway,
            _place: place,
            file,
            http,
        }
    }

    pub fn signed_in(&self, user: &str) -> Browser {
        let mut browser = Browser::new(self.http);
        assert_eq!(browser.sign_in(user, PASSWORD).status, 200);
        browser
    }

    pub fn text(&self) -> String {
        std::fs::read_to_string(&self.file).unwrap()
    }
}

#[track_caller]
fn ok(answer: &Answer, status: u16) -> Value {
    assert_eq!(answer.status, status, "{} {}", answer.head, answer.body);
    answer.json()
}

fn error(answer: &Answer, status: u16) -> String {
    ok(answer, status)["error"].as_str().unwrap().to_owned()
}

/// A scan of the yard that is done.
fn scanned(anna: &Browser, yard: &Yard, stations: &str) -> Value {
    let body = json!({ "port": yard.port, "stations": stations, "link": { "baud": 9600, "parity": "none", "stop_bits": 1 } });
    assert_eq!(
        ok(&anna.post("/api/v1/setup/scan", &body), 202)["state"],
        "running"
    );
    let second = error(&anna.post("/api/v1/setup/scan", &body), 409);
    assert!(second.contains("under way"), "{second}");
    until("the scan is done", PATIENCE * 4, || {
        let scan = anna.get("/api/v1/setup/scan").json();
        assert_ne!(scan["state"], "failed", "{scan}");
        (scan["state"] == "done").then_some(scan)
    })
}

/// The drives of the scan, those with a choice as the model that they are.
fn drives_of(scan: &Value, control: &Value) -> Vec<Value> {
    let drives = scan["drives"].as_array().unwrap().iter();
    let drive = |drive: &Value| {
        assert_eq!(drive["is_here"], true, "{drive}");
        let station = drive["station"].as_u64().unwrap();
        let model = MODELS[usize::try_from(station - 1).unwrap() / 2];
        assert!(
            drive["models"]
                .as_array()
                .unwrap()
                .iter()
                .any(|it| it["id"] == model),
            "{drive}"
        );
        let full_scale_hz = drive["models"]
            .as_array()
            .unwrap()
            .iter()
            .find(|it| it["id"] == model)
            .unwrap()["needs_full_scale"]
            .as_bool()
            .unwrap()
            .then_some(50);
        json!({ "name": format!("p{station}"), "station": station, "model": model, "full_scale_hz": full_scale_hz, "control": control })
    };
    drives.map(drive).collect()
}

fn control() -> Value {
    json!({
        "from": ["page"], "min_frequency_hz": 5, "max_frequency_hz": 50, "directions": "forward", "on_commander_lost": "stop",
        "lost_after_s": 60, "on_shutdown": "stop", "accept_unverified": true,
    })
}

#[test]
fn eight_drives_are_found_added_and_read_and_the_file_keeps_its_comments() {
    let (yard, site) = (Yard::new(BusPacing::None), Site::new(true));
    let anna = site.signed_in("anna");
    assert_eq!(anna.get("/api/v1/session").json()["setup"], true);
    let found = ok(&anna.get("/api/v1/setup"), 200);
    assert_eq!(
        (&found["lines"], &found["ways"]),
        (&json!([]), &json!(["page"])),
        "{found}"
    );
    assert_eq!(found["configuration"]["why_not"], Value::Null, "{found}");

    let scan = scanned(&anna, &yard, "1-8");
    let drives = drives_of(&scan, &Value::Null);
    assert_eq!(drives.len(), 8, "{scan}");
    let of_one = json!({ "station": 1, "models": [MODELS[0]] });
    let values = ok(&anna.post("/api/v1/setup/values", &of_one), 200);
    assert!(
        values["models"][0]["values"][0]["text"].is_string(),
        "{values}"
    );

    let change = json!({ "line": { "name": "hall-1" }, "drives": drives });
    let proposal = ok(&anna.post("/api/v1/setup/proposal", &change), 200);
    assert_eq!(
        (&proposal["is_right"], &proposal["problems"]),
        (&json!(true), &json!([])),
        "{proposal}"
    );
    assert!(
        proposal["text"]
            .as_str()
            .unwrap()
            .starts_with("[[line]]\nname = \"hall-1\""),
        "{proposal}"
    );
    let (before, mut apply) = (site.text(), change.clone());
    apply["digest"] = "0".into();
    assert!(error(&anna.post("/api/v1/setup/apply", &apply), 409).contains("has changed since"));
    apply["digest"] = proposal["digest"].clone();
    let done = ok(&anna.post("/api/v1/setup/apply", &apply), 200);
    assert_eq!(done["changes"][0], "line hall-1: added", "{done}");
    assert_eq!(
        std::fs::read_to_string(done["kept_as"].as_str().unwrap()).unwrap(),
        before
    );
    assert!(site.text().starts_with(&before), "{}", site.text());
    until("the drives show values", PATIENCE, || {
        let state = anna.get("/api/v1/state").json();
        let read = state["drives"]
            .as_array()?
            .iter()
            .filter(|drive| drive["output_frequency_hz"].is_number())
            .count();
        (read == 8).then_some(())
    });
    assert!(
        error(
            &anna.post(
                "/api/v1/setup/scan",
                &json!({ "port": yard.port, "stations": "1" })
            ),
            409
        )
        .contains("in use")
    );

    let given = json!({ "drive": "p1", "control": control() });
    let proposal = ok(&anna.post("/api/v1/setup/proposal", &given), 200);
    assert_eq!(proposal["is_right"], true, "{proposal}");
    let mut apply = given.clone();
    apply["digest"] = proposal["digest"].clone();
    ok(&anna.post("/api/v1/setup/apply", &apply), 200);
    assert_eq!(site.text().matches("[line.drive.control]").count(), 1);
    let seen = ok(&anna.get("/api/v1/setup/drives/p1"), 200);
    assert_eq!(
        (&seen["drive"], &seen["model"]),
        (&json!("p1"), &json!(MODELS[0])),
        "{seen}"
    );
    let again = error(&anna.post("/api/v1/setup/proposal", &given), 409);
    assert!(again.contains("already"), "{again}");
    a_refused_reload_leaves_the_file_as_it_was(&site, &anna);
}

/// The line of a drive that runs is not restarted.
fn a_refused_reload_leaves_the_file_as_it_was(site: &Site, anna: &Browser) {
    until("p1 is started", PATIENCE, || {
        let answer = anna
            .post(
                "/api/v1/drives/p1/command",
                &json!({ "run": "forward", "frequency_hz": 30 }),
            )
            .json();
        let outcome = answer["outcome"].as_str().unwrap().to_owned();
        (outcome == "confirmed" || outcome == "acknowledged").then_some(())
    });
    let kept = || {
        let files = std::fs::read_dir(site.file.parent().unwrap()).unwrap();
        files
            .filter(|file| {
                file.as_ref()
                    .unwrap()
                    .file_name()
                    .to_string_lossy()
                    .contains(".bak-")
            })
            .count()
    };
    let (before, kept_before) = (site.text(), kept());
    let mut apply = json!({ "drive": "p2", "control": control() });
    apply["digest"] = ok(&anna.post("/api/v1/setup/proposal", &apply), 200)["digest"].clone();
    let refused = error(&anna.post("/api/v1/setup/apply", &apply), 409);
    assert!(
        refused.contains("drive p1 is in use") && refused.contains("is as it was"),
        "{refused}"
    );
    assert_eq!((site.text(), kept()), (before, kept_before));
    let kept_rows = || {
        let csv = anna.get("/api/v1/journal?table=audit&format=csv").body;
        [
            "set-up: line hall-1 with ",
            "set-up: control of p2: the gateway did not take it over",
        ]
        .iter()
        .all(|part| {
            csv.lines()
                .any(|row| row.contains(part) && row.contains("anna"))
        })
        .then_some(())
    };
    until(
        "the audit names who did it, and why not",
        PATIENCE,
        kept_rows,
    );
    let stopped = anna
        .post("/api/v1/drives/p1/command", &json!({ "run": "stop" }))
        .json();
    assert_ne!(stopped["outcome"], "refused", "{stopped}");
}

#[test]
fn what_would_have_problems_changes_nothing() {
    let (yard, site) = (Yard::new(BusPacing::None), Site::new(true));
    let anna = site.signed_in("anna");
    let missing = error(
        &anna.post(
            "/api/v1/setup/proposal",
            &json!({ "line": { "name": "a" }, "drives": [{}] }),
        ),
        400,
    );
    assert!(missing.contains("`drives[0].name` is missing"), "{missing}");
    let scan = scanned(&anna, &yard, "1-2");
    let mut rules = control();
    rules["min_frequency_hz"] = json!(50);
    rules["max_frequency_hz"] = json!(5);
    let change = json!({ "line": { "name": "hall 1" }, "drives": drives_of(&scan, &rules) });
    let before = site.text();
    let proposal = ok(&anna.post("/api/v1/setup/proposal", &change), 200);
    assert_eq!(proposal["is_right"], false);
    let problems = proposal["problems"].as_array().unwrap();
    let names = |key: &str| {
        problems
            .iter()
            .any(|it| it["key"].as_str().unwrap().ends_with(key) && it["line"].as_u64() > Some(1))
    };
    assert!(names("line[0].name") && problems.len() > 1, "{problems:?}");
    let mut apply = change;
    apply["digest"] = proposal["digest"].clone();
    ok(&anna.post("/api/v1/setup/apply", &apply), 422);
    assert_eq!(site.text(), before);
    assert_eq!(
        std::fs::read_dir(site.file.parent().unwrap())
            .unwrap()
            .filter(|it| it
                .as_ref()
                .unwrap()
                .file_name()
                .to_string_lossy()
                .contains(".bak-"))
            .count(),
        0
    );
    assert_eq!(anna.ask("DELETE", "/api/v1/setup/scan", "").status, 204);
    assert_eq!(anna.get("/api/v1/setup/scan").status, 404);
}

#[test]
fn only_the_role_for_it_sets_up_and_only_where_that_is_on() {
    let site = Site::new(true);
    let (bob, stranger) = (site.signed_in("bob"), Browser::new(site.http));
    let scan = json!({ "port": "/dev/ttyUSB0", "stations": "1" });
    for (browser, status, why) in [
        (&bob, 403, "needs the role `setup`"),
        (&stranger, 401, "not signed in"),
    ] {
        for answer in [
            browser.get("/api/v1/setup"),
            browser.get("/api/v1/setup/scan"),
            browser.post("/api/v1/setup/scan", &scan),
            browser.post("/api/v1/setup/apply", &json!({})),
        ] {
            let error = error(&answer, status);
            assert!(error.contains(why), "{error}");
        }
    }
    assert_eq!(bob.get("/api/v1/session").json()["setup"], false);
    let off = Site::new(false);
    let anna = off.signed_in("anna");
    assert!(error(&anna.get("/api/v1/setup"), 403).contains("`setup = true` in [http]"));
    assert!(error(&anna.post("/api/v1/setup/scan", &scan), 403).contains("is off"));
}
