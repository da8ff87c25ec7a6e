//! What outlives a broken connection: events that a journal keeps, and telemetry of the time without a broker.

use super::harness::{BrokerSession, Rig, SessionAct, drives, publications, settings};
use super::types::Settings;
use crate::journal::StoredEvent;
use crate::north::broker::{BrokerEvent, MqttVersion, Publication, Qos};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::collections::VecDeque;

/// A journal that returns what was requested, and the broker's side of the events.
#[derive(Default)]
struct Journal {
    /// Numbers of all events ever kept.
    kept: Vec<u64>,
    taken: Vec<u64>,
    want: Option<u64>,
    /// What was returned and the session does not have yet.
    given: VecDeque<(Vec<u64>, bool)>,
    /// Numbers that the broker got, in order.
    published: Vec<u64>,
    /// Not acknowledged on this connection, with their tokens.
    open: Vec<(u64, u64)>,
    newest_of_connection: u64,
}

impl Journal {
    const GIVEN_MAX: usize = 5;

    fn act(&mut self, act: &SessionAct) {
        match act {
            SessionAct::WantEvents { after } => self.want = Some(*after),
            SessionAct::EventTaken(seq) => {
                assert!(!self.taken.contains(seq) && self.published.contains(seq));
                self.taken.push(*seq);
            }
            SessionAct::Publish(it) if it.topic == "vfd/plant/drive/pump/trip/event" => {
                self.publish(it)
            }
            _ => {}
        }
    }

    fn publish(&mut self, it: &Publication) {
        assert!(!it.retain && it.qos == Qos::AtLeastOnce);
        let seq = String::from_utf8(it.payload.clone())
            .unwrap()
            .parse()
            .unwrap();
        assert!(
            seq > self.newest_of_connection,
            "numbers rise on a connection"
        );
        self.newest_of_connection = seq;
        if !self.published.contains(&seq) {
            assert!(
                self.published.last().is_none_or(|last| *last < seq),
                "none is published before an older one"
            );
        }
        self.published.push(seq);
        self.open.push((seq, it.token.expect("a token")));
        assert!(self.open.len() <= 16, "no flood");
    }

    fn answer(&mut self) {
        let Some(after) = self.want else { return };
        let behind: Vec<_> = self
            .kept
            .iter()
            .copied()
            .filter(|seq| *seq > after && !self.taken.contains(seq))
            .collect();
        if behind.is_empty() {
            return;
        }
        self.want = None;
        let given: Vec<_> = behind.iter().copied().take(Self::GIVEN_MAX).collect();
        let more = given.len() < behind.len();
        self.given.push_back((given, more));
    }

    fn deliver(&mut self, rig: &mut Rig) {
        let Some((given, more)) = self.given.pop_front() else {
            return;
        };
        let drive = drives().swap_remove(0).name;
        let event = |seq: &u64| StoredEvent {
            seq: *seq,
            drive: drive.clone(),
            body: seq.to_string(),
        };
        let events: Vec<_> = given.iter().map(event).collect();
        rig.session.stored_events(rig.at(), &events, more);
    }
}

/// Something that happens.
#[derive(Clone, Copy, Debug)]
enum Step {
    Trips(u8),
    JournalAnswers,
    NewsArrive,
    BrokerAcknowledges(u8),
    Breaks,
    Connects,
    Bell,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        2 => (1..40_u8).prop_map(Step::Trips),
        4 => Just(Step::JournalAnswers),
        4 => Just(Step::NewsArrive),
        6 => any::<u8>().prop_map(Step::BrokerAcknowledges),
        1 => Just(Step::Breaks),
        2 => Just(Step::Connects),
        1 => Just(Step::Bell),
    ];
    prop::collection::vec(step, 1..120)
}

fn act(rig: &mut Rig, journal: &mut Journal, acts: Vec<SessionAct>) {
    let more = rig.acts();
    acts.iter().chain(&more).for_each(|act| journal.act(act));
}

fn play(rig: &mut Rig, journal: &mut Journal, step: Step) {
    let mut acts = Vec::new();
    match step {
        Step::Trips(count) => {
            // Numbers are used for other rows too.
            let last = journal.kept.last().copied().unwrap_or(0);
            journal
                .kept
                .extend((1..=u64::from(count)).map(|number| last + 2 * number));
        }
        Step::JournalAnswers => journal.answer(),
        Step::NewsArrive => journal.deliver(rig),
        Step::BrokerAcknowledges(place) => {
            if !journal.open.is_empty() {
                let place = usize::from(place) % journal.open.len();
                let (_, token) = journal.open.remove(place);
                rig.handle(BrokerEvent::Acknowledged(token));
            }
        }
        Step::Breaks | Step::Connects => {
            rig.handle(BrokerEvent::Lost);
            journal.newest_of_connection = 0;
            journal.open = Vec::new();
            if matches!(step, Step::Connects) {
                acts = rig.connect();
            }
        }
        Step::Bell => rig.session.stored_events(rig.at(), &[], true),
    }
    act(rig, journal, acts);
}

proptest! {
    #[test]
    fn no_event_is_lost_whenever_the_connection_breaks(steps in steps()) {
        let mut rig = Rig::born(MqttVersion::V5);
        // `want` is what was published at birth.
        let mut journal = Journal { want: Some(0), ..Journal::default() };
        for step in steps {
            play(&mut rig, &mut journal, step);
        }
        play(&mut rig, &mut journal, Step::Connects);
        // What was in flight before the last connect is first.
        for _ in 0..2 * journal.kept.len() + 20 {
            for step in [Step::JournalAnswers, Step::NewsArrive, Step::BrokerAcknowledges(0)] {
                play(&mut rig, &mut journal, step);
            }
        }
        journal.taken.sort_unstable();
        prop_assert_eq!(&journal.taken, &journal.kept, "all of them are published and reported as taken");
        prop_assert_eq!(rig.session.counters().events_waiting, 0);
    }
}

fn keeping(keep_telemetry: usize) -> Rig {
    let mut rig = Rig::with(Settings {
        keep_telemetry,
        ..settings(MqttVersion::V5)
    });
    rig.poll(0, 3_000);
    rig.connect();
    rig
}

fn history(acts: &[SessionAct]) -> Vec<(Value, u64)> {
    let all = publications(acts)
        .into_iter()
        .filter(|it| it.topic == "vfd/plant/drive/pump/history");
    all.map(|it| {
        assert!(!it.retain && it.qos == Qos::AtLeastOnce);
        (
            serde_json::from_slice(&it.payload).expect("JSON"),
            it.token.expect("a token"),
        )
    })
    .collect()
}

#[test]
fn changes_of_an_outage_are_reported_after_the_present() {
    let mut rig = keeping(100);
    rig.handle(BrokerEvent::Lost);
    rig.acts();
    for (millis, output) in [(1_000, 3_500), (1_000, 3_510), (1_000, 4_000)] {
        rig.pass(millis);
        rig.poll(0, output);
        rig.acts();
    }
    assert_eq!(
        rig.session.counters().history_waiting,
        2,
        "what is not published is not kept either"
    );
    let acts = rig.connect();
    let past = history(&acts);
    let expected = |second: u32, value: f64| {
        json!({
            "at": format!("2026-01-01T00:00:{second:02}.000Z"), "is_historical": true, "topic": "frequency/output",
            "value": value, "unit": "Hz",
        })
    };
    assert_eq!(
        past.iter().map(|(it, _)| it.clone()).collect::<Vec<_>>(),
        [expected(1, 35.0), expected(3, 40.0)]
    );
    let topics: Vec<_> = publications(&acts)
        .iter()
        .map(|it| it.topic.clone())
        .collect();
    let place = |end: &str| {
        topics
            .iter()
            .position(|topic| topic.ends_with(end))
            .expect("it is there")
    };
    assert!(
        place("plant/status") < place("pump/history"),
        "the present first"
    );

    rig.handle(BrokerEvent::Acknowledged(past[0].1));
    rig.handle(BrokerEvent::Lost);
    let again = history(&rig.connect());
    assert_eq!(
        again.iter().map(|(it, _)| it.clone()).collect::<Vec<_>>(),
        [expected(3, 40.0)],
        "until it has arrived"
    );
    rig.handle(BrokerEvent::Acknowledged(again[0].1));
    assert_eq!(rig.session.counters().history_waiting, 0);
    rig.poll(0, 4_500);
    assert_eq!(
        history(&rig.acts()).len(),
        0,
        "while there is a broker nothing is history"
    );
}

#[test]
fn a_change_of_the_run_state_is_kept_and_without_the_wish_nothing_is() {
    for (most, kept) in [(100, 1), (0, 0)] {
        let mut rig = keeping(most);
        rig.handle(BrokerEvent::Lost);
        rig.views[0].run_state = crate::drive::view::RunState::Forward;
        rig.acts();
        let past = history(&rig.connect());
        assert_eq!(past.len(), kept);
        assert!(
            past.iter()
                .all(|(it, _)| it["topic"] == "run/state" && it["value"] == "forward"),
            "{past:?}"
        );
    }
}

#[test]
fn the_oldest_changes_give_way_and_the_rest_goes_slowly() {
    let mut rig = keeping(50);
    rig.handle(BrokerEvent::Lost);
    for step in 0..80_u16 {
        rig.pass(100);
        rig.poll(0, 100 * step);
        rig.acts();
    }
    assert_eq!(
        (
            rig.session.counters().history_waiting,
            rig.session.counters().history_dropped
        ),
        (50, 30)
    );
    let mut past = history(&rig.connect());
    assert_eq!(past.len(), 16, "no more are open");
    let mut acknowledged = 0;
    let mut all: Vec<_> = Vec::new();
    for _ in 0..200 {
        for (it, token) in std::mem::take(&mut past) {
            all.push(it["value"].as_f64().expect("a number"));
            rig.handle(BrokerEvent::Acknowledged(token));
            acknowledged += 1;
        }
        let before = all.len();
        past = history(&rig.acts());
        assert!(past.len() <= 16 && before <= 50);
        if past.is_empty() {
            past = history(&rig.pass(100));
            assert!(past.len() <= 20, "so many in a tenth of a second");
        }
    }
    assert_eq!(acknowledged, 50);
    assert_eq!(all, (30..80).map(f64::from).collect::<Vec<_>>(), "in order");
}
