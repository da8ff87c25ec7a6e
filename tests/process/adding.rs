//! What `deploy/adding-a-drive.md` shows works as it stands there: its model is sound, is played, and is run.

use super::raw::Raw;
use super::rig::{Place, fields, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// Addresses of the invented drive, typed from the document.
const STATUS: u16 = 0x2100;
const OUTPUT: u16 = 0x2101;
const ACCELERATION: u16 = 0x0100;
const UNIFORM: u8 = 101;
const RUNNING: u16 = 0x0001;
const IN_REVERSE: u16 = 0x0002;

/// The model and the configuration of the document, as files.
struct Written {
    models: PathBuf,
    model: PathBuf,
    configuration: PathBuf,
    link: PathBuf,
    place: Place,
}

impl Written {
    fn new() -> Self {
        let place = Place::new();
        let (model, configuration) = of_document();
        let (models, link) = (place.file("models"), place.file("line"));
        std::fs::create_dir(&models).unwrap();
        let configuration = replaced(
            &configuration,
            "/etc/vfd-gateway/models",
            models.to_str().unwrap(),
        );
        let configuration = replaced(&configuration, "/tmp/vfd-line", link.to_str().unwrap());
        let configuration = replaced(&configuration, "127.0.0.1:1502", "127.0.0.1:0");
        let model = place.write("models/flux-2.toml", &model);
        let configuration = place.write("try.toml", &configuration);
        Self {
            models,
            model,
            configuration,
            link,
            place,
        }
    }

    fn simulate(&self) -> Started {
        let link = self.link.to_str().unwrap();
        let dir = self.models.to_str().unwrap();
        let drive = start(&[
            "simulate",
            "--model",
            "acme-flux-2",
            "--model-dir",
            dir,
            "--link",
            link,
        ]);
        drive.wait_for("that it plays", |line| {
            line.contains("station 1").then_some(())
        });
        drive
    }

    fn run(&self) -> (Started, SocketAddr) {
        let gateway = start(&["run", "-c", self.configuration.to_str().unwrap()]);
        let address = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        gateway.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
        (gateway, address)
    }
}

#[test]
fn the_model_of_the_tutorial_is_sound() {
    let written = Written::new();
    let said = ask(&["models", "check", written.model.to_str().unwrap()], 0);
    for word in [
        "acme-flux-2 is valid: 8 registers",
        "reset (unproven)",
        "inferred: reset, run command bit 7",
    ] {
        assert!(said.contains(word), "no {word}:\n{said}");
    }
    let dir = written.models.to_str().unwrap();
    let shown = ask(&["models", "show", "acme-flux-2", "--model-dir", dir], 0);
    for word in ["Acme Flux 2", "0x2101", "over-current", "P0-02"] {
        assert!(shown.contains(word), "no {word}:\n{shown}");
    }
    let listed = ask(&["models", "--model-dir", dir], 0);
    assert!(
        listed.contains("acme-flux-2") && listed.contains("hyundai-n700"),
        "{listed}"
    );
    let as_json: serde_json::Value =
        serde_json::from_str(&ask(&["models", "list", "--json", "--model-dir", dir], 0)).unwrap();
    let ours = as_json
        .as_array()
        .unwrap()
        .iter()
        .find(|model| model["id"] == "acme-flux-2")
        .unwrap();
    assert_eq!(ours["registers"], 8);
}

#[test]
fn a_model_that_is_like_another_is_checked_and_printed_whole() {
    let written = Written::new();
    let text = super::rig::text_of("deploy/adding-a-drive.md");
    let (_, rest) = text
        .split_once("\n## A drive that is like another one\n")
        .unwrap();
    let model = written.place.write("models/flux-3.toml", &blocks(rest)[0]);
    let dir = written.models.to_str().unwrap();
    let said = ask(
        &[
            "models",
            "check",
            model.to_str().unwrap(),
            "--model-dir",
            dir,
        ],
        0,
    );
    assert!(
        said.contains("acme-flux-3 is valid: 7 registers")
            && said.contains("stop: sibling, one source"),
        "{said}"
    );
    let printed = ask(
        &[
            "models",
            "show",
            "acme-flux-3",
            "--toml",
            "--model-dir",
            dir,
        ],
        0,
    );
    let alone = written.place.write("alone.toml", &printed);
    let said = ask(&["models", "check", alone.to_str().unwrap()], 0);
    assert!(said.contains("acme-flux-3 is valid: 7 registers"), "{said}");
}

/// The model of a meter in `docs/drives.md`.
#[test]
fn a_device_that_is_no_drive_is_read() {
    let written = Written::new();
    let text = super::rig::text_of("docs/drives.md");
    let (_, rest) = text.split_once("### A device that is no drive").unwrap();
    let model = written.place.write("models/meter.toml", &blocks(rest)[0]);
    let said = ask(&["models", "check", model.to_str().unwrap()], 0);
    assert!(
        said.contains("acme-meter is valid: 1 register") && said.contains("only read"),
        "{said}"
    );
    let line =
        "[[line]]\nname = 'hall'\nport = '/dev/ttyUSB0'\n[[line.drive]]\nname = 'm'\nstation = 1\n";
    let dirs = format!("[gateway]\nmodel_dirs = ['{}']\n", written.models.display());
    let file = written
        .place
        .write("meter.conf", &format!("{dirs}{line}model = 'acme-meter'\n"));
    let said = ask(&["check", "--verbose", "-c", file.to_str().unwrap()], 0);
    assert!(
        said.contains("read of 0x0000 x1 (voltage)") && said.contains("read-only"),
        "{said}"
    );
}

#[test]
fn the_configuration_of_the_tutorial_says_what_is_to_be_set() {
    let written = Written::new();
    let said = ask(
        &[
            "check",
            "--verbose",
            "-c",
            written.configuration.to_str().unwrap(),
        ],
        0,
    );
    for word in [
        "can be ordered: stop, frequency, forward, reverse, reset",
        "unproven and accepted: reset",
        "acceleration_time (0x0100): stored",
        "P0-02: run commands from communication (0x0002 = 2)",
        "P0-03: frequency from communication (0x0003 = 5)",
    ] {
        assert!(said.contains(word), "no {word}:\n{said}");
    }
}

#[test]
fn the_drive_of_the_tutorial_runs() {
    let written = Written::new();
    let _drive = written.simulate();
    let (mut gateway, address) = written.run();
    let mut client = Raw::connect(address);
    let status = |client: &mut Raw| client.read(STATUS, 1).map(|words| words[0]);
    for (command, run_state, bits) in [(1, 2, RUNNING), (2, 3, RUNNING | IN_REVERSE)] {
        stop(&mut client);
        for (register, word) in [(257, 3000), (256, command)] {
            until("the write is taken", PATIENCE, || {
                client.write(UNIFORM, register, word).ok()
            });
        }
        until("the motor turns", PATIENCE, || {
            (client.read(OUTPUT, 1).ok()?[0] > 200).then_some(())
        });
        until("the drive shows that it runs", PATIENCE, || {
            (status(&mut client) == Ok(bits)).then_some(())
        });
        until("the run state is known", PATIENCE, || {
            is_in(&mut client, run_state)
        });
        stop(&mut client);
        until("the motor stands still", PATIENCE, || {
            (client.read(OUTPUT, 1).ok()?[0] == 0).then_some(())
        });
        until("the drive shows that it stands", PATIENCE, || {
            (status(&mut client).ok()? & RUNNING == 0).then_some(())
        });
    }
    assert_eq!(client.write(1, ACCELERATION, 125), Ok(()));
    assert_eq!(client.read(ACCELERATION, 1), Ok(vec![125]));
    gateway.terminate();
    assert_eq!(
        gateway.end_within(PATIENCE).code(),
        Some(0),
        "{}",
        gateway.text()
    );
}

/// Stops the drive, as a controller does before each start.
fn stop(client: &mut Raw) {
    until("the stop is taken", PATIENCE, || {
        client.write(UNIFORM, 256, 0).ok()
    });
}

fn is_in(client: &mut Raw, run_state: u16) -> Option<()> {
    (client.read_unit(UNIFORM, 2, 1).ok()?[0] == run_state).then_some(())
}

#[test]
fn all_mistakes_of_all_model_files_are_reported_at_once() {
    let written = Written::new();
    let text = std::fs::read_to_string(&written.model).unwrap();
    let (one, other) = (
        written.models.join("one.toml"),
        written.models.join("other.toml"),
    );
    std::fs::write(&one, replaced(&text, "poll = \"fast\"", "poll = \"fats\"")).unwrap();
    std::fs::write(&other, &text).unwrap();
    let configuration = std::fs::read_to_string(&written.configuration).unwrap();
    let configuration = replaced(&configuration, "station = 1", "station = 1\npoll = \"1ms\"");
    let file = written.place.write("wrong.toml", &configuration);
    for said in [
        ask(&["check", "-c", file.to_str().unwrap()], 2),
        ask(&["run", "-c", file.to_str().unwrap()], 2),
        ask(
            &[
                "models",
                "list",
                "--model-dir",
                written.models.to_str().unwrap(),
            ],
            2,
        ),
    ] {
        let line = text
            .lines()
            .position(|line| line == "poll = \"fast\"")
            .unwrap()
            + 1;
        assert!(
            said.contains(&format!("{}:{line}:8", one.display())) && said.contains("\"fast\""),
            "{said}"
        );
        let both = said.contains(&other.display().to_string())
            && said.contains(&written.model.display().to_string());
        assert!(both && said.contains("`acme-flux-2`"), "{said}");
    }
    let said = ask(&["check", "-c", file.to_str().unwrap()], 2);
    assert!(
        said.contains("wrong.toml:") && said.contains("1ms is out of range"),
        "{said}"
    );
    assert!(!said.contains("there is no model"), "{said}");
}

#[test]
fn a_directory_that_cannot_be_read_is_reported_with_its_place() {
    let written = Written::new();
    let text = std::fs::read_to_string(&written.configuration).unwrap();
    let missing = written.place.file("missing");
    let configuration = replaced(
        &text,
        written.models.to_str().unwrap(),
        missing.to_str().unwrap(),
    );
    let file = written.place.write("missing.toml", &configuration);
    let said = ask(&["check", "-c", file.to_str().unwrap()], 2);
    assert!(said.contains(&format!("{}:2:15", file.display())), "{said}");
    assert!(
        said.contains("No such file") && said.contains("1 problem") && !said.contains("no model"),
        "{said}"
    );
    let said = ask(
        &[
            "simulate",
            "--model",
            "acme-flux-2",
            "--model-dir",
            missing.to_str().unwrap(),
        ],
        2,
    );
    assert!(said.contains("No such file"), "{said}");
    std::fs::write(
        written.models.join("long.toml"),
        "#".repeat(1024 * 1024 + 1),
    )
    .unwrap();
    std::fs::write(written.models.join(".hidden.toml"), "x =").unwrap();
    std::fs::write(written.models.join("notes.txt"), "x =").unwrap();
    let said = ask(&["check", "-c", written.configuration.to_str().unwrap()], 2);
    assert!(
        said.contains("long.toml: it is 1048577 bytes long; 1048576 bytes are the most")
            && said.contains("1 problem"),
        "{said}"
    );
    for number in 0..257 {
        std::fs::write(written.models.join(format!("{number}.toml")), "").unwrap();
    }
    let said = ask(
        &["models", "--model-dir", written.models.to_str().unwrap()],
        2,
    );
    assert!(
        said.contains("there are more than 256 model files"),
        "{said}"
    );
}

/// What the program says with `args`, ending with `code`.
#[track_caller]
fn ask(args: &[&str], code: i32) -> String {
    let output = vfd_gateway(args);
    let said = format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    assert_eq!(output.status.code(), Some(code), "{args:?}:\n{said}");
    said
}

#[track_caller]
fn replaced(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1)
}

/// The blocks of the document: those of the model, one after the other, and the configuration behind them.
fn of_document() -> (String, String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/adding-a-drive.md");
    let text = std::fs::read_to_string(path).unwrap();
    let (model, rest) = text.split_once("\n## Checking it\n").unwrap();
    let [configuration, like] = &blocks(rest)[..] else {
        panic!("a configuration and a model")
    };
    assert!(like.contains("like = \"acme-flux-2\""), "{like}");
    (blocks(model).join("\n"), configuration.clone())
}

/// What of a document is TOML.
fn blocks(text: &str) -> Vec<String> {
    let blocks = text.split("```toml\n").skip(1);
    blocks
        .map(|block| block.split_once("```").unwrap().0.to_owned())
        .collect()
}
