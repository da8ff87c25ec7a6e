//! Every known frame of the drives, in words, and the text of malformed frames.

use super::*;
use crate::domain::ids::Name;
use crate::domain::link::Framing;
use crate::drive::description::DriveRatings;
use crate::profile::catalog::Catalog;
use crate::vendors;
use crate::wire::{mbap, rtu};
use serde_json::Value;
use std::fmt::Write;
use std::sync::Arc;

fn catalog() -> Catalog {
    vendors::catalog()
}

fn drive(model: &str, station: u8) -> KnownDrive {
    KnownDrive {
        station: Station(station),
        name: Name::new(&format!("drive-{station}")).unwrap(),
        model: Arc::clone(catalog().find(model).unwrap()),
        ratings: DriveRatings {
            current_ma: Some(10_000),
            voltage_mv: Some(400_000),
        },
    }
}

fn decoder(framing: Framing, drives: Vec<KnownDrive>) -> TrafficDecoder {
    TrafficDecoder::new(LineFacts { framing, drives })
}

/// An N700 at station 1 and another at station 2.
fn hall() -> TrafficDecoder {
    decoder(
        Framing::Rtu,
        vec![drive("hyundai-n700", 1), drive("hyundai-n700", 2)],
    )
}

fn record(kind: TrafficKind, bytes: &[u8]) -> TrafficRecord {
    let why = (kind == TrafficKind::Request).then_some(FramePurpose::Poll);
    TrafficRecord {
        kind,
        why,
        bytes: bytes.to_vec(),
        begin: MonoTime::ZERO,
        end: MonoTime::ZERO,
    }
}

fn frame(station: u8, pdu: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    rtu::encode(&mut out, station, |adu| adu.extend_from_slice(pdu));
    out
}

/// The decoder's text for a request and for what comes back as `kind`.
fn exchange(
    decoder: &mut TrafficDecoder,
    request: &[u8],
    kind: TrafficKind,
    reply: &[u8],
) -> (TrafficFrame, TrafficFrame) {
    let asked = decoder.decode(&record(
        TrafficKind::Request,
        &frame(request[0], &request[1..]),
    ));
    (asked, decoder.decode(&record(kind, reply)))
}

/// One row of a collection of frames: drive, framing, request, reply.
struct Row {
    drive: String,
    what: String,
    framing: Framing,
    request: Vec<u8>,
    reply: Option<Vec<u8>>,
    decoded: Value,
}

fn model_of(drive: &str) -> Option<&'static str> {
    Some(match drive {
        "n700" => "hyundai-n700",
        "n100plus" => "hyundai-n100plus",
        "Toshiba VF-AS1" => "toshiba-vf-as1",
        "Toshiba VF-S15" => "toshiba-vf-s15",
        "TECO E510" => "teco-e510",
        "TECO E510s" => "teco-e510s",
        "Frecon FR500A" => "frecon-fr500a",
        _ => return None,
    })
}

fn rows() -> Vec<Row> {
    let all = [
        include_str!("../../../../../tests/data/hyundai-frames.json"),
        include_str!("../../../../../tests/data/teco-frecon-frames.json"),
        include_str!("../../../../../tests/data/toshiba-frames.json"),
    ];
    let rows = all
        .into_iter()
        .flat_map(|text| serde_json::from_str::<Vec<Value>>(text).unwrap());
    // The vendor's own protocol is not Modbus.
    let rows = rows.filter(|row| row["decoded"]["start"] != "2F");
    let bytes = |text: &str| {
        if text.starts_with(':') {
            return text.as_bytes().to_vec();
        }
        let digits = text.replace(' ', "");
        (0..digits.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap())
            .collect()
    };
    rows.map(|row| {
        let request = row["request"].as_str().unwrap();
        Row {
            drive: row["drive"].as_str().unwrap().to_owned(),
            what: row["what"].as_str().unwrap().to_owned(),
            framing: if request.starts_with(':') {
                Framing::Ascii
            } else {
                Framing::Rtu
            },
            request: bytes(request),
            reply: row["response"].as_str().map(bytes),
            decoded: row["decoded"].clone(),
        }
    })
    .collect()
}

fn is_sound(framing: Framing, bytes: &[u8]) -> bool {
    framing::decode(framing, bytes).is_some()
}

/// The decoder's text for a row: of a damaged frame as the line would report it.
fn decoded(row: &Row) -> (TrafficFrame, Option<TrafficFrame>) {
    let station = match row.framing {
        Framing::Ascii => {
            u8::from_str_radix(std::str::from_utf8(&row.request[1..3]).unwrap(), 16).unwrap()
        }
        _ => row.request[0],
    };
    // If a frame is for all, some drive receives it.
    let known = model_of(&row.drive).map(|model| {
        drive(
            model,
            if matches!(station, 0 | 0xFF) {
                1
            } else {
                station
            },
        )
    });
    let mut decoder = decoder(row.framing, known.into_iter().collect());
    let kind = |bytes: &[u8], kind| {
        if is_sound(row.framing, bytes) {
            kind
        } else {
            TrafficKind::Noise
        }
    };
    let asked = decoder.decode(&record(
        kind(&row.request, TrafficKind::Request),
        &row.request,
    ));
    let reply = row.reply.as_ref();
    (
        asked,
        reply.map(|reply| decoder.decode(&record(kind(reply, TrafficKind::Reply), reply))),
    )
}

#[test]
fn every_frame_of_the_collections_reads_as_it_always_did() {
    let mut text = String::new();
    for row in rows() {
        let shown = |bytes: &[u8]| match row.framing {
            Framing::Ascii => String::from_utf8_lossy(bytes).trim_end().to_owned(),
            _ => bytes
                .iter()
                .map(|byte| format!("{byte:02X}"))
                .collect::<Vec<_>>()
                .join(" "),
        };
        let (asked, reply) = decoded(&row);
        let _ = writeln!(text, "{}: {}", row.drive, row.what);
        let _ = writeln!(text, "  -> {}\n     {}", shown(&row.request), asked.text);
        if let (Some(bytes), Some(reply)) = (&row.reply, reply) {
            let _ = writeln!(text, "  <- {}\n     {}", shown(bytes), reply.text);
        }
    }
    let path = format!(
        "{}/../../tests/golden/traffic.txt",
        env!("CARGO_MANIFEST_DIR")
    );
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    assert_eq!(
        text,
        std::fs::read_to_string(&path).unwrap_or_default(),
        "{path}"
    );
}

#[test]
fn every_frame_of_the_collections_says_what_its_collection_says() {
    let mut frames = 0;
    let mut values = 0;
    let mut refusals = 0;
    for row in rows() {
        let what = format!("{}: {}", row.drive, row.what);
        let (asked, reply) = decoded(&row);
        for (bytes, frame) in
            std::iter::once((&row.request, &asked)).chain(row.reply.as_ref().zip(reply.as_ref()))
        {
            frames += 1;
            assert_eq!(
                frame.station.is_some(),
                is_sound(row.framing, bytes),
                "{what}"
            );
            assert!(!frame.text.is_empty(), "{what}");
        }
        let Some(reply) = reply.filter(|reply| reply.station.is_some() && asked.station.is_some())
        else {
            continue;
        };
        let plain = |frame: &TrafficFrame| frame.function.map(|code| code & 0x7F);
        assert_eq!(
            (reply.station, plain(&reply)),
            (asked.station, plain(&asked)),
            "{what}"
        );
        if let Some(code) = code(&row.decoded["exception"]) {
            assert_eq!(reply.exception, Some(code), "{what}");
            assert!(
                reply.text.starts_with(&format!("exception 0x{code:02X}: ")),
                "{what}: {}",
                reply.text
            );
            refusals += 1;
        } else if let (Some(value), Some(first)) =
            (row.decoded["value"].as_f64(), reply.values.first())
            && first.name.is_some()
            && row.decoded["unit"].is_string()
        {
            let shown: f64 = first.text.split(' ').next().unwrap().parse().unwrap();
            assert_eq!(shown, value, "{what}: {}", first.text);
            values += 1;
        }
    }
    assert_eq!((frames, values, refusals), (233, 18, 24));
}

/// A number, or hexadecimal text such as `52H`.
fn code(value: &Value) -> Option<u8> {
    let text = value
        .as_str()
        .map(|text| u8::from_str_radix(text.trim_end_matches('H'), 16).unwrap());
    value
        .as_u64()
        .map(|code| u8::try_from(code).unwrap())
        .or(text)
}

#[test]
fn a_read_and_its_reply_name_their_registers() {
    let (asked, reply) = exchange(
        &mut hall(),
        &[1, 3, 1, 1, 0, 1],
        TrafficKind::Reply,
        &frame(1, &[3, 2, 0x13, 0x88]),
    );
    assert_eq!(asked.text, "read 0x0101 output frequency, 1 word");
    assert_eq!(
        (asked.drive.unwrap().as_str(), asked.function),
        ("drive-1", Some(3))
    );
    assert_eq!(reply.text, "output frequency 50.00 Hz");
    let value = FrameValue {
        address: 0x0101_u16.into(),
        name: Some("output_frequency".into()),
        text: "50.00 Hz".into(),
    };
    assert_eq!(reply.values, [value]);
}

#[test]
fn writes_say_what_is_ordered_and_what_the_drive_holds() {
    let taken = frame(1, &[6, 0, 2, 0, 1]);
    let (asked, reply) = exchange(&mut hall(), &[1, 6, 0, 2, 0, 1], TrafficKind::Reply, &taken);
    assert_eq!(asked.text, "write 0x0002 run command = 0x0001 (forward)");
    assert_eq!(reply.text, "written: 0x0002 run command = 0x0001 (forward)");
    let refused = frame(1, &[6, 0, 2, 0, 0]);
    let (_, reply) = exchange(
        &mut hall(),
        &[1, 6, 0, 2, 0, 1],
        TrafficKind::Reply,
        &refused,
    );
    assert_eq!(
        reply.text,
        "not taken, the drive holds 0x0002 run command = 0x0000 (stop)"
    );
}

#[test]
fn a_run_word_is_reported_by_its_bits_and_fields() {
    use crate::profile::check;
    let text_of = |text: &str, word: u16| {
        let drive = KnownDrive {
            model: Arc::new(check::model(text).unwrap()),
            ..drive("hyundai-n700", 1)
        };
        let pdu = [&[6, 0x20, 0x00][..], &word.to_be_bytes()].concat();
        let asked = decoder(Framing::Rtu, vec![drive])
            .decode(&record(TrafficKind::Request, &frame(1, &pdu)));
        asked
            .text
            .strip_prefix("write 0x2000 run command = ")
            .unwrap_or(&asked.text)
            .to_owned()
    };
    let ignoring = include_str!("../../../../../tests/golden/models/zero-ignored.toml");
    assert_eq!(text_of(ignoring, 0x043C), "0x043C (stop)");
    assert_eq!(text_of(ignoring, 0x0000), "0x0000 (ignored)");
    assert_eq!(
        text_of(ignoring, 0x803C),
        "0x803C (ignored)",
        "whatever else it says"
    );
    assert_eq!(text_of(ignoring, 0x042C), "0x042C (quick-stop)");
    let latching = include_str!("../../../../../tests/golden/models/zero-nothing.toml");
    assert_eq!(text_of(latching, 0x0000), "0x0000 (nothing)");
    assert_eq!(text_of(latching, 0x0032), "0x0032 (run, toggle)");
    let coasting = include_str!("../../../../../tests/golden/models/zero-coast.toml");
    assert_eq!(text_of(coasting, 0x0000), "0x0000 (coast)");
}

#[test]
fn what_is_for_all_is_said_so() {
    let mut hall = hall();
    let asked = hall.decode(&record(
        TrafficKind::Request,
        &frame(0xFF, &[6, 0, 2, 0, 0]),
    ));
    assert_eq!(
        asked.text,
        "to all: write 0x0002 run command = 0x0000 (stop)"
    );
    assert_eq!((asked.station, asked.drive), (Some(Station(0xFF)), None));
}

#[test]
fn barriers_and_looks_for_an_echo_are_named() {
    let mut hall = hall();
    let mut said = |why, pdu: &[u8]| {
        let sent = TrafficRecord {
            why: Some(why),
            ..record(TrafficKind::Request, &frame(1, pdu))
        };
        hall.decode(&sent).text
    };
    assert_eq!(
        said(FramePurpose::Barrier, &[8, 0, 0, 0xA5, 0x37]),
        "barrier: loop test with 0xA537"
    );
    assert_eq!(
        said(FramePurpose::Trial, &[0x11]),
        "trial of a barrier: function 0x11, report server id"
    );
    assert_eq!(
        said(FramePurpose::Probe, &[3, 1, 1, 0, 2]),
        "looking for an echo: read 0x0101 output frequency, 2 words"
    );
    assert_eq!(
        said(FramePurpose::Stop, &[6, 0, 2, 0, 0]),
        "write 0x0002 run command = 0x0000 (stop)"
    );
    let refusal = hall.decode(&record(TrafficKind::Reply, &frame(1, &[0x86, 1])));
    assert!(!refusal.text.contains("as it should"), "{}", refusal.text);
    let barrier = TrafficRecord {
        why: Some(FramePurpose::Barrier),
        ..record(TrafficKind::Request, &frame(1, &[0x11]))
    };
    hall.decode(&barrier);
    let refusal = hall.decode(&record(TrafficKind::Reply, &frame(1, &[0x91, 1])));
    assert!(
        refusal.text.ends_with(", as it should be"),
        "{}",
        refusal.text
    );
}

#[test]
fn what_answers_nothing_is_understood_by_itself() {
    let mut hall = hall();
    let stray = TrafficKind::Stray(Station(1));
    let (_, late) = exchange(
        &mut hall,
        &[1, 3, 1, 1, 0, 1],
        stray,
        &frame(1, &[3, 4, 0, 1, 0, 2]),
    );
    assert_eq!(late.text, "2 words of unknown registers: 0x0001 0x0002");
    let mut said = |kind, pdu: &[u8]| hall.decode(&record(kind, &frame(2, pdu))).text;
    let foreign = TrafficKind::Foreign(Station(2));
    assert_eq!(
        said(foreign, &[6, 0, 2, 0, 1]),
        "after a write: 0x0002 run command = 0x0001 (forward)"
    );
    assert_eq!(
        said(foreign, &[0x10, 0, 2, 0, 2]),
        "after a write of 2 words from 0x0002 run command on"
    );
    assert_eq!(
        said(foreign, &[8, 0, 0, 0, 7]),
        "a loop test came back with 0x0007"
    );
    assert_eq!(
        said(foreign, &[0x83, 2]),
        "exception 0x02: illegal data address"
    );
    assert_eq!(said(foreign, &[0x63, 2]), "reply to function 0x63");
    let other = TrafficKind::OtherMaster(Station(2));
    assert_eq!(
        said(other, &[3, 1, 1, 0, 1]),
        "another master requests: read 0x0101 output frequency, 1 word"
    );
    assert_eq!(
        said(other, &[4, 1, 1, 0, 1]),
        "another master requests: read input 0x0101 output frequency, 1 word"
    );
    assert_eq!(
        said(TrafficKind::Echo, &[3, 1, 1, 0, 1]),
        "our own frame came back"
    );
}

#[test]
fn what_is_left_of_a_reply_is_said_to_be_that() {
    let mut hall = hall();
    let mut said = |bytes: &[u8]| {
        exchange(&mut hall, &[1, 3, 1, 1, 0, 1], TrafficKind::Noise, bytes)
            .1
            .text
    };
    assert_eq!(
        said(&[1, 3, 2, 0, 0, 0, 0]),
        "a damaged reply: 7 bytes whose check is wrong"
    );
    assert_eq!(said(&[1, 3, 2]), "a damaged reply: 3 of 7 bytes");
    assert_eq!(
        said(&[1, 3, 2, 0, 0, 0, 0, 0]),
        "a damaged reply: 8 bytes in the place of 7"
    );
    assert_eq!(
        said(&[1, 0x83, 2, 0, 0]),
        "a damaged reply: 5 bytes whose check is wrong"
    );
    assert_eq!(said(&[2, 3, 2, 0, 0, 0, 0]), "7 bytes that make no frame");
    assert_eq!(said(&[0]), "1 byte that makes no frame");
    let mut ascii = decoder(Framing::Ascii, vec![drive("teco-e510", 1)]);
    let mut said = |bytes: &[u8]| ascii.decode(&record(TrafficKind::Noise, bytes)).text;
    assert_eq!(
        said(b":0103021770FF\r\n"),
        "a damaged frame: 15 characters whose check is wrong"
    );
    assert_eq!(said(b":0103"), "5 characters of a frame that did not end");
    assert_eq!(said(b"03\r\n"), "4 bytes that make no frame");
}

#[test]
fn messages_of_modbus_tcp_read_as_the_frames_of_a_serial_line() {
    let message = |pdu: &[u8]| {
        let mut out = Vec::new();
        mbap::encode(&mut out, 0xBEEF, 1, |adu| adu.extend_from_slice(pdu));
        out
    };
    let mut line = decoder(Framing::Mbap, vec![drive("hyundai-n700", 1)]);
    let mut serial = hall();
    for (kind, pdu) in [
        (TrafficKind::Request, &[3, 1, 1, 0, 1][..]),
        (TrafficKind::Reply, &[3, 2, 0x17, 0x70]),
    ] {
        let frame = line.decode(&record(kind, &message(pdu)));
        assert_eq!(
            (&frame.station, frame.function),
            (&Some(Station(1)), Some(3))
        );
        assert_eq!(
            frame.text,
            serial.decode(&record(kind, &self::frame(1, pdu))).text
        );
    }
    let noise = line.decode(&record(TrafficKind::Noise, b"HTTP"));
    assert_eq!(noise.text, "4 bytes that make no Modbus TCP message");
}

#[test]
fn silences_are_counted_from_the_end_of_what_was_there_before() {
    let mut hall = hall();
    let at = |kind, begin_ms, end_ms| TrafficRecord {
        begin: MonoTime::from_millis(begin_ms),
        end: MonoTime::from_millis(end_ms),
        ..record(kind, &frame(1, &[3, 2, 0, 0]))
    };
    let gap_ms = |frame: TrafficFrame| frame.gap.map(|gap| gap.as_millis());
    let first = hall.decode(&at(TrafficKind::Reply, 100, 108));
    assert_eq!(
        (gap_ms(first.clone()), first.on_wire.as_millis()),
        (None, 8)
    );
    assert_eq!(
        gap_ms(hall.decode(&at(TrafficKind::Reply, 120, 130))),
        Some(12)
    );
    // What arrives while we are still sending has no silence before it.
    assert_eq!(
        gap_ms(hall.decode(&at(TrafficKind::Echo, 121, 129))),
        Some(0)
    );
    assert_eq!(
        gap_ms(hall.decode(&at(TrafficKind::Reply, 131, 132))),
        Some(1)
    );
    hall.skip();
    assert_eq!(gap_ms(hall.decode(&at(TrafficKind::Reply, 140, 141))), None);
}

#[test]
fn a_frame_is_a_document() {
    let mut hall = hall();
    let bytes = frame(1, &[3, 1, 1, 0, 1]);
    let sent = TrafficRecord {
        end: MonoTime::from_micros(8_333),
        ..record(TrafficKind::Request, &bytes)
    };
    let document = hall
        .decode(&sent)
        .document("2026-01-31T08:00:00.000001Z".to_owned(), &bytes);
    assert_eq!(
        serde_json::json!(document),
        serde_json::json!({
            "at": "2026-01-31T08:00:00.000001Z", "kind": "request", "why": "poll", "bytes": "010301010001D436",
            "gap_ms": null, "on_wire_ms": 8.333, "station": 1, "drive": "drive-1", "function": 3, "exception": null,
            "text": "read 0x0101 output frequency, 1 word", "values": [],
        })
    );
}

#[test]
fn no_bytes_are_too_odd() {
    let models = [
        "hyundai-n700",
        "toshiba-vf-as1",
        "teco-e510",
        "frecon-fr500a",
        "hyundai-n100plus",
    ];
    let mut random = fastrand::Rng::with_seed(7);
    for model in models {
        let mut decoder = decoder(Framing::Rtu, vec![drive(model, 1)]);
        for _ in 0..2_000 {
            let pdu: Vec<u8> = (0..random.usize(0..12)).map(|_| random.u8(..)).collect();
            let kinds = [
                TrafficKind::Request,
                TrafficKind::Reply,
                TrafficKind::Stray(Station(1)),
                TrafficKind::Noise,
            ];
            let kind = kinds[random.usize(..kinds.len())];
            let code = [3, 6, 8, 0x10, 0x83, random.u8(..)][random.usize(..6)];
            let frame = decoder.decode(&record(
                kind,
                &frame(random.u8(0..2), &[&[code], &pdu[..]].concat()),
            ));
            assert!(!frame.text.is_empty());
        }
    }
}
