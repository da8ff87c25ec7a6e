//! The client against a broker that misbehaves in ways seen in practice.

mod refusing;
mod writing;

use super::stub::{CONNECT, DISCONNECT, PUBACK, PUBLISH, Peer, SUBSCRIBE, Stub};
use super::*;
use crate::config::TlsSettings;
use crate::north::broker::{
    BrokerLimits, MqttVersion, PublicationRefusal, Qos, SubscriptionFilter,
};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::{Instant, sleep, timeout};

const VERSIONS: [MqttVersion; 2] = [MqttVersion::V4, MqttVersion::V5];

/// An event that a conversation has received.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Outcome {
    Connected(BrokerLimits),
    Subscribed(Vec<bool>),
    Message(Text),
    Acknowledged(u64),
    Refused(u64, PublicationRefusal),
    Stalled,
    Lost,
    Contested(Option<ClientRival>),
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Text {
    topic: String,
    payload: Vec<u8>,
    retain: bool,
    duplicate: bool,
    expiry: Option<Duration>,
    response_topic: Option<String>,
    correlation: Option<Vec<u8>>,
}

/// A conversation that sends what the test puts into it.
#[derive(Default)]
struct Script {
    events: Vec<Outcome>,
    packets: VecDeque<ClientPacket>,
    /// Sent at each connection.
    greeting: Vec<ClientPacket>,
    farewell: Vec<Publication>,
    leaves_will: bool,
    /// Publishes payloads of this size endlessly.
    flood: Option<usize>,
    wills: RefCell<u32>,
    /// Attempts that were reported as unsent.
    unsent: u32,
    /// Whether a tick is always due at once.
    is_due: bool,
    ticks: u32,
}

impl BrokerConversation for Script {
    fn unsent(&mut self) {
        self.unsent += 1;
    }

    fn will(&self) -> Publication {
        *self.wills.borrow_mut() += 1;
        text("will", &format!("will {}", self.wills.borrow()))
    }

    fn handle(&mut self, _at: ClockMoment, event: BrokerEvent<'_>) {
        self.events.push(match event {
            BrokerEvent::Connected(broker) => {
                self.packets = self.greeting.clone().into();
                Outcome::Connected(broker)
            }
            BrokerEvent::Subscribed(granted) => Outcome::Subscribed(granted),
            BrokerEvent::Message(message) => Outcome::Message(Text {
                topic: message.topic.to_owned(),
                payload: message.payload.to_vec(),
                retain: message.retain,
                duplicate: message.duplicate,
                expiry: message.expiry,
                response_topic: message.response_topic.map(ToOwned::to_owned),
                correlation: message.correlation.map(ToOwned::to_owned),
            }),
            BrokerEvent::Acknowledged(token) => Outcome::Acknowledged(token),
            BrokerEvent::Refused(token, refusal) => Outcome::Refused(token, refusal),
            BrokerEvent::Stalled(_) => Outcome::Stalled,
            BrokerEvent::Lost => Outcome::Lost,
        });
    }

    fn tick(&mut self, _at: ClockMoment) {
        self.ticks += 1;
    }

    fn next_wake(&self) -> Option<MonoTime> {
        self.is_due.then(MonoTime::default)
    }

    fn next_packet(&mut self, _at: ClockMoment) -> Option<ClientPacket> {
        let connected = self
            .events
            .iter()
            .rev()
            .find(|event| matches!(event, Outcome::Connected(_) | Outcome::Lost));
        let flood = self
            .flood
            .filter(|_| matches!(connected, Some(Outcome::Connected(_))));
        self.packets
            .pop_front()
            .or_else(|| flood.map(|bytes| ClientPacket::Publish(text("flood", &"x".repeat(bytes)))))
    }

    fn contested(&mut self, rival: Option<ClientRival>) {
        self.events.push(Outcome::Contested(rival));
    }

    fn farewell(&mut self, _at: ClockMoment) -> Vec<Publication> {
        std::mem::take(&mut self.farewell)
    }

    fn leaves_will(&self) -> bool {
        self.leaves_will
    }
}

/// The client with the test's handles.
#[derive(Default)]
struct Rig {
    conversation: RefCell<Script>,
    bell: Notify,
    stop: Notify,
    counters: ClientCounters,
}

impl Rig {
    fn greeting(packets: Vec<ClientPacket>) -> Self {
        Self {
            conversation: RefCell::new(Script {
                greeting: packets,
                ..Script::default()
            }),
            ..Self::default()
        }
    }

    /// Runs the client until `broker` is done.
    async fn run<O>(
        &self,
        stub: &Stub,
        version: MqttVersion,
        broker: impl Future<Output = O>,
    ) -> O {
        self.run_at(stub.address(), version, broker).await
    }

    async fn run_at<O>(
        &self,
        address: SocketAddr,
        version: MqttVersion,
        broker: impl Future<Output = O>,
    ) -> O {
        tokio::select! {
            () = converse(settings(address, version), &self.conversation, &self.bell, &self.counters, self.stop.notified()) => panic!("ended"),
            output = broker => output,
        }
    }

    fn events(&self) -> Vec<Outcome> {
        self.conversation.borrow().events.clone()
    }

    /// Waits until the conversation has received `count` events.
    async fn events_at_least(&self, count: usize) -> Vec<Outcome> {
        let enough = async {
            while self.conversation.borrow().events.len() < count {
                sleep(Duration::from_millis(1)).await;
            }
        };
        timeout(Duration::from_secs(5), enough)
            .await
            .unwrap_or_else(|_| panic!("only {:?}", self.events()));
        self.events()
    }

    fn say(&self, packet: ClientPacket) {
        self.conversation.borrow_mut().packets.push_back(packet);
        self.bell.notify_one();
    }
}

fn settings(address: SocketAddr, version: MqttVersion) -> ConnectionSettings {
    ConnectionSettings {
        host: address.ip().to_string(),
        port: address.port(),
        also_at: Vec::new(),
        tls: None,
        client_id: format!("test of {version:?}"),
        user: None,
        password: None,
        keep_alive: Duration::from_secs(5),
        version,
        keeps: BrokerKeeps::Nothing,
    }
}

fn text(topic: &str, payload: &str) -> Publication {
    Publication {
        topic: topic.to_owned(),
        payload: payload.as_bytes().to_vec(),
        retain: false,
        qos: Qos::AtMostOnce,
        expiry: None,
        correlation: None,
        token: None,
    }
}

fn with_token(token: u64) -> ClientPacket {
    ClientPacket::Publish(Publication {
        qos: Qos::AtLeastOnce,
        token: Some(token),
        ..text("record", &token.to_string())
    })
}

fn acknowledged(events: &[Outcome]) -> Vec<u64> {
    events
        .iter()
        .filter_map(|event| {
            if let Outcome::Acknowledged(token) = event {
                Some(*token)
            } else {
                None
            }
        })
        .collect()
}

const ANY: BrokerLimits = BrokerLimits {
    maximum_packet_bytes: None,
    retains: true,
};

#[tokio::test(start_paused = true)]
async fn a_broker_that_never_answers_connect_is_given_up_in_time() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let waited = rig.run(&stub, version, async {
            let mut first = stub.accept().await;
            first.expect(CONNECT).await;
            let begun = Instant::now();
            let _second = stub.accept().await;
            begun.elapsed()
        });
        let waited = waited.await;
        assert!(
            waited > Duration::from_secs(4) && waited < Duration::from_secs(6),
            "{version:?}: {waited:?}"
        );
        assert!(
            rig.events().is_empty(),
            "{version:?}: who was never connected has lost nothing"
        );
    }
}

#[tokio::test]
async fn an_attempt_that_ends_before_connect_is_reported_as_unsent() {
    let rig = Rig::default();
    let tls = TlsSettings {
        ca_file: Some("/no/such/authority.pem".into()),
        ..TlsSettings::default()
    };
    let settings = ConnectionSettings {
        tls: Some(tls),
        ..settings("127.0.0.1:1".parse().unwrap(), MqttVersion::V5)
    };
    let twice = async {
        while rig.conversation.borrow().unsent < 2 {
            sleep(Duration::from_millis(1)).await;
        }
    };
    tokio::select! {
        () = converse(settings, &rig.conversation, &rig.bell, &rig.counters, rig.stop.notified()) => panic!("ended"),
        events = timeout(Duration::from_secs(5), twice) => events.unwrap(),
    }
    assert!(rig.events().is_empty());
}

#[tokio::test(start_paused = true)]
async fn a_broker_that_stops_reading_is_given_up_in_time() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        rig.conversation.borrow_mut().flood = Some(100_000);
        let waited = rig.run(&stub, version, async {
            let _first = stub.welcome().await;
            let begun = Instant::now();
            let _second = stub.accept().await;
            begun.elapsed()
        });
        let waited = waited.await;
        assert!(
            waited > Duration::from_secs(4) && waited < Duration::from_secs(9),
            "{version:?}: {waited:?}"
        );
        assert_eq!(
            rig.events(),
            [Outcome::Connected(ANY), Outcome::Lost],
            "{version:?}"
        );
    }
}

#[tokio::test(start_paused = true)]
async fn a_broker_that_answers_no_ping_is_given_up_in_time() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let waited = rig.run(&stub, version, async {
            let mut first = stub.welcome().await;
            let begun = Instant::now();
            while first.read().await.is_some() {}
            begun.elapsed()
        });
        let waited = waited.await;
        assert!(
            waited > Duration::from_secs(7) && waited < Duration::from_secs(8),
            "{version:?}: {waited:?}"
        );
    }
}

#[tokio::test(start_paused = true)]
async fn a_message_above_the_limit_does_not_make_the_client_spin() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let mut connections = 0;
        let too_large = vec![0; incident::PACKET_MAX + 1];
        let attack = async {
            loop {
                let mut peer = stub.welcome().await;
                connections += 1;
                peer.publish("large", &too_large, &[]).await;
                while peer.read().await.is_some() {}
            }
        };
        let attacked = rig
            .run(&stub, version, timeout(Duration::from_secs(60), attack))
            .await;
        assert!(attacked.is_err());
        // 0.2, 0.4, ... 1.6 s make 3 s; then every 3 s, give or take a quarter.
        assert!(
            (16..=30).contains(&connections),
            "{version:?}: {connections} in a minute"
        );
        assert_eq!(rig.counters.received.get(), 0);
    }
}

fn filters(paths: &[&str]) -> Vec<SubscriptionFilter> {
    paths
        .iter()
        .map(|path| SubscriptionFilter {
            path: (*path).to_owned(),
            qos: Qos::AtLeastOnce,
            wants_retained: false,
        })
        .collect()
}

#[tokio::test]
async fn a_large_message_below_the_limit_arrives() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let events = rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            peer.publish("large", &vec![7; 200_000], &[]).await;
            rig.events_at_least(2).await
        });
        let Some(Outcome::Message(message)) = events.await.pop() else {
            panic!("no message")
        };
        assert_eq!(message.payload.len(), 200_000);
    }
}

#[tokio::test]
async fn a_message_against_the_protocol_ends_the_connection_and_is_not_handed_over() {
    let expiry = [2, 0, 0, 0, 9];
    let alias = |number: u8| vec![0x23, 0, number];
    let twice = [
        expiry.repeat(2),
        [1, 1].repeat(2),
        [8, 0, 1, b'a'].repeat(2),
        [9, 0, 1, 7].repeat(2),
        [3, 0, 1, b'x'].repeat(2),
        [expiry.as_slice(), &[9, 0, 0], &expiry].concat(),
    ];
    for properties in twice
        .into_iter()
        .chain([alias(0), alias(1), [alias(1), alias(2)].concat()])
    {
        let stub = Stub::new(MqttVersion::V5).await;
        let rig = Rig::default();
        rig.run(&stub, MqttVersion::V5, async {
            let mut peer = stub.welcome().await;
            peer.publish("run", b"forward", &properties).await;
            peer.publish("run", b"forward", &[]).await;
            while peer.read().await.is_some() {}
            rig.events_at_least(2).await
        })
        .await;
        let events = rig.events();
        // How long messages right after it have waited is unknown, if they are handed over at all.
        let believed = events.iter().take_while(|it| **it != Outcome::Stalled);
        assert_eq!(
            believed
                .filter(|it| matches!(it, Outcome::Message(_)))
                .count(),
            0,
            "{properties:?}: {events:?}"
        );
        assert!(
            events
                .iter()
                .filter(|it| matches!(it, Outcome::Message(_)))
                .count()
                <= 1,
            "{properties:?}: {events:?}"
        );
        assert!(
            events.contains(&Outcome::Lost),
            "{properties:?}: {events:?}"
        );
    }
}

#[tokio::test]
async fn a_message_with_every_property_once_is_handed_over() {
    let all = [
        &[1, 1][..],
        &[2, 0, 0, 0, 9],
        &[8, 0, 1, b'a'],
        &[9, 0, 1, 7],
        &[3, 0, 1, b'x'],
        // Properties that may be repeated.
        &[0x26, 0, 1, b'k', 0, 1, b'v', 0x26, 0, 1, b'k', 0, 0],
        &[0x0B, 0x80, 0x01, 0x0B, 5],
    ];
    for (properties, payload) in [
        (all.concat(), &b"forward"[..]),
        (all.concat(), b""),
        (Vec::new(), b""),
        (vec![1, 0], b"x"),
    ] {
        let stub = Stub::new(MqttVersion::V5).await;
        let rig = Rig::default();
        let events = rig.run(&stub, MqttVersion::V5, async {
            let mut peer = stub.welcome().await;
            peer.publish("run", payload, &properties).await;
            rig.events_at_least(2).await
        });
        let Some(Outcome::Message(message)) = events.await.pop() else {
            panic!("no message for {properties:?}")
        };
        assert_eq!(message.payload, payload);
    }
}

#[tokio::test]
async fn acknowledgements_out_of_order_find_their_tokens() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::greeting((11..=14).map(with_token).collect());
        let events = rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            let mut identifiers = Vec::new();
            for _ in 0..4 {
                identifiers.push(peer.published().await.identifier);
            }
            for at in [3, 0, 2] {
                peer.acknowledge(identifiers[at]).await;
            }
            rig.events_at_least(4).await
        });
        assert_eq!(acknowledged(&events.await), [14, 11, 13], "{version:?}");
    }
}

#[tokio::test]
async fn identifiers_that_come_round_while_one_is_still_open_keep_their_tokens() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::greeting((0..200).map(with_token).collect());
        let events = rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            let first = peer.published().await;
            // The first stays open until its identifier is needed again; then nothing continues without it.
            for _ in 1..usize::from(incident::INFLIGHT_MAX) {
                let next = peer.published().await;
                peer.acknowledge(next.identifier).await;
            }
            peer.acknowledge(first.identifier).await;
            for _ in usize::from(incident::INFLIGHT_MAX)..200 {
                let next = peer.published().await;
                peer.acknowledge(next.identifier).await;
            }
            rig.events_at_least(201).await
        });
        let tokens = acknowledged(&events.await);
        let expected: Vec<u64> = (1..64).chain([0]).chain(64..200).collect();
        assert_eq!(tokens, expected, "{version:?}");
    }
}

#[tokio::test]
async fn a_refused_filter_is_reported_in_its_place() {
    for version in VERSIONS {
        let filters = filters(&["a/+/set", "b/#"]);
        let stub = Stub::new(version).await;
        let rig = Rig::greeting(vec![ClientPacket::Subscribe(filters)]);
        let (options, events) = rig
            .run(&stub, version, async {
                let mut peer = stub.welcome().await;
                let subscribe = peer.expect(SUBSCRIBE).await;
                peer.answer_subscribe(&subscribe, &[1, 0x80]).await;
                (
                    *subscribe.body.last().unwrap(),
                    rig.events_at_least(2).await,
                )
            })
            .await;
        assert_eq!(
            events[1],
            Outcome::Subscribed(vec![true, false]),
            "{version:?}"
        );
        assert_eq!(options, options_of(version), "{version:?}");
    }
}

#[tokio::test]
async fn what_was_not_acknowledged_before_the_cut_is_not_reported_and_not_confused_with_what_comes_after()
 {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::greeting(vec![with_token(7)]);
        let events = rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            let cut = peer.published().await;
            drop(peer);
            rig.events_at_least(2).await;
            rig.conversation.borrow_mut().greeting = vec![with_token(8)];
            let mut peer = stub.welcome().await;
            let next = peer.published().await;
            assert_eq!(
                next.payload, b"8",
                "nothing of the old connection is sent on the new one"
            );
            assert_eq!(
                next.identifier, cut.identifier,
                "the same identifier, for this test to mean something"
            );
            peer.acknowledge(next.identifier).await;
            rig.events_at_least(4).await
        });
        let expected = [
            Outcome::Connected(ANY),
            Outcome::Lost,
            Outcome::Connected(ANY),
            Outcome::Acknowledged(8),
        ];
        assert_eq!(events.await, expected, "{version:?}");
    }
}

#[tokio::test]
async fn each_connection_has_a_fresh_will() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        rig.run(&stub, version, async {
            for count in 1..=3 {
                let mut peer = stub.accept().await;
                let connect = peer.expect(CONNECT).await;
                let will = format!("will {count}");
                assert!(
                    connect
                        .body
                        .windows(will.len())
                        .any(|part| part == will.as_bytes()),
                    "{version:?}: {will}"
                );
            }
        })
        .await;
    }
}

#[tokio::test]
async fn a_stop_sent_just_before_the_broker_dies_is_handed_over() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let events = rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            peer.publish("stop", b"", &[]).await;
            drop(peer);
            rig.events_at_least(3).await
        });
        let message = Outcome::Message(Text {
            topic: "stop".to_owned(),
            ..Text::default()
        });
        assert_eq!(
            events.await,
            [Outcome::Connected(ANY), message, Outcome::Lost],
            "{version:?}"
        );
    }
}

#[tokio::test]
async fn what_came_during_a_stall_is_handed_over_as_what_may_have_waited() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let message = |topic: &str| {
            Outcome::Message(Text {
                topic: topic.to_owned(),
                ..Text::default()
            })
        };
        rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            rig.events_at_least(1).await;
            peer.publish("stop", b"", &[]).await;
            // Suspends everything on this thread.
            std::thread::sleep(Duration::from_millis(1_100));
            assert_eq!(
                rig.events_at_least(3).await,
                [Outcome::Connected(ANY), Outcome::Stalled, message("stop")],
                "{version:?}"
            );
            peer.publish("stop", b"", &[]).await;
            assert_eq!(
                rig.events_at_least(4).await[3],
                message("stop"),
                "{version:?}: reported once"
            );
        })
        .await;
    }
}

#[tokio::test]
async fn a_stop_that_comes_beside_the_last_words_is_handed_over() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        rig.conversation.borrow_mut().farewell = vec![text("status", "offline")];
        let conversation = async {
            converse(
                settings(stub.address(), version),
                &rig.conversation,
                &rig.bell,
                &rig.counters,
                rig.stop.notified(),
            )
            .await;
        };
        let broker = async {
            let mut peer = stub.welcome().await;
            rig.events_at_least(1).await;
            rig.stop.notify_one();
            peer.published().await;
            peer.publish("stop", b"", &[]).await;
            while peer
                .read()
                .await
                .is_some_and(|frame| frame.kind != DISCONNECT)
            {}
        };
        tokio::join!(conversation, broker);
        let message = Outcome::Message(Text {
            topic: "stop".to_owned(),
            ..Text::default()
        });
        assert_eq!(
            rig.events(),
            [Outcome::Connected(ANY), message],
            "{version:?}"
        );
    }
}

#[tokio::test]
async fn the_bell_and_the_wish_to_reconnect_are_heard() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            rig.events_at_least(1).await;
            rig.say(ClientPacket::Publish(text("news", "1")));
            assert_eq!(peer.published().await.payload, b"1");
            rig.say(ClientPacket::Reconnect("a test"));
            while peer.read().await.is_some() {}
            stub.welcome().await;
            assert_eq!(rig.events_at_least(3).await[1], Outcome::Lost);
        })
        .await;
        assert!(rig.conversation.borrow().ticks >= 2);
    }
}

/// For Sparkplug: tck-id-payloads-ndeath-will-message-publisher-disconnect-mqtt50.
#[tokio::test]
async fn who_leaves_the_will_to_the_broker_sends_no_disconnect_with_mqtt_5() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let last = Publication {
            qos: Qos::AtLeastOnce,
            ..text("state", "offline")
        };
        rig.conversation.replace(Script {
            leaves_will: true,
            farewell: vec![last],
            ..Script::default()
        });
        let broker = async {
            let mut peer = stub.welcome().await;
            rig.events_at_least(1).await;
            rig.stop.notify_one();
            let last = peer.published().await;
            peer.acknowledge(last.identifier).await;
            peer.read().await.map(|frame| frame.kind)
        };
        let client = converse(
            settings(stub.address(), version),
            &rig.conversation,
            &rig.bell,
            &rig.counters,
            rig.stop.notified(),
        );
        let ((), end) = timeout(Duration::from_secs(5), async {
            tokio::join!(client, broker)
        })
        .await
        .unwrap();
        assert_eq!(
            end,
            (version == MqttVersion::V4).then_some(DISCONNECT),
            "{version:?}"
        );
    }
}

/// For Sparkplug: tck-id-payloads-ndeath-will-message-publisher, -publisher-disconnect-mqtt311.
#[tokio::test]
async fn the_last_words_come_before_disconnect_and_are_waited_for() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let last = Publication {
            retain: true,
            qos: Qos::AtLeastOnce,
            ..text("state", "offline")
        };
        rig.conversation.borrow_mut().farewell = vec![text("bye", "1"), last];
        let broker = async {
            let mut peer = stub.welcome().await;
            rig.events_at_least(1).await;
            rig.stop.notify_one();
            let mut said = Vec::new();
            for _ in 0..2 {
                said.push(peer.published().await);
            }
            assert_eq!(peer.read().await.map(|frame| frame.kind), Some(DISCONNECT));
            said.into_iter()
                .map(|it| (it.topic, it.retain))
                .collect::<Vec<_>>()
        };
        let client = converse(
            settings(stub.address(), version),
            &rig.conversation,
            &rig.bell,
            &rig.counters,
            rig.stop.notified(),
        );
        let ((), said) = timeout(Duration::from_secs(5), async {
            tokio::join!(client, broker)
        })
        .await
        .unwrap();
        assert_eq!(
            said,
            [("bye".to_owned(), false), ("state".to_owned(), true)],
            "{version:?}"
        );
    }
}

#[tokio::test]
async fn what_the_broker_would_not_take_is_dropped_and_the_rest_goes_out() {
    let version = MqttVersion::V5;
    let stub = Stub::new(version).await;
    // With topic, length and properties the first has exactly 100 bytes, the second one more.
    let fits = Publication {
        payload: vec![1; 94],
        ..text("t", "")
    };
    let too_large = Publication {
        payload: vec![2; 95],
        ..fits.clone()
    };
    let wildcard = text("a/#", "");
    let retained = Publication {
        retain: true,
        ..text("last", "")
    };
    let packets = [too_large, wildcard, fits, retained]
        .map(ClientPacket::Publish)
        .to_vec();
    let rig = Rig::greeting(packets);
    rig.run(&stub, version, async {
        // Maximum packet size 100, no retained messages.
        let mut peer = stub.welcome_on(&[0x27, 0, 0, 0, 100, 0x25, 0]).await;
        let first = peer.expect(PUBLISH).await;
        assert_eq!(first.body.len() + 2, 100);
        let last = peer.published().await;
        assert_eq!((last.topic.as_str(), last.retain), ("last", false));
    })
    .await;
    assert_eq!(rig.counters.dropped.get(), 2);
    assert_eq!(
        rig.events(),
        [Outcome::Connected(BrokerLimits {
            maximum_packet_bytes: Some(100),
            retains: false
        })]
    );
}

#[tokio::test]
async fn the_properties_of_mqtt_5_go_both_ways() {
    let version = MqttVersion::V5;
    let stub = Stub::new(version).await;
    let response = Publication {
        expiry: Some(Duration::from_millis(1500)),
        correlation: Some(vec![0xAB, 0xCD]),
        ..text("answer", "")
    };
    let rig = Rig::greeting(vec![ClientPacket::Publish(response)]);
    let (body, events) = rig
        .run(&stub, version, async {
            let mut peer = stub.welcome().await;
            // Expiry 9 s, response topic "r", correlation 1 2.
            peer.publish(
                "ask",
                b"!",
                &[0x02, 0, 0, 0, 9, 0x08, 0, 1, b'r', 0x09, 0, 2, 1, 2],
            )
            .await;
            (
                peer.expect(PUBLISH).await.body,
                rig.events_at_least(2).await,
            )
        })
        .await;
    assert_eq!(&body[8..], [10, 0x02, 0, 0, 0, 2, 0x09, 0, 2, 0xAB, 0xCD]);
    let message = Text {
        topic: "ask".to_owned(),
        payload: b"!".to_vec(),
        retain: false,
        duplicate: false,
        expiry: Some(Duration::from_secs(9)),
        response_topic: Some("r".to_owned()),
        correlation: Some(vec![1, 2]),
    };
    assert_eq!(events[1], Outcome::Message(message));
}

#[tokio::test(start_paused = true)]
async fn a_broker_that_wants_no_keep_alive_is_not_flooded_with_pings() {
    let version = MqttVersion::V5;
    let stub = Stub::new(version).await;
    let rig = Rig::default();
    let pings = rig.run(&stub, version, async {
        let mut peer = stub.welcome_on(&[0x13, 0, 0]).await;
        let mut pings = 0;
        let answer = async {
            while peer.read().await.is_some() {
                pings += 1;
                peer.send(0xD0, &[]).await;
            }
        };
        let ended = timeout(Duration::from_secs(21), answer).await;
        assert!(ended.is_err(), "the connection lives");
        pings
    });
    let pings = pings.await;
    assert!((4..=6).contains(&pings), "{pings} in 21 s");
}

#[tokio::test]
async fn a_full_queue_loses_nothing_and_blocks_nothing() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::greeting((0..500).map(with_token).collect());
        rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            rig.events_at_least(1).await;
            // Nothing is acknowledged: 64 go out, 64 wait, and the rest stays with the conversation.
            peer.publish("stop", b"", &[]).await;
            rig.events_at_least(2).await;
            let left = rig.conversation.borrow().packets.len();
            assert!(
                left >= 500 - 2 * usize::from(incident::INFLIGHT_MAX),
                "{version:?}: {left} left"
            );
            acknowledge_all(&mut peer, 500).await;
            assert_eq!(
                acknowledged(&rig.events_at_least(502).await),
                (0..500).collect::<Vec<_>>(),
                "{version:?}"
            );
        })
        .await;
    }
}

#[tokio::test]
async fn what_is_due_while_the_queue_is_full_does_not_make_the_client_spin() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::greeting((0..500).map(with_token).collect());
        rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            rig.events_at_least(1).await;
            rig.conversation.borrow_mut().is_due = true;
            // Received by an idle client.
            peer.publish("stop", b"", &[]).await;
            rig.events_at_least(2).await;
            sleep(Duration::from_millis(300)).await;
            let ticks = rig.conversation.borrow().ticks;
            assert!((2..200).contains(&ticks), "{version:?}: {ticks} ticks");
        })
        .await;
    }
}

async fn acknowledge_all(peer: &mut Peer, count: u64) {
    for token in 0..count {
        let published = peer.published().await;
        assert_eq!(published.payload, token.to_string().into_bytes());
        peer.acknowledge(published.identifier).await;
    }
}

fn rivals(events: &[Outcome]) -> Vec<Option<ClientRival>> {
    events
        .iter()
        .filter_map(|event| {
            if let Outcome::Contested(rival) = event {
                Some(*rival)
            } else {
                None
            }
        })
        .collect()
}

#[tokio::test(start_paused = true)]
async fn a_broker_that_names_a_rival_is_not_fought_over() {
    let version = MqttVersion::V5;
    let stub = Stub::new(version).await;
    let rig = Rig::default();
    let mut connections = 0_usize;
    let taking_turns = async {
        loop {
            let mut peer = stub.welcome().await;
            connections += 1;
            sleep(Duration::from_secs(2)).await;
            // DISCONNECT: session taken over.
            peer.send(0xE0, &[0x8E, 0]).await;
        }
    };
    let ended = rig
        .run(
            &stub,
            version,
            timeout(Duration::from_secs(300), taking_turns),
        )
        .await;
    assert!(ended.is_err());
    // Waits of 1, 2, 4, 8 and 16 s, then of 30 s, and 2 s each: some dozen instead of hundreds.
    assert!((8..=20).contains(&connections), "{connections} in 5 min");
    let rivals = rivals(&rig.events());
    assert!(
        rivals.len() >= connections - 1
            && rivals.iter().all(|it| *it == Some(ClientRival::Reported)),
        "{rivals:?}"
    );
}

#[tokio::test(start_paused = true)]
async fn a_broker_that_only_closes_short_connections_makes_a_rival_suspected_until_one_lives() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let mut connections = 0_usize;
        let taking_turns = async {
            loop {
                drop(stub.welcome().await);
                connections += 1;
            }
        };
        let ended = rig
            .run(
                &stub,
                version,
                timeout(Duration::from_secs(300), taking_turns),
            )
            .await;
        assert!(ended.is_err());
        // Five at once, a dozen with waits of 2 s, then with waits of 1, 2, 4, 8, 16 and 30 s.
        assert!(
            (20..=36).contains(&connections),
            "{version:?}: {connections} in 5 min"
        );
        let suspected = rivals(&rig.events());
        assert!(suspected.len() + 5 >= connections, "{suspected:?}");
        assert!(
            suspected
                .iter()
                .all(|it| *it == Some(ClientRival::Suspected)),
            "{suspected:?}"
        );
        rig.conversation.borrow_mut().events.clear();
        let mut connections = 0_usize;
        let living = async {
            loop {
                let mut peer = stub.welcome().await;
                connections += 1;
                if connections <= 5 {
                    continue;
                }
                while peer.read().await.is_some() {
                    peer.send(0xD0, &[]).await;
                }
            }
        };
        let ended = rig
            .run(&stub, version, timeout(Duration::from_secs(90), living))
            .await;
        assert!(ended.is_err());
        assert_eq!(
            rivals(&rig.events()),
            [Some(ClientRival::Suspected), None],
            "{version:?}"
        );
    }
}

#[tokio::test]
async fn a_broker_that_goes_and_comes_is_no_rival_and_is_found_again_within_a_second_and_a_half() {
    for version in VERSIONS {
        let rig = Rig::default();
        let stub = Stub::new(version).await;
        let address = stub.address();
        let mut stub = Some(stub);
        rig.run_at(address, version, async {
            for _ in 0..4 {
                let listening = stub.take().unwrap();
                drop(
                    timeout(Duration::from_millis(1500), listening.welcome())
                        .await
                        .expect("soon"),
                );
                drop(listening);
                // No broker listens for at least two attempts.
                sleep(Duration::from_millis(1200)).await;
                stub = Some(Stub::at(address, version).await);
            }
        })
        .await;
        assert_eq!(rivals(&rig.events()), [], "{version:?}");
    }
}

#[tokio::test]
async fn a_repeat_is_marked_as_the_broker_marked_it_and_acknowledged_all_the_same() {
    for version in VERSIONS {
        let stub = Stub::new(version).await;
        let rig = Rig::default();
        let events = rig.run(&stub, version, async {
            let mut peer = stub.welcome().await;
            peer.publish_again("again", 77).await;
            assert_eq!(peer.expect(PUBACK).await.body[..2], [0, 77]);
            rig.events_at_least(2).await
        });
        let message = Text {
            topic: "again".to_owned(),
            duplicate: true,
            ..Text::default()
        };
        assert_eq!(events.await[1], Outcome::Message(message), "{version:?}");
    }
}

/// For Sparkplug: tck-id-principles-persistence-clean-session-311, -clean-session-50.
#[tokio::test]
async fn the_subscription_is_asked_for_again_on_every_connection() {
    for version in VERSIONS {
        let filters = filters(&["a/+/set", "b/#"]);
        let stub = Stub::new(version).await;
        let rig = Rig::greeting(vec![ClientPacket::Subscribe(filters)]);
        rig.run(&stub, version, async {
            for _ in 0..3 {
                let mut peer = stub.accept().await;
                let connect = peer.expect(CONNECT).await;
                // Protocol name and level, then the flags: a clean session, or a clean start.
                assert_eq!(
                    connect.body[7] & 0x02,
                    0x02,
                    "{version:?}: the broker keeps nothing for us"
                );
                if version == MqttVersion::V5 {
                    // Without a session expiry interval (0x11) it is 0.
                    let properties = &connect.body[11..11 + usize::from(connect.body[10])];
                    assert!(!properties.contains(&0x11), "{properties:?}");
                }
                peer.answer_connect(&[]).await;
                assert!(
                    peer.expect(SUBSCRIBE)
                        .await
                        .body
                        .ends_with(&[b'#', options_of(version)])
                );
            }
        })
        .await;
    }
}

/// QoS 1; with MQTT 5 the retain flag as published, and no retained messages.
const fn options_of(version: MqttVersion) -> u8 {
    match version {
        MqttVersion::V4 => 0x01,
        MqttVersion::V5 => 0x01 | 0x08 | 0x20,
    }
}

#[tokio::test]
async fn an_answer_to_a_subscription_that_has_too_few_or_too_many_codes_is_reported_as_it_is() {
    for version in VERSIONS {
        for codes in [&[1][..], &[1, 1, 1]] {
            let filters = filters(&["a/+/set", "b/#"]);
            let stub = Stub::new(version).await;
            let rig = Rig::greeting(vec![ClientPacket::Subscribe(filters)]);
            let events = rig.run(&stub, version, async {
                let mut peer = stub.welcome().await;
                let subscribe = peer.expect(SUBSCRIBE).await;
                peer.answer_subscribe(&subscribe, codes).await;
                rig.events_at_least(2).await
            });
            assert_eq!(
                events.await[1],
                Outcome::Subscribed(vec![true; codes.len()]),
                "{version:?}"
            );
        }
    }
}

#[tokio::test]
async fn it_talks_with_the_broker_for_trying_out() {
    let listening = broker::listen("127.0.0.1:0".parse().unwrap())
        .await
        .unwrap();
    let address = listening.address();
    tokio::spawn(listening.serve());
    for version in VERSIONS {
        let rig = Rig::greeting(vec![
            ClientPacket::Subscribe(filters(&["record"])),
            with_token(5),
        ]);
        let events = rig.run_at(address, version, rig.events_at_least(4)).await;
        assert!(
            events.contains(&Outcome::Subscribed(vec![true])),
            "{version:?}: {events:?}"
        );
        assert!(
            events.contains(&Outcome::Acknowledged(5)),
            "{version:?}: {events:?}"
        );
        let message = Text {
            topic: "record".to_owned(),
            payload: b"5".to_vec(),
            ..Text::default()
        };
        assert!(
            events.contains(&Outcome::Message(message)),
            "{version:?}: {events:?}"
        );
    }
}

#[tokio::test]
async fn what_is_retained_in_the_broker_for_trying_out_stays_and_the_will_comes() {
    let listening = broker::listen("127.0.0.1:0".parse().unwrap())
        .await
        .unwrap();
    let address = listening.address();
    tokio::spawn(listening.serve());
    let kept = Publication {
        retain: true,
        qos: Qos::AtLeastOnce,
        token: Some(1),
        ..text("kept", "value")
    };
    let watcher = Rig::greeting(vec![ClientPacket::Subscribe(filters(&["kept", "will"]))]);
    let writer = Rig::greeting(vec![ClientPacket::Publish(kept)]);
    // Dropped without a farewell, so that its will is published.
    writer
        .run_at(address, MqttVersion::V5, writer.events_at_least(2))
        .await;
    let again = Rig::default();
    let mut events = watcher
        .run_at(address, MqttVersion::V4, async {
            watcher.events_at_least(3).await;
            again
                .run_at(address, MqttVersion::V5, again.events_at_least(1))
                .await;
            watcher.events_at_least(4).await
        })
        .await;
    events.retain(|event| matches!(event, Outcome::Message(_)));
    let kept = Text {
        topic: "kept".to_owned(),
        payload: b"value".to_vec(),
        retain: true,
        ..Text::default()
    };
    assert_eq!(events[0], Outcome::Message(kept));
    assert!(matches!(&events[1], Outcome::Message(message) if message.topic == "will"));
}
