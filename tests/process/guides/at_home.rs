//! The guides to Home Assistant and to Node-RED, up to the drive that each of them shows.

use super::super::hass::{self, Hass};
use super::super::node_red::NodeRed;
use super::super::rig::Place;
use super::super::started::{PATIENCE, until};
use super::broker::Broker;
use super::first_steps::played;
use super::follow::{Guide, NotRun, Table};
use super::text::document;
use super::{ADAPTER, DATA_DIR};

/// What a reader has in the place of the adapter, the directory and the broker.
fn places(place: &Place, broker: &Broker) -> Table {
    std::fs::create_dir(place.file("data")).unwrap();
    let here = |name: &str| place.file(name).to_str().unwrap().to_owned();
    vec![
        (ADAPTER, here("line")),
        (DATA_DIR, here("data")),
        (
            "mqtt://192.0.2.7",
            format!("mqtt://127.0.0.1:{}", broker.port()),
        ),
        ("-h 192.0.2.7", format!("-h 127.0.0.1 -p {}", broker.port())),
    ]
}

/// The last line of a guide that looks at the broker.
const LOOK: &str = "mosquitto_sub -h 192.0.2.7";

#[test]
fn the_guide_to_home_assistant_works() {
    const NOT_RUN: &[NotRun] = &[(
        "- alias: Pump starts at seven",
        "it starts a pump in the morning: `home_assistant` loads the delivered package with these automations",
    )];
    let place = Place::new();
    let _drive = played(&place, "line", "hyundai-n700");
    let broker = Broker::start(&place);
    let mut table = places(&place, &broker);
    table.push(("/run/secrets/mqtt", broker.password_file.clone()));
    let mut shown = Vec::new();
    Guide::new("docs/home-assistant.md", place, table, NOT_RUN).follow(|guide, typed| {
        if !typed.line.starts_with(LOOK) || !typed.line.contains("frequency/output") {
            return;
        }
        let Some(program) = hass::program() else {
            return;
        };
        let hass = Hass::start(program, &guide.place, broker.mosquitto.address());
        hass.wait_for("binary_sensor.pump_1_connected", "on");
        let frequency = until("the frequency is shown", PATIENCE, || {
            let entity = hass.entity("sensor.pump_1_output_frequency")?;
            entity["state"].as_str()?.parse::<f64>().ok()
        });
        shown.push(frequency);
    });
    assert!(
        hass::program().is_none() || shown == [0.0],
        "Home Assistant was not looked at: {shown:?}"
    );
}

#[test]
fn the_guide_to_node_red_works() {
    const NOT_RUN: &[NotRun] = &[(
        "{",
        "a document that is shown: the test of all documents reads it",
    )];
    let place = Place::new();
    let _drive = played(&place, "line", "hyundai-n700");
    let broker = Broker::start(&place);
    let table = places(&place, &broker);
    let mut shown = Vec::new();
    Guide::new("docs/node-red.md", place, table, NOT_RUN).follow(|guide, typed| {
        if !typed.line.starts_with(LOOK) {
            return;
        }
        // The gateway and the drive of this guide are called as in the flow: only the broker is set.
        let flow = document("deploy/node-red/flow.json");
        let with_port = flow.replace(
            "\"port\": \"1883\"",
            &format!("\"port\": \"{}\"", broker.port()),
        );
        assert!(with_port != flow && flow.contains("vfd/plant-a/drive/pump-1/"));
        let node_red = NodeRed::start(
            &guide.place,
            &with_port.replace("\"localhost\"", "\"127.0.0.1\""),
        );
        node_red.wait_for("presence", 0, "online");
        shown.push(node_red.wait_for("state", 0, "0 Hz"));
    });
    assert_eq!(shown.len(), 1, "Node-RED was not looked at");
}
