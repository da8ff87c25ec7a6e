//! When the session announces its entities, and when it takes them back.

use super::{BURST, BURST_EVERY, IN_FLIGHT_MAX, MIGRATES};
use crate::domain::command::{Outcome, Reason};
use crate::domain::ids::{DriveIndex, Name};
use crate::drive::description::{DriveDescription, DriveRef};
use crate::north::broker::{BrokerEvent, BrokerMessage, MqttVersion, Publication, Qos, ToLine};
use crate::north::mqtt::harness::{
    BrokerSession, Rig, SessionAct, commands, drives, identity, message, name, publications,
    settings,
};
use crate::north::mqtt::session::MqttSession;
use crate::north::mqtt::types::{HomeAssistant, LeaseMode, Settings};
use crate::north::titles::{PartTitle, PlantTitles};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

const NODE: &str = "vfd-gateway-plant";

fn speaking(version: MqttVersion) -> Settings {
    let home_assistant = Some(HomeAssistant {
        discovery: true,
        prefix: "ha".into(),
        devices: false,
        combined: Vec::new(),
        page: None,
    });
    Settings {
        home_assistant,
        ..settings(version)
    }
}

/// A gateway at a broker that retains messages, sends them to subscribers, and acknowledges at once.
struct Home {
    rig: Rig,
    kept: BTreeMap<String, Vec<u8>>,
    granted: bool,
}

impl Home {
    fn new(settings: Settings) -> Self {
        let mut rig = Rig::with(settings);
        rig.poll(0, 3_000);
        Self {
            rig,
            kept: BTreeMap::new(),
            granted: true,
        }
    }

    /// Another process of the gateway at the same broker.
    fn again(&mut self, settings: Settings, drives: Vec<DriveDescription>) {
        self.rig = Self::new(settings.clone()).rig;
        self.rig.views.truncate(drives.len());
        self.rig.session = MqttSession::new(
            (identity(), settings),
            drives,
            vec![name("hall")],
            self.rig.at(),
            7,
        );
    }

    /// Plays the broker for these acts and for what follows from them at once. Returns what was announced.
    fn play(&mut self, acts: Vec<SessionAct>) -> Vec<Publication> {
        let mut announced = Vec::new();
        let mut acts = acts;
        while !acts.is_empty() {
            for publication in publications(&acts)
                .into_iter()
                .filter(|it| it.topic.starts_with("ha/"))
            {
                announced.push(publication.clone());
                self.take(publication);
            }
            acts = self.rig.acts();
        }
        announced
    }

    fn take(&mut self, it: &Publication) {
        if it.retain && it.payload.is_empty() {
            self.kept.remove(&it.topic);
        } else if it.retain {
            self.kept.insert(it.topic.clone(), it.payload.clone());
        }
        if let Some(token) = it.token {
            self.rig.handle(BrokerEvent::Acknowledged(token));
        }
        // It is subscribed, so it is delivered.
        if self.granted {
            self.rig.handle(BrokerEvent::Message(BrokerMessage {
                retain: it.retain,
                ..message(&it.topic, &it.payload)
            }));
        }
    }

    /// Connects, and returns what is announced up to the end.
    fn connect(&mut self) -> Vec<Publication> {
        self.rig.handle(BrokerEvent::Connected(self.rig.broker));
        let acts = self.rig.acts();
        let [SessionAct::Subscribe(filters)] = &acts[..] else {
            panic!("{acts:?}")
        };
        let own = |path: &str| path.starts_with("ha/");
        assert_eq!(
            filters
                .iter()
                .filter(|it| own(&it.path) && it.wants_retained)
                .count(),
            2,
            "{filters:?}"
        );
        let granted = filters
            .iter()
            .map(|it| self.granted || !own(&it.path))
            .collect();
        self.rig.handle(BrokerEvent::Subscribed(granted));
        for (topic, payload) in self.kept.clone() {
            if self.granted && topic.contains(NODE) {
                self.rig.handle(BrokerEvent::Message(BrokerMessage {
                    retain: true,
                    ..message(&topic, &payload)
                }));
            }
        }
        let acts = self.rig.acts();
        let mut announced = self.play(acts);
        announced.extend(self.pass(60_000));
        announced
    }

    /// Time passes.
    fn pass(&mut self, millis: u64) -> Vec<Publication> {
        let mut announced = Vec::new();
        for _ in 0..millis / 50 {
            let acts = self.rig.pass(50);
            announced.extend(self.play(acts));
        }
        announced
    }

    fn topics(&self) -> BTreeSet<String> {
        self.kept.keys().cloned().collect()
    }
}

fn cleared(announced: &[Publication]) -> BTreeSet<String> {
    announced
        .iter()
        .filter(|it| it.payload.is_empty())
        .map(|it| it.topic.clone())
        .collect()
}

fn announced_topics(announced: &[Publication]) -> BTreeSet<String> {
    announced
        .iter()
        .filter(|it| !it.payload.is_empty() && it.retain)
        .map(|it| it.topic.clone())
        .collect()
}

#[test]
fn everything_is_announced_once_and_retained() {
    for version in [MqttVersion::V4, MqttVersion::V5] {
        let mut home = Home::new(speaking(version));
        let announced = home.connect();
        assert_eq!(
            announced_topics(&announced).len(),
            announced.len(),
            "each once, none taken back"
        );
        assert!(
            announced
                .iter()
                .all(|it| it.retain && it.qos == Qos::AtLeastOnce && it.expiry.is_none())
        );
        for topic in [
            "ha/sensor/vfd-gateway-plant/drive_pump_output_frequency/config",
            "ha/button/vfd-gateway-plant/drive_pump_stop/config",
            "ha/sensor/vfd-gateway-plant/drive_fan_run_state/config",
            "ha/binary_sensor/vfd-gateway-plant/gateway_line_hall_up/config",
        ] {
            assert!(home.kept.contains_key(topic), "{topic}");
        }
        assert!(
            !home
                .topics()
                .iter()
                .any(|it| it.contains("/button/") && it.contains("drive_fan"))
        );
        assert_eq!(home.pass(130_000), [], "and then nothing");
    }
}

#[test]
fn without_the_table_nothing_is_said_and_nothing_subscribed() {
    let mut rig = Rig::new(MqttVersion::V5);
    rig.poll(0, 3_000);
    let acts = rig.connect();
    let all = format!("{acts:?}");
    assert!(!all.contains(NODE), "{all}");
}

#[test]
fn a_birth_brings_all_of_it_again_after_a_while_of_its_own() {
    let mut home = Home::new(speaking(MqttVersion::V4));
    let all = announced_topics(&home.connect());
    for (topic, payload) in [("ha/status", &b"online"[..]), ("home/status", b" ONLINE")] {
        home.rig
            .handle(BrokerEvent::Message(message(topic, payload)));
        let wait = super::digest(NODE) % (super::JITTER_MAX_MS + 1);
        assert!((50..4_900).contains(&wait), "{wait}");
        assert_eq!(home.pass(wait - wait % 50), []);
        let again = home.pass(60_000);
        assert_eq!(
            (announced_topics(&again), again.len()),
            (all.clone(), all.len()),
            "{topic}"
        );
    }
    for (topic, payload) in [("ha/status", &b"offline"[..]), ("ha/other", b"online")] {
        home.rig
            .handle(BrokerEvent::Message(message(topic, payload)));
        assert_eq!(home.pass(60_000), []);
    }
    // Many births are one.
    for _ in 0..100 {
        home.rig
            .handle(BrokerEvent::Message(message("ha/status", b"online")));
    }
    assert_eq!(home.pass(60_000).len(), all.len());
}

#[test]
fn a_birth_topic_beside_the_alive_topic_ends_no_lease() {
    let mut home = Home::new(Settings {
        lease: LeaseMode::Session,
        ..speaking(MqttVersion::V5)
    });
    home.connect();
    home.rig
        .handle(BrokerEvent::Message(message("ha/status", b"offline")));
    assert!(
        home.rig
            .pass(20_000)
            .contains(&SessionAct::ToLine(ToLine::PathAlive))
    );
    home.rig
        .handle(BrokerEvent::Message(message("home/status", b"offline")));
    home.rig.acts();
    assert!(
        !home
            .rig
            .pass(20_000)
            .contains(&SessionAct::ToLine(ToLine::PathAlive))
    );
}

#[test]
fn what_an_earlier_life_announced_is_taken_back() {
    for version in [MqttVersion::V4, MqttVersion::V5] {
        let mut home = Home::new(speaking(version));
        home.connect();
        let before = home.topics();
        let foreign = "ha/sensor/vfd-gateway-plant2/drive_fan_run_state/config";
        home.kept.insert(foreign.into(), b"{}".to_vec());
        let [pump, _] = <[_; 2]>::try_from(drives()).unwrap();
        let pump = DriveDescription {
            control: None,
            ..pump
        };
        home.again(speaking(version), vec![pump]);
        let announced = home.connect();
        let gone: BTreeSet<_> = before.difference(&home.topics()).cloned().collect();
        assert_eq!(cleared(&announced), gone);
        assert!(gone.contains("ha/button/vfd-gateway-plant/drive_pump_stop/config"));
        assert!(gone.iter().any(|it| it.contains("drive_fan")));
        assert!(
            home.topics()
                .iter()
                .all(|it| !it.contains("/button/") && !it.contains("plant/drive_fan"))
        );
        assert!(
            home.kept.contains_key(foreign),
            "what belongs to others stays"
        );
    }
}

#[test]
fn a_gateway_that_may_not_look_announces_all_the_same_and_takes_nothing_back() {
    let mut home = Home::new(speaking(MqttVersion::V5));
    home.connect();
    let before = home.topics();
    let [pump, _] = <[_; 2]>::try_from(drives()).unwrap();
    home.again(speaking(MqttVersion::V5), vec![pump]);
    home.granted = false;
    let announced = home.connect();
    assert!(!announced_topics(&announced).is_empty());
    assert_eq!((cleared(&announced).len(), home.topics()), (0, before));
    assert_eq!(
        home.rig.session.counters().alive_refused,
        0,
        "the alive topic was granted"
    );
}

#[test]
fn a_reload_takes_back_what_is_gone_and_shows_what_is_new() {
    let mut home = Home::new(speaking(MqttVersion::V5));
    home.granted = false;
    home.connect();
    let before = home.topics();
    let [pump, fan] = <[_; 2]>::try_from(drives()).unwrap();
    let mill = DriveDescription {
        place: DriveRef {
            line: 7,
            drive: DriveIndex(0),
        },
        name: Name::new("mill").unwrap(),
        ..fan
    };
    home.rig.session.replace(
        home.rig.at(),
        vec![pump, mill],
        vec![name("hall"), name("yard")],
    );
    let line = home.rig.lines[0].clone();
    home.rig.lines.push(line);
    let announced = home.pass(60_000);
    let gone: BTreeSet<_> = before.difference(&home.topics()).cloned().collect();
    assert_eq!(cleared(&announced), gone);
    assert!(
        !gone.is_empty() && gone.iter().all(|it| it.contains("drive_fan")),
        "{gone:?}"
    );
    for part in ["drive_mill_run_state", "gateway_line_yard_up"] {
        assert!(home.topics().iter().any(|it| it.contains(part)), "{part}");
    }
}

#[test]
fn a_reload_with_a_title_announces_the_same_entities_again_with_it() {
    let mut home = Home::new(speaking(MqttVersion::V5));
    home.connect();
    let before = home.topics();
    let title = PartTitle::new("Umwälzpumpe Süd").unwrap();
    let titles = PlantTitles {
        drives: BTreeMap::from([("pump".to_owned(), title)]),
        ..PlantTitles::default()
    };
    home.rig.session.see_titles(&Arc::new(titles));
    let at = home.rig.at();
    home.rig.session.replace(at, drives(), vec![name("hall")]);
    let announced = home.pass(60_000);
    assert_eq!((cleared(&announced).len(), home.topics()), (0, before));
    let is_titled =
        |payload: &Vec<u8>| String::from_utf8_lossy(payload).contains("\"Umwälzpumpe Süd\"");
    let titled = home.kept.iter().filter(|(_, payload)| is_titled(payload));
    let topics: Vec<_> = titled.map(|(topic, _)| topic).collect();
    assert!(
        !topics.is_empty() && topics.iter().all(|it| it.contains("drive_pump")),
        "{topics:?}"
    );
}

#[test]
fn discovery_that_is_switched_off_takes_everything_back() {
    for devices in [false, true] {
        let with = |discovery| {
            let home_assistant = Some(HomeAssistant {
                discovery,
                prefix: "ha".into(),
                devices,
                combined: Vec::new(),
                page: None,
            });
            Settings {
                home_assistant,
                ..settings(MqttVersion::V4)
            }
        };
        let mut home = Home::new(with(true));
        home.connect();
        assert!(!home.kept.is_empty());
        home.again(with(false), drives());
        // The birth topic carries nothing that is wanted.
        home.rig.handle(BrokerEvent::Connected(home.rig.broker));
        let acts = home.rig.acts();
        let [SessionAct::Subscribe(filters)] = &acts[..] else {
            panic!("{acts:?}")
        };
        home.rig
            .handle(BrokerEvent::Subscribed(vec![true; filters.len()]));
        for (topic, payload) in home.kept.clone() {
            home.rig.handle(BrokerEvent::Message(BrokerMessage {
                retain: true,
                ..message(&topic, &payload)
            }));
        }
        home.pass(60_000);
        assert_eq!(home.topics(), BTreeSet::new());
        home.rig
            .handle(BrokerEvent::Message(message("ha/status", b"online")));
        assert_eq!(home.pass(60_000), []);
    }
}

#[test]
fn the_way_of_announcing_changes_in_the_order_that_keeps_what_people_made_of_it() {
    for devices in [true, false] {
        let with = |devices| {
            let home_assistant = Some(HomeAssistant {
                discovery: true,
                prefix: "ha".into(),
                devices,
                combined: Vec::new(),
                page: None,
            });
            Settings {
                home_assistant,
                ..settings(MqttVersion::V5)
            }
        };
        let mut home = Home::new(with(!devices));
        let old = announced_topics(&home.connect());
        home.again(with(devices), drives());
        let announced = home.connect();
        let step = |it: &Publication| match (it.retain, it.payload.is_empty()) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => 2,
        };
        assert!(announced.is_sorted_by_key(step));
        let hints: BTreeSet<_> = announced
            .iter()
            .filter(|it| it.payload == MIGRATES)
            .map(|it| it.topic.clone())
            .collect();
        assert_eq!((hints, cleared(&announced)), (old.clone(), old.clone()));
        assert!(home.topics().is_disjoint(&old) && !home.kept.is_empty());
        assert_eq!(
            home.topics().iter().all(|it| it.starts_with("ha/device/")),
            devices
        );
        assert_eq!(home.pass(60_000), []);
    }
}

#[test]
fn a_device_that_holds_less_than_before_is_taken_back_first() {
    let home_assistant = Some(HomeAssistant {
        discovery: true,
        prefix: "ha".into(),
        devices: true,
        combined: Vec::new(),
        page: None,
    });
    let with = || Settings {
        home_assistant: home_assistant.clone(),
        ..settings(MqttVersion::V4)
    };
    let topic = "ha/device/vfd-gateway-plant/drive_pump/config";
    let less = || {
        let [pump, fan] = <[_; 2]>::try_from(drives()).unwrap();
        vec![
            DriveDescription {
                control: None,
                ..pump
            },
            fan,
        ]
    };
    let steps = |announced: &[Publication]| -> Vec<bool> {
        announced
            .iter()
            .filter(|it| it.topic == topic)
            .map(|it| it.payload.is_empty())
            .collect()
    };
    // Over a restart.
    let mut home = Home::new(with());
    home.connect();
    home.again(with(), less());
    assert_eq!(steps(&home.connect()), [true, false]);
    assert!(
        !String::from_utf8(home.kept[topic].clone())
            .unwrap()
            .contains("run/set")
    );
    // Over a reload.
    let mut home = Home::new(with());
    home.connect();
    home.rig
        .session
        .replace(home.rig.at(), less(), vec![name("hall")]);
    assert_eq!(steps(&home.pass(60_000)), [true, false]);
}

#[test]
fn announcements_are_paced_and_everything_else_goes_first() {
    let mut home = Home::new(speaking(MqttVersion::V5));
    home.rig.handle(BrokerEvent::Connected(home.rig.broker));
    let acts = home.rig.acts();
    let [SessionAct::Subscribe(filters)] = &acts[..] else {
        panic!("{acts:?}")
    };
    home.rig
        .handle(BrokerEvent::Subscribed(vec![true; filters.len()]));
    let birth = home.rig.acts();
    assert!(
        publications(&birth)
            .iter()
            .all(|it| !it.topic.starts_with("ha/")),
        "first what the gateway shows"
    );
    // A broker that acknowledges nothing.
    let acts = home.rig.pass(1_500);
    let announced: Vec<_> = publications(&acts)
        .into_iter()
        .filter(|it| it.topic.starts_with("ha/"))
        .cloned()
        .collect();
    assert_eq!(announced.len(), IN_FLIGHT_MAX);
    let rest = home.rig.pass(5_000);
    assert!(
        publications(&rest)
            .iter()
            .all(|it| !it.topic.starts_with("ha/"))
    );
    // One that does.
    for it in &announced {
        home.rig
            .handle(BrokerEvent::Acknowledged(it.token.unwrap()));
    }
    let mut most = 0;
    loop {
        let acts = home
            .rig
            .pass(u64::try_from(BURST_EVERY.as_millis()).unwrap());
        let announced = home.play(acts);
        if announced.is_empty() {
            break;
        }
        most = most.max(announced.len());
    }
    assert!((1..=2 * BURST as usize).contains(&most), "{most}");
    // In the middle of them a command and its result, and a value that changes, wait for nothing.
    home.rig
        .handle(BrokerEvent::Message(message("ha/status", b"online")));
    let acts = home.rig.pass(5_000);
    home.play(acts);
    home.rig.poll(0, 4_000);
    let asked = home.rig.send("drive/pump/run/set", b"stop");
    let ticket = commands(&asked)[0].ticket;
    let answered = home
        .rig
        .answer(ticket, Outcome::Confirmed, Reason::None, true);
    let first = |acts: &[SessionAct]| publications(acts).first().map(|it| it.topic.clone());
    assert_eq!(
        first(&asked).as_deref(),
        Some("vfd/plant/drive/pump/frequency/output")
    );
    assert_eq!(
        first(&answered).as_deref(),
        Some("vfd/plant/drive/pump/result")
    );
    assert!(
        home.rig.session.discovery.walk.is_some(),
        "it was in the middle of them"
    );
}

#[test]
fn a_flood_under_our_node_is_bounded() {
    let mut home = Home::new(speaking(MqttVersion::V4));
    home.granted = false;
    home.connect();
    for number in 0..2 * super::GONE_MAX {
        let topic = format!("ha/sensor/{NODE}/x{number}/config");
        home.rig
            .handle(BrokerEvent::Message(message(&topic, b"{}")));
    }
    assert_eq!(home.rig.session.discovery.gone.len(), super::GONE_MAX);
}

#[test]
fn a_broker_that_keeps_nothing_is_reported_all_the_same() {
    let mut home = Home::new(speaking(MqttVersion::V5));
    home.rig.broker.retains = false;
    home.granted = false;
    let announced = home.connect();
    assert!(!announced.is_empty() && announced.iter().all(|it| !it.retain));
    home.rig
        .session
        .replace(home.rig.at(), Vec::new(), vec![name("hall")]);
    home.rig.views.clear();
    home.pass(10_000);
    assert!(home.rig.session.discovery.gone.is_empty());
}
