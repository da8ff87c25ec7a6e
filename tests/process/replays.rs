//! Messages that a broker kept are replays, and a broker that comes back brings no motion with it.

use super::plant::{Plant, RUN, Wish};

/// Every input and a payload that would act if it were live.
pub const COMMANDS: &[(&str, &str)] = &[
    ("drive/pump-1/frequency/set", "42.5"),
    ("drive/pump-1/run/set", "forward"),
    (
        "drive/pump-1/command",
        r#"{"id": "kept", "run": "forward", "frequency_hz": 20}"#,
    ),
    ("drive/pump-1/trip/reset", "reset"),
    ("drive/pump-1/lease", "1"),
    ("drive/pump-1/param/F007/set", "10"),
    ("drive/pump-1/param/F007/get", "1"),
    ("all/run/set", "stop"),
];

#[test]
fn retained_commands_move_nothing_at_start_nor_after_three_restarts_of_the_broker() {
    for version in ["version = 4", "version = 5"] {
        let wish = Wish {
            mqtt: version,
            ..Wish::default()
        };
        let mut plant = Plant::prepared(wish, |broker| {
            for (topic, payload) in COMMANDS {
                broker.publish_retained(&format!("vfd/plant/{topic}"), payload);
            }
        });
        for restart in 0..3 {
            plant.broker.end();
            plant.wait_until_not_ready();
            plant.broker.start_again();
            plant.wait_until_ready();
            let subscriber = plant.subscriber();
            subscriber.wait_for_payload("plant/status", "online");
            let kept = subscriber.wait_for("run/set", |it| it.retain.then(|| it.payload.clone()));
            assert_eq!(kept, "forward", "the broker still keeps it");
            assert_eq!(plant.written(), [], "{version}, restart {restart}");
        }
        assert_eq!(plant.output(), Some(0));
        // Commands are taken again: the subscriptions are back. Nothing was written before.
        plant.assert_nothing_was_written_since(0);
    }
}

#[test]
fn a_stop_with_the_retain_flag_stops_now_and_never_again() {
    let mut plant = Plant::new();
    let subscriber = plant.subscriber();
    let seen = plant.run_over_mqtt();
    plant
        .broker
        .publish_retained(&Plant::topic("command"), r#"{"id": "kept", "run": "stop"}"#);
    let told = subscriber.results("kept");
    let last = told.last().unwrap();
    assert_eq!(last["outcome"], "confirmed");
    assert!(
        last["message"].as_str().unwrap().contains("retain flag"),
        "its sender is warned: {last}"
    );
    plant.wait_until_it_stands();
    let written = plant.written();
    assert_eq!(written[seen..], [(RUN, 0)]);
    // Subscribed anew, the gateway leaves alone what the broker has kept.
    plant.broker.end();
    plant.wait_until_not_ready();
    plant.broker.start_again();
    plant.wait_until_ready();
    plant
        .subscriber()
        .wait_for_payload("plant/status", "online");
    plant.run_over_mqtt_behind_a_stop();
    assert_eq!(plant.written()[written.len()..], [(RUN, 1)]);
}
