//! The life of a session: birth, probe, reconnects, events.

use super::harness::{
    BrokerSession, Rig, SessionAct, message, on, publications, published_texts, results, settings,
};
use super::types::LeaseMode;
use crate::domain::command::{Outcome, Reason};
use crate::domain::ids::DriveIndex;
use crate::drive::description::DriveRef;
use crate::drive::view::{TripEvent, TripEventKind, TripRecord};
use crate::north::broker::{BrokerEvent, BrokerLimits, MqttVersion, Publication, Qos, ToLine};
use serde_json::{Value, json};
use std::time::Duration;

fn topics(acts: &[SessionAct]) -> Vec<String> {
    published_texts(acts)
        .into_iter()
        .map(|(topic, _)| topic)
        .collect()
}

fn has_probe(acts: &[SessionAct]) -> bool {
    acts.iter().any(
        |act| matches!(act, SessionAct::Publish(it) if it.topic == "vfd/plant/probe" && !it.retain),
    )
}

fn subscribe(rig: &mut Rig) -> usize {
    rig.handle(BrokerEvent::Connected(rig.broker));
    match &rig.acts_without_echo()[..] {
        [SessionAct::Subscribe(filters)] => filters.len(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn nothing_is_said_before_the_subscription_and_the_probe() {
    let mut rig = Rig::new(MqttVersion::V5);
    rig.poll(0, 3_000);
    assert_eq!(rig.acts_without_echo(), [], "no connection");
    let filters = subscribe(&mut rig);
    assert_eq!(rig.acts_without_echo(), []);
    rig.handle(BrokerEvent::Subscribed(vec![true; filters]));
    let acts = rig.acts_without_echo();
    assert_eq!(acts[0], SessionAct::ToLine(ToLine::PathOpened));
    assert!(acts.len() == 2 && has_probe(&acts));
    assert!(!rig.session.is_path_alive(rig.at()));
    let SessionAct::Publish(Publication { payload, .. }) = &acts[1] else {
        panic!()
    };
    rig.handle(BrokerEvent::Message(message("vfd/plant/probe", payload)));
    let acts = rig.acts_without_echo();
    assert_eq!(acts[0], SessionAct::ToLine(ToLine::PathAlive));
    assert!(rig.session.is_path_alive(rig.at()));
    let topics = topics(&acts);
    assert_eq!(
        (topics[0].as_str(), topics[topics.len() - 1].as_str()),
        ("info", "status")
    );
}

#[test]
fn a_birth_says_everything_once_and_online_last() {
    let mut rig = Rig::new(MqttVersion::V5);
    rig.poll(0, 3_000);
    let acts = rig.connect();
    let expected = [
        ("line/hall/status", "up"),
        ("drive/pump/availability", "online"),
        ("drive/pump/run/state", "stopped"),
        ("drive/pump/frequency/output", "30.00"),
        ("drive/pump/frequency/setpoint", "40.00"),
        ("drive/pump/measure/frequency_source", "3"),
        ("drive/pump/measure/run_source", "3"),
        ("drive/pump/control/owner", ""),
        ("drive/pump/trip/active", "false"),
        ("drive/pump/trip/code", "0"),
        ("drive/pump/trip/text", ""),
        ("drive/pump/trip/count", "2"),
        ("drive/fan/availability", "offline"),
        ("drive/fan/run/state", "unknown"),
        ("drive/fan/frequency/output", ""),
        ("drive/fan/trip/active", ""),
        ("status", "online"),
    ];
    for (topic, payload) in expected {
        assert_eq!(on(&acts, topic).as_deref(), Some(payload), "{topic}");
    }
    let mut topics = topics(&acts);
    let count = topics.len();
    topics.sort();
    topics.dedup();
    assert_eq!(topics.len(), count, "each topic once");
    assert!(publications(&acts).iter().all(|it| it.retain));
    assert_eq!(rig.acts(), [], "and then nothing");
}

#[test]
fn only_version_5_lets_telemetry_expire() {
    for (version, expected) in [
        (MqttVersion::V5, Some(Duration::from_secs(180))),
        (MqttVersion::V4, None),
    ] {
        let mut rig = Rig::new(version);
        rig.poll(0, 3_000);
        let acts = rig.connect();
        for it in publications(&acts) {
            let is_lasting = it.payload.is_empty() || it.topic.ends_with("/info");
            assert_eq!(
                it.expiry,
                if is_lasting { None } else { expected },
                "{}",
                it.topic
            );
        }
    }
}

#[test]
fn filters_are_narrow_and_catch_nothing_of_ours() {
    let mut rig = Rig::new(MqttVersion::V5);
    rig.poll(0, 3_000);
    let acts = rig.connect();
    let SessionAct::Subscribe(filters) = &acts[0] else {
        panic!()
    };
    assert!(filters.iter().all(|filter| !filter.path.contains('#')));
    let retained: Vec<_> = filters
        .iter()
        .filter(|filter| filter.wants_retained)
        .map(|it| it.path.as_str())
        .collect();
    assert_eq!(retained, ["home/status"]);
    let matches = |filter: &str, topic: &str| {
        let (filter, topic): (Vec<_>, Vec<_>) =
            (filter.split('/').collect(), topic.split('/').collect());
        filter.len() == topic.len()
            && filter
                .iter()
                .zip(&topic)
                .all(|(filter, level)| *filter == "+" || filter == level)
    };
    for it in publications(&acts) {
        assert!(
            !filters
                .iter()
                .any(|filter| matches(&filter.path, &it.topic)),
            "{}",
            it.topic
        );
    }
}

#[test]
fn an_alive_topic_that_is_not_granted_is_done_without() {
    let mut rig = Rig::new(MqttVersion::V5);
    let filters = subscribe(&mut rig);
    let mut granted = vec![true; filters];
    granted[filters - 1] = false;
    rig.handle(BrokerEvent::Subscribed(granted));
    assert!(has_probe(&rig.acts_without_echo()));
    assert_eq!(
        (
            rig.session.counters().alive_refused,
            rig.session.counters().reconnects
        ),
        (1, 0)
    );
}

#[test]
fn a_filter_that_is_not_granted_asks_for_a_new_connection() {
    for missing in [true, false] {
        let mut rig = Rig::new(MqttVersion::V5);
        let filters = subscribe(&mut rig);
        let mut granted = vec![true; filters - usize::from(missing)];
        granted[3] = missing;
        rig.handle(BrokerEvent::Subscribed(granted));
        assert!(matches!(rig.acts()[..], [SessionAct::Reconnect(_)]));
        assert_eq!(rig.pass(100_000), [], "once, and nothing after it");
        assert_eq!(rig.session.counters().reconnects, 1);
    }
}

#[test]
fn a_lost_probe_ends_the_connection_and_the_heartbeats() {
    let mut rig = Rig::born(MqttVersion::V5);
    let alive = |acts: &[SessionAct]| {
        acts.iter()
            .filter(|act| **act == SessionAct::ToLine(ToLine::PathAlive))
            .count()
    };
    let acts = rig.pass(20_000);
    assert_eq!(alive(&acts), 4, "one for each probe");
    // The next probe is due 5 s later and does not return.
    rig.millis += 5_000;
    rig.session.tick(rig.at());
    let mut acts = rig.acts_without_echo();
    assert!(has_probe(&acts));
    for _ in 0..20 {
        rig.millis += 1_000;
        rig.session.tick(rig.at());
        acts.extend(rig.acts_without_echo());
    }
    assert_eq!(alive(&acts), 0);
    assert_eq!(
        acts.iter()
            .filter(|act| matches!(act, SessionAct::Reconnect(_)))
            .count(),
        1
    );
    assert!(!rig.session.is_path_alive(rig.at()));
    assert_eq!(rig.session.counters().probes_lost, 1);
    let acts = rig.connect();
    assert_eq!(
        on(&acts, "status").as_deref(),
        Some("online"),
        "a new birth"
    );
    assert_eq!(
        (alive(&acts), on(&acts, "drive/pump/run/state").is_some()),
        (0, true)
    );
    assert_eq!(alive(&rig.pass(5_000)), 1, "when the way has stayed open");
}

#[test]
fn commanders_that_are_gone_give_no_sign_of_life() {
    let mut rig = Rig::born(MqttVersion::V5);
    for (payload, expected) in [
        (&b" Offline"[..], false),
        (b"online", true),
        (b"offline", false),
        (b"", true),
    ] {
        rig.deliver(&message("home/status", payload));
        assert_eq!(
            rig.pass(5_000)
                .contains(&SessionAct::ToLine(ToLine::PathAlive)),
            expected
        );
    }
    rig.deliver(&message("home/status", b"offline"));
    rig.handle(BrokerEvent::Lost);
    assert!(
        !rig.connect()
            .contains(&SessionAct::ToLine(ToLine::PathAlive)),
        "until the alive topic says otherwise"
    );
}

#[test]
fn explicit_leases_live_on_commands_only() {
    let mut rig = Rig::with(super::types::Settings {
        lease: LeaseMode::Explicit,
        ..settings(MqttVersion::V5)
    });
    let acts = rig.connect();
    assert!(
        acts.contains(&SessionAct::ToLine(ToLine::PathOpened))
            && !acts.contains(&SessionAct::ToLine(ToLine::PathAlive))
    );
    assert!(
        !rig.pass(30_000)
            .contains(&SessionAct::ToLine(ToLine::PathAlive))
    );
}

#[test]
fn retained_or_foreign_probes_prove_nothing() {
    let mut rig = Rig::new(MqttVersion::V5);
    let filters = subscribe(&mut rig);
    rig.handle(BrokerEvent::Subscribed(vec![true; filters]));
    let acts = rig.acts_without_echo();
    let Some(SessionAct::Publish(probe)) = acts.last() else {
        panic!()
    };
    rig.handle(BrokerEvent::Message(crate::north::broker::BrokerMessage {
        retain: true,
        ..message("vfd/plant/probe", &probe.payload)
    }));
    let text = String::from_utf8(probe.payload.clone()).unwrap();
    let guessed = [
        format!("{}-1", rig.at().wall.unix_ms),
        text.replacen('1', "2", 1),
        text.replace('-', ""),
    ];
    for payload in guessed.iter().map(String::as_bytes) {
        rig.handle(BrokerEvent::Message(message("vfd/plant/probe", payload)));
    }
    assert_eq!(rig.acts_without_echo(), []);
}

#[test]
fn will_and_farewell_say_offline() {
    let mut rig = Rig::born(MqttVersion::V5);
    let will = rig.session.will();
    assert_eq!(
        (will.topic.as_str(), &will.payload[..]),
        ("vfd/plant/status", &b"offline"[..])
    );
    assert!(will.retain && will.qos == Qos::AtLeastOnce);
    let farewell: Vec<_> = rig
        .session
        .farewell(rig.at())
        .into_iter()
        .map(SessionAct::Publish)
        .collect();
    let expected = [
        "drive/pump/availability",
        "drive/fan/availability",
        "status",
    ];
    assert_eq!(
        published_texts(&farewell),
        expected.map(|topic| (topic.to_owned(), "offline".to_owned()))
    );
}

fn trip(rig: &mut Rig, trips: u16) {
    let record = TripRecord {
        at: rig.now(),
        code: Some(9),
        words: vec![
            (0x0113_u16.into(), 9),
            (0x0115_u16.into(), 123),
            (0x0999_u16.into(), 1),
        ],
    };
    let event = TripEvent {
        kind: TripEventKind::Tripped { trips, record },
        count: Some(3),
        at: rig.now(),
        while_away: false,
    };
    let place = DriveRef {
        line: 0,
        drive: DriveIndex(0),
    };
    rig.session.trip(rig.at(), place, &event);
}

fn events(acts: &[SessionAct]) -> Vec<(u64, Value)> {
    let events = publications(acts)
        .into_iter()
        .filter(|it| it.topic.ends_with("trip/event"));
    let parts = |it: &Publication| {
        assert!(!it.retain && it.qos == Qos::AtLeastOnce);
        (
            it.token.expect("a token"),
            serde_json::from_slice(&it.payload).expect("JSON"),
        )
    };
    events.map(parts).collect()
}

#[test]
fn an_event_says_what_was_measured() {
    let mut rig = Rig::born(MqttVersion::V5);
    trip(&mut rig, 2);
    let cleared = TripEvent {
        kind: TripEventKind::Cleared,
        count: None,
        at: rig.now(),
        while_away: false,
    };
    rig.session.trip(
        rig.at(),
        DriveRef {
            line: 0,
            drive: DriveIndex(0),
        },
        &cleared,
    );
    rig.session.trip(
        rig.at(),
        DriveRef {
            line: 7,
            drive: DriveIndex(0),
        },
        &cleared,
    );
    let events = events(&rig.acts());
    let tripped = json!({
        "seq": 1, "session": "1767225600000", "drive": "pump", "kind": "tripped", "trips": 2, "count": 3, "code": 9,
        "text": "code 9",
        "at": "2026-01-01T00:00:00.000Z",
        "while_away": false,
        "values": {
            "trip_cause": { "value": 9.0, "unit": null },
            "trip_current": { "value": 12.3, "unit": "A" },
            "0x0999": { "value": 1, "unit": null },
        },
    });
    assert_eq!(events[0].1, tripped);
    assert_eq!(
        (events.len(), &events[1].1["kind"], &events[1].1["seq"]),
        (2, &json!("cleared"), &json!(2))
    );
}

#[test]
fn events_come_in_order_and_again_after_a_reconnect_until_acknowledged() {
    let mut rig = Rig::new(MqttVersion::V5);
    (0..20).for_each(|_| trip(&mut rig, 1));
    let tokens = |acts: &[SessionAct]| {
        events(acts)
            .into_iter()
            .map(|(token, _)| token)
            .collect::<Vec<_>>()
    };
    assert_eq!(
        tokens(&rig.connect()),
        (1..=16).collect::<Vec<_>>(),
        "no more than 16 in flight"
    );
    rig.handle(BrokerEvent::Acknowledged(1));
    assert_eq!(tokens(&rig.acts()), [17]);
    assert_eq!(rig.session.counters().events_waiting, 19);
    rig.handle(BrokerEvent::Lost);
    assert_eq!(rig.acts(), []);
    assert_eq!(tokens(&rig.connect()), (2..=17).collect::<Vec<_>>());
    for token in 2..=20 {
        rig.handle(BrokerEvent::Acknowledged(token));
        rig.acts();
    }
    assert_eq!(rig.session.counters().events_waiting, 0);
    rig.handle(BrokerEvent::Lost);
    assert_eq!(tokens(&rig.connect()), [0; 0]);
}

#[test]
fn a_full_queue_of_events_counts_and_reports_what_it_lost() {
    let mut rig = Rig::new(MqttVersion::V5);
    (0..1_030).for_each(|_| trip(&mut rig, 1));
    assert_eq!(rig.session.counters().events_dropped, 6);
    let first = &events(&rig.connect())[0].1;
    assert_eq!((&first["seq"], &first["lost"]), (&json!(7), &json!(6)));
}

#[test]
fn what_the_broker_does_not_take_is_not_sent() {
    let mut rig = Rig::new(MqttVersion::V5);
    rig.broker = BrokerLimits {
        maximum_packet_bytes: Some(200),
        retains: true,
    };
    trip(&mut rig, 1);
    let acts = rig.connect();
    assert!(
        publications(&acts)
            .iter()
            .all(|it| it.topic.len() + it.payload.len() <= 200)
    );
    assert!(on(&acts, "drive/pump/info").is_none() && on(&acts, "status").is_some());
    assert!(rig.session.counters().too_large > 0);
    assert_eq!(
        rig.session.counters().events_waiting,
        0,
        "it would never go"
    );

    let mut rig = Rig::new(MqttVersion::V5);
    rig.broker.retains = false;
    let acts = rig.connect();
    assert!(
        publications(&acts)
            .iter()
            .all(|it| !it.retain && !it.payload.is_empty())
    );
}

#[test]
fn results_wait_for_the_connection() {
    let mut rig = Rig::born(MqttVersion::V5);
    rig.handle(BrokerEvent::Lost);
    assert_eq!(
        publications(&rig.send("drive/pump/run/set", b"bad")),
        [] as [&Publication; 0]
    );
    let acts = rig.connect();
    assert_eq!(results(&acts).len(), 1);
}

#[test]
fn a_way_that_is_open_for_moments_only_keeps_no_lease() {
    let mut rig = Rig::with(super::types::Settings {
        probe_interval: Duration::from_secs(1),
        ..super::harness::settings(MqttVersion::V4)
    });
    let alive = |acts: &[SessionAct]| {
        acts.iter()
            .filter(|act| **act == SessionAct::ToLine(ToLine::PathAlive))
            .count()
    };
    assert_eq!(alive(&rig.connect()), 1, "the first connection");
    assert_eq!(alive(&rig.pass(10_000)), 10);
    for lives_ms in [900, 100, 2_900, 4_900, 0] {
        rig.handle(BrokerEvent::Lost);
        rig.millis += 1_000;
        let mut acts = rig.connect();
        acts.extend(rig.pass(lives_ms));
        assert_eq!(alive(&acts), 0, "{lives_ms} ms");
    }
    rig.handle(BrokerEvent::Lost);
    let mut acts = rig.connect();
    acts.extend(rig.pass(10_000));
    assert_eq!(alive(&acts), 6, "from the fifth second on");
}

#[test]
fn what_is_larger_than_the_broker_takes_is_named_and_no_document_grows_with_the_drives() {
    let mut rig = Rig::new(MqttVersion::V4);
    rig.poll(0, 3_000);
    rig.broker = BrokerLimits {
        maximum_packet_bytes: Some(1_000),
        retains: true,
    };
    let acts = rig.connect();
    for topic in [
        "info",
        "drive/pump/info",
        "line/hall/stats",
        "drive/pump/availability",
        "status",
    ] {
        assert!(on(&acts, topic).is_some(), "{topic}");
    }
    assert!(
        publications(&acts)
            .iter()
            .all(|it| it.topic.len() + it.payload.len() <= 1_000)
    );
    assert_eq!(on(&acts, "drive/pump/state"), None);
    let named: Vec<_> = rig
        .session
        .oversized()
        .iter()
        .map(|it| (it.topic.as_str(), it.limit))
        .collect();
    assert_eq!(
        named,
        [("vfd/plant/drive/pump/state", 1_000)],
        "the fan has never answered"
    );
    assert!(rig.session.oversized().iter().all(|it| it.bytes > 1_000));
    let notices = |rig: &mut Rig| std::iter::from_fn(|| rig.session.next_notice()).count();
    assert_eq!(notices(&mut rig), 1);
    rig.pass(130_000);
    assert_eq!(
        (notices(&mut rig), rig.session.oversized().len()),
        (0, 1),
        "once"
    );
}

#[test]
fn clients_that_are_gone_are_named_in_the_result_of_a_run() {
    let mut rig = Rig::born(MqttVersion::V5);
    assert_eq!(rig.session.clients_gone(), None);
    rig.deliver(&message("home/status", b"offline"));
    assert_eq!(rig.session.clients_gone(), Some("home/status"));
    for (payload, is_named) in [("forward", true), ("stop", false)] {
        let acts = rig.send("drive/pump/run/set", payload.as_bytes());
        let ticket = super::harness::commands(&acts)[0].ticket;
        let result =
            &super::harness::results(&rig.answer(ticket, Outcome::Confirmed, Reason::None, true))
                [0];
        let said = result["message"].as_str().unwrap_or_default();
        assert_eq!(
            said.contains("`home/status` says") && said.contains("lost_after"),
            is_named,
            "{result}"
        );
    }
    rig.deliver(&message("home/status", b"online"));
    assert_eq!(rig.session.clients_gone(), None);
}
