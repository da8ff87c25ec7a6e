//! The commander is lost, the broker is lost, the gateway is lost: the motor does not run on, and nothing starts again.

use super::plant::{FREQUENCY, LOST_AFTER, MARGIN, NATIVE, Plant, RUN, UNIFORM, Wish};
use super::raw::Raw;
use super::rig::{start, vfd_gateway};
use super::started::{PATIENCE, until};
use serde_json::Value;
use std::time::Duration;

#[test]
fn a_broker_that_is_killed_stops_the_drive_and_nothing_moves_when_it_is_back() {
    let mut plant = Plant::new();
    let seen = plant.run_over_mqtt();
    plant.broker.kill();
    plant.wait_for_write(seen, (RUN, 0), LOST_AFTER + MARGIN);
    plant.wait_until_it_stands();
    plant.broker.start_again();
    plant.wait_until_ready();
    let subscriber = plant.subscriber();
    subscriber.wait_for_payload("plant/status", "online");
    subscriber.wait_for_payload("run/state", "stopped");
    let state = subscriber.wait_for("pump-1/state", |it| {
        serde_json::from_str::<Value>(&it.payload).ok()
    });
    assert_eq!(
        (
            &state["control"]["failsafe"],
            &state["control"]["start_inhibited"]
        ),
        (&true.into(), &true.into())
    );
    assert_only_stops(&plant, seen);
    let written = plant.written().len();
    plant.assert_nothing_was_written_since(written);
    assert_eq!(plant.output(), Some(0));
}

#[test]
fn a_broker_that_stalls_stops_the_drive_and_nothing_moves_when_it_goes_on() {
    for version in ["version = 4", "version = 5"] {
        let plant = Plant::with(Wish {
            mqtt: version,
            ..Wish::default()
        });
        let seen = plant.run_over_mqtt();
        plant.broker.stall();
        plant.wait_for_write(seen, (RUN, 0), LOST_AFTER + MARGIN);
        plant.wait_until_it_stands();
        plant.broker.go_on();
        plant.wait_until_ready();
        plant
            .subscriber()
            .wait_for_payload("plant/status", "online");
        assert_only_stops(&plant, seen);
        let written = plant.written().len();
        plant.assert_nothing_was_written_since(written);
        assert_eq!(plant.output(), Some(0), "{version}");
    }
}

#[test]
fn a_command_that_waited_in_a_stalled_broker_moves_nothing() {
    let plant = Plant::new();
    plant.order("frequency/set", "20");
    plant.wait_for_write(0, (FREQUENCY, 2000), PATIENCE);
    let subscriber = plant.subscriber();
    // The message stays in the broker's socket until it goes on; by then the gateway has given the connection up.
    plant.broker.stall();
    let mut publisher = std::process::Command::new("mosquitto_pub");
    let (port, topic) = (
        plant.broker.address().port().to_string(),
        Plant::topic("run/set"),
    );
    publisher.args([
        "-h",
        "127.0.0.1",
        "-p",
        &port,
        "-q",
        "1",
        "-t",
        &topic,
        "-m",
        "forward",
    ]);
    let mut publisher = super::started::Started::new(publisher);
    plant.wait_until_not_ready();
    plant.broker.go_on();
    publisher.end_within(PATIENCE);
    plant.wait_until_ready();
    subscriber.wait_for_payload("plant/status", "online");
    plant.assert_nothing_was_written_since(1);
    assert_eq!(plant.output(), Some(0));
}

#[test]
fn a_gateway_that_stood_still_carries_out_stops_alone_and_then_whatever_comes() {
    for version in ["version = 4\n", "version = 5\n"] {
        // The broker notices that nothing comes from the gateway; the gateway notices that it stood still.
        for (keep_alive, is_given_up) in [("5s", true), ("60s", false)] {
            let mqtt = format!("{version}keep_alive = \"{keep_alive}\"");
            let plant = Plant::with(Wish {
                mqtt: &mqtt,
                lost_after: "60s",
                ..Wish::default()
            });
            let case = format!("{version}{keep_alive}");
            let subscriber = plant.subscriber();
            subscriber.wait_for_payload("plant/status", "online");
            let seen = plant.run_over_mqtt();
            plant.gateway.signal("STOP");
            plant.order("command", r#"{"id": "faster", "frequency_hz": 44}"#);
            plant.order("command", r#"{"id": "stop", "run": "stop"}"#);
            plant.order(
                "command",
                r#"{"id": "again", "run": "forward", "frequency_hz": 45}"#,
            );
            if is_given_up {
                subscriber.wait_for_payload("plant/status", "offline");
            } else {
                // Longer than a command may take to begin.
                std::thread::sleep(Duration::from_secs(2));
            }
            plant.gateway.signal("CONT");
            for id in ["faster", "again"] {
                let results = subscriber.results(id);
                assert_eq!(
                    results.last().unwrap()["reason"],
                    "stale",
                    "{case}: {results:?}"
                );
            }
            assert_ne!(
                subscriber.results("stop").last().unwrap()["outcome"],
                "refused",
                "{case}"
            );
            plant.wait_until_it_stands();
            assert_only_stops(&plant, seen);
            // Whoever has seen what became of the old commands is heard.
            let written = plant.written().len();
            plant.assert_nothing_was_written_since(written);
            let connections = plant
                .gateway
                .text()
                .matches("connected to the broker")
                .count();
            assert_eq!(connections, if is_given_up { 2 } else { 1 }, "{case}");
        }
    }
}

#[test]
fn of_what_modbus_clients_sent_while_the_gateway_stood_still_only_stops_are_carried_out() {
    let plant = Plant::with(Wish {
        lost_after: "60s",
        ..Wish::default()
    });
    let mut known = Raw::connect(plant.modbus);
    plant.run_over_modbus(&mut known);
    let seen = plant.written().len();
    // The system lets a newcomer connect meanwhile.
    let faster = plant
        .while_it_stands_still([&mut || known.write(UNIFORM, 257, 4400), &mut || {
            newcomer(&plant, 257, 4500)
        }]);
    assert_eq!(faster, [Err(0x0B); 2], "{}", plant.gateway.text());
    let stop = plant.while_it_stands_still([&mut || newcomer(&plant, 256, 0)]);
    assert_eq!(stop, [Ok(())], "{}", plant.gateway.text());
    plant.wait_until_it_stands();
    assert_only_stops(&plant, seen);
    until("a setpoint is taken behind the stop", PATIENCE, || {
        known.write(UNIFORM, 257, 4000).ok()
    });
}

fn newcomer(plant: &Plant, register: u16, word: u16) -> Result<(), u8> {
    Raw::connect(plant.modbus).write(UNIFORM, register, word)
}

#[test]
fn a_modbus_client_that_vanishes_stops_its_drive() {
    let plant = Plant::new();
    let mut client = Raw::connect(plant.modbus);
    plant.run_over_modbus(&mut client);
    drop(client);
    let seen = plant.written().len();
    plant.wait_for_write(seen, (RUN, 0), LOST_AFTER + MARGIN);
    plant.wait_until_it_stands();
    assert_only_stops(&plant, seen);
    let mut client = Raw::connect(plant.modbus);
    assert_eq!(
        client.write(UNIFORM, 256, 1),
        Err(6),
        "who was lost has to command stop first"
    );
}

#[test]
fn reads_keep_no_drive_running() {
    let plant = Plant::new();
    let mut client = Raw::connect(plant.modbus);
    plant.run_over_modbus(&mut client);
    let seen = plant.written().len();
    let mut answered = 0;
    until(
        "the drive is stopped while its commander only reads",
        LOST_AFTER + MARGIN,
        || {
            // On a busy machine the drive may miss one.
            let read = [
                client.read_unit(UNIFORM, 0, 16),
                client.read_unit(NATIVE, 0x0101, 1),
            ];
            answered += usize::from(read.iter().all(Result::is_ok));
            plant.written()[seen..].contains(&(RUN, 0)).then_some(())
        },
    );
    assert!(
        answered > 0,
        "no read was answered: {}",
        plant.gateway.text()
    );
}

#[test]
fn write_holds_a_drive_longer_than_its_lease_and_stops_it_on_ctrl_c() {
    let plant = Plant::new();
    let port = plant.modbus.port().to_string();
    let args = |more: &[&'static str]| {
        [
            &["write", "--port", &port, "--unit", "101", "--uniform"],
            more,
        ]
        .concat()
        .into_iter()
        .map(str::to_owned)
        .collect::<Vec<_>>()
    };
    let write = |more: &[&'static str]| {
        vfd_gateway(&args(more).iter().map(String::as_str).collect::<Vec<_>>())
    };
    assert!(write(&["run", "stop"]).status.success());
    until(
        "the stop is effective and the setpoint taken",
        PATIENCE,
        || {
            let output = write(&["frequency", "30"]);
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(
                output.status.success() || said.contains("exception 06"),
                "{said}"
            );
            output.status.success().then_some(())
        },
    );
    let mut writer = start(
        &args(&["run", "forward"])
            .iter()
            .map(String::as_str)
            .collect::<Vec<_>>(),
    );
    writer.wait_for("that it stays", |line| {
        line.contains("the lease is renewed").then_some(())
    });
    let seen = plant.written().len();
    // Half as long again as the lease: longer than the drive would run on without a sign of life.
    let life = || {
        Raw::connect(plant.modbus)
            .read_unit(UNIFORM, 16, 1)
            .unwrap()[0]
    };
    let begun = life();
    until(
        "the lease is over, were it not renewed",
        LOST_AFTER * 3 + MARGIN,
        || (life().wrapping_sub(begun) >= 6).then_some(()),
    );
    assert_eq!(
        plant.written().len(),
        seen,
        "a renewal puts nothing on the line"
    );
    assert!(plant.output() > Some(200));
    writer.interrupt();
    assert_eq!(
        writer.end_within(PATIENCE).code(),
        Some(0),
        "{}",
        writer.text()
    );
    plant.wait_until_it_stands();
    // Again if the motor takes longer to stop than its commander, who is gone, may be silent.
    assert_only_stops(&plant, seen);
}

#[test]
fn a_gateway_that_is_asked_to_exit_stops_the_drive_first_and_says_goodbye() {
    let mut plant = Plant::new();
    let subscriber = plant.subscriber();
    let seen = plant.run_over_mqtt();
    plant.gateway.terminate();
    assert_eq!(
        plant.gateway.end_within(Duration::from_secs(10)).code(),
        Some(0),
        "{}",
        plant.gateway.text()
    );
    assert_only_stops(&plant, seen);
    subscriber.wait_for_payload("plant/status", "offline");
    subscriber.wait_for_payload("pump-1/availability", "offline");
    plant.start_gateway_again();
    plant.wait_until_it_stands();
    assert_eq!(plant.written(), []);
}

#[test]
fn a_gateway_that_is_killed_is_offline_by_its_will_and_finds_the_drive_running() {
    let mut plant = Plant::new();
    plant.run_over_mqtt();
    let subscriber = plant.subscriber();
    subscriber.wait_for_payload("plant/status", "online");
    plant.gateway.kill();
    subscriber.wait_for_payload("plant/status", "offline");
    plant.start_gateway_again();
    // The model has no status word: that it runs shows, the direction does not.
    let again = plant.subscriber();
    again.wait_for_payload("plant/status", "online");
    again.wait_for_payload("run/state", "running");
    assert!(plant.output() > Some(200));
    assert_eq!(
        plant.written(),
        [],
        "a drive that was found running is left as it is"
    );
    // Until somebody says so.
    plant.order("run/set", "stop");
    plant.wait_until_it_stands();
    // Again if the motor takes longer to stop than a commander may be silent.
    assert_only_stops(&plant, 0);
}

/// A stop may be repeated; nothing else is written.
fn assert_only_stops(plant: &Plant, seen: usize) {
    let written = plant.written();
    assert!(
        written.len() > seen && written[seen..].iter().all(|it| *it == (RUN, 0)),
        "{:?}",
        &written[seen..]
    );
}
