//! Invalid packets: connections are closed with the right reason, and there is no panic.

use super::*;
use proptest::prelude::*;

/// Packets after CONNECT that end a connection, and the reason with MQTT 5.
const WRONG: &[(&str, &[u8], u8)] = &[
    (
        "a second CONNECT",
        b"\x10\x0d\x00\x04MQTT\x05\x02\x00\x3c\x00\x00\x00",
        0x82,
    ),
    ("AUTH", &[0xF0, 0], 0x82),
    ("type 0", &[0x00, 0], 0x81),
    ("what brokers send", &[0xD0, 0], 0x82),
    (
        "flags of SUBSCRIBE",
        &[0x80, 7, 0, 1, 0, 0, 1, b'a', 0],
        0x81,
    ),
    ("no filter", &[0x82, 3, 0, 1, 0], 0x82),
    (
        "packet identifier 0",
        &[0x82, 7, 0, 0, 0, 0, 1, b'a', 0],
        0x82,
    ),
    (
        "subscription identifier 0",
        &[0x82, 9, 0, 1, 2, 0x0B, 0, 0, 1, b'a', 0],
        0x82,
    ),
    (
        "options that do not exist",
        &[0x82, 7, 0, 1, 0, 0, 1, b'a', 0x40],
        0x81,
    ),
    (
        "retain handling 3",
        &[0x82, 7, 0, 1, 0, 0, 1, b'a', 0x30],
        0x82,
    ),
    ("quality 3", &[0x82, 7, 0, 1, 0, 0, 1, b'a', 3], 0x81),
    (
        "no-local in a group",
        b"\x82\x10\x00\x01\x00\x00\x0a$share/g/a\x04",
        0x82,
    ),
    (
        "PUBLISH at quality 3",
        &[0x36, 6, 0, 1, b'a', 0, 1, 0],
        0x81,
    ),
    ("a repeat at quality 0", &[0x38, 4, 0, 1, b'a', 0], 0x81),
    ("a wildcard in a topic", &[0x30, 4, 0, 1, b'#', 0], 0x90),
    ("no topic", &[0x30, 3, 0, 0, 0], 0x90),
    ("a topic that is no text", &[0x30, 4, 0, 1, 0xFF, 0], 0x81),
    ("a topic alias", &[0x30, 7, 0, 1, b'a', 3, 0x23, 0, 1], 0x94),
    (
        "a property twice",
        &[0x30, 8, 0, 1, b'a', 4, 1, 0, 1, 0],
        0x82,
    ),
    (
        "a property that does not belong there",
        &[0x30, 6, 0, 1, b'a', 2, 0x17, 0],
        0x81,
    ),
    (
        "properties beyond the packet",
        &[0x30, 4, 0, 1, b'a', 9],
        0x81,
    ),
    (
        "a property beyond the others",
        &[0x30, 8, 0, 1, b'a', 1, 0x02, 0, 0, 0],
        0x81,
    ),
    ("a topic beyond the packet", &[0x30, 3, 0, 9, b'a'], 0x81),
    ("bytes after PINGREQ", &[0xC0, 1, 0], 0x81),
    (
        "a length of five bytes",
        &[0xC0, 0xFF, 0xFF, 0xFF, 0xFF, 1],
        0x81,
    ),
    (
        "a packet that is too large",
        &[0x30, 0x80, 0x80, 0x40],
        0x95,
    ),
];

#[test]
fn what_is_wrong_ends_the_connection_with_its_reason() {
    for (name, bytes, reason) in WRONG {
        let mut rig = Rig::new();
        let other = rig.connect("other");
        let id = rig.connect("a");
        assert!(!rig.bytes(id, bytes), "{name}");
        assert!(rig.machine.is_ending(id), "{name}");
        assert_eq!(farewell(&mut rig, id), *reason, "{name}");
        assert!(
            rig.bytes(id, &[0xC0, 0]) && rig.sent(id).is_empty(),
            "{name}: no more is read"
        );
        assert!(!rig.machine.is_ending(other), "{name}");
        let (old, _) = rig.connect_v4("old", true);
        let is_right_there = rig.bytes(old, bytes);
        assert!(
            rig.sent(old).is_empty() || is_right_there,
            "{name}: 3.1.1 has no DISCONNECT of brokers"
        );
    }
}

#[test]
fn wrong_connections_are_refused() {
    for (name, bytes, expected) in [
        (
            "a reserved flag",
            &b"\x10\x0d\x00\x04MQTT\x05\x03\x00\x3c\x00\x00\x00"[..],
            &[0x20, 3, 0, 0x81, 0][..],
        ),
        (
            "a will without its flag",
            b"\x10\x0d\x00\x04MQTT\x05\x0a\x00\x3c\x00\x00\x00",
            &[0x20, 3, 0, 0x81, 0],
        ),
        (
            "receive maximum 0",
            b"\x10\x10\x00\x04MQTT\x05\x02\x00\x3c\x03\x21\x00\x00\x00\x00",
            &[0x20, 3, 0, 0x82, 0],
        ),
        (
            "a method",
            b"\x10\x11\x00\x04MQTT\x05\x02\x00\x3c\x04\x15\x00\x01x\x00\x00",
            &[0x20, 3, 0, 0x8C, 0],
        ),
        (
            "an end too soon",
            b"\x10\x08\x00\x04MQTT\x05\x02",
            &[0x20, 3, 0, 0x81, 0],
        ),
        (
            "3.1.1 with a password alone",
            b"\x10\x0f\x00\x04MQTT\x04\x42\x00\x3c\x00\x01a\x00\x00",
            &[],
        ),
        ("another packet", &[0xC0, 0], &[]),
        ("another protocol", b"GET / HTTP/1.1\r\n\r\n", &[]),
    ] {
        let mut rig = Rig::new();
        let id = rig.open();
        assert!(!rig.bytes(id, bytes), "{name}");
        assert_eq!(&*rig.sent(id), expected, "{name}");
    }
}

#[test]
fn more_unreleased_messages_than_were_offered_end_the_connection() {
    let mut rig = Rig::new();
    let id = rig.connect("a");
    for pkid in 1..=64 {
        assert!(rig.publish(
            id,
            v5::Publish {
                pkid,
                ..message("a", "x", QoS::ExactlyOnce)
            }
        ));
    }
    rig.sent(id);
    assert!(!rig.publish(
        id,
        v5::Publish {
            pkid: 65,
            ..message("a", "x", QoS::ExactlyOnce)
        }
    ));
    assert_eq!(farewell(&mut rig, id), 0x93);
    // With 3.1.1 a client cannot know the limit.
    let (old, _) = rig.connect_v4("b", true);
    for pkid in 1..=1000 {
        let publish = v4::Publish {
            pkid,
            ..v4::Publish::new("a", rumqttc::QoS::ExactlyOnce, "x")
        };
        assert!(rig.say_v4(old, &v4::Packet::Publish(publish)));
    }
}

/// The reason code with which the broker disconnects a client, which must have a text as well.
fn farewell(rig: &mut Rig, id: Id) -> u8 {
    let packets = rig.take(id);
    let [v5::Packet::Disconnect(it)] = &packets[..] else {
        panic!("{packets:?}")
    };
    let words = it
        .properties
        .as_ref()
        .and_then(|it| it.reason_string.clone());
    assert!(words.is_some_and(|it| !it.is_empty()));
    it.reason_code as u8
}

#[test]
fn a_client_that_takes_only_short_packets_gets_the_reason_without_words() {
    let mut rig = Rig::new();
    let properties = v5::ConnectProperties {
        max_packet_size: Some(40),
        ..Default::default()
    };
    let (id, _) = rig.connect_with(
        v5::Connect {
            properties: Some(properties),
            ..connect("a")
        },
        None,
    );
    assert!(!rig.bytes(id, &[0xF0, 0]));
    assert_eq!(&*rig.sent(id), [0xE0, 2, 0x82, 0]);
}

/// A packet with any body.
fn packet() -> impl Strategy<Value = Vec<u8>> {
    let body = prop::collection::vec(
        prop_oneof![any::<u8>(), 0..6_u8, Just(b'a'), Just(b'/'), Just(b'#')],
        0..60,
    );
    (any::<u8>(), body)
        .prop_map(|(first, body)| [&[first, u8::try_from(body.len()).unwrap()], &*body].concat())
}

/// A valid packet with some bytes changed.
fn damaged() -> impl Strategy<Value = Vec<u8>> {
    let right: Vec<&'static [u8]> = vec![
        b"\x10\x1d\x00\x04MQTT\x05\xc6\x00\x3c\x05\x11\x00\x00\x00\x09\x00\x01a\x00\x00\x01w\x00\x01x\x00\x00\x00\x00",
        b"\x10\x0d\x00\x04MQTT\x04\x02\x00\x3c\x00\x01a",
        b"\x32\x15\x00\x03a/b\x00\x01\x09\x02\x00\x00\x00\x09\x26\x00\x00\x00\x00xyz",
        b"\x34\x08\x00\x03a/b\x00\x02\x00",
        b"\x82\x0b\x00\x01\x02\x0b\x05\x00\x03a/#\x0e",
        b"\x82\x10\x00\x01\x00\x00\x0a$share/g/a\x02",
        b"\xa2\x08\x00\x01\x00\x00\x03a/#",
        b"\x40\x02\x00\x01",
        b"\x50\x02\x00\x01",
        b"\x62\x02\x00\x01",
        b"\x70\x02\x00\x01",
        b"\xc0\x00",
        b"\xe0\x02\x04\x00",
    ];
    let change = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..3);
    (prop::sample::select(right), change).prop_map(|(right, changes)| {
        let mut bytes = right.to_vec();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes
    })
}

proptest! {
    #[test]
    fn no_bytes_panic_and_what_is_said_can_be_read(
        packets in prop::collection::vec((0..3_usize, prop_oneof![packet(), damaged()], 0..2_000_u64), 1..40),
    ) {
        let mut rig = Rig::new();
        let mut ids = [rig.connect("0"), rig.connect_v4("1", false).0, rig.open()];
        rig.subscribe(ids[0], &[filter("#", QoS::ExactlyOnce)]);
        for (which, bytes, wait) in packets {
            rig.bytes(ids[which], &bytes);
            rig.pass(Duration::from_millis(wait));
            for id in &mut ids {
                let sent = rig.sent(*id);
                let mut rest = &sent[..];
                while let Some(it) = frame(rest, usize::MAX).expect("packets are framed") {
                    rest = &rest[it.end..];
                }
                prop_assert!(rest.is_empty(), "a packet that is not whole");
                if rig.machine.is_ending(*id) {
                    rig.machine.closed(*id, rig.now);
                    *id = rig.open();
                }
            }
        }
        for id in ids {
            rig.machine.closed(id, rig.now);
        }
        rig.machine.take_woken();
        prop_assert!(rig.machine.connections.is_empty());
    }
}
