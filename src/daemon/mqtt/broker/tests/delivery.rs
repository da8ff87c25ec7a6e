//! Messages: receivers, repetition, order, properties.

use super::*;
use v5::PubAckReason;

fn filters(paths: &[&str], qos: QoS) -> Vec<v5::Filter> {
    paths.iter().map(|path| filter(path, qos)).collect()
}

fn acknowledge(rig: &mut Rig, id: Id, pkid: u16) {
    assert!(rig.say(id, &v5::Packet::PubAck(v5::PubAck::new(pkid, None))));
}

#[test]
fn a_message_goes_to_those_that_want_it_at_the_lower_of_both_qualities() {
    let mut rig = Rig::new();
    let writer = rig.connect("writer");
    for (wanted, number) in [
        (QoS::AtMostOnce, 0),
        (QoS::AtLeastOnce, 1),
        (QoS::ExactlyOnce, 2),
    ] {
        let reader = rig.connect("reader");
        assert_eq!(rig.subscribe(reader, &[filter("a/+", wanted)]).len(), 1);
        for (qos, other) in [
            (QoS::AtMostOnce, 0),
            (QoS::AtLeastOnce, 1),
            (QoS::ExactlyOnce, 2),
        ] {
            rig.publish(
                writer,
                v5::Publish {
                    pkid: other,
                    ..message("a/b", "x", qos)
                },
            );
            let got = rig.messages(reader);
            assert_eq!(got.len(), 1);
            assert_eq!(got[0].qos as u16, number.min(other));
            assert!(!got[0].retain && !got[0].dup);
        }
        let id = 2;
        rig.say(writer, &v5::Packet::PubRel(v5::PubRel::new(id, None)));
    }
    rig.publish(writer, message("b/b", "x", QoS::AtMostOnce));
    assert_eq!(
        rig.take(writer).len(),
        3 + 3 + 3,
        "PUBACK, PUBREC and PUBCOMP of each round"
    );
}

#[test]
fn quality_2_is_delivered_once_however_often_it_is_sent() {
    let mut rig = Rig::new();
    let writer = rig.connect_with(lasting("writer", 60), None).0;
    let reader = rig.connect("reader");
    rig.subscribe(reader, &[filter("a", QoS::ExactlyOnce)]);
    rig.publish(writer, message("a", "x", QoS::ExactlyOnce));
    rig.machine.closed(writer, rig.now);
    let (writer, ack) = rig.connect_with(lasting("writer", 60), None);
    assert!(ack.session_present);
    rig.publish(
        writer,
        v5::Publish {
            dup: true,
            ..message("a", "x", QoS::ExactlyOnce)
        },
    );
    assert!(matches!(&rig.take(writer)[..], [v5::Packet::PubRec(it)] if it.pkid == 9));
    let got = rig.messages(reader);
    assert_eq!(got.len(), 1);
    assert!(rig.say(writer, &v5::Packet::PubRel(v5::PubRel::new(9, None))));
    assert!(
        matches!(&rig.take(writer)[..], [v5::Packet::PubComp(it)] if it.reason == v5::PubCompReason::Success)
    );
    // The other half: PUBREC, PUBREL, PUBCOMP with the reader.
    assert!(rig.say(
        reader,
        &v5::Packet::PubRec(v5::PubRec::new(got[0].pkid, None))
    ));
    assert!(matches!(&rig.take(reader)[..], [v5::Packet::PubRel(it)] if it.pkid == got[0].pkid));
    assert!(rig.say(
        reader,
        &v5::Packet::PubComp(v5::PubComp::new(got[0].pkid, None))
    ));
    assert!(rig.take(reader).is_empty());
    // An unused identifier.
    assert!(rig.say(reader, &v5::Packet::PubRec(v5::PubRec::new(77, None))));
    let not_found = v5::PubRelReason::PacketIdentifierNotFound;
    assert!(matches!(&rig.take(reader)[..], [v5::Packet::PubRel(it)] if it.reason == not_found));
}

#[test]
fn what_was_not_acknowledged_comes_again_in_order_and_says_so() {
    let mut rig = Rig::new();
    let writer = rig.connect("writer");
    let (reader, _) = rig.connect_with(lasting("reader", 60), None);
    rig.subscribe(reader, &[filter("#", QoS::ExactlyOnce)]);
    for (payload, qos) in [
        ("1", QoS::AtLeastOnce),
        ("2", QoS::ExactlyOnce),
        ("3", QoS::ExactlyOnce),
    ] {
        rig.publish(
            writer,
            v5::Publish {
                pkid: 5,
                ..message("x", payload, qos)
            },
        );
        rig.say(writer, &v5::Packet::PubRel(v5::PubRel::new(5, None)));
    }
    let got = rig.messages(reader);
    assert_eq!(got.iter().map(|it| it.dup).collect::<Vec<_>>(), [false; 3]);
    assert!(rig.say(
        reader,
        &v5::Packet::PubRec(v5::PubRec::new(got[1].pkid, None))
    ));
    rig.machine.closed(reader, rig.now);
    rig.publish(writer, message("x", "4", QoS::AtLeastOnce));
    rig.publish(writer, message("x", "lost", QoS::AtMostOnce));
    let reader = rig.open();
    rig.say(
        reader,
        &v5::Packet::Connect(lasting("reader", 60), None, None),
    );
    let again = rig.take(reader);
    let text = |it: &v5::Packet| match it {
        v5::Packet::ConnAck(ack) => format!("session {}", ack.session_present),
        v5::Packet::Publish(it) => format!("{} {}", String::from_utf8_lossy(&it.payload), it.dup),
        v5::Packet::PubRel(it) => format!("release {}", it.pkid == got[1].pkid),
        other => format!("{other:?}"),
    };
    let said: Vec<String> = again.iter().map(text).collect();
    assert_eq!(
        said,
        [
            "session true",
            "1 true",
            "release true",
            "3 true",
            "4 false"
        ]
    );
}

#[test]
fn no_more_is_in_flight_than_the_client_takes_and_all_comes_in_order() {
    let mut rig = Rig::new();
    let writer = rig.connect("writer");
    for (maximum, expected) in [(Some(2), 2), (None, 64), (Some(1000), 64)] {
        let properties = v5::ConnectProperties {
            receive_maximum: maximum,
            ..Default::default()
        };
        let connect = v5::Connect {
            properties: Some(properties),
            ..connect("reader")
        };
        let (reader, _) = rig.connect_with(connect, None);
        rig.subscribe(reader, &[filter("a", QoS::AtLeastOnce)]);
        for number in 0..100 {
            rig.publish(writer, message("a", &number.to_string(), QoS::AtLeastOnce));
        }
        let mut got = rig.messages(reader);
        assert_eq!(got.len(), expected);
        for at in 0..100 {
            let pkid = got[at].pkid;
            acknowledge(&mut rig, reader, pkid);
            got.extend(rig.messages(reader));
        }
        let numbers: Vec<usize> = got
            .iter()
            .map(|it| str::from_utf8(&it.payload).unwrap().parse().unwrap())
            .collect();
        assert_eq!(numbers, (0..100).collect::<Vec<_>>());
    }
}

#[test]
fn a_full_queue_drops_the_oldest_at_quality_0_first_and_counts() {
    let mut rig = Rig::new();
    let writer = rig.connect("writer");
    let (reader, _) = rig.connect_with(lasting("reader", 60), None);
    rig.subscribe(reader, &[filter("a", QoS::AtLeastOnce)]);
    let max = super::super::limits::WAITING_MAX;
    for number in 0..max + 2 {
        let qos = if number % 2 == 0 {
            QoS::AtMostOnce
        } else {
            QoS::AtLeastOnce
        };
        rig.publish(writer, message("a", &number.to_string(), qos));
    }
    let report = rig.machine.take_report();
    assert_eq!(report.dropped.get("reader"), Some(&2));
    let first = rig.payloads(reader);
    assert_eq!(first[..3], ["1", "3", "4"], "0 and 2 gave way");
    rig.machine.closed(reader, rig.now);
    for number in 0..max {
        rig.publish(writer, message("a", &number.to_string(), QoS::AtLeastOnce));
    }
    let report = rig.machine.take_report();
    assert!(
        report.dropped["reader"] > 0,
        "those above 0 are bounded too"
    );
    assert_eq!(rig.machine.take_report(), Default::default());
}

#[test]
fn retained_messages_come_at_a_subscription_as_it_asks_for_them() {
    let mut rig = Rig::new();
    let writer = rig.connect("writer");
    for topic in ["a/1", "a/2", "b"] {
        rig.publish(writer, retained(topic, topic));
    }
    let reader = rig.connect("reader");
    rig.subscribe(reader, &[filter("a/#", QoS::AtMostOnce)]);
    let got = rig.messages(reader);
    assert_eq!(
        got.iter().map(|it| &*it.topic).collect::<Vec<_>>(),
        [b"a/1", b"a/2"]
    );
    assert!(got.iter().all(|it| it.retain && it.qos == QoS::AtMostOnce));
    for (rule, count) in [
        (RetainForwardRule::OnEverySubscribe, 2),
        (RetainForwardRule::OnNewSubscribe, 0),
        (RetainForwardRule::Never, 0),
    ] {
        let again = v5::Filter {
            retain_forward_rule: rule,
            ..filter("a/#", QoS::AtMostOnce)
        };
        rig.subscribe(reader, &[again]);
        assert_eq!(rig.messages(reader).len(), count);
    }
    let new = v5::Filter {
        retain_forward_rule: RetainForwardRule::OnNewSubscribe,
        ..filter("b", QoS::AtMostOnce)
    };
    rig.subscribe(reader, &[new]);
    assert_eq!(rig.payloads(reader), ["b"]);
    rig.publish(writer, retained("a/1", ""));
    assert_eq!(
        rig.payloads(reader),
        [""],
        "that it is cleared is delivered"
    );
    let (old, _) = rig.connect_v4("old", true);
    rig.say_v4(
        old,
        &v4::Packet::Subscribe(v4::Subscribe {
            pkid: 1,
            ..v4::Subscribe::new("#", rumqttc::QoS::AtMostOnce)
        }),
    );
    let got = rig.take_v4(old);
    assert!(
        matches!(&got[..], [v4::Packet::SubAck(_), v4::Packet::Publish(_), v4::Packet::Publish(it)] if it.retain)
    );
}

#[test]
fn all_that_is_retained_comes_however_much_it_is() {
    let mut rig = Rig::new();
    let writer = rig.connect("writer");
    let count = super::super::limits::WAITING_MAX + 500;
    for number in 0..count {
        rig.publish(writer, retained(&format!("a/{number}"), "x"));
    }
    let reader = rig.connect("reader");
    rig.subscribe(reader, &[filter("#", QoS::AtMostOnce)]);
    rig.publish(writer, message("live", "y", QoS::AtMostOnce));
    let got = rig.messages(reader);
    assert_eq!(got.len(), count + 1);
    assert_eq!(got[count].topic, "live", "after what was there before");
    assert_eq!(rig.machine.take_report(), Default::default());
}

#[test]
fn the_options_of_mqtt_5_are_kept() {
    let mut rig = Rig::new();
    let reader = rig.connect("reader");
    let own = v5::Filter {
        nolocal: true,
        ..filter("own", QoS::AtMostOnce)
    };
    let plain = v5::Filter {
        preserve_retain: true,
        ..filter("kept", QoS::AtMostOnce)
    };
    rig.subscribe(reader, &[own, plain, filter("other", QoS::AtMostOnce)]);
    rig.publish(reader, message("own", "x", QoS::AtMostOnce));
    assert_eq!(rig.payloads(reader), [""; 0]);
    let writer = rig.connect("writer");
    rig.publish(writer, message("own", "x", QoS::AtMostOnce));
    rig.publish(writer, retained("kept", "x"));
    rig.publish(writer, retained("other", "x"));
    let flags: Vec<bool> = rig.messages(reader).iter().map(|it| it.retain).collect();
    assert_eq!(flags, [false, true, false]);
    // Two filters, one message, both identifiers.
    rig.ask(reader, &[filter("other", QoS::AtMostOnce)], Some(3));
    rig.ask(reader, &[filter("+", QoS::AtLeastOnce)], Some(200));
    rig.take(reader);
    rig.publish(writer, message("other", "x", QoS::AtLeastOnce));
    let bytes = rig.sent(reader);
    // 200 takes two bytes.
    assert_eq!(&bytes[11..], [5, 0x0B, 3, 0x0B, 0xC8, 1, b'x'], "{bytes:?}");
}

#[test]
fn properties_are_passed_on_and_expiry_counts_down() {
    let mut rig = Rig::new();
    let reader = rig.connect_with(lasting("reader", 600), None).0;
    let writer = rig.connect("writer");
    rig.subscribe(reader, &[filter("a", QoS::AtLeastOnce)]);
    let pair = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    let properties = v5::PublishProperties {
        payload_format_indicator: Some(1),
        message_expiry_interval: Some(10),
        response_topic: Some("answer".to_owned()),
        correlation_data: Some("42".into()),
        user_properties: vec![pair("a", "1"), pair("a", "2"), pair("", "")],
        content_type: Some("text".to_owned()),
        ..Default::default()
    };
    let with = |expiry| v5::Publish {
        properties: Some(v5::PublishProperties {
            message_expiry_interval: Some(expiry),
            ..properties.clone()
        }),
        retain: true,
        ..message("a", "x", QoS::AtLeastOnce)
    };
    rig.publish(writer, with(10));
    assert_eq!(rig.messages(reader)[0].properties, Some(properties.clone()));
    rig.machine.closed(reader, rig.now);
    rig.publish(writer, with(10));
    rig.publish(writer, with(3));
    rig.pass(Duration::from_secs(4));
    let reader = rig.open();
    rig.say(
        reader,
        &v5::Packet::Connect(lasting("reader", 600), None, None),
    );
    let left: Vec<_> = rig
        .messages(reader)
        .iter()
        .map(|it| it.properties.clone().unwrap().message_expiry_interval)
        .collect();
    assert_eq!(
        left,
        [Some(6), Some(6)],
        "one that was in flight, one that waited; the third is over"
    );
    rig.publish(writer, with(2));
    rig.pass(Duration::from_secs(2));
    let late = rig.connect("late");
    rig.subscribe(late, &[filter("a", QoS::AtLeastOnce)]);
    assert_eq!(rig.payloads(late), [""; 0], "what is retained is over too");
    let (old, _) = rig.connect_v4("old", true);
    rig.say_v4(
        old,
        &v4::Packet::Subscribe(v4::Subscribe {
            pkid: 1,
            ..v4::Subscribe::new("a", rumqttc::QoS::AtMostOnce)
        }),
    );
    rig.publish(writer, with(10));
    assert!(matches!(&rig.take_v4(old)[..], [_, v4::Packet::Publish(it)] if it.payload == "x"));
}

#[test]
fn a_packet_that_is_too_large_for_a_client_is_not_sent() {
    let mut rig = Rig::new();
    let properties = v5::ConnectProperties {
        max_packet_size: Some(40),
        ..Default::default()
    };
    let (reader, _) = rig.connect_with(
        v5::Connect {
            properties: Some(properties),
            ..connect("reader")
        },
        None,
    );
    rig.subscribe(reader, &[filter("a", QoS::AtLeastOnce)]);
    let writer = rig.connect("writer");
    rig.publish(writer, message("a", &"x".repeat(40), QoS::AtLeastOnce));
    rig.publish(writer, message("a", "y", QoS::AtLeastOnce));
    assert_eq!(rig.payloads(reader), ["y"]);
}

#[test]
fn a_shared_subscription_gives_each_message_to_one_of_its_members() {
    let mut rig = Rig::new();
    let writer = rig.connect("writer");
    rig.publish(writer, retained("a", "kept"));
    let readers: Vec<Id> = (0..3)
        .map(|number| rig.connect_with(lasting(&number.to_string(), 60), None).0)
        .collect();
    for id in &readers {
        rig.subscribe(*id, &filters(&["$share/g/a"], QoS::AtLeastOnce));
        assert_eq!(rig.payloads(*id), [""; 0], "no retained message");
    }
    for number in 0..30 {
        rig.publish(writer, message("a", &number.to_string(), QoS::AtLeastOnce));
    }
    assert_eq!(
        readers
            .iter()
            .map(|id| rig.payloads(*id).len())
            .collect::<Vec<_>>(),
        [10, 10, 10]
    );
    rig.machine.closed(readers[0], rig.now);
    for number in 0..30 {
        rig.publish(writer, message("a", &number.to_string(), QoS::AtLeastOnce));
    }
    assert_eq!(
        readers[1..]
            .iter()
            .map(|id| rig.payloads(*id).len())
            .collect::<Vec<_>>(),
        [15, 15],
        "those that are here"
    );
}

#[test]
fn subscriptions_end_and_wrong_ones_are_refused_one_by_one() {
    let mut rig = Rig::new();
    let reader = rig.connect("reader");
    let codes = rig.subscribe(
        reader,
        &filters(&["a", "a/#/b", "$share/g"], QoS::ExactlyOnce),
    );
    let invalid = v5::SubscribeReasonCode::TopicFilterInvalid;
    assert_eq!(
        codes,
        [
            v5::SubscribeReasonCode::Success(QoS::ExactlyOnce),
            invalid,
            invalid
        ]
    );
    let unsubscribe = v5::Unsubscribe {
        pkid: 3,
        filters: vec!["a".to_owned(), "b".to_owned()],
        properties: None,
    };
    rig.say(reader, &v5::Packet::Unsubscribe(unsubscribe));
    let Some(v5::Packet::UnsubAck(ack)) = rig.take(reader).pop() else {
        panic!("no UNSUBACK")
    };
    assert_eq!(
        ack.reasons,
        [
            v5::UnsubAckReason::Success,
            v5::UnsubAckReason::NoSubscriptionExisted
        ]
    );
    rig.publish(reader, message("a", "x", QoS::AtLeastOnce));
    let [v5::Packet::PubAck(ack)] = &rig.take(reader)[..] else {
        panic!("it is still subscribed")
    };
    assert_eq!(ack.reason, PubAckReason::Success);
    let (old, _) = rig.connect_v4("old", true);
    let wanted = ["a", "a#"]
        .map(|path| v4::SubscribeFilter::new(path.to_owned(), rumqttc::QoS::AtLeastOnce));
    rig.say_v4(
        old,
        &v4::Packet::Subscribe(v4::Subscribe {
            pkid: 1,
            ..v4::Subscribe::new_many(wanted)
        }),
    );
    assert_eq!(&*rig.sent(old), [0x90, 4, 0, 1, 1, 0x80]);
    rig.say_v4(
        old,
        &v4::Packet::Unsubscribe(v4::Unsubscribe {
            pkid: 2,
            topics: vec!["a".to_owned()],
        }),
    );
    assert_eq!(&*rig.sent(old), [0xB0, 2, 0, 2]);
}
