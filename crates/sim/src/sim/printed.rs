//! Every frame pair printed in vendors' documents, or derived from their rules, tested against a drive: the request in,
//! the response out. If the response shows a value, the drive is first brought into that state.

use super::testing::*;
use super::*;
use crate::domain::command::Direction;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, RefusedWrite, RegisterRole};
use crate::wire::{pdu, rtu};
use serde_json::Value;
use std::sync::Arc;

const FILES: [&str; 3] = [
    include_str!("../../../../tests/data/hyundai-frames.json"),
    include_str!("../../../../tests/data/teco-frecon-frames.json"),
    include_str!("../../../../tests/data/toshiba-frames.json"),
];

/// The model for the frames printed for a drive. Two siblings print the frames of the E510, too.
fn model_of(drive: &str) -> Option<&'static str> {
    Some(match drive {
        "n700" => "hyundai-n700",
        "n100plus" => "hyundai-n100plus",
        "TECO E510" | "TECO F510" | "TECO A510s" => "teco-e510",
        "TECO E510s" => "teco-e510s",
        "Frecon FR500A" => "frecon-fr500a",
        "Toshiba VF-AS1" => "toshiba-vf-as1",
        "Toshiba VF-S15" => "toshiba-vf-s15",
        _ => return None,
    })
}

/// Pairs that no drive of these models can produce, with the beginning of the response and the reason.
const NOT_PLAYED: [(&str, &str, &str, &str); 17] = [
    (
        "n700",
        "compact column of the F008 write",
        "0106",
        "the register is not in the model",
    ),
    (
        "TECO E510s",
        "08H error reply",
        "0188",
        "why a loop test fails is not documented",
    ),
    (
        "TECO E510s",
        "08H error reply, corrected",
        "0188",
        "why a loop test fails is not documented",
    ),
    (
        "TECO E510",
        "08H error reply",
        "0188",
        "why a loop test fails is not documented",
    ),
    (
        "TECO E510",
        "03H exception 52H (address)",
        "0183",
        "the request shown is a right one",
    ),
    (
        "TECO E510s",
        "03H exception 04",
        "0183",
        "the request shown is a right one",
    ),
    (
        "TECO E510",
        "06H exception 52H",
        "0186",
        "the model has the register",
    ),
    (
        "TECO E510",
        "06H exception 51H",
        "0186",
        "the drive serves the function",
    ),
    (
        "TECO E510",
        "10H exception 52H",
        "0190",
        "the request shown is a right one",
    ),
    ("TECO EV", "10H run", "0110", "another drive"),
    (
        "Frecon FR500A",
        "06H EEPROM write F01.02",
        "0106",
        "the register is not in the model",
    ),
    (
        "Frecon FR500A",
        "06H RAM write F01.02",
        "0106",
        "the register is not in the model",
    ),
    (
        "Toshiba VF-S15",
        "Indirect block write 0x1870",
        "0110",
        "indirect blocks are not played",
    ),
    (
        "Toshiba VF-S15",
        "Indirect block write while busy",
        "0190",
        "indirect blocks are not played",
    ),
    (
        "Toshiba VF-S15",
        "Indirect block read 0x1875",
        "0103",
        "indirect blocks are not played",
    ),
    (
        "Toshiba VF-S15",
        "Indirect block read, 2 words",
        "0103",
        "indirect blocks are not played",
    ),
    (
        "Toshiba VF-S15",
        "Read device identification",
        "012B",
        "the function is not played",
    ),
];

/// Brings `drive` into the state in which `request` is answered by `response`; both are PDUs.
fn prepare(drive: &mut SimDrive, request: &[u8], response: &[u8]) {
    let address = u16::from_be_bytes([request[1], request[2]]);
    let shown = pdu::words(response.get(2..).unwrap_or_default());
    let first = shown.first().copied().unwrap_or_default();
    let mut write = |address: u16, value: u16| {
        let mut request = vec![6];
        pdu::put_words(&mut request, &[address, value]);
        assert!(drive.answer(seconds(0), &request, 0, &mut Vec::new()));
    };
    match (request[0], address, response[0]) {
        (3, 0x0101, 3) => {
            write(0x0004, first);
            write(0x0002, u16::from(first > 0));
        }
        (3, 0x0201, 3) => write(0x0004, first),
        (3, 0x0202 | 0x020C, 3) => write(address, first),
        (3, 0x2523, 3) => write(0x2502, first),
        (3, 0x2520, 3) => {
            write(0x2502, shown[3]);
            write(0x2501, 1);
        }
        (3, 0x0C10, 3) => drive.set_locally(seconds(0), 0x0C10_u16.into(), first),
        // The frequency comes from somewhere else: 00-05.
        (6, 0x2502, 0x86) => drive.set_locally(seconds(0), 0x0005_u16.into(), 0),
        (3, 0x3000 | 0x2100, 3) => {
            write(0x2001, 5000);
            write(0x2000, 1);
        }
        (3, 0x3100 | 0xFC90, 3) => drive.trip(seconds(50), first),
        (3, 0xFD00 | 0xFD01 | 0xFD03, 3) | (6, 0x0011, 0x86) => {
            // 0.33 and 0.67 times 31.29 of 60 Hz is 67.94 %.
            write(0xFA01, if address == 0xFD03 { 3129 } else { 6000 });
            write(0xFA00, 0xC400);
            // Bit 13 stands for a terminal that no flag names.
            drive.set_locally(seconds(0), 0xFD01_u16.into(), 0x2000);
        }
        (3 | 6, _, 0x83 | 0x86) | (6 | 8 | 16, ..) => {}
        other => panic!("no state is known for {other:02X?}"),
    }
}

fn options(drive: &str, address: u16) -> DriveOptions {
    if (drive, address) != ("TECO E510", 0x2520) {
        return DriveOptions::default();
    }
    // 50 Hz, 400.0 V, 560 V and 4.5 A at full speed.
    DriveOptions {
        max_frequency_hz: 50,
        rated_current_x10: 45,
        dc_link_v: 580,
        ..DriveOptions::default()
    }
}

/// Station and PDU of a frame as written in the collections: RTU in hexadecimal, or ASCII.
fn decoded(frame: &str) -> (u8, Vec<u8>) {
    let frame = frame.trim();
    if let Some(text) = frame.strip_prefix(':') {
        let bytes = from_hex(text);
        let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        assert_eq!(sum, 0, "{frame}");
        return (bytes[0], bytes[1..bytes.len() - 1].to_vec());
    }
    let bytes = from_hex(&frame.replace(' ', ""));
    let (station, pdu) = rtu::decode(&bytes).expect(frame);
    (station, pdu.to_vec())
}

fn text<'a>(pair: &'a Value, key: &str) -> &'a str {
    pair[key].as_str().unwrap_or_default()
}

fn is_valid(pair: &Value) -> bool {
    pair["valid_crc"]
        .as_bool()
        .or(pair["valid_check"].as_bool())
        .unwrap()
}

fn pairs() -> Vec<Value> {
    let all = FILES.map(|file| serde_json::from_str::<Vec<Value>>(file).unwrap());
    all.into_iter()
        .flatten()
        .filter(|pair| is_valid(pair) && pair["response"].is_string())
        .collect()
}

#[test]
fn every_pair_that_a_drive_can_be_brought_to_is_played() {
    let mut played = 0;
    let mut unused: Vec<_> = NOT_PLAYED.to_vec();
    for pair in pairs() {
        let drive = text(&pair, "drive");
        let what = text(&pair, "what");
        let response_hex = text(&pair, "response").replace([' ', ':'], "");
        let is_this = |it: &(&str, &str, &str, &str)| {
            it.0 == drive && what.starts_with(it.1) && response_hex.starts_with(it.2)
        };
        if NOT_PLAYED.iter().any(is_this) {
            unused.retain(|it| !is_this(it));
            continue;
        }
        let ((station, request), (_, response)) = (
            decoded(text(&pair, "request")),
            decoded(text(&pair, "response")),
        );
        assert_eq!(station, 1);
        let address = u16::from_be_bytes([request[1], request[2]]);
        let id = model_of(drive).unwrap_or_else(|| panic!("no model is known for {drive}"));
        let mut sim = SimDrive::new(model(id), options(drive, address));
        prepare(&mut sim, &request, &response);
        let mut found = Vec::new();
        assert!(
            sim.answer(seconds(60), &request, 0, &mut found),
            "{drive}: {what}"
        );
        assert_eq!(found, response, "{drive}: {what}: {found:02X?}");
        played += 1;
    }
    assert_eq!(unused, [], "named in vain");
    assert_eq!(played, PLAYED);
}

/// Number of tested pairs in all three collections.
const PLAYED: usize = 84;

#[test]
fn printed_broadcasts_stop_every_drive_and_none_answers() {
    for (drive, setpoint, run) in [
        ("Frecon FR500A", (0x2001, 6000), (0x2000, 1)),
        ("Toshiba VF-AS1", (0xFA01, 6000), (0xFA00, 0xC400)),
    ] {
        let all = FILES.map(|file| serde_json::from_str::<Vec<Value>>(file).unwrap());
        let is_it =
            |pair: &Value| text(pair, "drive") == drive && text(pair, "request").starts_with("00 ");
        let printed = all.into_iter().flatten().find(is_it).unwrap();
        let model = model(model_of(drive).unwrap());
        let mut bus = SimBus::new(model.link.played(), UNPACED, 0);
        for station in [1, 2] {
            bus.connect(
                Station(station),
                SimDrive::new(model.clone(), DriveOptions::default()),
            );
            for (address, value) in [setpoint, run] {
                bus.receive(seconds(0), &frame(station, 6, address, value));
            }
        }
        taken(&mut bus, seconds(20));
        assert!(
            [1, 2]
                .iter()
                .all(|it| bus.drive(Station(*it)).unwrap().output(seconds(20)) == 60_000_000)
        );
        bus.receive(
            seconds(20),
            &from_hex(&text(&printed, "request").replace(' ', "")),
        );
        assert_eq!(taken(&mut bus, seconds(40)), [0; 0]);
        assert!(
            [1, 2]
                .iter()
                .all(|it| bus.drive(Station(*it)).unwrap().output(seconds(40)) == 0)
        );
    }
}

#[test]
fn a_drive_of_each_model_is_read_in_full_and_runs_and_stops() {
    let may_be_old = |model: &Model| model.write.refused.value == RefusedWrite::EchoMayBeOld;
    // The walk of the scenarios is for all models; here each order is one word by function 06.
    let is_plain = |model: &&Arc<Model>| {
        let setpoint = model.register_for(RegisterRole::FrequencyCommand);
        let is_plain = setpoint
            .is_some_and(|it| it.scale == 100 && it.form.is_plain() && it.access.can_write());
        let run = model
            .run
            .as_ref()
            .filter(|_| is_plain && model.serves(6) && !may_be_old(model));
        run.is_some_and(|run| {
            run.reverse.is_some() && run.start.steps.is_empty() && run.places == Default::default()
        })
    };
    for model in crate::vendors::catalog().models().filter(is_plain) {
        let id = &model.id;
        let mut drive = SimDrive::new(model.clone(), DriveOptions::default());
        for register in model.registers.iter().filter(|it| it.access.can_read()) {
            let mut request = vec![3];
            pdu::put_words(&mut request, &[register.address.number(), 1]);
            let mut reply = Vec::new();
            assert!(
                drive.answer(MonoTime::ZERO, &request, 0, &mut reply),
                "{id} {}",
                register.name
            );
            assert_eq!(reply[..2], [3, 2], "{id} {}", register.name);
        }
        let run = model.run.as_ref().unwrap();
        let reverse = run.reverse.as_ref().unwrap().value;
        let roles = [
            (RegisterRole::FrequencyCommand, 3000),
            (crate::profile::model::RegisterRole::RunCommand, reverse),
        ];
        for (role, value) in roles {
            let mut request = vec![6];
            pdu::put_words(
                &mut request,
                &[model.register_for(role).unwrap().address.number(), value],
            );
            let mut reply = Vec::new();
            assert!(drive.answer(MonoTime::ZERO, &request, 0, &mut reply));
            assert_eq!(reply, request, "{id}");
        }
        assert_eq!(drive.output(seconds(30)), -30_000_000, "{id}");
        drive.operate_panel(seconds(30), Some(Direction::Forward));
        assert_eq!(
            drive.output(seconds(60)),
            -30_000_000,
            "{id}: the bus commands"
        );
    }
}
