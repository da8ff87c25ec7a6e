//! Commands of hosts: what is given to the drives, what is refused, and what is published about it.

use super::harness::*;
use super::payload::{PayloadMetric, PayloadValue, SparkplugPayload};
use crate::domain::command::{Direction, GoOrder, Order, Outcome, Owner, Reason};
use crate::domain::frequency::Hertz;
use crate::domain::ids::AskerId;
use crate::journal::TriedWrite;
use crate::north::broker::{BrokerEvent, BrokerMessage, Qos};
use std::time::Duration;

const DCMD: &str = "spBv1.0/hall 1/DCMD/plant/pump";

fn go(frequency: Option<u32>, run: Option<Direction>) -> Order {
    Order::Go(GoOrder::new(Vec::new(), frequency.map(Hertz::from_millihertz), run).unwrap())
}

fn stop() -> Order {
    Order::Stop { setpoint: None }
}

/// What is published about the last command: outcome, reason, message.
fn published_outcome(acts: &[SessionAct], births: &[Sent]) -> Vec<String> {
    let data = sent(acts);
    let words = ["result/outcome", "result/reason", "result/message"];
    let alias = |name: &str| {
        births
            .iter()
            .find(|it| it.kind == "DBIRTH pump")
            .unwrap()
            .metric(name)
            .alias
    };
    let value = |name: &&str| {
        let mut metrics = data.iter().flat_map(|it| &it.payload.metrics);
        let found = metrics.rfind(|it| it.alias == alias(name));
        match found.and_then(|it| it.value.clone()) {
            Some(PayloadValue::Text(text)) => text,
            other => format!("{other:?}"),
        }
    };
    words.iter().map(value).collect()
}

/// A rig with what was born.
fn born() -> (Rig, Vec<Sent>) {
    let mut rig = Rig::new();
    rig.poll(0, 3_000);
    rig.connect(0);
    let births = sent(&rig.host(true, 1));
    (rig, births)
}

#[test]
fn metrics_become_orders() {
    let forward = Some(Direction::Forward);
    let table = [
        (vec![text("run/set", "stop")], stop()),
        (vec![text("run/set", " STOP ")], stop()),
        (vec![text("run/set", "coast")], Order::Coast),
        (vec![text("run/set", "forward")], go(None, forward)),
        (
            vec![metric("frequency/set", PayloadValue::Double(42.5))],
            go(Some(42_500), None),
        ),
        (
            vec![metric("frequency/set", PayloadValue::Float(42.1))],
            go(Some(42_100), None),
        ),
        (
            vec![metric("frequency/set", PayloadValue::Int(42))],
            go(Some(42_000), None),
        ),
        (
            vec![metric("frequency/set", PayloadValue::Long(42))],
            go(Some(42_000), None),
        ),
        (
            vec![
                text("run/set", "forward"),
                metric("frequency/set", PayloadValue::Double(30.0)),
            ],
            go(Some(30_000), forward),
        ),
        (
            vec![metric("trip/reset", PayloadValue::Boolean(true))],
            Order::Reset,
        ),
        (
            vec![metric("lease", PayloadValue::Boolean(true))],
            Order::Renew,
        ),
        // A stop counts, whatever else the message contains.
        (
            vec![text("run/set", "forward"), text("run/set", "stop")],
            stop(),
        ),
        (
            vec![text("run/sett", "forward"), text("run/set", "stop")],
            stop(),
        ),
        (
            vec![text("run/set", "coast"), text("run/set", "stop")],
            stop(),
        ),
    ];
    for (metrics, order) in table {
        let (mut rig, _) = born();
        let acts = rig.command(metrics.clone());
        assert_eq!(orders(&acts), [&order], "{metrics:?}");
        let request = commands(&acts)[0];
        assert_eq!(
            (request.asker, request.origin.owner),
            (AskerId::SPARKPLUG, Owner::Sparkplug)
        );
        assert_eq!(request.start_before, rig.at().mono + Duration::from_secs(1));
    }
}

#[test]
fn an_alias_means_what_the_birth_says() {
    let (mut rig, births) = born();
    let alias = births[1].metric("run/set").alias;
    let by_alias = |alias| PayloadMetric {
        alias,
        value: Some(PayloadValue::Text("forward".into())),
        ..PayloadMetric::default()
    };
    assert_eq!(
        orders(&rig.command(vec![by_alias(alias)])),
        [&go(None, Some(Direction::Forward))]
    );
    for unknown in [Some(0), Some(1), Some(u64::MAX), None] {
        assert_eq!(
            commands(&rig.command(vec![by_alias(unknown)])).len(),
            0,
            "{unknown:?}"
        );
    }
}

#[test]
fn what_is_not_exactly_known_is_refused_as_a_whole_and_in_words() {
    let frequency = || metric("frequency/set", PayloadValue::Double(30.0));
    let table = [
        (
            vec![frequency(), text("run/sett", "forward")],
            Reason::NotUnderstood,
            "is it `run/set`?",
        ),
        (
            vec![frequency(), text("run/state", "forward")],
            Reason::NotUnderstood,
            "`run/state` is not written",
        ),
        (
            vec![text("run/set", "start")],
            Reason::NotUnderstood,
            "`forward`, `reverse`, `stop` or `coast`",
        ),
        (
            vec![metric("run/set", PayloadValue::Int(1))],
            Reason::NotUnderstood,
            "takes text",
        ),
        (
            vec![text("frequency/set", "30")],
            Reason::NotANumber,
            "such as 42.5",
        ),
        (
            vec![metric("frequency/set", PayloadValue::Double(f64::NAN))],
            Reason::NotANumber,
            "frequency/set",
        ),
        (
            vec![metric("frequency/set", PayloadValue::Long(u64::MAX))],
            Reason::OutsideLimits,
            "frequency/set",
        ),
        (
            vec![PayloadMetric {
                is_null: Some(true),
                ..frequency()
            }],
            Reason::NotANumber,
            "frequency/set",
        ),
        (
            vec![frequency(), frequency()],
            Reason::Conflict,
            "one message carries",
        ),
        (
            vec![
                frequency(),
                metric("trip/reset", PayloadValue::Boolean(true)),
            ],
            Reason::Conflict,
            "one message carries",
        ),
        (
            vec![metric("trip/reset", PayloadValue::Int(1))],
            Reason::NotUnderstood,
            "accepts only true",
        ),
    ];
    for (metrics, reason, says) in table {
        let (mut rig, births) = born();
        let acts = rig.command(metrics.clone());
        assert_eq!(commands(&acts).len(), 0, "{metrics:?}");
        let [outcome, word, message] = &published_outcome(&acts, &births)[..] else {
            panic!()
        };
        assert_eq!(
            (outcome.as_str(), word.as_str()),
            ("refused", reason.keyword()),
            "{metrics:?}: {message}"
        );
        assert!(message.contains(says), "{message}");
        assert_eq!(kept(&acts).len(), 1, "{metrics:?}");
    }
    let (mut rig, _) = born();
    assert_eq!(
        rig.command(vec![metric("trip/reset", PayloadValue::Boolean(false))]),
        [],
        "a button that is not down"
    );
    assert_eq!(rig.command(Vec::new()), []);
}

#[test]
fn bytes_that_are_no_payload_are_refused_and_kept() {
    let (mut rig, births) = born();
    let acts = rig.deliver(&message(DCMD, b"\x12\xFF stop"));
    assert_eq!(
        published_outcome(&acts, &births)[..2],
        [
            "refused".to_owned(),
            Reason::NotUnderstood.keyword().to_owned()
        ]
    );
    assert!(matches!(&kept(&acts)[0].tried, TriedWrite::Text(_)));
    let acts = rig.deliver(&message("spBv1.0/hall 1/DCMD/plant/pumpe", &[]));
    assert_eq!(kept(&acts)[0].report.unwrap().reason, Reason::UnknownDrive);
}

#[test]
fn a_retained_command_is_a_replay_and_a_live_stop_with_the_flag_is_executed() {
    let (mut rig, births) = born();
    let payload = |metric| {
        SparkplugPayload {
            timestamp: Some(EPOCH_MS.cast_unsigned()),
            metrics: vec![metric],
            seq: None,
        }
        .bytes()
    };
    let run = payload(text("run/set", "forward"));
    let acts = rig.deliver(&BrokerMessage {
        retain: true,
        ..message(DCMD, &run)
    });
    assert_eq!(
        (
            commands(&acts).len(),
            published_outcome(&acts, &births)[1].as_str()
        ),
        (0, "retained")
    );
    assert_eq!(rig.session.counters().refused_retained, 1);
    let halt = payload(text("run/set", "stop"));
    let acts = rig.deliver(&BrokerMessage {
        retain: true,
        ..message(DCMD, &halt)
    });
    assert_eq!(
        orders(&acts),
        [&stop()],
        "with MQTT 5 none is delivered at subscribe"
    );
    let acts = rig.deliver(&BrokerMessage {
        duplicate: true,
        ..message(DCMD, &run)
    });
    assert_eq!(
        (
            commands(&acts).len(),
            published_outcome(&acts, &births)[1].as_str()
        ),
        (0, "duplicate")
    );
}

#[test]
fn an_old_command_is_refused_with_its_age_and_an_old_stop_is_not() {
    let (mut rig, births) = born();
    rig.pass(60_000);
    let now = rig.unix_ms();
    let give = |rig: &mut Rig, timestamp, word: &str| {
        let payload = SparkplugPayload {
            timestamp,
            metrics: vec![text("run/set", word)],
            seq: None,
        }
        .bytes();
        rig.deliver(&message(DCMD, &payload))
    };
    for timestamp in [Some(now - 10_001), Some(0), None] {
        let acts = give(&mut rig, timestamp, "forward");
        assert_eq!(
            (
                commands(&acts).len(),
                published_outcome(&acts, &births)[1].as_str()
            ),
            (0, "stale"),
            "{timestamp:?}"
        );
    }
    for timestamp in [now + 2_001, now + 50_000, u64::MAX] {
        let acts = give(&mut rig, Some(timestamp), "forward");
        assert_eq!(
            (
                commands(&acts).len(),
                published_outcome(&acts, &births)[1].as_str()
            ),
            (0, "clock_ahead"),
            "{timestamp}"
        );
    }
    let acts = give(&mut rig, Some(now - 12_300), "forward");
    assert!(
        published_outcome(&acts, &births)[2].contains("12.3 s ago"),
        "{:?}",
        published_outcome(&acts, &births)
    );
    for timestamp in [Some(now - 60_000), None] {
        assert_eq!(
            orders(&give(&mut rig, timestamp, "stop")),
            [&stop()],
            "{timestamp:?}"
        );
    }
    let acts = give(&mut rig, Some(now - 9_000), "forward");
    assert_eq!(
        commands(&acts)[0].issued,
        Some(rig.at().mono.before(Duration::from_secs(9)))
    );
    let acts = give(&mut rig, Some(now + 1_500), "forward");
    let come = rig.at().mono;
    assert_eq!(commands(&acts)[0].issued, Some(come), "it counts as now");
    rig.pass(1_000);
    let acts = give(&mut rig, Some(now + 1_500), "forward");
    assert_eq!(
        commands(&acts)[0].issued,
        Some(come),
        "and as the same moment when it comes again"
    );
}

#[test]
fn a_command_without_a_proven_way_back_is_refused_and_a_stop_is_not() {
    let mut rig = Rig::new();
    rig.poll(0, 3_000);
    rig.connect(0);
    assert_eq!(
        orders(&rig.command(vec![text("run/set", "forward")])),
        Vec::<&Order>::new(),
        "the host is not there"
    );
    assert_eq!(
        orders(&rig.command(vec![text("run/set", "stop")])),
        [&stop()]
    );
    rig.is_deaf = true;
    rig.host(true, 1);
    assert_eq!(
        commands(&rig.command(vec![text("run/set", "forward")])).len(),
        0,
        "no probe returned"
    );
    rig.is_deaf = false;
    rig.pass(1_000);
    assert_eq!(
        commands(&rig.command(vec![text("run/set", "forward")])).len(),
        1
    );
}

#[test]
fn while_the_probe_is_overdue_everything_but_a_stop_is_stale_until_a_later_one_is_back() {
    let (mut rig, births) = born();
    rig.pass(20_000);
    rig.is_deaf = true;
    rig.millis += 1_000;
    let is_probe = |act: &SessionAct| matches!(act, SessionAct::Publish(it) if it.topic == PROBE && it.qos == Qos::AtLeastOnce);
    assert!(
        rig.acts().iter().any(is_probe),
        "it waits where commands wait"
    );
    rig.millis += 200;
    assert_eq!(
        commands(&rig.command(vec![text("run/set", "forward")])).len(),
        1,
        "not late yet"
    );
    rig.millis += 600;
    for metric in [
        text("run/set", "forward"),
        metric("frequency/set", PayloadValue::Double(30.0)),
    ] {
        let acts = rig.command(vec![metric]);
        assert_eq!(
            (
                commands(&acts).len(),
                published_outcome(&acts, &births)[1].as_str()
            ),
            (0, "stale")
        );
        assert!(
            published_outcome(&acts, &births)[2]
                .contains("the gateway's probe through the broker is late")
        );
    }
    assert_eq!(
        orders(&rig.command(vec![text("run/set", "stop")])),
        [&stop()]
    );
    rig.is_deaf = false;
    rig.pass(1_000);
    assert_eq!(
        commands(&rig.command(vec![text("run/set", "forward")])).len(),
        1,
        "it is back"
    );
}

#[test]
fn stop_for_all_stops_those_that_a_host_may_command() {
    let (mut rig, _) = born();
    assert_eq!(
        orders(&rig.node_command(vec![text("all/run/set", "stop")])),
        [&stop()],
        "`fan` has no control"
    );
    for bad in [
        text("all/run/set", "forward"),
        metric("all/run/set", PayloadValue::Boolean(true)),
    ] {
        let acts = rig.node_command(vec![bad]);
        assert_eq!((commands(&acts).len(), kept(&acts).len()), (0, 1));
    }
    assert_eq!(rig.node_command(vec![text("Node Control/Reboot", "x")]), []);
    assert_eq!(rig.session.counters().ignored, 1);
}

#[test]
fn what_becomes_of_a_command_is_reported_at_each_stage_and_counted() {
    let (mut rig, births) = born();
    let acts = rig.command(vec![text("run/set", "forward")]);
    let ticket = commands(&acts)[0].ticket;
    let acts = rig.answer(ticket, Outcome::Acknowledged, Reason::None, false);
    assert_eq!(published_outcome(&acts, &births)[0], "acknowledged");
    let acts = rig.answer(ticket, Outcome::Confirmed, Reason::None, true);
    assert_eq!(published_outcome(&acts, &births)[0], "confirmed");
    let count = births[1].metric("result/count").alias;
    let data = sent(&acts);
    assert!(
        data[0]
            .payload
            .metrics
            .iter()
            .any(|it| it.alias == count && it.value == Some(PayloadValue::Long(2)))
    );
    assert_eq!(
        rig.answer(ticket, Outcome::Failed, Reason::NoReply, true),
        [],
        "it is no longer pending"
    );
    let acts = rig.command(vec![metric("frequency/set", PayloadValue::Double(300.0))]);
    let ticket = commands(&acts)[0].ticket;
    let acts = rig.answer(ticket, Outcome::Refused, Reason::OutsideLimits, true);
    assert!(
        published_outcome(&acts, &births)[2].contains("300.00 Hz is outside the limits of "),
        "{:?}",
        published_outcome(&acts, &births)
    );
}

#[test]
fn commands_without_an_answer_are_bounded_and_given_up_in_the_end() {
    let (mut rig, births) = born();
    for _ in 0..64 {
        assert_eq!(
            commands(&rig.command(vec![text("run/set", "forward")])).len(),
            1
        );
    }
    let acts = rig.command(vec![text("run/set", "forward")]);
    assert_eq!(
        (
            commands(&acts).len(),
            published_outcome(&acts, &births)[1].as_str()
        ),
        (0, "queue_full")
    );
    for _ in 0..100 {
        assert_eq!(
            orders(&rig.command(vec![text("run/set", "stop")])),
            [&stop()],
            "a stop always fits"
        );
    }
    rig.pass(2_000_000);
    assert_eq!(rig.session.counters().unanswered, 64 + 4);
    assert_eq!(
        commands(&rig.command(vec![text("run/set", "forward")])).len(),
        1,
        "there is room again"
    );
}

#[test]
fn a_stop_goes_before_what_waits_here_for_its_drive() {
    let (mut rig, _) = born();
    let payload = |metric| {
        SparkplugPayload {
            timestamp: Some(EPOCH_MS.cast_unsigned()),
            metrics: vec![metric],
            seq: None,
        }
        .bytes()
    };
    for metric in [
        text("run/set", "forward"),
        metric("lease", PayloadValue::Boolean(true)),
        text("run/set", "stop"),
    ] {
        rig.handle(BrokerEvent::Message(message(DCMD, &payload(metric))));
    }
    let mut inward = Vec::new();
    while let Some(act) = rig.session.next_inward() {
        inward.push(act);
    }
    assert_eq!(
        orders(&inward),
        [&stop(), &Order::Renew],
        "renewing a lease moves nothing"
    );
    assert_eq!(
        kept(&inward)[0].report.unwrap().outcome,
        Outcome::Superseded
    );
}
