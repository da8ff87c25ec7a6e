//! Brokers other than mosquitto, and commands as other clients send them.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::outsiders::{aedes, paho};
use super::plant::{FREQUENCY, Plant, RUN, Wish};
use super::rig::{Place, start};
use super::started::{PATIENCE, Started, until};
use serde_json::json;

/// A gateway without a drive that answers, at the broker at `port`, with `keys` of `[mqtt]`.
pub fn gateway_at(place: &Place, port: u16, keys: &str) -> Started {
    let text = format!(
        "[gateway]\nname = \"plant\"\n\n[[line]]\nname = \"test\"\nport = \"{}\"\n\n[[line.drive]]\nname = \"pump-1\"\n\
         model = \"hyundai-n700\"\nstation = 1\n\n[mqtt]\nbroker = \"mqtt://127.0.0.1:{port}\"\n{keys}\n",
        place.file("line").display()
    );
    let file = place.write("gateway.toml", &text);
    start(&["run", "-c", file.to_str().unwrap()])
}

#[test]
fn the_whole_round_goes_through_aedes() {
    let port = free_port();
    let _broker = aedes(port);
    // It refuses MQTT 5.
    let mut plant = Plant::with(Wish {
        mqtt: "version = 4",
        through: Some(&|_| port),
        ..Wish::default()
    });
    plant.broker = Mosquitto::tools_for(port);
    let subscriber = Subscriber::new(&plant.broker, "mqttv311", "vfd/plant/#");
    subscriber.wait_for_payload("plant/status", "online");
    subscriber.wait_for_payload("run/state", "stopped");
    plant.order("command", r#"{"id": "a1", "frequency_hz": 30}"#);
    assert_eq!(
        subscriber.results("a1").last().unwrap()["outcome"],
        "confirmed"
    );
    plant.order("run/set", "forward");
    plant.wait_until_it_turns();
    subscriber.wait_for_payload("run/state", "forward");
    plant.order("run/set", "stop");
    plant.wait_until_it_stands();
    assert_eq!(plant.written(), [(FREQUENCY, 3000), (RUN, 1), (RUN, 0)]);
    plant
        .broker
        .publish_retained(&Plant::topic("frequency/set"), "44");
    subscriber.wait_for_payload("frequency/setpoint", "44.00");
    // The will.
    plant.gateway.kill();
    subscriber.wait_for_payload("plant/status", "offline");
    // What is kept is delivered to a gateway that connects, and refused.
    plant.start_gateway_again();
    let again = Subscriber::new(&plant.broker, "mqttv311", "vfd/plant/#");
    again.wait_for_payload("plant/status", "online");
    until("the kept setpoint is refused", PATIENCE, || {
        (plant.metric("vfd_gateway_mqtt_refused_retained_total") >= 1.0).then_some(())
    });
    assert_eq!(plant.written(), []);
}

#[test]
fn aedes_refuses_mqtt_5_and_the_gateway_says_so_and_stays() {
    let port = free_port();
    let broker = aedes(port);
    let place = Place::new();
    let mut gateway = gateway_at(&place, port, "");
    gateway.wait_for("that there is no connection", |line| {
        line.contains("no connection to the broker").then_some(())
    });
    until("it has tried again", PATIENCE, || {
        (broker
            .find_all(|line| line.contains("refused").then_some(()))
            .len()
            >= 2)
            .then_some(())
    });
    assert!(!gateway.has_ended());
}

#[test]
fn strict_commands_need_a_sign_that_they_are_new_from_every_client() {
    for (version, of_client) in [("version = 5", "5"), ("version = 4", "4")] {
        let plant = Plant::with(Wish {
            mqtt: version,
            control: "commands = \"strict\"",
            ..Wish::default()
        });
        let port = plant.broker.address().port();
        let ask = |topic: &str, payload: &str| paho(port, of_client, topic, payload, false);
        assert_eq!(
            ask(&Plant::topic("frequency/set"), "30")["outcome"],
            "confirmed",
            "a setpoint moves nothing"
        );
        assert_eq!(
            ask(&Plant::topic("run/set"), "forward")["reason"],
            "epoch_needed",
            "{version}"
        );
        assert_eq!(
            ask(&Plant::topic("command"), r#"{"id": "1", "run": "forward"}"#)["reason"],
            "epoch_needed"
        );
        let epoch = plant.epoch();
        let wrong = json!({"id": "2", "run": "forward", "epoch": epoch + 1});
        assert_eq!(
            ask(&Plant::topic("command"), &wrong.to_string())["reason"],
            "stale_epoch"
        );
        let right = json!({"id": "3", "run": "forward", "epoch": epoch});
        assert_eq!(
            ask(&Plant::topic("command"), &right.to_string())["outcome"],
            "acknowledged",
            "{version}"
        );
        plant.wait_until_it_turns();
        // A stop needs nothing, and makes that epoch an old one.
        assert_eq!(
            ask(&Plant::topic("run/set"), "stop")["outcome"],
            "confirmed"
        );
        plant.wait_until_it_stands();
        let late = json!({"id": "4", "run": "forward", "epoch": epoch});
        assert_eq!(
            ask(&Plant::topic("command"), &late.to_string())["reason"],
            "stale_epoch"
        );
        assert_eq!(
            plant.written(),
            [(FREQUENCY, 3000), (RUN, 1), (RUN, 0)],
            "{version}"
        );
    }
}

#[test]
fn what_is_published_with_the_retain_flag_is_refused_live_as_far_as_the_version_tells() {
    let plant = Plant::new();
    let port = plant.broker.address().port();
    for of_client in ["5", "4"] {
        let result = paho(port, of_client, &Plant::topic("frequency/set"), "30", true);
        assert_eq!(
            (&result["outcome"], &result["reason"]),
            (&"refused".into(), &"retained".into()),
            "{of_client}"
        );
    }
    plant.assert_nothing_was_written_since(0);
}
