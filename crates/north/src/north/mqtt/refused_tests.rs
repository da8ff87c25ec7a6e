//! A broker that does not accept events: what is sent again, what is given up, and that nothing is blocked for ever.

use super::harness::{BrokerSession, Rig, SessionAct, drives, publications, settings};
use super::types::Settings;
use crate::journal::StoredEvent;
use crate::north::broker::{BrokerEvent, MqttVersion, PublicationRefusal};

/// A session with `count` stored events on their way to the broker.
fn rig(count: u64) -> (Rig, Vec<SessionAct>) {
    let mut rig = Rig::born(MqttVersion::V5);
    let drive = drives().swap_remove(0).name;
    let event = |seq: u64| StoredEvent {
        seq,
        drive: drive.clone(),
        body: seq.to_string(),
    };
    let events: Vec<_> = (1..=count).map(event).collect();
    rig.session.stored_events(rig.at(), &events, false);
    let acts = rig.acts();
    (rig, acts)
}

/// Numbers and tokens of the events that are published.
fn events(acts: &[SessionAct]) -> Vec<(u64, u64)> {
    let all = publications(acts)
        .into_iter()
        .filter(|it| it.topic.ends_with("/trip/event"));
    all.map(|it| {
        (
            String::from_utf8_lossy(&it.payload).parse().unwrap(),
            it.token.unwrap(),
        )
    })
    .collect()
}

fn numbers(acts: &[SessionAct]) -> Vec<u64> {
    events(acts).into_iter().map(|(number, _)| number).collect()
}

fn taken(acts: &[SessionAct]) -> Vec<u64> {
    acts.iter()
        .filter_map(|act| {
            if let SessionAct::EventTaken(seq) = act {
                Some(*seq)
            } else {
                None
            }
        })
        .collect()
}

#[test]
fn events_that_are_never_taken_do_not_stand_in_the_way() {
    let (mut rig, acts) = rig(40);
    let first = events(&acts);
    assert_eq!(first.len(), 16);
    for (_, token) in first {
        rig.handle(BrokerEvent::Refused(token, PublicationRefusal::Never));
    }
    let acts = rig.acts();
    assert_eq!(
        taken(&acts),
        (1..=16).collect::<Vec<_>>(),
        "they stay in the journal and are not offered again"
    );
    assert_eq!(numbers(&acts), (17..=32).collect::<Vec<_>>());
    let counters = rig.session.counters();
    assert_eq!((counters.events_refused, counters.events_waiting), (16, 24));
}

#[test]
fn a_full_broker_is_asked_again_and_nothing_is_lost() {
    let (mut rig, acts) = rig(40);
    for (_, token) in events(&acts) {
        rig.handle(BrokerEvent::Refused(token, PublicationRefusal::Full));
    }
    assert_eq!(rig.acts(), [], "at once it would refuse them again");
    let acts = rig.pass(1_000);
    let again = events(&acts);
    assert_eq!(again.len(), 1, "one, to try");
    rig.handle(BrokerEvent::Refused(again[0].1, PublicationRefusal::Full));
    assert_eq!(numbers(&rig.pass(1_900)), [0_u64; 0], "longer each time");
    let acts = rig.pass(100);
    rig.handle(BrokerEvent::Acknowledged(events(&acts)[0].1));
    let mut all = vec![1];
    let mut acts = rig.acts();
    loop {
        let more = events(&acts);
        if more.is_empty() {
            break;
        }
        all.extend(more.iter().map(|(number, _)| *number));
        more.iter()
            .for_each(|(_, token)| rig.handle(BrokerEvent::Acknowledged(*token)));
        acts = rig.acts();
    }
    assert_eq!(all, (1..=40).collect::<Vec<_>>(), "in order");
    assert_eq!(
        (
            rig.session.counters().events_refused,
            rig.session.counters().events_waiting
        ),
        (0, 0)
    );
}

#[test]
fn an_event_that_a_broker_fails_to_take_is_given_up_after_some_minutes() {
    let (mut rig, acts) = rig(2);
    let both = events(&acts);
    rig.handle(BrokerEvent::Refused(both[0].1, PublicationRefusal::Failed));
    rig.handle(BrokerEvent::Acknowledged(both[1].1));
    let mut tries = 1;
    for _ in 0..300 {
        let acts = rig.pass(1_000);
        tries += events(&acts).len();
        for (number, token) in events(&acts) {
            assert_eq!(number, 1);
            rig.handle(BrokerEvent::Refused(token, PublicationRefusal::Failed));
        }
    }
    assert_eq!((tries, rig.session.counters().events_refused), (10, 1));
    assert_eq!(rig.session.counters().events_waiting, 0);
}

#[test]
fn a_new_connection_is_offered_everything_at_once() {
    let (mut rig, acts) = rig(3);
    for (_, token) in events(&acts) {
        rig.handle(BrokerEvent::Refused(token, PublicationRefusal::Full));
    }
    rig.handle(BrokerEvent::Lost);
    assert_eq!(numbers(&rig.connect()), [1, 2, 3]);
    rig.handle(BrokerEvent::Refused(
        7 | (1 << 62),
        PublicationRefusal::Never,
    ));
    assert_eq!(
        rig.session.counters().events_refused,
        0,
        "it was not in flight"
    );
}

#[test]
fn history_that_is_not_taken_is_counted_as_dropped() {
    let mut rig = Rig::with(Settings {
        keep_telemetry: 10,
        ..settings(MqttVersion::V5)
    });
    rig.poll(0, 3_000);
    rig.connect();
    rig.handle(BrokerEvent::Lost);
    rig.pass(1_000);
    rig.poll(0, 3_500);
    rig.acts();
    let acts = rig.connect();
    let event = publications(&acts)
        .into_iter()
        .find(|it| it.topic.ends_with("/history"))
        .unwrap();
    rig.handle(BrokerEvent::Refused(
        event.token.unwrap(),
        PublicationRefusal::Never,
    ));
    assert_eq!(
        (
            rig.session.counters().history_dropped,
            rig.session.counters().history_waiting
        ),
        (1, 0)
    );
}
