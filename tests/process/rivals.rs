//! Another client with the gateway's identifier: the broker lets only one of them be connected.

use super::mosquitto::Rival;
use super::plant::{Plant, Wish};
use super::rig::{fields, vfd_gateway};
use super::started::{PATIENCE, until};
use serde_json::Value;
use std::time::{Duration, Instant};

/// Longer than the waits of 1, 2, 4 and 8 s that follow each other while the rival is there.
const FIGHT: Duration = Duration::from_secs(12);

#[test]
fn a_rival_is_named_in_the_log_and_in_health_and_is_not_fought_with() {
    // Some versions of mosquitto tell with MQTT 5 who was thrown out, Debian's 2.0.11 does not.
    let said = "another client uses";
    for (version, of_rival) in [("version = 5", "mqttv5"), ("version = 4", "mqttv311")] {
        let plant = Plant::with(Wish {
            mqtt: version,
            ..Wish::default()
        });
        assert_eq!(plant.metric("vfd_gateway_mqtt_takeovers_total"), 0.0);
        let rival = Rival::new(&plant.broker, of_rival, "vfd-gateway-plant");
        let warning = plant.gateway.wait_for("that there is a rival", |line| {
            let fields = fields(line)
                .filter(|it| it["message"].as_str().is_some_and(|it| it.contains(said)))?;
            Some(fields)
        });
        assert_eq!(warning["client_id"], "vfd-gateway-plant", "{version}");
        assert!(
            warning["message"]
                .as_str()
                .unwrap()
                .contains("`client_id` in [mqtt]"),
            "what to do: {warning}"
        );
        let begun = Instant::now();
        until("health tells", PATIENCE, || {
            let health: Value = serde_json::from_str(&plant.get("/api/v1/health")?.1).ok()?;
            (health["mqtt"]["contested"] == true).then_some(())
        });
        assert_eq!(plant.metric("vfd_gateway_mqtt_contested"), 1.0);
        let shown = vfd_gateway(&["health", "--url", &format!("http://{}", plant.http)]);
        let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
        assert!(
            shown.contains("another client has the same client identifier"),
            "{shown}"
        );
        until("the fight has lasted for a while", FIGHT + PATIENCE, || {
            (begun.elapsed() > FIGHT).then_some(())
        });
        let takeovers = plant.metric("vfd_gateway_mqtt_takeovers_total");
        // Who came back at once would be thrown out every second or oftener.
        assert!(
            (1.0..=10.0).contains(&takeovers),
            "{version}: {takeovers} in {FIGHT:?}"
        );
        drop(rival);
        until("the gateway is back", Duration::from_secs(60), || {
            plant.get("/readyz").filter(|(status, _)| *status == 200)
        });
        plant.assert_nothing_was_written_since(0);
    }
}
