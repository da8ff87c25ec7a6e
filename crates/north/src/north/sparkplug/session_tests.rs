//! Births, data and deaths, by the requirements of the Sparkplug 3.0 specification that each test holds.

use super::harness::*;
use super::payload::{PayloadMetric, PayloadType, PayloadValue, PropertyScalar};
use super::types::Settings;
use crate::domain::report::LineState as PortState;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{RunState, TripRecord};
use crate::north::broker::{BrokerEvent, BrokerLimits, BrokerMessage, Qos, ToLine};
use std::collections::BTreeSet;

fn bdseq(number: u64) -> Option<PayloadValue> {
    Some(PayloadValue::Long(number))
}

fn property(metric: &PayloadMetric, key: &str) -> Option<PropertyScalar> {
    let set = metric.properties.as_ref()?;
    let place = set.keys.iter().position(|it| it == key)?;
    set.values[place].value.clone()
}

/// tck-id-message-flow-edge-node-birth-publish-will-message-topic, -payload, -payload-bdSeq, -qos, -will-retained;
/// tck-id-payloads-ndeath-seq, -will-message-qos, -will-message-retain; tck-id-topics-ndeath-payload.
#[test]
fn the_will_is_ndeath_with_the_number_of_the_connection_and_nothing_else() {
    let mut rig = Rig::new();
    for number in [0, 1, 255, 0] {
        rig.session.connecting(number);
        let will = rig.session.will();
        assert_eq!(
            (will.topic.as_str(), will.retain, will.qos),
            ("spBv1.0/hall 1/NDEATH/plant", false, Qos::AtLeastOnce)
        );
        let sent = &sent(&[SessionAct::Publish(will)])[0];
        assert_eq!((sent.payload.seq, sent.payload.metrics.len()), (None, 1));
        assert_eq!(sent.value("bdSeq"), bdseq(number.into()));
        assert_eq!(
            sent.metric("bdSeq").datatype,
            Some(PayloadType::Int64 as u32)
        );
    }
}

/// tck-id-message-flow-edge-node-ncmd-subscribe, tck-id-message-flow-device-dcmd-subscribe; of what is retained, only the
/// state of the host is asked for.
#[test]
fn commands_and_the_state_of_the_host_are_subscribed_first() {
    let mut rig = Rig::new();
    rig.handle(BrokerEvent::Connected(rig.broker));
    let acts = rig.acts();
    let [SessionAct::Subscribe(filters)] = &acts[..] else {
        panic!("{acts:?}")
    };
    let filters: Vec<_> = filters
        .iter()
        .map(|it| (it.path.as_str(), it.wants_retained))
        .collect();
    let commands = [
        ("spBv1.0/hall 1/NCMD/plant", false),
        ("spBv1.0/hall 1/DCMD/plant/+", false),
        (PROBE, false),
    ];
    assert_eq!(filters, [&commands[..], &[(STATE, true)]].concat());
    rig.handle(BrokerEvent::Subscribed(vec![true, false, true, true]));
    assert!(
        matches!(rig.acts()[..], [SessionAct::Reconnect(_)]),
        "one is not granted"
    );
}

/// tck-id-message-flow-edge-node-birth-publish-phid-wait, -phid-wait-id,
/// tck-id-operational-behavior-edge-node-birth-sequence-wait, tck-id-principles-birth-certificates-order,
/// tck-id-message-flow-device-birth-publish-nbirth-wait.
#[test]
fn nothing_is_published_before_the_primary_host_is_there_and_nbirth_comes_first() {
    let mut rig = Rig::new();
    rig.poll(0, 3_000);
    assert_eq!(rig.connect(7), []);
    assert_eq!(rig.pass(60_000), [], "not even a probe");
    let other = message("spBv1.0/STATE/other", br#"{"online":true,"timestamp":9}"#);
    assert_eq!(
        rig.deliver(&BrokerMessage {
            retain: true,
            ..other
        }),
        [],
        "another host"
    );
    assert_eq!(rig.host(false, 5), []);
    assert_eq!(rig.session.counters().host_awaited, 1);
    rig.poll(0, 3_000);
    let acts = rig.host(true, 6);
    assert_eq!(kinds(&acts), ["NBIRTH", "DBIRTH pump"]);
    assert_eq!(rig.session.counters().host_awaited, 0);
    assert!(rig.session.is_path_alive(rig.at()));
    let mut alone = Rig::with(Settings {
        primary_host: None,
        ..settings()
    });
    assert_eq!(
        kinds(&alone.connect(0)),
        ["NBIRTH"],
        "no host is waited for"
    );
}

/// tck-id-payloads-nbirth-timestamp, -bdseq, -rebirth-req, tck-id-topics-nbirth-seq-num,
/// tck-id-operational-behavior-data-commands-rebirth-name, -rebirth-name-aliases, -rebirth-datatype, -rebirth-value,
/// tck-id-message-flow-edge-node-birth-publish-nbirth-qos, -retained.
#[test]
fn nbirth_carries_the_number_of_the_will_and_what_asks_for_births() {
    let mut rig = Rig::new();
    rig.connect(42);
    let acts = rig.host(true, 1);
    let birth = &sent(&acts)[0];
    assert_eq!(
        (
            birth.kind.as_str(),
            birth.payload.seq,
            birth.payload.timestamp
        ),
        ("NBIRTH", Some(0), Some(rig.unix_ms()))
    );
    assert_eq!(
        (birth.publication.qos, birth.publication.retain),
        (Qos::AtMostOnce, false)
    );
    assert_eq!(
        (birth.value("bdSeq"), birth.metric("bdSeq").alias),
        (bdseq(42), None)
    );
    let rebirth = birth.metric("Node Control/Rebirth");
    assert_eq!(
        (rebirth.alias, rebirth.datatype),
        (None, Some(PayloadType::Boolean as u32))
    );
    assert_eq!(rebirth.value, Some(PayloadValue::Boolean(false)));
    assert_eq!(
        birth.value("line/hall/status"),
        Some(PayloadValue::Text("up".into()))
    );
}

/// tck-id-payloads-name-birth-data-requirement, tck-id-payloads-alias-uniqueness, -alias-birth-requirement,
/// tck-id-payloads-metric-datatype-req, tck-id-payloads-timestamp-in-UTC, tck-id-case-sensitivity-metric-names,
/// tck-id-payloads-dbirth-order, -dbirth-timestamp, tck-id-payloads-propertyset-keys-array-size, -values-array-size,
/// tck-id-payloads-metric-propertyvalue-type-req, tck-id-operational-behavior-data-publish-nbirth-values,
/// -dbirth-values.
#[test]
fn a_birth_says_of_each_metric_its_name_alias_type_and_moment_and_all_are_unique() {
    let mut rig = Rig::new();
    rig.poll(0, 3_000);
    rig.poll(1, 3_000);
    rig.connect(0);
    let births = sent(&rig.host(true, 1));
    assert_eq!(
        births.iter().map(|it| it.kind.as_str()).collect::<Vec<_>>(),
        ["NBIRTH", "DBIRTH pump", "DBIRTH fan"]
    );
    let mut aliases = BTreeSet::new();
    for birth in &births {
        assert_eq!(
            birth.payload.timestamp,
            Some(rig.unix_ms()),
            "{}",
            birth.kind
        );
        let mut names = BTreeSet::new();
        for metric in &birth.payload.metrics {
            let name = metric.name.clone().expect("a name");
            assert!(names.insert(name.to_lowercase()), "{name} twice");
            let has_none = ["bdSeq", "Node Control/Rebirth"].contains(&name.as_str());
            assert!(
                metric.alias.map_or(has_none, |alias| aliases.insert(alias)),
                "{name}: {:?}",
                metric.alias
            );
            assert!(
                metric.datatype.is_some() && metric.timestamp.is_some(),
                "{metric:?}"
            );
            assert_eq!(
                metric.value.is_none(),
                metric.is_null == Some(true),
                "{metric:?}"
            );
            if let Some(set) = &metric.properties {
                assert_eq!(set.keys.len(), set.values.len(), "{set:?}");
                assert!(set.values.iter().all(|it| it.datatype.is_some()), "{set:?}");
            }
        }
    }
    let pump = &births[1];
    assert_eq!(
        pump.value("frequency/output"),
        Some(PayloadValue::Double(30.0))
    );
    assert_eq!(
        property(pump.metric("frequency/output"), "engUnit"),
        Some(PropertyScalar::Text("Hz".into()))
    );
    assert_eq!(
        property(pump.metric("frequency/output"), "readOnly"),
        Some(PropertyScalar::Boolean(true))
    );
    assert_eq!(
        property(pump.metric("frequency/set"), "readOnly"),
        Some(PropertyScalar::Boolean(false))
    );
    assert!(property(pump.metric("frequency/set"), "engHigh").is_some());
    assert_eq!(
        pump.value("run/state"),
        Some(PayloadValue::Text("stopped".into()))
    );
    assert_eq!(
        pump.value("trip/active"),
        Some(PayloadValue::Boolean(false))
    );
    assert_eq!(pump.value("trip/count"), Some(PayloadValue::Int(2)));
    assert!(
        births[2]
            .payload
            .metrics
            .iter()
            .all(|it| it.name.as_deref() != Some("run/set")),
        "no control, no input"
    );
}

/// tck-id-payloads-sequence-num-incrementing, -always-included, -req-nbirth: one count over all messages;
/// tck-id-payloads-ddata-timestamp.
#[test]
fn numbers_run_over_all_messages_of_the_node_and_begin_again_behind_255() {
    let mut rig = Rig::born();
    let mut expected = 2;
    for round in 0..300_u16 {
        rig.poll(0, 1_000 + 100 * (round % 7));
        rig.poll(1, 1_000 + 100 * (round % 5));
        for sent in sent(&rig.pass(500)) {
            assert_eq!(sent.payload.seq, Some(expected), "{}", sent.kind);
            assert!(sent.payload.timestamp.is_some(), "{}", sent.kind);
            expected = (expected + 1) % 256;
        }
    }
    rig.node_command(vec![metric(
        "Node Control/Rebirth",
        PayloadValue::Boolean(true),
    )]);
    let acts = rig.pass(1_000);
    let seqs: Vec<_> = sent(&acts).iter().map(|sent| sent.payload.seq).collect();
    assert!(
        seqs.starts_with(&[Some(0), Some(1), Some(2)]) || rig.session.counters().births == 2,
        "{seqs:?}"
    );
}

/// tck-id-payloads-name-requirement, tck-id-payloads-alias-data-cmd-requirement,
/// tck-id-operational-behavior-data-publish-nbirth-change, -dbirth-change, tck-id-principles-rbe-recommended. The
/// recommendation tck-id-payloads-metric-datatype-not-req is not followed: common decoders need the type.
#[test]
fn data_is_what_has_changed_by_its_alias_alone() {
    let mut rig = Rig::new();
    rig.poll(0, 3_000);
    rig.connect(0);
    let births = sent(&rig.host(true, 1));
    let alias = births[1].metric("frequency/output").alias;
    rig.poll(0, 3_010);
    assert_eq!(
        kinds(&rig.pass(400)),
        Vec::<String>::new(),
        "within the dead band"
    );
    rig.poll(0, 3_100);
    let data = sent(&rig.acts());
    assert_eq!(
        (
            data.len(),
            data[0].kind.as_str(),
            data[0].payload.metrics.len()
        ),
        (1, "DDATA pump", 1)
    );
    let metric = &data[0].payload.metrics[0];
    assert_eq!((metric.alias, &metric.name), (alias, &None));
    assert_eq!(metric.datatype, Some(PayloadType::Double as u32));
    assert_eq!(
        (&metric.value, metric.timestamp),
        (&Some(PayloadValue::Double(31.0)), Some(rig.unix_ms()))
    );
    assert_eq!((metric.is_historical, &metric.properties), (None, &None));
    rig.lines[0].report.state = PortState::Down;
    let data = sent(&rig.acts());
    assert_eq!(data[0].kind, "NDATA");
    assert!(
        matches!(&data[0].payload.metrics[0].value, Some(PayloadValue::Text(text)) if text.starts_with("down: "))
    );
}

#[test]
fn measured_values_are_gathered_for_a_moment_and_a_trip_is_not() {
    let mut rig = Rig::born();
    rig.pass(300);
    rig.poll(0, 4_000);
    assert_eq!(kinds(&rig.acts()), ["DDATA pump"]);
    rig.pass(10);
    rig.poll(0, 5_000);
    assert_eq!(kinds(&rig.acts()), Vec::<String>::new(), "too soon");
    rig.views[0].run_state = RunState::Tripped;
    rig.views[0].trip.active = Some(true);
    let data = sent(&rig.acts());
    let values: Vec<_> = data[0]
        .payload
        .metrics
        .iter()
        .filter_map(|it| it.value.clone())
        .collect();
    assert_eq!(values.len(), 2, "{values:?}");
    assert!(
        values.contains(&PayloadValue::Boolean(true))
            && values.contains(&PayloadValue::Text("tripped".into()))
    );
    let later = sent(&rig.pass(250));
    assert_eq!(
        later[0].payload.metrics[0].value,
        Some(PayloadValue::Double(50.0))
    );
}

/// tck-id-payloads-propertyset-quality-value-type, -value-value.
#[test]
fn a_value_that_grows_stale_is_null_and_marked_until_it_is_read_again() {
    let mut rig = Rig::born();
    let data = sent(&rig.pass(10_000));
    let stale: Vec<_> = data.iter().flat_map(|it| &it.payload.metrics).collect();
    assert!(!stale.is_empty());
    for metric in stale {
        assert_eq!((metric.is_null, &metric.value), (Some(true), &None));
        assert_eq!(property(metric, "Quality"), Some(PropertyScalar::Int(500)));
        assert_eq!(
            metric.properties.as_ref().unwrap().values[0].datatype,
            Some(3)
        );
    }
    rig.poll(0, 3_000);
    let data = sent(&rig.acts());
    assert!(
        data[0]
            .payload
            .metrics
            .iter()
            .all(|it| property(it, "Quality") == Some(PropertyScalar::Int(192)))
    );
}

/// tck-id-operational-behavior-device-ddeath, tck-id-payloads-ddeath-seq-inc, tck-id-payloads-ddeath-timestamp.
#[test]
fn a_drive_that_is_lost_dies_and_is_born_again_when_it_answers() {
    let mut rig = Rig::born();
    rig.views[0].snapshot.presence = DrivePresence::Offline;
    let death = &sent(&rig.acts())[0];
    assert_eq!(
        (
            death.kind.as_str(),
            death.payload.seq,
            death.payload.metrics.len()
        ),
        ("DDEATH pump", Some(2), 0)
    );
    assert!(death.payload.timestamp.is_some());
    assert_eq!(
        kinds(&rig.pass(20_000)),
        Vec::<String>::new(),
        "the dead say nothing"
    );
    rig.poll(0, 3_000);
    let birth = &sent(&rig.acts())[0];
    assert_eq!(
        (birth.kind.as_str(), birth.payload.seq),
        ("DBIRTH pump", Some(3))
    );
}

/// tck-id-operational-behavior-data-commands-rebirth-action-2, -3.
#[test]
fn a_host_that_asks_for_births_gets_all_of_them_with_the_same_number_but_not_more_than_once_a_second()
 {
    let mut rig = Rig::born();
    rig.pass(5_000);
    rig.poll(0, 3_000);
    let ask = || vec![metric("Node Control/Rebirth", PayloadValue::Boolean(true))];
    let acts = rig.node_command(ask());
    let births = sent(&acts);
    assert_eq!(
        births.iter().map(|it| it.kind.as_str()).collect::<Vec<_>>(),
        ["NBIRTH", "DBIRTH pump"]
    );
    assert_eq!(
        (births[0].payload.seq, births[0].value("bdSeq")),
        (Some(0), bdseq(0))
    );
    for _ in 0..5 {
        assert_eq!(kinds(&rig.node_command(ask())), Vec::<String>::new());
    }
    let acts = rig.pass(1_500);
    assert_eq!(
        kinds(&acts).iter().filter(|kind| *kind == "NBIRTH").count(),
        1,
        "five wishes, one birth"
    );
    assert_eq!(
        (
            rig.session.counters().births,
            rig.session.counters().rebirths
        ),
        (3, 2)
    );
    rig.node_command(vec![metric(
        "Node Control/Rebirth",
        PayloadValue::Boolean(false),
    )]);
    let again = metric("Node Control/Rebirth", PayloadValue::Boolean(true));
    let payload = super::payload::SparkplugPayload {
        timestamp: None,
        metrics: vec![again],
        seq: None,
    }
    .bytes();
    rig.deliver(&BrokerMessage {
        retain: true,
        ..message("spBv1.0/hall 1/NCMD/plant", &payload)
    });
    assert_eq!(
        rig.session.counters().rebirths,
        2,
        "false asks for nothing, and what is retained is a replay"
    );
}

/// tck-id-operational-behavior-data-commands-rebirth-action-1: also while the births that are asked for have to wait.
#[test]
fn from_the_wish_for_births_on_no_data_is_sent_and_none_is_lost() {
    let mut rig = Rig::born();
    rig.pass(300);
    rig.node_command(vec![metric(
        "Node Control/Rebirth",
        PayloadValue::Boolean(true),
    )]);
    for output in [4_000, 5_000] {
        rig.poll(0, output);
        assert_eq!(
            kinds(&rig.acts()),
            Vec::<String>::new(),
            "the births are due in less than a second"
        );
        assert_eq!(kinds(&rig.pass(300)), Vec::<String>::new());
    }
    let all = sent(&rig.pass(200));
    assert_eq!(
        (all[0].kind.as_str(), all[1].kind.as_str()),
        ("NBIRTH", "DBIRTH pump")
    );
    let output = all[1].metric("frequency/output");
    assert_eq!(output.value, Some(PayloadValue::Double(50.0)));
    let past = all[2..]
        .iter()
        .flat_map(|it| &it.payload.metrics)
        .filter(|it| it.is_historical == Some(true));
    let past: Vec<_> = past
        .filter(|it| it.alias == output.alias)
        .map(|it| it.value.clone())
        .collect();
    assert_eq!(
        past,
        [
            Some(PayloadValue::Double(40.0)),
            Some(PayloadValue::Double(50.0))
        ]
    );
}

#[test]
fn births_that_wait_for_a_host_that_is_gone_wake_nobody() {
    let mut rig = Rig::born();
    rig.node_command(vec![metric(
        "Node Control/Rebirth",
        PayloadValue::Boolean(true),
    )]);
    assert!(matches!(rig.host(false, 1)[..], [SessionAct::Leave(_)]));
    for _ in 0..20 {
        rig.pass(1_000);
        assert!(
            rig.session
                .next_wake()
                .is_none_or(|wake| wake > rig.at().mono),
            "it would turn without an end"
        );
    }
}

/// tck-id-operational-behavior-data-publish-dbirth-order.
#[test]
fn values_stand_in_the_order_in_which_they_came_about() {
    let mut rig = Rig::new();
    rig.poll(0, 3_000);
    rig.millis += 200;
    rig.connect(0);
    let mut all = sent(&rig.host(true, 1));
    rig.pass(300);
    rig.poll(0, 3_100);
    rig.millis += 100;
    rig.views[0].run_state = RunState::Tripped;
    all.extend(sent(&rig.acts()));
    assert_eq!(
        all.iter().map(|it| it.kind.as_str()).collect::<Vec<_>>(),
        ["NBIRTH", "DBIRTH pump", "DDATA pump"]
    );
    for sent in &all[1..] {
        let moments: Vec<_> = sent.payload.metrics.iter().map(|it| it.timestamp).collect();
        assert!(
            moments.is_sorted() && moments.first() < moments.last(),
            "{}: {moments:?}",
            sent.kind
        );
    }
}

/// tck-id-message-flow-edge-node-birth-publish-phid-offline, tck-id-operational-behavior-edge-node-termination-host-offline,
/// -host-offline-reconnect, -host-offline-timestamp,
/// tck-id-operational-behavior-edge-node-intentional-disconnect-ndeath.
#[test]
fn a_primary_host_that_goes_offline_is_left_with_ndeath_and_the_connection_is_made_again() {
    let mut rig = Rig::born();
    assert_eq!(rig.host(false, 0), [], "older than its birth");
    let acts = rig.host(false, 1);
    assert!(matches!(acts[..], [SessionAct::Leave(_)]), "{acts:?}");
    let farewell: Vec<_> = rig
        .session
        .farewell(rig.at())
        .into_iter()
        .map(SessionAct::Publish)
        .collect();
    let death = &sent(&farewell)[0];
    assert_eq!(
        (death.kind.as_str(), death.value("bdSeq"), death.payload.seq),
        ("NDEATH", bdseq(0), None)
    );
    assert_eq!(death.publication.qos, Qos::AtLeastOnce);
    rig.handle(BrokerEvent::Lost);
    assert!(!rig.session.is_path_alive(rig.at()));
    rig.poll(0, 3_000);
    rig.connect(1);
    assert_eq!(rig.host(false, 1), [], "it waits, and stays connected");
    let births = sent(&rig.host(true, 2));
    assert_eq!(
        (births[0].kind.as_str(), births[0].value("bdSeq")),
        ("NBIRTH", bdseq(1))
    );
    assert_eq!(rig.session.counters().host_losses, 1);
}

/// What happened in between, in order, after the births. The specification explains `is_historical` and has no id for
/// it.
#[test]
fn what_happened_while_no_host_was_there_is_reported_as_history() {
    let mut rig = Rig::born();
    rig.pass(500);
    rig.handle(BrokerEvent::Lost);
    let mut expected = Vec::new();
    for output in [3_500, 4_000, 4_500] {
        rig.poll(0, output);
        rig.acts();
        expected.push((
            rig.unix_ms(),
            PayloadValue::Double(f64::from(output) / 100.0),
        ));
        rig.pass(300);
    }
    let record = TripRecord {
        at: rig.at().mono,
        code: Some(3),
        words: Vec::new(),
    };
    rig.views[0].run_state = RunState::Tripped;
    rig.views[0].trip.active = Some(true);
    rig.views[0].trip_kept.total = 1;
    rig.views[0].trip.last = Some(record.clone());
    rig.views[0].trip_kept.last = Some(record);
    rig.acts();
    assert!(rig.session.counters().history_waiting >= 5);
    rig.pass(100);
    rig.poll(0, 4_500);
    rig.connect(1);
    let all = sent(&rig.host(true, 2));
    let outputs = all[1].metric("frequency/output").alias;
    let total = all[1].metric("trip/total").alias;
    let is_past = |metric: &&PayloadMetric| metric.is_historical == Some(true);
    let past: Vec<_> = all[2..]
        .iter()
        .flat_map(|it| &it.payload.metrics)
        .filter(is_past)
        .collect();
    let past_values: Vec<_> = past
        .iter()
        .filter(|it| it.alias == outputs)
        .map(|it| (it.timestamp.unwrap(), it.value.clone().unwrap()))
        .collect();
    assert_eq!(past_values, expected);
    assert!(
        past.iter()
            .any(|it| it.alias == total && it.value == Some(PayloadValue::Long(1))),
        "{past:?}"
    );
    assert!(all[..2].iter().all(|it| {
        !it.payload
            .metrics
            .iter()
            .any(|it| it.is_historical == Some(true))
    }));
    assert_eq!(rig.session.counters().history_waiting, 0);
}

/// tck-id-topics-ddata-payload: nothing of it is left out because the broker takes small packets only.
#[test]
fn history_comes_in_messages_as_large_as_the_broker_takes() {
    const PACKET_BYTES: usize = 4_096;
    const TRIPS: u32 = 40;
    let mut rig = Rig::born();
    rig.pass(500);
    rig.handle(BrokerEvent::Lost);
    for total in 1..=TRIPS {
        let record = TripRecord {
            at: rig.at().mono,
            code: Some(3),
            words: Vec::new(),
        };
        rig.views[0].trip_kept.total = total;
        rig.views[0].trip.last = Some(record.clone());
        rig.views[0].trip_kept.last = Some(record);
        rig.acts();
        rig.pass(100);
    }
    rig.broker = BrokerLimits {
        maximum_packet_bytes: Some(PACKET_BYTES),
        retains: true,
    };
    rig.poll(0, 3_000);
    rig.connect(1);
    let all = sent(&rig.host(true, 2));
    let last = all[1].metric("trip/last").alias;
    let past = all[2..]
        .iter()
        .flat_map(|it| &it.payload.metrics)
        .filter(|it| it.is_historical == Some(true));
    assert_eq!(past.filter(|it| it.alias == last).count(), TRIPS as usize);
    assert!(
        all.iter()
            .all(|it| it.publication.payload.len() < PACKET_BYTES)
    );
    assert_eq!(
        (
            rig.session.counters().too_large,
            rig.session.counters().history_waiting
        ),
        (0, 0)
    );
}

#[test]
fn what_a_dying_broker_may_not_have_passed_on_is_reported_again() {
    let mut rig = Rig::born();
    rig.pass(2_000);
    rig.is_deaf = true;
    rig.poll(0, 4_100);
    let data = sent(&rig.pass(500));
    assert!(data.iter().any(|it| it.kind == "DDATA pump"));
    rig.handle(BrokerEvent::Lost);
    rig.is_deaf = false;
    rig.connect(1);
    let all = sent(&rig.host(true, 2));
    let is_past = |it: &&PayloadMetric| {
        it.is_historical == Some(true) && it.value == Some(PayloadValue::Double(41.0))
    };
    assert_eq!(
        all.iter()
            .flat_map(|it| &it.payload.metrics)
            .filter(is_past)
            .count(),
        1
    );
    rig.pass(2_000);
    rig.handle(BrokerEvent::Lost);
    rig.connect(2);
    let all = sent(&rig.host(true, 3));
    assert!(
        !all.iter()
            .flat_map(|it| &it.payload.metrics)
            .any(|it| is_past(&it)),
        "proven by a probe since"
    );
}

#[test]
fn a_probe_that_does_not_come_back_ends_the_connection_and_heartbeats_come_with_probes_alone() {
    let mut rig = Rig::born();
    let alive = |acts: &[SessionAct]| {
        acts.iter()
            .filter(|act| **act == SessionAct::ToLine(ToLine::PathAlive))
            .count()
    };
    assert!(alive(&rig.pass(5_000)) >= 4);
    rig.is_deaf = true;
    let acts = rig.pass(10_000);
    assert_eq!(alive(&acts), 0);
    assert!(
        acts.iter()
            .any(|act| matches!(act, SessionAct::Reconnect(_)))
    );
    assert!(!rig.session.is_path_alive(rig.at()));
}

#[test]
fn a_way_that_is_open_for_moments_only_keeps_no_lease() {
    let mut rig = Rig::born();
    let alive = |acts: &[SessionAct]| {
        acts.iter()
            .filter(|act| **act == SessionAct::ToLine(ToLine::PathAlive))
            .count()
    };
    assert!(alive(&rig.pass(10_000)) >= 9);
    let mut number = 0;
    let mut again = |rig: &mut Rig, lives_ms| {
        number += 1;
        rig.handle(BrokerEvent::Lost);
        rig.millis += 1_000;
        let mut acts = rig.connect(number);
        acts.extend(rig.host(true, 1 + u64::from(number)));
        acts.extend(rig.pass(lives_ms));
        alive(&acts)
    };
    for lives_ms in [900, 100, 2_900, 4_900, 0] {
        assert_eq!(again(&mut rig, lives_ms), 0, "{lives_ms} ms");
    }
    assert_eq!(again(&mut rig, 10_000), 6, "from the fifth second on");
}

#[test]
fn who_has_read_every_probe_cannot_write_the_next() {
    let mut rig = Rig::born();
    rig.is_deaf = true;
    let acts = rig.pass(2_500);
    let is_probe = |act: &&SessionAct| matches!(act, SessionAct::Publish(it) if it.topic == PROBE);
    let Some(SessionAct::Publish(probe)) = acts.iter().find(is_probe) else {
        panic!("{acts:?}")
    };
    let text = String::from_utf8(probe.payload.clone()).unwrap();
    let (number, code) = text.split_once('-').unwrap();
    let next = number.parse::<u64>().unwrap() + 1;
    for forged in [
        format!("{next}-{code}"),
        format!("{next}"),
        format!("{}-{next}", rig.at().wall.unix_ms),
    ] {
        let acts = rig.deliver(&message(PROBE, forged.as_bytes()));
        assert!(
            !acts.contains(&SessionAct::ToLine(ToLine::PathAlive)),
            "{forged}"
        );
    }
    assert!(
        rig.deliver(&message(PROBE, text.as_bytes()))
            .contains(&SessionAct::ToLine(ToLine::PathAlive)),
        "its own"
    );
}

#[test]
fn what_is_larger_than_the_broker_takes_is_not_sent_and_uses_no_number() {
    let mut rig = Rig::new();
    rig.broker = BrokerLimits {
        maximum_packet_bytes: Some(700),
        retains: true,
    };
    rig.poll(0, 3_000);
    rig.connect(0);
    assert_eq!(kinds(&rig.host(true, 1)), ["NBIRTH"]);
    assert_eq!(rig.session.counters().too_large, 1);
    rig.lines[0].report.state = PortState::Down;
    assert_eq!(sent(&rig.acts())[0].payload.seq, Some(1));
    assert_eq!(
        rig.session.counters().too_large,
        1,
        "not tried again on this connection"
    );
}

#[test]
fn other_drives_are_born_with_the_node_and_keep_their_history() {
    let mut rig = Rig::born();
    rig.pass(500);
    let mut drives = drives();
    drives.reverse();
    rig.views.reverse();
    rig.session.replace(rig.at(), drives, vec![name("hall")]);
    assert_eq!(kinds(&rig.acts()), ["NBIRTH", "DBIRTH pump"]);
    rig.poll(0, 100);
    assert_eq!(kinds(&rig.acts()), ["DBIRTH fan"]);
}

/// tck-id-message-flow-edge-node-birth-publish-phid-offline.
#[test]
fn a_primary_host_that_goes_offline_before_other_drives_are_born_is_left_all_the_same() {
    let mut rig = Rig::born();
    rig.session.replace(rig.at(), drives(), vec![name("hall")]);
    assert!(
        matches!(rig.host(false, 1)[..], [SessionAct::Leave(_)]),
        "it had received the births before"
    );
}
