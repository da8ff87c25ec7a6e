//! What drives have used outlives a kill, is found on every way, and is set back only on request.

use super::plant::{Plant, Wish};
use super::raw::Raw;
use super::rig::vfd_gateway;
use super::started::{PATIENCE, until};
use serde_json::Value;
use std::path::Path;
use std::time::{Duration, Instant};

const RUNNING: &str = "vfd_gateway_drive_running_seconds_total{line=\"hall-1\",drive=\"pump-1\"}";
const STARTS: &str = "vfd_gateway_drive_starts_total{line=\"hall-1\",drive=\"pump-1\"}";

/// What `vfd-gateway usage` prints of `data`.
fn days(data: &Path) -> Vec<Value> {
    let output = vfd_gateway(&[
        "usage",
        "pump-1",
        "--data-dir",
        data.to_str().unwrap(),
        "--json",
    ]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// The sum of a key over all days, in case midnight passes.
fn sum(days: &[Value], key: &str) -> f64 {
    days.iter().map(|day| day[key].as_f64().unwrap()).sum()
}

#[test]
fn sums_outlive_a_kill_are_found_on_every_way_and_begin_again_on_request() {
    let mut plant = Plant::new();
    let data = plant.place.file("data");
    assert_eq!(plant.metric(STARTS), 0.0);
    plant.run_over_mqtt();
    until("some running time is kept", PATIENCE, || {
        (plant.metric(RUNNING) >= 3.0).then_some(())
    });
    let before = plant.metric(RUNNING);
    plant.gateway.kill();
    plant.start_gateway_again();
    assert!(
        plant.metric(RUNNING) >= before,
        "{} after {before}",
        plant.metric(RUNNING)
    );
    assert_eq!(
        plant.metric(STARTS),
        1.0,
        "it was found running or stopped, and not started"
    );

    let subscriber = plant.subscriber();
    subscriber.wait_for_payload("pump-1/usage/starts", "1");
    subscriber.wait_for_payload("pump-1/usage/trips", "0");
    let mut client = Raw::connect(plant.modbus);
    let words = client.read_unit(super::plant::UNIFORM, 32, 8).unwrap();
    assert_eq!(
        (words[..2].to_vec(), words[5]),
        (vec![u16::MAX; 2], 1),
        "no energy is known of this model; {words:?}"
    );

    let (status, shown) = plant.get("/api/v1/usage?drive=pump-1").unwrap();
    let shown: Value = serde_json::from_str(&shown).unwrap();
    assert_eq!(
        (status, sum(shown["days"].as_array().unwrap(), "starts")),
        (200, 1.0)
    );
    assert_eq!(sum(&days(&data), "starts"), 1.0);
    let (status, csv) = plant.get("/api/v1/usage?drive=pump-1&format=csv").unwrap();
    assert!(
        status == 200
            && csv.starts_with("day,drive,energy_kwh,energy_from,running_hours,starts,trips\n"),
        "{csv}"
    );

    let config = plant.file.to_str().unwrap().to_owned();
    let reset = vfd_gateway(&["usage", "pump-1", "-c", &config, "--reset", "--yes"]);
    assert!(
        reset.status.success(),
        "{}",
        String::from_utf8_lossy(&reset.stderr)
    );
    assert!(
        String::from_utf8_lossy(&reset.stdout).contains("1 starts"),
        "{reset:?}"
    );
    until("the sums are at 0", PATIENCE, || {
        (plant.metric(STARTS) == 0.0).then_some(())
    });
    assert_eq!(sum(&days(&data), "starts"), 1.0, "days stay");
    let audit = vfd_gateway(&["journal", "audit", "-c", &config, "--json"]);
    let audit = String::from_utf8_lossy(&audit.stdout).into_owned();
    assert!(
        audit
            .lines()
            .any(|row| row.contains("usage_reset") && row.contains("\"by\":\"local\"")),
        "{audit}"
    );
    let unknown = vfd_gateway(&["usage", "pump-2", "-c", &config, "--reset", "--yes"]);
    let said = String::from_utf8_lossy(&unknown.stderr).into_owned();
    assert!(
        unknown.status.code() == Some(2) && said.contains("did you mean pump-1?"),
        "{said}"
    );
}

/// The running time of the drive in the journal's file.
fn kept(plant: &Plant) -> Duration {
    let file = plant.place.file("data").join("journal.db");
    let database = rusqlite::Connection::open(file).unwrap();
    let body: String = database
        .query_row("SELECT body FROM drive WHERE name = 'pump-1'", [], |row| {
            row.get(0)
        })
        .unwrap();
    let body: Value = serde_json::from_str(&body).unwrap();
    Duration::from_millis(body["usage"]["running_ms"].as_u64().unwrap())
}

/// `KILLS=100 cargo test --test process how_much_running_time -- --ignored --nocapture`
#[test]
#[ignore = "a measurement of some minutes"]
fn how_much_running_time_is_lost_by_kills() {
    let kills = std::env::var("KILLS").map_or(20, |text| text.parse().expect("KILLS is a number"));
    let mut plant = Plant::with(Wish {
        lost_after: "10min",
        ..Wish::default()
    });
    // It goes on running while the gateway is away.
    let text = std::fs::read_to_string(&plant.file).unwrap();
    std::fs::write(
        &plant.file,
        text.replace(
            "on_commander_lost = \"stop\"",
            "on_commander_lost = \"hold\"",
        ),
    )
    .unwrap();
    plant.run_over_mqtt();
    let mut random = fastrand::Rng::with_seed(1);
    let mut lost = Vec::new();
    for _ in 0..kills {
        plant.gateway.kill();
        let before = kept(&plant);
        plant.start_gateway_again();
        let begun = Instant::now();
        std::thread::sleep(Duration::from_millis(random.u64(1_000..20_000)));
        let ran = begun.elapsed();
        plant.gateway.kill();
        lost.push(ran.saturating_sub(kept(&plant).saturating_sub(before)));
        plant.start_gateway_again();
    }
    lost.sort();
    println!(
        "{kills} kills: lost {:.1?} (median), {:.1?} at most",
        lost[lost.len() / 2],
        lost[lost.len() - 1]
    );
}
