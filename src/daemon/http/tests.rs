//! Answers over real sockets, from a gateway whose lines are played by the test.

use super::connections::{self, CONNECTIONS_MAX, ConnectionPatience};
use super::routes::{self, RouteDocuments};
use super::socket::{OwnSocket, SOCKET_NAME};
use super::state::HttpState;
use super::table;
use crate::daemon::exchange::shared::SharedPlant;
use crate::daemon::exchange::totals::{ModbusTotals, MqttTotals};
use crate::daemon::host::clock;
use crate::daemon::local::LocalSide;
use crate::daemon::testing::Dir;
use crate::domain::command::{Outcome, Owner};
use crate::domain::counts::{CommandCounts, DamageCounts, ExchangeCounts, ReplyCounts};
use crate::domain::ids::{DriveIndex, Name, UnitId};
use crate::domain::link::Interface;
use crate::domain::report::{
    LineCounters, LineFault, LineMeasured, LineQuality, LineReport, LineState, LineWaiting,
};
use crate::domain::report::{ReplyReport, StationReport, StopBounds};
use crate::domain::standby::{LineRole, StandbyReport, StandbyTrouble};
use crate::domain::time::{MonoTime, WallTime};
use crate::domain::version::PROGRAM_VERSION;
use crate::drive::description::{DriveDescription, DriveRef, PointSettings};
use crate::drive::snapshot::{DrivePresence, DriveSnapshot};
use crate::drive::view::{ControlView, DriveView, RunState};
use crate::north::modbus::ConnectionCounters;
use crate::north::mqtt;
use crate::vendors;
use prometheus_client::metrics::MetricType;
use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UnixStream};
use tokio::task::LocalSet;

/// A drive at unit 1 of the line hall-1.
pub(super) fn description() -> DriveDescription {
    let name = |text| Name::new(text).unwrap();
    let catalog = vendors::catalog();
    DriveDescription {
        place: DriveRef {
            line: 0,
            drive: DriveIndex(0),
        },
        name: name("pump-1"),
        line: name("hall-1"),
        model: Arc::clone(catalog.find("hyundai-n700").unwrap()),
        unit: UnitId::new(1).unwrap(),
        uniform_unit: UnitId::new(101).unwrap(),
        group: None,
        pace: crate::drive::plan::PollPace::new(Duration::from_secs(1), 1.0),
        ratings: crate::drive::description::DriveRatings::default(),
        control: None,
        points: PointSettings::default(),
    }
}

/// One line with one drive, with a broker if `broker`.
pub(super) fn state(broker: bool) -> Arc<HttpState> {
    let name = |text| Name::new(text).unwrap();
    Arc::new(HttpState {
        sparkplug: None.into(),
        journal: None,
        trends: None,
        socket: None,
        configuration: None,
        gateway: "plant-a".to_owned(),
        shared: Arc::new(SharedPlant::new(
            vec![(name("hall-1"), Interface::Rs485)],
            vec![description()],
        ))
        .into(),
        modbus: Arc::new(ModbusTotals::default()),
        mqtt: broker.then(Arc::default).into(),
        started: clock::now(),
        started_at: WallTime {
            unix_ms: 1_700_000_000_500,
        },
    })
}

pub(super) fn show(state: &HttpState, report: LineReport, view: DriveView) {
    state.shared.load().lines[0].set_report(report);
    state.shared.load().drives[0].view.store(Arc::new(view));
}

pub(super) const UP: LineReport = LineReport {
    state: LineState::Up,
    fault: None,
    open_error: None,
    counters: LineCounters {
        requests: 7,
        replies: 5,
        exceptions: 1,
        silent: 0,
        garbled: 0,
        strays: 0,
        foreign: 0,
        other_master: 0,
        echoes: 0,
        noise_bytes: 12,
        noise_between: 1,
        retries: 0,
        barriers: 0,
        broadcasts: 0,
        joined: 0,
        queue_full: 0,
        expired: 0,
        withdrawn: 0,
        port_ups: 1,
        port_downs: 0,
        jams: 0,
        busy_us: 1_500_000,
    },
    stop: StopBounds {
        all_healthy: Duration::from_millis(40),
        one_silent: Duration::from_millis(560),
        each_further: Duration::from_millis(31),
    },
    planned_use_per_mille: 125,
    measured: LineMeasured {
        longest_stop: Duration::from_millis(17),
        shortest_gap: None,
        median_gap: Duration::from_micros(90),
    },
    quality: LineQuality {
        bad_per_cent: Some(12),
        is_suspended: true,
    },
    suspicion: None,
    waiting: LineWaiting {
        requests: 4,
        commands: 2,
        stops: 1,
    },
    standby: None,
};

/// A drive that answered at `at` with 50.00 Hz and 3 trips.
pub(super) fn online(at: MonoTime) -> DriveView {
    let mut snapshot = DriveSnapshot::default();
    snapshot.presence = DrivePresence::Online;
    snapshot.take(0x0101_u16.into(), &[5000], at);
    snapshot.take(0x0112_u16.into(), &[3], at);
    DriveView {
        line_is_up: true,
        snapshot,
        run_state: RunState::Forward,
        ..DriveView::default()
    }
}

pub(super) fn on_a_runtime<F: Future>(test: F) -> F::Output {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    LocalSet::new().block_on(&runtime, test)
}

pub(super) async fn serve(state: &Arc<HttpState>, patience: ConnectionPatience) -> SocketAddr {
    serve_documents(RouteDocuments::new(Arc::clone(state)), patience).await
}

pub(super) async fn serve_documents(
    documents: RouteDocuments,
    patience: ConnectionPatience,
) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::task::spawn_local(connections::serve(
        listener,
        routes::router(documents),
        patience,
    ));
    address
}

/// The status line's number and the body of the answer.
async fn ask(address: SocketAddr, method: &str, path: &str) -> (u16, String) {
    answer(TcpStream::connect(address).await.unwrap(), method, path, "").await
}

pub(super) async fn answer(
    mut stream: impl AsyncReadExt + AsyncWriteExt + Unpin,
    method: &str,
    path: &str,
    body: &str,
) -> (u16, String) {
    let length = body.len();
    let head = format!(
        "{method} {path} HTTP/1.1\r\nHost: here\r\nConnection: close\r\nContent-Length: {length}"
    );
    let request = format!("{head}\r\n\r\n{body}");
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).await.unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap();
    (
        head.split(' ').nth(1).unwrap().parse().unwrap(),
        body.to_owned(),
    )
}

#[test]
fn alive_and_ready_differ() {
    on_a_runtime(async {
        let state = state(true);
        let address = serve(&state, ConnectionPatience::default()).await;
        assert_eq!(
            ask(address, "GET", "/healthz").await,
            (200, "ok\n".to_owned())
        );
        let gone = LineReport {
            fault: Some(LineFault::Gone),
            ..LineReport::default()
        };
        show(&state, gone, DriveView::default());
        let (status, body) = ask(address, "GET", "/readyz").await;
        assert_eq!(status, 503);
        assert!(body.contains("the device is gone"), "{body}");
        show(&state, UP, DriveView::default());
        assert_eq!(
            ask(address, "GET", "/readyz").await.0,
            503,
            "the broker cannot be reached"
        );
        state
            .mqtt
            .load_full()
            .as_ref()
            .unwrap()
            .set(true, &Default::default());
        let (status, body) = ask(address, "GET", "/readyz").await;
        let body: serde_json::Value = serde_json::from_str(&body).unwrap();
        assert_eq!(
            (status, &body["ready"], &body["lines"][0]["state"]),
            (200, &true.into(), &"up".into())
        );
    });
}

#[test]
fn what_is_not_there_is_404_and_what_does_not_only_look_is_405() {
    on_a_runtime(async {
        let address = serve(&state(false), ConnectionPatience::default()).await;
        for (method, path, status) in [
            ("GET", "/", 200),
            ("GET", "/assets/", 404),
            ("GET", "/metrics/", 404),
            ("POST", "/nothing", 404),
            ("POST", "/metrics", 405),
            ("PUT", "/healthz", 405),
            ("DELETE", "/api/v1/health", 405),
            ("HEAD", "/metrics", 200),
        ] {
            assert_eq!(
                ask(address, method, path).await.0,
                status,
                "{method} {path}"
            );
        }
    });
}

#[test]
fn health_names_lines_and_drives() {
    on_a_runtime(async {
        let state = state(false);
        show(&state, UP, online(clock::now()));
        let address = serve(&state, ConnectionPatience::default()).await;
        let (_, body) = ask(address, "GET", "/api/v1/health").await;
        let health: serde_json::Value = serde_json::from_str(&body).unwrap();
        assert_eq!(health["gateway"], "plant-a");
        assert_eq!(health["version"], PROGRAM_VERSION);
        assert_eq!(health["ready"], true, "no broker is configured");
        let line = serde_json::json!({ "name": "hall-1", "state": "up", "reason": null, "suspicion": null, "standby": null });
        assert_eq!(health["lines"], serde_json::json!([line]));
        let drive = &health["drives"][0];
        assert_eq!(
            (&drive["presence"], &drive["run_state"]),
            (&"online".into(), &"forward".into())
        );
        show(
            &state,
            LineReport::default(),
            DriveView {
                line_is_up: false,
                ..online(clock::now())
            },
        );
        let (_, body) = ask(address, "GET", "/api/v1/health").await;
        let health: serde_json::Value = serde_json::from_str(&body).unwrap();
        let drive = &health["drives"][0];
        assert_eq!(
            (&drive["presence"], &drive["run_state"]),
            (&"offline".into(), &"offline".into())
        );
    });
}

#[test]
fn metrics_show_lines_drives_and_only_fresh_values() {
    let state = state(true);
    let now = clock::now() + Duration::from_secs(3600);
    let seen = |age| show(&state, UP, online(now.before(age)));
    let text = || super::metrics::text(Arc::clone(&state), now).unwrap();
    seen(Duration::from_millis(2900));
    state.modbus.opened();
    state.modbus.add(
        &ConnectionCounters::default(),
        &ConnectionCounters {
            requests: 3,
            replies: 2,
            exceptions: one_of_02(),
            ..ConnectionCounters::default()
        },
    );
    let fresh = text();
    for line in [
        "# TYPE vfd_gateway_line_requests counter",
        "vfd_gateway_line_requests_total{line=\"hall-1\"} 7",
        "vfd_gateway_line_noise_bytes_total{line=\"hall-1\"} 12",
        "vfd_gateway_line_bad_ratio{line=\"hall-1\"} 0.12",
        "vfd_gateway_line_suspended{line=\"hall-1\"} 1.0",
        "vfd_gateway_line_up{line=\"hall-1\"} 1.0",
        "vfd_gateway_drive_value_age_seconds{line=\"hall-1\",drive=\"pump-1\"} 2.9",
        "vfd_gateway_drive_online{line=\"hall-1\",drive=\"pump-1\"} 1.0",
        "vfd_gateway_drive_run_state{line=\"hall-1\",drive=\"pump-1\"} 2.0",
        "# UNIT vfd_gateway_drive_output_frequency_hertz hertz",
        "vfd_gateway_drive_output_frequency_hertz{line=\"hall-1\",drive=\"pump-1\"} 50.0",
        "vfd_gateway_drive_value{line=\"hall-1\",drive=\"pump-1\",name=\"trip_count\",unit=\"-\"} 3.0",
        "vfd_gateway_modbus_connections 1.0",
        "vfd_gateway_modbus_requests_total 3",
        "vfd_gateway_modbus_exceptions_total{code=\"02\"} 1",
        "vfd_gateway_mqtt_connected 0.0",
        "vfd_gateway_mqtt_contested 0.0",
        "vfd_gateway_mqtt_takeovers_total 0",
        "vfd_gateway_process_start_time_seconds 1700000000.5",
        "# EOF",
    ] {
        assert!(fresh.lines().any(|it| it == line), "no {line} in\n{fresh}");
    }
    assert!(
        !fresh.contains("lease_held{"),
        "a drive without control has no lease"
    );
    assert!(
        !fresh.contains("line_active{"),
        "a line of one gateway has no roles"
    );
    seen(Duration::from_millis(3000));
    let stale = text();
    assert!(!stale.contains("hertz{"), "{stale}");
}

#[test]
fn a_line_of_two_gateways_is_shown_with_the_role() {
    let state = state(false);
    let standby = StandbyReport {
        role: LineRole::Active,
        take_overs: 3,
        given_up: 2,
        rivals: 1,
        hears_other: false,
        listener: Some(true),
        kept: 0,
        trouble: StandbyTrouble::default(),
    };
    show(
        &state,
        LineReport {
            standby: Some(standby),
            ..UP
        },
        DriveView::default(),
    );
    let text = super::metrics::text(Arc::clone(&state), clock::now()).unwrap();
    for line in [
        "vfd_gateway_line_active{line=\"hall-1\"} 1.0",
        "vfd_gateway_line_hears_other{line=\"hall-1\"} 0.0",
        "vfd_gateway_line_listener{line=\"hall-1\"} 1.0",
        "vfd_gateway_line_take_overs_total{line=\"hall-1\"} 3",
        "vfd_gateway_line_given_up_total{line=\"hall-1\"} 2",
        "vfd_gateway_line_rivals_total{line=\"hall-1\"} 1",
    ] {
        assert!(text.lines().any(|it| it == line), "no {line} in\n{text}");
    }
    let health = serde_json::json!(super::health::health(&state, clock::now()));
    let expected = serde_json::json!({ "role": "active", "half": null, "partner": null, "take_overs": 3, "given_up": 2,
        "rivals": 1, "hears_other": false, "listener": true, "deaf": false, "files_differ": false,
        "unknown_station": null });
    assert_eq!(health["lines"][0]["standby"], expected);
}

#[test]
fn metrics_show_what_was_planned_beside_what_was_measured() {
    let state = state(false);
    show(&state, UP, DriveView::default());
    let reads = ReplyReport {
        count: 1200,
        p50: Duration::from_millis(4),
        p999: Duration::from_millis(7),
        max: Duration::from_millis(9),
        timeout: Duration::from_millis(30),
        ..ReplyReport::default()
    };
    let writes = ReplyReport {
        timeout: Duration::from_millis(500),
        ..ReplyReport::default()
    };
    let mut replies = ReplyCounts::default();
    [4, 4, 9]
        .into_iter()
        .for_each(|millis| replies.add(Duration::from_millis(millis)));
    let mut commands = CommandCounts::default();
    commands.add(&Owner::Mqtt, Outcome::Confirmed);
    let station = StationReport {
        replies: [reads, writes, writes],
        oldest_age: Duration::from_millis(620),
        planned_age: Some(Duration::from_millis(640)),
        exchanges: ExchangeCounts {
            replies: 90,
            exceptions: 4,
            garbled: 5,
            silent: 3,
            retries: 2,
        },
        damage: DamageCounts {
            late: 6,
            doubled: 7,
            ..DamageCounts::default()
        },
        reply_counts: [replies, ReplyCounts::default(), ReplyCounts::default()],
        commands,
        bad_per_cent: Some(4),
        is_suspended: true,
    };
    state.shared.load().drives[0]
        .station
        .store(Arc::new(station));
    let text = super::metrics::text(Arc::clone(&state), clock::now()).unwrap();
    for line in [
        "vfd_gateway_line_planned_use_ratio{line=\"hall-1\"} 0.125",
        "vfd_gateway_line_stop_bound_healthy_seconds{line=\"hall-1\"} 0.04",
        "vfd_gateway_line_stop_bound_seconds{line=\"hall-1\"} 0.56",
        "vfd_gateway_line_stop_longest_seconds{line=\"hall-1\"} 0.017",
        "vfd_gateway_line_gap_median_seconds{line=\"hall-1\"} 0.00009",
        "vfd_gateway_drive_oldest_age_seconds{line=\"hall-1\",drive=\"pump-1\"} 0.62",
        "vfd_gateway_drive_planned_age_seconds{line=\"hall-1\",drive=\"pump-1\"} 0.64",
        "vfd_gateway_line_busy_seconds_total{line=\"hall-1\"} 1.5",
        "vfd_gateway_line_waiting_requests{line=\"hall-1\"} 4.0",
        "vfd_gateway_line_waiting_commands{line=\"hall-1\"} 2.0",
        "vfd_gateway_line_waiting_stops{line=\"hall-1\"} 1.0",
        "vfd_gateway_line_hangs{line=\"hall-1\"} 0.0",
        "vfd_gateway_drive_replies_total{line=\"hall-1\",drive=\"pump-1\"} 90",
        "vfd_gateway_drive_exceptions_total{line=\"hall-1\",drive=\"pump-1\"} 4",
        "vfd_gateway_drive_garbled_total{line=\"hall-1\",drive=\"pump-1\"} 5",
        "vfd_gateway_drive_silent_total{line=\"hall-1\",drive=\"pump-1\"} 3",
        "vfd_gateway_drive_retries_total{line=\"hall-1\",drive=\"pump-1\"} 2",
        "vfd_gateway_drive_late_total{line=\"hall-1\",drive=\"pump-1\"} 6",
        "vfd_gateway_drive_doubled_total{line=\"hall-1\",drive=\"pump-1\"} 7",
        "vfd_gateway_drive_bad_ratio{line=\"hall-1\",drive=\"pump-1\"} 0.04",
        "vfd_gateway_drive_suspended{line=\"hall-1\",drive=\"pump-1\"} 1.0",
        "# TYPE vfd_gateway_drive_reply_seconds histogram",
        "vfd_gateway_drive_reply_seconds_sum{line=\"hall-1\",drive=\"pump-1\",class=\"read\"} 0.017",
        "vfd_gateway_drive_reply_seconds_count{line=\"hall-1\",drive=\"pump-1\",class=\"read\"} 3",
        "vfd_gateway_drive_reply_seconds_bucket{le=\"0.005\",line=\"hall-1\",drive=\"pump-1\",class=\"read\"} 2",
        "vfd_gateway_drive_reply_seconds_bucket{le=\"+Inf\",line=\"hall-1\",drive=\"pump-1\",class=\"read\"} 3",
        "vfd_gateway_drive_outcomes_total{line=\"hall-1\",drive=\"pump-1\",source=\"mqtt\",outcome=\"confirmed\"} 1",
        "vfd_gateway_drive_outcomes_total{line=\"hall-1\",drive=\"pump-1\",source=\"mqtt\",outcome=\"refused\"} 0",
        "vfd_gateway_drive_reply_timeout_seconds{line=\"hall-1\",drive=\"pump-1\",class=\"write\"} 0.5",
        "vfd_gateway_drive_reply_time_seconds{line=\"hall-1\",drive=\"pump-1\",class=\"read\",share=\"0.999\"} 0.007",
    ] {
        assert!(text.lines().any(|it| it == line), "no {line} in\n{text}");
    }
    assert!(
        !text.contains("gap_shortest_seconds{"),
        "there was no frame yet"
    );
    assert!(
        !text.contains("class=\"write\",share"),
        "there was no write yet"
    );
    assert!(
        !text.contains("source=\"local\""),
        "nobody commanded from there"
    );
}

#[test]
fn metrics_show_control() {
    let state = state(false);
    let control = ControlView {
        start_inhibited: true,
        epoch: 1,
        commands: 9,
        ..ControlView::default()
    };
    show(
        &state,
        UP,
        DriveView {
            control: Some(control),
            ..online(clock::now())
        },
    );
    let text = super::metrics::text(state, clock::now()).unwrap();
    let drive = "{line=\"hall-1\",drive=\"pump-1\"}";
    for (name, value) in [
        ("start_inhibited", "1.0"),
        ("lease_held", "0.0"),
        ("commands_total", "9"),
    ] {
        let line = format!("vfd_gateway_drive_{name}{drive} {value}");
        assert!(text.contains(&line), "no {line} in\n{text}");
    }
    assert!(!text.contains("mqtt"), "no broker is configured");
}

#[test]
fn who_does_not_know_open_metrics_gets_the_format_before_it() {
    let text = "# HELP a_b Help of it.\n# TYPE a_b counter\n# UNIT a_b s\na_b_total{x=\"y\"} 1\n# HELP a_c Of a_b.\n\
                # TYPE a_c gauge\na_c 1.0\n# EOF\n";
    let older = "# HELP a_b_total Help of it.\n# TYPE a_b_total counter\na_b_total{x=\"y\"} 1\n# HELP a_c Of a_b.\n\
                 # TYPE a_c gauge\na_c 1.0\n";
    assert_eq!(super::metrics::older(text), older);
}

fn one_of_02() -> [u64; ConnectionCounters::EXCEPTION_CODES] {
    std::array::from_fn(|code| u64::from(code == 2))
}

/// All metrics with their labels.
fn metrics() -> Vec<(&'static table::MetricName, &'static str)> {
    fn names<T>(
        metrics: &'static [table::MetricFamily<T>],
    ) -> impl Iterator<Item = &'static table::MetricName> {
        metrics.iter().map(|metric| &metric.name)
    }
    let of = |labels: &'static str| move |name| (name, labels);
    let mut all = vec![(&table::BUILD, "`version`, `gateway`")];
    all.extend(names(table::GATEWAY).map(of("-")));
    all.extend(names(table::LINE).map(of("`line`")));
    all.extend(names(table::THREAD).map(of("`line`")));
    all.extend(names(&table::DRIVE).map(of("`line`, `drive`")));
    all.extend(names(table::STATION).map(of("`line`, `drive`")));
    all.extend(names(table::REPLIES).map(of("`line`, `drive`, `class`")));
    all.push((&table::REPLY_TIME, "`line`, `drive`, `class`, `share`"));
    all.push((&table::REPLY, "`line`, `drive`, `class`"));
    all.push((&table::COMMANDS, "`line`, `drive`, `source`, `outcome`"));
    all.push((&table::VALUE_AGE, "`line`, `drive`"));
    all.push((&table::WARNING, "`line`, `drive`"));
    all.push((&table::OUTPUT_FREQUENCY, "`line`, `drive`"));
    all.push((&table::VALUE, "`line`, `drive`, `name`, `unit`"));
    all.extend(names(table::MODBUS).map(of("-")));
    all.extend(names(table::SERIAL).map(of("`master`")));
    all.extend(names(table::READS).map(of("`listener`")));
    all.push((&table::MODBUS_EXCEPTIONS, "`code`"));
    all.extend(names(table::MQTT).map(of("-")));
    all.extend(names(table::SPARKPLUG).map(of("-")));
    all.extend(names(table::SOCKET).map(of("-")));
    all.extend(names(table::JOURNAL).map(of("-")));
    all
}

#[test]
fn no_metric_stands_in_the_table_twice() {
    let mut names: Vec<_> = metrics().into_iter().map(|(name, _)| name.name).collect();
    let count = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), count);
}

#[test]
fn the_reference_has_every_metric_as_it_is_served() {
    let text =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/metrics.md"))
            .unwrap();
    let row = |(name, labels): (&table::MetricName, &str)| {
        let unit = name.unit.map(|unit| format!("_{unit}")).unwrap_or_default();
        let total = if matches!(name.kind, MetricType::Counter) {
            "_total"
        } else {
            ""
        };
        format!(
            "| `{}{unit}{total}` | {labels} | {} |",
            name.name, name.help
        )
    };
    let right: Vec<_> = metrics().into_iter().map(row).collect();
    let written: Vec<_> = text
        .lines()
        .filter(|line| line.starts_with("| `"))
        .collect();
    assert_eq!(written, right, "right is:\n{}", right.join("\n"));
}

/// The words of `text` that begin like the name of a metric.
fn named_in(text: &str) -> BTreeSet<&str> {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    words
        .filter(|word| word.starts_with(&format!("{}_", table::PREFIX)))
        .collect()
}

#[test]
fn every_metric_of_dashboard_and_alerts_is_served() {
    let served: BTreeSet<_> = metrics()
        .into_iter()
        .flat_map(|(name, _)| sample_names(name))
        .collect();
    for file in [
        "grafana/dashboard.json",
        "prometheus/rules.yml",
        "prometheus/rules_test.yml",
    ] {
        let text = delivered(file);
        let named = named_in(&text);
        assert!(named.len() > 20, "{file}: {named:?}");
        let unknown: Vec<_> = named
            .into_iter()
            .filter(|name| !served.contains(*name))
            .collect();
        assert!(
            unknown.is_empty(),
            "{file} names what is not served: {unknown:?}"
        );
    }
}

#[test]
fn every_alert_is_shown_to_fire() {
    let rules = delivered("prometheus/rules.yml");
    let tests = delivered("prometheus/rules_test.yml");
    let alerts: Vec<_> = rules
        .lines()
        .filter_map(|line| line.trim().strip_prefix("- alert: "))
        .collect();
    assert!(alerts.len() > 10, "{alerts:?}");
    for alert in alerts {
        let fires = format!("'{{alertname=\"{alert}\"}}', value: 1");
        assert!(tests.contains(&fires), "{alert}");
    }
}

/// The dashboard needs nothing beyond Grafana: its own panels, and a data source that the user chooses.
#[test]
fn the_dashboard_needs_no_plugin_and_names_no_source() {
    let dashboard: serde_json::Value =
        serde_json::from_str(&delivered("grafana/dashboard.json")).unwrap();
    let names = dashboard["templating"]["list"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["name"].as_str().unwrap());
    assert_eq!(
        names.collect::<Vec<_>>(),
        ["datasource", "instance", "line", "drive"]
    );
    let panels = dashboard["panels"].as_array().unwrap();
    for panel in panels {
        let kind = panel["type"].as_str().unwrap();
        assert!(
            ["row", "timeseries", "stat", "state-timeline"].contains(&kind),
            "{kind}"
        );
        let source = &panel["datasource"]["uid"];
        assert!(kind == "row" || source == "${datasource}", "{panel}");
    }
    let numbers: BTreeSet<_> = panels
        .iter()
        .map(|panel| panel["id"].as_u64().unwrap())
        .collect();
    assert_eq!(numbers.len(), panels.len());
}

fn delivered(file: &str) -> String {
    std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("deploy")
            .join(file),
    )
    .unwrap()
}

/// The names of the samples of a metric.
fn sample_names(name: &table::MetricName) -> Vec<String> {
    let unit = name.unit.map(|unit| format!("_{unit}")).unwrap_or_default();
    let endings: &[&str] = match name.kind {
        MetricType::Counter => &["_total"],
        MetricType::Histogram => &["_bucket", "_sum", "_count"],
        _ => &[""],
    };
    endings
        .iter()
        .map(|ending| format!("{}_{}{unit}{ending}", table::PREFIX, name.name))
        .collect()
}

#[test]
fn who_says_nothing_or_stays_too_long_is_shown_the_door() {
    on_a_runtime(async {
        let short = Duration::from_millis(200);
        let address = serve(
            &state(false),
            ConnectionPatience {
                head: short,
                ..ConnectionPatience::default()
            },
        )
        .await;
        let mut silent = TcpStream::connect(address).await.unwrap();
        silent.write_all(b"GET /healthz HTT").await.unwrap();
        let mut rest = Vec::new();
        // Whatever it receives, the stream is closed.
        let _ = tokio::time::timeout(Duration::from_secs(5), silent.read_to_end(&mut rest))
            .await
            .unwrap();
        let address = serve(
            &state(false),
            ConnectionPatience {
                connection: short,
                ..ConnectionPatience::default()
            },
        )
        .await;
        let mut idle = TcpStream::connect(address).await.unwrap();
        idle.write_all(b"GET /healthz HTTP/1.1\r\nHost: here\r\n\r\n")
            .await
            .unwrap();
        let _ = tokio::time::timeout(Duration::from_secs(5), idle.read_to_end(&mut rest))
            .await
            .unwrap();
        assert!(String::from_utf8_lossy(&rest).contains("ok\n"));
    });
}

#[test]
fn one_connection_too_many_waits_for_its_place() {
    on_a_runtime(async {
        let address = serve(&state(false), ConnectionPatience::default()).await;
        let mut held = Vec::new();
        for _ in 0..CONNECTIONS_MAX {
            held.push(TcpStream::connect(address).await.unwrap());
        }
        let mut late = Box::pin(ask(address, "GET", "/healthz"));
        assert!(
            tokio::time::timeout(Duration::from_millis(200), &mut late)
                .await
                .is_err()
        );
        held.pop();
        assert_eq!(late.await.0, 200);
    });
}

#[test]
fn the_socket_is_its_owners_alone_and_goes_with_the_gateway() {
    let place = Dir::new();
    let path = place.join(SOCKET_NAME);
    on_a_runtime(async {
        let socket = OwnSocket::open(&place).unwrap();
        assert_eq!(socket.path(), path);
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o600);
        let state = state(false);
        let side = Arc::new(LocalSide::new(state.shared.clone(), None));
        tokio::task::spawn_local(socket.serve(RouteDocuments::new(Arc::clone(&state)), side));
        let connect = async || UnixStream::connect(&path).await.unwrap();
        assert_eq!(answer(connect().await, "GET", "/healthz", "").await.0, 200);
        // What only the tools may do is served here and nowhere else.
        let setup = "/api/v1/drives/nobody/setup";
        assert!(
            answer(connect().await, "GET", setup, "")
                .await
                .1
                .contains("unknown_drive")
        );
        let address = serve(&state, ConnectionPatience::default()).await;
        for (method, path) in [
            ("GET", setup),
            ("GET", "/api/v1/drives/pump-1/setup"),
            ("POST", setup),
        ] {
            assert_eq!(ask(address, method, path).await, (404, String::new()));
        }
    });
    assert!(!path.exists(), "it is gone with the task");
}

/// A process that can open the lock can hold it, and no gateway would start.
#[test]
fn the_lock_is_its_owners_alone() {
    let place = Dir::new();
    let lock = place.join("vfd-gateway.lock");
    let mode = || lock.metadata().unwrap().permissions().mode() & 0o777;
    on_a_runtime(async {
        drop(OwnSocket::open(&place).unwrap());
        assert_eq!(mode(), 0o600);
        std::fs::set_permissions(&lock, std::fs::Permissions::from_mode(0o644)).unwrap();
        drop(OwnSocket::open(&place).unwrap());
        assert_eq!(mode(), 0o600, "one of an earlier version");
    });
}

#[test]
fn the_socket_of_the_dead_is_replaced_and_that_of_the_living_is_not() {
    let place = Dir::new();
    let path = place.join(SOCKET_NAME);
    drop(std::os::unix::net::UnixListener::bind(&path).unwrap());
    assert!(path.symlink_metadata().is_ok(), "nobody has removed it");
    on_a_runtime(async {
        let living = OwnSocket::open(&place).unwrap();
        let refusal = OwnSocket::open(&place).unwrap_err().to_string();
        assert!(
            refusal.contains(&format!("process {}", std::process::id())),
            "{refusal}"
        );
        assert!(
            UnixStream::connect(&path).await.is_ok(),
            "the living one is left alone"
        );
        drop(living);
        OwnSocket::open(&place).unwrap();
    });
}

#[test]
fn what_is_no_socket_is_left_alone() {
    let place = Dir::new();
    std::fs::write(place.join(SOCKET_NAME), "notes").unwrap();
    on_a_runtime(async {
        for (directory, why) in [
            (&*place, "is not a socket"),
            (Path::new("/nonexistent"), "/nonexistent"),
        ] {
            let refusal = OwnSocket::open(directory)
                .unwrap()
                .reachable()
                .refusal()
                .unwrap();
            assert!(
                refusal.contains(why),
                "the gateway runs without it: {refusal}"
            );
        }
    });
    assert_eq!(
        std::fs::read_to_string(place.join(SOCKET_NAME)).unwrap(),
        "notes"
    );
}

#[test]
fn the_broker_is_counted_once_a_connection() {
    let mqtt = MqttTotals::default();
    for connected in [true, true, false, true] {
        let counters = mqtt::MqttCounters {
            messages_in: 5,
            messages_out: 6,
            refused_retained: 7,
            ..Default::default()
        };
        mqtt.set(connected, &counters);
    }
    assert_eq!((mqtt.connects(), mqtt.counters().refused_retained), (2, 7));
    for contested in [true, true, false] {
        mqtt.contested(contested);
        assert_eq!(mqtt.is_contested(), contested);
    }
    assert_eq!(mqtt.takeovers(), 2);
}
