//! The Sparkplug session: its life from connection to farewell, and its next act.

use super::device::{SparkplugDevice, millis};
use super::host::{HostChange, PrimaryHost};
use super::node::{self, EdgeNode};
use super::payload::{PayloadMetric, SparkplugPayload};
use super::topics::{MessageKind, SparkplugInbound, SparkplugTopics};
use super::types::{Settings, SparkplugCounters};
use crate::domain::command::{CommandAnswer, Owner};
use crate::domain::ids::{AskerId, Name, Ticket};
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::north::broker::{
    BrokerEvent, BrokerLink, BrokerMessage, BrokerSession, OversizedPublication, Publication, Qos,
    ReturnedProbe, SessionAct, SessionLine, SessionNotice,
};
use crate::north::clock::ClockMoment;
use std::sync::Arc;
use std::time::Duration;

/// Shortest time between births on request, however many hosts ask.
const BETWEEN_REBIRTHS: Duration = Duration::from_secs(1);

/// The gateway as an edge node of Sparkplug B, each drive a device. Each connection has a number, `bdSeq`.
#[derive(Debug)]
pub struct SparkplugSession {
    pub(super) settings: Settings,
    pub(super) topics: SparkplugTopics,
    pub(super) drives: Vec<DriveDescription>,
    lines: usize,
    pub(super) devices: Vec<SparkplugDevice>,
    pub(super) node: EdgeNode,
    pub(super) link: BrokerLink<()>,
    pub(super) host: PrimaryHost,
    pub(super) bdseq: u8,
    /// The number of the next message.
    pub(super) seq: u8,
    pub(super) is_born: bool,
    /// It was born on this connection, which a change of drives does not undo: hosts consider it online.
    pub(super) is_known: bool,
    /// When everything is born again because a host requested it.
    pub(super) rebirth_at: Option<MonoTime>,
    pub(super) born_at: MonoTime,
    /// The gateway is the edge node: it is the only one, or the active one.
    pub(super) is_mine: bool,
    /// The drives on whose line another gateway is active.
    pub(super) listens: Vec<bool>,
    is_connected: bool,
    /// The session with this broker is to be ended, for this reason.
    leaving: Option<&'static str>,
    /// The device that is checked next.
    pub(super) place: usize,
    pub(super) counters: SparkplugCounters,
}

impl BrokerSession for SparkplugSession {
    type Settings = Settings;
    type Counters = SparkplugCounters;
    const ASKER: AskerId = AskerId::SPARKPLUG;
    const OWNER: Owner = Owner::Sparkplug;
    /// tck-id-payloads-ndeath-will-message-publisher-disconnect-mqtt50: NDEATH is published twice, with the same
    /// number.
    const LEAVES_WILL: bool = true;
    const SHOWS_STATIONS: bool = false;

    fn new(
        settings: Settings,
        drives: Vec<DriveDescription>,
        lines: Vec<Name>,
        started: ClockMoment,
        probe_key: u128,
    ) -> Self {
        let mut session = Self {
            topics: SparkplugTopics::new(&settings),
            devices: devices_of(&settings, &drives, lines.len()),
            lines: lines.len(),
            node: EdgeNode::default(),
            link: BrokerLink::new(
                Self::ASKER,
                started,
                probe_key,
                settings.probe_interval,
                settings.probe_timeout,
            ),
            host: PrimaryHost::new(settings.primary_host.is_some()),
            bdseq: 0,
            seq: 0,
            is_born: false,
            is_known: false,
            rebirth_at: None,
            born_at: started.mono,
            is_mine: !settings.standby,
            listens: Vec::new(),
            is_connected: false,
            leaving: None,
            place: 0,
            counters: SparkplugCounters::default(),
            drives,
            settings,
        };
        session.count_history();
        session
    }

    fn count_tickets_from(&mut self, first: Ticket) {
        self.link.commands.count_tickets_from(first);
    }

    /// Everything is born again.
    fn replace(&mut self, _at: ClockMoment, drives: Vec<DriveDescription>, lines: Vec<Name>) {
        self.lines = lines.len();
        let mut devices = devices_of(&self.settings, &drives, self.lines);
        for (drive, device) in drives.iter().zip(&mut devices) {
            if let Some(same) = self.drives.iter().position(|it| it == drive) {
                std::mem::swap(&mut device.history, &mut self.devices[same].history);
            }
        }
        let moved = |old: &DriveDescription| drives.iter().position(|drive| drive == old);
        let moved: Vec<_> = self.drives.iter().map(moved).collect();
        // Outcomes of a drive that was removed are not published any more.
        while self.link.commands.take_gone(&moved).is_some() {}
        self.link.commands.move_drives(&moved);
        self.devices = devices;
        self.drives = drives;
        self.place = 0;
        self.is_born = false;
        self.count_history();
    }

    /// Only the edge node has one.
    fn wants_connection(&self) -> bool {
        self.is_mine
    }

    fn connecting(&mut self, bdseq: u8) {
        self.bdseq = bdseq;
    }

    /// NDEATH with the number of the connection.
    fn will(&self) -> Publication {
        // Written before the connection, so its timestamp would be wrong.
        let metric = PayloadMetric {
            timestamp: None,
            ..node::bdseq(self.bdseq, 0)
        };
        self.death(SparkplugPayload {
            timestamp: None,
            metrics: vec![metric],
            seq: None,
        })
    }

    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        self.link.handle(at, &event);
        match event {
            BrokerEvent::Connected(_) => {
                self.lost();
                self.host.forget();
                self.is_connected = true;
            }
            BrokerEvent::Subscribed(granted) => {
                let is_granted =
                    granted.len() == self.topics.filters().len() && granted.iter().all(|it| *it);
                self.link.path.subscribed(at.mono, is_granted);
            }
            BrokerEvent::Message(message) => self.message(at, &message),
            BrokerEvent::Lost => self.lost(),
            // Every message but a stop has to state its age itself.
            BrokerEvent::Stalled(_) => {}
            // Only the last words are sent in a way that is acknowledged.
            BrokerEvent::Acknowledged(_) | BrokerEvent::Refused(..) => {}
        }
    }

    fn command_answer(&mut self, _at: ClockMoment, answer: &CommandAnswer) {
        if answer.asker == Self::ASKER {
            self.answered(answer);
        }
    }

    fn refused_by_line(&mut self, _at: ClockMoment, ticket: Ticket) {
        if let Some((pending, report)) = self.link.commands.refused_by_line(ticket) {
            self.publish_result(pending.drive, report, Some(&pending));
        }
    }

    /// Among several gateways the edge node is the one that is active on the first line that they share; the drives of
    /// other lines are its devices where it is active.
    fn see_roles(&mut self, _at: ClockMoment, lines: &[SessionLine]) {
        if !self.settings.standby {
            return;
        }
        let first = lines.iter().find_map(|line| line.report.standby);
        self.is_mine = first.is_some_and(|standby| standby.role == LineRole::Active);
        let role_on = |name: &Name| {
            lines
                .iter()
                .find(|line| line.name == *name)?
                .report
                .standby
                .map(|it| it.role)
        };
        self.listens = self
            .drives
            .iter()
            .map(|drive| role_on(&drive.line) == Some(LineRole::Listening))
            .collect();
    }

    fn tick(&mut self, at: ClockMoment) {
        self.link.clock.see(at);
        self.check_path(at.mono);
        self.drop_overdue(at.mono);
    }

    fn next_wake(&self) -> Option<MonoTime> {
        if !self.is_mine {
            return self.link.commands.wake();
        }
        // Once the host is gone, nothing is sent until the connection is left.
        let may_publish = self.may_publish();
        let path = if self.is_born && may_publish {
            self.link.path.wake()
        } else {
            self.link.path.overdue()
        };
        // Devices that are not checked would not be served.
        let looked_at = self
            .devices
            .iter()
            .filter(|device| device.is_born || !self.is_born && self.keeps());
        let devices = looked_at.filter_map(SparkplugDevice::wake).min();
        let rebirth = if may_publish { self.rebirth_at } else { None };
        [path, rebirth, self.link.commands.wake(), devices]
            .into_iter()
            .flatten()
            .min()
    }

    fn next_inward(&mut self) -> Option<SessionAct> {
        self.link.next_inward()
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
        if !self.is_mine {
            return std::mem::take(&mut self.is_connected)
                .then_some(SessionAct::Leave("on standby: another gateway is active"));
        }
        self.check_path(at.mono);
        if let Some(reason) = self.link.path.take_reconnect() {
            return Some(SessionAct::Reconnect(reason));
        }
        if self.link.path.take_subscription(at.mono) {
            return Some(SessionAct::Subscribe(self.topics.filters()));
        }
        if let Some(reason) = self.leaving.take() {
            return Some(SessionAct::Leave(reason));
        }
        let act = self.next_publication(at.mono, views, lines);
        self.count_history();
        act
    }

    /// With MQTT 3.1.1 a will is published only for clients that vanish.
    fn farewell(&mut self, at: ClockMoment) -> Vec<Publication> {
        self.link.clock.see(at);
        let at_ms = millis(self.link.clock, at.mono);
        let metrics = vec![node::bdseq(self.bdseq, at_ms)];
        vec![self.death(SparkplugPayload {
            timestamp: Some(at_ms),
            metrics,
            seq: None,
        })]
    }

    fn next_notice(&mut self) -> Option<SessionNotice> {
        self.link.next_notice()
    }

    fn oversized(&self) -> &[OversizedPublication] {
        self.link.oversized.all()
    }

    /// All is born, the primary host is online if one is configured, and the path through the broker was proven recently.
    fn is_path_alive(&self, at: ClockMoment) -> bool {
        self.is_born && self.host.is_there() && self.link.path.is_alive(at.mono)
    }

    fn counters(&self) -> SparkplugCounters {
        let (attempts_lost, is_left_to_another) =
            (self.link.commands.attempts_lost(), !self.is_mine);
        let host_behind_ms = self.host.behind_ms();
        SparkplugCounters {
            attempts_lost,
            is_left_to_another,
            host_behind_ms,
            ..self.counters
        }
    }
}

impl SparkplugSession {
    fn death(&self, payload: SparkplugPayload) -> Publication {
        let qos = Qos::AtLeastOnce;
        Publication {
            qos,
            ..Publication::new(self.topics.node(MessageKind::Death), payload.bytes())
        }
    }

    fn message(&mut self, at: ClockMoment, message: &BrokerMessage<'_>) {
        match self.topics.parse(message.topic) {
            Some(SparkplugInbound::Probe) => return self.probe(at, message),
            Some(SparkplugInbound::State) => self.state(message),
            Some(SparkplugInbound::NodeCommand) => self.node_command(at, message),
            Some(SparkplugInbound::DeviceCommand(device)) => {
                self.device_command(at, device, message)
            }
            None => self.counters.ignored += 1,
        }
        self.counters.messages_in += 1;
    }

    fn state(&mut self, message: &BrokerMessage<'_>) {
        let was_behind_ms = self.host.behind_ms();
        if self.host.take(message.payload) == HostChange::Offline && self.is_known {
            self.counters.host_losses += 1;
            self.leaving = Some("the primary host is offline");
        }
        if let Some(behind_ms) = self.host.behind_ms()
            && was_behind_ms != Some(behind_ms)
        {
            self.link.notify(SessionNotice::HostBehind { behind_ms });
        }
    }

    fn probe(&mut self, at: ClockMoment, message: &BrokerMessage<'_>) {
        if message.retain
            || self.link.path.returned(at.mono, message.payload) == ReturnedProbe::Foreign
        {
            return;
        }
        let proven = self.link.path.settled();
        self.devices
            .iter_mut()
            .for_each(|device| device.history.proven(proven));
        if self.host.is_there() && self.is_born && self.link.path.is_sign_of_life(at.mono) {
            self.link.commands.path_alive();
        }
    }

    /// A host requested all births.
    pub(super) fn ask_for_rebirth(&mut self) {
        if self.is_born && self.rebirth_at.is_none() {
            self.rebirth_at = Some(self.born_at + BETWEEN_REBIRTHS);
            self.counters.rebirths += 1;
        }
    }

    fn lost(&mut self) {
        self.is_connected = false;
        self.is_born = false;
        self.is_known = false;
        self.rebirth_at = None;
        self.leaving = None;
        self.devices.iter_mut().for_each(SparkplugDevice::lost);
        self.count_history();
    }

    fn check_path(&mut self, at: MonoTime) {
        self.counters.probes_lost += u64::from(self.link.path.check(at));
    }

    /// Whether there is a host to publish to, and it can be reached.
    pub(super) fn may_publish(&self) -> bool {
        self.link.path.is_granted() && self.host.is_there()
    }

    /// Whether changes are of interest while no host is reached.
    const fn keeps(&self) -> bool {
        self.settings.keep_telemetry > 0
    }
}

/// One device per drive, with aliases that no two metrics of the edge node share.
fn devices_of(
    settings: &Settings,
    drives: &[DriveDescription],
    lines: usize,
) -> Vec<SparkplugDevice> {
    let keep = settings.keep_telemetry.div_ceil(drives.len().max(1));
    let mut alias = node::next_alias(lines);
    drives
        .iter()
        .map(|drive| {
            let device = SparkplugDevice::new(drive, alias, keep);
            alias = device.next_alias();
            device
        })
        .collect()
}
