//! The session as one of two gateways of the same name.

use super::harness::{
    BrokerSession, Rig, SessionAct, commands, identity, kept, message, name, on, orders,
    publications, published_texts, results, settings,
};
use super::types::{GatewayIdentity, HomeAssistant, Settings};
use crate::domain::command::{Order, Outcome, Reason};
use crate::domain::ids::DriveIndex;
use crate::domain::standby::{LineRole, StandbyPair, StandbyReport, StandbyTrouble};
use crate::drive::description::DriveRef;
use crate::drive::view::{TripEvent, TripEventKind, TripRecord};
use crate::journal::StoredEvent;
use crate::north::broker::{BrokerEvent, MqttVersion, Publication};
use serde_json::{Value, json};

pub(super) fn report(role: LineRole) -> StandbyReport {
    let hears_other = role == LineRole::Listening;
    StandbyReport {
        role,
        take_overs: 0,
        given_up: 0,
        rivals: 0,
        hears_other,
        listener: None,
        kept: 0,
        trouble: StandbyTrouble::default(),
    }
}

pub(super) fn pair(half: &str, partner: &str) -> StandbyPair {
    StandbyPair {
        half: name(half),
        partner: name(partner),
        rank: 0,
        take_over_after: None,
    }
}

pub(super) fn one_of_two(half: &str, partner: &str) -> GatewayIdentity {
    GatewayIdentity {
        standby: Some(pair(half, partner)),
        ..identity()
    }
}

fn half_with(settings: Settings, role: LineRole) -> Rig {
    let mut rig = Rig::as_gateway(one_of_two("b", "a"), settings);
    rig.lines[0].report.standby = Some(report(role));
    rig.poll(0, 3_000);
    rig
}

/// The half `b` of two on the line `hall`.
fn half(role: LineRole) -> Rig {
    half_with(settings(MqttVersion::V5), role)
}

fn connected(role: LineRole) -> Rig {
    let mut rig = half(role);
    rig.connect();
    rig
}

fn set(rig: &mut Rig, role: LineRole) -> Vec<SessionAct> {
    rig.lines[0].report.standby = Some(report(role));
    rig.acts()
}

fn topics(acts: &[SessionAct]) -> Vec<String> {
    published_texts(acts)
        .into_iter()
        .map(|(topic, _)| topic)
        .collect()
}

#[test]
fn a_listener_tells_of_itself_and_of_nothing_else() {
    let mut rig = half(LineRole::Listening);
    let acts = rig.connect();
    assert_eq!(topics(&acts), ["standby/b"]);
    let document: Value = serde_json::from_str(&on(&acts, "standby/b").unwrap()).unwrap();
    let line = json!({
        "name": "hall", "role": "listening", "take_overs": 0, "given_up": 0, "rivals": 0, "hears_other": true, "listener": null,
    });
    assert_eq!(
        document,
        json!({ "half": "b", "partner": "a", "online": true, "lines": [line] })
    );
    assert!(publications(&acts)[0].retain);
    rig.poll(0, 4_000);
    assert_eq!(topics(&rig.acts()), [""; 0]);
    assert_eq!(topics(&rig.pass(61_000)), ["standby/b"], "the heartbeat");
}

#[test]
fn who_becomes_active_publishes_everything_and_says_online_last() {
    let mut rig = connected(LineRole::Listening);
    let acts = set(&mut rig, LineRole::Active);
    let all = topics(&acts);
    assert_eq!(all.last().map(String::as_str), Some("status"), "{all:?}");
    for (topic, payload) in [
        ("status", Some("online")),
        ("line/hall/active", Some("b")),
        ("drive/pump/availability", Some("online")),
        ("drive/pump/frequency/output", Some("30.00")),
    ] {
        assert_eq!(on(&acts, topic).as_deref(), payload, "{topic}");
    }
    assert!(
        ["info", "drive/fan/state", "line/hall/stats"]
            .iter()
            .all(|it| all.iter().any(|topic| topic == it))
    );
    let document: Value = serde_json::from_str(&on(&acts, "standby/b").unwrap()).unwrap();
    assert_eq!(document["lines"][0]["role"], "active");
    // Who gives the line up publishes nothing of it any more.
    let acts = set(&mut rig, LineRole::Listening);
    assert_eq!(topics(&acts), ["standby/b"]);
    rig.poll(0, 1_000);
    assert_eq!(topics(&rig.pass(61_000)), ["standby/b"]);
    let again = set(&mut rig, LineRole::Active);
    assert_eq!(
        on(&again, "drive/pump/frequency/output").as_deref(),
        Some(""),
        "a minute old"
    );
    assert_eq!(on(&again, "status").as_deref(), Some("online"));
}

#[test]
fn the_end_of_another_never_hides_this_one() {
    for version in [MqttVersion::V4, MqttVersion::V5] {
        let mut rig = half_with(settings(version), LineRole::Active);
        rig.connect();
        let acts = rig.send("status", b"offline");
        let texts = published_texts(&acts);
        assert_eq!(
            texts
                .last()
                .map(|(topic, payload)| (topic.as_str(), payload.as_str())),
            Some(("status", "online"))
        );
        assert!(
            texts.iter().any(|(topic, _)| topic == "standby/b"),
            "{texts:?}"
        );
        assert_eq!(
            topics(&rig.send("status", b"online")),
            [""; 0],
            "its own words come back"
        );
    }
    // A listener says only that it is there: the gateway is not.
    let mut rig = connected(LineRole::Listening);
    assert_eq!(topics(&rig.send("status", b"offline")), ["standby/b"]);
}

#[test]
fn a_listener_leaves_commands_to_the_active_one() {
    let mut rig = connected(LineRole::Listening);
    rig.send(
        "standby/a",
        br#"{"half": "a", "online": true, "lines": [{"name": "hall", "role": "active"}]}"#,
    );
    for (topic, payload) in [
        ("drive/pump/run/set", &b"forward"[..]),
        ("drive/pump/run/set", b"stop"),
        ("drive/pump/run/set", b"sideways"),
        ("drive/pump/frequency/set", b"20.0"),
        ("drive/pump/command", br#"{"id": 1, "run": "stop"}"#),
        ("drive/pump/param/F007/get", b""),
        ("drive/pump/lease", b""),
        ("by/plc/drive/pump/run/set", b"stop"),
        ("drive/lift/run/set", b"stop"),
        ("all/run/set", b"stop"),
        ("all/run/set", b"go"),
    ] {
        let acts = rig.send(topic, payload);
        assert!(
            commands(&acts).is_empty() && kept(&acts).is_empty(),
            "{topic}"
        );
        assert!(
            publications(&acts).is_empty(),
            "{topic}: {:?}",
            published_texts(&acts)
        );
    }
}

#[test]
fn a_stop_that_no_one_else_may_hear_goes_to_the_line() {
    let mut rig = half(LineRole::Listening);
    rig.lines[0].report.standby = Some(StandbyReport {
        hears_other: false,
        ..report(LineRole::Listening)
    });
    rig.connect();
    let acts = rig.send("drive/pump/run/set", b"stop");
    assert_eq!(orders(&acts), [&Order::Stop { setpoint: None }]);
    let ticket = commands(&acts)[0].ticket;
    let acts = rig.answer(ticket, Outcome::Refused, Reason::Standby, true);
    assert!(results(&acts).is_empty(), "the other one may answer");
    assert_eq!(
        orders(&rig.send("all/run/set", b"stop")),
        [&Order::Stop { setpoint: None }]
    );
    assert!(commands(&rig.send("drive/pump/run/set", b"forward")).is_empty());
}

#[test]
fn a_stop_is_not_left_to_a_foreign_master() {
    let mut rig = connected(LineRole::Listening);
    rig.send(
        "standby/a",
        br#"{"half": "a", "online": true, "lines": [{"name": "hall", "role": "listening"}]}"#,
    );
    assert_eq!(
        orders(&rig.send("drive/pump/run/set", b"stop")),
        [&Order::Stop { setpoint: None }]
    );
    assert_eq!(
        orders(&rig.send("all/run/set", b"stop")),
        [&Order::Stop { setpoint: None }]
    );
    assert!(commands(&rig.send("drive/pump/run/set", b"forward")).is_empty());
}

#[test]
fn a_command_that_the_line_left_to_another_is_a_new_one_later() {
    let mut rig = connected(LineRole::Active);
    let command = br#"{"id": "one", "run": "forward"}"#;
    let acts = rig.send("drive/pump/command", command);
    let acts = rig.answer(
        commands(&acts)[0].ticket,
        Outcome::Refused,
        Reason::Standby,
        true,
    );
    assert!(results(&acts).is_empty());
    let acts = rig.send("drive/pump/command", command);
    assert_eq!(commands(&acts).len(), 1, "its id is not used up");
    let acts = rig.answer(
        commands(&acts)[0].ticket,
        Outcome::Unknown,
        Reason::Standby,
        true,
    );
    assert_eq!(results(&acts).len(), 1, "what was tried is answered");
}

pub(super) fn trip(rig: &mut Rig) {
    let words = vec![(0x0113_u16.into(), 9), (0x0115_u16.into(), 123)];
    let record = TripRecord {
        at: rig.now(),
        code: Some(9),
        words,
    };
    let kind = TripEventKind::Tripped { trips: 1, record };
    let event = TripEvent {
        kind,
        count: Some(3),
        at: rig.now(),
        while_away: false,
    };
    rig.session.trip(
        rig.at(),
        DriveRef {
            line: 0,
            drive: DriveIndex(0),
        },
        &event,
    );
}

fn events(acts: &[SessionAct]) -> Vec<&Publication> {
    publications(acts)
        .into_iter()
        .filter(|it| it.topic.ends_with("trip/event"))
        .collect()
}

/// The trip as the other gateway publishes it.
fn published_by_the_other(count: u16) -> Vec<u8> {
    json!({ "drive": "pump", "kind": "tripped", "count": count, "code": 9, "seq": 77, "session": "of a" })
        .to_string()
        .into_bytes()
}

#[test]
fn a_trip_that_both_saw_is_published_once() {
    for is_heard_first in [false, true] {
        let mut rig = connected(LineRole::Listening);
        if is_heard_first {
            rig.send("drive/pump/trip/event", &published_by_the_other(3));
        }
        trip(&mut rig);
        assert!(events(&rig.acts()).is_empty());
        if !is_heard_first {
            assert_eq!(rig.session.counters().events_waiting, 1);
            rig.send("drive/pump/trip/event", &published_by_the_other(2));
            assert_eq!(rig.session.counters().events_waiting, 1, "another trip");
            rig.send("drive/pump/trip/event", &published_by_the_other(3));
        }
        assert_eq!(rig.session.counters().events_waiting, 0);
        set(&mut rig, LineRole::Active);
        assert!(events(&rig.pass(10_000)).is_empty());
    }
}

#[test]
fn a_trip_that_the_other_did_not_publish_is_published_after_the_line_was_taken_over() {
    let mut rig = connected(LineRole::Listening);
    trip(&mut rig);
    rig.acts();
    assert!(
        events(&set(&mut rig, LineRole::Active)).is_empty(),
        "what the other texts may still be on its way"
    );
    assert!(events(&rig.pass(999)).is_empty());
    let acts = rig.pass(1);
    assert_eq!(events(&acts).len(), 1);
    // Its own words come back and are not taken for another's.
    let own = events(&acts)[0].payload.clone();
    rig.send("drive/pump/trip/event", &own);
    trip(&mut rig);
    assert_eq!(events(&rig.acts()).len(), 1);
}

#[test]
fn what_the_broker_retains_when_it_connects_was_published() {
    for code in [9, 8] {
        let mut rig = half(LineRole::Active);
        trip(&mut rig);
        let values = json!({ "trip_cause": { "value": 9.0, "unit": null }, "trip_current": { "value": 12.3, "unit": "A" } });
        let last =
            json!({ "at": "before", "code": code, "text": "x", "values": values }).to_string();
        rig.handle(BrokerEvent::Connected(rig.broker));
        rig.acts();
        rig.handle(BrokerEvent::Subscribed(vec![true; 24]));
        rig.handle(BrokerEvent::Message(message(
            "vfd/plant/drive/pump/trip/last",
            last.as_bytes(),
        )));
        assert_eq!(rig.session.counters().events_waiting, u64::from(code != 9));
    }
}

#[test]
fn stored_events_that_another_published_are_done() {
    let mut rig = connected(LineRole::Listening);
    let body = |seq: u64, count: u16| json!({ "drive": "pump", "kind": "tripped", "count": count, "code": 9, "seq": seq, "session": "of b" });
    let stored = |seq, count| StoredEvent {
        seq,
        drive: name("pump"),
        body: body(seq, count).to_string(),
    };
    rig.send("drive/pump/trip/event", &published_by_the_other(3));
    rig.session
        .stored_events(rig.at(), &[stored(1, 3), stored(2, 4)], false);
    let acts = rig.acts();
    assert!(
        acts.contains(&SessionAct::EventTaken(1)) && !acts.contains(&SessionAct::EventTaken(2)),
        "{acts:?}"
    );
    assert!(events(&acts).is_empty());
    let acts = rig.send("drive/pump/trip/event", &published_by_the_other(4));
    assert!(acts.contains(&SessionAct::EventTaken(2)), "{acts:?}");
    // Events of its own journal are no one else's.
    rig.session.stored_events(rig.at(), &[stored(3, 5)], false);
    rig.send("drive/pump/trip/event", body(3, 5).to_string().as_bytes());
    assert_eq!(rig.session.counters().events_waiting, 1);
}

fn other(role: &str) -> Vec<u8> {
    json!({ "half": "a", "online": true, "lines": [{ "name": "hall", "role": role }] })
        .to_string()
        .into_bytes()
}

#[test]
fn it_speaks_again_when_the_one_before_it_has_fallen_silent() {
    let mut rig = connected(LineRole::Listening);
    rig.send("standby/a", &other("active"));
    set(&mut rig, LineRole::Active);
    let acts = rig.send("standby/a", &other("listening"));
    assert_eq!(
        on(&acts, "drive/pump/frequency/output").as_deref(),
        Some("30.00"),
        "an old value may stand there"
    );
    assert!(topics(&rig.send("standby/a", &other("listening"))).is_empty());
}

#[test]
fn another_that_is_missed_is_published_as_offline_unless_it_reports_itself() {
    for is_there in [false, true] {
        let mut rig = connected(LineRole::Listening);
        rig.send("standby/a", &other("active"));
        rig.send("status", b"offline");
        if is_there {
            rig.send("standby/a", &other("active"));
        }
        let acts = rig.pass(6_000);
        let document =
            on(&acts, "standby/a").map(|text| serde_json::from_str::<Value>(&text).unwrap());
        assert_eq!(
            document,
            (!is_there).then(|| json!({ "half": "a", "online": false, "lines": [] }))
        );
    }
    // One that was taken for dead says that it is there.
    let mut rig = connected(LineRole::Active);
    let acts = rig.send(
        "standby/b",
        br#"{"half": "b", "online": false, "lines": []}"#,
    );
    assert_eq!(topics(&acts), ["standby/b"]);
}

#[test]
fn whether_the_partner_is_there_is_counted_by_its_own_words() {
    let online = |rig: &Rig| rig.session.counters().partner_online;
    let mut rig = half(LineRole::Active);
    assert_eq!(online(&rig), None, "no broker");
    rig.connect();
    assert_eq!(online(&rig), Some(false), "nothing of it stands there");
    rig.send("standby/c", &other("listening"));
    assert_eq!(online(&rig), Some(false), "another one");
    rig.send("standby/a", &other("listening"));
    assert_eq!(online(&rig), Some(true));
    // Until it is missed, an end may be that of a third one.
    rig.send("status", b"offline");
    assert_eq!(online(&rig), Some(true));
    rig.pass(6_000);
    assert_eq!(online(&rig), Some(false));
    rig.send("standby/a", &other("active"));
    rig.send(
        "standby/a",
        br#"{"half": "a", "online": false, "lines": []}"#,
    );
    assert_eq!(online(&rig), Some(false), "it has said farewell");
    rig.send("standby/a", &other("active"));
    rig.handle(BrokerEvent::Lost);
    assert_eq!(online(&rig), None);
    let mut alone = Rig::with(settings(MqttVersion::V5));
    alone.connect();
    assert_eq!(online(&alone), None);
}

#[test]
fn the_farewell_takes_back_what_it_spoke_for() {
    let farewell = |rig: &mut Rig| {
        let acts: Vec<_> = rig
            .session
            .farewell(rig.at())
            .into_iter()
            .map(SessionAct::Publish)
            .collect();
        topics(&acts)
    };
    let of_drives = ["drive/pump/availability", "drive/fan/availability"];
    let mut active = connected(LineRole::Active);
    assert_eq!(
        farewell(&mut active),
        [&of_drives[..], &["standby/b", "status"]].concat()
    );
    let mut listener = connected(LineRole::Listening);
    assert_eq!(
        farewell(&mut listener),
        ["standby/b", "status"],
        "no one is known to be active"
    );
    listener.send("standby/a", &other("active"));
    assert_eq!(farewell(&mut listener), ["standby/b"]);
}

#[test]
fn one_of_them_announces_to_home_assistant_and_both_the_same() {
    let with = |role| {
        let home_assistant = HomeAssistant {
            discovery: true,
            prefix: "homeassistant".into(),
            devices: true,
            combined: Vec::new(),
            page: None,
        };
        half_with(
            Settings {
                home_assistant: Some(home_assistant),
                ..settings(MqttVersion::V5)
            },
            role,
        )
    };
    let announced = |acts: &[SessionAct]| -> Vec<(String, String)> {
        published_texts(acts)
            .into_iter()
            .filter(|(topic, _)| topic.starts_with("homeassistant/"))
            .collect()
    };
    let mut rig = with(LineRole::Listening);
    let mut acts = rig.connect();
    acts.extend(rig.pass(20_000));
    assert!(announced(&acts).is_empty());
    let mut acts = set(&mut rig, LineRole::Active);
    acts.extend(rig.pass(20_000));
    let of_b = announced(&acts);
    assert_eq!(of_b.len(), 3, "the gateway and two drives");
    assert!(
        of_b[0].1.contains("\"vfd/plant/line/hall/active\""),
        "{}",
        of_b[0].1
    );
    // The other one, with the names exchanged.
    let mut rig = with(LineRole::Active);
    let home_assistant = rig.session.settings.home_assistant.clone();
    let settings = Settings {
        home_assistant,
        ..settings(MqttVersion::V5)
    };
    rig.session = super::MqttSession::new(
        (one_of_two("a", "b"), settings),
        super::harness::drives(),
        vec![name("hall")],
        rig.at(),
        7,
    );
    let mut acts = rig.connect();
    acts.extend(rig.pass(20_000));
    assert_eq!(announced(&acts), of_b);
}

#[test]
fn what_concerns_no_line_comes_from_the_first_by_name_that_is_active() {
    let mut rig = connected(LineRole::Active);
    let answers = |rig: &mut Rig| {
        ["drive/lift/run/set", "all/run/set"]
            .map(|topic| results(&rig.send(topic, b"sideways")).len())
    };
    rig.send("standby/c", &other("active"));
    assert_eq!(answers(&mut rig), [1, 1]);
    rig.send("standby/a", &other("active"));
    assert_eq!(answers(&mut rig), [0, 0]);
    // One that may be gone counts no longer.
    rig.send("status", b"offline");
    assert_eq!(answers(&mut rig), [1, 1]);
    rig.send("standby/a", &other("active"));
    assert_eq!(answers(&mut rig), [0, 0]);
    rig.handle(BrokerEvent::Lost);
    assert!(
        on(&rig.connect(), "info").is_some(),
        "the next connection reports it, or does not"
    );
    assert_eq!(answers(&mut rig), [1, 1]);
}
