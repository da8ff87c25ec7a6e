//! How connections and sessions begin, end and are taken over; wills.

use super::*;
use v5::DisconnectReasonCode as Reason;

fn will(topic: &str, delay: Option<u32>) -> Option<v5::LastWill> {
    let properties = delay.map(|it| v5::LastWillProperties {
        delay_interval: Some(it),
        payload_format_indicator: None,
        message_expiry_interval: None,
        content_type: Some("text/plain".to_owned()),
        response_topic: None,
        correlation_data: None,
        user_properties: Vec::new(),
    });
    Some(v5::LastWill::new(
        topic,
        "gone",
        QoS::AtLeastOnce,
        false,
        properties,
    ))
}

/// A watcher of all topics.
fn watcher(rig: &mut Rig) -> Id {
    let id = rig.connect("watcher");
    rig.subscribe(id, &[filter("#", QoS::AtMostOnce)]);
    id
}

#[test]
fn connections_of_other_versions_are_refused_in_words_that_they_know() {
    let mut rig = Rig::new();
    let id = rig.open();
    assert!(!rig.bytes(id, b"\x10\x0f\x00\x06MQIsdp\x03\x02\x00\x3c\x00\x01a"));
    assert_eq!(&*rig.sent(id), [0x20, 2, 0, 1]);
    assert!(rig.machine.is_ending(id));
    let id = rig.open();
    assert!(!rig.bytes(id, b"\x10\x0e\x00\x04MQTT\x06\x02\x00\x3c\x00\x00\x01a"));
    assert_eq!(&*rig.sent(id), [0x20, 3, 0, 0x84, 0]);
    let id = rig.open();
    assert!(
        !rig.bytes(id, b"\x10\x04\x00\x02AB"),
        "another protocol is not answered"
    );
    assert!(rig.sent(id).is_empty() && rig.machine.is_ending(id));
}

#[test]
fn a_client_without_identifier_gets_one_or_has_to_forgo_its_session() {
    let mut rig = Rig::new();
    let (_, ack) = rig.connect_with(connect(""), None);
    let properties = ack.properties.unwrap();
    assert!(
        properties
            .assigned_client_identifier
            .is_some_and(|it| it.starts_with("auto-"))
    );
    assert_eq!(properties.max_packet_size, Some(PACKET_MAX));
    assert_eq!(properties.receive_max, Some(64));
    assert_eq!(
        rig.connect_v4("", true).1.code,
        v4::ConnectReturnCode::Success
    );
    assert_eq!(
        rig.connect_v4("", false).1.code,
        v4::ConnectReturnCode::BadClientId
    );
    let (_, other) = rig.connect_with(connect("named"), None);
    assert_eq!(other.properties.unwrap().assigned_client_identifier, None);
}

#[test]
fn the_same_client_again_takes_over_and_the_other_connection_hears_why() {
    let mut rig = Rig::new();
    let watcher = watcher(&mut rig);
    let (first, _) = rig.connect_with(lasting("a", 60), will("will", None));
    rig.machine.take_woken();
    let (second, ack) = rig.connect_with(lasting("a", 60), None);
    assert!(ack.session_present);
    assert!(rig.machine.take_woken().contains(&first));
    let Some(v5::Packet::Disconnect(said)) = rig.take(first).pop() else {
        panic!("no DISCONNECT")
    };
    assert_eq!(said.reason_code, Reason::SessionTakenOver);
    assert!(rig.machine.is_ending(first) && !rig.machine.is_ending(second));
    rig.machine.closed(first, rig.now);
    assert_eq!(rig.payloads(watcher), ["gone"]);
    rig.publish(second, message("x", "1", QoS::AtMostOnce));
    assert_eq!(rig.payloads(watcher), ["1"], "the second connection lives");
}

#[test]
fn a_session_is_kept_for_as_long_as_it_says() {
    let mut rig = Rig::new();
    for (wait, is_kept) in [(59, true), (61, false)] {
        let (id, ack) = rig.connect_with(lasting("a", 60), None);
        assert!(!ack.session_present);
        rig.subscribe(id, &[filter("x", QoS::AtLeastOnce)]);
        rig.machine.closed(id, rig.now);
        rig.pass(Duration::from_secs(wait));
        assert_eq!(
            rig.connect_with(lasting("a", 60), None).1.session_present,
            is_kept,
            "{wait} s"
        );
        let (id, ack) = rig.connect_with(connect("a"), None);
        assert!(!ack.session_present, "a clean start");
        rig.machine.closed(id, rig.now);
    }
    let (id, _) = rig.connect_v4("b", false);
    rig.machine.closed(id, rig.now);
    rig.pass(Duration::from_secs(3600));
    assert!(rig.connect_v4("b", false).1.session_present);
    assert!(!rig.connect_v4("b", true).1.session_present);
}

#[test]
fn there_is_a_bound_on_sessions_and_connections() {
    let mut rig = Rig::new();
    for number in 0..=super::super::limits::SESSIONS_MAX {
        let (id, _) = rig.connect_v4(&format!("c{number}"), false);
        rig.machine.closed(id, rig.now);
        rig.now = rig.now + Duration::from_millis(1);
    }
    assert_eq!(
        rig.machine.sessions.len(),
        super::super::limits::SESSIONS_MAX
    );
    assert!(rig.connect_v4("c1", false).1.session_present);
    assert!(
        !rig.connect_v4("c0", false).1.session_present,
        "the one that waited longest gave way"
    );
    let mut rig = Rig::new();
    let all: Vec<Id> = (0..super::super::CONNECTIONS_MAX)
        .map(|_| rig.open())
        .collect();
    assert_eq!(rig.machine.open(rig.now), None);
    rig.machine.closed(all[0], rig.now);
    assert!(rig.machine.open(rig.now).is_some());
}

#[test]
fn silence_ends_a_connection_after_one_and_a_half_times_its_keep_alive() {
    let mut rig = Rig::new();
    let watcher = watcher(&mut rig);
    let (id, _) = rig.connect_with(
        v5::Connect {
            keep_alive: 10,
            ..connect("a")
        },
        will("will", None),
    );
    rig.pass(Duration::from_secs(14));
    assert!(rig.say(id, &v5::Packet::PingReq(v5::PingReq)));
    assert!(matches!(rig.take(id)[..], [v5::Packet::PingResp(_)]));
    rig.pass(Duration::from_secs(14));
    assert!(!rig.machine.is_ending(id));
    rig.pass(Duration::from_secs(2));
    let Some(v5::Packet::Disconnect(said)) = rig.take(id).pop() else {
        panic!("no DISCONNECT")
    };
    assert_eq!(said.reason_code, Reason::KeepAliveTimeout);
    assert_eq!(rig.payloads(watcher), ["gone"]);
    assert!(
        !rig.machine.is_ending(watcher),
        "one without a keep-alive stays"
    );
}

#[test]
fn a_process_that_stood_still_does_not_take_that_for_silence() {
    let mut rig = Rig::new();
    let (id, _) = rig.connect_with(
        v5::Connect {
            keep_alive: 10,
            ..connect("a")
        },
        None,
    );
    rig.now = rig.now + Duration::from_secs(60);
    rig.machine.tick(rig.now);
    assert!(!rig.machine.is_ending(id));
    rig.pass(Duration::from_secs(15));
    assert!(rig.machine.is_ending(id));
}

#[test]
fn who_does_not_say_who_it_is_is_not_waited_for() {
    let mut rig = Rig::new();
    let id = rig.open();
    rig.pass(Duration::from_secs(10));
    assert!(rig.machine.is_ending(id) && rig.sent(id).is_empty());
}

#[test]
fn a_will_is_published_unless_the_client_takes_its_leave() {
    let mut rig = Rig::new();
    let watcher = watcher(&mut rig);
    let (id, _) = rig.connect_with(connect("a"), will("broken", None));
    rig.machine.closed(id, rig.now);
    assert_eq!(rig.messages(watcher)[0].topic, "broken");
    // With MQTT 5 the ordinary farewell has neither a reason nor a length, and other reasons may have no properties.
    for (farewell, is_published) in [
        (&[0xE0, 0][..], false),
        (&[0xE0, 1, 0], false),
        (&[0xE0, 1, 4], true),
    ] {
        let (id, _) = rig.connect_with(connect("a"), will("left", None));
        assert!(rig.bytes(id, farewell));
        assert!(rig.machine.is_ending(id));
        rig.machine.closed(id, rig.now);
        assert_eq!(
            rig.messages(watcher).len(),
            usize::from(is_published),
            "{farewell:?}"
        );
    }
    let id = rig.open();
    let will = v4::LastWill::new("old", "gone", rumqttc::QoS::AtMostOnce, true);
    let connect = v4::Connect {
        last_will: Some(will),
        ..v4::Connect::new("b")
    };
    assert!(rig.say_v4(id, &v4::Packet::Connect(connect)));
    rig.machine.closed(id, rig.now);
    assert_eq!(rig.messages(watcher)[0].topic, "old");
}

#[test]
fn a_will_waits_for_its_delay_but_not_beyond_its_session() {
    let mut rig = Rig::new();
    let watcher = watcher(&mut rig);
    let (id, _) = rig.connect_with(lasting("a", 60), will("will", Some(10)));
    rig.machine.closed(id, rig.now);
    rig.pass(Duration::from_secs(9));
    assert_eq!(rig.payloads(watcher), [""; 0]);
    rig.pass(Duration::from_secs(1));
    let received = rig.messages(watcher);
    assert_eq!(
        received[0]
            .properties
            .as_ref()
            .unwrap()
            .content_type
            .as_deref(),
        Some("text/plain")
    );
    // The client reconnects in time.
    let (id, _) = rig.connect_with(lasting("a", 60), will("will", Some(10)));
    rig.machine.closed(id, rig.now);
    rig.pass(Duration::from_secs(9));
    let (id, _) = rig.connect_with(lasting("a", 5), will("will", Some(10)));
    rig.pass(Duration::from_secs(20));
    assert_eq!(rig.payloads(watcher), [""; 0]);
    rig.machine.closed(id, rig.now);
    rig.pass(Duration::from_secs(4));
    assert_eq!(rig.payloads(watcher), [""; 0]);
    rig.pass(Duration::from_secs(1));
    assert_eq!(rig.payloads(watcher), ["gone"], "the session is over");
    // A clean start ends a session.
    let (id, _) = rig.connect_with(lasting("a", 60), will("will", Some(10)));
    rig.machine.closed(id, rig.now);
    rig.connect("a");
    assert_eq!(rig.payloads(watcher), ["gone"]);
}

#[test]
fn a_farewell_may_shorten_a_session_and_not_make_one_last() {
    let mut rig = Rig::new();
    let (id, _) = rig.connect_with(lasting("a", 600), None);
    assert!(rig.bytes(id, &[0xE0, 7, 0, 5, 0x11, 0, 0, 0, 0]));
    rig.machine.closed(id, rig.now);
    assert!(!rig.connect_with(lasting("a", 600), None).1.session_present);
    let id = rig.connect("b");
    assert!(!rig.bytes(id, &[0xE0, 7, 0, 5, 0x11, 0, 0, 0, 9]));
    let Some(v5::Packet::Disconnect(said)) = rig.take(id).pop() else {
        panic!("no DISCONNECT")
    };
    assert_eq!(said.reason_code, Reason::ProtocolError);
}
