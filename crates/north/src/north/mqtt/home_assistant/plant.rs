//! Everything that is announced to Home Assistant, made on demand: nothing of it is kept.

use super::entity::{DiscoveryEntity, EntityNeeds};
use super::{drive, gateway, ids};
use crate::domain::ids::Name;
use crate::domain::version::{PROGRAM_NAME, PROGRAM_REPOSITORY, PROGRAM_VERSION};
use crate::drive::description::DriveDescription;
use crate::north::mqtt::topics::MqttTopics;
use crate::north::mqtt::types::{HomeAssistant, Settings};
use crate::north::titles::{PartTitle, PlantTitles};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;

/// The component of an announcement that holds a whole device.
pub(super) const DEVICE: &str = "device";

/// What is known of the gateway.
#[derive(Clone, Copy, Debug)]
pub(in crate::north::mqtt) struct DiscoveryPlant<'a> {
    settings: &'a HomeAssistant,
    /// The topic on which the clients say that they are online.
    alive: Option<&'a str>,
    pub(super) topics: &'a MqttTopics,
    gateway: &'a Name,
    titles: &'a PlantTitles,
    lines: &'a [Name],
    drives: &'a [DriveDescription],
}

/// A device of Home Assistant.
#[derive(Clone, Copy, Debug)]
enum DiscoveryDevice<'a> {
    Gateway,
    Drive(&'a DriveDescription),
}

impl DiscoveryDevice<'_> {
    fn object(self) -> String {
        match self {
            Self::Gateway => ids::GATEWAY.to_owned(),
            Self::Drive(drive) => ids::drive(&drive.name),
        }
    }
}

/// What an announcement under our node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AnnouncementKind {
    /// It belongs there.
    Wanted,
    /// Something that is announced in the other way now, by device or by entity.
    OtherWay,
    /// Something that is not there any more.
    Gone,
}

/// Where something is announced, and the keys of its components if it is a device.
type Announced = (String, Vec<String>);

impl<'a> DiscoveryPlant<'a> {
    /// `None` if Home Assistant discovery is not configured.
    pub(in crate::north::mqtt) fn of(
        settings: &'a Settings,
        topics: &'a MqttTopics,
        titles: &'a PlantTitles,
        lines: &'a [Name],
        drives: &'a [DriveDescription],
    ) -> Option<Self> {
        let alive = settings.alive_topic.as_deref();
        let gateway = &topics.name;
        settings.home_assistant.as_ref().map(|settings| Self {
            settings,
            alive,
            topics,
            gateway,
            titles,
            lines,
            drives,
        })
    }

    /// Whether anything is announced at all.
    pub(super) const fn is_on(&self) -> bool {
        self.settings.discovery
    }

    /// What is subscribed: where Home Assistant says that it is online, and what was announced before. The alive topic
    /// is subscribed anyway.
    pub(super) fn filters(&self) -> Vec<String> {
        let birth = self.birth();
        let birth = Some(birth).filter(|birth| self.is_on() && self.alive != Some(birth));
        birth
            .into_iter()
            .chain([ids::filter(&self.settings.prefix, &self.node())])
            .collect()
    }

    /// Whether `topic` is where Home Assistant says that it is online.
    pub(super) fn is_birth_topic(&self, topic: &str) -> bool {
        self.alive == Some(topic) || self.birth() == topic
    }

    fn birth(&self) -> String {
        format!("{}/status", self.settings.prefix)
    }

    /// Component and object of an announcement under our node.
    pub(super) fn parse<'t>(&self, topic: &'t str) -> Option<(&'t str, &'t str)> {
        ids::parse(topic, &self.settings.prefix, &self.node())
    }

    /// The announcement at `place`: the number of the device, and of the entity among its own. `None` past the last
    /// entity of a device, which has one announcement if it is announced as a whole.
    pub(super) fn announcement(
        &self,
        (device, entity): (usize, usize),
    ) -> Option<(String, Vec<u8>)> {
        let device = self.device(device)?;
        let entities = self.entities(device);
        let (component, object, document) = if self.settings.devices {
            if entity > 0 {
                return None;
            }
            (DEVICE, device.object(), self.whole(device, entities))
        } else {
            let entity = entities.into_iter().nth(entity)?;
            let component = entity.component.keyword();
            let object = ids::entity(&device.object(), &entity.key);
            (
                component,
                object,
                Value::Object(self.single(device, entity)),
            )
        };
        Some((
            self.topic(component, &object),
            document.to_string().into_bytes(),
        ))
    }

    /// Whether there is a device with this number: the gateway, then the drives.
    pub(super) fn has_device(&self, device: usize) -> bool {
        self.device(device).is_some()
    }

    /// What an announcement with `payload` is.
    pub(super) fn look(&self, component: &str, object: &str, payload: &[u8]) -> AnnouncementKind {
        if !self.settings.discovery {
            return AnnouncementKind::Gone;
        }
        if component == DEVICE {
            let device = self.devices().find(|device| device.object() == object);
            return match device {
                None => AnnouncementKind::Gone,
                Some(_) if !self.settings.devices => AnnouncementKind::OtherWay,
                Some(device) if keys_of(payload) == keys(&self.entities(device)) => {
                    AnnouncementKind::Wanted
                }
                Some(_) => AnnouncementKind::Gone,
            };
        }
        let device = self.devices().find_map(|device| {
            let key = object.strip_prefix(&device.object())?.strip_prefix('_')?;
            self.entities(device)
                .into_iter()
                .find(|entity| entity.key == key && entity.component.keyword() == component)
        });
        match device {
            None => AnnouncementKind::Gone,
            Some(_) if self.settings.devices => AnnouncementKind::OtherWay,
            Some(_) => AnnouncementKind::Wanted,
        }
    }

    /// All that is announced.
    pub(super) fn all(&self) -> BTreeSet<Announced> {
        if !self.settings.discovery {
            return BTreeSet::new();
        }
        let of_device = |device: DiscoveryDevice<'a>| -> Vec<Announced> {
            let object = device.object();
            let entities = self.entities(device);
            if self.settings.devices {
                return vec![(
                    self.topic(DEVICE, &object),
                    keys(&entities).into_iter().collect(),
                )];
            }
            let topic = |it: &DiscoveryEntity| {
                self.topic(it.component.keyword(), &ids::entity(&object, &it.key))
            };
            entities
                .iter()
                .map(|entity| (topic(entity), Vec::new()))
                .collect()
        };
        self.devices().flat_map(of_device).collect()
    }

    /// What distinguishes this gateway's announcements from others.
    pub(super) fn node(&self) -> String {
        ids::node(self.gateway)
    }

    fn topic(&self, component: &str, object: &str) -> String {
        ids::topic(&self.settings.prefix, component, &self.node(), object)
    }

    fn device(&self, place: usize) -> Option<DiscoveryDevice<'a>> {
        match place.checked_sub(1) {
            None => Some(DiscoveryDevice::Gateway),
            Some(drive) => self.drives.get(drive).map(DiscoveryDevice::Drive),
        }
    }

    fn devices(&self) -> impl Iterator<Item = DiscoveryDevice<'a>> {
        [DiscoveryDevice::Gateway]
            .into_iter()
            .chain(self.drives.iter().map(DiscoveryDevice::Drive))
    }

    fn entities(&self, device: DiscoveryDevice<'_>) -> Vec<DiscoveryEntity> {
        match device {
            DiscoveryDevice::Gateway => gateway::entities(self.topics, self.lines, self.titles),
            DiscoveryDevice::Drive(drive) => {
                drive::entities(self.topics, drive, &self.settings.combined)
            }
        }
    }

    /// A single entity.
    fn single(&self, device: DiscoveryDevice<'_>, entity: DiscoveryEntity) -> Map<String, Value> {
        let mut config = self.config(device, entity);
        config.insert("device".to_owned(), self.about(device));
        config.insert("origin".to_owned(), origin());
        config
    }

    /// A device with all its entities.
    fn whole(&self, device: DiscoveryDevice<'_>, entities: Vec<DiscoveryEntity>) -> Value {
        let component = |entity: DiscoveryEntity| {
            let key = entity.key.clone();
            let platform = entity.component.keyword();
            let mut config = self.config(device, entity);
            config.insert("platform".to_owned(), platform.into());
            (key, Value::Object(config))
        };
        let components: Map<_, _> = entities.into_iter().map(component).collect();
        json!({ "device": self.about(device), "origin": origin(), "components": components })
    }

    /// The configuration of an entity, without its device.
    fn config(&self, device: DiscoveryDevice<'_>, entity: DiscoveryEntity) -> Map<String, Value> {
        let DiscoveryEntity {
            key,
            needs,
            mut config,
            ..
        } = entity;
        let node = self.node();
        config.insert(
            "unique_id".to_owned(),
            ids::unique(&node, &ids::entity(&device.object(), &key)).into(),
        );
        let gateway = || json!({ "topic": self.topics.gateway("status") });
        let availability = match (needs, device) {
            (EntityNeeds::Nothing, _) => return config,
            (EntityNeeds::Drive, DiscoveryDevice::Drive(drive)) => {
                let drive = self.topics.drive(drive.name.as_str(), "availability");
                json!([gateway(), { "topic": drive }])
            }
            (EntityNeeds::Gateway | EntityNeeds::Drive, _) => json!([gateway()]),
        };
        config.insert("availability".to_owned(), availability);
        config.insert("availability_mode".to_owned(), "all".into());
        config
    }

    fn about(&self, device: DiscoveryDevice<'_>) -> Value {
        let mut about = self.identity(device);
        if let Some(page) = &self.settings.page {
            about["configuration_url"] = page.as_str().into();
        }
        about
    }

    fn identity(&self, device: DiscoveryDevice<'_>) -> Value {
        let node = self.node();
        let id = |object: &str| ids::unique(&node, object);
        match device {
            DiscoveryDevice::Gateway => json!({
                "identifiers": [id(ids::GATEWAY)],
                "name": shown(self.gateway, self.titles.gateway.as_ref()),
                "manufacturer": PROGRAM_NAME,
                "model": "Gateway for variable-frequency drives",
                "sw_version": PROGRAM_VERSION,
            }),
            DiscoveryDevice::Drive(drive) => json!({
                "identifiers": [id(&device.object())],
                "name": shown(&drive.name, self.titles.drives.get(drive.name.as_str())),
                "manufacturer": drive.model.vendor,
                "model": drive.model.title,
                "via_device": id(ids::GATEWAY),
            }),
        }
    }
}

/// What Home Assistant calls the device of `name`. It isolates what it shows itself, and voice assistants compare the letters.
fn shown<'t>(name: &'t Name, title: Option<&'t PartTitle>) -> &'t str {
    title.map_or(name.as_str(), PartTitle::as_str)
}

/// The announcing software. The URL is present if the program has one.
fn origin() -> Value {
    let mut origin = json!({ "name": PROGRAM_NAME, "sw_version": PROGRAM_VERSION });
    if !PROGRAM_REPOSITORY.is_empty() {
        origin["support_url"] = PROGRAM_REPOSITORY.into();
    }
    origin
}

fn keys(entities: &[DiscoveryEntity]) -> BTreeSet<String> {
    entities.iter().map(|entity| entity.key.clone()).collect()
}

/// The component keys of an announced device; none if this is no such document.
fn keys_of(payload: &[u8]) -> BTreeSet<String> {
    let document: Option<Value> = serde_json::from_slice(payload).ok();
    let components = document
        .as_ref()
        .and_then(|it| it.get("components")?.as_object());
    components
        .into_iter()
        .flat_map(|it| it.keys().cloned())
        .collect()
}
