//! The embedded broker against other people's clients: mosquitto's tools and paho-mqtt.

use super::mosquitto::{Mosquitto, Subscriber};
use super::outsiders::paho_round;
use super::rig::program;
use super::started::{PATIENCE, Started};
use serde_json::json;
use std::net::SocketAddr;

const VERSIONS: [&str; 2] = ["mqttv311", "mqttv5"];

/// `vfd-gateway broker`, and the tools for it.
struct Embedded {
    program: Started,
    port: u16,
    tools: Mosquitto,
}

impl Embedded {
    fn new() -> Self {
        let mut command = program();
        command.args(["broker", "--listen", "127.0.0.1:0"]);
        // It ends with its input.
        let program = Started::at_a_keyboard(command);
        let address: SocketAddr = program.wait_for("where it listens", |line| {
            line.strip_prefix("listening on ")?.trim().parse().ok()
        });
        Self {
            program,
            port: address.port(),
            tools: Mosquitto::tools_for(address.port()),
        }
    }

    /// Its log has no warning.
    fn assert_is_content(&self) {
        let words = ["\"WARN\"", "\"ERROR\"", "panicked"];
        let wrong = self.program.find_all(|line| {
            words
                .iter()
                .any(|it| line.contains(it))
                .then(|| line.clone())
        });
        assert_eq!(wrong, [""; 0]);
    }
}

#[test]
fn mosquittos_tools_get_every_quality_of_service_in_both_versions() {
    let broker = Embedded::new();
    for reads in VERSIONS {
        for qos in ["0", "1", "2"] {
            let reader = Subscriber::with(&broker.tools, reads, "a/+/c", &["-q", qos]);
            for writes in VERSIONS {
                for (sent, number) in [("0", 0), ("1", 1), ("2", 2)] {
                    let payload = format!("{writes} {sent}");
                    broker
                        .tools
                        .publish_with(&["-V", writes, "-q", sent, "-t", "a/b/c", "-m", &payload]);
                    let got = reader.wait_for_payload("a/b/c", &payload);
                    assert_eq!(
                        (got.qos, got.retain),
                        (number.min(qos.parse().unwrap()), false),
                        "{reads} {payload}"
                    );
                }
            }
            assert_eq!(reader.on("a/b/c").len(), 6, "each once");
        }
    }
    broker.assert_is_content();
}

#[test]
fn mosquittos_tools_find_what_is_retained_what_waited_and_the_will() {
    let broker = Embedded::new();
    for version in VERSIONS {
        let topic = |name: &str| format!("{version}/{name}");
        broker
            .tools
            .publish_with(&["-V", version, "-r", "-t", &topic("kept"), "-m", "value"]);
        let watcher = Subscriber::new(&broker.tools, version, &topic("#"));
        assert!(watcher.wait_for_payload("kept", "value").retain);
        broker
            .tools
            .publish_with(&["-V", version, "-r", "-t", &topic("kept"), "-m", "newer"]);
        assert!(!watcher.wait_for_payload("kept", "newer").retain);
        broker
            .tools
            .publish_with(&["-V", version, "-r", "-n", "-t", &topic("kept")]);
        watcher.wait_for_payload("kept", "");
        broker
            .tools
            .publish_with(&["-V", version, "-t", &topic("marker"), "-m", "end"]);
        let late = Subscriber::new(&broker.tools, version, &topic("#"));
        broker
            .tools
            .publish_with(&["-V", version, "-t", &topic("marker"), "-m", "later"]);
        late.wait_for_payload("marker", "later");
        assert!(!late.has("kept"), "it is cleared");

        let waits: &[&str] = if version == "mqttv5" {
            &["-c", "-x", "600"]
        } else {
            &["-c"]
        };
        let id = topic("id");
        let lasting = [waits, &["-i", &id]].concat();
        drop(Subscriber::with(
            &broker.tools,
            version,
            &topic("waits"),
            &lasting,
        ));
        broker.tools.publish_with(&[
            "-V",
            version,
            "-q",
            "2",
            "-t",
            &topic("waits"),
            "-m",
            "for me",
        ]);
        Subscriber::with(&broker.tools, version, &topic("waits"), &lasting)
            .wait_for_payload("waits", "for me");

        let will = topic("will");
        let will = [
            "--will-topic",
            &will,
            "--will-payload",
            "gone",
            "--will-qos",
            "1",
        ];
        drop(Subscriber::with(&broker.tools, version, "nothing", &will));
        assert_eq!(watcher.wait_for_payload("will", "gone").qos, 1);
    }
    let refused = broker
        .tools
        .try_publish_with(&["-V", "mqttv31", "-t", "a", "-m", "b"])
        .unwrap_err();
    assert!(
        refused.contains("unacceptable protocol version"),
        "{refused}"
    );
    broker.assert_is_content();
}

#[test]
fn paho_gets_every_quality_of_service_what_is_retained_and_the_will() {
    let broker = Embedded::new();
    for version in ["4", "5"] {
        let round = paho_round(broker.port, version);
        assert_eq!(
            round["live"],
            json!([["0", 0, false], ["1", 1, false], ["2", 2, false]]),
            "{version}"
        );
        assert_eq!(round["kept"], json!([["value", 1, true]]), "{version}");
        assert_eq!(
            round["waited"],
            json!([true, [["1", 1, false], ["2", 2, false]]]),
            "{version}"
        );
        assert_eq!(round["will"], json!([["gone", 1, false]]), "{version}");
        assert_eq!(round["many"], json!(500), "{version}");
        if version == "5" {
            let properties = json!({"user": [["a", "1"], ["a", "2"]], "correlation": "42", "response": "answer",
                "content": "text", "format": 1, "identifiers": [7], "counts_down": true});
            assert_eq!(round["properties"], properties);
            assert_eq!(round["assigned"], true);
            assert_eq!(round["taken_over"], 142);
        }
    }
    broker.assert_is_content();
}

#[test]
fn it_ends_with_its_input() {
    let mut broker = Embedded::new();
    let reader = Subscriber::new(&broker.tools, "mqttv5", "#");
    broker.program.end_of_input();
    assert!(
        broker.program.end_within(PATIENCE).success(),
        "{}",
        broker.program.text()
    );
    drop(reader);
}
