//! The traffic of the wire, as a drive engineer reads it. `UPDATE_GOLDEN=1` rewrites the texts.

use crate::support::{Rig, RigOptions};
use std::fmt::Write;
use std::time::Duration;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::domain::traffic::TrafficKind;
use vfd_gateway::sim::FaultPlan;
use vfd_gateway::wire::pdu::{self, Request};

const OUTPUT_FREQUENCY: u16 = 0x0101;
const FREQUENCY_SETTING: u16 = 0x0201;

fn rig(drives: u8) -> Rig {
    Rig::new(&RigOptions {
        drives,
        tells_traffic: true,
        ..RigOptions::default()
    })
}

/// Everything since `begun`, in the order in which it happened.
fn told(rig: &Rig, begun: MonoTime) -> String {
    let mut lines: Vec<(MonoTime, String)> = Vec::new();
    for record in &rig.traffic {
        let bytes = record
            .bytes
            .iter()
            .map(|byte| format!("{byte:02X}"))
            .collect::<Vec<_>>()
            .join(" ");
        let (arrow, what) = match record.kind {
            TrafficKind::Request => ("->", meaning(&record.bytes)),
            TrafficKind::Reply => ("<-", "the reply".to_owned()),
            TrafficKind::Stray(station) => {
                ("<-", format!("stray: station {station}, not the answer"))
            }
            TrafficKind::Foreign(station) => {
                ("<-", format!("foreign: station {station} was not asked"))
            }
            TrafficKind::Echo => ("<--", "echo".to_owned()),
            TrafficKind::OtherMaster(station) => {
                ("<--", format!("request of somebody else to {}", station.0))
            }
            TrafficKind::Noise => ("<-", "noise".to_owned()),
        };
        lines.push((record.at(), format!("{arrow} {bytes:<30} {what}")));
    }
    for (at, answer) in &rig.answers {
        let outcome = match &answer.outcome {
            NativeOutcome::Words(words) => format!("{words:?}"),
            other => format!("{other:?}"),
        };
        lines.push((*at, format!("   client {} gets {outcome}", answer.asker.0)));
    }
    lines.sort_by_key(|(at, _)| *at);
    let mut text = String::new();
    for (at, line) in lines {
        let _ = writeln!(
            text,
            "{:>9.3} ms {line}",
            at.since(begun).as_secs_f64() * 1e3
        );
    }
    text
}

fn meaning(frame: &[u8]) -> String {
    match Request::decode(&frame[1..frame.len() - 2]) {
        Some(Request::Read { address, count }) => {
            format!("station {}: read {address} x{count}", frame[0])
        }
        other => format!("{other:?}"),
    }
}

/// Where the texts are.
pub const GOLDEN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/conversations");

/// Compares `text` with the one that is kept under this name.
pub fn compare(name: &str, text: &str) {
    let path = format!("{GOLDEN}/{name}.txt");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, text).expect("the golden text can be written");
    }
    let golden = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(text, golden, "{path}");
}

#[test]
fn three_clients_ask_and_two_share() {
    let mut rig = rig(2);
    let begun = rig.now;
    rig.read(1, 0, OUTPUT_FREQUENCY, 1);
    rig.read(1, 1, FREQUENCY_SETTING, 1);
    rig.read(2, 0, 0x0211, 2);
    rig.read(3, 1, FREQUENCY_SETTING, 1);
    rig.ask(
        3,
        0,
        NativeAsk::Write {
            address: 0x0002_u16.into(),
            values: vec![1],
        },
    );
    while rig.step(begun + Duration::from_secs(1)) {}
    compare("sharing", &told(&rig, begun));
}

#[test]
fn a_reply_stays_out_and_a_barrier_settles_it() {
    let mut rig = rig(1);
    let begun = rig.now;
    rig.bus.set_faults(FaultPlan {
        lost: 1000,
        ..FaultPlan::NONE
    });
    rig.read(1, 0, OUTPUT_FREQUENCY, 1);
    rig.bus.set_faults(FaultPlan::NONE);
    rig.read(2, 0, FREQUENCY_SETTING, 1);
    while rig.step(begun + Duration::from_secs(1)) {}
    compare("barrier", &told(&rig, begun));
}

#[test]
fn a_reply_comes_late_and_answers_nobody() {
    let mut rig = rig(2);
    let begun = rig.now;
    rig.bus.set_faults(FaultPlan {
        late: 1000,
        max_lateness: Duration::from_millis(60),
        ..FaultPlan::NONE
    });
    rig.read(1, 0, OUTPUT_FREQUENCY, 1);
    rig.bus.set_faults(FaultPlan::NONE);
    while rig.step(begun + Duration::from_secs(1)) {}
    rig.read(1, 0, OUTPUT_FREQUENCY, 1);
    while rig.step(begun + Duration::from_secs(2)) {}
    compare("late_reply", &told(&rig, begun));
}

#[test]
fn a_drive_dies_and_comes_back() {
    let mut rig = rig(1);
    let begun = rig.now;
    rig.bus.set_powered(rig.now, Station(1), false);
    for second in 0..12 {
        if second == 6 {
            rig.bus.set_powered(rig.now, Station(1), true);
        }
        rig.read(1, 0, OUTPUT_FREQUENCY, 1);
        while rig.step(begun + Duration::from_secs(second + 1)) {}
    }
    compare("dead_drive", &told(&rig, begun));
}

#[test]
fn the_bytes_of_a_conversation_are_those_of_the_manual() {
    let mut rig = rig(1);
    rig.read(1, 0, OUTPUT_FREQUENCY, 1);
    let ticket = rig.read(1, 0, FREQUENCY_SETTING, 1);
    rig.answer_to(ticket);
    // Interface manual, D001 and F001 read requests.
    assert_eq!(
        rig.sent[0].frame,
        [0x01, 0x03, 0x01, 0x01, 0x00, 0x01, 0xD4, 0x36]
    );
    assert_eq!(
        rig.sent[1].frame,
        [0x01, 0x03, 0x02, 0x01, 0x00, 0x01, 0xD4, 0x72]
    );
    assert_eq!(pdu::words(&rig.traffic[1].bytes[3..5]), [0]);
}
