//! Every frame that is known of the drives: printed, misprinted, or built from what is printed.

use super::*;
use crate::profile::scale::ScaledValue;
use crate::wire::crc;
use serde_json::Value;
use std::collections::BTreeSet;

/// Registers that frames name and that the models do not list, on purpose.
const NOT_LISTED: [(&str, u16); 8] = [
    ("hyundai-n700", 0x0203),   // a misprint; what is there is unknown
    ("toshiba-vf-s15", 0xFFFF), // does not exist
    ("toshiba-vf-as1", 0xFFFF),
    ("toshiba-vf-s15", 0x1875), // the indirect block: what it shows depends on selectors
    ("toshiba-vf-s15", 0x1876), // a wrong start of it
    ("teco-e510s", 0x0100),     // an example of a check sum only
    ("frecon-fr500a", 0x0102),  // an example of an address only
    ("frecon-fr500a", 0x8102),  // its stored twin
];

/// What stands between the start of a frame and its check, and the check itself.
#[derive(Clone, Debug)]
struct Wire {
    body: Vec<u8>,
    check: Vec<u8>,
    right_check: Vec<u8>,
}

impl Wire {
    /// Of hexadecimal digits, with or without blanks, or of an ASCII frame that begins with a colon.
    fn of(text: &str) -> Self {
        let (digits, check_bytes) = match text.strip_prefix(':') {
            Some(ascii) => (
                ascii
                    .strip_suffix("\r\n")
                    .expect("an ASCII frame ends with CR LF")
                    .to_owned(),
                1,
            ),
            None => (text.replace(' ', ""), 2),
        };
        let hex = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).unwrap();
        let mut body: Vec<u8> = (0..digits.len()).step_by(2).map(hex).collect();
        let check = body.split_off(body.len() - check_bytes);
        let right_check = match check_bytes {
            1 => vec![
                body.iter()
                    .fold(0_u8, |sum, byte| sum.wrapping_add(*byte))
                    .wrapping_neg(),
            ],
            _ => crc::modbus(&body).to_le_bytes().to_vec(),
        };
        Self {
            body,
            check,
            right_check,
        }
    }

    fn is_sound(&self) -> bool {
        self.check == self.right_check
    }

    fn station(&self) -> u16 {
        u16::from(self.body[0])
    }

    fn function(&self) -> u8 {
        self.body[1]
    }

    /// The word at byte `at` of the body.
    fn word(&self, at: usize) -> u16 {
        u16::from_be_bytes([self.body[at], self.body[at + 1]])
    }

    fn words_from(&self, at: usize) -> Vec<u16> {
        self.body[at..]
            .chunks_exact(2)
            .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
            .collect()
    }

    /// The code of an exception reply.
    fn exception(&self) -> Option<u16> {
        (self.function() & 0x80 != 0).then(|| u16::from(self.body[2]))
    }
}

/// One row of a collection, what it says in the same words whatever the collection.
struct Frame {
    what: String,
    model: Option<Arc<Model>>,
    request: Wire,
    response: Option<Wire>,
    is_valid: bool,
    /// The check that would be right, where a misprint is corrected.
    right_check: Option<Vec<u8>>,
    /// Frame that is right where this one is not.
    correct: Option<Wire>,
    station: u16,
    function: u8,
    address: Option<u16>,
    count: Option<u16>,
    raw: Vec<u16>,
    value: Option<f64>,
    exception: Option<u16>,
    decoded: Value,
}

/// A number, or hexadecimal text: `0xFD00`, `2501`, `52H`, `C0 CD`.
fn number(value: &Value) -> Option<u16> {
    match value {
        Value::Number(number) => u16::try_from(number.as_u64()?).ok(),
        Value::String(text) => {
            let digits = text
                .trim_start_matches("0x")
                .trim_end_matches('H')
                .replace(' ', "");
            Some(u16::from_str_radix(&digits, 16).unwrap_or_else(|_| panic!("{text}")))
        }
        _ => None,
    }
}

fn numbers(value: &Value) -> Vec<u16> {
    match value {
        Value::Array(list) => list.iter().map(|it| number(it).unwrap()).collect(),
        other => number(other).into_iter().collect(),
    }
}

fn model_of(drive: &str) -> Option<Arc<Model>> {
    let id = match drive {
        "n700" => "hyundai-n700",
        "n100plus" => "hyundai-n100plus",
        "Toshiba VF-AS1" => "toshiba-vf-as1",
        "Toshiba VF-S15" => "toshiba-vf-s15",
        "TECO E510" => "teco-e510",
        "TECO E510s" => "teco-e510s",
        "Frecon FR500A" => "frecon-fr500a",
        "TECO F510" | "TECO A510s" | "TECO EV" => return None,
        other => panic!("{other}"),
    };
    Some(model(id))
}

impl Frame {
    fn of(row: &Value) -> Self {
        let decoded = row["decoded"].clone();
        let wire = |key: &str| row[key].as_str().map(Wire::of);
        // One collection writes the station under `address`, a raw word under `value` and hertz under `hz`.
        let is_teco_or_frecon = row["mode"].is_string();
        let first = |keys: &[&str]| keys.iter().find_map(|key| number(&decoded[*key]));
        let (station, address, raw, value) = if is_teco_or_frecon {
            (
                first(&["address"]),
                first(&["start", "register"]),
                &["values", "value"][..],
                &decoded["hz"],
            )
        } else {
            (
                first(&["station", "unit"]),
                first(&["address"]),
                &["raw", "words"][..],
                &decoded["value"],
            )
        };
        let raw = raw
            .iter()
            .map(|key| numbers(&decoded[*key]))
            .find(|list| !list.is_empty())
            .unwrap_or_default();
        Self {
            what: format!("{}: {}", row["drive"], row["what"]),
            model: model_of(row["drive"].as_str().unwrap()),
            request: wire("request").unwrap(),
            response: wire("response"),
            is_valid: row["valid_crc"]
                .as_bool()
                .or(row["valid_check"].as_bool())
                .unwrap(),
            right_check: match first(&["correct_lrc"]) {
                Some(lrc) => Some(vec![lrc as u8]),
                None => number(&decoded["correct_crc"]).map(|crc| crc.to_be_bytes().to_vec()),
            },
            correct: wire("correct_frame"),
            station: station.unwrap(),
            function: first(&["function"]).unwrap() as u8,
            address,
            count: first(&["count"]),
            raw,
            value: value.as_f64(),
            exception: first(&["exception"]),
            decoded,
        }
    }

    fn wires(&self) -> impl Iterator<Item = &Wire> {
        [Some(&self.request), self.response.as_ref()]
            .into_iter()
            .flatten()
    }

    /// The words that the exchange carries: those read, else those written.
    fn carried(&self) -> Vec<u16> {
        match (self.request.function(), &self.response) {
            (3, Some(response)) if response.exception().is_none() => response.words_from(3),
            (6, _) => vec![self.request.word(4)],
            (0x10, _) => self.request.words_from(7),
            _ => Vec::new(),
        }
    }
}

fn rows(text: &str) -> Vec<Value> {
    serde_json::from_str::<Value>(text)
        .unwrap()
        .as_array()
        .unwrap()
        .clone()
}

/// The frames of all collections that are Modbus.
fn frames() -> Vec<Frame> {
    let all = [
        include_str!("../../../../../tests/data/hyundai-frames.json"),
        include_str!("../../../../../tests/data/teco-frecon-frames.json"),
        include_str!("../../../../../tests/data/toshiba-frames.json"),
    ];
    let rows = all
        .into_iter()
        .flat_map(rows)
        .filter(|row| row["decoded"]["start"] != "2F");
    rows.map(|row| Frame::of(&row)).collect()
}

#[test]
fn the_collections_are_whole() {
    let frames = frames();
    let of = |id: &str| {
        frames
            .iter()
            .filter(|it| it.model.as_ref().is_some_and(|model| model.id == id))
            .count()
    };
    assert_eq!((of("hyundai-n700"), of("hyundai-n100plus")), (24, 15));
    assert_eq!((of("toshiba-vf-as1"), of("toshiba-vf-s15")), (17, 15));
    assert_eq!(
        (of("teco-e510"), of("teco-e510s"), of("frecon-fr500a")),
        (15, 15, 15)
    );
    assert_eq!(frames.len(), 39 + 52 + 36 - 4);
    assert_eq!(
        frames.iter().filter(|frame| !frame.is_valid).count(),
        6 + 7 + 1
    );
}

#[test]
fn a_check_is_right_where_the_collection_says_so() {
    for frame in frames() {
        let wrong: Vec<_> = frame.wires().filter(|wire| !wire.is_sound()).collect();
        assert_eq!(wrong.is_empty(), frame.is_valid, "{}", frame.what);
        if let (Some(right), [wire]) = (&frame.right_check, &wrong[..]) {
            assert_eq!(&wire.right_check, right, "{}", frame.what);
        }
        assert!(wrong.len() <= 1, "{}", frame.what);
        if let Some(correct) = &frame.correct {
            assert!(correct.is_sound(), "{}", frame.what);
            assert_ne!(
                (&correct.body, &correct.check),
                (&frame.request.body, &frame.request.check),
                "{}",
                frame.what
            );
        }
        if let Some(lrc) = number(&frame.decoded["lrc"]) {
            let shown = frame
                .wires()
                .map(|wire| wire.check.clone())
                .collect::<Vec<_>>();
            assert!(shown.contains(&vec![lrc as u8]), "{}", frame.what);
        }
    }
}

#[test]
fn frames_say_what_the_collection_says() {
    for frame in frames() {
        let what = &frame.what;
        let request = &frame.request;
        for wire in frame.wires() {
            assert_eq!(wire.station(), frame.station, "{what}");
        }
        // An exception reply has the request's function with the highest bit set.
        assert_eq!(request.function(), frame.function & 0x7F, "{what}");
        if let Some(response) = &frame.response {
            assert_eq!(response.function() & 0x7F, request.function(), "{what}");
            assert_eq!(response.exception(), frame.exception, "{what}");
        }
        if let Some(address) = frame.address {
            assert_eq!(request.word(2), address, "{what}");
        }
        if let Some(count) = frame.count {
            assert_eq!(request.word(4), count, "{what}");
        }
        if !frame.raw.is_empty() {
            assert_eq!(frame.carried(), frame.raw, "{what}");
        }
    }
}

#[test]
fn a_write_is_answered_by_its_echo() {
    let mut seen = 0;
    for frame in frames() {
        let Some(response) = frame
            .response
            .as_ref()
            .filter(|it| it.exception().is_none())
        else {
            continue;
        };
        match frame.request.function() {
            6 | 8 => assert_eq!(response.body, frame.request.body, "{}", frame.what),
            // The misprinted command has another start than its answer.
            0x10 if frame.is_valid => {
                assert_eq!(response.body, frame.request.body[..6], "{}", frame.what)
            }
            _ => continue,
        }
        seen += 1;
    }
    assert_eq!(seen, 53);
}

#[test]
fn models_know_the_registers_of_the_frames() {
    let mut unlisted: BTreeSet<(&str, u16)> = BTreeSet::new();
    for frame in frames() {
        let Some(model) = &frame.model else { continue };
        if !matches!(frame.request.function(), 3 | 6 | 0x10) {
            continue;
        }
        let address = frame.request.word(2);
        let is_known = model.register_at(address).is_some();
        let on_purpose = NOT_LISTED
            .iter()
            .find(|(id, at)| (*id, *at) == (model.id.as_str(), address));
        assert_eq!(
            is_known,
            on_purpose.is_none(),
            "{}: 0x{address:04X}",
            frame.what
        );
        unlisted.extend(on_purpose);
    }
    assert_eq!(unlisted.len(), NOT_LISTED.len());
}

#[test]
fn words_mean_what_the_collection_says() {
    // A whole block of monitors, by the words of the collection.
    let block = [
        ("frequency_command_hz", 0x2523),
        ("output_hz", 0x2524),
        ("output_v", 0x2525),
        ("dc_bus_v", 0x2526),
        ("current_a", 0x2527),
    ];
    let mut seen = 0;
    for frame in frames() {
        let Some(model) = &frame.model else { continue };
        let value_at = |address: u16| {
            let word = frame.carried()[usize::from(address - frame.request.word(2))];
            ScaledValue::from_word(word, model.register_at(address).unwrap()).value()
        };
        if let Some(value) = frame
            .value
            .filter(|_| model.register_at(frame.request.word(2)).is_some())
        {
            assert_eq!(value_at(frame.request.word(2)), value, "{}", frame.what);
            seen += 1;
        }
        for (key, address) in block {
            if let Some(value) = frame.decoded[key].as_f64() {
                assert_eq!(value_at(address), value, "{}: {key}", frame.what);
                seen += 1;
            }
        }
    }
    assert_eq!(seen, 36);
}

#[test]
fn models_serve_what_is_answered_and_name_what_is_refused() {
    for frame in frames() {
        let (Some(model), Some(response)) = (&frame.model, &frame.response) else {
            continue;
        };
        let function = frame.request.function();
        match response.exception() {
            None => assert!(model.serves(function), "{}", frame.what),
            Some(1) => assert!(!model.serves(function), "{}", frame.what),
            Some(code) => assert!(model.exception_text(code as u8).is_some(), "{}", frame.what),
        }
        assert!(
            function != 3 || frame.exception.is_some() || is_one_read(model, &frame.request),
            "{}",
            frame.what
        );
    }
}

/// Whether the model allows the read in one frame. The indirect block is read by another rule.
fn is_one_read(model: &Model, request: &Wire) -> bool {
    request.word(4) <= model.words_in_one_read(request.word(2)) || request.word(2) == 0x1875
}

#[test]
fn run_words_of_the_frames_are_commands_of_the_models() {
    let mut seen = Vec::new();
    for frame in frames() {
        let Some(model) = &frame.model else { continue };
        let register = model
            .register_for(RegisterRole::RunCommand)
            .unwrap()
            .address;
        if frame.request.function() != 6 || register != frame.request.word(2) {
            continue;
        }
        let word = frame.request.word(4);
        let place = run_words(model)
            .iter()
            .position(|known| known.is_some_and(|(it, _)| it == word));
        let names = ["stop", "forward", "reverse", "coast", "reset", "release"];
        seen.push((
            model.id.clone(),
            word,
            place.map_or("none", |place| names[place]),
        ));
    }
    seen.sort_unstable();
    seen.dedup();
    let seen: Vec<_> = seen
        .iter()
        .map(|(id, word, name)| (id.as_str(), *word, *name))
        .collect();
    assert_eq!(
        seen,
        [
            ("frecon-fr500a", 1, "forward"),
            ("frecon-fr500a", 2, "reverse"),
            ("frecon-fr500a", 5, "stop"),
            ("frecon-fr500a", 6, "coast"),
            ("frecon-fr500a", 7, "reset"),
            ("hyundai-n100plus", 0, "stop"),
            ("hyundai-n100plus", 1, "forward"),
            ("hyundai-n100plus", 2, "reverse"),
            ("hyundai-n700", 0, "stop"),
            ("hyundai-n700", 1, "forward"),
            ("hyundai-n700", 2, "reverse"),
            ("hyundai-n700", 3, "coast"),
            ("hyundai-n700", 4, "reset"),
            ("toshiba-vf-as1", 0x0000, "release"),
            // Emergency off, which trips the drive, and a reset that lets the frequency go.
            ("toshiba-vf-as1", 0x9000, "none"),
            ("toshiba-vf-as1", 0xA000, "none"),
            ("toshiba-vf-as1", 0xC000, "stop"),
            ("toshiba-vf-as1", 0xC400, "forward"),
            ("toshiba-vf-as1", 0xC600, "reverse"),
            ("toshiba-vf-as1", 0xC800, "coast")
        ]
    );
}

#[test]
fn the_vendors_own_protocol_is_no_modbus() {
    let rows = rows(include_str!(
        "../../../../../tests/data/toshiba-frames.json"
    ));
    let rows: Vec<_> = rows
        .iter()
        .filter(|row| row["decoded"]["start"] == "2F")
        .collect();
    assert_eq!(rows.len(), 4);
    for row in rows {
        for key in ["request", "response"] {
            let Some(wire) = row[key].as_str().map(Wire::of) else {
                continue;
            };
            assert!(!wire.is_sound(), "{}", row["what"]);
            // Its check is the sum of all bytes before it.
            let mut bytes = [wire.body, wire.check].concat();
            let sum = bytes.pop().unwrap();
            let is_right = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)) == sum;
            let expected = key == "response" || row["decoded"]["checksum_valid"] == true;
            assert_eq!(is_right, expected, "{}", row["what"]);
        }
    }
}
