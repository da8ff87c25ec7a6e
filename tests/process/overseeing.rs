//! Whoever watches the gateway: metrics, alive and ready, and the health check of a container.

use super::outsiders::mbpoll;
use super::plant::{Plant, Wish};
use super::rig::vfd_gateway;
use super::started::{PATIENCE, until};

#[test]
fn metrics_and_health_say_what_runs_and_what_is_missing() {
    let mut plant = Plant::new();
    plant.run_over_mqtt();
    let metric = |plant: &Plant, name: &str| -> f64 {
        let (status, text) = plant.get("/metrics").unwrap();
        assert_eq!(status, 200);
        assert!(text.ends_with("# EOF\n"), "complete: {text}");
        let line = text
            .lines()
            .find(|line| line.starts_with(name))
            .unwrap_or_else(|| panic!("no {name} in {text}"));
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    assert_eq!(metric(&plant, "vfd_gateway_ready "), 1.0);
    let output = "vfd_gateway_drive_output_frequency_hertz{line=\"hall-1\",drive=\"pump-1\"}";
    until("the output frequency is polled", PATIENCE, || {
        (metric(&plant, output) > 2.0).then_some(())
    });
    assert_eq!(
        metric(&plant, "vfd_gateway_drive_run_state{"),
        2.0,
        "forward"
    );
    assert_eq!(metric(&plant, "vfd_gateway_drive_lease_held{"), 1.0);
    assert_eq!(metric(&plant, "vfd_gateway_mqtt_connected "), 1.0);
    assert!(metric(&plant, "vfd_gateway_line_replies_total{") > 10.0);
    let (before, after) = (metric(&plant, "vfd_gateway_modbus_replies_total "), || {
        plant.output();
        metric(&plant, "vfd_gateway_modbus_replies_total ")
    });
    assert_eq!(after(), before + 1.0);

    let socket = plant.place.file("data/vfd-gateway.sock");
    let by_url = format!("http://{}", plant.http);
    let ways = [
        ["health", "--socket", socket.to_str().unwrap()],
        ["health", "--url", &by_url],
    ];
    for way in &ways {
        let output = vfd_gateway(way);
        let text = String::from_utf8_lossy(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{way:?}: {text}");
        for line in [
            "line hall-1: up",
            "drive pump-1 (hyundai-n700 on hall-1): online, forward",
            "mqtt: connected",
        ] {
            assert!(text.contains(line), "no {line} in {text}");
        }
    }
    // Without its broker it lives and is not ready.
    plant.broker.kill();
    plant.wait_until_not_ready();
    assert_eq!(plant.get("/healthz").unwrap(), (200, "ok\n".to_owned()));
    assert_eq!(metric(&plant, "vfd_gateway_ready "), 0.0);
    let is_alive = |way: &[&str; 3]| vfd_gateway(&[&way[..], &["--alive"]].concat());
    for way in &ways {
        assert_eq!(vfd_gateway(way).status.code(), Some(1), "{way:?}");
        let output = is_alive(way);
        assert_eq!(
            (output.status.code(), &output.stdout[..]),
            (Some(0), &b"ok\n"[..]),
            "{way:?}: {output:?}"
        );
    }
    plant.gateway.kill();
    for way in &ways {
        assert_eq!(
            vfd_gateway(way).status.code(),
            Some(1),
            "nobody there: {way:?}"
        );
        assert_eq!(
            is_alive(way).status.code(),
            Some(1),
            "nobody there: {way:?}"
        );
    }
}

#[test]
fn reads_from_memory_and_their_age_are_counted_where_the_listener_allows_them() {
    const POLL_S: f64 = 0.1;
    let count = |plant: &Plant, name: &str| {
        plant.metric(&format!(
            "vfd_gateway_modbus_native_reads_{name}{{listener=\"127.0.0.1:0\"}}"
        ))
    };
    let read = |plant: &Plant| {
        let polled = mbpoll(plant.modbus, &["-r", "257", "-c", "1"]);
        assert_eq!(polled.values, [0], "{}", polled.text);
    };
    let plant = Plant::with(Wish {
        listener: "cached = true",
        ..Wish::NONE
    });
    until("an answer from memory", PATIENCE, || {
        read(&plant);
        (count(&plant, "memory_total") >= 1.0).then_some(())
    });
    let (oldest, all) = (
        count(&plant, "memory_age_longest_seconds"),
        count(&plant, "memory_age_seconds_total"),
    );
    assert!(0.0 < oldest && oldest <= POLL_S, "{oldest}");
    assert!(
        oldest <= all && all <= count(&plant, "memory_total") * POLL_S,
        "{oldest} {all}"
    );
    // Registers that are not polled are read from the drive.
    let before = count(&plant, "line_total");
    let polled = mbpoll(plant.modbus, &["-r", "275", "-c", "4"]);
    assert_eq!(polled.values.len(), 4, "{}", polled.text);
    assert_eq!(count(&plant, "line_total"), before + 1.0);

    let plant = Plant::new();
    for _ in 0..3 {
        read(&plant);
    }
    assert_eq!(
        (count(&plant, "line_total"), count(&plant, "memory_total")),
        (3.0, 0.0)
    );
}
