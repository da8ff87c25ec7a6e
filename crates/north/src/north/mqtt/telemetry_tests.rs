//! What is published of the drives, when, and when it is taken back.

use super::harness::{
    BrokerSession, Rig, SessionAct, idle_control, on, publications, published_texts,
};
use crate::domain::command::{Outcome, Owner, Reason, Report, RunIntent};
use crate::domain::counts::ExchangeCounts;
use crate::domain::frequency::Hertz;
use crate::domain::native::{NativeAnswer, NativeOutcome};
use crate::domain::report::{LineFault, LineState, ReplyReport, StationReport};
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{RunState, TripRecord};
use crate::north::broker::MqttVersion;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

fn state(acts: &[SessionAct]) -> Option<Value> {
    on(acts, "drive/pump/state").map(|text| serde_json::from_str(&text).expect("JSON"))
}

/// The drive continues to answer for this long.
fn polled(rig: &mut Rig, millis: u64, output: u16) -> Vec<SessionAct> {
    let mut all = Vec::new();
    for _ in 0..millis / 500 {
        all.extend(rig.pass(500));
        rig.poll(0, output);
        all.extend(rig.acts());
    }
    all
}

#[test]
fn a_change_is_published_from_its_dead_band_on() {
    let mut rig = Rig::born(MqttVersion::V5);
    rig.pass(1_000);
    for (output, expected) in [
        (3_049, None),
        (3_050, Some("30.50")),
        (3_001, None),
        (3_000, Some("30.00")),
    ] {
        rig.poll(0, output);
        let acts = rig.pass(1_000);
        assert_eq!(
            on(&acts, "drive/pump/frequency/output").as_deref(),
            expected,
            "{output}"
        );
        assert_eq!(
            state(&acts).is_some(),
            expected.is_some(),
            "the state goes by the same"
        );
    }
    let now = rig.now();
    rig.views[0].snapshot.take(0x0201_u16.into(), &[4_001], now);
    let setpoint = on(&rig.acts(), "drive/pump/frequency/setpoint");
    assert_eq!(
        setpoint.as_deref(),
        Some("40.01"),
        "one step where none is configured"
    );
}

#[test]
fn what_does_not_change_comes_with_the_heartbeat_only() {
    let mut rig = Rig::born(MqttVersion::V5);
    let quiet = polled(&mut rig, 59_500, 3_000);
    let only_stats = published_texts(&quiet);
    assert_eq!(only_stats, [], "nothing changed");
    let again = polled(&mut rig, 1_000, 3_000);
    for topic in [
        "status",
        "line/hall/status",
        "line/hall/stats",
        "drive/pump/state",
        "drive/pump/frequency/output",
    ] {
        assert!(on(&again, topic).is_some(), "{topic}");
    }
    assert!(on(&again, "info").is_none());
    assert!(
        on(&again, "drive/fan/frequency/output").is_none(),
        "what is cleared stays so"
    );
}

#[test]
fn a_stale_value_is_cleared_once_and_comes_back_when_fresh() {
    let mut rig = Rig::born(MqttVersion::V5);
    // Polled every 500 ms: stale after 1.5 s; the slow ones after 6 s.
    assert_eq!(published_texts(&rig.pass(1_499)), []);
    let acts = rig.pass(1);
    assert_eq!(
        on(&acts, "drive/pump/frequency/output").as_deref(),
        Some("")
    );
    assert_eq!(on(&acts, "drive/pump/frequency/setpoint"), None);
    assert!(publications(&acts).iter().all(|it| it.retain));
    let state = state(&acts).expect("a state");
    assert_eq!(state["values"]["output_frequency"]["quality"], "stale");
    assert_eq!(state["values"]["output_frequency"]["value"], 30.0);
    assert_eq!(state["values"]["frequency_setting"]["quality"], "good");
    let later = rig.pass(50_000);
    assert_eq!(on(&later, "drive/pump/frequency/output"), None, "once");
    assert_eq!(
        on(&later, "drive/pump/frequency/setpoint").as_deref(),
        Some("")
    );
    assert_eq!(on(&later, "drive/pump/trip/active").as_deref(), Some(""));
    rig.poll(0, 3_000);
    let acts = rig.pass(1_000);
    assert_eq!(
        on(&acts, "drive/pump/frequency/output").as_deref(),
        Some("30.00")
    );
    assert_eq!(
        on(&acts, "drive/pump/trip/active").as_deref(),
        Some("false")
    );
}

#[test]
fn an_offline_drive_says_so_and_its_run_state_is_unknown() {
    for is_line_down in [true, false] {
        let mut rig = Rig::born(MqttVersion::V5);
        rig.views[0].run_state = RunState::Forward;
        assert_eq!(
            on(&rig.acts(), "drive/pump/run/state").as_deref(),
            Some("forward")
        );
        if is_line_down {
            rig.views[0].line_is_up = false;
        } else {
            rig.views[0].snapshot.presence = DrivePresence::Offline;
        }
        let acts = rig.pass(500);
        assert_eq!(
            on(&acts, "drive/pump/availability").as_deref(),
            Some("offline")
        );
        assert_eq!(
            on(&acts, "drive/pump/run/state").as_deref(),
            Some("unknown")
        );
        assert_eq!(state(&acts).expect("a state")["online"], false);
    }
}

#[test]
fn the_state_comes_at_most_twice_a_second() {
    let mut rig = Rig::born(MqttVersion::V5);
    let mut states = 0;
    for step in 0..110 {
        rig.poll(0, 3_000 + 100 * step);
        states += usize::from(state(&rig.pass(20)).is_some());
    }
    assert_eq!(states, 4, "in 2.2 seconds");
    assert_eq!(
        state(&rig.pass(500)).expect("the last one")["values"]["output_frequency"]["value"],
        139.0
    );
}

#[test]
fn the_state_says_all_that_is_known() {
    let mut rig = Rig::born(MqttVersion::V5);
    let owner_until = MonoTime::from_millis(31_000);
    rig.views[0].control = Some(crate::drive::view::ControlView {
        lease: Some((Owner::Mqtt, owner_until)),
        intent: RunIntent::Run(crate::domain::command::Direction::Forward),
        setpoint: Some(Hertz::from_millihertz(42_500)),
        start_inhibited: true,
        last: Some(Report::new(Outcome::Confirmed, Reason::None)),
        epoch: 7,
        ..idle_control()
    });
    let state = state(&rig.pass(1_000)).expect("a state");
    let control = json!({
        "owner": "mqtt", "lease_until": "2026-01-01T00:00:30.000Z", "intent": "forward", "setpoint_hz": 42.5,
        "start_inhibited": true, "command_pending": false, "stop_pending": false, "not_effective": false,
        "output_outside": false, "stopped_elsewhere": false,
        "failsafe": false, "epoch": 7, "outcome": "confirmed", "reason": "none",
    });
    assert_eq!(state["control"], control);
    assert_eq!(
        state["capabilities"],
        json!(["stop", "frequency", "forward", "coast", "reset"])
    );
    let output =
        json!({ "value": 30.0, "unit": "Hz", "at": "2026-01-01T00:00:00.000Z", "quality": "good" });
    assert_eq!(state["values"]["output_frequency"], output);
    assert_eq!(
        (&state["run_state"], &state["trip"]["count"]),
        (&json!("stopped"), &json!(2))
    );
}

#[test]
fn a_renewed_lease_alone_is_no_news_until_the_published_end_is_past() {
    let mut rig = Rig::born(MqttVersion::V5);
    let lease = |rig: &mut Rig| {
        let until = MonoTime::from_millis(rig.millis + 30_000);
        rig.views[0].control = Some(crate::drive::view::ControlView {
            lease: Some((Owner::Mqtt, until)),
            ..idle_control()
        });
    };
    lease(&mut rig);
    assert!(state(&polled(&mut rig, 1_000, 3_000)).is_some());
    let mut states = 0;
    for _ in 0..57 {
        lease(&mut rig);
        states += usize::from(state(&polled(&mut rig, 500, 3_000)).is_some());
    }
    assert_eq!(states, 0);
    lease(&mut rig);
    assert!(state(&polled(&mut rig, 2_000, 3_000)).is_some());
}

#[test]
fn a_trip_is_shown_with_its_record_and_taken_back() {
    let mut rig = Rig::born(MqttVersion::V5);
    let at = rig.now();
    rig.views[0].trip.active = Some(true);
    rig.views[0].trip.last = Some(TripRecord {
        at,
        code: Some(9),
        words: vec![(0x0114_u16.into(), 4_215)],
    });
    let acts = rig.acts();
    assert_eq!(
        on(&acts, "drive/pump/trip/last"),
        None,
        "it is not kept yet"
    );
    rig.views[0].trip_kept.last = rig.views[0].trip.last.clone();
    let acts = [acts, rig.acts()].concat();
    assert_eq!(on(&acts, "drive/pump/trip/active").as_deref(), Some("true"));
    assert_eq!(on(&acts, "drive/pump/trip/code").as_deref(), Some("9"));
    assert_eq!(on(&acts, "drive/pump/trip/text").as_deref(), Some("code 9"));
    let last = r#"{"at":"2026-01-01T00:00:00.000Z","code":9,"text":"code 9","values":{"trip_frequency":{"unit":"Hz","value":42.15}}}"#;
    assert_eq!(on(&acts, "drive/pump/trip/last").as_deref(), Some(last));
    rig.views[0].trip.active = Some(false);
    let acts = rig.acts();
    assert_eq!(on(&acts, "drive/pump/trip/code").as_deref(), Some("0"));
    assert_eq!(on(&acts, "drive/pump/trip/text").as_deref(), Some(""));
    assert_eq!(on(&acts, "drive/pump/trip/last"), None, "it stays");
    rig.views[0].trip.active = None;
    let acts = rig.acts();
    assert_eq!(on(&acts, "drive/pump/trip/active").as_deref(), Some(""));
    assert_eq!(on(&acts, "drive/pump/trip/code").as_deref(), Some(""));
}

#[test]
fn a_line_says_why_it_is_down_and_its_counters_come_every_ten_seconds() {
    let mut rig = Rig::born(MqttVersion::V5);
    rig.pass(1_000);
    rig.lines[0].report.state = LineState::Down;
    rig.lines[0].report.fault = Some(LineFault::Gone);
    rig.lines[0].report.counters.silent = 5;
    let acts = rig.acts();
    assert_eq!(
        published_texts(&acts),
        [(
            "line/hall/status".to_owned(),
            "down: the device is gone".to_owned()
        )]
    );
    let stats = on(&rig.pass(9_000), "line/hall/stats").expect("counters");
    assert_eq!(
        serde_json::from_str::<Value>(&stats).expect("JSON")["silent"],
        5
    );
}

#[test]
fn a_line_shows_what_was_planned_beside_what_was_measured() {
    let mut rig = Rig::born(MqttVersion::V5);
    let report = &mut rig.lines[0].report;
    report.planned_use_per_mille = 625;
    report.stop.one_silent = Duration::from_micros(560_001);
    report.measured.longest_stop = Duration::from_millis(17);
    let reads = ReplyReport {
        count: 1200,
        p999: Duration::from_micros(7_300),
        ..ReplyReport::default()
    };
    let timeout = Duration::from_millis(500);
    let unseen = ReplyReport {
        timeout,
        ..ReplyReport::default()
    };
    let station = StationReport {
        replies: [reads, unseen, unseen],
        exchanges: ExchangeCounts {
            retries: 2,
            ..ExchangeCounts::default()
        },
        ..StationReport::default()
    };
    rig.lines[0].stations = vec![Arc::new(station)];
    let acts = rig.pass(10_000);
    let document =
        |topic| serde_json::from_str::<Value>(&on(&acts, topic).expect("counters")).expect("JSON");
    let stats = document("line/hall/stats");
    let budget = &stats["budget"];
    assert_eq!(
        (&budget["planned_use_percent"], &budget["longest_stop_ms"]),
        (&62.5.into(), &17.into())
    );
    assert_eq!(budget["worst_stop_ms"], 561, "a bound is not rounded down");
    let drive = document("drive/pump/stats");
    assert_eq!(
        (&drive["name"], &drive["retries"]),
        (&"pump".into(), &2.into())
    );
    assert_eq!(
        (&drive["read"]["count"], &drive["read"]["p999_us"]),
        (&1200.into(), &7300.into())
    );
    assert_eq!(
        (&drive["write"]["timeout_ms"], &drive["write"]["p50_us"]),
        (&500.into(), &Value::Null)
    );
}

#[test]
fn a_parameter_is_published_when_it_was_asked_for_and_cleared_when_old() {
    let mut rig = Rig::born(MqttVersion::V4);
    let answer = |rig: &mut Rig| {
        let acts = rig.send("drive/pump/param/f007/get", b"");
        let ticket = super::harness::reads(&acts)[0].ticket;
        let outcome = NativeOutcome::Words(vec![105].into());
        let answer = NativeAnswer {
            asker: crate::domain::ids::AskerId::MQTT,
            ticket,
            outcome,
        };
        rig.session.native_answer(rig.at(), &answer);
        rig.acts()
    };
    for _ in 0..2 {
        let acts = answer(&mut rig);
        assert_eq!(
            on(&acts, "drive/pump/param/F007").as_deref(),
            Some("10.5"),
            "also if nothing changed"
        );
        assert_eq!(
            super::harness::results(&acts)[0]["values"],
            json!({ "F007": 10.5 })
        );
    }
    rig.handle(crate::north::broker::BrokerEvent::Lost);
    assert_eq!(
        on(&rig.connect(), "drive/pump/param/F007").as_deref(),
        Some("10.5"),
        "part of the birth"
    );
    assert_eq!(
        on(&rig.pass(180_000), "drive/pump/param/F007").as_deref(),
        Some("")
    );
}

#[test]
fn pictures_that_change_while_they_are_walked_are_shown_in_the_end() {
    let mut rig = Rig::born(MqttVersion::V5);
    rig.poll(0, 4_000);
    let first: Vec<_> = rig.views.iter().cloned().map(Arc::new).collect();
    let act = rig
        .session
        .next_act(rig.stage.at(), &first, &rig.stage.lines);
    assert!(act.is_some());
    rig.views[0].line_is_up = false;
    let acts = rig.acts();
    assert_eq!(
        on(&acts, "drive/pump/availability").as_deref(),
        Some("offline")
    );
}
