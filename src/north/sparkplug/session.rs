//! The Sparkplug session: its life from connection to farewell, and its next act.

use super::device::{SparkplugDevice, millis};
use super::host::{HostChange, PrimaryHost};
use super::node::{self, EdgeNode};
use super::payload::{PayloadMetric, SparkplugPayload};
use super::telling::publication;
use super::topics::{MessageKind, SparkplugInbound, SparkplugTopics};
use super::types::{Settings, SparkplugAct, SparkplugCounters};
use crate::domain::ids::{AskerId, Name, Ticket};
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::north::broker::{
    BrokerCommands, BrokerEvent, BrokerLimits, BrokerMessage, BrokerPath, ClientClocks,
    OversizedPublication, OversizedTopics, Publication, Qos, ReturnedProbe, SessionLine,
};
use crate::north::clock::{ClockMoment, LabelClock};
use std::sync::Arc;
use std::time::Duration;

/// Shortest time between births on request, however many hosts ask.
const BETWEEN_REBIRTHS: Duration = Duration::from_secs(1);

/// The gateway as an edge node of Sparkplug B, each drive a device, as a machine without a socket or a clock. Its owner
/// moves things between it, the broker and the lines as with [`mqtt::Session`](crate::north::mqtt::MqttSession).
///
/// Each connection has a number, `bdSeq`, that is passed to [`connecting`](Self::connecting) before
/// [`will`](Self::will) is called.
#[derive(Debug)]
pub struct SparkplugSession {
    pub(super) settings: Settings,
    pub(super) topics: SparkplugTopics,
    pub(super) drives: Vec<DriveDescription>,
    lines: usize,
    pub(super) devices: Vec<SparkplugDevice>,
    pub(super) node: EdgeNode,
    pub(super) clock: LabelClock,
    pub(super) issued: ClientClocks,
    pub(super) path: BrokerPath,
    pub(super) host: PrimaryHost,
    pub(super) broker: BrokerLimits,
    /// What is larger than it takes.
    pub(super) oversized: OversizedTopics,
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
    pub(super) commands: BrokerCommands<()>,
    pub(super) counters: SparkplugCounters,
}

impl SparkplugSession {
    /// The session of a gateway with these drives and lines, started now. `probe_key` is random, and used by this
    /// session only: without it no peer can forge a probe.
    #[must_use]
    pub fn new(
        settings: Settings,
        drives: Vec<DriveDescription>,
        lines: &[Name],
        started: ClockMoment,
        probe_key: u128,
    ) -> Self {
        let mut session = Self {
            topics: SparkplugTopics::new(&settings),
            devices: devices_of(&settings, &drives, lines.len()),
            lines: lines.len(),
            node: EdgeNode::default(),
            clock: LabelClock::new(started),
            issued: ClientClocks::default(),
            path: BrokerPath::new(probe_key, settings.probe_interval, settings.probe_timeout),
            host: PrimaryHost::new(settings.primary_host.is_some()),
            broker: BrokerLimits::default(),
            oversized: OversizedTopics::default(),
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
            commands: BrokerCommands::new(AskerId::SPARKPLUG),
            counters: SparkplugCounters::default(),
            drives,
            settings,
        };
        session.count_history();
        session
    }

    /// Ticket numbers continue from here.
    pub const fn count_tickets_from(&mut self, first: Ticket) {
        self.commands.count_tickets_from(first);
    }

    /// The next connection has this number.
    pub const fn connecting(&mut self, bdseq: u8) {
        self.bdseq = bdseq;
    }

    /// What the broker publishes when the connection breaks: NDEATH with the number of the connection.
    #[must_use]
    pub fn will(&self) -> Publication {
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

    fn death(&self, payload: SparkplugPayload) -> Publication {
        let qos = Qos::AtLeastOnce;
        Publication {
            qos,
            ..publication(self.topics.node(MessageKind::Death), payload.bytes())
        }
    }

    /// Takes what happened on the connection.
    pub fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        self.clock.see(at);
        if !matches!(event, BrokerEvent::Stalled(_)) {
            self.path.look(at.mono);
        }
        match event {
            BrokerEvent::Connected(broker) => {
                self.lost(at.mono);
                self.broker = broker;
                self.oversized.forget();
                self.host.forget();
                self.path.connected();
                self.is_connected = true;
            }
            BrokerEvent::Subscribed(granted) => {
                let is_granted =
                    granted.len() == self.topics.filters().len() && granted.iter().all(|it| *it);
                self.path.subscribed(at.mono, is_granted);
            }
            BrokerEvent::Message(message) => self.message(at, &message),
            // Every message but a stop has to state its age itself.
            BrokerEvent::Stalled(stood) => self.path.stalled(at.mono, stood),
            BrokerEvent::Lost => self.lost(at.mono),
            // Only the last words are sent in a way that is acknowledged.
            BrokerEvent::Acknowledged(_) | BrokerEvent::Refused(..) => {}
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
        if self.host.take(message.payload) == HostChange::Offline && self.is_known {
            self.counters.host_losses += 1;
            self.leaving = Some("the primary host is offline");
        }
    }

    fn probe(&mut self, at: ClockMoment, message: &BrokerMessage<'_>) {
        if message.retain || self.path.returned(at.mono, message.payload) == ReturnedProbe::Foreign
        {
            return;
        }
        let proven = self.path.settled();
        self.devices
            .iter_mut()
            .for_each(|device| device.history.proven(proven));
        if self.host.is_there() && self.is_born && self.path.is_sign_of_life(at.mono) {
            self.commands.path_alive();
        }
    }

    /// A host requested all births.
    pub(super) fn ask_for_rebirth(&mut self) {
        if self.is_born && self.rebirth_at.is_none() {
            self.rebirth_at = Some(self.born_at + BETWEEN_REBIRTHS);
            self.counters.rebirths += 1;
        }
    }

    fn lost(&mut self, at: MonoTime) {
        self.path.lost(at);
        self.is_connected = false;
        self.is_born = false;
        self.is_known = false;
        self.rebirth_at = None;
        self.leaving = None;
        self.devices.iter_mut().for_each(SparkplugDevice::lost);
        self.commands.path_lost();
        self.count_history();
    }

    /// Replaces drives and lines: everything is born again.
    pub fn replace(&mut self, drives: Vec<DriveDescription>, lines: &[Name]) {
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
        while self.commands.take_gone(&moved).is_some() {}
        self.commands.move_drives(&moved);
        self.devices = devices;
        self.drives = drives;
        self.place = 0;
        self.is_born = false;
        self.count_history();
    }

    /// Takes the present roles of the gateway on its lines. Among several gateways the edge node is the one that is active
    /// on the first line that they share; the drives of other lines are its devices where it is active.
    fn see_roles(&mut self, lines: &[SessionLine]) {
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

    /// Whether there is to be a connection: only the edge node has one.
    #[must_use]
    pub const fn wants_connection(&self) -> bool {
        self.is_mine
    }

    /// Advances to the present.
    pub fn tick(&mut self, at: ClockMoment) {
        self.clock.see(at);
        self.check_path(at.mono);
        self.drop_overdue(at.mono);
    }

    fn check_path(&mut self, at: MonoTime) {
        self.counters.probes_lost += u64::from(self.path.check(at));
    }

    /// When [`tick`](Self::tick) and [`next_act`](Self::next_act) are to be called if no event occurs before.
    #[must_use]
    pub fn next_wake(&self) -> Option<MonoTime> {
        if !self.is_mine {
            return self.commands.wake();
        }
        // Once the host is gone, nothing is sent until the connection is left.
        let may_tell = self.may_tell();
        let path = if self.is_born && may_tell {
            self.path.wake()
        } else {
            self.path.overdue()
        };
        // Devices that are not checked would not be served.
        let looked_at = self
            .devices
            .iter()
            .filter(|device| device.is_born || !self.is_born && self.keeps());
        let devices = looked_at.filter_map(SparkplugDevice::wake).min();
        let rebirth = if may_tell { self.rebirth_at } else { None };
        [path, rebirth, self.commands.wake(), devices]
            .into_iter()
            .flatten()
            .min()
    }

    /// Whether there is a host to publish to, and it can be reached.
    pub(super) fn may_tell(&self) -> bool {
        self.path.is_granted() && self.host.is_there()
    }

    /// Whether changes are of interest while no host is reached.
    const fn keeps(&self) -> bool {
        self.settings.keep_telemetry > 0
    }

    /// The next item for the lines, and after them attempts to be kept. It needs no room on the connection.
    pub fn next_inward(&mut self) -> Option<SparkplugAct> {
        let to_line = self.commands.next_to_line().map(SparkplugAct::ToLine);
        to_line.or_else(|| {
            self.commands
                .next_attempt()
                .map(|(drive, attempt)| SparkplugAct::Keep(drive, attempt))
        })
    }

    /// The next act. `views` are in the order of the drives, `lines` in the order of the lines.
    pub fn next_act(
        &mut self,
        at: ClockMoment,
        views: &[Arc<DriveView>],
        lines: &[SessionLine],
    ) -> Option<SparkplugAct> {
        if let Some(act) = self.next_inward() {
            return Some(act);
        }
        self.clock.see(at);
        self.see_roles(lines);
        if !self.is_mine {
            return std::mem::take(&mut self.is_connected)
                .then_some(SparkplugAct::Leave("on standby: another gateway is active"));
        }
        self.check_path(at.mono);
        if let Some(reason) = self.path.take_reconnect() {
            return Some(SparkplugAct::Reconnect(reason));
        }
        if self.path.take_subscription(at.mono) {
            return Some(SparkplugAct::Subscribe(self.topics.filters()));
        }
        if let Some(reason) = self.leaving.take() {
            return Some(SparkplugAct::Leave(reason));
        }
        let act = self.next_publication(at.mono, views, lines);
        self.count_history();
        act
    }

    /// What is still to be published on an orderly end: with MQTT 3.1.1 a will is published only for clients that
    /// vanish.
    pub fn farewell(&mut self, at: ClockMoment) -> Vec<Publication> {
        self.clock.see(at);
        let at_ms = millis(self.clock, at.mono);
        let metrics = vec![node::bdseq(self.bdseq, at_ms)];
        vec![self.death(SparkplugPayload {
            timestamp: Some(at_ms),
            metrics,
            seq: None,
        })]
    }

    /// Whether a host can command: all is born, the primary host is online if one is configured, and the path through
    /// the broker was proven recently.
    #[must_use]
    pub fn is_path_alive(&self, at: ClockMoment) -> bool {
        self.is_born && self.host.is_there() && self.path.is_alive(at.mono)
    }

    /// Whether the primary host is online; `None` if none is configured.
    #[must_use]
    pub fn is_host_online(&self) -> Option<bool> {
        self.settings
            .primary_host
            .is_some()
            .then(|| self.host.is_there())
    }

    /// What is not published because it is larger than the broker takes.
    #[must_use]
    pub fn oversized(&self) -> &[OversizedPublication] {
        self.oversized.all()
    }

    /// A publication larger than the broker takes that was not reported yet; each is returned once.
    pub fn next_oversized(&mut self) -> Option<OversizedPublication> {
        self.oversized.next_untold()
    }

    /// The counters so far.
    #[must_use]
    pub const fn counters(&self) -> SparkplugCounters {
        let (attempts_lost, is_left_to_another) = (self.commands.attempts_lost(), !self.is_mine);
        let host_behind_ms = self.host.behind_ms();
        SparkplugCounters {
            attempts_lost,
            is_left_to_another,
            host_behind_ms,
            ..self.counters
        }
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
