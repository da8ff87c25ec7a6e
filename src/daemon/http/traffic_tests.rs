//! A client that watches a line over HTTP gets its traffic in order, and the number of frames that it has missed.

use super::connections::{self, ConnectionPatience};
use super::routes;
use super::state::HttpState;
use super::tests::on_a_runtime;
use crate::daemon::exchange::shared::{SharedLine, SharedPlant};
use crate::daemon::exchange::totals::ModbusTotals;
use crate::daemon::exchange::traffic::{LISTENERS_MAX, RECORDS_MAX};
use crate::daemon::host::clock;
use crate::domain::ids::{Name, Station};
use crate::domain::link::{Interface, Wiring};
use crate::domain::time::WallTime;
use crate::domain::traffic::{FramePurpose, TrafficKind, TrafficRecord};
use serde_json::Value;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::timeout;

const PATIENCE: Duration = Duration::from_secs(20);
/// Reads 0x0101 of station 5.
const READ: [u8; 8] = [5, 3, 1, 1, 0, 1, 0xD5, 0xB2];

fn line() -> Arc<SharedLine> {
    let wiring = Wiring {
        stations: vec![Station(5)],
        ..Wiring::default()
    };
    Arc::new(
        SharedLine::new(
            0,
            Name::new("hall-1").unwrap(),
            Interface::Rs485,
            [super::tests::description()],
        )
        .wired(wiring),
    )
}

fn state(line: &Arc<SharedLine>) -> Arc<HttpState> {
    Arc::new(HttpState {
        journal: None,
        trends: None,
        gateway: "plant-a".to_owned(),
        shared: Arc::new(SharedPlant::of(vec![Arc::clone(line)], Arc::default())).into(),
        modbus: Arc::new(ModbusTotals::default()),
        mqtt: None.into(),
        sparkplug: None.into(),
        socket: None,
        configuration: None,
        started: clock::now(),
        started_at: WallTime { unix_ms: 0 },
    })
}

async fn serve(state: &Arc<HttpState>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let router = routes::router(routes::RouteDocuments::new(Arc::clone(state)));
    tokio::task::spawn_local(connections::serve(
        listener,
        router,
        ConnectionPatience::default(),
    ));
    address
}

/// A watching client.
struct Watcher {
    stream: TcpStream,
    text: String,
}

impl Watcher {
    async fn new(address: SocketAddr, head: &str) -> Self {
        let mut stream = TcpStream::connect(address).await.unwrap();
        let request =
            format!("GET /api/v1/lines/hall-1/traffic HTTP/1.1\r\nHost: here\r\n{head}\r\n");
        stream.write_all(request.as_bytes()).await.unwrap();
        Self {
            stream,
            text: String::new(),
        }
    }

    /// Reads until `wanted` has arrived.
    async fn until(&mut self, wanted: &str) -> &str {
        let mut bytes = [0; 4096];
        while !self.text.contains(wanted) {
            let read = timeout(PATIENCE, self.stream.read(&mut bytes))
                .await
                .expect(&self.text)
                .unwrap();
            assert!(read > 0, "no {wanted} in {}", self.text);
            self.text += &String::from_utf8_lossy(&bytes[..read]);
        }
        &self.text
    }

    /// The frames so far.
    fn frames(&self) -> Vec<Value> {
        let blocks = self.text.split("event: frame").skip(1);
        let data = blocks.map(|block| {
            block
                .lines()
                .find_map(|line| line.strip_prefix("data: "))
                .unwrap()
        });
        data.map(|data| serde_json::from_str(data).unwrap())
            .collect()
    }
}

fn put(line: &SharedLine, count: usize) {
    let at = clock::now();
    let record = TrafficRecord {
        kind: TrafficKind::Request,
        why: Some(FramePurpose::Poll),
        bytes: READ.to_vec(),
        begin: at,
        end: at + Duration::from_millis(8),
    };
    line.traffic.take_over(&mut vec![record; count]);
}

#[test]
fn frames_come_in_words_with_their_numbers() {
    on_a_runtime(async {
        let line = line();
        let address = serve(&state(&line)).await;
        let mut watcher = Watcher::new(address, "").await;
        let begin = watcher.until("event: begin").await;
        assert!(
            begin.contains("text/event-stream") && begin.contains("retry: 500"),
            "{begin}"
        );
        watcher.until("\"line\":\"hall-1\"").await;
        put(&line, 2);
        watcher.until("id: 0.2").await;
        watcher.until("event: alive").await;
        let frames = watcher.frames();
        assert_eq!(frames.len(), 2);
        assert_eq!(frames[0]["text"], "read 0x0101 output frequency, 1 word");
        assert_eq!(
            (&frames[0]["drive"], &frames[0]["kind"]),
            (&"pump-1".into(), &"request".into())
        );
        assert_eq!(
            (&frames[0]["gap_ms"], &frames[1]["gap_ms"]),
            (&Value::Null, &0.0.into())
        );
        assert_eq!(
            frames[0]["at"].as_str().unwrap().len(),
            "2026-01-31T08:00:00.000000Z".len()
        );
    });
}

#[test]
fn who_comes_back_goes_on_and_is_reported_what_was_lost() {
    on_a_runtime(async {
        let line = line();
        let address = serve(&state(&line)).await;
        Watcher::new(address, "").await.until("event: begin").await;
        put(&line, 3);
        let mut again = Watcher::new(address, "Last-Event-ID: 0.1\r\n").await;
        again.until("id: 0.3").await;
        assert_eq!(
            (again.frames().len(), again.text.contains("event: lost")),
            (2, false)
        );
        let mut of_another = Watcher::new(address, "Last-Event-ID: 7.2\r\n").await;
        of_another.until("id: 0.3").await;
        assert_eq!(of_another.frames().len(), 3);
        put(&line, RECORDS_MAX);
        let mut late = Watcher::new(address, "Last-Event-ID: 0.1\r\n").await;
        late.until("event: lost\ndata: {\"records\":2}").await;
        late.until(&format!("id: 0.{}", RECORDS_MAX + 3)).await;
    });
}

#[test]
fn a_line_has_few_places_and_they_come_back() {
    on_a_runtime(async {
        let line = line();
        let address = serve(&state(&line)).await;
        let mut watchers = Vec::new();
        for _ in 0..LISTENERS_MAX {
            let mut watcher = Watcher::new(address, "").await;
            watcher.until("event: begin").await;
            watchers.push(watcher);
        }
        let mut refused = Watcher::new(address, "").await;
        let text = refused.until("already").await;
        assert!(
            text.starts_with("HTTP/1.1 503")
                && text.contains("{\"error\":\"line hall-1 is already watched by 4"),
            "{text}"
        );
        drop(watchers);
        let deadline = clock::now() + PATIENCE;
        while clock::now() < deadline {
            let mut watcher = Watcher::new(address, "").await;
            if watcher.until("\r\n").await.starts_with("HTTP/1.1 200") {
                return;
            }
        }
        panic!("no place came back");
    });
}

#[test]
fn a_line_that_is_no_more_ends_its_answers_and_is_not_found() {
    on_a_runtime(async {
        let line = line();
        let state = state(&line);
        let address = serve(&state).await;
        let mut watcher = Watcher::new(address, "").await;
        watcher.until("event: begin").await;
        put(&line, 1);
        state
            .shared
            .set(Arc::new(SharedPlant::of(Vec::new(), Arc::default())));
        watcher.until("event: again").await;
        assert_eq!(watcher.frames().len(), 1, "what had come before is sent");
        let mut gone = Watcher::new(address, "").await;
        assert!(
            gone.until("no line is called hall-1")
                .await
                .starts_with("HTTP/1.1 404")
        );
    });
}
