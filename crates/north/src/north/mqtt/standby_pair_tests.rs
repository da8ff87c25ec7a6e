//! Two gateways of one name at one broker, which is played here: what an outsider sees of them.

use super::harness::{BrokerSession, Rig, SessionAct, message, settings};
use super::standby_tests::{one_of_two, report, trip};
use crate::domain::standby::LineRole;
use crate::north::broker::{
    BrokerEvent, BrokerMessage, MqttVersion, Publication, SubscriptionFilter,
};
use std::collections::BTreeMap;

const HALVES: [&str; 2] = ["a", "b"];

/// Both gateways, the broker, and everything that was published.
struct Plant {
    rigs: [Rig; 2],
    filters: [Vec<SubscriptionFilter>; 2],
    is_connected: [bool; 2],
    retained: BTreeMap<String, Vec<u8>>,
    published: Vec<(String, String)>,
}

fn matches(filter: &str, topic: &str) -> bool {
    let (filter, topic): (Vec<_>, Vec<_>) =
        (filter.split('/').collect(), topic.split('/').collect());
    filter.len() == topic.len()
        && filter
            .iter()
            .zip(&topic)
            .all(|(one, other)| *one == "+" || one == other)
}

impl Plant {
    /// Both are connected; `a` is active.
    fn new() -> Self {
        let rig = |half, partner, role| {
            let mut rig = Rig::as_gateway(one_of_two(half, partner), settings(MqttVersion::V5));
            rig.lines[0].report.standby = Some(report(role));
            rig.poll(0, 3_000);
            rig
        };
        let rigs = [
            rig("a", "b", LineRole::Active),
            rig("b", "a", LineRole::Listening),
        ];
        let filters = [Vec::new(), Vec::new()];
        let (retained, published) = (BTreeMap::new(), Vec::new());
        let mut plant = Self {
            rigs,
            filters,
            is_connected: [false; 2],
            retained,
            published,
        };
        plant.connect(0);
        plant.connect(1);
        plant.pass(2_000);
        plant
    }

    fn connect(&mut self, half: usize) {
        self.is_connected[half] = true;
        let broker = self.rigs[half].broker;
        self.rigs[half].handle(BrokerEvent::Connected(broker));
        self.settle();
    }

    /// The process is gone, and the broker publishes its will.
    fn kill(&mut self, half: usize) {
        self.is_connected[half] = false;
        let will = self.rigs[half].session.will();
        self.publish(&will);
    }

    fn set(&mut self, half: usize, role: LineRole) {
        self.rigs[half].lines[0].report.standby = Some(report(role));
    }

    fn deliver(&mut self, half: usize, topic: &str, payload: &[u8], retain: bool) {
        self.rigs[half].handle(BrokerEvent::Message(BrokerMessage {
            retain,
            ..message(topic, payload)
        }));
    }

    fn publish(&mut self, it: &Publication) {
        let text = String::from_utf8_lossy(&it.payload).into_owned();
        self.published.push((
            it.topic
                .strip_prefix("vfd/plant/")
                .unwrap_or(&it.topic)
                .to_owned(),
            text,
        ));
        if it.retain && it.payload.is_empty() {
            self.retained.remove(&it.topic);
        } else if it.retain {
            self.retained.insert(it.topic.clone(), it.payload.clone());
        }
        for half in 0..2 {
            let is_subscribed = self.filters[half]
                .iter()
                .any(|filter| matches(&filter.path, &it.topic));
            if self.is_connected[half] && is_subscribed {
                self.deliver(half, &it.topic, &it.payload, it.retain);
            }
        }
    }

    /// One act of one of them; false if it has nothing to do.
    fn step(&mut self, half: usize) -> bool {
        if !self.is_connected[half] {
            return false;
        }
        let Rig { session, stage, .. } = &mut self.rigs[half];
        stage.show();
        match session.next_act(stage.at(), &stage.shown, &stage.lines) {
            None => return false,
            Some(SessionAct::Publish(it)) => {
                self.publish(&it);
                if let Some(token) = it.token {
                    self.rigs[half].handle(BrokerEvent::Acknowledged(token));
                }
            }
            Some(SessionAct::Subscribe(filters)) => {
                self.rigs[half].handle(BrokerEvent::Subscribed(vec![true; filters.len()]));
                let is_wanted = |topic: &str| {
                    filters
                        .iter()
                        .any(|filter| filter.wants_retained && matches(&filter.path, topic))
                };
                let all: Vec<_> = self
                    .retained
                    .clone()
                    .into_iter()
                    .filter(|(topic, _)| is_wanted(topic))
                    .collect();
                self.filters[half] = filters;
                all.iter()
                    .for_each(|(topic, payload)| self.deliver(half, topic, payload, true));
            }
            Some(_) => {}
        }
        true
    }

    fn settle(&mut self) {
        let mut steps = 0;
        while self.step(0) | self.step(1) {
            steps += 1;
            assert!(steps < 10_000, "they answer each other for ever");
        }
    }

    fn pass(&mut self, millis: u64) {
        for _ in 0..millis / 100 {
            for rig in &mut self.rigs {
                rig.millis += 100;
                let at = rig.at();
                rig.session.tick(at);
            }
            self.settle();
        }
    }

    fn text(&self, topic: &str) -> Option<String> {
        self.retained
            .get(&format!("vfd/plant/{topic}"))
            .map(|it| String::from_utf8_lossy(it).into_owned())
    }

    fn times(&self, topic: &str) -> usize {
        self.published.iter().filter(|(it, _)| it == topic).count()
    }

    #[track_caller]
    fn is_served_by(&self, half: usize) {
        assert_eq!(self.text("status").as_deref(), Some("online"));
        assert_eq!(self.text("line/hall/active").as_deref(), Some(HALVES[half]));
        assert_eq!(
            self.text("drive/pump/availability").as_deref(),
            Some("online")
        );
    }
}

/// The active one is killed after each of the publications that a trip causes, and before the first.
#[test]
fn wherever_the_active_one_dies_the_trip_is_published_once_and_the_next_one_is_seen() {
    let mut kills = 0;
    loop {
        let mut plant = Plant::new();
        plant.published.clear();
        for rig in &mut plant.rigs {
            trip(rig);
            rig.views[0].trip.active = Some(true);
        }
        let mut steps = 0;
        while steps < kills && plant.step(0) {
            steps += 1;
        }
        plant.kill(0);
        plant.settle();
        assert_eq!(
            plant.text("status").as_deref(),
            Some("offline"),
            "no one is active"
        );
        plant.pass(2_500);
        plant.set(1, LineRole::Active);
        plant.pass(5_000);
        plant.is_served_by(1);
        assert_eq!(
            plant.times("drive/pump/trip/event"),
            1,
            "killed after {kills} acts"
        );
        assert!(
            plant
                .text("standby/a")
                .is_some_and(|text| text.contains("\"online\":false"))
        );
        if steps < kills {
            assert!(kills > 3, "the trip causes several publications");
            return;
        }
        kills += 1;
    }
}

#[test]
fn the_end_of_a_listener_is_hidden_from_no_one_for_long_and_its_return_changes_nothing() {
    let mut plant = Plant::new();
    plant.is_served_by(0);
    plant.published.clear();
    plant.kill(1);
    plant.settle();
    plant.is_served_by(0);
    let status: Vec<_> = plant
        .published
        .iter()
        .filter(|(topic, _)| topic == "status")
        .map(|(_, it)| it.as_str())
        .collect();
    assert_eq!(status, ["offline", "online"]);
    plant.pass(6_000);
    assert!(
        plant
            .text("standby/b")
            .is_some_and(|text| text.contains("\"online\":false"))
    );
    plant.published.clear();
    plant.connect(1);
    plant.pass(2_000);
    assert!(
        plant
            .text("standby/b")
            .is_some_and(|text| text.contains("\"online\":true"))
    );
    plant.is_served_by(0);
    assert!(
        plant
            .published
            .iter()
            .all(|(topic, _)| topic == "standby/b" || topic == "probe"),
        "{:?}",
        plant.published
    );
}

#[test]
fn a_line_that_is_handed_over_and_back_is_shown_by_the_one_that_has_it() {
    let mut plant = Plant::new();
    for round in 0..4 {
        let (old, new) = (round % 2, 1 - round % 2);
        plant.set(old, LineRole::Listening);
        plant.settle();
        assert_eq!(
            plant.text("status").as_deref(),
            Some("online"),
            "it is taken over within seconds"
        );
        plant.pass(3_000);
        plant.set(new, LineRole::Active);
        plant.pass(3_000);
        plant.is_served_by(new);
        for rig in &mut plant.rigs {
            trip(rig);
        }
        plant.pass(2_000);
        assert_eq!(plant.times("drive/pump/trip/event"), round + 1);
    }
}

/// What the one before has published may come late, as after its network was cut.
#[test]
fn an_old_value_does_not_stay_behind_the_one_that_published_it() {
    let mut plant = Plant::new();
    plant.set(1, LineRole::Active);
    plant.rigs[1].poll(0, 4_000);
    // The first one does not know yet that it has lost the line, and what it knows is old.
    while plant.step(1) {}
    plant.rigs[0].poll(0, 1_000);
    while plant.step(0) {}
    assert_eq!(
        plant.text("drive/pump/frequency/output").as_deref(),
        Some("10.00")
    );
    plant.set(0, LineRole::Listening);
    plant.settle();
    plant.is_served_by(1);
    assert_eq!(
        plant.text("drive/pump/frequency/output").as_deref(),
        Some("40.00")
    );
}
