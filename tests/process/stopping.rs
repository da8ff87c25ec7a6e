//! STOP by every way that there is, and nobody goes on behind it.

use super::outsiders::mbpoll_write;
use super::plant::{FREQUENCY, NATIVE, Plant, RUN, UNIFORM, Wish};
use super::raw::Raw;
use super::started::{PATIENCE, until};

/// Who holds control, in the uniform map; 0 is nobody.
const OWNER: u16 = 19;

/// Long enough that no lease ends while the test looks.
const PATIENT: Wish<'_> = Wish {
    lost_after: "30s",
    ..Wish::NONE
};

#[test]
fn anyone_who_may_stop_stops_a_drive_that_was_started_over_mqtt() {
    let plant = Plant::with(PATIENT);
    plant.order("frequency/set", "30");
    plant.wait_for_write(0, (FREQUENCY, 3000), PATIENCE);
    let mut seen = 1;
    let ways: [(&str, &dyn Fn()); 7] = [
        ("run/set", &|| plant.order("run/set", "stop")),
        ("run/set coast", &|| plant.order("run/set", "coast")),
        ("all/run/set", &|| {
            plant.broker.publish("vfd/plant/all/run/set", "stop")
        }),
        ("coil 3", &|| {
            assert!(mbpoll_write(
                plant.modbus,
                &["-a", "101", "-t", "0", "-r", "3"],
                1
            ))
        }),
        ("register 256", &|| {
            assert!(mbpoll_write(
                plant.modbus,
                &["-a", "101", "-t", "4", "-r", "256"],
                0
            ))
        }),
        ("the drive's own register", &|| {
            assert!(mbpoll_write(
                plant.modbus,
                &["-a", "1", "-t", "4", "-r", "2"],
                0
            ))
        }),
        ("coil 0 of unit 255", &|| {
            assert!(mbpoll_write(
                plant.modbus,
                &["-a", "255", "-t", "0", "-r", "0"],
                1
            ))
        }),
    ];
    for (way, stop) in ways {
        plant.run_over_mqtt_behind_a_stop();
        assert_eq!(
            plant.written()[seen..],
            [(RUN, 1)],
            "the start before {way}"
        );
        seen += 1;
        stop();
        let word = if way.contains("coast") { 3 } else { 0 };
        plant.wait_for_write(seen, (RUN, word), PATIENCE);
        plant.wait_until_it_stands();
        assert_eq!(plant.written()[seen..], [(RUN, word)], "{way}");
        seen += 1;
    }
}

#[test]
fn who_was_stopped_by_another_party_does_not_go_on() {
    let plant = Plant::with(PATIENT);
    let subscriber = plant.subscriber();
    // A controller holds the drive; the operator stops it over MQTT.
    let mut controller = Raw::connect(plant.modbus);
    assert_eq!(
        controller.write(UNIFORM, 256, 1),
        Err(6),
        "nobody has commanded stop since the start"
    );
    plant.run_over_modbus(&mut controller);
    plant.wait_until_it_turns();
    plant.order("command", r#"{"id": "not-mine", "frequency_hz": 40}"#);
    assert_eq!(
        subscriber.results("not-mine").last().unwrap()["reason"],
        "other_owner"
    );
    plant.order("run/set", "stop");
    plant.wait_until_it_stands();
    let written = plant.written();
    assert_eq!(written.last(), Some(&(RUN, 0)));
    for _ in 0..3 {
        assert_eq!(
            controller.write(UNIFORM, 256, 1),
            Err(6),
            "what a controller writes cyclically is no new start"
        );
        assert_eq!(
            controller.write(NATIVE, RUN, 1),
            Err(6),
            "nor by the drive's own register"
        );
    }
    assert_eq!(controller.read_unit(UNIFORM, 256, 1), Ok(vec![0]));
    assert_eq!(plant.written(), written);
    // Its own stop, then a start.
    plant.write_uniform(&mut controller, 256, 0);
    plant.write_uniform(&mut controller, 256, 1);
    plant.wait_until_it_turns();

    // The other way round: the controller stops what was started over MQTT, and a plain start has to wait.
    assert_eq!(controller.write(UNIFORM, 256, 0), Ok(()));
    until("control is given back at standstill", PATIENCE, || {
        (controller.read_unit(UNIFORM, OWNER, 1) == Ok(vec![0])).then_some(())
    });
    plant.run_over_mqtt_behind_a_stop();
    let before = plant.epoch();
    assert!(mbpoll_write(
        plant.modbus,
        &["-a", "101", "-t", "0", "-r", "3"],
        1
    ));
    plant.order("command", r#"{"id": "too-soon", "run": "forward"}"#);
    let reason = subscriber.results("too-soon").last().unwrap()["reason"].clone();
    assert!(
        reason == "restart_delay" || reason == "stop_pending",
        "{reason}"
    );
    plant.order(
        "command",
        &format!(r#"{{"id": "old", "run": "forward", "epoch": {before}}}"#),
    );
    let reason = subscriber.results("old").last().unwrap()["reason"].clone();
    assert!(
        reason == "stale_epoch" || reason == "stop_pending",
        "{reason}"
    );
    plant.wait_until_it_stands();
    assert_eq!(plant.written().last(), Some(&(RUN, 0)));
}

#[test]
fn a_signal_without_a_meaning_ends_nothing_and_one_that_asks_for_the_end_stops_the_motor_first() {
    let mut plant = Plant::with(PATIENT);
    let seen = plant.run_over_mqtt();
    for signal in [
        "USR1", "USR2", "ALRM", "VTALRM", "PROF", "IO", "XCPU", "XFSZ", "40",
    ] {
        plant.gateway.signal(signal);
    }
    for signal in ["SIGUSR1", "SIGUSR2", "SIGALRM"] {
        plant.gateway.wait_for("that it was ignored", |line| {
            (line.contains("signal ignored") && line.contains(signal)).then_some(())
        });
    }
    assert_eq!(plant.written().len(), seen, "the motor runs on");
    plant.gateway.signal("QUIT");
    assert!(plant.gateway.end_within(PATIENCE).success());
    assert!(plant.written()[seen..].contains(&(RUN, 0)), "on_shutdown");
}
