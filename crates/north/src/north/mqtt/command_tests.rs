//! The effects of messages: commands, refusals, results.

use super::harness::{
    BrokerSession, EPOCH_MS, Rig, SessionAct, commands, kept, message, on, orders, publications,
    published_texts, reads, result, results, settings,
};
use super::types::Settings;
use crate::domain::command::{
    Direction, GoOrder, Order, Outcome, Owner, Reason, RegisterWrite, Report,
};
use crate::domain::frequency::Hertz;
use crate::domain::ids::{AskerId, CommanderName};
use crate::domain::native::{NativeAnswer, NativeAsk, NativeOutcome, NativeRefusal};
use crate::domain::time::MonoTime;
use crate::drive::view::ControlView;
use crate::journal::TriedWrite;
use crate::north::broker::{BrokerEvent, BrokerMessage, MqttVersion, Publication, Qos};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::time::Duration;

const STOP: Order = Order::Stop { setpoint: None };

const INPUTS: [(&str, &[u8]); 11] = [
    ("drive/pump/run/set", b"forward"),
    ("drive/pump/frequency/set", b"42.5"),
    ("drive/pump/trip/reset", b"reset"),
    ("drive/pump/command", br#"{"run":"forward"}"#),
    ("drive/pump/lease", b"x"),
    ("drive/pump/param/F007/set", b"10.5"),
    ("drive/pump/param/F007/get", b"x"),
    ("drive/nosuch/run/set", b"stop"),
    ("by/plc-2/drive/pump/run/set", b"forward"),
    ("drive/pump/control/take", b"take"),
    ("all/run/set", b"start"),
];

fn go(registers: Vec<RegisterWrite>, frequency: Option<u32>, run: Option<Direction>) -> Order {
    Order::Go(
        GoOrder::new(registers, frequency.map(Hertz::from_millihertz), run).expect("an order"),
    )
}

/// An order to run, and its effect while no probe returns.
fn run_without_echo(rig: &mut Rig) -> Vec<SessionAct> {
    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/drive/pump/run/set",
        b"forward",
    )));
    rig.acts_without_echo()
}

/// The probe that is sent.
fn probe(acts: &[SessionAct]) -> Publication {
    let is_probe =
        |act: &&SessionAct| matches!(act, SessionAct::Publish(it) if it.topic == "vfd/plant/probe");
    let Some(SessionAct::Publish(probe)) = acts.iter().find(is_probe) else {
        panic!("no probe in {acts:?}")
    };
    probe.clone()
}

fn refused(reason: &str) -> (String, String) {
    ("refused".to_owned(), reason.to_owned())
}

#[test]
fn each_input_becomes_its_order() {
    let acceleration = RegisterWrite::new(0x020C_u16, 105);
    let table: [(&str, &[u8], Order); 14] = [
        (
            "run/set",
            b"forward",
            go(vec![], None, Some(Direction::Forward)),
        ),
        ("run/set", b" STOP ", STOP),
        ("run/set", b"coast", Order::Coast),
        ("frequency/set", b"42.5", go(vec![], Some(42_500), None)),
        ("trip/reset", b"reset", Order::Reset),
        ("control/take", b"take", Order::Take),
        ("lease", b"", Order::Renew),
        // With a byte order mark, as some editors and languages write it.
        (
            "command",
            b"\xEF\xBB\xBF{\"run\":\"reverse\"}",
            go(vec![], None, Some(Direction::Reverse)),
        ),
        (
            "run/set",
            b"\xEF\xBB\xBFforward",
            go(vec![], None, Some(Direction::Forward)),
        ),
        (
            "frequency/set",
            b"\xEF\xBB\xBF42.5",
            go(vec![], Some(42_500), None),
        ),
        // A stop is taken as the word alone.
        ("command", b"stop", STOP),
        ("command", b" \"Coast\"\n", Order::Coast),
        (
            "param/acceleration_time/set",
            b"10.5",
            go(vec![acceleration], None, None),
        ),
        (
            "command",
            br#"{"frequency_hz":5,"param":{"F007":10.5}}"#,
            go(vec![acceleration], Some(5_000), None),
        ),
    ];
    for (input, payload, order) in table {
        let mut rig = Rig::born(MqttVersion::V5);
        let acts = rig.send(&format!("drive/pump/{input}"), payload);
        assert_eq!(orders(&acts), [&order], "{input}");
        assert_eq!(results(&acts), [Value::Null; 0]);
        let request = commands(&acts)[0];
        assert_eq!(
            (request.asker, request.origin.owner),
            (AskerId::MQTT, Owner::Mqtt)
        );
        assert_eq!(request.start_before, rig.now() + Duration::from_secs(1));
        let acts = rig.send(&format!("by/plc-2/drive/pump/{input}"), payload);
        assert_eq!(orders(&acts), [&order], "{input}");
        let plc = Owner::MqttBy(CommanderName::new("plc-2").expect("a name"));
        assert_eq!(commands(&acts)[0].origin.owner, plc);
    }
}

#[test]
fn what_comes_under_a_name_is_answered_with_it_and_no_other_word_is_a_name() {
    let mut rig = Rig::born(MqttVersion::V5);
    let acts = rig.send("by/plc-2/drive/pump/run/set", b"forward");
    let plc_1 = Owner::MqttBy(CommanderName::new("plc-1").expect("a name"));
    let lease = Some((plc_1, MonoTime::from_millis(9_000)));
    rig.views[0].control = Some(ControlView {
        lease,
        ..ControlView::default()
    });
    let acts = rig.report(commands(&acts)[0].ticket, Report::held_by(plc_1), true);
    let outcome = &results(&acts)[0];
    assert_eq!(
        (&outcome["by"], &outcome["owner"]),
        (&json!("plc-2"), &json!("mqtt plc-1"))
    );
    assert_eq!(outcome["message"], "mqtt plc-1 holds control of the drive");
    assert_eq!(
        on(&acts, "drive/pump/control/owner").as_deref(),
        Some("mqtt plc-1")
    );

    let long = "x".repeat(33);
    for name in ["", "a b", "\u{FC}", long.as_str()] {
        let acts = rig.send(&format!("by/{name}/drive/pump/run/set"), b"stop");
        assert_eq!(
            orders(&acts),
            [&STOP],
            "a stop is one whatever its topic says: {name}"
        );
        let acts = rig.send(&format!("by/{name}/drive/pump/run/set"), b"forward");
        assert_eq!(
            (commands(&acts).len(), result(&acts)),
            (0, refused("not_understood")),
            "{name}"
        );
        assert_eq!((kept(&acts).len(), kept(&acts)[0].owner), (1, Owner::Mqtt));
    }
}

#[test]
fn ids_belong_to_their_commander() {
    let mut rig = Rig::born(MqttVersion::V5);
    let command = br#"{"id":7,"frequency_hz":42.5}"#;
    for topic in [
        "drive/pump/command",
        "by/a/drive/pump/command",
        "by/b/drive/pump/command",
    ] {
        assert_eq!(commands(&rig.send(topic, command)).len(), 1, "{topic}");
        assert_eq!(
            commands(&rig.send(topic, command)).len(),
            0,
            "{topic} again"
        );
    }
}

/// A topic, a payload, what that attempts and who, and why it has no effect.
type Case<'a> = (&'a str, &'a [u8], (TriedWrite, Owner), Reason);

/// What `order` attempts, and who attempted it.
fn of_everybody(order: Order) -> (TriedWrite, Owner) {
    (TriedWrite::Order(order), Owner::Mqtt)
}

#[test]
fn what_comes_to_nothing_is_kept_with_who_what_and_why() {
    let run = || go(vec![], None, Some(Direction::Forward));
    let text = |text: &str| (TriedWrite::Text(text.to_owned()), Owner::Mqtt);
    let large = vec![b'1'; 9_000];
    let table: [Case<'_>; 7] = [
        (
            "drive/pump/run/set",
            b"start",
            text("drive/pump/run/set: start"),
            Reason::NotUnderstood,
        ),
        (
            "drive/pumb/run/set",
            b"stop",
            text("drive/pumb/run/set: stop"),
            Reason::UnknownDrive,
        ),
        (
            "drive/a b/run/set",
            b"stop",
            text("drive/a b/run/set: stop"),
            Reason::UnknownDrive,
        ),
        (
            "all/run/set",
            b"forward",
            text("all/run/set: forward"),
            Reason::NotUnderstood,
        ),
        (
            "drive/pump/frequency/set",
            b"4,5",
            text("drive/pump/frequency/set: 4,5"),
            Reason::NotANumber,
        ),
        (
            "drive/pump/command",
            br#"{"run":"forward","issued_at":1}"#,
            of_everybody(run()),
            Reason::Stale,
        ),
        (
            "by/plc-2/drive/pump/frequency/set",
            &large,
            (
                TriedWrite::Text(format!(
                    "by/plc-2/drive/pump/frequency/set: {}\u{2026}",
                    "1".repeat(40)
                )),
                Owner::MqttBy(CommanderName::new("plc-2").expect("a name")),
            ),
            Reason::TooLarge,
        ),
    ];
    for (topic, payload, (tried, owner), reason) in table {
        let mut rig = Rig::born(MqttVersion::V5);
        let acts = rig.send(topic, payload);
        let place = acts.iter().find_map(|act| {
            if let SessionAct::Keep(drive, _) = act {
                Some(*drive)
            } else {
                None
            }
        });
        assert_eq!(
            place.flatten().is_some(),
            topic.contains("/pump/"),
            "{topic}"
        );
        let all = kept(&acts);
        assert_eq!(all.len(), 1, "{topic}");
        assert_eq!((&all[0].tried, all[0].owner), (&tried, owner), "{topic}");
        assert_eq!(all[0].report, Some(Report::refused(reason)), "{topic}");
    }
    let mut rig = Rig::born(MqttVersion::V5);
    let topic = "vfd/plant/drive/pump/run/set";
    let acts = rig.deliver(&BrokerMessage {
        duplicate: true,
        ..message(topic, b"forward")
    });
    assert_eq!(
        (&kept(&acts)[0].tried, kept(&acts)[0].owner),
        (&of_everybody(run()).0, Owner::Mqtt)
    );
    for (topic, payload) in [
        ("drive/pump/lease", &b"x"[..]),
        ("drive/pump/param/F007/get", b"x"),
    ] {
        let topic = format!("vfd/plant/{topic}");
        let acts = rig.deliver(&BrokerMessage {
            retain: true,
            ..message(&topic, payload)
        });
        assert_eq!(kept(&acts).len(), 0, "no attempt to write: {topic}");
        let acts = rig.deliver(&message(&topic, &large));
        assert_eq!(kept(&acts).len(), 0, "no attempt to write: {topic}");
    }
}

#[test]
fn what_is_taken_back_or_not_taken_by_a_line_is_kept() {
    let mut rig = Rig::born(MqttVersion::V5);
    let run = go(vec![], None, Some(Direction::Forward));
    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/drive/pump/run/set",
        b"forward",
    )));
    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/drive/pump/run/set",
        b"stop",
    )));
    let acts = rig.acts();
    assert_eq!(orders(&acts), [&STOP]);
    let cut = Report::new(Outcome::Superseded, Reason::Stopped);
    assert_eq!(
        (&kept(&acts)[0].tried, kept(&acts)[0].report),
        (&TriedWrite::Order(run.clone()), Some(cut))
    );

    let ticket = commands(&rig.send("drive/fan/run/set", b"forward"))[0].ticket;
    rig.session.refused_by_line(rig.at(), ticket);
    let acts = rig.acts();
    assert_eq!(
        kept(&acts)[0].report,
        Some(Report::refused(Reason::QueueFull))
    );

    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/drive/fan/run/set",
        b"forward",
    )));
    rig.millis += 100_000;
    rig.session.tick(rig.at());
    let acts = rig.acts();
    assert_eq!(
        (commands(&acts).len(), kept(&acts).len()),
        (0, 1),
        "it was not fetched"
    );
    rig.send("drive/fan/run/set", b"forward");
    assert_eq!(kept(&rig.pass(100_000)).len(), 0, "a line had it");
}

#[test]
fn a_retained_command_is_refused_on_every_input() {
    for version in [MqttVersion::V4, MqttVersion::V5] {
        for (input, payload) in INPUTS {
            let mut rig = Rig::born(version);
            let topic = format!("vfd/plant/{input}");
            let acts = rig.deliver(&BrokerMessage {
                retain: true,
                ..message(&topic, payload)
            });
            assert_eq!(
                (commands(&acts).len(), reads(&acts).len()),
                (0, 0),
                "{input}"
            );
            assert_eq!(result(&acts), refused("retained"), "{input}");
            assert_eq!(rig.session.counters().refused_retained, 1);
            let acts = rig.deliver(&BrokerMessage {
                retain: true,
                ..message(&topic, b"")
            });
            assert_eq!(acts, [], "a topic is cleared: {input}");
        }
    }
}

#[test]
fn a_retained_stop_is_live_with_version_5_and_a_replay_before() {
    for (topic, payload) in [
        ("vfd/plant/drive/pump/run/set", &b"stop"[..]),
        ("vfd/plant/drive/pump/run/set", b"coast"),
        ("vfd/plant/drive/pump/command", br#"{"run":"stop"}"#),
        ("vfd/plant/all/run/set", b"stop"),
    ] {
        let retained = BrokerMessage {
            retain: true,
            ..message(topic, payload)
        };
        let mut rig = Rig::born(MqttVersion::V5);
        let acts = rig.deliver(&retained);
        assert_eq!(commands(&acts).len(), 1, "{topic}");
        assert_eq!(rig.session.counters().retained_stops, 1);
        let ticket = commands(&acts)[0].ticket;
        let outcomes = results(&rig.answer(ticket, Outcome::Confirmed, Reason::None, true));
        assert!(
            outcomes[0]["message"]
                .as_str()
                .expect("a warning")
                .contains("retain")
        );

        let mut rig = Rig::born(MqttVersion::V4);
        let acts = rig.deliver(&retained);
        assert_eq!(
            (commands(&acts).len(), result(&acts)),
            (0, refused("retained")),
            "{topic}"
        );
    }
}

#[test]
fn bad_payloads_give_one_result_and_no_command() {
    let large = vec![b'1'; 5_000_000];
    let table: [(&str, &[u8], &str); 24] = [
        ("drive/pump/run/set", b"start", "not_understood"),
        ("drive/pump/run/set", b"\xFF\xFE", "not_understood"),
        ("drive/pump/frequency/set", b"NaN", "not_a_number"),
        ("drive/pump/frequency/set", b"inf", "not_a_number"),
        ("drive/pump/frequency/set", b"4,5", "not_a_number"),
        ("drive/pump/frequency/set", b"1e3", "not_a_number"),
        ("drive/pump/frequency/set", b"-5", "outside_limits"),
        ("drive/pump/frequency/set", &large, "too_large"),
        ("drive/pump/command", &large, "too_large"),
        ("drive/pump/lease", &large, "too_large"),
        ("drive/pump/param/F007/get", &large, "too_large"),
        ("drive/pump/command", b"[1]", "not_understood"),
        (
            "drive/pump/command",
            br#"{"reset":true,"frequency_hz":5}"#,
            "conflict",
        ),
        ("drive/pump/param/F999/get", b"", "not_listed"),
        ("drive/pump/param/run_command/set", b"1", "not_listed"),
        ("drive/pumb/run/set", b"stop", "unknown_drive"),
        ("all/run/set", b"forward", "not_understood"),
        ("all/run/set", &large, "too_large"),
        // Nothing, where only a retained message of nothing clears a topic.
        ("drive/pump/run/set", b"", "not_understood"),
        ("drive/pump/frequency/set", b"", "not_understood"),
        ("drive/pump/command", b"", "not_understood"),
        ("drive/pump/control/take", b"", "not_understood"),
        ("by/plc-2/drive/pump/trip/reset", b"", "not_understood"),
        ("all/run/set", b"", "not_understood"),
    ];
    for (input, payload, reason) in table {
        let mut rig = Rig::born(MqttVersion::V5);
        let acts = rig.send(input, payload);
        assert_eq!(
            (commands(&acts).len(), reads(&acts).len()),
            (0, 0),
            "{input}"
        );
        assert_eq!(result(&acts), refused(reason), "{input}");
        let all = results(&acts);
        let text = |key: &str| all[0][key].as_str().map_or(0, str::len);
        assert!(
            text("id") > 0 && text("message") > 0 && text("message") < 300,
            "{all:?}"
        );
    }
    let mut rig = Rig::born(MqttVersion::V5);
    let acts = rig.send("drive/pumb/run/set", b"stop");
    assert_eq!(
        results(&acts)[0]["message"],
        "there is no drive `pumb`; is it `pump`?"
    );
    for ignored in [
        "drive/a b/run/set",
        "drive//run/set",
        "drive/pump/run/state",
        "elsewhere",
    ] {
        assert_eq!(
            publications(&rig.send(ignored, b"stop")),
            [] as [&Publication; 0],
            "{ignored}"
        );
    }
    assert_eq!(rig.session.counters().ignored, 4);
}

#[test]
fn stop_all_goes_to_each_drive_with_control() {
    let mut rig = Rig::born(MqttVersion::V5);
    let acts = rig.send("all/run/set", b" Stop");
    assert_eq!(orders(&acts), [&STOP], "the fan has none");
    let ticket = commands(&acts)[0].ticket;
    let acts = rig.answer(ticket, Outcome::Confirmed, Reason::None, true);
    assert!(on(&acts, "drive/pump/result").is_some());
}

#[test]
fn results_come_in_stages_with_the_values_read_back() {
    let mut rig = Rig::born(MqttVersion::V5);
    let acts = rig.send(
        "drive/pump/command",
        br#"{"id":"a1","frequency_hz":42.5,"param":{"F007":10.5}}"#,
    );
    let ticket = commands(&acts)[0].ticket;
    let all = results(&rig.answer(ticket, Outcome::Acknowledged, Reason::None, false));
    let parts =
        |it: &Value| ["id", "drive", "outcome", "final", "values"].map(|key| it[key].clone());
    assert_eq!(
        parts(&all[0]),
        [
            json!("a1"),
            json!("pump"),
            json!("acknowledged"),
            json!(false),
            Value::Null
        ]
    );
    let all = results(&rig.answer(ticket, Outcome::Confirmed, Reason::None, true));
    let values = json!({ "frequency_hz": 42.5, "F007": 10.5 });
    assert_eq!(
        parts(&all[0]),
        [
            json!("a1"),
            json!("pump"),
            json!("confirmed"),
            json!(true),
            values
        ]
    );
    assert_eq!(
        rig.answer(ticket, Outcome::Confirmed, Reason::None, true),
        [],
        "only one last word"
    );
}

#[test]
fn a_refusal_by_the_drive_shows_what_it_holds() {
    let mut rig = Rig::born(MqttVersion::V5);
    let kept = Report {
        held: Some(2_000),
        ..Report::new(Outcome::Failed, Reason::KeptOldValue)
    };
    for (input, payload, values) in [
        (
            "frequency/set",
            &b"42.5"[..],
            json!({ "frequency_hz": 20.0 }),
        ),
        ("param/F007/set", b"10.5", json!({ "F007": 200.0 })),
        (
            "command",
            br#"{"run":"forward","frequency_hz":42.5}"#,
            Value::Null,
        ),
    ] {
        let acts = rig.send(&format!("drive/pump/{input}"), payload);
        let all = results(&rig.report(commands(&acts)[0].ticket, kept, true));
        assert_eq!(
            (&all[0]["held"], &all[0]["values"]),
            (&json!(2_000), &values),
            "{input}"
        );
    }
}

#[test]
fn a_repeat_gets_the_first_outcome_and_moves_nothing() {
    let mut rig = Rig::born(MqttVersion::V5);
    let command = br#"{"id":7,"frequency_hz":42.5}"#;
    let ticket = commands(&rig.send("drive/pump/command", command))[0].ticket;
    let acts = rig.send("drive/pump/command", command);
    assert_eq!(
        (acts.len(), kept(&acts).len()),
        (1, 1),
        "its outcome will come"
    );
    rig.answer(ticket, Outcome::Confirmed, Reason::None, true);
    let acts = rig.send("drive/pump/command", command);
    assert_eq!(commands(&acts).len(), 0);
    let all = results(&acts);
    assert_eq!(
        (&all[0]["outcome"], &all[0]["repeat"], &all[0]["id"]),
        (&json!("confirmed"), &json!(true), &json!(7))
    );
    assert_eq!(
        result(&rig.send("drive/pump/command", br#"{"id":7,"frequency_hz":43}"#)),
        refused("duplicate")
    );
    assert_eq!(rig.session.counters().duplicates, 3);
    rig.pass(600_000);
    assert_eq!(
        commands(&rig.send("drive/pump/command", command)).len(),
        1,
        "ten minutes later it is a new one"
    );
}

#[test]
fn a_stop_is_executed_however_often_it_comes() {
    let mut rig = Rig::born(MqttVersion::V5);
    let stop = br#"{"id":"s","run":"stop"}"#;
    for _ in 0..3 {
        assert_eq!(orders(&rig.send("drive/pump/command", stop)), [&STOP]);
    }
    assert_eq!(
        result(&rig.send("drive/pump/command", br#"{"id":"s","run":"forward"}"#)),
        refused("duplicate")
    );
    for payload in [&b"stop"[..], b"coast"] {
        let repeat = BrokerMessage {
            duplicate: true,
            ..message("vfd/plant/drive/pump/run/set", payload)
        };
        assert_eq!(commands(&rig.deliver(&repeat)).len(), 1);
    }
}

#[test]
fn a_redelivery_without_an_id_is_refused() {
    for (input, payload) in INPUTS
        .into_iter()
        .filter(|(input, _)| input.starts_with("drive/pump"))
    {
        let mut rig = Rig::born(MqttVersion::V5);
        let topic = format!("vfd/plant/{input}");
        let acts = rig.deliver(&BrokerMessage {
            duplicate: true,
            ..message(&topic, payload)
        });
        if input.ends_with("get") {
            assert_eq!(reads(&acts).len(), 1, "reading moves nothing");
        } else {
            assert_eq!(
                (commands(&acts).len(), result(&acts)),
                (0, refused("duplicate")),
                "{input}"
            );
        }
    }
}

#[test]
fn the_shortest_deadline_wins() {
    let mut rig = Rig::born(MqttVersion::V5);
    let topic = "vfd/plant/drive/pump/command";
    for (payload, expiry, expected) in [
        (&br#"{"run":"forward","ttl_ms":5000}"#[..], None, 5_000),
        (br#"{"run":"forward","ttl_ms":5000}"#, Some(3), 3_000),
        (br#"{"run":"forward","ttl_ms":500}"#, Some(3), 500),
        (br#"{"run":"forward"}"#, Some(3), 1_000),
        (br#"{"run":"forward"}"#, Some(0), 0),
    ] {
        let acts = rig.deliver(&BrokerMessage {
            expiry: expiry.map(Duration::from_secs),
            ..message(topic, payload)
        });
        assert_eq!(
            commands(&acts)[0].start_before,
            rig.now() + Duration::from_millis(expected)
        );
    }
}

#[test]
fn a_command_that_was_issued_too_long_ago_is_stale_but_a_stop_never_is() {
    let mut rig = Rig::born(MqttVersion::V5);
    rig.pass(10_000);
    let send = |rig: &mut Rig, run: &str, age_ms: i64| {
        let issued_at = EPOCH_MS + 10_000 - age_ms;
        let payload = json!({ "run": run, "issued_at": issued_at, "epoch": 7 }).to_string();
        rig.send("drive/pump/command", payload.as_bytes())
    };
    let acts = send(&mut rig, "forward", 400);
    let request = commands(&acts)[0];
    assert_eq!(
        (request.issued, request.epoch),
        (Some(MonoTime::from_millis(10_600)), Some(7))
    );
    assert_eq!(result(&send(&mut rig, "forward", 1_001)), refused("stale"));
    assert_eq!(
        result(&send(&mut rig, "forward", -2_001)),
        refused("clock_ahead")
    );
    assert_eq!(
        commands(&send(&mut rig, "forward", -500))[0].issued,
        Some(rig.now()),
        "nothing is issued later"
    );
    assert_eq!(orders(&send(&mut rig, "stop", 1_000_000)), [&STOP]);
    let far = format!(r#"{{"run":"forward","issued_at":{}}}"#, i64::MIN);
    assert_eq!(
        result(&rig.send("drive/pump/command", far.as_bytes())),
        refused("stale")
    );
}

#[test]
fn a_command_ahead_of_our_clock_is_the_same_moment_when_it_comes_again() {
    for (ahead_ms, is_taken) in [
        (0, true),
        (500, true),
        (2_000, true),
        (2_001, false),
        (50_000, false),
    ] {
        let mut rig = Rig::born(MqttVersion::V5);
        rig.pass(10_000);
        let come = rig.now();
        let issued_at = EPOCH_MS + 10_000 + ahead_ms;
        let run = json!({ "run": "forward", "issued_at": issued_at, "ttl_ms": 60_000 }).to_string();
        let acts = rig.send("drive/pump/command", run.as_bytes());
        if !is_taken {
            assert_eq!(result(&acts), refused("clock_ahead"), "{ahead_ms}");
            let outcome = results(&acts)[0]["message"]
                .as_str()
                .unwrap_or_default()
                .to_owned();
            assert!(
                outcome.contains(&format!(
                    "{:.1} s ahead",
                    f64::from(i32::try_from(ahead_ms).unwrap()) / 1000.0
                )),
                "{outcome}"
            );
        } else {
            assert_eq!(commands(&acts)[0].issued, Some(come), "{ahead_ms}");
            let ticket = commands(&acts)[0].ticket;
            let acts = rig.answer(ticket, Outcome::Acknowledged, Reason::None, true);
            let message = results(&acts)[0]["message"]
                .as_str()
                .unwrap_or_default()
                .to_owned();
            assert_eq!(
                message.contains("s ahead of the gateway's clock"),
                ahead_ms >= 100,
                "{message}"
            );
        }
        // The same message after a stop, at any time.
        for later_ms in [1_000, 1_500, 49_000] {
            rig.pass(later_ms);
            let acts = rig.send("drive/pump/command", run.as_bytes());
            assert!(
                commands(&acts).iter().all(|it| it.issued == Some(come)),
                "{ahead_ms} {later_ms}"
            );
            assert!(
                is_taken || commands(&acts).is_empty(),
                "{ahead_ms} {later_ms}"
            );
        }
    }
}

#[test]
fn what_may_have_waited_through_a_stall_is_stale_but_a_stop_is_carried_out() {
    for version in [MqttVersion::V4, MqttVersion::V5] {
        let mut rig = Rig::born(version);
        rig.pass(10_000);
        rig.handle(BrokerEvent::Stalled(Duration::from_secs(3)));
        let young = format!(
            r#"{{"id":"young","frequency_hz":40,"issued_at":{}}}"#,
            EPOCH_MS + 9_900
        );
        for (rest, payload) in [
            ("run/set", "forward"),
            ("command", r#"{"id":"old","run":"forward","epoch":7}"#),
            (
                "command",
                r#"{"id":"patient","frequency_hz":30,"ttl_ms":4000}"#,
            ),
            ("command", &young),
            ("run/set", "stop"),
        ] {
            rig.handle(BrokerEvent::Message(message(
                &format!("vfd/plant/drive/pump/{rest}"),
                payload.as_bytes(),
            )));
        }
        // Before any of it the probe is sent that has to return, after everything that is queued at the broker.
        let acts = rig.acts_without_echo();
        let probe = probe(&acts);
        assert_eq!(probe.qos, Qos::AtLeastOnce);
        assert_eq!(
            orders(&acts),
            [&STOP],
            "{version:?}: it takes back what was still taken"
        );
        let outcomes: Vec<_> = results(&acts)
            .iter()
            .map(|it| it["reason"].as_str().unwrap_or_default().to_owned())
            .collect();
        assert_eq!(
            outcomes,
            ["stale", "stale", "stopped", "stopped"],
            "{version:?}"
        );
        assert_eq!(
            result(&run_without_echo(&mut rig)),
            refused("stale"),
            "still"
        );
        rig.handle(BrokerEvent::Message(message(
            "vfd/plant/probe",
            &probe.payload,
        )));
        assert_eq!(
            orders(&rig.send("drive/pump/run/set", b"forward")),
            [&go(vec![], None, Some(Direction::Forward))]
        );
    }
}

#[test]
fn a_probe_from_before_the_stall_proves_nothing_and_a_new_connection_all() {
    let mut rig = Rig::born(MqttVersion::V5);
    rig.millis += 5_000;
    let before = probe(&rig.acts_without_echo());
    rig.handle(BrokerEvent::Stalled(Duration::from_secs(60)));
    assert!(
        !rig.acts_without_echo()
            .iter()
            .any(|act| matches!(act, SessionAct::Reconnect(_))),
        "it is not the probe that is late"
    );
    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/probe",
        &before.payload,
    )));
    assert_eq!(result(&run_without_echo(&mut rig)), refused("stale"));
    rig.handle(BrokerEvent::Lost);
    rig.connect();
    assert_eq!(orders(&rig.send("drive/pump/run/set", b"forward")).len(), 1);
}

/// The probe's usual round trip takes no time here.
#[test]
fn while_the_probe_is_overdue_everything_but_a_stop_is_stale_until_a_later_one_is_back() {
    for version in [MqttVersion::V4, MqttVersion::V5] {
        let mut rig = Rig::born(version);
        rig.pass(60_000);
        rig.millis += 5_000;
        let late = probe(&rig.acts_without_echo());
        rig.millis += 200;
        assert_eq!(
            commands(&run_without_echo(&mut rig)).len(),
            1,
            "{version:?}: not late yet"
        );
        rig.millis += 600;
        let young = format!(
            r#"{{"frequency_hz":40,"issued_at":{}}}"#,
            rig.at().wall.unix_ms
        );
        for (rest, payload) in [
            ("run/set", "forward"),
            ("command", r#"{"id":"a","run":"forward","epoch":7}"#),
            ("command", r#"{"id":"b","frequency_hz":30,"ttl_ms":60000}"#),
            ("command", &young),
            ("trip/reset", "reset"),
        ] {
            rig.handle(BrokerEvent::Message(message(
                &format!("vfd/plant/drive/pump/{rest}"),
                payload.as_bytes(),
            )));
            let acts = rig.acts_without_echo();
            assert_eq!(
                (commands(&acts).len(), result(&acts)),
                (0, refused("stale")),
                "{version:?}: {payload}"
            );
        }
        let outcome = results(&run_without_echo(&mut rig))[0]["message"]
            .as_str()
            .unwrap_or_default()
            .to_owned();
        assert!(
            outcome.contains("the gateway's probe through the broker is late"),
            "{outcome}"
        );
        rig.handle(BrokerEvent::Message(message(
            "vfd/plant/drive/pump/run/set",
            b"stop",
        )));
        assert_eq!(orders(&rig.acts_without_echo()), [&STOP], "{version:?}");
        // The late one proves nothing about what was delayed with it, but the next one is sent at once.
        rig.handle(BrokerEvent::Message(message(
            "vfd/plant/probe",
            &late.payload,
        )));
        let acts = run_without_echo(&mut rig);
        assert_eq!(result(&acts), refused("stale"), "{version:?}: still");
        rig.handle(BrokerEvent::Message(message(
            "vfd/plant/probe",
            &probe(&acts).payload,
        )));
        assert_eq!(
            commands(&run_without_echo(&mut rig)).len(),
            1,
            "{version:?}: it is back"
        );
    }
}

#[test]
fn a_new_connection_is_no_way_for_commands_before_its_first_probe_is_back() {
    let mut rig = Rig::born(MqttVersion::V5);
    rig.pass(10_000);
    rig.handle(BrokerEvent::Lost);
    rig.handle(BrokerEvent::Connected(rig.broker));
    let acts = rig.acts_without_echo();
    let filters = acts.iter().find_map(|act| {
        if let SessionAct::Subscribe(it) = act {
            Some(it.len())
        } else {
            None
        }
    });
    rig.handle(BrokerEvent::Subscribed(vec![
        true;
        filters
            .expect("a subscription")
    ]));
    let first = probe(&rig.acts_without_echo());
    assert_eq!(result(&run_without_echo(&mut rig)), refused("stale"));
    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/drive/pump/run/set",
        b"stop",
    )));
    assert_eq!(orders(&rig.acts_without_echo()), [&STOP]);
    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/probe",
        &first.payload,
    )));
    assert_eq!(commands(&run_without_echo(&mut rig)).len(), 1);
}

#[test]
fn responses_go_where_they_are_allowed_and_nowhere_else() {
    let ask = |topic, correlation| BrokerMessage {
        response_topic: Some(topic),
        correlation,
        ..message("vfd/plant/drive/pump/run/set", b"bad")
    };
    let mut rig = Rig::born(MqttVersion::V5);
    let acts = rig.deliver(&ask("vfd/answers/me", Some(b"c1")));
    let response = publications(&acts)
        .into_iter()
        .find(|it| it.topic == "vfd/answers/me")
        .expect("a response");
    assert_eq!(response.correlation.as_deref(), Some(&b"c1"[..]));
    assert_eq!(
        Some(String::from_utf8_lossy(&response.payload).into_owned()),
        on(&acts, "drive/pump/result")
    );

    for topic in [
        "vfd/plant/drive/fan/run/set",
        "vfd/other/drive/fan/run/set",
        "elsewhere",
        "vfd/answers/#",
    ] {
        assert_eq!(
            published_texts(&rig.deliver(&ask(topic, None))).len(),
            1,
            "{topic}"
        );
    }
    assert_eq!(
        published_texts(&rig.deliver(&ask("vfd/answers/me", Some(&[0; 1_025])))).len(),
        1
    );
    assert_eq!(rig.session.counters().responses_ignored, 5);
    let mut rig = Rig::born(MqttVersion::V4);
    assert_eq!(
        published_texts(&rig.deliver(&ask("vfd/answers/me", None))).len(),
        1
    );
    let mut rig = Rig::with(Settings {
        response_prefix: None,
        ..settings(MqttVersion::V5)
    });
    rig.connect();
    assert_eq!(
        published_texts(&rig.deliver(&ask("vfd/answers/me", None))).len(),
        1
    );
}

#[test]
fn the_65th_command_is_refused_and_a_stop_is_not() {
    let mut rig = Rig::born(MqttVersion::V5);
    let first_setpoint = commands(&rig.send("drive/pump/frequency/set", b"10"))[0].ticket;
    for _ in 1..64 {
        assert_eq!(
            commands(&rig.send("drive/pump/frequency/set", b"10")).len(),
            1
        );
    }
    assert_eq!(
        result(&rig.send("drive/pump/frequency/set", b"10")),
        refused("queue_full")
    );
    assert_eq!(
        reads(&rig.send("drive/pump/param/F007/get", b"")).len(),
        1,
        "reads have bounds of their own"
    );
    let stop = |rig: &mut Rig| rig.send("drive/pump/run/set", b"stop");
    let first = commands(&stop(&mut rig))[0].ticket;
    (0..3).for_each(|_| assert_eq!(results(&stop(&mut rig)), [Value::Null; 0]));
    let acts = stop(&mut rig);
    assert_eq!(commands(&acts).len(), 1);
    assert_eq!(
        result(&acts),
        ("superseded".to_owned(), "newer".to_owned()),
        "the oldest gives way"
    );
    assert_eq!(
        rig.answer(first, Outcome::Confirmed, Reason::None, true),
        []
    );
    assert_eq!(
        commands(&rig.send("drive/fan/run/set", b"stop")).len(),
        1,
        "room for each drive"
    );
    rig.answer(first_setpoint, Outcome::Confirmed, Reason::None, true);
    assert_eq!(
        commands(&rig.send("drive/pump/frequency/set", b"10")).len(),
        1,
        "room again"
    );
}

#[test]
fn a_stop_overtakes_and_cuts_what_still_waits_here() {
    let mut rig = Rig::born(MqttVersion::V5);
    let run = message("vfd/plant/drive/pump/run/set", b"forward");
    for message in [
        run.clone(),
        message("vfd/plant/drive/fan/run/set", b"forward"),
        message("vfd/plant/drive/pump/lease", b""),
        message("vfd/plant/drive/pump/run/set", b"coast"),
        message("vfd/plant/drive/pump/run/set", b"stop"),
    ] {
        rig.handle(BrokerEvent::Message(message));
    }
    let run_fan = go(vec![], None, Some(Direction::Forward));
    let mut inward = Vec::new();
    while let Some(act) = rig.session.next_inward() {
        inward.push(act);
    }
    assert_eq!(
        orders(&inward),
        [&Order::Coast, &STOP, &run_fan, &Order::Renew]
    );
    assert_eq!(
        result(&rig.acts()),
        ("superseded".to_owned(), "stopped".to_owned())
    );
    rig.deliver(&run);
}

#[test]
fn a_refused_command_is_not_executed_when_the_same_message_comes_again() {
    let mut rig = Rig::born(MqttVersion::V5);
    let command = br#"{"id":"a","run":"forward"}"#;
    let ticket = commands(&rig.send("drive/pump/command", command))[0].ticket;
    rig.session.refused_by_line(rig.at(), ticket);
    assert_eq!(result(&rig.acts()), refused("queue_full"));
    let acts = rig.send("drive/pump/command", command);
    assert_eq!(
        (commands(&acts).len(), result(&acts)),
        (0, refused("queue_full")),
        "that was its final result"
    );

    let waited = br#"{"id":"b","run":"forward"}"#;
    rig.handle(BrokerEvent::Stalled(Duration::from_secs(3)));
    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/drive/pump/command",
        waited,
    )));
    let acts = rig.acts_without_echo();
    assert_eq!(result(&acts), refused("stale"));
    rig.handle(BrokerEvent::Message(message(
        "vfd/plant/probe",
        &probe(&acts).payload,
    )));
    let acts = rig.send("drive/pump/command", waited);
    assert_eq!(
        (commands(&acts).len(), result(&acts)),
        (0, refused("stale")),
        "nor does a proven way make it young"
    );
    assert_eq!(
        commands(&rig.send("drive/pump/command", br#"{"id":"c","run":"forward"}"#)).len(),
        1
    );
}

#[test]
fn renewals_are_quiet_unless_refused() {
    let mut rig = Rig::born(MqttVersion::V5);
    let ticket = commands(&rig.send("drive/pump/lease", b""))[0].ticket;
    assert_eq!(
        rig.answer(ticket, Outcome::Confirmed, Reason::None, true),
        []
    );
    let ticket = commands(&rig.send("drive/pump/lease", b""))[0].ticket;
    assert_eq!(
        result(&rig.answer(ticket, Outcome::Refused, Reason::OtherOwner, true)),
        refused("other_owner")
    );
}

#[test]
fn a_read_asks_for_one_word_and_tells_why_it_failed() {
    let mut rig = Rig::born(MqttVersion::V5);
    for (outcome, expected) in [
        (NativeOutcome::NoReply, ("failed", "no_reply")),
        (NativeOutcome::Expired, ("expired", "too_late")),
        (
            NativeOutcome::DriveException {
                code: 2,
                reason: Reason::DriveException,
            },
            ("failed", "drive_exception"),
        ),
        (
            NativeOutcome::DriveException {
                code: 2,
                reason: Reason::DriveLocked,
            },
            ("failed", "drive_locked"),
        ),
        (
            NativeOutcome::Refused(NativeRefusal::LineDown),
            ("refused", "line_down"),
        ),
        (
            NativeOutcome::Words(Vec::new().into()),
            ("failed", "no_reply"),
        ),
    ] {
        let acts = rig.send("drive/pump/param/F007/get", b"");
        let request = reads(&acts)[0];
        assert_eq!(
            request.ask,
            NativeAsk::Read {
                address: 0x020C_u16.into(),
                count: 1
            }
        );
        let answer = NativeAnswer {
            asker: AskerId::MQTT,
            ticket: request.ticket,
            outcome,
        };
        rig.session.native_answer(
            rig.at(),
            &NativeAnswer {
                asker: AskerId(5),
                ..answer.clone()
            },
        );
        rig.session.native_answer(rig.at(), &answer);
        let (outcome, reason) = result(&rig.acts());
        assert_eq!((outcome.as_str(), reason.as_str()), expected);
    }
}

#[test]
fn what_is_never_answered_is_given_up_and_said_to_be_unknown() {
    let mut rig = Rig::born(MqttVersion::V5);
    rig.send("drive/pump/run/set", b"forward");
    rig.handle(BrokerEvent::Lost);
    let acts = rig.connect();
    assert_eq!(results(&acts), [Value::Null; 0], "it is still waited for");
    assert_eq!(
        result(&rig.pass(61_000)),
        ("unknown".to_owned(), "no_reply".to_owned())
    );
    assert_eq!(rig.session.counters().unanswered, 1);
    rig.send("drive/pump/run/set", b"stop");
    assert_eq!(
        results(&rig.pass(600_000)),
        [Value::Null; 0],
        "a stop may stay pending for long"
    );
}

#[test]
fn what_nobody_fetches_stays_bounded() {
    let mut rig = Rig::born(MqttVersion::V5);
    for _ in 0..10 {
        for (input, payload) in INPUTS {
            let topic = format!("vfd/plant/{input}");
            (0..50).for_each(|_| rig.handle(BrokerEvent::Message(message(&topic, payload))));
        }
        (0..50).for_each(|_| {
            rig.handle(BrokerEvent::Message(message(
                "vfd/plant/all/run/set",
                b"stop",
            )))
        });
        rig.millis += 1_000_000;
        rig.session.tick(rig.at());
    }
    let inward: Vec<_> = std::iter::from_fn(|| rig.session.next_inward()).collect();
    assert!(
        inward.iter().all(|act| matches!(act, SessionAct::Keep(..))),
        "all are given up"
    );
    assert_eq!(inward.len(), crate::north::broker::ATTEMPTS_MAX);
    assert!(rig.session.counters().attempts_lost > 0);
    assert!(
        publications(&rig.connect())
            .iter()
            .filter(|it| it.topic.ends_with("/result"))
            .count()
            <= 64
    );
    assert!(rig.session.counters().results_dropped > 0);
}

fn any_topic() -> impl Strategy<Value = String> {
    let words = [
        "vfd", "plant", "drive", "pump", "fan", "run", "set", "param", "F007", "get", "command",
        "all", "probe", "",
    ];
    let levels = prop::collection::vec(prop::sample::select(words.to_vec()), 0..7);
    let ours =
        prop::sample::select(INPUTS.to_vec()).prop_map(|(input, _)| format!("vfd/plant/{input}"));
    prop_oneof![levels.prop_map(|levels| levels.join("/")), ours, ".{0,20}"]
}

fn any_payload() -> impl Strategy<Value = Vec<u8>> {
    let known = INPUTS.map(|(_, payload)| payload.to_vec()).to_vec();
    let json = (
        prop::sample::select(vec![
            "run",
            "frequency_hz",
            "reset",
            "param",
            "id",
            "ttl_ms",
            "issued_at",
            "epoch",
        ]),
        any::<i64>(),
    )
        .prop_map(|(key, number)| format!("{{\"{key}\":{number}}}").into_bytes());
    prop_oneof![
        prop::sample::select(known),
        json,
        prop::collection::vec(any::<u8>(), 0..40),
        "[{}\":,a-z0-9.]{0,40}".prop_map(String::into_bytes)
    ]
}

proptest! {
    #[test]
    fn no_message_panics_or_gives_more_than_one_command(
        topic in any_topic(),
        payload in any_payload(),
        retain in any::<bool>(),
        duplicate in any::<bool>(),
        response in prop::option::of(any_topic()),
        is_v5 in any::<bool>(),
    ) {
        let mut rig = Rig::born(if is_v5 { MqttVersion::V5 } else { MqttVersion::V4 });
        let message = BrokerMessage { retain, duplicate, response_topic: response.as_deref(), ..message(&topic, &payload) };
        let acts = rig.deliver(&message);
        prop_assert!(commands(&acts).len() + reads(&acts).len() <= 1);
        prop_assert!(results(&acts).len() <= 1);
        // Every attempt to write is recorded once: by an order, of which a line knows, or as kept.
        let rest = topic.strip_prefix("vfd/plant/").unwrap_or_default();
        let is_input = rest == "all/run/set" || INPUTS.iter().any(|(input, _)| *input == rest);
        let is_attempt = is_input && !payload.is_empty() && !rest.ends_with("/get") && !rest.ends_with("/lease");
        let accounts = orders(&acts).len() + kept(&acts).len();
        prop_assert!(if is_attempt { accounts == 1 } else { kept(&acts).len() <= 1 }, "{} {:?}", accounts, acts);
        prop_assert!(kept(&acts).iter().all(|attempt| attempt.report.is_some()));
        let is_stop = orders(&acts).iter().all(|order| order.is_stop());
        prop_assert!(!retain || is_stop);
        prop_assert!(!acts.iter().any(|act| matches!(act, SessionAct::Reconnect(_))));
    }
}
