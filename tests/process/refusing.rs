//! What may not be done is refused by the right exception, and none of it reaches the line.

use super::outsiders::pymodbus_client;
use super::raw::Raw;
use super::rig::{Gateway, Place, gateway, gateway_with, requests_heard, simulate};
use serde_json::json;

/// F001, the output frequency setting. Typed from the manual.
const F001: u16 = 0x0201;

#[test]
fn pymodbus_gets_the_exception_that_fits() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    let requests = [
        ("write:1:0x0002:1", 0x01),         // RUN
        ("write:1:0x0004:5000", 0x01),      // frequency command
        ("write:1:0x020C:100,0,100", 0x01), // a block
        ("read:2:0x0101:1", 0x0A),          // no such unit
        ("read:255:0x0101:1", 0x02),        // the gateway itself has no such word
        ("read:0:0x0101:1", 0x02),
        ("read:1:0xFFFF:2", 0x02), // past the last register
    ];
    let answers = pymodbus_client(gateway.address, &requests.map(|(request, _)| request));
    for ((request, code), answer) in requests.iter().zip(&answers) {
        assert_eq!(answer, &json!({"exception": code}), "{request}");
    }
    assert_eq!(answers.len(), requests.len());
    assert_eq!(
        Raw::connect(gateway.address).read(F001, 1),
        Ok(vec![0]),
        "nothing was written"
    );
}

#[test]
fn a_quantity_that_modbus_does_not_know_is_03() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let gateway = gateway(&place, &port);
    let mut client = Raw::connect(gateway.address);
    for function in [3, 4] {
        for count in [0, 126, 0xFFFF_u16] {
            let [high, low] = count.to_be_bytes();
            assert_eq!(
                client.ask(1, &[function, 1, 1, high, low]),
                [function | 0x80, 3],
                "{function} {count}"
            );
        }
    }
}

#[test]
fn garbage_closes_its_own_connection_and_no_other() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    let mut decent = Raw::connect(gateway.address);
    for (what, bytes) in MALFORMED {
        let mut client = Raw::connect(gateway.address);
        client.send(bytes);
        assert!(client.is_closed_in_silence(), "{what}");
        assert_eq!(decent.read(0x0211, 1), Ok(vec![3]), "after {what}");
    }
}

#[test]
fn who_is_not_allowed_is_not_let_in() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    for (allow, is_let_in) in [("10.0.0.0/8", false), ("127.0.0.0/8", true)] {
        let gateway = gateway_with(&place, &port, &format!("allow = [\"{allow}\"]"));
        gateway.wait_for_drive();
        let mut client = Raw::connect(gateway.address);
        if is_let_in {
            assert_eq!(client.read(F001, 1), Ok(vec![0]));
        } else {
            assert!(client.is_closed_in_silence(), "{allow}");
        }
    }
}

#[test]
fn the_line_never_hears_of_what_was_refused() {
    let undisturbed = requests_on_the_line(|_| {});
    let with_refusals = requests_on_the_line(|gateway| {
        for (_, bytes) in MALFORMED {
            let mut client = Raw::connect(gateway.address);
            client.send(bytes);
            assert!(client.is_closed_in_silence());
        }
        let mut client = Raw::connect(gateway.address);
        for (unit, pdu, code) in REFUSED {
            assert_eq!(
                client.ask(*unit, pdu),
                [pdu[0] | 0x80, *code],
                "{unit} {pdu:02X?}"
            );
        }
    });
    assert_eq!(with_refusals, undisturbed);
}

/// What must close a connection.
const MALFORMED: &[(&str, &[u8])] = &[
    ("a wrong protocol", &[0, 1, 0, 1, 0, 6, 1, 3, 1, 1, 0, 1]),
    ("a length of 0", &[0, 1, 0, 0, 0, 0, 1, 3, 1, 1, 0, 1]),
    ("a length of 65535", &[0, 1, 0, 0, 0xFF, 0xFF, 1, 3, 1, 1, 0, 1]),
    ("a web browser", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"),
    (
        "a page elsewhere that has a browser send a write",
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1:1502\r\n\r\n\x00\x01\x00\x00\x00\x06\x01\x06\x01\x01\x00\x01",
    ),
    ("a serial frame", &[1, 3, 1, 1, 0, 1, 0xD4, 0x36]),
];

/// What is answered with an exception: unit, PDU, code.
const REFUSED: &[(u8, &[u8], u8)] = &[
    (1, &[6, 0, 2, 0, 1], 1),                         // RUN
    (1, &[6, 0, 2, 0, 0], 1),                         // STOP too: nothing at all is written
    (1, &[0x10, 0, 4, 0, 1, 2, 0x13, 0x88], 1),       // frequency command as a block
    (1, &[5, 0, 0, 0xFF, 0], 1),                      // a coil
    (1, &[0x17, 1, 1, 0, 1, 0, 2, 0, 1, 2, 0, 1], 1), // read and write at once
    (9, &[3, 1, 1, 0, 1], 0x0A),                      // no such unit
    (255, &[6, 0, 2, 0, 1], 1), // the number that is the drives' own broadcast
    (0, &[6, 0, 2, 0, 1], 1),   // and that of Modbus
    (1, &[3, 1, 1, 0, 0], 3),   // no words
    (1, &[3, 1, 1, 0, 126], 3), // too many
];

/// Requests that a drive hears while a gateway starts, `disturb` happens, and a client reads ten times.
/// The ten reads leave the gateway time for all its first polls, so that their number is always the same.
fn requests_on_the_line(disturb: impl FnOnce(&Gateway)) -> u64 {
    let place = Place::new();
    let port = place.file("line");
    let drive = simulate(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    disturb(&gateway);
    let mut client = Raw::connect(gateway.address);
    for _ in 0..10 {
        assert_eq!(client.read(0x0211, 1), Ok(vec![3]));
    }
    requests_heard(drive)
}
