//! A broker that takes no packet above a limit: it says so with MQTT 5, and closes the connection with 3.1.1.

use super::plant::{Plant, RUN, Wish};
use super::rig::{fields, vfd_gateway};
use super::started::{PATIENCE, until};
use serde_json::Value;

/// Less than a drive's `state` needs, and more than every other document, command and subscription.
const LIMIT: u64 = 1_000;

#[test]
fn what_fits_is_published_commands_get_through_and_the_rest_is_named_with_size_and_limit() {
    for version in ["version = 4", "version = 5"] {
        let broker = format!("max_packet_size {LIMIT}\n");
        let plant = Plant::with(Wish {
            mqtt: version,
            broker: &broker,
            lost_after: "30s",
            ..Wish::default()
        });
        let subscriber = plant.subscriber();
        let health = || {
            serde_json::from_str::<Value>(&plant.get("/api/v1/health").expect("HTTP answers").1)
                .unwrap()
        };
        let named = until("what is too large is named", PATIENCE, || {
            health()["mqtt"]["oversized"]
                .as_array()
                .filter(|all| !all.is_empty())
                .cloned()
        });
        assert_eq!(named.len(), 1, "{version}: {named:?}");
        assert_eq!(named[0]["topic"], Plant::topic("state"), "{version}");
        let (bytes, limit) = (
            named[0]["bytes"].as_u64().unwrap(),
            named[0]["limit"].as_u64().unwrap(),
        );
        // One that is learned lies below the document and above all that was taken.
        assert!(
            bytes > LIMIT && limit < bytes && (limit >= LIMIT || version.ends_with('4')),
            "{version}: {named:?}"
        );
        for topic in [
            "status",
            "info",
            "drive/pump-1/info",
            "line/hall-1/stats",
            "drive/pump-1/stats",
        ] {
            subscriber.wait_for(topic, |it| it.topic.ends_with(topic).then_some(()));
        }

        let connects = plant.metric("vfd_gateway_mqtt_connects_total");
        plant.run_over_mqtt();
        plant.order("run/set", "stop");
        plant.wait_for_write(0, (RUN, 0), PATIENCE);
        plant.wait_until_it_stands();
        assert_eq!(
            plant.metric("vfd_gateway_mqtt_connects_total"),
            connects,
            "{version}: the connection stays"
        );
        assert_eq!(
            health()["mqtt"]["contested"],
            false,
            "{version}: nobody else has the identifier"
        );
        assert_eq!(
            plant.metric("vfd_gateway_mqtt_takeovers_total"),
            0.0,
            "{version}"
        );
        let shown = vfd_gateway(&["health", "--url", &format!("http://{}", plant.http)]);
        let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
        // Its size changes with what it says.
        let told = format!("{} is not published: ", Plant::topic("state"));
        assert!(shown.contains(&told), "{version}: {shown}");
        let is_told = |line: &String| {
            let fields = fields(line)?;
            let message = fields["message"].as_str()?;
            (message.contains("larger than the broker takes")
                && fields["topic"] == Plant::topic("state"))
            .then_some(())
        };
        assert_eq!(
            plant.logged(is_told).len(),
            1,
            "{version}: it is logged once"
        );
    }
}
