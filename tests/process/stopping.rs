//! STOP by every way that there is, and nobody goes on behind it.

use super::outsiders::mbpoll_write;
use super::plant::{NATIVE, Plant, RUN, UNIFORM, Wish};
use super::raw::Raw;
use super::started::PATIENCE;

/// Long enough that no lease ends while the test looks.
const PATIENT: Wish<'_> = Wish { lost_after: "30s", simulate: &[], mqtt: "" };

#[test]
fn whoever_may_stop_stops_a_drive_that_was_started_over_mqtt() {
    let plant = Plant::with(PATIENT);
    let mut seen = 0;
    let ways: [(&str, &dyn Fn()); 7] = [
        ("run/set", &|| plant.order("run/set", "stop")),
        ("run/set coast", &|| plant.order("run/set", "coast")),
        ("all/run/set", &|| plant.broker.publish("vfd/plant/all/run/set", "stop")),
        ("coil 3", &|| assert!(mbpoll_write(plant.modbus, &["-a", "101", "-t", "0", "-r", "3"], 1))),
        ("register 256", &|| assert!(mbpoll_write(plant.modbus, &["-a", "101", "-t", "4", "-r", "256"], 0))),
        ("the drive's own register", &|| assert!(mbpoll_write(plant.modbus, &["-a", "1", "-t", "4", "-r", "2"], 0))),
        ("coil 0 of unit 255", &|| assert!(mbpoll_write(plant.modbus, &["-a", "255", "-t", "0", "-r", "0"], 1))),
    ];
    for (way, stop) in ways {
        // A plain start is too soon after a stop, so this one names the present epoch.
        plant.order("command", &format!(r#"{{"run": "forward", "frequency_hz": 30, "epoch": {}}}"#, plant.epoch()));
        plant.wait_until_it_turns();
        seen += 2;
        assert_eq!(plant.written().len(), seen, "setpoint and start before {way}: {:?}", plant.written());
        stop();
        let word = if way.contains("coast") { 3 } else { 0 };
        plant.wait_for_write(seen, (RUN, word), PATIENCE);
        plant.wait_until_it_stands();
        assert_eq!(plant.written()[seen..], [(RUN, word)], "{way}");
        seen += 1;
    }
}

#[test]
fn who_was_stopped_by_somebody_else_does_not_go_on() {
    let plant = Plant::with(PATIENT);
    let subscriber = plant.subscriber();
    // A controller holds the drive; the operator stops it over MQTT.
    let mut controller = Raw::connect(plant.modbus);
    assert_eq!(controller.write(UNIFORM, 256, 1), Err(6), "nobody has commanded stop since the start");
    for (register, word) in [(256, 0), (257, 3000), (256, 1)] {
        assert_eq!(controller.write(UNIFORM, register, word), Ok(()));
    }
    plant.wait_until_it_turns();
    plant.order("command", r#"{"id": "not-mine", "frequency_hz": 40}"#);
    assert_eq!(subscriber.results("not-mine").last().unwrap()["reason"], "other_owner");
    plant.order("run/set", "stop");
    plant.wait_until_it_stands();
    let written = plant.written();
    assert_eq!(written.last(), Some(&(RUN, 0)));
    for _ in 0..3 {
        assert_eq!(controller.write(UNIFORM, 256, 1), Err(6), "what a controller writes cyclically is no new start");
        assert_eq!(controller.write(NATIVE, RUN, 1), Err(6), "nor by the drive's own register");
    }
    assert_eq!(controller.read_unit(UNIFORM, 256, 1), Ok(vec![0]));
    assert_eq!(plant.written(), written);
    // Its own stop, then a start.
    assert_eq!((controller.write(UNIFORM, 256, 0), controller.write(UNIFORM, 256, 1)), (Ok(()), Ok(())));
    plant.wait_until_it_turns();

    // The other way round: the controller stops what was started over MQTT, and a plain start has to wait.
    assert_eq!(controller.write(UNIFORM, 256, 0), Ok(()));
    plant.wait_until_it_stands();
    plant.order("command", &format!(r#"{{"run": "forward", "epoch": {}}}"#, plant.epoch()));
    plant.wait_until_it_turns();
    let before = plant.epoch();
    assert!(mbpoll_write(plant.modbus, &["-a", "101", "-t", "0", "-r", "3"], 1));
    plant.order("command", r#"{"id": "too-soon", "run": "forward"}"#);
    let reason = subscriber.results("too-soon").last().unwrap()["reason"].clone();
    assert!(reason == "restart_delay" || reason == "stop_pending", "{reason}");
    plant.order("command", &format!(r#"{{"id": "old", "run": "forward", "epoch": {before}}}"#));
    let reason = subscriber.results("old").last().unwrap()["reason"].clone();
    assert!(reason == "stale_epoch" || reason == "stop_pending", "{reason}");
    plant.wait_until_it_stands();
    assert_eq!(plant.written().last(), Some(&(RUN, 0)));
}
