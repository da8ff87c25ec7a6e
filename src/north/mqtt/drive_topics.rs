//! The retained topics of one drive: what belongs on each, and which is to be published next.

use super::history::Change;
use super::slot::{Content, EXPIRY_HEARTBEATS, Present, Slot};
use super::state::{self, StateSlot, fresh, shown_run_state, stale_at};
use super::topics::Topics;
use super::types::{Publication, Qos};
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::drive::rated::Rated;
use crate::drive::snapshot::Reading;
use crate::drive::view::DriveView;
use crate::profile::model::{Model, Register, Role};
use crate::profile::scale::Scaled;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What a topic shows. Numbers are places of registers in the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Availability,
    RunState,
    /// A polled register.
    Polled(usize),
    /// What the register at this place shows in per cent of a rated value, in the unit of that value.
    Rated(usize),
    /// The setpoint that was commanded, where the drive's own is not polled.
    Setpoint,
    /// Who holds control.
    Owner,
    TripActive,
    TripCode,
    TripText,
    TripCount,
    TripLast,
    /// A register that was asked for.
    Param(usize),
}

impl Kind {
    /// Whether its changes are kept while no broker can be told.
    const fn is_recorded(self) -> bool {
        matches!(self, Self::RunState | Self::Polled(_) | Self::Rated(_) | Self::Setpoint)
    }

    /// The register that it shows.
    const fn register(self) -> Option<usize> {
        match self {
            Self::Polled(register) | Self::Rated(register) | Self::Param(register) => Some(register),
            _ => None,
        }
    }
}

/// The retained topics of one drive.
#[derive(Debug)]
pub(super) struct DriveTopics {
    slots: Vec<(Kind, Slot)>,
    state: StateSlot,
    /// Smallest change of each register of the model that is published, in steps.
    bands: Vec<f64>,
    params: BTreeMap<usize, Reading>,
    /// The next slot of this walk; behind the last one comes the state.
    cursor: usize,
    /// The picture that was looked at last while no broker could be told.
    recorded: Option<Arc<DriveView>>,
    /// The picture with which this walk began.
    walking: Option<Arc<DriveView>>,
    /// The picture of the last walk that was finished, and until when another one of it finds nothing.
    walked: Option<(Arc<DriveView>, MonoTime)>,
}

impl DriveTopics {
    pub(super) fn new(topics: &Topics, drive: &DriveDescription) -> Self {
        let slot = |(kind, rest): (Kind, String)| (kind, Slot::new(topics.drive(drive.name.as_str(), &rest)));
        Self {
            slots: kinds(drive).into_iter().map(slot).collect(),
            state: StateSlot::new(topics.drive(drive.name.as_str(), "state")),
            bands: drive.model.registers.iter().map(|register| band(drive, register)).collect(),
            params: BTreeMap::new(),
            cursor: 0,
            recorded: None,
            walking: None,
            walked: None,
        }
    }

    /// All its topics.
    pub(super) fn topics(&self) -> impl Iterator<Item = &str> {
        self.slots.iter().map(|(_, slot)| slot.topic()).chain([self.state.topic()])
    }

    /// Forgets what was published, so that everything is published again.
    pub(super) fn forget(&mut self) {
        self.slots.iter_mut().for_each(|(_, slot)| slot.forget());
        self.state.forget();
        self.recorded = None;
        self.restart();
    }

    fn restart(&mut self) {
        (self.cursor, self.walking, self.walked) = (0, None, None);
    }

    /// Takes a register that was read on demand; it is published even if nothing changed.
    pub(super) fn take_param(&mut self, register: usize, reading: Reading, topic: String) {
        self.params.insert(register, reading);
        let known = self.slots.iter_mut().find(|(kind, _)| *kind == Kind::Param(register));
        match known {
            Some((_, slot)) => slot.forget(),
            None => self.slots.push((Kind::Param(register), Slot::new(topic))),
        }
        self.restart();
    }

    /// The next publication; nothing if all topics show the picture.
    pub(super) fn next(
        &mut self,
        now: &Present,
        drive: &DriveDescription,
        view: &Arc<DriveView>,
    ) -> Option<Publication> {
        if self.walked.as_ref().is_some_and(|(walked, until)| Arc::ptr_eq(walked, view) && now.at < *until) {
            return None;
        }
        self.walked = None;
        self.walking.get_or_insert_with(|| view.clone());
        while self.cursor < self.slots.len() {
            self.cursor += 1;
            if let Some(publication) = self.offer(self.cursor - 1, now, drive, view) {
                return Some(publication);
            }
        }
        let (model, bands) = (&drive.model, &self.bands);
        let differ = |register: &Register, old, new| {
            place_of(model, register).is_some_and(|place| differ(register, bands[place], old, new))
        };
        if let Some(publication) = self.state.offer(now, drive, view, differ) {
            return Some(publication);
        }
        let until = self.until(now, drive, view);
        let is_of_this_picture = self.walking.take().is_some_and(|walking| Arc::ptr_eq(&walking, view));
        self.walked = is_of_this_picture.then(|| (view.clone(), until));
        self.cursor = 0;
        // What was walked before the picture changed is walked once more.
        if is_of_this_picture { None } else { self.next(now, drive, view) }
    }

    fn offer(
        &mut self,
        place: usize,
        now: &Present,
        drive: &DriveDescription,
        view: &DriveView,
    ) -> Option<Publication> {
        let kind = self.slots.get(place)?.0;
        let content = self.content(kind, now, drive, view)?;
        let register = match kind {
            Kind::Polled(register) | Kind::Param(register) => drive.model.registers.get(register),
            _ => None,
        };
        let payload = payload(&content, register);
        let band = band_of(&self.bands, kind);
        let has_moved = |old, new| register.is_some_and(|register| differ(register, band, old, new));
        let slot = &mut self.slots.get_mut(place)?.1;
        let qos = if kind == Kind::Availability { Qos::AtLeastOnce } else { Qos::AtMostOnce };
        slot.offer(now, content, has_moved).then(|| slot.publication(now, payload, qos))
    }

    /// What has changed of run state, frequencies and measurements since it was told, in the order in which it happened.
    pub(super) fn record(
        &mut self,
        now: &Present,
        place: usize,
        drive: &DriveDescription,
        view: &Arc<DriveView>,
    ) -> Vec<Change> {
        if self.recorded.as_ref().is_some_and(|recorded| Arc::ptr_eq(recorded, view)) {
            return Vec::new();
        }
        self.recorded = Some(view.clone());
        let kinds: Vec<_> = self.slots.iter().map(|(kind, _)| *kind).filter(|kind| kind.is_recorded()).collect();
        let contents: Vec<_> = kinds.into_iter().map(|kind| (kind, self.content(kind, now, drive, view))).collect();
        let mut changes = Vec::new();
        for (kind, content) in contents {
            let (Some(content), Some((_, slot))) = (content, self.slots.iter_mut().find(|(it, _)| *it == kind)) else {
                continue;
            };
            let register = kind.register().and_then(|register| drive.model.registers.get(register));
            let band = band_of(&self.bands, kind);
            if !slot.tell(&content, |old, new| register.is_some_and(|register| differ(register, band, old, new))) {
                continue;
            }
            let read_at = register.and_then(|it| view.snapshot.reading(it.address)).map(|reading| reading.at);
            let topic = below_drive(slot.topic(), drive).to_owned();
            let (at, register) = (read_at.unwrap_or(now.at), kind.register());
            changes.push(Change { drive: place, topic, register, at, content });
        }
        changes.sort_by_key(|change| change.at);
        changes
    }

    /// What belongs on a topic; nothing if it is to be left as it is.
    fn content(&self, kind: Kind, now: &Present, drive: &DriveDescription, view: &DriveView) -> Option<Content> {
        let trip = Some(&view.trip).filter(|_| trips_are_fresh(drive, view, now.at));
        let text = |text: Option<String>| text.map_or(Content::Cleared, |text| Content::Text(text.into()));
        let word = |reading: Option<Reading>| reading.map_or(Content::Cleared, |it| Content::Word(it.raw));
        Some(match kind {
            Kind::Availability => Content::Text(if view.is_online() { "online" } else { "offline" }.into()),
            Kind::RunState => Content::Text(shown_run_state(view).word().into()),
            Kind::Polled(register) => {
                word(drive.model.registers.get(register).and_then(|it| fresh(drive, it, view, now.at)))
            }
            Kind::Rated(register) => {
                text(drive.model.registers.get(register).and_then(|it| rated(drive, it, view, now.at)))
            }
            Kind::Setpoint => text(view.control.as_ref().and_then(|it| it.setpoint).map(|hertz| hertz.to_string())),
            Kind::Owner => text(view.control.as_ref().and_then(|it| it.lease).map(|(owner, _)| owner.to_string())),
            Kind::TripActive => text(trip.and_then(|it| it.active).map(|active| active.to_string())),
            Kind::TripCount => text(view.trip_kept.count.filter(|_| trip.is_some()).map(|count| count.to_string())),
            Kind::TripCode => text(code(view).filter(|_| trip.is_some()).map(|code| code.to_string())),
            Kind::TripText => {
                text(code(view).filter(|_| trip.is_some()).and_then(|code| state::trip_text(drive, code)))
            }
            // Without a record of our own, what stands there from before is still true.
            Kind::TripLast => {
                let record = state::record(drive, now.clock, view.trip_kept.last.as_ref()?);
                Content::Text(Value::Object(record).to_string().into())
            }
            Kind::Param(register) => {
                let is_fresh = |reading: &&Reading| now.at < param_stale_at(now, reading);
                word(self.params.get(&register).filter(is_fresh).copied())
            }
        })
    }

    /// Until when nothing is due while the picture stays as it is.
    fn until(&self, now: &Present, drive: &DriveDescription, view: &DriveView) -> MonoTime {
        let heartbeats = self.slots.iter().map(|(_, slot)| slot.due(now.heartbeat));
        let ends = self.slots.iter().filter_map(|(kind, slot)| self.ends_at(*kind, slot, now, drive, view));
        // The state shows staleness of every polled register, also of those without a topic of their own.
        let polled = drive.model.registers.iter().filter(|it| it.poll.is_some());
        let stale = polled.filter_map(|it| stale_at(drive, it, view)).filter(|stale_at| *stale_at > now.at);
        let all = heartbeats.chain(ends).chain(stale).chain([self.state.due(now.heartbeat)]);
        all.min().unwrap_or(MonoTime::NEVER)
    }

    /// When what stands on a topic is to be cleared.
    fn ends_at(
        &self,
        kind: Kind,
        slot: &Slot,
        now: &Present,
        drive: &DriveDescription,
        view: &DriveView,
    ) -> Option<MonoTime> {
        let trips = drive.model.trip_register();
        let register = match kind {
            Kind::Polled(register) | Kind::Rated(register) => drive.model.registers.get(register),
            Kind::TripActive | Kind::TripCode | Kind::TripText | Kind::TripCount => trips,
            Kind::Param(register) => {
                return self.params.get(&register).filter(|_| slot.is_filled()).map(|it| param_stale_at(now, it));
            }
            _ => None,
        };
        stale_at(drive, register?, view).filter(|_| slot.is_filled())
    }

    /// When the finished walk is to be walked again; nothing while one is under way.
    pub(super) fn wake(&self) -> Option<MonoTime> {
        self.walked.as_ref().map(|(_, until)| *until)
    }
}

/// A value in per cent of a rated one, in the unit of that, with two decimals; nothing if it is stale.
fn rated(drive: &DriveDescription, register: &Register, view: &DriveView, at: MonoTime) -> Option<String> {
    let hundredths = Rated::of(register, &drive.ratings)?.hundredths(fresh(drive, register, view, at)?.raw);
    Some(format!("{}.{:02}", hundredths / 100, hundredths % 100))
}

/// A value that was asked for once is shown for as long as a broker may keep it.
fn param_stale_at(now: &Present, reading: &Reading) -> MonoTime {
    reading.at + now.heartbeat * EXPIRY_HEARTBEATS
}

/// Whether what is known of trips is not older than the register that tells them may be. One that is not polled is read
/// in another way.
fn trips_are_fresh(drive: &DriveDescription, view: &DriveView, at: MonoTime) -> bool {
    let polled = drive.model.trip_register().filter(|it| it.poll.is_some());
    polled.is_none_or(|register| fresh(drive, register, view, at).is_some())
}

/// The number of the cause of the trip that holds, 0 if none holds; nothing if that is not known.
fn code(view: &DriveView) -> Option<u16> {
    if view.trip.active? { view.trip.last.as_ref()?.code } else { Some(0) }
}

fn payload(content: &Content, register: Option<&Register>) -> Vec<u8> {
    match (content, register) {
        (Content::Text(text), _) => text.as_bytes().to_vec(),
        (Content::Word(word), Some(register)) => Scaled::from_word(*word, register).to_string().into_bytes(),
        (Content::Word(_) | Content::Cleared, _) => Vec::new(),
    }
}

fn place_of(model: &Model, register: &Register) -> Option<usize> {
    model.registers.binary_search_by_key(&register.address, |it| it.address).ok()
}

/// The smallest change of a topic that is published, in steps.
fn band_of(bands: &[f64], kind: Kind) -> f64 {
    kind.register().and_then(|register| bands.get(register)).copied().unwrap_or(1.0)
}

/// The levels of `topic` below those of `drive`.
fn below_drive<'t>(topic: &'t str, drive: &DriveDescription) -> &'t str {
    let place = topic.find(&format!("/drive/{}/", drive.name)).map(|start| start + "/drive/".len());
    place.and_then(|start| topic.get(start + drive.name.as_str().len() + 1..)).unwrap_or(topic)
}

/// The dead band of `register` in its steps; one step where none is configured.
fn band(drive: &DriveDescription, register: &Register) -> f64 {
    let configured = drive.dead_bands.iter().find(|(name, _)| *name == register.name);
    configured.map_or(1.0, |(_, band)| band * f64::from(register.scale))
}

/// Whether two words of `register` differ by at least `band` steps.
fn differ(register: &Register, band: f64, old: u16, new: u16) -> bool {
    // A band in decimal is seldom a whole number of steps to the last bit.
    const ROUNDING: f64 = 1e-6;
    let raw = |word: u16| if register.signed { i32::from(word.cast_signed()) } else { i32::from(word) };
    old != new && f64::from((raw(old) - raw(new)).abs()) + ROUNDING >= band
}

/// What is shown of `drive`, each with its topic below the drive's.
pub(super) fn kinds(drive: &DriveDescription) -> Vec<(Kind, String)> {
    let mut kinds = vec![(Kind::Availability, "availability".into()), (Kind::RunState, "run/state".into())];
    let polled = |(_, register): &(usize, &Register)| register.poll.is_some();
    let values = drive.model.registers.iter().enumerate().filter(polled);
    kinds.extend(values.filter_map(|(place, register)| Some((Kind::Polled(place), value_topic(register)?))));
    let in_per_cent = drive.model.registers.iter().enumerate().filter(polled).filter_map(|(place, register)| {
        let rated = Rated::of(register, &drive.ratings)?;
        Some((Kind::Rated(place), format!("measure/{}", measure_name(register.role?, rated.unit)?)))
    });
    kinds.extend(in_per_cent);
    let has_setpoint = kinds.iter().any(|(_, rest)| rest == SETPOINT);
    if drive.control.is_some() && !has_setpoint {
        kinds.push((Kind::Setpoint, SETPOINT.into()));
    }
    if drive.control.is_some() {
        kinds.push((Kind::Owner, "control/owner".into()));
    }
    let trips = [
        (Kind::TripActive, "active"),
        (Kind::TripCode, "code"),
        (Kind::TripText, "text"),
        (Kind::TripCount, "count"),
        (Kind::TripLast, "last"),
    ];
    kinds.extend(trips.map(|(kind, rest)| (kind, format!("trip/{rest}"))));
    kinds
}

const SETPOINT: &str = "frequency/setpoint";

/// The topic of a polled register; nothing for the trip count, which is shown as it was understood.
fn value_topic(register: &Register) -> Option<String> {
    match register.role {
        Some(Role::OutputFrequency) => Some("frequency/output".to_owned()),
        Some(Role::FrequencySetting | Role::FrequencyCommand) => Some(SETPOINT.to_owned()),
        Some(Role::TripCount | Role::TripCode | Role::TripCause | Role::TripHistory) => None,
        Some(role) => Some(format!("measure/{}", measure_name(role, register.unit).unwrap_or(&register.name))),
        None => Some(format!("measure/{}", register.name)),
    }
}

/// The name that a measurement has for every vendor, where it is in the unit that it has for every vendor.
const fn measure_name(role: Role, unit: UnitOfMeasure) -> Option<&'static str> {
    Some(match (role, unit) {
        (Role::OutputCurrent, UnitOfMeasure::Ampere) => "current",
        (Role::OutputVoltage, UnitOfMeasure::Volt) => "voltage",
        (Role::DcLinkVoltage, UnitOfMeasure::Volt) => "dc_voltage",
        (Role::OutputPower, UnitOfMeasure::Kilowatt) => "power",
        (Role::Torque, UnitOfMeasure::Percent) => "torque",
        (Role::Temperature, UnitOfMeasure::Celsius) => "temperature",
        (Role::RunHours, UnitOfMeasure::Hour) => "run_hours",
        _ => return None,
    })
}
