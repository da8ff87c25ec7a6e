//! The MQTT session: its life from connection to farewell, and its next act.

use super::command_ids::CommandIds;
use super::counters::MqttCounters;
use super::dispatch::AnswerContext;
use super::event_queue::EventQueue;
use super::half::PairMember;
use super::history::ChangeHistory;
use super::home_assistant::{DiscoveryPlant, DiscoveryWalk};
use super::peer_events::{EventMark, PeerEvents};
use super::results::WaitingResults;
use super::stored::StoredEvents;
use super::telemetry::TelemetryTopics;
use super::topics::MqttTopics;
use super::types::{GatewayIdentity, LeaseMode, Settings};
use crate::domain::command::{CommandAnswer, Owner};
use crate::domain::ids::{AskerId, Name, Ticket};
use crate::domain::native::NativeAnswer;
use crate::domain::time::MonoTime;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::view::{DriveView, TripEvent};
use crate::journal::{StoredEvent, trip};
use crate::north::broker::{
    BrokerEvent, BrokerLink, BrokerSession, OversizedPublication, Publication, PublicationRefusal,
    Qos, SessionAct, SessionLine, SessionNotice, SubscriptionFilter,
};
use crate::north::clock::ClockMoment;
use crate::north::titles::PlantTitles;
use std::sync::Arc;

/// The source of a publication, marked in its token. Numbers stay far below.
const DISCOVERY: u64 = 1 << 61;
const STORED: u64 = 1 << 62;
const HISTORY: u64 = 1 << 63;

/// The MQTT side of the gateway.
///
/// Nothing is published before the broker has granted every subscription and a probe has returned, except the probe and
/// results of commands.
#[derive(Debug)]
pub struct MqttSession {
    pub(super) settings: Settings,
    pub(super) topics: MqttTopics,
    pub(super) drives: Vec<DriveDescription>,
    pub(super) lines: Vec<Name>,
    pub(super) titles: Arc<PlantTitles>,
    /// Distinguishes this process from others of the same gateway: its start, in milliseconds since 1970, and of several
    /// gateways which one it is.
    pub(super) run: String,
    pub(super) started: MonoTime,
    pub(super) link: BrokerLink<AnswerContext>,
    /// Used ids per drive.
    pub(super) seen: Vec<CommandIds>,
    pub(super) results: WaitingResults,
    pub(super) events: EventQueue,
    pub(super) stored: StoredEvents,
    /// What other gateways of the name have published.
    pub(super) peer_events: PeerEvents,
    /// Which of them this one is.
    pub(super) half: PairMember,
    history: ChangeHistory,
    pub(super) telemetry: TelemetryTopics,
    pub(super) discovery: DiscoveryWalk,
    pub(super) counters: MqttCounters,
    /// The alive topic says that the clients are offline.
    pub(super) are_commanders_gone: bool,
}

impl BrokerSession for MqttSession {
    /// The gateway, and the settings of the session.
    type Settings = (GatewayIdentity, Settings);
    type Counters = MqttCounters;
    const ASKER: AskerId = AskerId::MQTT;
    const OWNER: Owner = Owner::Mqtt;
    const LEAVES_WILL: bool = false;
    const SHOWS_STATIONS: bool = true;

    fn new(
        (gateway, settings): Self::Settings,
        drives: Vec<DriveDescription>,
        lines: Vec<Name>,
        started: ClockMoment,
        probe_key: u128,
    ) -> Self {
        let topics = MqttTopics::new(&gateway, &settings);
        let half = gateway
            .standby
            .as_ref()
            .map(|pair| format!("-{}", pair.half))
            .unwrap_or_default();
        let run = format!("{}{half}", started.wall.unix_ms);
        let mut half = PairMember::new(gateway.standby, &topics);
        half.replace(&lines, drives.iter().map(|drive| drive.line.clone()));
        let link = BrokerLink::new(
            Self::ASKER,
            started,
            probe_key,
            settings.probe_interval,
            settings.probe_timeout,
        );
        let mut session = Self {
            telemetry: TelemetryTopics::new(
                &settings,
                &topics,
                &drives,
                &lines,
                &link.clock.text(started.mono),
            ),
            seen: drives.iter().map(|_| CommandIds::default()).collect(),
            results: WaitingResults::default(),
            events: EventQueue::default(),
            stored: StoredEvents::default(),
            peer_events: PeerEvents::default(),
            half,
            history: ChangeHistory::new(settings.keep_telemetry),
            discovery: DiscoveryWalk::default(),
            counters: MqttCounters::default(),
            are_commanders_gone: false,
            settings,
            topics,
            drives,
            lines,
            titles: Arc::default(),
            run,
            started: started.mono,
            link,
        };
        session.apply_roles(started.mono);
        session
    }

    fn count_tickets_from(&mut self, first: Ticket) {
        self.link.commands.count_tickets_from(first);
    }

    fn see_titles(&mut self, titles: &Arc<PlantTitles>) {
        self.titles = Arc::clone(titles);
    }

    /// A drive continues if its place and name are the same; requests to the others no longer have an answer. Topics of
    /// what was removed are cleared.
    fn replace(&mut self, at: ClockMoment, drives: Vec<DriveDescription>, lines: Vec<Name>) {
        self.link.clock.see(at);
        self.replace_plant(at, drives, lines);
    }

    fn will(&self) -> Publication {
        goodbye(self.topics.gateway("status"))
    }

    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        self.link.handle(at, &event);
        match event {
            BrokerEvent::Connected(_) | BrokerEvent::Lost => self.lost(),
            BrokerEvent::Subscribed(granted) => self.subscribed(at, &granted),
            BrokerEvent::Message(message) => self.message(at, &message),
            BrokerEvent::Acknowledged(token) => self.acknowledged(token),
            BrokerEvent::Refused(token, refusal) => self.refused(at.mono, token, refusal),
            BrokerEvent::Stalled(_) => {}
        }
    }

    fn command_answer(&mut self, at: ClockMoment, answer: &CommandAnswer) {
        self.link.clock.see(at);
        if answer.asker == Self::ASKER {
            self.answered(at, answer);
        }
    }

    fn native_answer(&mut self, at: ClockMoment, answer: &NativeAnswer) {
        self.link.clock.see(at);
        if answer.asker == Self::ASKER {
            self.read_answered(at, answer);
        }
    }

    fn refused_by_line(&mut self, at: ClockMoment, ticket: Ticket) {
        self.link.clock.see(at);
        if let Some((pending, report)) = self.link.commands.refused_by_line(ticket) {
            self.end(at, &pending, report);
        }
    }

    /// A trip event is published until the broker has acknowledged it. Drives that are not ours are ignored.
    fn trip(&mut self, at: ClockMoment, place: DriveRef, event: &TripEvent) {
        self.link.clock.see(at);
        let Some(drive) = self.drives.iter().find(|drive| drive.place == place) else {
            return;
        };
        let mut body = trip::event(drive, &|at| self.link.clock.text(at), event);
        body.insert("session".to_owned(), self.run.as_str().into());
        let mark = self
            .half
            .pair()
            .map(|_| EventMark::of(drive.name.as_str(), &body))
            .unwrap_or_default();
        if self.peer_events.take(at.mono, &mark) {
            return;
        }
        let topic = self.topics.drive(drive.name.as_str(), "trip/event");
        self.counters.events_dropped += u64::from(self.events.add(topic, body, mark));
        self.count_events();
    }

    /// Events are published at `trip/event` until the broker has acknowledged them: then [`SessionAct::EventTaken`] is
    /// returned for each. Together they are what [`SessionAct::WantEvents`] requested: the first of those that no broker has
    /// and whose numbers are higher, in rising order.
    ///
    /// Anything else is ignored. A journal that has something not yet requested rings with no events and `more`; a
    /// request that cannot be answered yet stays open until it can.
    fn stored_events(&mut self, at: ClockMoment, events: &[StoredEvent], more: bool) {
        self.link.clock.see(at);
        self.take_stored(at, events, more);
    }

    fn has_partner(&self) -> bool {
        self.half.pair().is_some()
    }

    fn see_roles(&mut self, at: ClockMoment, lines: &[SessionLine]) {
        if self.half.see(at.mono, lines) {
            self.apply_roles(at.mono);
        }
    }

    fn tick(&mut self, at: ClockMoment) {
        self.link.clock.see(at);
        self.check_path(at.mono);
        self.drop_overdue(at);
    }

    fn next_wake(&self) -> Option<MonoTime> {
        let own = [self.link.path.wake(), self.link.commands.wake()];
        let own = own.into_iter().flatten().min();
        if !self.link.path.is_open() {
            return own;
        }
        let may_publish = |mark: &EventMark| self.may_publish(self.half.now(), mark);
        let publications = [
            self.telemetry.wake(),
            self.history.wake(),
            self.events.wake(may_publish),
            self.stored.wake(may_publish),
            self.half.wake(self.settings.heartbeat),
            self.discovery.wake(),
        ];
        publications.into_iter().chain([own]).flatten().min()
    }

    fn next_inward(&mut self) -> Option<SessionAct> {
        self.link.next_inward().or_else(|| self.stored.next_act())
    }

    fn next_act(
        &mut self,
        at: ClockMoment,
        views: &[Arc<DriveView>],
        lines: &[SessionLine],
    ) -> Option<SessionAct> {
        if let Some(act) = self.next_inward() {
            return Some(act);
        }
        self.link.clock.see(at);
        self.see_roles(at, lines);
        self.check_path(at.mono);
        self.record(at.mono, views);
        if let Some(reason) = self.link.path.take_reconnect() {
            self.counters.reconnects += 1;
            return Some(SessionAct::Reconnect(reason));
        }
        if self.link.path.take_subscription(at.mono) {
            return Some(SessionAct::Subscribe(self.filters()));
        }
        loop {
            let publication = self.next_publication(at.mono, views, lines)?;
            if let Some(publication) = self.admitted(publication) {
                self.counters.messages_out += 1;
                return Some(SessionAct::Publish(publication));
            }
        }
    }

    fn farewell(&mut self, at: ClockMoment) -> Vec<Publication> {
        self.link.clock.see(at);
        let all = if self.half.pair().is_some() {
            self.farewell_as_half(at.mono)
        } else {
            let drives = self
                .drives
                .iter()
                .map(|drive| self.topics.drive(drive.name.as_str(), "availability"));
            drives
                .chain([self.topics.gateway("status")])
                .map(goodbye)
                .collect()
        };
        all.into_iter().filter_map(|it| self.admitted(it)).collect()
    }

    fn next_notice(&mut self) -> Option<SessionNotice> {
        self.link.next_notice()
    }

    fn oversized(&self) -> &[OversizedPublication] {
        self.link.oversized.all()
    }

    fn clients_gone(&self) -> Option<&str> {
        let depends = self.are_commanders_gone && self.settings.lease == LeaseMode::Session;
        if depends {
            self.settings.alive_topic.as_deref()
        } else {
            None
        }
    }

    /// A probe returned on this connection, no longer ago than two of them and their time-out allow.
    fn is_path_alive(&self, at: ClockMoment) -> bool {
        self.link.path.is_alive(at.mono)
    }

    fn counters(&self) -> MqttCounters {
        let (attempts_lost, partner_online) =
            (self.link.commands.attempts_lost(), self.is_partner_online());
        MqttCounters {
            attempts_lost,
            partner_online,
            ..self.counters
        }
    }
}

impl MqttSession {
    fn subscribed(&mut self, at: ClockMoment, granted: &[bool]) {
        let filters = self.filters();
        let is_whole = granted.len() == filters.len();
        // The other grants are not needed. Without the alive topic the probe alone shows whether the path is open.
        let is_needed = |filter: &SubscriptionFilter| !filter.wants_retained;
        let is_granted = is_whole
            && filters
                .iter()
                .zip(granted)
                .all(|(it, granted)| *granted || !is_needed(it));
        let alive = filters
            .iter()
            .position(|it| Some(it.path.as_str()) == self.settings.alive_topic.as_deref());
        let is_alive_refused = alive.and_then(|place| granted.get(place)) == Some(&false);
        let is_alive_refused = is_whole && is_alive_refused && is_granted;
        self.counters.alive_refused = u64::from(is_alive_refused);
        if is_alive_refused {
            self.link.notify(SessionNotice::AliveTopicRefused);
        }
        if self.link.path.subscribed(at.mono, is_granted) {
            self.link.commands.path_opened();
        }
    }

    pub(super) fn acknowledged(&mut self, token: u64) {
        let number = token & !(DISCOVERY | STORED | HISTORY);
        match token & (DISCOVERY | STORED | HISTORY) {
            DISCOVERY => self.discovery.acknowledged(number),
            STORED => self.stored.acknowledged(number),
            HISTORY => self.history.acknowledged(number),
            _ => self.events.acknowledged(number),
        }
        self.count_events();
    }

    fn refused(&mut self, at: MonoTime, token: u64, refusal: PublicationRefusal) {
        let number = token & !(STORED | HISTORY);
        let is_event_given_up = match token & (STORED | HISTORY) {
            STORED => self.stored.refused(at, number, refusal),
            HISTORY => {
                let is_given_up = self.history.refused(at, number, refusal);
                self.counters.history_dropped += u64::from(is_given_up);
                false
            }
            _ => self.events.refused(at, number, refusal),
        };
        if is_event_given_up {
            self.counters.events_refused += 1;
            self.link.notify(SessionNotice::EventRefused);
        }
        self.count_events();
    }

    pub(super) fn count_events(&mut self) {
        self.counters.events_waiting = (self.events.len() + self.stored.len()) as u64;
        self.counters.history_waiting = self.history.len() as u64;
    }

    fn lost(&mut self) {
        self.events.lost();
        self.stored.lost();
        self.history.lost();
        self.telemetry.forget();
        self.discovery.lost();
        self.peer_events.lost();
        self.half.lost();
    }

    fn check_path(&mut self, at: MonoTime) {
        self.counters.probes_lost += u64::from(self.link.path.check(at));
    }

    /// Keeps what cannot be published now, if that is configured.
    fn record(&mut self, at: MonoTime, views: &[Arc<DriveView>]) {
        if !self.link.path.is_open() && self.history.is_on() {
            let now = (at, self.link.clock);
            let dropped = self
                .telemetry
                .record(now, &self.drives, views, &mut self.history);
            self.counters.history_dropped += dropped;
            self.count_events();
        }
    }

    fn next_publication(
        &mut self,
        at: MonoTime,
        views: &[Arc<DriveView>],
        lines: &[SessionLine],
    ) -> Option<Publication> {
        if let Some(payload) = self.link.path.take_probe(at) {
            // It must wait wherever a command waits, so it has to be in the same queue of the broker.
            return Some(Publication {
                qos: Qos::AtLeastOnce,
                ..Publication::new(self.topics.gateway("probe"), payload)
            });
        }
        if !self.link.path.is_granted() {
            return None;
        }
        if let Some(result) = self.results.next() {
            return Some(result);
        }
        if !self.link.path.is_open() {
            return None;
        }
        if let Some(event) = self.next_event(at) {
            return Some(event);
        }
        if let Some(publication) = self.next_of_standby(at) {
            return Some(publication);
        }
        if let Some(publication) =
            self.telemetry
                .next(at, self.link.clock, &self.drives, views, lines)
        {
            return Some(publication);
        }
        if let Some((topic, payload, number)) =
            self.history
                .next(at, &self.topics, self.link.clock, &self.drives)
        {
            return Some(acknowledged_one(topic, payload, HISTORY | number));
        }
        let plant = DiscoveryPlant::of(
            &self.settings,
            &self.topics,
            &self.titles,
            &self.lines,
            &self.drives,
        )?;
        let (publication, number) = self.discovery.next(at, &plant)?;
        Some(Publication {
            token: Some(DISCOVERY | number),
            ..publication
        })
    }

    fn next_event(&mut self, at: MonoTime) -> Option<Publication> {
        let (mut events, mut stored) = (
            std::mem::take(&mut self.events),
            std::mem::take(&mut self.stored),
        );
        let event = events.next(at, |mark| self.may_publish(at, mark));
        let event = event.or_else(|| {
            let (topic, payload, seq) = stored.next(at, |mark| self.may_publish(at, mark))?;
            Some((topic, payload, STORED | seq))
        });
        (self.events, self.stored) = (events, stored);
        event.map(|(topic, payload, token)| acknowledged_one(topic, payload, token))
    }

    /// What is subscribed.
    fn filters(&self) -> Vec<SubscriptionFilter> {
        let plant = DiscoveryPlant::of(
            &self.settings,
            &self.topics,
            &self.titles,
            &self.lines,
            &self.drives,
        );
        self.topics
            .filters()
            .into_iter()
            .chain(plant.into_iter().flat_map(|it| it.subscriptions()))
            .collect()
    }
}

/// A publication that the broker acknowledges and does not retain.
fn acknowledged_one(topic: String, payload: Vec<u8>, token: u64) -> Publication {
    Publication {
        token: Some(token),
        qos: Qos::AtLeastOnce,
        ..Publication::new(topic, payload)
    }
}

pub(super) fn goodbye(topic: String) -> Publication {
    Publication {
        retain: true,
        qos: Qos::AtLeastOnce,
        ..Publication::new(topic, b"offline".to_vec())
    }
}
