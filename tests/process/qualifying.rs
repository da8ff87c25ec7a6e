//! `qualify`: a person in front of a drive leads it through what its model leaves unproven; what is confirmed counts for
//! that drive, and a command that is killed leaves no motor running.

use super::mosquitto::free_port;
use super::plant::get;
use super::raw::Raw;
use super::rig::{self, Place, assert_says, fields, program, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use rustix::io::write;
use serde_json::Value;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;
use vfd_gateway::daemon::host::pty::Pty;

/// A model of which stop, forward and setpoint are unproven, and that cannot coast.
const MODEL: &str = "teco-e510s";
/// One of which every action is.
const ALL_UNPROVEN: &str = "toshiba-vf-s15";
/// The drive's uniform unit, and its words: run state with its values, run command, setpoint.
const UNIFORM: u8 = 101;
const RUN_STATE: u16 = 2;
const STOPPED: u16 = 1;
const FORWARD: u16 = 2;
const TRIPPED: u16 = 4;
const RUN: u16 = 256;
const SETPOINT: u16 = 257;
/// A trial begins, and what the panel shows is asked.
const SEND: &str = "send it? [y/N/skip]";
/// A ramp, on a machine that is busy with other tests.
const RAMP: Duration = Duration::from_secs(60);

/// A simulated drive and a gateway before it. What is dropped first ends first.
struct Site {
    gateway: Started,
    modbus: SocketAddr,
    http: SocketAddr,
    drive: Started,
    socket: String,
    file: PathBuf,
    place: Place,
}

impl Site {
    fn new(control: &str) -> Self {
        Self::of(MODEL, "", control)
    }

    fn of(model: &str, keys: &str, control: &str) -> Self {
        let place = Place::new();
        let port = place.file("line");
        let mut command = program();
        command.args([
            "simulate",
            "--trip-on-enter",
            "--model",
            model,
            "--link",
            port.to_str().unwrap(),
        ]);
        let drive = Started::at_a_keyboard(command);
        drive.wait_for("that it plays", |line| {
            line.contains("station 1").then_some(())
        });
        std::fs::create_dir(place.file("data")).unwrap();
        std::fs::create_dir(place.file("models")).unwrap();
        let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
        let text = format!(
            "[gateway]\nname = \"site\"\ndata_dir = \"{}\"\nmodel_dirs = [\"{}\"]\n\n\
             [[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\nwrite = [\"127.0.0.1/32\"]\n\n[http]\nlisten = \"{http}\"\n\n\
             [[line]]\nname = \"hall-1\"\nport = \"{}\"\n\n[[line.drive]]\nname = \"fan-1\"\nmodel = \"own-fan\"\n\
             station = 1\nunit = 1\nuniform_unit = {UNIFORM}\npoll = \"100ms\"\n{keys}\n\n[line.drive.control]\n\
             from = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\non_commander_lost = \"stop\"\n\
             lost_after = \"3s\"\non_shutdown = \"stop\"\n{control}\n",
            place.file("data").display(),
            place.file("models").display(),
            port.display()
        );
        let file = place.write("gateway.toml", &text);
        place.write("models/own-fan.toml", &own_model(model, "Own fan"));
        let (gateway, modbus) = run(&file);
        let socket = place
            .file("data/vfd-gateway.sock")
            .to_str()
            .unwrap()
            .to_owned();
        let site = Self {
            gateway,
            modbus,
            http,
            drive,
            socket,
            file,
            place,
        };
        site.waits_for(STOPPED);
        site
    }

    fn again(&mut self) {
        self.gateway.terminate();
        assert!(self.gateway.end_within(PATIENCE).success());
        (self.gateway, self.modbus) = run(&self.file);
        self.waits_for(STOPPED);
    }

    fn edit(&self, from: &str, to: &str) {
        let text = std::fs::read_to_string(&self.file).unwrap();
        assert!(text.contains(from), "{from} in {text}");
        std::fs::write(&self.file, text.replacen(from, to, 1)).unwrap();
    }

    fn word(&self, register: u16) -> Option<u16> {
        Raw::connect(self.modbus)
            .read_unit(UNIFORM, register, 1)
            .ok()
            .map(|words| words[0])
    }

    fn waits_for(&self, run_state: u16) {
        until(&format!("run state {run_state}"), RAMP, || {
            (self.word(RUN_STATE) == Some(run_state)).then_some(())
        });
    }

    /// What becomes of a start over Modbus TCP: stop, setpoint, run.
    fn starts(&self) -> Result<(), u8> {
        let mut client = Raw::connect(self.modbus);
        for (register, word) in [(RUN, 0), (SETPOINT, 1000), (RUN, 1)] {
            let mut tries = 0;
            loop {
                tries += 1;
                match client.write(UNIFORM, register, word) {
                    // A stop before may not be effective yet.
                    Err(6) if tries < 200 => std::thread::sleep(Duration::from_millis(20)),
                    Err(code) => return Err(code),
                    Ok(()) => break,
                }
            }
        }
        Ok(())
    }

    fn args<'a>(&'a self, more: &[&'a str]) -> Vec<&'a str> {
        [&["qualify", "fan-1", "--socket", &self.socket], more].concat()
    }
}

fn check(site: &Site) -> std::process::Output {
    vfd_gateway(&["check", "--verbose", "-c", site.file.to_str().unwrap()])
}

fn own_model(like: &str, title: &str) -> String {
    format!("like = \"{like}\"\nid = \"own-fan\"\ntitle = \"{title}\"\n")
}

fn run(file: &std::path::Path) -> (Started, SocketAddr) {
    let gateway = start(&["run", "-c", file.to_str().unwrap()]);
    let modbus = gateway.wait_for("where it listens", |line| {
        let fields = fields(line)?;
        (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
    });
    (gateway, modbus)
}

/// `qualify`, with somebody at its terminal.
struct Trials {
    command: Started,
    terminal: Option<Pty>,
    /// Questions that were answered.
    asked: usize,
}

impl Trials {
    fn begin(site: &Site) -> Self {
        let terminal = Pty::new().unwrap();
        let mut command = program();
        command.args(site.args(&["--by", "anna"]));
        let command = Started::at_a_terminal(command, rig::terminal(terminal.path()));
        Self {
            command,
            terminal: Some(terminal),
            asked: 0,
        }
    }

    /// Waits for the next question, and answers it.
    fn answers(&mut self, question: &str, answer: &str) {
        self.waits_to_be_asked(question);
        let terminal = self.terminal.as_ref().unwrap();
        write(terminal.master(), format!("{answer}\n").as_bytes()).unwrap();
        self.asked += 1;
    }

    /// The question stands at the end of what was printed, without a line break behind it.
    fn waits_to_be_asked(&mut self, question: &str) {
        until(
            &format!("`{question}` is asked: {}", self.command.text()),
            RAMP,
            || {
                let said = self.command.text_so_far();
                let asked = said.matches("[y/N/skip]").count();
                (asked == self.asked + 1 && said.trim_end().ends_with(question)).then_some(())
            },
        );
    }

    fn ends(mut self, code: i32, words: &[&str]) {
        assert_eq!(
            self.command.end_within(RAMP).code(),
            Some(code),
            "{}",
            self.command.text()
        );
        let said = until("all is read", PATIENCE, || {
            self.command.is_silent().then(|| self.command.text())
        });
        for word in words {
            assert!(said.contains(word), "no `{word}` in: {said}");
        }
    }
}

#[test]
fn a_drive_is_qualified_and_that_counts_until_something_changes() {
    let mut site = Site::new("qualify = true");
    assert_says(&check(&site), 0, &["being qualified", "takes no orders"]);
    assert_eq!(
        site.starts(),
        Err(1),
        "nobody else may use what is unproven"
    );
    assert_says(
        &vfd_gateway(&site.args(&[])),
        2,
        &["stdin is not a terminal"],
    );
    assert_eq!(
        get(site.http, "/api/v1/drives/fan-1/qualify").unwrap().0,
        404,
        "not over TCP"
    );
    assert_says(
        &vfd_gateway(&site.args(&["--list"])),
        0,
        &["basic", "not tried; refused", "open to trials"],
    );

    let mut trials = Trials::begin(&site);
    trials.answers(SEND, "y");
    trials.answers("new fault? [y/N/skip]", "y");
    trials.answers(SEND, "y");
    trials.waits_to_be_asked("about that frequency? [y/N/skip]");
    assert_eq!(
        site.word(RUN_STATE),
        Some(FORWARD),
        "it runs while the person looks"
    );
    trials.answers("about that frequency? [y/N/skip]", "y");
    trials.answers(SEND, "y");
    trials.answers("come to rest? [y/N/skip]", "y");
    trials.ends(0, &["frame 01 06", "basic: confirmed", "counts after"]);
    site.waits_for(STOPPED);
    let journal = vfd_gateway(&["journal", "audit", "-c", site.file.to_str().unwrap()]);
    assert_says(&journal, 0, &["qualify basic: confirmed by anna"]);

    site.edit("qualify = true", "");
    site.again();
    assert_says(&check(&site), 0, &["qualified at this drive (site): basic"]);
    let state: Value = serde_json::from_str(&get(site.http, "/api/v1/state").unwrap().1).unwrap();
    let drive = &state["drives"][0];
    assert_eq!(
        drive["control"]["site"],
        serde_json::json!(["basic"]),
        "{drive}"
    );
    let health = vfd_gateway(&["health", "--socket", &site.socket]);
    assert!(
        String::from_utf8_lossy(&health.stdout).contains("qualified at the site: basic"),
        "{health:?}"
    );
    assert_eq!(site.starts(), Ok(()));
    site.waits_for(FORWARD);
    Raw::connect(site.modbus).write(UNIFORM, RUN, 0).unwrap();
    site.waits_for(STOPPED);

    let report = site.place.file("report.json");
    assert_says(
        &vfd_gateway(&site.args(&["--report", report.to_str().unwrap()])),
        0,
        &["written"],
    );
    let report = std::fs::read_to_string(report).unwrap();
    assert!(
        report.contains("confirmed") && report.contains("own-fan"),
        "{report}"
    );
    assert!(
        !["fan-1", "hall-1", "anna", "127.0.0.1"]
            .iter()
            .any(|it| report.contains(it)),
        "{report}"
    );

    site.place
        .write("models/own-fan.toml", &own_model(MODEL, "Another fan"));
    let void = [
        "no longer counts (basic): the model file has changed since",
        "takes no orders",
    ];
    assert_says(&check(&site), 0, &void);
    site.again();
    assert_eq!(site.starts(), Err(1));
    assert_says(
        &vfd_gateway(&site.args(&["--forget", "--yes"])),
        0,
        &["forgotten"],
    );
    assert_says(
        &vfd_gateway(&site.args(&["--list"])),
        0,
        &["not tried; refused"],
    );
}

#[test]
fn a_motor_in_a_trial_is_stopped_whatever_becomes_of_the_command() {
    let site = Site::new("qualify = true");
    for how in ["killed", "interrupted", "answered with no", "left alone"] {
        let mut trials = Trials::begin(&site);
        trials.answers(SEND, "y");
        trials.answers("new fault? [y/N/skip]", "y");
        trials.answers(SEND, "y");
        trials.waits_to_be_asked("about that frequency? [y/N/skip]");
        assert_eq!(site.word(RUN_STATE), Some(FORWARD), "{how}");
        match how {
            "killed" => trials.command.kill(),
            "interrupted" => {
                trials.command.interrupt();
                trials.ends(1, &["interrupted; the motor is stopped"]);
            }
            "left alone" => {
                trials.terminal = None;
                trials.ends(1, &["the motor is stopped"]);
            }
            _ => {
                trials.answers("about that frequency? [y/N/skip]", "n");
                trials.ends(
                    1,
                    &["NOT AS EXPECTED", "contradicted", "the motor is stopped"],
                );
            }
        }
        site.waits_for(STOPPED);
    }
    let told = vfd_gateway(&site.args(&["--list"]));
    assert_says(&told, 0, &["contradicted by anna"]);
    let lost = site
        .gateway
        .find_all(|line| line.contains("commander lost").then_some(()));
    assert_eq!(
        lost.len(),
        1,
        "only the one that was killed: {}",
        site.gateway.text()
    );
}

#[test]
fn every_action_has_a_trial_of_its_own() {
    let control = "qualify = true\ndirections = [\"forward\", \"reverse\"]\nallow_release = true\n";
    let mut site = Site::of(
        ALL_UNPROVEN,
        "rated_current_a = 11.0\nrated_voltage_v = 400.0",
        control,
    );
    let mut trials = Trials::begin(&site);
    let at_rest = [SEND, "new fault? [y/N/skip]"];
    let basic = [
        SEND,
        "about that frequency? [y/N/skip]",
        SEND,
        "come to rest? [y/N/skip]",
    ];
    let others = [
        SEND,
        "the other way? [y/N/skip]",
        SEND,
        "without a ramp? [y/N/skip]",
        SEND,
        "terminals again? [y/N/skip]",
    ];
    for question in at_rest.into_iter().chain(basic).chain(others) {
        trials.answers(question, "y");
    }
    let results = [
        "basic: confirmed",
        "reverse: confirmed",
        "coast: confirmed",
        "release: confirmed",
        "reset: skipped",
    ];
    trials.ends(0, &results);
    site.waits_for(STOPPED);

    // A trip is reset in the trials behind a reload: what a reset rests on is sure then.
    assert_says(&vfd_gateway(&["reload", "--socket", &site.socket]), 0, &[]);
    site.waits_for(STOPPED);
    site.drive.type_line("trip");
    site.waits_for(TRIPPED);
    let mut trials = Trials::begin(&site);
    for question in [
        SEND,
        "new fault? [y/N/skip]",
        SEND,
        "motor stand still? [y/N/skip]",
    ] {
        trials.answers(question, "y");
    }
    trials.answers(SEND, "enough");
    trials.ends(1, &["reset: confirmed", "ended at your request"]);
    site.waits_for(STOPPED);
    let told = vfd_gateway(&site.args(&["--list"]));
    assert_says(
        &told,
        0,
        &[
            "basic",
            "accepted for this drive (site)",
            "counts after a reload",
        ],
    );
}
