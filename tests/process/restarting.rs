//! The broker ends and comes back, again and again, with a run command kept on every topic.

use super::plant::{FREQUENCY, Plant, Wish};
use super::replays::COMMANDS;
use super::started::{PATIENCE, until};
use serde_json::Value;
use std::time::{Duration, Instant};

/// Much longer than the 2 s that are aimed at: other tests run at the same time.
const BACK_WITHIN: Duration = Duration::from_secs(12);

/// Restarts of the broker; `RESTARTS` sets another number.
fn restarts() -> usize {
    std::env::var("RESTARTS").map_or(5, |text| text.parse().expect("RESTARTS is a number"))
}

#[test]
fn no_restart_of_the_broker_moves_anything_and_each_finds_the_gateway_again() {
    let all = restarts();
    let mut times = Vec::new();
    for (version, restarts) in [("version = 5", all - all / 2), ("version = 4", all / 2)] {
        let wish = Wish {
            mqtt: version,
            ..Wish::default()
        };
        let mut plant = Plant::prepared(wish, |broker| {
            for (topic, payload) in COMMANDS {
                broker.publish_retained(&format!("vfd/plant/{topic}"), payload);
            }
        });
        // What is kept is on the disk from the first orderly end on, so that a kill loses nothing of it.
        plant.broker.end();
        plant.broker.start_again();
        plant.wait_until_ready();
        for restart in 0..restarts {
            times.push(restart_once(&mut plant, restart));
            // What goes to the line is seen in the log, which may come a little later than the answer.
            plant.wait_for_write(restart, (FREQUENCY, setpoint(restart)), PATIENCE);
            assert_eq!(
                plant.written().len(),
                restart + 1,
                "{version}, restart {restart}"
            );
        }
        let setpoints: Vec<_> = (0..restarts)
            .map(|restart| (FREQUENCY, setpoint(restart)))
            .collect();
        assert_eq!(
            plant.written(),
            setpoints,
            "{version}: what was commanded since, and nothing else"
        );
        assert_eq!(plant.output(), Some(0));
        if version == "version = 4" {
            let refused = plant.metric("vfd_gateway_mqtt_refused_retained_total");
            assert!(
                refused >= (restarts * COMMANDS.len() / 2) as f64,
                "delivered each time, and refused: {refused}"
            );
        }
    }
    times.sort();
    let (median, longest) = (times[times.len() / 2], times[times.len() - 1]);
    println!(
        "{} restarts: telemetry {median:.1?} after the broker (median), {longest:.1?} at most",
        times.len()
    );
}

/// In 0.01 Hz; another one each time, so that each is written.
const fn setpoint(restart: usize) -> u16 {
    1000 + (restart % 4000) as u16
}

/// Returns how long after the broker listens there is telemetry of after that.
fn restart_once(plant: &mut Plant, restart: usize) -> Duration {
    if restart.is_multiple_of(2) {
        plant.broker.end();
    } else {
        plant.broker.kill();
    }
    // Away for no time, for a while, or for longer than any wait of the gateway.
    let away = Duration::from_millis([0, 150, 700, 2500][restart % 4]);
    std::thread::sleep(away);
    let since = now();
    plant.broker.start_again();
    let begun = Instant::now();
    let subscriber = plant.subscriber();
    subscriber.wait_for("pump-1/state", |it| {
        let state: Value = serde_json::from_str(&it.payload).ok()?;
        (state["at"].as_str()? > since.as_str()).then_some(())
    });
    let took = begun.elapsed();
    let said = || {
        plant
            .gateway
            .find_all(|line| line.contains("broker").then(|| line.clone()))
            .join("\n")
    };
    assert!(
        took < BACK_WITHIN,
        "restart {restart}, broker up at {since}: {took:?}\n{}",
        said()
    );
    // The subscriptions are back when a command is carried out.
    let (id, hertz) = (
        format!("after-{restart}"),
        f64::from(setpoint(restart)) / 100.0,
    );
    plant.order(
        "command",
        &format!(r#"{{"id": "{id}", "frequency_hz": {hertz}}}"#),
    );
    let last = subscriber.results(&id).pop().unwrap();
    assert_eq!(last["outcome"], "confirmed", "{last}");
    let kept = subscriber.wait_for("run/set", |it| it.retain.then(|| it.payload.clone()));
    assert_eq!(kept, "forward", "the broker still keeps it");
    until("the gateway is ready", PATIENCE, || {
        plant.get("/readyz").filter(|(status, _)| *status == 200)
    });
    took
}

/// As the gateway writes it: UTC with milliseconds.
fn now() -> String {
    let output = std::process::Command::new("date")
        .args(["-u", "+%Y-%m-%dT%H:%M:%S.%3NZ"])
        .output()
        .unwrap();
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

#[test]
fn a_trip_that_a_stalled_broker_was_informed_of_comes_again_when_it_was_killed() {
    for version in ["version = 5", "version = 4"] {
        let wish = Wish {
            mqtt: version,
            simulate: &["--trip-every", "8"],
            lost_after: "30s",
            ..Wish::default()
        };
        let mut plant = Plant::with(wish);
        plant.run_over_mqtt();
        // From here on the broker takes bytes and does nothing with them: only their acknowledgement would be proof.
        plant.broker.stall();
        until("the drive has tripped", PATIENCE, || {
            let health: Value = serde_json::from_str(&plant.get("/api/v1/health")?.1).ok()?;
            (health["drives"][0]["run_state"] == "tripped").then_some(())
        });
        plant.wait_until_not_ready();
        plant.broker.kill();
        plant.broker.start_again();
        let subscriber = plant.subscriber();
        let event = subscriber.wait_for("trip/event", |it| {
            serde_json::from_str::<Value>(&it.payload).ok()
        });
        assert_eq!(
            (&event["kind"], &event["code"]),
            (&"tripped".into(), &1.into()),
            "{version}"
        );
    }
}
