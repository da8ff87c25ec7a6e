//! Sparkplug B: a host that nobody here wrote finds the gateway and its drive, commands it, and loses it.

use super::mosquitto::Mosquitto;
use super::plant::{FREQUENCY, LOST_AFTER, MARGIN, Plant, RUN, Wish};
use super::rig::fields;
use super::scada::{Scada, metric, metrics};
use super::started::{PATIENCE, until};
use serde_json::{Value, json};

/// Brokers are killed so often, or as often as this variable says.
const KILLS: (&str, usize) = ("SPARKPLUG_KILLS", 5);

const SPARKPLUG: &str = "[mqtt.sparkplug]\ngroup = \"plant-a\"\nprimary_host = \"scada\"\n";

/// A plant whose drive takes commands from a host, with these keys of `[mqtt]`.
fn plant(mqtt: &str) -> Plant {
    let mqtt = format!("{mqtt}\n{SPARKPLUG}");
    Plant::with(Wish {
        mqtt: &mqtt,
        from: ", \"sparkplug\"",
        ..Wish::default()
    })
}

fn number(value: &Value) -> u64 {
    value
        .as_u64()
        .unwrap_or_else(|| panic!("no number: {value}"))
}

/// Whether numbers run on without a gap from each NBIRTH, and each NDEATH has the number of the birth before it.
/// Returns the `bdSeq` of all NBIRTHs.
pub fn assert_sequence(seen: &[Value]) -> Vec<u64> {
    let (mut sessions, mut next) = (Vec::new(), None);
    for message in seen {
        let kind = message["kind"].as_str().unwrap();
        assert_eq!(message["retain"], false, "{message}");
        match kind {
            "NBIRTH" => {
                assert_eq!(message["seq"], 0, "{message}");
                sessions.push(number(&message["bdseq"]));
                next = Some(1);
                continue;
            }
            "NDEATH" => {
                assert_eq!(
                    (&message["seq"], metrics(message).len()),
                    (&Value::Null, 1),
                    "{message}"
                );
                continue;
            }
            _ => {}
        }
        // Of what came before this host was there, it has seen no birth.
        let Some(expected) = next else { continue };
        assert_eq!(
            (number(&message["seq"]), &message["qos"]),
            (expected, &json!(0)),
            "{message}"
        );
        next = Some((expected + 1) % 256);
    }
    sessions
}

#[test]
fn a_host_finds_the_gateway_and_its_drive_with_names_types_units_and_limits() {
    for version in ["5", "4"] {
        let plant = plant(&format!("version = {version}"));
        let scada = Scada::online(&plant.broker, version);
        let node = scada.wait_for_kind("NBIRTH", 0);
        assert_eq!(
            (&node["node"], &node["bdseq"], &node["seq"]),
            (&json!("plant"), &json!(0), &json!(0))
        );
        assert_eq!(metric(&node, "Node Control/Rebirth")["value"], false);
        assert_eq!(metric(&node, "line/hall-1/status")["value"], "up");
        let drive = scada.wait_for_kind("DBIRTH", 0);
        assert_eq!(
            (&drive["device"], &drive["seq"]),
            (&json!("pump-1"), &json!(1))
        );
        let output = metric(&drive, "frequency/output");
        assert_eq!(
            (&output["type"], &output["properties"]["engUnit"]),
            (&json!("Double"), &json!("Hz"))
        );
        assert!(output["properties"]["Quality"].is_u64(), "{output}");
        let input = metric(&drive, "frequency/set");
        let of_input = &input["properties"];
        assert_eq!(
            (
                &of_input["engLow"],
                &of_input["engHigh"],
                &of_input["readOnly"]
            ),
            (&json!(5), &json!(50), &json!(false))
        );
        // What was not read yet when the drive was born comes as data.
        scada.wait_for_value("frequency/output", &0.into(), 0);
        scada.wait_for_value("run/state", &"stopped".into(), 0);
        // An N700 counts its trips and does not say whether one holds.
        let trip = metric(&drive, "trip/active");
        assert_eq!(
            (&trip["type"], &trip["value"]),
            (&json!("Boolean"), &Value::Null)
        );
        assert_eq!(metric(&drive, "Properties/model")["value"], "hyundai-n700");
        assert!(
            metrics(&drive)
                .iter()
                .all(|it| it["alias"].is_u64() && it["at"].is_u64()),
            "{drive}"
        );
        assert_sequence(&scada.seen());
        for metric in metrics(&node).iter().chain(metrics(&drive)) {
            assert_is_documented(metric);
        }
    }
}

/// The guide has a row for it.
fn assert_is_documented(metric: &Value) {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/sparkplug.md");
    let guide = std::fs::read_to_string(file).unwrap();
    let name = metric["name"].as_str().unwrap();
    let name = match name.split('/').collect::<Vec<_>>()[..] {
        ["measure", _] => "measure/NAME",
        ["line", _, "status"] => "line/LINE/status",
        _ => name,
    };
    let has_it = guide
        .lines()
        .any(|line| line.starts_with("| `") && line.contains(&format!("`{name}`")));
    assert!(has_it, "docs/sparkplug.md has no {name}");
}

#[test]
fn a_host_commands_the_drive_sees_its_outcome_and_stops_it_by_dying() {
    let plant = plant("");
    let scada = Scada::online(&plant.broker, "5");
    scada.wait_for_kind("DBIRTH", 0);
    until("the way back is proven", PATIENCE, || {
        (plant.metric("vfd_gateway_sparkplug_connected") == 1.0).then_some(())
    });
    scada.write(&json!([
        { "name": "frequency/set", "type": "Double", "value": 30.0 },
        { "name": "run/set", "type": "String", "value": "forward" },
    ]));
    plant.wait_until_it_turns();
    assert_eq!(plant.written(), [(FREQUENCY, 3000), (RUN, 1)]);
    scada.wait_for_value("run/state", &"forward".into(), 0);
    scada.wait_for_value("run/set", &"forward".into(), 0);
    scada.wait_for_value("frequency/output", &30.into(), 0);
    scada.wait_for_value("control/owner", &"sparkplug".into(), 0);
    let seen = scada.seen().len();
    scada.write(&json!([{ "name": "frequency/set", "type": "Double", "value": 70.0 }]));
    scada.wait_for("the limits", seen, |message| {
        let says = |it: &Value| {
            it["value"]
                .as_str()
                .is_some_and(|it| it.contains("limits of 5.00 to 50.00 Hz"))
        };
        metrics(message)
            .iter()
            .any(|it| it["name"] == "result/message" && says(it))
            .then_some(())
    });
    scada.write_text("run/set", "stop");
    plant.wait_until_it_stands();
    until("it runs again", PATIENCE, || {
        scada.write_text("run/set", "forward");
        (plant.output() > Some(200)).then_some(())
    });
    let written = plant.written().len();
    scada.say(&json!({ "vanish": true }));
    plant.wait_for_write(written, (RUN, 0), LOST_AFTER + MARGIN);
    plant.wait_until_it_stands();
}

#[test]
fn what_is_retained_or_old_or_no_command_moves_nothing() {
    let plant = plant("");
    let scada = Scada::online(&plant.broker, "5");
    scada.wait_for_kind("DBIRTH", 0);
    until("the way back is proven", PATIENCE, || {
        (plant.metric("vfd_gateway_sparkplug_connected") == 1.0).then_some(())
    });
    let forward = json!([{ "name": "run/set", "type": "String", "value": "forward" }]);
    let order = |more: Value| {
        let mut order = json!({ "to": "DCMD/plant/pump-1", "metrics": forward });
        order
            .as_object_mut()
            .unwrap()
            .extend(more.as_object().unwrap().clone());
        let seen = scada.seen().len();
        scada.say(&order);
        seen
    };
    scada.wait_for_reason("retained", order(json!({ "retain": true })));
    scada.wait_for_reason("stale", order(json!({ "age_ms": 11_000 })));
    scada.wait_for_reason("clock_ahead", order(json!({ "age_ms": -61_000 })));
    let unknown = json!([{ "name": "run/sett", "type": "String", "value": "forward" }]);
    scada.wait_for_reason("not_understood", order(json!({ "metrics": unknown })));
    assert_eq!(
        plant.metric("vfd_gateway_sparkplug_refused_retained_total"),
        1.0
    );
    assert_eq!(
        plant.metric("vfd_gateway_sparkplug_refused_stale_total"),
        2.0
    );
    plant.assert_nothing_was_written_since(0);
}

#[test]
fn births_come_again_when_they_are_asked_for_and_after_a_drive_was_away() {
    let plant = plant("");
    let scada = Scada::online(&plant.broker, "5");
    scada.wait_for_kind("DBIRTH", 0);
    let seen = scada.seen().len();
    scada.ask_for_births();
    let node = scada.wait_for_kind("NBIRTH", seen);
    assert_eq!(
        (&node["seq"], &node["bdseq"]),
        (&json!(0), &json!(0)),
        "the same connection"
    );
    scada.wait_for_kind("DBIRTH", seen);
    plant.silence_the_drive();
    scada.wait_for_kind("DDEATH", seen);
    let seen = scada.seen().len();
    plant.wake_the_drive();
    scada.wait_for_kind("DBIRTH", seen);
    assert_eq!(assert_sequence(&scada.seen()), [0, 0]);
}

#[test]
fn a_primary_host_that_goes_offline_is_left_and_waited_for() {
    let plant = plant("");
    let scada = Scada::online(&plant.broker, "5");
    scada.wait_for_kind("DBIRTH", 0);
    let seen = scada.seen().len();
    // Older than its birth: the will of a former session, which comes late.
    scada.say(&json!({ "state": false, "at": 1 }));
    scada.ask_for_births();
    scada.wait_for_kind("DBIRTH", seen);
    assert!(scada.seen().iter().all(|it| it["kind"] != "NDEATH"));
    let seen = scada.seen().len();
    let now = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap()
        .as_millis() as u64;
    scada.say(&json!({ "state": false, "at": now }));
    let death = scada.wait_for_kind("NDEATH", seen);
    assert_eq!((&death["bdseq"], &death["qos"]), (&json!(0), &json!(1)));
    until("it waits for its host", PATIENCE, || {
        (plant.metric("vfd_gateway_sparkplug_host_awaited") == 1.0).then_some(())
    });
    let health: Value = serde_json::from_str(&plant.get("/api/v1/health").unwrap().1).unwrap();
    assert_eq!(
        (
            &health["sparkplug"]["connected"],
            &health["sparkplug"]["host_awaited"]
        ),
        (&json!(false), &json!(true))
    );
    let seen = scada.seen().len();
    scada.say(&json!({ "state": true }));
    let birth = scada.wait_for_kind("NBIRTH", seen);
    assert_eq!(birth["bdseq"], 1);
    scada.wait_for_kind("DBIRTH", seen);
    assert_eq!(assert_sequence(&scada.seen()), [0, 0, 1]);
}

/// How often the connection of the edge node found nobody at the broker's port.
fn refusals(plant: &Plant) -> usize {
    let is_one = |line: &String| {
        let fields = fields(line)?;
        let of_node = fields["client_id"].as_str()?.ends_with("-sparkplug");
        (of_node && fields["reason"].as_str()?.contains("Connection refused")).then_some(())
    };
    plant.gateway.find_all(is_one).len()
}

/// What the host of `plant` sees of the numbers while its broker is killed `kills` times.
fn kill(plant: &mut Plant, kills: usize) {
    // The host of one connection sees all of it; the will of the gateway dies with the broker.
    let mut all = Vec::new();
    for kill in 0..=kills {
        let scada = Scada::online(&plant.broker, "5");
        scada.wait_for_kind("DBIRTH", 0);
        // Something to be told, which moves nothing.
        scada.write_text("no/such", "metric");
        scada.wait_for_reason("not_understood", 0);
        let sessions = assert_sequence(&scada.seen());
        assert!(!sessions.is_empty());
        all.push(sessions[sessions.len() - 1]);
        if kill < kills {
            let before = refusals(plant);
            plant.broker.kill();
            // One that is back before anybody has missed it, again and again, looks like a rival with our identifier.
            until("the broker is missed", PATIENCE, || {
                (refusals(plant) > before).then_some(())
            });
            plant.broker.start_again();
        }
    }
    let expected: Vec<_> = (0..=kills as u64).map(|kill| kill % 256).collect();
    assert_eq!(all, expected, "one more with each CONNECT");
}

#[test]
fn numbers_are_right_over_kills_of_the_broker_and_a_restart_of_the_gateway() {
    let kills = std::env::var(KILLS.0)
        .ok()
        .map_or(KILLS.1, |kills| kills.parse().expect("a number"));
    let mut plant = plant("");
    kill(&mut plant, kills);
    plant.gateway.kill();
    let scada = Scada::online(&plant.broker, "5");
    plant.start_gateway_again();
    let birth = scada.wait_for_kind("NBIRTH", 0);
    assert_eq!(number(&birth["bdseq"]), (kills as u64 + 1) % 256);
    let seen = scada.seen().len();
    plant.gateway.terminate();
    plant.gateway.end_within(PATIENCE);
    let death = scada.wait_for_kind("NDEATH", seen);
    assert_eq!(
        death["bdseq"], birth["bdseq"],
        "an orderly end says farewell"
    );
}

#[test]
fn a_gateway_that_is_killed_is_buried_by_the_broker_with_the_number_of_its_birth() {
    let mut plant = plant("");
    let scada = Scada::online(&plant.broker, "5");
    scada.wait_for_kind("DBIRTH", 0);
    plant.gateway.kill();
    let death = scada.wait_for_kind("NDEATH", 0);
    assert_eq!(
        (&death["bdseq"], &death["qos"], &death["retain"]),
        (&json!(0), &json!(1), &json!(false))
    );
}

#[test]
fn a_trip_and_values_of_an_outage_are_reported_as_history_in_order() {
    let mut plant = plant("");
    let scada = Scada::online(&plant.broker, "5");
    scada.wait_for_kind("DBIRTH", 0);
    plant.run_over_modbus(&mut super::raw::Raw::connect(plant.modbus));
    drop(scada);
    plant.broker.kill();
    plant.wait_until_it_stands();
    // The gateway has polled the standstill, and no more changes come.
    let mut before = 0.0;
    until("the standstill waits as well", PATIENCE, || {
        let (_, text) = plant.get("/metrics")?;
        let output = text
            .lines()
            .find(|line| line.starts_with("vfd_gateway_drive_output_frequency_hertz{"))?;
        let stands = output.ends_with(" 0.0") || output.ends_with(" 0");
        let waiting = plant.metric("vfd_gateway_sparkplug_history_waiting");
        let is_all = waiting > 5.0 && std::mem::replace(&mut before, waiting) == waiting;
        (stands && is_all).then_some(())
    });
    plant.broker.start_again();
    let scada = Scada::online(&plant.broker, "5");
    let mut moments = Vec::new();
    scada.wait_for("the standstill of the outage", 0, |message| {
        let is_output = |it: &&Value| it["name"] == "frequency/output" && it["historical"] == true;
        for metric in metrics(message).iter().filter(is_output) {
            moments.push((number(&metric["at"]), metric["value"].as_f64().unwrap()));
        }
        (moments.last()?.1 == 0.0).then_some(())
    });
    assert!(
        moments.len() > 2 && moments.is_sorted_by_key(|(at, _)| *at),
        "{moments:?}"
    );
    assert_sequence(&scada.seen());
}

#[test]
fn check_says_what_is_reported_and_what_is_wrong() {
    let place = super::rig::Place::new();
    let broker = Mosquitto::tools_for(1);
    let text = |sparkplug: &str, data_dir: &str| {
        format!(
            "[gateway]\nname = \"plant\"\n{data_dir}\n[[line]]\nname = \"hall-1\"\nport = \"/dev/ttyUSB0\"\n\n\
             [[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\nstation = 1\n\n\
             [mqtt]\nbroker = \"mqtt://{}\"\n{sparkplug}\n",
            broker.address()
        )
    };
    let check = |text: &str| {
        let file = place.write("gateway.toml", text);
        let output = super::rig::vfd_gateway(&["check", "-c", file.to_str().unwrap()]);
        let said = [output.stdout, output.stderr].concat();
        (
            output.status.code(),
            String::from_utf8_lossy(&said).into_owned(),
        )
    };
    let (code, said) = check(&text(SPARKPLUG, "data_dir = \"/var/lib/vfd-gateway\""));
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("edge node plant of group plant-a; births wait for the primary host scada"),
        "{said}"
    );
    let (code, said) = check(&text(SPARKPLUG, ""));
    assert_eq!(code, Some(2), "{said}");
    assert!(
        said.contains("bdSeq") && said.contains("`data_dir` in `[gateway]`"),
        "{said}"
    );
}

#[test]
#[ignore = "some minutes: cargo test --test process sparkplug::a_hundred_kills -- --ignored"]
fn a_hundred_kills_of_the_broker_leave_every_number_right() {
    let mut plant = plant("");
    kill(&mut plant, 100);
}
