//! Documents of drives of every built-in model, of lines, and the advice on them.

use super::gateway::{BrokerWay, PageJournal};
use super::line_use::LineRates;
use super::testing::{NOW, NOW_TEXT, clock, description, drive, models, view};
use super::trend::{ROWS_MAX, ROWS_RECENT, STEP};
use super::{DriveTrends, PageDrive, PageGateway, PageLine, PageMoment, trips};
use crate::domain::command::{Outcome, Owner, Reason, Report, RunIntent};
use crate::domain::control::FailSafe;
use crate::domain::fail_safe::{FailSafeCause, FailSafeRun, FailSafeStage};
use crate::domain::frequency::Hertz;
use crate::domain::ids::{Name, Station};
use crate::domain::link::{Interface, Wiring};
use crate::domain::report::{
    LineFault, LineMeasured, LineQuality, LineReport, LineState, StopBounds,
};
use crate::domain::standby::{LineRole, StandbyReport, StandbyTrouble};
use crate::domain::suspicion::LineSuspicion;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::sight::{LastSeen, SeenAt, SightView};
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{DriveView, RunState, TripRecord};
use crate::drive::watchdog::{WatchdogState, WatchdogView};
use crate::north::broker::OversizedPublication;
use crate::north::finding::{FindingSign, Severity, ranked};
use crate::profile::model::{PollClass, Register, RegisterRole};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

/// Output frequency, F001 and F010 of the N700. Typed from the manual.
const OUTPUT: u16 = 0x0101;
const SETTING: u16 = 0x0201;
const FREQUENCY_SOURCE: u16 = 0x0211;

fn document(description: &DriveDescription, view: &DriveView, now: MonoTime) -> Value {
    drive(description, view).document(&PageMoment {
        now,
        clock: &clock(),
    })
}

fn values(document: &Value) -> &[Value] {
    document["values"].as_array().unwrap()
}

fn value<'d>(document: &'d Value, role: &str) -> &'d Value {
    values(document)
        .iter()
        .find(|value| value["role"] == role)
        .unwrap_or_else(|| panic!("no {role}"))
}

#[test]
fn a_warning_that_is_a_field_of_a_word_is_shown_alone() {
    let mut description = description("teco-e510");
    let mut model = (*description.model).clone();
    let register = model
        .registers
        .iter_mut()
        .find(|it| it.role == Some(RegisterRole::TripCode))
        .unwrap();
    register.role = Some(RegisterRole::WarningBits);
    register.form.mask = 0x00F0;
    description.model = Arc::new(model);
    let warning = |word| document(&description, &view(&description, word), NOW)["warning"].clone();
    assert_eq!(warning(0xFF5F), json!("bit 0; bit 2"));
    assert_eq!(
        warning(0xFF0F),
        json!(null),
        "the other bits of the word are none of its own"
    );
}

#[test]
fn the_state_of_the_drive_is_shown_in_its_own_words() {
    let start = include_str!("../../../../../tests/golden/models/start.toml");
    let model = Arc::new(crate::profile::check::model(start).unwrap());
    let description = DriveDescription {
        model,
        ..description("teco-e510")
    };
    let shown = |word, at| {
        let document = document(&description, &view(&description, word), at);
        let status = values(&document)
            .iter()
            .find(|value| value["name"] == "status")
            .unwrap();
        (document["drive_state"].clone(), status["text"].clone())
    };
    assert_eq!(
        shown(0x8223, NOW),
        (json!("switched on"), json!("switched on"))
    );
    assert_eq!(
        shown(0x0060, NOW),
        (json!(null), json!(null)),
        "an unknown word has no text"
    );
    assert_eq!(
        shown(0x0021, NOW + Duration::from_secs(60)).0,
        json!(null),
        "an old word is no state"
    );
}

/// The texts of all advice for a drive.
fn advice(description: &DriveDescription, view: &DriveView) -> Vec<(Severity, String)> {
    let advice = drive(description, view).advice(Interface::Rs485, NOW);
    assert!(
        advice
            .iter()
            .all(|it| it.drive.as_ref() == Some(&description.name))
    );
    advice
        .into_iter()
        .map(|it| (it.severity, it.text.to_string()))
        .collect()
}

#[test]
fn the_age_of_a_drive_is_that_of_what_is_read_again_and_again() {
    let description = description("toshiba-vf-as1");
    let mut view = view(&description, 0);
    let later = NOW + Duration::from_secs(600);
    assert_eq!(
        document(&description, &view, later)["oldest_ms"],
        json!(null),
        "all that moves is stale"
    );
    let moves = |register: &&Register| register.poll.is_some_and(PollClass::is_live);
    for register in description.model.registers.iter().filter(moves) {
        view.snapshot.take(register.address, &[0], later);
    }
    let shown = document(&description, &view, later + Duration::from_millis(700));
    assert!(
        values(&shown)
            .iter()
            .any(|value| value["age_ms"] == 600_700),
        "a constant was read long ago"
    );
    assert_eq!(shown["oldest_ms"], 700);
}

#[test]
fn every_model_shows_each_polled_register_with_its_age() {
    for model in models() {
        let description = description(&model);
        let view = view(&description, 3000);
        let shown = document(&description, &view, NOW + Duration::from_millis(250));
        let polled = description
            .model
            .registers
            .iter()
            .filter(|register| register.poll.is_some());
        let names: Vec<_> = polled.map(|register| register.name.as_str()).collect();
        assert_eq!(
            values(&shown)
                .iter()
                .map(|value| value["name"].as_str().unwrap())
                .collect::<Vec<_>>(),
            names
        );
        for value in values(&shown) {
            assert_eq!(
                (&value["quality"], &value["age_ms"]),
                (&json!("good"), &json!(250)),
                "{model} {value}"
            );
            assert!(
                value["value"].is_number() && value["label"].is_string(),
                "{model} {value}"
            );
        }
        assert_eq!(
            shown["output_frequency_hz"], 30.0,
            "{model}: all have steps of 0.01 Hz"
        );
        assert_eq!(
            shown["output_frequency_hz"],
            value(&shown, "output_frequency")["value"],
            "{model}"
        );
        assert_eq!(
            (&shown["model"], &shown["station"], &shown["unit"]),
            (&json!(model), &json!(3), &json!(3))
        );
        assert_eq!(
            (&shown["presence"], &shown["run_state"]),
            (&json!("online"), &json!("stopped")),
            "{model}"
        );
        let control = &shown["control"];
        assert_eq!(
            (&control["min_hz"], &control["max_hz"]),
            (&json!(5.0), &json!(50.0))
        );
        assert_eq!(
            control["from"],
            json!(["mqtt", "modbus-tcp", "page", "sparkplug"])
        );
        assert!(
            control["can"].as_array().unwrap().contains(&json!("stop")),
            "{model}"
        );
    }
}

#[test]
fn what_is_old_is_stale_and_what_was_never_read_is_nothing() {
    for model in models() {
        let description = description(&model);
        let view = view(&description, 3000);
        let seen = drive(&description, &view);
        let first = seen.changes_at(NOW);
        assert_eq!(
            first,
            NOW + Duration::from_secs(3),
            "{model}: fast values, three periods"
        );
        let before = document(&description, &view, first.before(Duration::from_millis(1)));
        let at = first;
        assert_eq!(value(&before, "output_frequency")["quality"], "good");
        let after = document(&description, &view, at);
        assert_eq!(value(&after, "output_frequency")["quality"], "stale");
        assert_eq!(
            value(&after, "output_frequency")["value"],
            30.0,
            "shown with its age"
        );
        assert_eq!(
            after["output_frequency_hz"],
            Value::Null,
            "only what is fresh"
        );
        assert_eq!(seen.changes_at(MonoTime::NEVER), MonoTime::NEVER);
        let never = DriveView::default();
        let shown = document(&description, &never, NOW);
        assert!(
            values(&shown)
                .iter()
                .all(|it| it["quality"] == "never" && it["value"].is_null()),
            "{shown}"
        );
        assert_eq!(
            (&shown["presence"], &shown["run_state"]),
            (&json!("unknown"), &json!("unknown"))
        );
        assert_eq!(
            shown["control"]["intent"], "stop",
            "there is a control section all the same"
        );
    }
}

#[test]
fn per_cent_of_a_rated_value_is_shown_in_its_unit() {
    let description = description("toshiba-vf-s15");
    let view = view(&description, 0x1A8A);
    let shown = document(&description, &view, NOW);
    let current = value(&shown, "output_current");
    // The worked example of the vendor: 67.94 % of 10 A.
    assert_eq!(
        (&current["value"], &current["unit"]),
        (&json!(6.79), &json!("A"))
    );
}

#[test]
fn control_shows_who_holds_it_and_how_the_last_command_ended() {
    let description = description("hyundai-n700");
    let mut view = view(&description, 3000);
    let control = view.control.as_mut().unwrap();
    control.lease = Some((Owner::Mqtt, NOW + Duration::from_secs(2)));
    control.intent = RunIntent::Run(crate::domain::command::Direction::Reverse);
    control.setpoint = Some(Hertz::from_centihertz(4250));
    control.last = Some(Report::held_by(Owner::Mqtt));
    let shown = &document(&description, &view, NOW)["control"];
    assert_eq!(
        (&shown["owner"], &shown["lease_left_ms"]),
        (&json!("mqtt"), &json!(2000))
    );
    assert_eq!(
        (&shown["intent"], &shown["setpoint_hz"]),
        (&json!("reverse"), &json!(42.5))
    );
    let last = json!({ "outcome": "refused", "reason": "other_owner", "message": "mqtt holds control of the drive" });
    assert_eq!(shown["last"], last);
    let shown = &document(&description, &view, NOW + Duration::from_secs(2))["control"];
    assert_eq!(
        (&shown["owner"], &shown["lease_left_ms"]),
        (&Value::Null, &Value::Null),
        "it is over"
    );
    view.control.as_mut().unwrap().lease = Some((Owner::Local, MonoTime::NEVER));
    let shown = &document(&description, &view, NOW)["control"];
    assert_eq!(
        (&shown["owner"], &shown["lease_left_ms"]),
        (&json!("local"), &Value::Null),
        "without an end"
    );
    let read_only = DriveDescription {
        control: None,
        ..description.clone()
    };
    assert_eq!(document(&read_only, &view, NOW)["control"], Value::Null);
}

#[test]
fn a_drive_that_cannot_be_asked_is_offline() {
    let description = description("teco-e510");
    let mut view = DriveView {
        run_state: RunState::Forward,
        ..view(&description, 0)
    };
    view.snapshot.presence = DrivePresence::Offline;
    let shown = document(&description, &view, NOW);
    assert_eq!(
        (&shown["presence"], &shown["run_state"]),
        (&json!("offline"), &json!("offline"))
    );
    let (severity, text) = advice(&description, &view).remove(0);
    assert_eq!(severity, Severity::Problem);
    assert!(text.contains("does not answer as station 3"), "{text}");
    view.line_is_up = false;
    assert!(
        advice(&description, &view)
            .iter()
            .all(|(_, text)| !text.contains("answer")),
        "its line says it"
    );
}

#[test]
fn trips_are_reported_once_with_their_text_and_their_end() {
    let description = description("toshiba-vf-s15");
    let before = view(&description, 0);
    let mut after = before.clone();
    let record = TripRecord {
        at: NOW,
        code: Some(1),
        words: Vec::new(),
    };
    after.trip.active = Some(true);
    after.trip.seen = 1;
    after.trip.last = Some(record);
    let clock = clock();
    let present = PageMoment {
        now: NOW + Duration::from_millis(400),
        clock: &clock,
    };
    let events = trips::between(&present, &description, &before, &after);
    // What the manual is read to say, marked as that.
    let text = "OC1: overcurrent, acceleration (inferred)";
    assert_eq!(
        events,
        [
            json!({ "drive": "pump-1", "kind": "tripped", "code": 1, "text": text, "at": "2024-01-31T08:00:00.000Z" })
        ]
    );
    assert_eq!(
        trips::between(&present, &description, &after, &after),
        [] as [Value; 0]
    );
    let shown = &document(&description, &after, NOW)["trip"];
    assert_eq!(
        (&shown["active"], &shown["code"], &shown["text"]),
        (&json!(true), &json!(1), &json!(text))
    );
    assert_eq!(
        (&shown["seen"], &shown["last_at"]),
        (&json!(1), &json!(NOW_TEXT))
    );
    let mut cleared = after.clone();
    cleared.trip.active = Some(false);
    let kinds = |before: &DriveView, after: &DriveView| -> Vec<String> {
        let events = trips::between(&present, &description, before, after);
        events
            .iter()
            .map(|it| it["kind"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(kinds(&after, &cleared), ["cleared"]);
    assert_eq!(
        kinds(&before, &cleared),
        ["tripped", "cleared"],
        "both between two looks"
    );
    let unknown = DriveView {
        trip: crate::drive::view::TripView {
            active: None,
            ..after.trip.clone()
        },
        ..after.clone()
    };
    assert_eq!(
        kinds(&after, &unknown),
        [] as [&str; 0],
        "what is not known is not over"
    );
}

#[test]
fn a_register_that_keeps_a_drive_from_obeying_is_named_with_what_is_right() {
    let description = description("hyundai-n700");
    let mut view = view(&description, 3);
    view.snapshot.take(SETTING.into(), &[3000], NOW);
    assert_eq!(advice(&description, &view), []);
    view.snapshot.take(FREQUENCY_SOURCE.into(), &[1], NOW);
    let said = advice(&description, &view);
    let (severity, text) = &said[0];
    assert_eq!((said.len(), *severity), (1, Severity::Problem));
    assert!(
        text.starts_with("the drive refuses bus commands: F010 is 1"),
        "{text}"
    );
    assert!(
        text.contains("not 3") && text.contains("vfd-gateway enable pump-1"),
        "{text}"
    );
    let read_only = DriveDescription {
        control: None,
        ..description.clone()
    };
    assert_eq!(advice(&read_only, &view), [], "it takes no commands");
}

#[test]
fn every_model_has_its_setup_judged_where_it_is_polled() {
    for model in models() {
        let description = description(&model);
        let right = view(&description, 0);
        let polled = description.model.setup.iter().filter_map(|item| {
            let register = description.model.register_at(item.address?)?;
            register.poll.map(|_| (item, register.address))
        });
        for (item, address) in polled {
            let mut good = right.clone();
            let mut bad = right.clone();
            let wrong = (0..u16::MAX)
                .find(|word| !item.values.value.contains(word))
                .unwrap();
            good.snapshot.take(address, &[item.values.value[0]], NOW);
            bad.snapshot.take(address, &[wrong], NOW);
            let names = |view: &DriveView| {
                let text = format!("the drive refuses bus commands: {} is {wrong}", item.what);
                advice(&description, view)
                    .iter()
                    .any(|(_, said)| said.starts_with(&text))
            };
            assert!(names(&bad) && !names(&good), "{model} {}", item.what);
        }
    }
}

#[test]
fn a_watchdog_a_stop_without_effect_and_a_refusal_are_reported() {
    let description = description("hyundai-n700");
    let mut view = view(&description, 3);
    view.watchdog = Some(WatchdogView {
        state: WatchdogState::Off,
        ..WatchdogView::default()
    });
    view.status.bus_run = Some(false);
    let control = view.control.as_mut().unwrap();
    control.not_effective = true;
    control.failsafe = Some(FailSafeRun::due(
        FailSafe::Stop,
        FailSafeCause::CommanderLost,
        NOW,
    ));
    control.last = Some(Report::new(Outcome::Failed, Reason::KeptOldValue));
    let said = advice(&description, &view);
    let has = |severity, part: &str| {
        said.iter()
            .any(|(it, text)| *it == severity && text.contains(part))
    };
    assert!(
        has(Severity::Problem, "obeys its panel or terminals"),
        "{said:?}"
    );
    assert!(has(Severity::Problem, "a stop shows no effect"), "{said:?}");
    assert!(
        has(
            Severity::Problem,
            "the drive kept its old value; it may be locked"
        ),
        "{said:?}"
    );
    assert!(
        has(Severity::Hint, "watchdog over the bus is off"),
        "{said:?}"
    );
    assert!(
        has(
            Severity::Problem,
            "the commander was lost. The declared action (stop) is due: nothing was sent"
        ),
        "{said:?}"
    );
    view.control.as_mut().unwrap().last = Some(Report::new(Outcome::Confirmed, Reason::None));
    assert_eq!(advice(&description, &view).len(), said.len() - 1);
}

#[test]
fn a_declared_action_is_called_by_its_cause_and_by_the_stage_that_it_has_reached() {
    let description = description("hyundai-n700");
    for cause in FailSafeCause::ALL {
        for stage in FailSafeStage::ALL {
            let mut view = view(&description, 0);
            let due = FailSafeRun::due(FailSafe::Coast, cause, NOW);
            view.control.as_mut().unwrap().failsafe = Some(FailSafeRun { stage, ..due });
            let said = drive(&description, &view).advice(Interface::Rs485, NOW);
            let findings: Vec<_> = said
                .iter()
                .filter(|it| matches!(it.sign, FindingSign::CommanderLost | FindingSign::FailSafe))
                .collect();
            let [finding] = findings.as_slice() else {
                panic!("{said:?}")
            };
            assert_eq!(
                finding.sign == FindingSign::CommanderLost,
                cause.is_lost_commander()
            );
            let text = finding.text.to_string();
            assert!(
                text.contains("coast") && !text.contains("finding."),
                "{text}"
            );
            assert_eq!(
                text.contains("was carried out"),
                stage == FailSafeStage::Effective,
                "{text}"
            );
            assert_eq!(
                text.contains("commander was lost"),
                cause == FailSafeCause::CommanderLost,
                "{text}"
            );
        }
    }
}

#[test]
fn a_drive_that_may_still_run_is_the_first_problem_whether_the_line_is_up_or_down() {
    let description = description("hyundai-n700");
    for (line_is_up, output, part) in [
        (
            true,
            Some(Hertz::from_millihertz(42_500)),
            "last seen running forward at 42.5 Hz. Go to the drive",
        ),
        (false, None, "last seen running forward. Go to the drive"),
    ] {
        let mut view = view(&description, 0);
        view.line_is_up = line_is_up;
        view.snapshot.presence = DrivePresence::Offline;
        let last_seen = Some(LastSeen {
            run_state: RunState::Forward,
            output,
            at: SeenAt::Here(NOW),
        });
        view.sight = SightView {
            last_seen,
            may_still_run: true,
        };
        let said = ranked(drive(&description, &view).advice(Interface::Rs485, NOW));
        let text = said[0].text.to_string();
        assert!(
            said[0].sign == FindingSign::MayStillRun
                && text.contains("MAY STILL RUN")
                && text.contains(part),
            "{said:?}"
        );
    }
}

#[test]
fn a_warning_is_told_as_long_as_it_is_fresh_and_the_drive_answers() {
    let mut description = description("teco-e510");
    let mut model = (*description.model).clone();
    let register = model
        .registers
        .iter_mut()
        .find(|it| it.role == Some(RegisterRole::TripCode))
        .unwrap();
    register.role = Some(RegisterRole::WarningCode);
    let address = register.address;
    description.model = Arc::new(model);
    let mut view = view(&description, 0);
    view.snapshot.take(address, &[0], NOW);
    let warning = |view: &DriveView, at| {
        let said = drive(&description, view).advice(Interface::Rs485, at);
        let warns = said.into_iter().find(|it| it.sign == FindingSign::Warns)?;
        Some((warns.severity, warns.text.to_string()))
    };
    assert_eq!(warning(&view, NOW), None);
    view.snapshot.take(address, &[9], NOW);
    let text =
        "the drive warns: code 9; it keeps working, and may trip if the cause remains".to_owned();
    assert_eq!(warning(&view, NOW), Some((Severity::Hint, text)));
    assert_eq!(
        warning(&view, NOW + Duration::from_secs(600)),
        None,
        "too old"
    );
    view.snapshot.presence = DrivePresence::Offline;
    assert_eq!(warning(&view, NOW), None);
}

#[test]
fn a_tripped_drive_is_the_first_of_all_problems() {
    let description = description("teco-e510");
    let mut view = view(&description, 0);
    view.trip.active = Some(true);
    view.trip_kept.last_code = Some(16);
    view.control.as_mut().unwrap().not_effective = true;
    let said = drive(&description, &view).advice(Interface::Rs485, NOW);
    let tripped = said
        .iter()
        .find(|it| it.text.to_string().starts_with("the drive is tripped: 16"))
        .unwrap();
    assert_eq!(
        (tripped.severity, tripped.severity.keyword()),
        (Severity::Trip, "problem")
    );
    let others = said
        .iter()
        .filter(|it| it.severity != Severity::Trip)
        .cloned();
    let all = ranked(others.chain([tripped.clone()]));
    assert_eq!(all.first(), Some(tripped));
    view.snapshot.presence = DrivePresence::Offline;
    assert!(
        advice(&description, &view)
            .iter()
            .all(|(_, text)| !text.contains("tripped")),
        "it is unknown by now"
    );
    view.snapshot.presence = DrivePresence::Online;
    view.trip.active = Some(false);
    assert!(
        advice(&description, &view)
            .iter()
            .all(|(_, text)| !text.contains("tripped"))
    );
}

#[test]
fn a_value_says_how_often_it_is_read() {
    let description = description("toshiba-vf-s15");
    let shown = document(&description, &view(&description, 3000), NOW);
    let of =
        |name: &str| values(&shown).iter().find(|it| it["name"] == name).unwrap()["poll"].clone();
    assert_eq!(
        (of("output_frequency"), of("model_code")),
        (json!("fast"), json!("hourly"))
    );
}

#[test]
fn a_setpoint_outside_the_limits_is_reported() {
    let description = description("hyundai-n700");
    let mut view = view(&description, 3);
    view.snapshot.take(SETTING.into(), &[6000], NOW);
    let said = advice(&description, &view);
    assert!(
        said[0]
            .1
            .contains("setpoint of 60 Hz is outside 5 to 50 Hz"),
        "{said:?}"
    );
}

fn up() -> LineReport {
    LineReport {
        state: LineState::Up,
        stop: StopBounds {
            all_healthy: Duration::from_micros(40_100),
            one_silent: Duration::from_millis(560),
            each_further: Duration::from_millis(31),
        },
        planned_use_per_mille: 125,
        measured: LineMeasured {
            longest_stop: Duration::from_millis(17),
            ..LineMeasured::default()
        },
        ..LineReport::default()
    }
}

fn with_line<T>(report: LineReport, hangs: bool, made: impl FnOnce(&PageLine<'_>) -> T) -> T {
    let name = |text| Name::new(text).unwrap();
    let wiring = Wiring {
        port: "/dev/ttyS0".to_owned(),
        stations: vec![Station(3)],
        ..Wiring::default()
    };
    let rates = Some(LineRates {
        use_per_cent: 33.333,
        exchanges_per_s: 12.0,
    });
    let line = name("hall-1");
    let pump = name("pump-1");
    made(&PageLine {
        name: &line,
        interface: Interface::Rs485,
        wiring: &wiring,
        pair: None,
        report: &report,
        hangs,
        rates,
        drives: &[&pump],
    })
}

#[test]
fn a_line_shows_its_wires_its_use_and_its_stops() {
    let shown = with_line(up(), false, |line| line.document());
    let right = json!({
        "name": "hall-1", "port": "/dev/ttyS0", "link": "9600 8N1", "framing": "rtu", "interface": "rs485",
        "state": "up", "reason": null, "reason_said": null, "hangs": false, "use_per_cent": 33.3, "planned_use_per_cent": 12.5,
        "bad_per_cent": null, "is_suspended": false, "exchanges_per_s": 12.0,
        "stop_ms": { "all_healthy": 41, "one_silent": 560, "each_further": 31, "longest_seen": 17 },
        "suspicion": null, "suspicion_said": null, "standby": null, "drives": ["pump-1"],
    });
    assert_eq!(shown, right);
    let down = with_line(LineReport::default(), false, |line| line.document());
    assert_eq!(
        (&down["state"], &down["reason"]),
        (&json!("down"), &json!("not opened yet"))
    );
}

#[test]
fn a_line_in_trouble_says_what_to_look_at() {
    let said = |report, hangs| -> Vec<String> {
        let advice = with_line(report, hangs, |line| line.advice());
        assert!(
            advice
                .iter()
                .all(|it| it.line == Name::new("hall-1") && it.drive.is_none())
        );
        advice
            .into_iter()
            .map(|it| format!("{}: {}", it.severity.keyword(), it.text))
            .collect()
    };
    assert_eq!(said(up(), false), [] as [&str; 0]);
    let gone = LineReport {
        fault: Some(LineFault::Gone),
        ..LineReport::default()
    };
    let text = &said(gone, false)[0];
    assert!(
        text.starts_with("problem: the line is down: the device is gone; check that /dev/ttyS0"),
        "{text}"
    );
    for fault in [
        LineFault::Failed,
        LineFault::Stuck,
        LineFault::Mute,
        LineFault::Echo,
        LineFault::Jammed,
    ] {
        let said = said(
            LineReport {
                fault: Some(fault),
                ..LineReport::default()
            },
            false,
        );
        assert!(
            said.len() == 1 && said[0].contains(&fault.to_string()),
            "{said:?}"
        );
    }
    let hung = said(up(), true);
    assert!(hung[0].contains("restart the gateway"), "{hung:?}");
    let suspected = said(
        LineReport {
            suspicion: Some(LineSuspicion::DuplicateStation(Station(3))),
            ..up()
        },
        false,
    );
    assert!(
        suspected[0].contains("more answers from station 3 than requests to it"),
        "{suspected:?}"
    );
    let bad = |bad_per_cent, is_suspended| LineQuality {
        bad_per_cent: Some(bad_per_cent),
        is_suspended,
    };
    let suspended = said(
        LineReport {
            quality: bad(12, true),
            ..up()
        },
        false,
    );
    assert!(
        suspended[0].starts_with("problem: 12 % of the last exchanges failed: run orders"),
        "{suspended:?}"
    );
    let poor = said(
        LineReport {
            quality: bad(2, false),
            ..up()
        },
        false,
    );
    assert!(poor[0].starts_with("hint: 2 %"), "{poor:?}");
    let full = said(
        LineReport {
            planned_use_per_mille: 1430,
            ..up()
        },
        false,
    );
    assert!(
        full[0].starts_with("hint: the polls would need 143 %"),
        "{full:?}"
    );
}

#[test]
fn a_line_with_several_gateways_tells_who_sends() {
    let signs_of = |role, hears_other, rivals, trouble| {
        let listener = (role == LineRole::Active).then_some(rivals == 0);
        let standby = StandbyReport {
            role,
            take_overs: 1,
            given_up: 1,
            rivals,
            hears_other,
            listener,
            kept: 0,
            trouble,
        };
        let advice = with_line(
            LineReport {
                standby: Some(standby),
                ..up()
            },
            false,
            |line| line.advice(),
        );
        advice.into_iter().map(|it| it.sign).collect::<Vec<_>>()
    };
    let said =
        |role, hears_other, rivals| signs_of(role, hears_other, rivals, StandbyTrouble::default());
    assert_eq!(said(LineRole::Listening, true, 0), []);
    assert_eq!(said(LineRole::Active, false, 0), []);
    assert_eq!(
        said(LineRole::Listening, false, 0),
        [FindingSign::NoGatewayActive]
    );
    assert_eq!(
        said(LineRole::Active, false, 2),
        [FindingSign::NoListener, FindingSign::RivalOnLine]
    );
    let trouble = StandbyTrouble {
        is_deaf: true,
        files_differ: true,
        unknown_station: Some(Station(9)),
    };
    let signs = [
        FindingSign::LineDeaf,
        FindingSign::FilesDiffer,
        FindingSign::Stranger,
    ];
    assert_eq!(signs_of(LineRole::Listening, true, 0, trouble), signs);
}

#[test]
fn a_drive_shows_whether_its_gateway_is_on_standby() {
    let description = description("hyundai-n700");
    let view = view(&description, 3000);
    for (standby, right) in [
        (None, json!(null)),
        (Some(LineRole::Listening), json!("listening")),
    ] {
        let drive = PageDrive {
            standby,
            ..drive(&description, &view)
        };
        assert_eq!(
            drive.document(&PageMoment {
                now: NOW,
                clock: &clock()
            })["standby"],
            right
        );
    }
}

#[test]
fn the_gateway_tells_of_its_broker_and_its_journal() {
    let sound = PageGateway {
        name: "plant-a".to_owned(),
        started_at: NOW_TEXT.to_owned(),
        is_ready: true,
        mqtt: Some(BrokerWay {
            is_connected: true,
            ..BrokerWay::default()
        }),
        journal: Some(PageJournal {
            state: "ok",
            is_ok: true,
            reason: None,
            moved_aside: None,
            replaced: None,
            lost: 0,
        }),
        unreachable: None,
    };
    assert_eq!(sound.advice(), []);
    let shown = sound.document(61);
    assert_eq!(
        (&shown["uptime_s"], &shown["mqtt"]["connected"]),
        (&json!(61), &json!(true))
    );
    assert_eq!(shown["journal"], json!({ "state": "ok", "reason": null }));
    let journal = PageJournal {
        state: "failed",
        is_ok: false,
        reason: Some("disk full".to_owned()),
        moved_aside: Some("old.db".to_owned()),
        lost: 2,
        replaced: Some("its file was deleted".to_owned()),
    };
    let lost_reason = Some("broker:1883: Connection refused".to_owned());
    let away = BrokerWay {
        lost_reason,
        ..BrokerWay::default()
    };
    let said = PageGateway {
        mqtt: Some(away),
        ..sound.clone()
    }
    .advice();
    assert!(
        said[0]
            .text
            .to_string()
            .contains("cannot be reached (broker:1883: Connection refused)"),
        "{said:?}"
    );
    let alone = BrokerWay {
        is_connected: true,
        is_partner_missing: true,
        ..BrokerWay::default()
    };
    let said = PageGateway {
        mqtt: Some(alone),
        ..sound.clone()
    }
    .advice();
    assert!(
        said[0].text.to_string().contains("the other gateway"),
        "{said:?}"
    );
    let topic = "vfd/plant-a/drive/pump-1/state".to_owned();
    let oversized = vec![OversizedPublication {
        topic,
        bytes: 2_612,
        limit: 2_000,
    }];
    let clients_gone = Some("homeassistant/status".to_owned());
    let restrained = BrokerWay {
        is_connected: true,
        oversized,
        clients_gone,
        ..BrokerWay::default()
    };
    let said = PageGateway {
        mqtt: Some(restrained),
        ..sound.clone()
    }
    .advice();
    let parts = [
        "up to 2000 bytes, and 1 topics",
        "homeassistant/status says",
    ];
    assert_eq!(said.len(), parts.len());
    assert!(
        said.iter()
            .zip(parts)
            .all(|(it, part)| it.text.to_string().contains(part)),
        "{said:?}"
    );
    assert!(
        said[0].text.to_string().contains("pump-1/state with 2612"),
        "{said:?}"
    );
    let mqtt = Some(BrokerWay {
        is_contested: true,
        ..BrokerWay::default()
    });
    let said: Vec<_> = PageGateway {
        mqtt,
        journal: Some(journal),
        ..sound
    }
    .advice();
    let parts = [
        "another client",
        "(disk full)",
        "kept as old.db",
        "was deleted: do not touch",
        "2 rows",
    ];
    assert_eq!(said.len(), parts.len());
    assert!(
        said.iter()
            .zip(parts)
            .all(|(it, part)| it.text.to_string().contains(part)),
        "{said:?}"
    );
}

#[test]
fn the_trend_of_every_model_has_the_columns_that_it_can_fill() {
    for model in models() {
        let description = description(&model);
        let view = view(&description, 2999);
        let mut trends = DriveTrends::default();
        trends.change_to([&description]);
        trends.note(NOW, [drive(&description, &view)]);
        let shown = trends.document("pump-1", 1_706_688_000, ROWS_MAX).unwrap();
        let names: Vec<_> = shown["columns"]
            .as_array()
            .unwrap()
            .iter()
            .map(|it| it["name"].as_str().unwrap())
            .collect();
        assert_eq!(names[..2], ["output_frequency", "setpoint"], "{model}");
        assert_eq!(shown["values"].as_array().unwrap().len(), names.len());
        assert_eq!(
            shown["values"][0],
            json!([29.99]),
            "{model}: as exact as it was"
        );
        assert_eq!(
            (&shown["step_s"], &shown["end_at_s"]),
            (&json!(2), &json!(1_706_688_000))
        );
    }
    assert!(DriveTrends::default().document("pump-1", 0, 1).is_none());
}

#[test]
fn a_trend_keeps_an_hour_with_gaps_where_nothing_was_known() {
    let description = description("hyundai-n700");
    let mut trends = DriveTrends::default();
    trends.change_to([&description]);
    let newest = |trends: &DriveTrends, rows| {
        trends.document("pump-1", 0, rows).unwrap()["values"][0]
            .as_array()
            .unwrap()
            .clone()
    };
    let rows = |trends: &DriveTrends| newest(trends, ROWS_MAX);
    let at = |row: u32| NOW + STEP * row;
    let mut fresh = view(&description, 0);
    for row in 0..2000 {
        assert!(trends.is_due(at(row)));
        fresh
            .snapshot
            .take(OUTPUT.into(), &[u16::try_from(row).unwrap()], at(row));
        trends.note(at(row), [drive(&description, &fresh)]);
        assert!(!trends.is_due(at(row) + Duration::from_millis(1999)));
    }
    let kept = rows(&trends);
    assert_eq!(
        (kept.len(), &kept[0], &kept[ROWS_MAX - 1]),
        (ROWS_MAX, &json!(2.0), &json!(19.99))
    );
    assert_eq!(newest(&trends, ROWS_RECENT), kept[ROWS_MAX - ROWS_RECENT..]);
    // Nothing was read since, and two rows were missed.
    trends.note(at(2002), [drive(&description, &fresh)]);
    assert_eq!(
        rows(&trends)[ROWS_MAX - 4..],
        [json!(19.99), Value::Null, Value::Null, Value::Null]
    );
    trends.note(at(1_000_000), [drive(&description, &fresh)]);
    assert!(
        rows(&trends).len() == ROWS_MAX && rows(&trends).iter().all(Value::is_null),
        "after a long sleep"
    );
    assert_eq!(trends.newest_at(), Some(at(1_000_000)));
}

#[test]
fn a_drive_that_stays_the_same_keeps_its_trend_over_a_change_of_the_configuration() {
    let old = description("hyundai-n700");
    let mut other = description("teco-e510");
    let mut trends = DriveTrends::default();
    trends.change_to([&old]);
    let view = view(&old, 100);
    trends.note(NOW, [drive(&old, &view)]);
    other.name = Name::new("pump-2").unwrap();
    trends.change_to([&other, &old]);
    let rows = |trends: &DriveTrends, name| {
        trends
            .document(name, 0, 1)
            .map(|it| it["values"][0].as_array().unwrap().len())
    };
    assert_eq!(
        (rows(&trends, "pump-1"), rows(&trends, "pump-2")),
        (Some(1), Some(0))
    );
    let replaced = DriveDescription {
        name: old.name.clone(),
        ..other.clone()
    };
    trends.change_to([&replaced]);
    assert_eq!(
        (rows(&trends, "pump-1"), rows(&trends, "pump-2")),
        (Some(0), None),
        "another drive of that name"
    );
}
