//! The guides under `docs/` and the README do as they say. Each guide is followed literally: its blocks in order, each
//! in the state that those before it have left, in one fresh directory, up to a live value of a drive. Drives are
//! played, the broker is a mosquitto. Besides, every configuration is checked, also those of the reference, and every
//! document read.
//!
//! | file | guides |
//! | --- | --- |
//! | `first_steps` | one for each vendor of drives |
//! | `beside_demo` | the README, MQTT by example, a PLC or a SCADA system |
//! | `at_home` | Home Assistant, Node-RED |
//! | `on_site` | a real drive, the simulator, installing and running it |
//!
//! `figures` looks at the figures of all documents.
//!
//! `follow` is the reader, `text` and `lines` what is read, `broker` the broker on the network of the guides.

mod at_home;
mod beside_demo;
mod broker;
mod figures;
mod first_steps;
mod follow;
mod lines;
mod on_site;
mod text;

use super::rig::{Place, text_of, vfd_gateway};
use std::process::Output;
use text::{blocks, documents};

/// What every guide calls its adapter, its data directory and its listener.
const ADAPTER: &str = "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A10KZP1X-if00-port0";
const DATA_DIR: &str = "/var/lib/vfd-gateway";
const LISTEN: &str = "127.0.0.1:1502";

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
                    let whole = if is_whole {
                        block.text.clone()
                    } else {
                        around(&block.text)
                    };
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
                "sh" | "yaml" | "" | "end" => {}
                other => panic!("{name}: nobody looks at {other}"),
            }
        }
    }
    assert!(
        configurations >= 10 && json >= 3,
        "{configurations} configurations, {json} documents"
    );
}

/// Guides that are not followed here, and why.
const ELSEWHERE: [(&str, &str); 8] = [
    ("sparkplug.md", "`sparkplug` plays the host that it needs"),
    (
        "container.md",
        "`containers` and `tests/run image`: it is about images and their engines",
    ),
    ("standby.md", "`standby` plays the bus that it needs"),
    (
        "fleet.md",
        "`fleet` and `fleet_commands`: it needs a cluster of brokers",
    ),
    (
        "trouble.md",
        "it goes from symptoms to remedies, and not from a beginning to an end",
    ),
    ("mistakes.md", "`mistakes` makes each of them"),
    ("upgrade.md", "it says what changed, and nothing is typed"),
    ("../deploy/adding-a-drive.md", "`adding` follows it"),
];

#[test]
fn every_guide_is_followed() {
    let contents = text_of("docs/README.md");
    let (_, guides) = contents.split_once("## Guides").unwrap();
    let guides = guides.split_once("## Reference").unwrap().0;
    let sources = ["at_home", "beside_demo", "first_steps", "on_site"];
    let sources = sources
        .map(|name| text_of(&format!("tests/process/guides/{name}.rs")))
        .concat();
    for guide in guides
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
    {
        let is_page = guide.starts_with("first-steps/") && guide != "first-steps/README.md";
        let is_followed = is_page || sources.contains(&format!("Guide::new(\"docs/{guide}\""));
        assert!(
            is_followed != ELSEWHERE.iter().any(|(name, _)| *name == guide),
            "nobody follows {guide}"
        );
    }
}

/// A whole configuration with `part` in it, which shows a listener and no line.
fn around(part: &str) -> String {
    // A drive takes commands only from where somebody may give them.
    let from = if part.contains("[[http.users]]") {
        r#""modbus-tcp", "page""#
    } else {
        r#""modbus-tcp""#
    };
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

fn said(output: &Output) -> String {
    [&output.stdout[..], &output.stderr]
        .map(|it| String::from_utf8_lossy(it).into_owned())
        .concat()
}
