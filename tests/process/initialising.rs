//! `init`: from a line of unknown drives to a configuration that passes `check` and a gateway that serves them.

use super::mosquitto::free_port;
use super::plant::get;
use super::rig::{Place, assert_says, program, start, vfd_gateway};
use super::started::{PATIENCE, until};
use serde_json::Value;
use std::io::Write;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::lines::simulated_end::AtSpeed;
use vfd_gateway::daemon::lines::simulator;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::LinkSettings;
use vfd_gateway::sim::{BusOptions, BusPacing, DriveOptions, SimBus, SimDrive};
use vfd_gateway::vendors;

/// Two drives of each of four makers.
pub const MODELS: [&str; 4] = ["hyundai-n700", "teco-e510", "frecon-fr500a", "delta-ms300"];
const PASSWORD: &str = "correct horse";

/// A line with eight drives, at stations 1 to 8. It ends with this.
pub struct Yard {
    pub port: PathBuf,
    over: Arc<AtomicBool>,
    player: Option<JoinHandle<()>>,
}

impl Yard {
    /// Where bytes take time, the drives hear only what is sent at their own speed, 9600 bit/s.
    pub fn new(pacing: BusPacing) -> Self {
        let pty = Pty::new().unwrap();
        let port = pty.path().to_owned();
        let over = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&over);
        let player = std::thread::spawn(move || {
            let catalog = vendors::catalog();
            let options = BusOptions {
                pacing,
                ..BusOptions::default()
            };
            let mut bus = SimBus::new(LinkSettings::DEFAULT, options, 1);
            for (station, id) in (1..).zip(MODELS.iter().flat_map(|id| [id, id])) {
                let model = Arc::clone(catalog.find(id).unwrap());
                bus.connect(
                    Station(station),
                    SimDrive::new(model, DriveOptions::default()),
                );
            }
            match pacing {
                BusPacing::None => simulator::play(&pty, &mut bus, &is_over, |_, _| ()),
                BusPacing::CharacterTimes => {
                    let line = AtSpeed {
                        pty: &pty,
                        baud: 9600,
                        stop_bits: 1,
                    };
                    simulator::play(line, &mut bus, &is_over, |_, _| ())
                }
            }
            .unwrap();
        });
        Self {
            port,
            over,
            player: Some(player),
        }
    }
}

impl Drop for Yard {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        // A player that has failed has said so.
        let _ = self.player.take().map(JoinHandle::join);
    }
}

/// What `init` does with `args` and these answers.
fn init(out: &Path, args: &[&str], answers: &[&str]) -> Output {
    let mut command = program();
    command.arg("init").arg("--out").arg(out).args(args);
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    // A program that has refused already does not read.
    let _ = input.write_all((answers.join("\n") + "\n").as_bytes());
    drop(input);
    child.wait_with_output().unwrap()
}

#[test]
fn eight_unknown_drives_are_served_after_a_few_answers() {
    let yard = Yard::new(BusPacing::None);
    let place = Place::new();
    let out = place.file("vfd-gateway.toml");
    let data = place.file("data");
    let [page, modbus] =
        [free_port(), free_port()].map(|port| SocketAddr::from(([127, 0, 0, 1], port)));
    let port = yard.port.to_str().unwrap();
    let mut args = vec![
        "--port",
        port,
        "--stations",
        "1-8",
        "--ways",
        "page,modbus-tcp",
        "--command-from",
        "page",
    ];
    // A pseudo-terminal has no speed: the drives would answer at the first one that is tried.
    args.extend(["--baud", "9600", "--parity", "none", "--stop-bits", "1"]);
    let listen = [page.to_string(), modbus.to_string()];
    args.extend([
        "--page-listen",
        &listen[0],
        "--modbus-listen",
        &listen[1],
        "--page-user",
        "anna",
    ]);
    args.extend(["--data-dir", data.to_str().unwrap(), "--start", "no"]);
    args.extend(MODELS.iter().flat_map(|model| ["--model", model]));
    // Names, the password, limits, directions, client lost, after how long, shut down, unproven models.
    let answers = [
        "p1 p2 p3 p4 p5 p6 p7 p8",
        PASSWORD,
        "5-50",
        "",
        "halt",
        "stop",
        "10s",
        "stop",
        "yes",
    ];
    let made = init(&out, &args, &answers);
    assert_says(&made, 0, &["`halt` is not one of stop", "is written"]);
    let written = std::fs::read_to_string(&out).unwrap();
    assert!(
        !written.contains(PASSWORD) && written.contains("anna.hash"),
        "{written}"
    );
    assert_says(
        &vfd_gateway(&["check", "-c", out.to_str().unwrap()]),
        0,
        &["line-1"],
    );

    let gateway = start(&["run", "-c", out.to_str().unwrap()]);
    let online = |state: &Value| {
        let drives = state["drives"].as_array()?;
        let online = drives
            .iter()
            .filter(|drive| drive["presence"] == "online")
            .count();
        (online == 8).then(|| {
            drives
                .iter()
                .map(|drive| drive["name"].as_str().unwrap().to_owned())
                .collect::<Vec<_>>()
        })
    };
    let names = until("all drives are online", PATIENCE, || {
        online(&serde_json::from_str(&get(page, "/api/v1/state")?.1).ok()?)
    });
    assert_eq!(
        names,
        ["p1", "p2", "p3", "p4", "p5", "p6", "p7", "p8"],
        "{}",
        gateway.text_so_far()
    );
    let again = init(&out, &args, &answers);
    assert_says(&again, 2, &["already exists and is not overwritten"]);
    assert_eq!(std::fs::read_to_string(&out).unwrap(), written);
}

#[test]
fn answers_that_are_wrong_or_missing_write_nothing() {
    let place = Place::new();
    let out = place.file("vfd-gateway.toml");
    let drive = ["--port", "/dev/ttyUSB9", "--drive", "pump-1=hyundai-n700@1"];
    let missing = init(&out, &drive, &["page"]);
    assert_says(
        &missing,
        1,
        &["the input ended before", "nothing was written"],
    );
    let flags = |more: &[&'static str]| {
        [
            &drive[..],
            &["--ways", "page", "--page-listen", "127.0.0.1:0"],
            more,
        ]
        .concat()
    };
    let wrong = [
        (
            flags(&["--command-from", "mqtt"]),
            "`mqtt` is not one of page",
        ),
        (
            flags(&["--command-from", "page", "--page-user", "an na"]),
            "--page-user: a name has 1 to 32 characters a-z, A-Z, 0-9",
        ),
        (
            ["--drive", "pump-1=n700@1", "--port", "/dev/x"].to_vec(),
            "no model is called n700",
        ),
    ];
    for (args, word) in wrong {
        assert_says(&init(&out, &args, &[]), 2, &[word]);
    }
    // They contradict each other: the client may be silent for less than it takes to notice.
    let control = [
        "--command-from",
        "page",
        "--page-user",
        "anna",
        "--limits",
        "5-50",
        "--directions",
        "forward",
    ];
    let ends = [
        "--on-commander-lost",
        "stop",
        "--lost-after",
        "10ms",
        "--on-shutdown",
        "stop",
        "--data-dir",
        "/tmp",
    ];
    let args = [
        &drive[..],
        &["--ways", "page", "--page-listen", "127.0.0.1:8080"],
        &control,
        &ends,
    ]
    .concat();
    assert_says(
        &init(&out, &args, &[PASSWORD]),
        2,
        &["contradict each other", "lost_after"],
    );
    assert_eq!(std::fs::read_dir(out.parent().unwrap()).unwrap().count(), 0);
}

#[test]
fn a_page_for_other_hosts_gets_a_certificate() {
    let place = Place::new();
    let out = place.file("vfd-gateway.toml");
    let data = place.file("data");
    let args = [
        "--port",
        "/dev/ttyUSB9",
        "--drive",
        "pump-1=hyundai-n700@1",
        "--ways",
        "page",
        "--page-listen",
        "0.0.0.0:8443",
        "--page-allow",
        "127.0.0.0/8",
        "--command-from",
        "",
        "--data-dir",
        data.to_str().unwrap(),
        "--start",
        "no",
    ];
    assert_says(
        &init(&out, &args, &[]),
        0,
        &["fingerprint", ":8443/authority.crt", "is written"],
    );
    assert!(place.file("tls/page.pem").exists() && data.exists());
    assert_says(
        &vfd_gateway(&["check", "-c", out.to_str().unwrap()]),
        0,
        &["0.0.0.0:8443"],
    );
}
