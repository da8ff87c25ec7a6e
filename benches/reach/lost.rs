//! The broker is killed under a running drive: how long until the fail-safe.

use crate::bare_mqtt::Talker;
use crate::brokers::Broker;
use crate::plant::{Gateway, RUN, Setup};
use crate::table::{Row, Times};
use crate::tapped::TappedLine;
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::sim::BusOptions;

/// `lost_after` of [`Setup`], in ms.
const LEASE_MS: f64 = 3000.0;
const PATIENCE: Duration = Duration::from_secs(10);

pub fn lost() -> Vec<Row> {
    let rounds = if crate::is_quick() { 2 } else { 10 };
    let spans: Vec<Option<Duration>> = (0..rounds).map(round).collect();
    let times = Times::new(spans.iter().copied().flatten());
    vec![
        Row::told(
            "lost: broker killed until fail-safe frame, min / p50 / max, ms",
            {
                format!(
                    "{:.0} / {:.0} / {:.0}",
                    times.at(0.0),
                    times.at(0.5),
                    times.at(1.0)
                )
            },
        ),
        Row::at_most(
            "lost: longest, against the lease and 0.5 s, ms",
            LEASE_MS + 500.0,
            times.at(1.0),
        ),
        Row::all(
            "lost: rounds with a fail-safe",
            rounds as usize,
            times.len(),
        ),
    ]
}

/// Everything starts again, so that no round waits for a gateway that has backed off.
fn round(n: u64) -> Option<Duration> {
    let mut broker = Broker::start(false);
    let line = TappedLine::start(1, BusOptions::default());
    let mqtt = Some((broker.port, if n.is_multiple_of(2) { 5 } else { 4 }));
    let gateway = Gateway::start(&Setup {
        device: line.path(),
        drives: 1,
        unpaced: false,
        poll: "250ms",
        mqtt,
        listen: 0,
    });
    let mut talker = Talker::connect(broker.port, "bench-lost", &[]).expect("the broker accepts");
    let mut runs = false;
    for _ in 0..50 {
        let command = br#"{"run":"forward","frequency_hz":30}"#;
        talker
            .publish("vfd/bench/drive/d1/command", command, false)
            .expect("published");
        runs = line
            .wait_for(
                Duration::from_millis(200),
                |heard| heard.is_write(RUN, 1),
                drop,
            )
            .is_some();
        if runs {
            break;
        }
    }
    assert!(runs, "no command gets through");
    // Long enough that only the probes keep the lease, and at any moment between two of them.
    std::thread::sleep(Duration::from_millis(3500 + n * 100));
    line.forget();
    let killed = clock::now();
    broker.kill();
    let stop = line.wait_for(PATIENCE, |heard| heard.is_write(RUN, 0), drop);
    gateway.stop();
    line.stop();
    stop.map(|stop| stop.at.since(killed))
}
