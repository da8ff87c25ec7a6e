//! One real gateway of the fleet: its configuration is loaded, its session runs to the end of its birth, and what it
//! publishes is the pattern for all.

use super::Args;
use crate::books::Shape;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::cli::commands::demo::plant::{self, DemoDrive, DemoLine};
use vfd_gateway::cli::tools::{CommandFailure, input};
use vfd_gateway::config::{self, Config, MqttSettings};
use vfd_gateway::daemon::host::clock;
use vfd_gateway::daemon::lines::build;
use vfd_gateway::domain::command::{Direction, Owner, RunIntent};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::{Name, Station};
use vfd_gateway::domain::report::{LineReport, LineState as Link};
use vfd_gateway::drive::description::DriveDescription;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::drive::view::{ControlView, DriveView, RunState};
use vfd_gateway::north::broker::{
    BrokerEvent, BrokerLimits, BrokerMessage, BrokerSession, Publication, SessionAct, SessionLine,
};
use vfd_gateway::north::clock::ClockMoment;
use vfd_gateway::north::mqtt::{GatewayIdentity, MqttSession, Settings, TopicTree};
use vfd_gateway::profile::model::Model;

/// Most drives on one line, as RS-485 carries them.
const LINE_MAX: usize = 32;
/// A word that reads as a value with four digits in every register.
const WORD: u16 = 4321;
/// Most acts of a birth: a session that continues beyond that is broken.
const ACTS_MAX: usize = 1_000_000;

/// What a gateway publishes.
#[derive(Clone, Debug)]
pub struct Specimen {
    /// Model of its drives.
    pub model: String,
    /// The document `state` of a drive.
    pub state: Vec<u8>,
    /// How long a broker may keep it (MQTT 5).
    pub expiry: Option<Duration>,
    /// Everything that it publishes when it connects, and the same if it publishes documents alone.
    pub births: [Volume; 2],
    /// The `[[line]]` tables of its configuration.
    pub lines: String,
}

/// Publications, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Volume {
    /// How many there are.
    pub messages: usize,
    /// Their topics and payloads together.
    pub bytes: usize,
}

/// The gateway that `args` describe.
pub fn specimen(args: &Args) -> Result<Specimen, CommandFailure> {
    let model = model(args)?;
    let lines = lines(args, &model);
    let (config, mqtt) = configuration(args, &lines)?;
    let whole = birth(&config, &mqtt, &TopicTree::ALL)?;
    let documents = birth(&config, &mqtt, &[TopicTree::State])?;
    // A real gateway also clears other topics at its birth; those are not documents.
    let topic = format!(
        "{}/{}/drive/{}/state",
        args.prefix,
        Shape::gateway_name(0),
        Shape::drive_name(0)
    );
    let state = documents
        .iter()
        .find(|it| it.topic == topic && !it.payload.is_empty());
    let state =
        state.ok_or_else(|| CommandFailure::failed("a gateway of this kind publishes no state"))?;
    Ok(Specimen {
        model: model.id.clone(),
        state: state.payload.clone(),
        expiry: state.expiry,
        births: [volume(&whole), volume(&documents)],
        lines,
    })
}

fn model(args: &Args) -> Result<Arc<Model>, CommandFailure> {
    if let Some(id) = &args.model {
        return input::model(id, &args.own);
    }
    let catalog = input::catalog_with(&args.own)?;
    // Of those of the demo, which need nothing but a station, the one with the most values.
    let last = vfd_gateway::vendors::in_demo()
        .iter()
        .rev()
        .find_map(|id| catalog.find(id))
        .cloned();
    last.ok_or_else(|| CommandFailure::failed("no model can be commanded"))
}

fn volume(publications: &[Publication]) -> Volume {
    let bytes = publications
        .iter()
        .map(|it| it.topic.len() + it.payload.len())
        .sum();
    Volume {
        messages: publications.len(),
        bytes,
    }
}

/// The `[[line]]` tables of its configuration.
fn lines(args: &Args, model: &Arc<Model>) -> String {
    let drives: Vec<_> = (0..args.drives as usize).collect();
    let stations: Vec<_> = model.link.stations.value.clone().take(LINE_MAX).collect();
    let lines = (1..)
        .zip(drives.chunks(stations.len().max(1)))
        .map(|(number, chunk)| DemoLine {
            name: format!("line-{number}"),
            link: model.link.played(),
            drives: chunk
                .iter()
                .zip(&stations)
                .map(|(drive, station)| drive_on(*drive, *station, model))
                .collect(),
        });
    let lines: Vec<_> = lines.collect();
    let devices: Vec<_> = (1..=lines.len())
        .map(|number| PathBuf::from(format!("/dev/ttyS{number}")))
        .collect();
    plant::configuration(
        lines.iter().zip(devices.iter().map(PathBuf::as_path)),
        &["mqtt"],
    )
}

fn configuration(args: &Args, lines: &str) -> Result<(Config, MqttSettings), CommandFailure> {
    let name = Shape::gateway_name(0);
    let version = args.mqtt_version;
    let prefix = &args.prefix;
    let text = format!(
        "[gateway]\nname = \"{name}\"\n[mqtt]\nbroker = \"mqtt://127.0.0.1\"\nversion = {version}\nprefix = {prefix:?}\n{lines}"
    );
    let config = config::load(&text, &input::catalog_with(&args.own)?)
        .map_err(|problems| super::plan::wrong(&problems))?;
    let mqtt = config
        .mqtt
        .clone()
        .ok_or_else(|| CommandFailure::failed("a gateway without a broker"))?;
    Ok((config, mqtt))
}

fn drive_on(drive: usize, station: u8, model: &Arc<Model>) -> DemoDrive {
    DemoDrive {
        name: Shape::drive_name(drive),
        station: Station(station),
        group: "fleet",
        model: Arc::clone(model),
    }
}

/// Everything that a gateway publishes from its connection on until nothing is left to say.
fn birth(
    config: &Config,
    mqtt: &MqttSettings,
    publish: &[TopicTree],
) -> Result<Vec<Publication>, CommandFailure> {
    let shared = build::shared(config);
    let drives: Vec<_> = shared
        .drives
        .iter()
        .map(|drive| drive.description.clone())
        .collect();
    let at = clock::moment();
    let views: Vec<_> = drives
        .iter()
        .map(|drive| Arc::new(view(drive, at)))
        .collect();
    let lines = shared.lines.iter().map(|line| SessionLine {
        name: line.name.clone(),
        report: LineReport {
            state: Link::Up,
            ..line.report()
        },
        stations: Vec::new(),
    });
    let lines: Vec<_> = lines.collect();
    let names = lines.iter().map(|line| line.name.clone()).collect();
    let name = config.gateway.name.clone().unwrap_or_else(Name::fallback);
    let settings = Settings {
        publish: publish.to_vec(),
        ..mqtt.session.clone()
    };
    let probe = format!("{}/{name}/probe", settings.prefix);
    let gateway = GatewayIdentity {
        name,
        standby: None,
    };
    let mut session = MqttSession::new((gateway, settings), drives, names, at, 1);
    session.handle(
        at,
        BrokerEvent::Connected(BrokerLimits {
            maximum_packet_bytes: None,
            retains: true,
        }),
    );
    let mut published = Vec::new();
    for _ in 0..ACTS_MAX {
        match session.next_act(at, &views, &lines) {
            None => return Ok(published),
            Some(SessionAct::Subscribe(filters)) => {
                session.handle(at, BrokerEvent::Subscribed(vec![true; filters.len()]))
            }
            Some(SessionAct::Publish(it)) if it.topic == probe => {
                session.handle(at, BrokerEvent::Message(message(&it)))
            }
            Some(SessionAct::Publish(it)) => published.push(it),
            Some(_) => {}
        }
    }
    Err(CommandFailure::failed(
        "a gateway of this kind has no end of things to say",
    ))
}

/// `it` as it comes back to its sender.
fn message(it: &Publication) -> BrokerMessage<'_> {
    BrokerMessage {
        topic: &it.topic,
        payload: &it.payload,
        retain: false,
        duplicate: false,
        expiry: None,
        response_topic: None,
        correlation: None,
    }
}

/// A running drive that is under control, with a value in every register that is polled.
fn view(drive: &DriveDescription, at: ClockMoment) -> DriveView {
    let mut view = DriveView {
        line_is_up: true,
        run_state: RunState::Forward,
        ..DriveView::default()
    };
    view.snapshot.presence = DrivePresence::Online;
    for register in drive
        .model
        .registers
        .iter()
        .filter(|register| register.poll.is_some())
    {
        view.snapshot.take(register.address, &[WORD], at.mono);
    }
    view.trip.active = Some(false);
    view.trip_kept.count = Some(0);
    view.control = drive.control.as_ref().map(|control| ControlView {
        lease: Some((Owner::Mqtt, at.mono + control.lost_after)),
        intent: RunIntent::Run(Direction::Forward),
        setpoint: Some(Hertz::from_centihertz(WORD)),
        epoch: u64::try_from(at.wall.unix_ms).unwrap_or(0),
        ..ControlView::default()
    });
    view
}
