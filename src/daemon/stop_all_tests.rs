//! Each line finds a stop for all drives together, by whatever path it arrives, so that it can be one frame there.

use crate::config::{self, Config};
use crate::daemon::exchange::inbox::LineInbox;
use crate::daemon::exchange::shared::{CurrentPlant, SharedPlant};
use crate::daemon::host::clock;
use crate::daemon::lines;
use crate::daemon::local::{LocalSide, OrderingClient};
use crate::daemon::mqtt::speaker::{SessionSides, SessionSpeaker};
use crate::daemon::mqtt::{BdSeq, BrokerConversation};
use crate::daemon::service::build;
use crate::daemon::service::conversations::BrokerSide;
use crate::daemon::testing::{Dir, Sleeper};
use crate::domain::ids::{CommanderName, Ticket};
use crate::north::broker::{BrokerEvent, BrokerMessage};
use crate::north::mqtt::MqttSession;
use crate::north::sparkplug::SparkplugSession;
use crate::north::sparkplug::payload::{PayloadMetric, PayloadValue, SparkplugPayload};
use crate::vendors;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

const DRIVES: usize = 3;

/// One line of drives that every client may command.
fn config() -> Config {
    let mut text = "[gateway]\nname = \"plant\"\ndata_dir = \"/data\"\n[mqtt]\nbroker = \"mqtt://127.0.0.1\"\n\
                    [mqtt.sparkplug]\ngroup = \"hall\"\nprimary_host = \"scada\"\n[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\n\
                    write = [\"127.0.0.1/32\"]\n[[line]]\nname = \"hall-1\"\nport = \"/dev/ttyUSB0\"\n"
        .to_owned();
    for station in 1..=DRIVES {
        write!(
            text,
            "[[line.drive]]\nname = \"pump-{station}\"\nmodel = \"hyundai-n700\"\nstation = {station}\n\
             [line.drive.control]\nfrom = [\"mqtt\", \"sparkplug\", \"modbus-tcp\"]\n\
             frequency_hz = {{ min = 5.0, max = 50.0 }}\non_commander_lost = \"stop\"\nlost_after = \"30s\"\n\
             on_shutdown = \"hold\"\n",
        )
        .unwrap();
    }
    let catalog = vendors::catalog();
    config::load(&text, &catalog).unwrap()
}

/// Sends a stop for all, and returns how many stops the line finds when it is woken.
fn found(shared: &SharedPlant, give: impl FnOnce()) -> usize {
    let inbox: &Arc<LineInbox> = &shared.lines[0].inbox;
    let sleeper = Sleeper::new(inbox);
    give();
    sleeper.found()
}

fn message<'a>(topic: &'a str, payload: &'a [u8]) -> BrokerEvent<'a> {
    let retain = false;
    let duplicate = false;
    let expiry = None;
    BrokerEvent::Message(BrokerMessage {
        topic,
        payload,
        retain,
        duplicate,
        expiry,
        response_topic: None,
        correlation: None,
    })
}

/// What a session with a broker is connected to.
fn sides<C: Default>(shared: &Arc<SharedPlant>) -> SessionSides<C> {
    SessionSides {
        current: CurrentPlant::from(Arc::clone(shared)),
        news: Arc::default(),
        totals: Arc::default(),
        journal: None,
    }
}

/// The settings of both sides with a broker.
fn broker_side(config: &Config, dir: &Path) -> BrokerSide {
    let name = config.gateway.name.clone().unwrap();
    build::broker(
        config.mqtt.as_ref().unwrap(),
        (&name, None),
        Some(dir),
        None,
    )
    .unwrap()
}

#[test]
fn by_way_of_mqtt() {
    let config = config();
    let mqtt = broker_side(&config, &Dir::new()).mqtt;
    let shared = Arc::new(lines::build::shared(&config));
    let mut speaker = SessionSpeaker::<MqttSession>::new(
        (mqtt.gateway, mqtt.settings),
        None,
        sides(&shared),
        Ticket(1),
        clock::moment(),
    );
    let stop = message("vfd/plant/all/run/set", b"stop");
    assert_eq!(
        found(&shared, || speaker.handle(clock::moment(), stop)),
        DRIVES
    );
}

#[test]
fn by_way_of_sparkplug() {
    let config = config();
    let dir = Dir::new();
    let settings = broker_side(&config, &dir).sparkplug.unwrap().settings;
    let shared = Arc::new(lines::build::shared(&config));
    let mut speaker = SessionSpeaker::<SparkplugSession>::new(
        settings,
        Some(BdSeq::read(&dir)),
        sides(&shared),
        Ticket(1),
        clock::moment(),
    );
    let value = Some(PayloadValue::Text("stop".to_owned()));
    let metrics = vec![PayloadMetric {
        name: Some("all/run/set".to_owned()),
        value,
        ..PayloadMetric::default()
    }];
    let payload = SparkplugPayload {
        timestamp: None,
        metrics,
        seq: None,
    }
    .bytes();
    let stop = message("spBv1.0/hall/NCMD/plant", &payload);
    assert_eq!(
        found(&shared, || speaker.handle(clock::moment(), stop)),
        DRIVES
    );
}

#[test]
fn by_way_of_the_page() {
    let shared = Arc::new(lines::build::shared(&config()));
    let side = LocalSide::new(Arc::clone(&shared), None);
    let places: Vec<_> = shared
        .drives
        .iter()
        .map(|drive| drive.description.place)
        .collect();
    let who = OrderingClient::signed_in(CommanderName::new("anna").unwrap());
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .build()
        .unwrap();
    let _within = runtime.enter();
    assert_eq!(found(&shared, || drop(side.stop_all(who, &places))), DRIVES);
}
