//! Modbus TCP clients that nobody here wrote: every function that they have, exact exceptions, many requests at once, a
//! second connection.

use super::outsiders::{libmodbus, npm_client, pymodbus_client};
use super::plant::{FREQUENCY, Plant, RUN};
use super::raw::Raw;
use serde_json::{Value, json};
use std::net::SocketAddr;
use vfd_gateway::domain::version::PROGRAM_VERSION;

type Client = fn(SocketAddr, &[&str]) -> Vec<Value>;

const CLIENTS: [(&str, Client); 3] = [
    ("pymodbus", pymodbus_client),
    ("modbus-serial", |address, requests| {
        npm_client("modbus-serial", address, requests)
    }),
    ("jsmodbus", |address, requests| {
        npm_client("jsmodbus", address, requests)
    }),
];

/// Requests that every client knows, and the answers.
const READS: &[(&str, &str)] = &[
    ("coils:101:0:4", r#"{"bits": [false, false, false, false]}"#),
    (
        "discrete:101:0:4",
        r#"{"bits": [true, false, false, false]}"#,
    ),
    ("read:101:0:1", r#"{"words": [1]}"#),
    ("read_input:101:20:2", r#"{"words": [500, 5000]}"#),
    ("read:255:3:1", r#"{"words": [1]}"#),
    ("read:1:529:1", r#"{"words": [3]}"#),
    ("read_input:1:529:2", r#"{"words": [3, 3]}"#),
    (
        "read:1:274:20",
        r#"{"words": [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]}"#,
    ),
    ("coils:1:0:1", r#"{"exception": 1}"#),
    ("coils:101:3:2", r#"{"exception": 2}"#),
    ("discrete:101:16:1", r#"{"exception": 2}"#),
    ("read:101:39:2", r#"{"exception": 2}"#),
    ("read_input:101:40:1", r#"{"exception": 2}"#),
    ("read:9:0:1", r#"{"exception": 10}"#),
    ("write:101:0:1", r#"{"exception": 2}"#),
    ("write:101:257:499", r#"{"exception": 3}"#),
    ("write:101:256:1,3000", r#"{"exception": 6}"#),
    ("write:1:524:100", r#"{"exception": 2}"#),
    ("coil:101:4:1", r#"{"exception": 2}"#),
    ("flags:101:0:1,1", r#"{"exception": 3}"#),
    ("write:255:0:1", r#"{"exception": 1}"#),
];

/// Orders that every client knows, the answers, and the setpoint that each puts on the line.
const ORDERS: &[(&str, &str, Option<u16>)] = &[
    ("write:101:257:3000", r#"{"words": [3000]}"#, Some(3000)),
    ("read:101:257:1", r#"{"words": [3000]}"#, None),
    ("write:101:257:2500,1", r#"{"count": 2}"#, Some(2500)),
    ("write:1:4:2750", r#"{"words": [2750]}"#, Some(2750)),
    ("coil:101:3:1", r#"{"bits": [true]}"#, None),
    ("flags:101:0:0,0,0,1", r#"{"count": 4}"#, None),
];

#[test]
fn every_function_that_all_clients_have_is_answered_to_each_of_them() {
    let plant = Plant::new();
    for (name, client) in CLIENTS {
        let requests: Vec<&str> = READS.iter().map(|(request, _)| *request).collect();
        let answers = client(plant.modbus, &requests);
        assert_eq!(answers.len(), READS.len(), "{name}");
        for ((request, expected), answer) in READS.iter().zip(&answers) {
            assert_eq!(
                answer,
                &serde_json::from_str::<Value>(expected).unwrap(),
                "{name}: {request}"
            );
        }
    }
    assert_eq!(plant.written(), [], "refused means: nothing on the line");
    let mut setpoints = Vec::new();
    for (name, client) in CLIENTS {
        let requests: Vec<&str> = ORDERS.iter().map(|(request, ..)| *request).collect();
        let answers = client(plant.modbus, &requests);
        for ((request, expected, setpoint), answer) in ORDERS.iter().zip(&answers) {
            assert_eq!(
                answer,
                &serde_json::from_str::<Value>(expected).unwrap(),
                "{name}: {request}"
            );
            setpoints.extend(setpoint.map(|word| (FREQUENCY, word)));
        }
    }
    let written = plant.written();
    let (stops, others): (Vec<_>, Vec<_>) = written.into_iter().partition(|it| *it == (RUN, 0));
    assert!(!stops.is_empty());
    assert_eq!(others, setpoints, "each order once, and nothing else");
}

#[test]
fn masks_reads_with_writes_and_identification_are_answered() {
    let plant = Plant::new();
    let text = json!({"0": "vfd-gateway", "1": "vfd-gateway", "2": PROGRAM_VERSION});
    for (name, client) in &CLIENTS[..2] {
        let both = |words: &str| format!("both:101:257:1,257,{words}");
        let (mask, identity) = ("mask:101:257:65280,200", "identity:255:1:0");
        let requests = [
            "write:101:257:2500",
            mask,
            "read:101:257:1",
            &both("2600"),
            &both("5001"),
            identity,
            "identity:101:1:0",
        ];
        let answers = client(plant.modbus, &requests);
        assert_eq!(answers[1], json!({"masks": [65280, 200]}), "{name}");
        assert_eq!(
            answers[2],
            json!({"words": [2504]}),
            "{name}: 2500 and FF00, or 00C8"
        );
        assert_eq!(
            answers[3],
            json!({"words": [2600]}),
            "{name}: written, then read"
        );
        assert_eq!(answers[4], json!({"exception": 3}), "{name}");
        assert_eq!(answers[5], json!({"identity": text}), "{name}");
        assert_eq!(
            answers[6],
            json!({"exception": 1}),
            "{name}: only the gateway itself is identified"
        );
    }
    // The N700 has no loop test, and 17 hex is not for the drive's own registers.
    let others = [
        "loop:1:0:0x1234",
        "mask:1:4:0,0",
        "both:1:529:1,4,1",
        "flags:1:0:1",
        "discrete:1:0:1",
    ];
    for (request, answer) in others.iter().zip(pymodbus_client(plant.modbus, &others)) {
        assert_eq!(answer, json!({"exception": 1}), "{request}");
    }
    let written: Vec<_> = plant.written();
    assert_eq!(
        written,
        [2500, 2504, 2600, 2500, 2504, 2600].map(|word| (FREQUENCY, word))
    );
}

#[test]
fn many_requests_at_once_get_each_its_own_answer_and_a_second_connection_goes_on() {
    let plant = Plant::new();
    let together = "together:read:101:20:1|read:101:21:1|read:1:529:1|read:9:0:1|read:101:20:2|discrete:101:0:1|\
                    coils:101:3:1|read:1:274:2|read_input:1:529:2|read:101:0:1|read:255:3:1|read:101:40:1";
    let expected = json!([
        {"words": [500]}, {"words": [5000]}, {"words": [3]}, {"exception": 10}, {"words": [500, 5000]},
        {"bits": [true]}, {"bits": [false]}, {"words": [0, 0]}, {"words": [3, 3]}, {"words": [1]}, {"words": [1]},
        {"exception": 2}
    ]);
    for name in ["modbus-serial", "jsmodbus"] {
        let requests = [
            together,
            together,
            "again",
            together,
            "read:101:20:1",
            "again",
            "again",
            "read:101:21:1",
        ];
        let answers = npm_client(name, plant.modbus, &requests);
        let (first, second) = (json!({"words": [500]}), json!({"words": [5000]}));
        assert_eq!(
            answers,
            [&expected, &expected, &expected, &first, &second].map(Clone::clone),
            "{name}"
        );
    }
}

#[test]
fn libmodbus_and_what_applies_of_its_own_test_client_pass() {
    let plant = Plant::new();
    let output = libmodbus(&plant.place.file(""), &plant.modbus.port().to_string(), 101);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success() && text.contains("ALL THAT APPLIES PASSES"),
        "{text}"
    );
    let (stops, others): (Vec<_>, Vec<_>) =
        plant.written().into_iter().partition(|it| *it == (RUN, 0));
    assert!(!stops.is_empty());
    assert_eq!(
        others,
        [3000, 2500, 2504, 2600].map(|word| (FREQUENCY, word))
    );
}

/// Function, what follows it, and the exception: quantities, byte counts, coil values and addresses that pass 65535.
const WRONG: &[(&[u8], u8)] = &[
    (&[1, 0, 0, 0, 0], 3),
    (&[1, 0, 0, 0x07, 0xD1], 3), // 2001 coils
    (&[1, 0, 0, 0x07, 0xD0], 2), // 2000 would do, where there are so many
    (&[2, 0, 0, 0, 0], 3),
    (&[2, 0, 0, 0x07, 0xD1], 3),
    (&[2, 0xFF, 0xFF, 0, 2], 2),
    (&[3, 0, 0, 0, 0], 3),
    (&[3, 0, 0, 0, 126], 3),
    (&[3, 0, 0, 0, 125], 2),
    (&[4, 0, 0, 0, 126], 3),
    (&[4, 0xFF, 0xFF, 0, 2], 2),
    (&[5, 0, 3, 0, 1], 3), // neither FF00 nor 0000
    (&[5, 0, 3, 0xFF, 0xFF], 3),
    (&[0x0F, 0, 0, 0, 0, 0], 3),
    (&[0x0F, 0, 0, 0, 4, 2, 8, 0], 3),
    (&[0x0F, 0, 0, 0, 9, 1, 0], 3),
    (&[0x0F, 0, 0, 0x07, 0xB1, 247], 3), // 1969
    (&[0x10, 1, 0, 0, 0, 0], 3),
    (&[0x10, 1, 0, 0, 1, 3, 0, 0, 0], 3),
    (&[0x10, 1, 0, 0, 2, 2, 0, 0], 3),
    (&[0x10, 1, 0, 0, 124, 6, 0, 0, 0, 0, 0, 0], 3), // whole, it would be longer than any frame
    (&[0x10, 0xFF, 0xFF, 0, 2, 4, 0, 0, 0, 0], 2),
    (&[0x16, 1, 1, 0, 0], 3),
    (&[0x17, 0, 0, 0, 126, 1, 1, 0, 1, 2, 0x0B, 0xB8], 3),
    (&[0x17, 0, 0, 0, 0, 1, 1, 0, 1, 2, 0x0B, 0xB8], 3),
    (&[0x17, 0, 0, 0, 1, 1, 1, 0, 122, 2, 0x0B, 0xB8], 3),
    (&[0x17, 0xFF, 0xFF, 0, 2, 1, 1, 0, 1, 2, 0x0B, 0xB8], 2),
    (&[0x2B, 0x0D, 0, 0], 1),
    (&[0x2B, 0x0E, 9, 0], 3),
    (&[0x11], 1),
    (&[0x42, 0, 0], 1),
    (&[0x08, 0, 1, 0, 0], 1),
];

#[test]
fn every_limit_has_its_exact_exception_and_puts_nothing_on_the_line() {
    let plant = Plant::new();
    let mut client = Raw::connect(plant.modbus);
    for (pdu, code) in WRONG {
        // The data that the byte count announces, where the table leaves it out.
        let bytes = match pdu {
            [0x0F | 0x10, _, _, _, _, bytes] => usize::from(*bytes),
            _ => 0,
        };
        let whole = [*pdu, &vec![0; bytes]].concat();
        let unit = if pdu[0] == 0x2B { 255 } else { 101 };
        assert_eq!(
            client.ask(unit, &whole),
            [pdu[0] | 0x80, *code],
            "{pdu:02X?}"
        );
    }
    plant.assert_nothing_was_written_since(0);
}
