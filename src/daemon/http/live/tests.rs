//! Live documents over real sockets, from a gateway whose lines are played by the test.

use crate::daemon::exchange::shared::SharedPlant;
use crate::daemon::host::clock;
use crate::daemon::http::RouteDocuments;
use crate::daemon::http::connections::{self, ConnectionPatience};
use crate::daemon::http::lasting::LASTING_MAX;
use crate::daemon::http::routes;
use crate::daemon::http::state::HttpState;
use crate::daemon::http::tests::{on_a_runtime, state};
use crate::domain::report::{LineReport, LineState};
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{DriveView, RunState, TripRecord};
use crate::north::titles::{PartTitle, PlantTitles};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

/// Serves `state`, whose live task runs.
async fn serve(state: &Arc<HttpState>, patience: ConnectionPatience) -> SocketAddr {
    serve_documents(RouteDocuments::new(Arc::clone(state)), patience).await
}

async fn serve_documents(documents: RouteDocuments, patience: ConnectionPatience) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::task::spawn_local(super::run(Arc::clone(&documents.live)));
    tokio::task::spawn_local(connections::serve(
        listener,
        routes::router(documents),
        patience,
    ));
    address
}

fn show(state: &HttpState, view: DriveView) {
    state.shared.load().drives[0].view.store(Arc::new(view));
}

fn online(at: MonoTime, hertz: u16) -> DriveView {
    let mut view = DriveView {
        line_is_up: true,
        run_state: RunState::Forward,
        ..DriveView::default()
    };
    view.snapshot.presence = DrivePresence::Online;
    view.snapshot.take(0x0101_u16.into(), &[hertz * 100], at);
    view
}

/// A client that listens to the events.
struct Listening {
    stream: TcpStream,
    text: String,
}

impl Listening {
    /// Connects, and returns the status as well.
    async fn connect(address: SocketAddr) -> (u16, Self) {
        let mut stream = TcpStream::connect(address).await.unwrap();
        stream
            .write_all(b"GET /api/v1/events HTTP/1.1\r\nHost: here\r\n\r\n")
            .await
            .unwrap();
        let mut it = Self {
            stream,
            text: String::new(),
        };
        let head = it.up_to("\r\n\r\n").await.unwrap();
        (head.split(' ').nth(1).unwrap().parse().unwrap(), it)
    }

    /// What arrives up to `end`; `None` if the connection is closed before.
    async fn up_to(&mut self, end: &str) -> Option<String> {
        loop {
            if let Some(at) = self.text.find(end) {
                return Some(self.text.drain(..at + end.len()).collect());
            }
            let mut buffer = vec![0; 64 * 1024];
            let length = self
                .stream
                .read(&mut buffer)
                .await
                .ok()
                .filter(|length| *length > 0)?;
            self.text += std::str::from_utf8(&buffer[..length]).unwrap();
        }
    }

    /// The next event with its data, without the chunk headers of the transfer.
    async fn event(&mut self) -> Option<(String, Value)> {
        let text = self.up_to("\n\n").await?;
        let field = |name: &str| text.lines().find_map(|line| line.strip_prefix(name));
        let data = serde_json::from_str(field("data: ")?).unwrap();
        Some((field("event: ")?.to_owned(), data))
    }

    /// The next event of this kind.
    async fn next(&mut self, kind: &str) -> Value {
        loop {
            let (found, data) = self.event().await.unwrap_or_else(|| panic!("no {kind}"));
            if found == kind {
                return data;
            }
        }
    }
}

#[test]
fn titles_stand_beside_names_and_only_where_there_are_any() {
    on_a_runtime(async {
        let state = state(false);
        let address = serve(&state, ConnectionPatience::default()).await;
        let document = async |path: &str| -> Value {
            serde_json::from_str(&get(address, path).await.1).unwrap()
        };
        for path in ["/api/v1/state", "/api/v1/advice", "/api/v1/health"] {
            let text = document(path).await.to_string();
            assert!(!text.contains("titles"), "{text}");
        }
        let plain = document("/api/v1/advice").await;
        let title = PartTitle::new("قاعة <b>\"1\"").unwrap();
        let titles = PlantTitles {
            lines: BTreeMap::from([("hall-1".to_owned(), title)]),
            ..PlantTitles::default()
        };
        let shared = state.shared.get();
        let same = SharedPlant::of(shared.lines.clone(), Arc::clone(&shared.changed));
        state.shared.set(Arc::new(same.titled(&titles)));
        let expected = json!({ "drives": {}, "gateway": null, "groups": {}, "lines": { "hall-1": "قاعة <b>\"1\"" } });
        for path in ["/api/v1/state", "/api/v1/health"] {
            let found = document(path).await;
            assert_eq!(found["titles"], expected, "{path}");
            assert_eq!(found["lines"][0]["name"], "hall-1");
        }
        let advice = document("/api/v1/advice").await;
        let of_line = |finding: &&Value| finding["line"] == "hall-1" && finding["drive"].is_null();
        let findings = advice["advice"].as_array().unwrap();
        let found: Vec<_> = findings.iter().filter(of_line).collect();
        assert!(!found.is_empty(), "{advice}");
        assert!(
            found
                .iter()
                .all(|it| it["title"] == expected["lines"]["hall-1"])
        );
        assert!(!plain.to_string().contains("title"), "{plain}");
    });
}

#[test]
fn the_state_comes_first_and_then_what_has_changed() {
    on_a_runtime(async {
        let state = state(false);
        show(&state, online(clock::now(), 10));
        let address = serve(&state, ConnectionPatience::default()).await;
        let (status, mut listening) = Listening::connect(address).await;
        assert_eq!(status, 200);
        let (kind, first) = listening.event().await.unwrap();
        assert_eq!(
            (kind.as_str(), &first["drives"][0]["output_frequency_hz"]),
            ("state", &json!(10.0))
        );
        assert_eq!(
            (&first["gateway"]["name"], &first["lines"][0]["state"]),
            (&json!("plant-a"), &json!("down"))
        );
        show(&state, online(clock::now(), 20));
        let update = listening.next("update").await;
        assert_eq!(update["drives"][0]["output_frequency_hz"], 20.0);
        assert!(
            update["at"].is_string()
                && update.get("lines").is_none()
                && update.get("gateway").is_none()
        );
        let report = LineReport {
            state: LineState::Up,
            ..LineReport::default()
        };
        state.shared.load().lines[0].set_report(report);
        let update = listening.next("update").await;
        assert_eq!(
            (&update["lines"][0]["state"], &update["gateway"]["ready"]),
            (&json!("up"), &json!(true))
        );
        assert_eq!(update["advice"], json!([]), "that it was down is over");
        assert!(
            update.get("drives").is_none(),
            "nothing of it has changed: {update}"
        );
    });
}

#[test]
fn a_trip_is_reported_once_to_each_who_listens() {
    on_a_runtime(async {
        let state = state(false);
        show(&state, online(clock::now(), 10));
        let address = serve(&state, ConnectionPatience::default()).await;
        let (_, mut one) = Listening::connect(address).await;
        let (_, mut other) = Listening::connect(address).await;
        one.next("state").await;
        let mut tripped = online(clock::now(), 0);
        let record = TripRecord {
            at: clock::now(),
            code: Some(7),
            words: Vec::new(),
        };
        tripped.trip.active = Some(true);
        tripped.trip.seen = 1;
        tripped.trip.last = Some(record);
        show(&state, tripped.clone());
        for listening in [&mut one, &mut other] {
            let trip = listening.next("trip").await;
            assert_eq!(
                (&trip["drive"], &trip["kind"], &trip["code"]),
                (&json!("pump-1"), &json!("tripped"), &json!(7))
            );
        }
        tripped.trip.active = Some(false);
        show(&state, tripped);
        assert_eq!(one.next("trip").await["kind"], "cleared");
    });
}

#[test]
fn in_silence_there_are_heartbeats() {
    on_a_runtime(async {
        let address = serve(&state(false), ConnectionPatience::default()).await;
        let (_, mut listening) = Listening::connect(address).await;
        assert_eq!(listening.event().await.unwrap().0, "state");
        let first = listening.next("alive").await["moment"].clone();
        let later = async { while listening.next("alive").await["moment"] == first {} };
        tokio::time::timeout(Duration::from_secs(5), later)
            .await
            .expect("another moment");
    });
}

#[test]
fn another_configuration_is_reported_with_its_state() {
    on_a_runtime(async {
        let state = state(false);
        let address = serve(&state, ConnectionPatience::default()).await;
        let (_, mut listening) = Listening::connect(address).await;
        listening.next("state").await;
        listening.next("alive").await;
        // The task must have seen the first one.
        listening.next("alive").await;
        state
            .shared
            .set(Arc::new(SharedPlant::of(Vec::new(), Arc::default())));
        listening.next("configuration").await;
        assert_eq!(listening.event().await.unwrap().1["drives"], json!([]));
    });
}

#[test]
fn there_are_so_many_who_listen_and_others_are_still_served() {
    on_a_runtime(async {
        let address = serve(&state(false), ConnectionPatience::default()).await;
        let mut all = Vec::new();
        for _ in 0..LASTING_MAX {
            let (status, listening) = Listening::connect(address).await;
            assert_eq!(status, 200);
            all.push(listening);
        }
        let (status, _) = Listening::connect(address).await;
        assert_eq!(status, 503);
        let (status, body) = get(address, "/healthz").await;
        assert_eq!((status, body.as_str()), (200, "ok\n"));
        all.pop();
        let again = async {
            while Listening::connect(address).await.0 != 200 {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(5), again)
            .await
            .expect("a place that was left is free");
    });
}

#[test]
fn who_listens_may_stay_longer_than_others() {
    on_a_runtime(async {
        let state = state(false);
        let patience = ConnectionPatience {
            connection: Duration::from_millis(50),
            ..ConnectionPatience::default()
        };
        let address = serve(&state, patience).await;
        let (_, mut listening) = Listening::connect(address).await;
        listening.next("state").await;
        tokio::time::sleep(patience.connection * 4).await;
        show(&state, online(clock::now(), 20));
        assert_eq!(
            listening.next("update").await["drives"][0]["output_frequency_hz"],
            20.0
        );
    });
}

#[test]
fn who_does_not_read_is_let_go_and_the_others_go_on() {
    on_a_runtime(async {
        let documents = RouteDocuments::new(state(false));
        let address = serve_documents(documents.clone(), ConnectionPatience::default()).await;
        let (_, mut slow) = Listening::connect(address).await;
        let (_, mut good) = Listening::connect(address).await;
        good.next("state").await;
        // More than all buffers in between hold.
        let text = super::events::event("update", &format!("\"{}\"", "x".repeat(2 << 20)));
        for _ in 0..100 {
            documents.live.lock().listeners.tell(text.clone());
            good.next("update").await;
            if documents.live.lock().listeners.count() == 1 {
                break;
            }
        }
        assert_eq!(documents.live.lock().listeners.count(), 1);
        good.next("alive").await;
        while let Some(_event) = slow.event().await {}
    });
}

async fn get(address: SocketAddr, path: &str) -> (u16, String) {
    crate::daemon::http::tests::answer(TcpStream::connect(address).await.unwrap(), "GET", path, "")
        .await
}

#[test]
fn documents_are_found_and_mistakes_are_named() {
    on_a_runtime(async {
        let state = state(true);
        show(&state, online(clock::now(), 10));
        let address = serve(&state, ConnectionPatience::default()).await;
        let of = async |path: &str| {
            let (status, body) = get(address, path).await;
            (status, serde_json::from_str::<Value>(&body).unwrap())
        };
        let (status, trend) = of("/api/v1/trend?drive=pump-1").await;
        assert_eq!((status, &trend["values"][0]), (200, &json!([10.0])));
        assert_eq!(of("/api/v1/trend?drive=pump-1&span=10m").await.1, trend);
        let (status, advice) = of("/api/v1/advice").await;
        assert_eq!(status, 200);
        assert!(
            advice["advice"][0]["text"]
                .as_str()
                .unwrap()
                .contains("the broker cannot be reached"),
            "{advice}"
        );
        assert_eq!(of("/api/v1/state").await.1["drives"][0]["name"], "pump-1");
        for (path, status, part) in [
            ("/api/v1/trend", 400, "there are pump-1"),
            ("/api/v1/trend?drive=pump-2", 404, "there are pump-1"),
            ("/api/v1/trend?name=pump-1", 400, "expected drive"),
            ("/api/v1/trend?drive=pump-1&span=24h", 404, "`data_dir`"),
            (
                "/api/v1/trend?drive=pump-1&values=output_current",
                404,
                "`data_dir`",
            ),
            (
                "/api/v1/trend?drive=pump-1&span=1y",
                400,
                "expected 10m, 1h, 24h, 7d, 30d",
            ),
            (
                "/api/v1/trend?drive=pump-1&span=10m&format=csv",
                400,
                "neither",
            ),
            (
                "/api/v1/trend?drive=pump-1&format=xml",
                400,
                "expected json, rows or csv",
            ),
            ("/api/v1/journal", 404, "`data_dir`"),
            ("/api/v1/journal?table=trip", 400, "expected trips"),
            ("/api/v1/journal?since=yesterday", 400, "12h"),
            ("/api/v1/journal?last=10001", 400, "from 1 to 10000"),
            ("/api/v1/journal?format=xml", 400, "expected json or csv"),
        ] {
            let (found, body) = of(path).await;
            assert_eq!(found, status, "{path}");
            assert!(
                body["error"].as_str().unwrap().contains(part),
                "{path}: {body}"
            );
        }
    });
}
