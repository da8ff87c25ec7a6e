//! Prometheus as it stands: it reads what the gateway serves, and its alerts fire.

use super::mosquitto::free_port;
use super::outsiders::{promtool, samples};
use super::plant::{Plant, Wish, get};
use super::rig::Place;
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The directory of the rules that are delivered.
fn delivered() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/prometheus")
}

#[test]
fn configuration_and_rules_are_sound_and_each_alert_fires_when_it_should() {
    for args in [
        &["check", "config", "prometheus.yml"][..],
        &["check", "rules", "rules.yml"],
        &["test", "rules", "rules_test.yml"],
    ] {
        let output = promtool(&delivered(), args, "");
        assert!(output.status.success(), "{args:?}: {output:?}");
    }
}

#[test]
fn what_is_served_is_read_by_those_who_know_the_formats() {
    let plant = Plant::new();
    plant.run_over_mqtt();
    until("reply times and outcomes are shown", PATIENCE, || {
        let (_, text) = plant.get("/metrics")?;
        (text.contains("_drive_reply_seconds_bucket{") && text.contains("_drive_outcomes_total{")).then_some(())
    });
    let older = scraped(plant.http, "text/plain");
    let output = promtool(&delivered(), &["check", "metrics"], &older);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let samples = samples(&scraped(plant.http, "application/openmetrics-text"));
    assert!(samples > 100, "{samples}");
}

/// The metrics for a scraper that accepts `format`.
fn scraped(address: SocketAddr, format: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(stream, "GET /metrics HTTP/1.1\r\nHost: localhost\r\nAccept: {format}\r\nConnection: close\r\n\r\n")
        .unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert!(head.to_lowercase().contains(&format!("content-type: {format}")), "{head}");
    body.to_owned()
}

#[test]
fn a_tripped_drive_becomes_an_alert() {
    let plant = Plant::with(Wish { simulate: &["--trip-every", "5"], ..Wish::NONE });
    let place = Place::new();
    let (prometheus, address) = prometheus(&place, plant.http);
    let ask = |path: &str| -> Option<Value> { serde_json::from_str(&get(address, path)?.1).ok() };
    let alert = until("the alert fires", PATIENCE * 2, || {
        let answer = ask("/api/v1/alerts")?;
        let alerts = answer["data"]["alerts"].as_array()?;
        let of_trip = |alert: &&Value| alert["labels"]["alertname"] == "DriveTripped" && alert["state"] == "firing";
        alerts.iter().find(of_trip).cloned()
    });
    assert_eq!((&alert["labels"]["drive"], &alert["labels"]["line"]), (&"pump-1".into(), &"hall-1".into()));
    assert_eq!(alert["annotations"]["summary"], "Drive pump-1 on line hall-1 has tripped.");
    let number = |query: &str| -> Option<f64> {
        let answer = ask(&format!("/api/v1/query?query={query}"))?;
        answer["data"]["result"][0]["value"][1].as_str()?.parse().ok()
    };
    assert_eq!(number("up"), Some(1.0), "{}", prometheus.text());
    let reads = "histogram_quantile(0.5,vfd_gateway_drive_reply_seconds_bucket%7Bclass=%22read%22%7D)";
    let median = number(reads);
    assert!(median.is_some_and(|seconds| (0.001..1.0).contains(&seconds)), "{median:?}");
}

/// Prometheus with the delivered rules, looking at the gateway each second. Where it is asked.
fn prometheus(place: &Place, gateway: SocketAddr) -> (Started, SocketAddr) {
    let delivered_text = |name: &str| std::fs::read_to_string(delivered().join(name)).unwrap();
    let configuration = delivered_text("prometheus.yml");
    let configuration = configuration.replace("127.0.0.1:8080", &gateway.to_string()).replace(": 5s", ": 1s");
    assert!(configuration.contains(&gateway.to_string()) && configuration.contains("interval: 1s"));
    place.write("rules.yml", &delivered_text("rules.yml"));
    let file = place.write("prometheus.yml", &configuration);
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
    let mut command = Command::new("prometheus");
    command.arg(format!("--config.file={}", file.display()));
    command.arg(format!("--storage.tsdb.path={}", place.file("series").display()));
    command.arg(format!("--web.listen-address={address}"));
    (Started::new(command), address)
}
