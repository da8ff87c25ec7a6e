//! A listener of a line sees all its traffic, in order, and changes nothing.

use crate::support::{MQTT, Rig, RigOptions, STOP};
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::domain::traffic::{FramePurpose, TrafficKind};
use vfd_gateway::sim::BusOptions;

/// Drives that are polled, read and stopped on a line on which everything goes wrong at times, watched or not.
fn a_busy_minute(seed: u64, tells_traffic: bool) -> Rig {
    let faults = "noise=80,lost=20,late=20,cut=20,flip=20,foreign=30"
        .parse()
        .expect("a plan");
    let bus = BusOptions {
        faults,
        ..BusOptions::default()
    };
    let mut rig = Rig::new(&RigOptions {
        drives: 3,
        bus,
        seed,
        tells_traffic,
        ..RigOptions::controlled()
    });
    let begun = rig.now;
    for second in 0..60_u16 {
        rig.read(1, second % 3, 0x0101 + second, 1);
        rig.read(2, second % 2, 0x0201, 2);
        if second % 10 == 9 {
            rig.command(MQTT, second % 3, STOP);
        }
        while rig.step(begun + Duration::from_secs(u64::from(second) + 1)) {}
    }
    rig
}

#[test]
fn a_line_that_is_watched_does_the_same_at_the_same_moments() {
    for seed in 0..4 {
        let watched = a_busy_minute(seed, true);
        let alone = a_busy_minute(seed, false);
        let sent = |rig: &Rig| {
            rig.sent
                .iter()
                .map(|sent| (sent.at, sent.frame.clone()))
                .collect::<Vec<_>>()
        };
        assert!(sent(&watched).len() > 500);
        assert_eq!(sent(&watched), sent(&alone), "{seed}");
        assert_eq!(watched.answers, alone.answers, "{seed}");
        assert_eq!(watched.core.counters(), alone.core.counters(), "{seed}");
        assert_eq!(alone.traffic, []);
    }
}

#[test]
fn all_that_goes_over_the_wire_is_reported_once_and_in_order() {
    let rig = a_busy_minute(1, true);
    let of =
        |kind: fn(TrafficKind) -> bool| rig.traffic.iter().filter(move |record| kind(record.kind));
    let requests: Vec<_> = of(|kind| kind == TrafficKind::Request).collect();
    assert_eq!(requests.len(), rig.sent.len());
    for (told, sent) in requests.iter().zip(&rig.sent) {
        assert_eq!((&told.bytes, told.at()), (&sent.frame, sent.at));
        assert_eq!(
            told.end,
            sent.at + rig.setup.timing.on_wire(sent.frame.len())
        );
    }
    // From the beginning of the scenario on; earlier counts were reported before.
    let noise: usize = of(|kind| kind == TrafficKind::Noise)
        .map(|record| record.bytes.len())
        .sum();
    assert_eq!(noise as u64, rig.core.counters().noise_bytes);
    let strays = of(|kind| matches!(kind, TrafficKind::Stray(_))).count();
    assert_eq!(strays as u64, rig.core.counters().strays);
    assert!(
        noise > 0 && strays > 0 && of(|kind| matches!(kind, TrafficKind::Foreign(_))).count() > 0
    );
    let mut last = MonoTime::ZERO;
    for record in &rig.traffic {
        assert!(
            record.begin <= record.end && record.at() >= last,
            "{record:?} behind {last:?}"
        );
        last = record.at();
    }
    let whys: Vec<_> = requests.iter().filter_map(|record| record.why).collect();
    assert_eq!(whys.len(), requests.len());
    for why in [
        FramePurpose::Client,
        FramePurpose::Poll,
        FramePurpose::Stop,
        FramePurpose::Command,
    ] {
        assert!(whys.contains(&why), "{why:?}");
    }
}

#[test]
fn who_comes_in_the_middle_sees_what_follows() {
    let mut rig = Rig::new(&RigOptions::default());
    let silent = rig.read(1, 0, 0x0101, 1);
    rig.answer_to(silent);
    assert_eq!(rig.traffic, []);
    rig.core.tell_traffic(true);
    let watched = rig.read(1, 0, 0x0101, 1);
    rig.answer_to(watched);
    let kinds: Vec<_> = rig.traffic.drain(..).map(|record| record.kind).collect();
    assert_eq!(kinds, [TrafficKind::Request, TrafficKind::Reply]);
    rig.core.tell_traffic(false);
    let silent = rig.read(1, 0, 0x0101, 1);
    rig.answer_to(silent);
    assert_eq!(rig.traffic, []);
}
