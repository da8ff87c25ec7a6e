//! Thirty-two drives of twenty metrics each, all of which change once a second: whether a Sparkplug host receives every
//! change, with every number in sequence, and what that costs.

use crate::bare_mqtt::Talker;
use crate::brokers::Broker;
use crate::plant::Place;
use crate::table::Row;
use crate::telemetry::{
    Answered, DRIVES, LINES, POINTS, lines_text, per_cent, start_gateway, start_line, thread_ticks,
    ticks,
};
use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use vfd_gateway::north::sparkplug::payload::{PayloadValue, SparkplugPayload};

const POLL: Duration = Duration::from_secs(1);
const WARM_UP: Duration = Duration::from_secs(5);

/// What the host received during the measurement.
#[derive(Default)]
struct Seen {
    messages: u64,
    changes: u64,
    bytes: u64,
    /// Sequence numbers that did not follow the last.
    gaps: u64,
    next: Option<u64>,
    /// Aliases of the points.
    points: HashSet<u64>,
}

impl Seen {
    fn take(&mut self, topic: &str, bytes: &[u8]) {
        let Some(kind) = topic
            .split('/')
            .nth(2)
            .filter(|kind| kind.ends_with("BIRTH") || kind.ends_with("DATA"))
        else {
            return;
        };
        // A birth is larger than a command may be.
        let payload = SparkplugPayload::parse(bytes).expect("a payload");
        let number = payload.seq.expect("a number");
        self.gaps += u64::from(kind != "NBIRTH" && self.next.is_some_and(|next| next != number));
        self.next = Some((number + 1) % 256);
        let is_birth = kind.ends_with("BIRTH");
        for metric in &payload.metrics {
            let is_point = metric
                .name
                .as_deref()
                .is_some_and(|name| name.starts_with("measure/v"));
            if let Some(alias) = metric.alias.filter(|_| is_birth && is_point) {
                self.points.insert(alias);
            }
            let is_change = metric
                .alias
                .is_some_and(|alias| self.points.contains(&alias))
                && !is_birth;
            self.changes +=
                u64::from(is_change && matches!(metric.value, Some(PayloadValue::Double(_))));
        }
        self.messages += 1;
        self.bytes += bytes.len() as u64;
    }

    /// Resets the counts, and keeps what was born.
    fn restart(&mut self) {
        self.messages = 0;
        self.changes = 0;
        self.bytes = 0;
    }
}

pub fn sparkplug() -> Vec<Row> {
    let look = Duration::from_secs(if crate::is_quick() { 10 } else { 60 });
    let answered = Arc::new(Answered::new());
    let end = Arc::new(AtomicBool::new(false));
    let lines: Vec<_> = (0..LINES)
        .map(|line| start_line(line, &answered, &end))
        .collect();
    let ports: Vec<_> = lines.iter().map(|(port, _)| port.clone()).collect();
    let broker = Broker::start(false);
    let place = Place::new();
    let mut host = Talker::connect(broker.port, "bench-host", &["spBv1.0/#"]).expect("it accepts");
    let mut gateway = start_gateway(&place, &configuration(&ports, broker.port, &place));
    let mut seen = Seen::default();
    watch(&mut host, &mut seen, WARM_UP);
    seen.restart();
    let before = ticks(gateway.id());
    let threads = thread_ticks(gateway.id());
    let begun = Instant::now();
    watch(&mut host, &mut seen, look);
    let took = begun.elapsed();
    let used = ticks(gateway.id()) - before;
    let of_lines = thread_ticks(gateway.id()) - threads;
    gateway.kill().expect("killed");
    gateway.wait().expect("collected");
    end.store(true, Ordering::Relaxed);
    lines
        .into_iter()
        .for_each(|(_, line)| line.join().expect("a line ends"));
    rows(&seen, took, used, of_lines, broker.name())
}

fn rows(seen: &Seen, took: Duration, used: f64, of_lines: f64, broker: &str) -> Vec<Row> {
    let points = LINES as f64 * f64::from(DRIVES) * f64::from(POINTS);
    let expected = points * took.as_secs_f64() / POLL.as_secs_f64();
    let a_second = |count: u64| count as f64 / took.as_secs_f64();
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    vec![
        Row::told(
            "sparkplug: drives, metrics of each, change, broker",
            format!("32, {POINTS}, {POLL:?}, {broker}"),
        ),
        Row::at_least(
            "sparkplug: changes that came, of all that there were",
            0.98,
            seen.changes as f64 / expected,
        ),
        Row::at_most(
            "sparkplug: numbers that were missing or out of order",
            0.0,
            seen.gaps as f64,
        ),
        Row::told(
            "sparkplug: messages / changes / kB a second",
            format!(
                "{:.0} / {:.0} / {:.0}",
                a_second(seen.messages),
                a_second(seen.changes),
                a_second(seen.bytes) / 1e3
            ),
        ),
        Row::at_most(
            "sparkplug: CPU of the gateway beside its lines, % of a core",
            5.0,
            per_cent(used - of_lines, took),
        ),
        Row::told(
            "sparkplug: that of its lines, % of a core",
            format!("{:.1}", per_cent(of_lines, took)),
        ),
        Row::told("sparkplug: load of the machine", load.trim().to_owned()),
    ]
}

/// Receives for `span`.
fn watch(host: &mut Talker, seen: &mut Seen, span: Duration) {
    let until = Instant::now() + span;
    while let Some(message) = host
        .next(until.saturating_duration_since(Instant::now()))
        .expect("it is there")
    {
        seen.take(&message.topic, &message.payload);
    }
}

fn configuration(ports: &[PathBuf], broker: u16, place: &Place) -> String {
    let head = format!(
        "[gateway]\nname = \"bench\"\ndata_dir = \"{}\"\n",
        place.path().display()
    );
    let mut text = lines_text(&head, ports, POLL);
    // The gateway's own topics are not what is measured.
    let _ = write!(
        text,
        "[mqtt]\nbroker = \"mqtt://127.0.0.1:{broker}\"\npublish = [\"info\"]\n"
    );
    text + "[mqtt.sparkplug]\ngroup = \"bench\"\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n"
}
