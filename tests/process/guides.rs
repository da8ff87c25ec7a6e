//! The guides under `docs/` do as they say: their configurations are checked, as those of the reference and the README are,
//! their documents are read, and what they tell to type is typed, in the order of the text, against drives that are played.

use super::demo::Demo;
use super::outsiders::mbpoll_output;
use super::raw::Raw;
use super::rig::{Place, fields, start, text_of, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// What every guide calls its adapter, its data directory and its listener.
const ADAPTER: &str = "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A10KZP1X-if00-port0";
const DATA_DIR: &str = "/var/lib/vfd-gateway";
const LISTEN: &str = "127.0.0.1:1502";
const FILE: &str = "vfd-gateway.toml";
/// The uniform unit of the drive of every guide, its run command and its output frequency.
const UNIFORM: u8 = 101;
const RUN: u16 = 256;
const OUTPUT: u16 = 4;

/// How soon a line is typed again that was refused for now.
const AGAIN_AFTER: Duration = Duration::from_millis(200);

/// A block of a document: its language and its text.
struct Block {
    language: String,
    text: String,
}

fn blocks(document: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut is_open = false;
    for line in document.lines() {
        match (line.strip_prefix("```"), is_open) {
            (Some(language), false) => found.push(Block { language: language.to_owned(), text: String::new() }),
            (None, true) => found.last_mut().unwrap().text.extend([line, "\n"]),
            (_, _) => {}
        }
        is_open ^= line.starts_with("```");
    }
    assert!(!is_open, "a block does not end");
    found
}

/// All documents under `docs/`, by their path there.
fn documents() -> Vec<(String, String)> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let mut found = Vec::new();
    let mut folders = vec![docs.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.extension().and_then(|it| it.to_str()) {
                None => folders.push(path),
                Some("md") => {
                    let name = path.strip_prefix(&docs).unwrap().to_str().unwrap().to_owned();
                    found.push((name, std::fs::read_to_string(&path).unwrap()));
                }
                Some(_) => {}
            }
        }
    }
    found.sort();
    found
}

fn document(name: &str) -> String {
    documents().into_iter().find(|(other, _)| other == name).unwrap().1
}

#[test]
fn every_configuration_and_every_document_in_the_guides_is_sound() {
    let place = Place::new();
    let (mut configurations, mut json) = (0, 0);
    let readme = ("the README".to_owned(), text_of("README.md"));
    for (name, text) in documents().into_iter().chain([readme]) {
        for block in blocks(&text) {
            match block.language.as_str() {
                "toml" if block.text.contains("[[register]]") => {
                    let file = place.write("model.toml", &block.text);
                    let output = vfd_gateway(&["models", "check", file.to_str().unwrap()]);
                    assert!(output.status.success(), "{name}: {}", said(&output));
                    configurations += 1;
                }
                "toml" => {
                    let is_whole = block.text.contains("[[line]]");
                    let whole = if is_whole { block.text.clone() } else { around(&block.text) };
                    let file = place.write("block.toml", &whole);
                    let output = vfd_gateway(&["check", "-c", file.to_str().unwrap()]);
                    assert!(output.status.success(), "{name}: {}", said(&output));
                    configurations += 1;
                }
                "json" => {
                    let value = serde_json::from_str::<serde_json::Value>(&block.text);
                    value.unwrap_or_else(|error| panic!("{name}: {error} in {}", block.text));
                    json += 1;
                }
                "sh" | "yaml" | "" => {}
                other => panic!("{name}: nobody looks at {other}"),
            }
        }
    }
    assert!(configurations >= 10 && json >= 3, "{configurations} configurations, {json} documents");
}

/// A whole configuration with `part` in it, which shows a listener and no line.
fn around(part: &str) -> String {
    // A drive takes commands only from where somebody may give them.
    let from = if part.contains("[[http.users]]") { r#""modbus-tcp", "page""# } else { r#""modbus-tcp""# };
    format!(
        r#"
[[line]]
name = "hall-1"
port = "{ADAPTER}"

[[line.drive]]
name = "pump-1"
model = "hyundai-n700"
station = 1

[line.drive.control]
from = [{from}]
frequency_hz = {{ min = 5.0, max = 50.0 }}
on_commander_lost = "stop"
lost_after = "10s"
on_shutdown = "stop"

[[line.drive]]
name = "pump-2"
model = "hyundai-n700"
station = 2

[[modbus_tcp]]
listen = "{LISTEN}"
write = ["127.0.0.1/32"]

{part}
"#
    )
}

#[test]
fn every_model_that_is_built_in_has_first_steps() {
    let listed: serde_json::Value = serde_json::from_slice(&vfd_gateway(&["models", "list", "--json"]).stdout).unwrap();
    let guides: String = documents().into_iter().filter(|(name, _)| name.starts_with("first")).map(|it| it.1).collect();
    for model in listed.as_array().unwrap() {
        let id = model["id"].as_str().unwrap();
        assert!(guides.contains(&format!("`model = \"{id}\"`")), "no guide is about {id}");
    }
}

/// Whoever follows a guide: a drive on its line, a file that is edited, a gateway that is started again.
struct Reader {
    gateway: Option<(Started, SocketAddr)>,
    link: PathBuf,
    _drive: Started,
    place: Place,
}

impl Reader {
    fn of(text: &str) -> Self {
        let place = Place::new();
        let link = place.file("line");
        std::fs::create_dir(place.file("data")).unwrap();
        let (_, model) = text.split_once("\nmodel = \"").unwrap();
        let model = model.split('"').next().unwrap();
        // Every page has RTU frames, also where the drive leaves the factory with ASCII.
        let drive = start(&["simulate", "--model", model, "--data-bits", "8", "--link", link.to_str().unwrap()]);
        drive.wait_for("that it plays", |line| line.contains("station 1").then_some(()));
        Self { gateway: None, link, _drive: drive, place }
    }

    /// The file of the guide, on this machine.
    fn edit(&self, text: &str) {
        let places = [
            (ADAPTER, self.link.to_str().unwrap().to_owned()),
            (DATA_DIR, self.place.file("data").to_str().unwrap().to_owned()),
            (LISTEN, "127.0.0.1:0".to_owned()),
        ];
        let here = places.iter().fold(text.to_owned(), |text, (there, here)| {
            assert!(text.contains(there), "no {there} in {text}");
            text.replace(there, here)
        });
        self.place.write(FILE, &here);
    }

    fn run_gateway(&mut self) {
        if let Some((mut old, _)) = self.gateway.take() {
            old.interrupt();
            assert!(old.end_within(PATIENCE).success(), "{}", old.text());
        }
        let gateway = start(&["run", "-c", self.place.file(FILE).to_str().unwrap()]);
        let address = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        gateway.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
        self.gateway = Some((gateway, address));
    }

    fn address(&self) -> SocketAddr {
        self.gateway.as_ref().unwrap().1
    }

    /// A shell in which `line` is typed, with the port that the gateway has here, and nobody to answer questions.
    fn shell(&self, line: &str) -> Command {
        let more = match line.split(' ').nth(1) {
            Some("read" | "write") => format!(" --port {}", self.address().port()),
            Some("enable") => " --yes".to_owned(),
            Some("watchdog") if line.contains("--set") => " --yes".to_owned(),
            _ => String::new(),
        };
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("exec {line}{more}")]).current_dir(self.place.file(""));
        shell.env("PATH", path_with_the_program());
        shell
    }

    fn word(&self, address: u16) -> u16 {
        Raw::connect(self.address()).read_unit(UNIFORM, address, 1).unwrap()[0]
    }

    fn type_line(&mut self, line: &str) {
        match line.split(' ').nth(1).unwrap() {
            "run" => self.run_gateway(),
            "check" | "health" | "read" | "verify" | "enable" | "watchdog" | "journal" => self.type_until_done(line),
            "write" if line.ends_with("run forward") => self.run_forward(line),
            "write" => self.type_until_done(line),
            other => panic!("nobody tries `{other}`"),
        }
    }

    /// What was ordered just before may still be under way.
    fn type_until_done(&self, line: &str) {
        let begun = Instant::now();
        loop {
            let output = self.shell(line).output().unwrap();
            if output.status.success() {
                return;
            }
            assert!(begun.elapsed() < PATIENCE, "{line}: {}", said(&output));
            std::thread::sleep(AGAIN_AFTER);
        }
    }

    /// It stays until Ctrl-C, and stops the motor then.
    fn run_forward(&self, line: &str) {
        let mut writer = until("the start is taken", PATIENCE, || {
            let mut writer = Started::new(self.shell(line));
            until("it runs or is refused", PATIENCE, || (writer.has_ended() || self.word(RUN) == 1).then_some(()));
            (!writer.has_ended()).then_some(writer)
        });
        until("the motor turns", PATIENCE, || turns(self.word(OUTPUT)).then_some(()));
        writer.interrupt();
        assert!(writer.end_within(PATIENCE).success(), "{}", writer.text());
        until("the motor stands", PATIENCE, || (self.word(OUTPUT) == 0).then_some(()));
    }

    /// Reads the guide from its beginning to its end.
    fn follow(name: &str) {
        let text = document(name);
        let mut reader = Self::of(&text);
        let mut typed = 0;
        for block in blocks(&text) {
            match block.language.as_str() {
                "toml" => reader.edit(&block.text),
                "sh" => {
                    for line in block.text.lines() {
                        reader.type_line(line);
                        typed += 1;
                    }
                }
                _ => {}
            }
        }
        assert!(typed > 10, "{typed} lines of {name}");
    }
}

/// Whether an output frequency is known, and above 1 Hz.
fn turns(word: u16) -> bool {
    (101..u16::MAX).contains(&word)
}

fn path_with_the_program() -> String {
    let program = Path::new(env!("CARGO_BIN_EXE_vfd-gateway")).parent().unwrap().to_str().unwrap();
    format!("{program}:{}", std::env::var("PATH").unwrap())
}

fn said(output: &Output) -> String {
    [&output.stdout[..], &output.stderr].map(|it| String::from_utf8_lossy(it).into_owned()).concat()
}

/// One test for each page of first steps.
macro_rules! first_steps {
    ($($test:ident => $page:literal,)*) => {
        $(
            #[test]
            fn $test() {
                Reader::follow(concat!("first-steps/", $page, ".md"));
            }
        )*

        const FOLLOWED: &[&str] = &[$(concat!("first-steps/", $page, ".md")),*];
    };
}

first_steps! {
    the_first_steps_with_abb_work => "abb",
    the_first_steps_with_actech_work => "actech",
    the_first_steps_with_automationdirect_work => "automationdirect",
    the_first_steps_with_control_techniques_work => "control-techniques",
    the_first_steps_with_danfoss_work => "danfoss",
    the_first_steps_with_delta_work => "delta",
    the_first_steps_with_eaton_work => "eaton",
    the_first_steps_with_frecon_work => "frecon",
    the_first_steps_with_fuji_work => "fuji",
    the_first_steps_with_hitachi_work => "hitachi",
    the_first_steps_with_huanyang_work => "huanyang",
    the_first_steps_with_hyundai_n100plus_work => "hyundai-n100plus",
    the_first_steps_with_hyundai_n700_work => "hyundai-n700",
    the_first_steps_with_inovance_work => "inovance",
    the_first_steps_with_invertek_work => "invertek",
    the_first_steps_with_invt_work => "invt",
    the_first_steps_with_ls_work => "ls",
    the_first_steps_with_mitsubishi_work => "mitsubishi",
    the_first_steps_with_omron_work => "omron",
    the_first_steps_with_powtran_work => "powtran",
    the_first_steps_with_rockwell_work => "rockwell",
    the_first_steps_with_schneider_work => "schneider",
    the_first_steps_with_siemens_work => "siemens",
    the_first_steps_with_spindles_work => "spindles",
    the_first_steps_with_sunfar_work => "sunfar",
    the_first_steps_with_teco_work => "teco",
    the_first_steps_with_toshiba_work => "toshiba",
    the_first_steps_with_vacon_work => "vacon",
    the_first_steps_with_weg_work => "weg",
    the_first_steps_with_yaskawa_work => "yaskawa",
}

#[test]
fn every_page_of_first_steps_is_followed() {
    let pages = documents().into_iter().map(|(name, _)| name);
    let pages: Vec<_> = pages.filter(|name| name.starts_with("first") && !name.ends_with("README.md")).collect();
    assert_eq!(pages, FOLLOWED);
}

/// The demo beside which lines of a guide are typed.
struct Beside(Demo);

impl Beside {
    fn start() -> Self {
        Self(Demo::new())
    }

    /// `line` with the ports of this demo, line by line as in a terminal.
    fn shell(&self, line: &str) -> Command {
        let line = line.replace("-p 1883", &format!("-p {}", self.0.broker.port()));
        let line = line.replace("-p 1502", &format!("-p {}", self.0.modbus.port()));
        let mut shell = Command::new("timeout");
        shell.args([&PATIENCE.as_secs().to_string(), "stdbuf", "-oL", "sh", "-c", &format!("exec {line}")]);
        shell
    }

    /// The lines of the guide called `name` that begin with `tool`.
    fn lines(name: &str, tool: &str) -> Vec<String> {
        let of_shell = blocks(&document(name)).into_iter().filter(|block| block.language == "sh");
        let lines: Vec<_> = of_shell.flat_map(|it| it.text.lines().map(str::to_owned).collect::<Vec<_>>()).collect();
        lines.into_iter().filter(|line| line.starts_with(tool)).collect()
    }

    /// What a register of a uniform unit holds.
    fn word(&self, unit: u8, address: u16) -> u16 {
        Raw::connect(self.0.modbus).read_unit(unit, address, 1).unwrap()[0]
    }

    fn end(mut self) {
        self.0.program.interrupt();
        assert!(self.0.program.end_within(PATIENCE).success(), "{}", self.0.program.text());
    }
}

#[test]
fn the_lines_of_the_guide_to_mqtt_work_beside_the_demo() {
    let demo = Beside::start();
    let results = "mosquitto_sub -h 127.0.0.1 -p 1883 -v -t vfd/demo/drive/+/result -t vfd/demo/status";
    let results = Started::new(demo.shell(&results.replace(" -v", " -v -W 120")));
    results.wait_for("the gateway", |line| line.ends_with("online").then_some(()));
    let taken = || {
        let is_taken = |line: &String| {
            let result: serde_json::Value = serde_json::from_str(line.split_once(' ')?.1).ok()?;
            let is_good = ["acknowledged", "confirmed"].iter().any(|word| result["outcome"] == **word);
            (result["final"] == true && is_good).then_some(())
        };
        results.find_all(is_taken).len()
    };
    let lines = Beside::lines("mqtt.md", "mosquitto_");
    assert!(lines.len() >= 12, "{lines:?}");
    for line in lines {
        let before = taken();
        let output = demo.shell(&line).output().unwrap();
        assert!(output.status.success(), "{line}: {}", said(&output));
        if line.starts_with("mosquitto_pub") && (line.contains("/command ") || line.contains("/set ")) {
            until(&format!("the end of {line}"), PATIENCE, || (taken() > before).then_some(()));
        } else if line.starts_with("mosquitto_sub") {
            assert!(!output.stdout.is_empty(), "{line}");
        }
    }
    drop(results);
    demo.end();
}

#[test]
fn the_lines_of_the_guide_to_plcs_work_beside_the_demo() {
    let demo = Beside::start();
    let lines = Beside::lines("plc-and-scada.md", "mbpoll");
    assert!(lines.len() >= 9, "{lines:?}");
    for line in lines {
        let is_read = line.contains(" -c ");
        until(&line, PATIENCE, || {
            let said = mbpoll_output(&mut demo.shell(&line));
            let is_done = if is_read { !said.values.is_empty() } else { said.text.contains("Written 1 references.") };
            is_done.then_some(())
        });
        if line.ends_with("-r 258 -p 1502 127.0.0.1 1") {
            until("the motor turns", PATIENCE, || turns(demo.word(UNIFORM, OUTPUT)).then_some(()));
        }
    }
    demo.end();
}

#[test]
fn the_five_minutes_of_the_readme_work_beside_the_demo() {
    let demo = Beside::start();
    let readme = text_of("README.md");
    let (_, tour) = readme.split_once("Five minutes more").unwrap();
    let tour = blocks(tour.split_once("\n## ").unwrap().0).remove(0).text;
    let port = format!(" --port {}", demo.0.modbus.port());
    for line in tour.lines().map(|line| line.split('#').next().unwrap().trim()) {
        let more = if line.contains("--unit") { &port } else { "" };
        let line = line.replace("http://127.0.0.1:8080", &demo.0.page) + more;
        let mut shell = demo.shell(&line);
        shell.env("PATH", path_with_the_program());
        if !line.contains("run forward") {
            until(&line, PATIENCE, || shell.output().unwrap().status.success().then_some(()));
            continue;
        }
        // A person is slower than this: the stop before it is effective by then.
        let mut writer = until(&line, PATIENCE, || {
            let mut shell = Command::new("sh");
            shell.args(["-c", &format!("exec {line}")]).env("PATH", path_with_the_program());
            let mut writer = Started::new(shell);
            let is_refused = until("an answer", PATIENCE, || match writer.text().contains("the lease is renewed") {
                true => Some(false),
                false => writer.has_ended().then_some(true),
            });
            (!is_refused).then_some(writer)
        });
        until("the motor turns", PATIENCE, || turns(demo.word(103, OUTPUT)).then_some(()));
        writer.interrupt();
        assert!(writer.end_within(PATIENCE).success(), "{}", writer.text());
    }
    demo.end();
}
