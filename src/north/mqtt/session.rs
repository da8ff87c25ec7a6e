//! The MQTT session: its life from connection to farewell, and its next act.

use super::command_ids::CommandIds;
use super::counters::MqttCounters;
use super::dispatch::AnswerContext;
use super::event_queue::EventQueue;
use super::half::PairMember;
use super::history::ChangeHistory;
use super::home_assistant::{DiscoveryPlant, DiscoveryWalk};
use super::results::WaitingResults;
use super::stored::StoredEvents;
use super::telemetry::TelemetryTopics;
use super::told::{EventMark, PeerEvents};
use super::topics::MqttTopics;
use super::types::{GatewayIdentity, MqttAct, Settings};
use crate::domain::ids::{AskerId, Name};
use crate::domain::time::MonoTime;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::view::{DriveView, TripEvent};
use crate::journal::trip;
use crate::north::broker::{
    BrokerCommands, BrokerEvent, BrokerLimits, BrokerPath, ClientClocks, OversizedTopics,
    Publication, PublicationRefusal, Qos, SessionLine, SubscriptionFilter,
};
use crate::north::clock::{ClockMoment, LabelClock};
use std::sync::Arc;

/// The source of a publication, marked in its token. Numbers stay far below.
const DISCOVERY: u64 = 1 << 61;
const STORED: u64 = 1 << 62;
const HISTORY: u64 = 1 << 63;

/// The MQTT side of the gateway as a machine without a socket or a clock. Its owner moves things between it, the
/// broker and the lines:
///
/// * what happens on the connection goes to [`handle`](Self::handle), answers of the lines to
///   [`command_answer`](Self::command_answer) and [`native_answer`](Self::native_answer), trips to
///   [`trip`](Self::trip), or if a journal keeps them, to [`stored_events`](Self::stored_events);
/// * [`tick`](Self::tick) is called when [`next_wake`](Self::next_wake) is due;
/// * after each of these, and whenever a view changed, [`next_act`](Self::next_act) is called until it returns
///   `None`. While there is no room for publications, [`next_inward`](Self::next_inward) is called instead.
///
/// Nothing is published before the broker has granted every subscription and a probe has returned, except the probe and
/// results of commands.
#[derive(Debug)]
pub struct MqttSession {
    pub(super) settings: Settings,
    pub(super) topics: MqttTopics,
    pub(super) drives: Vec<DriveDescription>,
    pub(super) lines: Vec<Name>,
    /// Distinguishes this process from others of the same gateway: its start, in milliseconds since 1970, and of several
    /// gateways which one it is.
    pub(super) run: String,
    pub(super) clock: LabelClock,
    pub(super) issued: ClientClocks,
    pub(super) started: MonoTime,
    pub(super) path: BrokerPath,
    pub(super) broker: BrokerLimits,
    /// What is larger than it takes.
    pub(super) oversized: OversizedTopics,
    pub(super) commands: BrokerCommands<AnswerContext>,
    /// Used ids per drive.
    pub(super) seen: Vec<CommandIds>,
    pub(super) results: WaitingResults,
    pub(super) events: EventQueue,
    pub(super) stored: StoredEvents,
    /// What other gateways of the name have published.
    pub(super) told: PeerEvents,
    /// Which of them this one is.
    pub(super) half: PairMember,
    history: ChangeHistory,
    pub(super) telemetry: TelemetryTopics,
    pub(super) discovery: DiscoveryWalk,
    pub(super) counters: MqttCounters,
    /// The alive topic says that the clients are offline.
    pub(super) are_commanders_gone: bool,
}

impl MqttSession {
    /// The session of this gateway with these drives and lines, started now. `probe_key` is random, and used by this
    /// session only: without it no peer can forge a probe.
    #[must_use]
    pub fn new(
        gateway: GatewayIdentity,
        settings: Settings,
        drives: Vec<DriveDescription>,
        lines: Vec<Name>,
        started: ClockMoment,
        probe_key: u128,
    ) -> Self {
        let topics = MqttTopics::new(&gateway, &settings);
        let clock = LabelClock::new(started);
        let half = gateway
            .standby
            .as_ref()
            .map(|pair| format!("-{}", pair.half))
            .unwrap_or_default();
        let run = format!("{}{half}", started.wall.unix_ms);
        let mut half = PairMember::new(gateway.standby, &topics);
        half.replace(&lines, drives.iter().map(|drive| drive.line.clone()));
        let mut session = Self {
            telemetry: TelemetryTopics::new(
                &settings,
                &topics,
                &drives,
                &lines,
                &clock.text(started.mono),
            ),
            path: BrokerPath::new(probe_key, settings.probe_interval, settings.probe_timeout),
            seen: drives.iter().map(|_| CommandIds::default()).collect(),
            broker: BrokerLimits::default(),
            oversized: OversizedTopics::default(),
            commands: BrokerCommands::new(AskerId::MQTT),
            results: WaitingResults::default(),
            events: EventQueue::default(),
            stored: StoredEvents::default(),
            told: PeerEvents::default(),
            half,
            history: ChangeHistory::new(settings.keep_telemetry),
            discovery: DiscoveryWalk::default(),
            counters: MqttCounters::default(),
            are_commanders_gone: false,
            settings,
            topics,
            drives,
            lines,
            run,
            clock,
            issued: ClientClocks::default(),
            started: started.mono,
        };
        session.speak(started.mono);
        session
    }

    /// What the broker publishes when the connection breaks.
    #[must_use]
    pub fn will(&self) -> Publication {
        goodbye(self.topics.gateway("status"))
    }

    /// Takes what happened on the connection.
    pub fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        self.clock.see(at);
        if !matches!(event, BrokerEvent::Stalled(_)) {
            self.path.look(at.mono);
        }
        match event {
            BrokerEvent::Connected(broker) => self.connected(at.mono, broker),
            BrokerEvent::Subscribed(granted) => self.subscribed(at, &granted),
            BrokerEvent::Message(message) => self.message(at, &message),
            BrokerEvent::Acknowledged(token) => self.acknowledged(token),
            BrokerEvent::Refused(token, refusal) => self.refused(at.mono, token, refusal),
            BrokerEvent::Stalled(stood) => self.path.stalled(at.mono, stood),
            BrokerEvent::Lost => self.lost(at.mono),
        }
    }

    fn connected(&mut self, at: MonoTime, broker: BrokerLimits) {
        self.lost(at);
        self.broker = broker;
        self.oversized.forget();
        self.path.connected();
    }

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
        self.counters.alive_refused = u64::from(is_whole && is_alive_refused && is_granted);
        if self.path.subscribed(at.mono, is_granted) {
            self.commands.path_opened();
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
        let counters = &mut self.counters;
        match token & (STORED | HISTORY) {
            STORED => {
                counters.events_refused += u64::from(self.stored.refused(at, number, refusal))
            }
            HISTORY => {
                counters.history_dropped += u64::from(self.history.refused(at, number, refusal))
            }
            _ => counters.events_refused += u64::from(self.events.refused(at, number, refusal)),
        }
        self.count_events();
    }

    pub(super) fn count_events(&mut self) {
        self.counters.events_waiting = (self.events.len() + self.stored.len()) as u64;
        self.counters.history_waiting = self.history.len() as u64;
    }

    fn lost(&mut self, at: MonoTime) {
        self.path.lost(at);
        self.events.lost();
        self.stored.lost();
        self.history.lost();
        self.telemetry.forget();
        self.discovery.lost();
        self.told.lost();
        self.half.lost();
        self.commands.path_lost();
    }

    /// Takes a trip or its clearing, to be published until the broker has acknowledged it. Drives that are not ours are
    /// ignored.
    pub fn trip(&mut self, at: ClockMoment, place: DriveRef, event: &TripEvent) {
        self.clock.see(at);
        let Some(drive) = self.drives.iter().find(|drive| drive.place == place) else {
            return;
        };
        let mut body = trip::event(drive, &|at| self.clock.text(at), event);
        body.insert("session".to_owned(), self.run.as_str().into());
        let mark = self
            .half
            .pair()
            .map(|_| EventMark::of(drive.name.as_str(), &body))
            .unwrap_or_default();
        if self.told.take(at.mono, &mark) {
            return;
        }
        let topic = self.topics.drive(drive.name.as_str(), "trip/event");
        self.counters.events_dropped += u64::from(self.events.add(topic, body, mark));
        self.count_events();
    }

    /// Advances to the present.
    pub fn tick(&mut self, at: ClockMoment) {
        self.clock.see(at);
        self.check_path(at.mono);
        self.drop_overdue(at);
    }

    fn check_path(&mut self, at: MonoTime) {
        self.counters.probes_lost += u64::from(self.path.check(at));
    }

    /// When [`tick`](Self::tick) and [`next_act`](Self::next_act) are to be called if no event occurs before.
    #[must_use]
    pub fn next_wake(&self) -> Option<MonoTime> {
        let own = [self.path.wake(), self.commands.wake()];
        let own = own.into_iter().flatten().min();
        if !self.path.is_open() {
            return own;
        }
        let may_tell = |mark: &EventMark| self.may_tell(self.half.now(), mark);
        let told = [
            self.telemetry.wake(),
            self.history.wake(),
            self.events.wake(may_tell),
            self.stored.wake(may_tell),
            self.half.wake(self.settings.heartbeat),
            self.discovery.wake(),
        ];
        told.into_iter().chain([own]).flatten().min()
    }

    /// The next item for the lines: commands, reads, and the state of the path from the clients; after them attempts to
    /// be kept. It needs no room on the connection, so that a stop never waits for one.
    pub fn next_inward(&mut self) -> Option<MqttAct> {
        let attempt = |commands: &mut BrokerCommands<_>| {
            commands
                .next_attempt()
                .map(|(drive, it)| MqttAct::Keep(drive, it))
        };
        let to_line = self.commands.next_to_line().map(MqttAct::ToLine);
        to_line
            .or_else(|| attempt(&mut self.commands))
            .or_else(|| self.stored.next_act())
    }

    /// The next act. `views` are in the order of the drives, `lines` in the order of the lines given to
    /// [`new`](Self::new). What is returned counts as done, except events with a token, which are sent again after a
    /// reconnect until they are acknowledged.
    pub fn next_act(
        &mut self,
        at: ClockMoment,
        views: &[Arc<DriveView>],
        lines: &[SessionLine],
    ) -> Option<MqttAct> {
        if let Some(act) = self.next_inward() {
            return Some(act);
        }
        self.clock.see(at);
        self.see_roles(at, lines);
        self.check_path(at.mono);
        self.record(at.mono, views);
        if let Some(reason) = self.path.take_reconnect() {
            self.counters.reconnects += 1;
            return Some(MqttAct::Reconnect(reason));
        }
        if self.path.take_subscription(at.mono) {
            return Some(MqttAct::Subscribe(self.filters()));
        }
        loop {
            let publication = self.next_publication(at.mono, views, lines)?;
            if let Some(publication) = self.admitted(publication) {
                self.counters.messages_out += 1;
                return Some(MqttAct::Publish(publication));
            }
        }
    }

    /// Keeps what cannot be published now, if that is configured.
    fn record(&mut self, at: MonoTime, views: &[Arc<DriveView>]) {
        if !self.path.is_open() && self.history.is_on() {
            let now = (at, self.clock);
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
        if let Some(payload) = self.path.take_probe(at) {
            // It must wait wherever a command waits, so it has to be in the same queue of the broker.
            return Some(passing(
                self.topics.gateway("probe"),
                payload,
                Qos::AtLeastOnce,
                None,
            ));
        }
        if !self.path.is_granted() {
            return None;
        }
        if let Some(result) = self.results.next() {
            return Some(result);
        }
        if !self.path.is_open() {
            return None;
        }
        if let Some(event) = self.next_event(at) {
            return Some(event);
        }
        if let Some(publication) = self.next_of_standby(at) {
            return Some(publication);
        }
        if let Some(publication) = self
            .telemetry
            .next(at, self.clock, &self.drives, views, lines)
        {
            return Some(publication);
        }
        if let Some((topic, payload, number)) =
            self.history
                .next(at, &self.topics, self.clock, &self.drives)
        {
            return Some(passing(
                topic,
                payload,
                Qos::AtLeastOnce,
                Some(HISTORY | number),
            ));
        }
        let plant = DiscoveryPlant::of(&self.settings, &self.topics, &self.lines, &self.drives)?;
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
        let event = events.next(at, |mark| self.may_tell(at, mark));
        let event = event.or_else(|| {
            let (topic, payload, seq) = stored.next(at, |mark| self.may_tell(at, mark))?;
            Some((topic, payload, STORED | seq))
        });
        (self.events, self.stored) = (events, stored);
        event.map(|(topic, payload, token)| passing(topic, payload, Qos::AtLeastOnce, Some(token)))
    }

    /// What is subscribed.
    fn filters(&self) -> Vec<SubscriptionFilter> {
        let plant = DiscoveryPlant::of(&self.settings, &self.topics, &self.lines, &self.drives);
        self.topics
            .filters()
            .into_iter()
            .chain(plant.into_iter().flat_map(|it| it.subscriptions()))
            .collect()
    }

    /// What is still to be published on an orderly end.
    pub fn farewell(&mut self, at: ClockMoment) -> Vec<Publication> {
        self.clock.see(at);
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

    /// Whether the path through the broker was proven recently: a probe returned on this connection, no longer ago than
    /// two of them and their time-out allow.
    #[must_use]
    pub fn is_path_alive(&self, at: ClockMoment) -> bool {
        self.path.is_alive(at.mono)
    }

    /// The counters so far.
    #[must_use]
    pub fn counters(&self) -> MqttCounters {
        let (attempts_lost, partner_online) =
            (self.commands.attempts_lost(), self.is_partner_online());
        MqttCounters {
            attempts_lost,
            partner_online,
            ..self.counters
        }
    }
}

/// A publication that the broker does not retain.
const fn passing(topic: String, payload: Vec<u8>, qos: Qos, token: Option<u64>) -> Publication {
    Publication {
        topic,
        payload,
        retain: false,
        qos,
        expiry: None,
        correlation: None,
        token,
    }
}

pub(super) fn goodbye(topic: String) -> Publication {
    let payload = b"offline".to_vec();
    let qos = Qos::AtLeastOnce;
    Publication {
        topic,
        payload,
        retain: true,
        qos,
        expiry: None,
        correlation: None,
        token: None,
    }
}
