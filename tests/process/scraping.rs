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
        (text.contains("_drive_reply_seconds_bucket{") && text.contains("_drive_outcomes_total{"))
            .then_some(())
    });
    let older = scraped(plant.http, "text/plain");
    let output = promtool(&delivered(), &["check", "metrics"], &older);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let samples = samples(&scraped(plant.http, "application/openmetrics-text"));
    assert!(samples > 100, "{samples}");
}

/// The metrics for a scraper that accepts `format`.
fn scraped(address: SocketAddr, format: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(
        stream,
        "GET /metrics HTTP/1.1\r\nHost: localhost\r\nAccept: {format}\r\nConnection: close\r\n\r\n"
    )
    .unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert!(
        head.to_lowercase()
            .contains(&format!("content-type: {format}")),
        "{head}"
    );
    body.to_owned()
}

#[test]
fn a_tripped_drive_becomes_an_alert() {
    let plant = Plant::with(Wish {
        simulate: &["--trip-every", "5"],
        ..Wish::NONE
    });
    let place = Place::new();
    let (prometheus, address) = prometheus(&place, plant.http);
    let ask = |path: &str| -> Option<Value> { serde_json::from_str(&get(address, path)?.1).ok() };
    let alert = until("the alert fires", PATIENCE * 2, || {
        let answer = ask("/api/v1/alerts")?;
        let alerts = answer["data"]["alerts"].as_array()?;
        let of_trip = |alert: &&Value| {
            alert["labels"]["alertname"] == "DriveTripped" && alert["state"] == "firing"
        };
        alerts.iter().find(of_trip).cloned()
    });
    assert_eq!(
        (&alert["labels"]["drive"], &alert["labels"]["line"]),
        (&"pump-1".into(), &"hall-1".into())
    );
    assert_eq!(
        alert["annotations"]["summary"],
        "Drive pump-1 on line hall-1 has tripped."
    );
    let asked = |query: &str| ask(&format!("/api/v1/query?query={}", encoded(query)));
    let number = |query: &str| -> Option<f64> {
        asked(query)?["data"]["result"][0]["value"][1]
            .as_str()?
            .parse()
            .ok()
    };
    assert_eq!(number("up"), Some(1.0), "{}", prometheus.text());
    let median =
        number("histogram_quantile(0.5, vfd_gateway_drive_reply_seconds_bucket{class=\"read\"})");
    assert!(
        median.is_some_and(|seconds| (0.001..1.0).contains(&seconds)),
        "{median:?}"
    );
    for query in dashboard_queries() {
        // Nobody has commanded, this model has no watchdog that can be read, and there is no Sparkplug.
        let may_be_empty = ["drive_outcomes", "drive_watchdog", "sparkplug"]
            .iter()
            .any(|name| query.contains(name));
        until(&format!("the dashboard shows {query}"), PATIENCE, || {
            let answer = asked(&query)?;
            assert_eq!(answer["status"], "success", "{query}: {answer}");
            let is_empty = answer["data"]["result"].as_array()?.is_empty();
            (may_be_empty || !is_empty).then_some(())
        });
    }
}

/// What the panels of the dashboard ask for, with everything chosen.
fn dashboard_queries() -> Vec<String> {
    let file = delivered().with_file_name("grafana").join("dashboard.json");
    let dashboard: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let targets = dashboard["panels"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|panel| panel["targets"].as_array());
    let queries = targets.flatten().map(|target| {
        let query = target["expr"]
            .as_str()
            .unwrap()
            .replace("$__rate_interval", "10s");
        ["$instance", "$line", "$drive"]
            .iter()
            .fold(query, |query, name| query.replace(name, ".*"))
    });
    let queries: Vec<_> = queries.collect();
    assert!(
        queries.len() > 50 && queries.iter().all(|query| !query.contains('$')),
        "{queries:?}"
    );
    queries
}

/// `text` as it stands in a query of an address.
fn encoded(text: &str) -> String {
    text.bytes().map(|byte| format!("%{byte:02X}")).collect()
}

/// Prometheus with the delivered rules, looking at the gateway each second. Where it is asked.
fn prometheus(place: &Place, gateway: SocketAddr) -> (Started, SocketAddr) {
    let delivered_text = |name: &str| std::fs::read_to_string(delivered().join(name)).unwrap();
    let configuration = delivered_text("prometheus.yml");
    let configuration = configuration
        .replace("127.0.0.1:8080", &gateway.to_string())
        .replace(": 5s", ": 1s");
    assert!(configuration.contains(&gateway.to_string()) && configuration.contains("interval: 1s"));
    place.write("rules.yml", &delivered_text("rules.yml"));
    let file = place.write("prometheus.yml", &configuration);
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
    let mut command = Command::new("prometheus");
    command.arg(format!("--config.file={}", file.display()));
    command.arg(format!(
        "--storage.tsdb.path={}",
        place.file("series").display()
    ));
    command.arg(format!("--web.listen-address={address}"));
    (Started::new(command), address)
}
