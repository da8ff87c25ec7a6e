//! What a foreign Sparkplug host sees of two gateways that are one edge node.

use super::super::mosquitto::{Mosquitto, free_port};
use super::super::plant::get;
use super::super::rig::{Place, assert_says, vfd_gateway};
use super::super::scada::{Scada, metrics};
use super::super::sparkplug::assert_sequence;
use super::super::started::until;
use super::A_WHILE;
use super::pair::{A, B, PATIENCE, Pair};
use serde_json::{Value, json};
use std::net::{Ipv4Addr, SocketAddr};

/// A pair at a broker, and a host that is online.
struct Plant {
    pair: Pair,
    scada: Scada,
    /// Where each half serves its metrics.
    http: [SocketAddr; 2],
    _broker: Mosquitto,
    _place: Place,
}

impl Plant {
    /// The pair speaks this version of MQTT and is not started.
    fn new(version: &str) -> Self {
        let place = Place::new();
        let broker = Mosquitto::start(&place.file(""));
        let scada = Scada::online(&broker, version);
        let pair = Pair::new(9_600);
        let http = [(); 2].map(|()| SocketAddr::from((Ipv4Addr::LOCALHOST, free_port())));
        for (half, http) in pair.halves.iter().zip(http) {
            let text = std::fs::read_to_string(&half.file).unwrap();
            let text = text.replace(
                "from = [\"modbus-tcp\"]",
                "from = [\"modbus-tcp\", \"sparkplug\"]",
            );
            let mqtt = format!(
                "\n[mqtt]\nbroker = \"mqtt://{}\"\nversion = {version}\n",
                broker.address()
            );
            let sparkplug = "\n[mqtt.sparkplug]\ngroup = \"plant-a\"\nprimary_host = \"scada\"\n";
            let http = format!("\n[http]\nlisten = \"{http}\"\n");
            std::fs::write(&half.file, text + &mqtt + sparkplug + &http).unwrap();
        }
        Self {
            pair,
            scada,
            http,
            _broker: broker,
            _place: place,
        }
    }

    /// What the half at `end` says of its connection as an edge node; `None` where it has none to have.
    fn is_connected(&self, end: usize) -> Option<bool> {
        let (_, metrics) =
            get(self.http[usize::from(end == B)], "/metrics").expect("the metrics are served");
        let value = metrics
            .lines()
            .find_map(|line| line.strip_prefix("vfd_gateway_sparkplug_connected "))?;
        Some(value.trim() == "1.0")
    }

    /// Waits for the births of the node and both drives behind `seen` messages; returns that of the node.
    fn is_born(&self, seen: usize) -> Value {
        let birth = self.scada.wait_for_kind("NBIRTH", seen);
        for drive in ["pump-1", "pump-2"] {
            self.scada
                .wait_for(&format!("the birth of {drive}"), seen, |it| {
                    (it["kind"] == "DBIRTH" && it["device"] == drive).then_some(())
                });
        }
        birth
    }

    /// Waits until pump-2 shows this output behind `seen` messages.
    fn puts_out(&self, hertz: f64, seen: usize) {
        self.scada
            .wait_for(&format!("{hertz} Hz"), seen, |message| {
                let is_it = |it: &Value| {
                    it["name"] == "frequency/output" && it["value"].as_f64() == Some(hertz)
                };
                (message["device"] == "pump-2" && metrics(message).iter().any(is_it)).then_some(())
            });
    }

    /// Stops pump-2 and commands it until it puts out what it shall.
    fn runs(&self, hertz: f64) {
        let seen = self.scada.seen().len();
        self.says(&json!([{ "name": "run/set", "type": "String", "value": "stop" }]));
        until("the host's command is carried out", PATIENCE, || {
            self.says(&json!([
                { "name": "frequency/set", "type": "Double", "value": hertz },
                { "name": "run/set", "type": "String", "value": "forward" },
            ]));
            let mut looks = 0..500;
            looks.find(|_| {
                std::thread::sleep(std::time::Duration::from_millis(10));
                self.shows(hertz, seen)
            })
        });
    }

    fn says(&self, metrics: &Value) {
        self.scada
            .say(&json!({ "to": "DCMD/plant/pump-2", "metrics": metrics }));
    }

    fn shows(&self, hertz: f64, seen: usize) -> bool {
        let seen = self.scada.seen().into_iter().skip(seen);
        let of_drive = seen.filter(|it| it["device"] == "pump-2");
        let is_it =
            |it: &Value| it["name"] == "frequency/output" && it["value"].as_f64() == Some(hertz);
        of_drive
            .into_iter()
            .any(|it| metrics(&it).iter().any(is_it))
    }

    /// There was never an NBIRTH while another one was alive, each NDEATH has the number of the birth before it, and what
    /// came in between has its numbers without a gap. Returns the `bdSeq` of all births.
    #[track_caller]
    fn assert_one_at_a_time(&self) -> Vec<u64> {
        let seen = self.scada.seen();
        let (mut is_alive, mut number) = (false, &Value::Null);
        for message in &seen {
            match message["kind"].as_str().unwrap() {
                "NBIRTH" => {
                    assert!(!is_alive, "a second birth: {message}");
                    (is_alive, number) = (true, &message["bdseq"]);
                }
                // With MQTT 5 the broker publishes it once more behind an orderly end.
                "NDEATH" => {
                    assert_eq!(&message["bdseq"], number, "{message}");
                    is_alive = false;
                }
                kind => assert!(is_alive, "{kind} of one that is dead: {message}"),
            }
        }
        assert_sequence(&seen)
    }
}

fn a_host_sees_one_node_over_take_overs(version: &str) {
    let mut plant = Plant::new(version);
    plant.pair.start_one_behind_the_other();
    assert_eq!(plant.is_born(0)["bdseq"], 0);
    plant.runs(30.0);

    let seen = plant.scada.seen().len();
    plant.pair.kill(A);
    assert_eq!(plant.scada.wait_for_kind("NDEATH", seen)["bdseq"], 0);
    assert_eq!(
        plant.is_born(seen)["bdseq"],
        0,
        "the first connection of the other half"
    );
    // It was left running, as is declared for it.
    plant.puts_out(30.0, seen);
    plant.runs(20.0);

    // The first one is back and listens.
    let births = plant.assert_one_at_a_time().len();
    plant.pair.start(A);
    let back = plant.pair.hub.count();
    plant.pair.wait_for_requests(B, A_WHILE, back);
    plant.runs(25.0);
    assert_eq!(plant.assert_one_at_a_time().len(), births);

    let seen = plant.scada.seen().len();
    plant.pair.kill(B);
    assert_eq!(plant.scada.wait_for_kind("NDEATH", seen)["bdseq"], 0);
    assert_eq!(plant.is_born(seen)["bdseq"], 1, "its second connection");
    plant.puts_out(25.0, seen);
    plant.runs(30.0);
    assert_eq!(plant.assert_one_at_a_time(), [0, 0, 1]);
    plant.pair.assert_one_master();
}

#[test]
fn a_host_sees_one_node_over_take_overs_with_mqtt_5() {
    a_host_sees_one_node_over_take_overs("5");
}

#[test]
fn a_host_sees_one_node_over_take_overs_with_mqtt_3() {
    a_host_sees_one_node_over_take_overs("4");
}

/// The broker does not notice that it hangs: the connection of the other half ends its own.
#[test]
fn a_half_that_hung_leaves_the_node_to_the_other_when_it_goes_on() {
    let mut plant = Plant::new("5");
    plant.pair.start_one_behind_the_other();
    plant.is_born(0);
    plant.runs(30.0);
    let seen = plant.scada.seen().len();
    plant.pair.program(A).signal("STOP");
    assert_eq!(plant.scada.wait_for_kind("NDEATH", seen)["bdseq"], 0);
    plant.is_born(seen);
    plant.puts_out(30.0, seen);
    plant.pair.program(A).signal("CONT");
    let goes_on = plant.pair.hub.count();
    plant.pair.wait_for_requests(B, A_WHILE, goes_on);
    plant.runs(20.0);
    assert_eq!(
        plant.assert_one_at_a_time(),
        [0, 0],
        "the one that goes on is not born again"
    );
    // That the other one has taken its connection over is in order: no rival, and nothing is missing.
    until("the other one is the node", PATIENCE, || {
        (plant.is_connected(B) == Some(true)).then_some(())
    });
    assert_eq!(plant.is_connected(A), None);
    let health = vfd_gateway(&[
        "health",
        "--json",
        "-c",
        plant.pair.half(A).file.to_str().unwrap(),
    ]);
    let health: Value = serde_json::from_slice(&health.stdout).unwrap();
    assert_eq!(health["sparkplug"]["contested"], false, "{health}");
    plant.pair.assert_one_master();
}

#[test]
fn a_node_is_handed_over_and_the_motor_runs_on() {
    let mut plant = Plant::new("5");
    plant.pair.start_one_behind_the_other();
    plant.is_born(0);
    plant.runs(30.0);
    let seen = plant.scada.seen().len();
    let yields = vfd_gateway(&[
        "standby",
        "yield",
        "-c",
        plant.pair.half(A).file.to_str().unwrap(),
    ]);
    assert_says(
        &yields,
        0,
        &["line hall-1: another gateway sends on the line now"],
    );
    plant.scada.wait_for_kind("NDEATH", seen);
    plant.is_born(seen);
    plant.puts_out(30.0, seen);
    let later = plant.pair.hub.count();
    plant.pair.wait_for_requests(B, A_WHILE, later);
    assert_eq!(plant.assert_one_at_a_time(), [0, 0]);
    plant.pair.assert_turns(2);
    plant.pair.assert_one_master();
}
