//! The broker without sockets and clocks: it takes packets and the time, and returns what is to be sent.

use super::client_queue::DeliveryLimits;
use super::decode;
use super::encode;
use super::limits::{
    CONNECTIONS_MAX, IN_FLIGHT_MAX, INCOMING_MAX, PACKET_MAX, RETAINED_BYTES_MAX, RETAINED_MAX,
};
use super::packet::{
    ConnectRefusal, IncomingPacket, OutgoingPacket, PacketQos, ProtocolFault, reason,
};
use super::retained::{ExpiringMessage, RetainedMessages};
use super::session::{ClientSession, SessionId};
use super::tree::SubscriptionTree;
use crate::domain::time::MonoTime;
use crate::north::broker::MqttVersion;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::time::Duration;

/// Time for a client to send CONNECT.
const CONNECT_WITHIN: Duration = Duration::from_secs(10);
/// How often expired retained messages are removed.
const SWEEP: Duration = Duration::from_secs(10);
/// If a tick is this late, the process was suspended, and what clients sent waits in their sockets.
const STALL: Duration = Duration::from_secs(2);
/// Approximate number of bytes that are handed over at once.
const HANDED_OVER: usize = 64 * 1024;
/// A DISCONNECT with a reason string is shorter than this.
const FAREWELL_MAX: usize = 128;
/// Unread answers to a client beyond which reading from it pauses, in bytes.
const REPLIES_MAX: usize = 64 * 1024;

/// The number of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ConnectionId(u64);

/// The broker.
#[derive(Debug)]
pub struct BrokerMachine {
    pub(super) connections: BTreeMap<ConnectionId, BrokerConnection>,
    pub(super) sessions: BTreeMap<SessionId, ClientSession>,
    pub(super) clients: HashMap<Arc<str>, SessionId>,
    pub(super) subscriptions: SubscriptionTree,
    pub(super) retained: RetainedMessages,
    /// Connections that have bytes to send or are to be closed.
    pub(super) woken: BTreeSet<ConnectionId>,
    /// Dropped messages of sessions that have ended, by client.
    pub(super) dropped: BTreeMap<Arc<str>, u64>,
    /// Retained messages for which there was no room.
    pub(super) not_kept: u64,
    pub(super) random: fastrand::Rng,
    /// Counts connections and sessions.
    pub(super) number: u64,
    /// The next member of shared subscriptions.
    pub(super) turn: usize,
    ticked: MonoTime,
    swept: MonoTime,
}

/// One connection.
#[derive(Debug)]
pub(super) struct BrokerConnection {
    /// What it accepts; known from CONNECT on.
    pub taking: DeliveryLimits,
    pub session: Option<SessionId>,
    /// The silence after which it is closed.
    pub silence_max: Option<Duration>,
    heard: MonoTime,
    /// Answers that wait for the socket.
    pub replies: Vec<u8>,
    /// The connection is closed once those are sent.
    pub is_ending: bool,
}

impl BrokerConnection {
    /// Messages at quality of service 2 that it may leave unreleased. 3.1.1 cannot announce a limit.
    fn incoming_max(&self) -> usize {
        if self.taking.version == MqttVersion::V4 {
            INCOMING_MAX
        } else {
            usize::from(IN_FLIGHT_MAX)
        }
    }

    /// Sends DISCONNECT, after which the connection is closed.
    pub fn dismiss(&mut self, reason: u8, why: &'static str) {
        let why = if self.taking.packet_max < FAREWELL_MAX {
            ""
        } else {
            why
        };
        self.reply(&OutgoingPacket::Disconnect(reason, why));
        self.is_ending = true;
    }

    pub fn reply(&mut self, packet: &OutgoingPacket<'_>) {
        encode::packet(packet, self.taking.version, &mut self.replies);
    }
}

/// Messages that were dropped since the last report.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct DroppedReport {
    /// Clients, and how many messages for them were dropped.
    pub dropped: BTreeMap<Arc<str>, u64>,
    /// Retained messages that were not kept.
    pub not_kept: u64,
}

impl BrokerMachine {
    /// A broker that starts at `now`; identifiers of clients without one are made from `seed`.
    pub fn new(seed: u64, now: MonoTime) -> Self {
        Self {
            connections: BTreeMap::new(),
            sessions: BTreeMap::new(),
            clients: HashMap::new(),
            subscriptions: SubscriptionTree::default(),
            retained: RetainedMessages::new(RETAINED_MAX, RETAINED_BYTES_MAX),
            woken: BTreeSet::new(),
            dropped: BTreeMap::new(),
            not_kept: 0,
            random: fastrand::Rng::with_seed(seed),
            number: 0,
            turn: 0,
            ticked: now,
            swept: now,
        }
    }

    /// Opens a connection; `None` if there are too many.
    pub fn open(&mut self, now: MonoTime) -> Option<ConnectionId> {
        if self.connections.len() >= CONNECTIONS_MAX {
            return None;
        }
        self.number += 1;
        let id = ConnectionId(self.number);
        let taking = DeliveryLimits {
            version: MqttVersion::V4,
            window: usize::from(IN_FLIGHT_MAX),
            packet_max: PACKET_MAX as usize,
        };
        let connection = BrokerConnection {
            taking,
            session: None,
            silence_max: Some(CONNECT_WITHIN),
            heard: now,
            replies: Vec::new(),
            is_ending: false,
        };
        self.connections.insert(id, connection);
        Some(id)
    }

    /// Processes a complete packet.
    ///
    /// # Errors
    /// Why the connection is closed. That is done already; the reason is for the log.
    pub fn received(
        &mut self,
        id: ConnectionId,
        first: u8,
        body: &[u8],
        now: MonoTime,
    ) -> Result<(), ProtocolFault> {
        let Some(connection) = self.connections.get_mut(&id).filter(|it| !it.is_ending) else {
            return Ok(());
        };
        connection.heard = now;
        let version = connection.taking.version;
        let Some(session) = connection.session else {
            return self.received_first(id, first, body, now);
        };
        let done = decode::packet(first, body, version)
            .and_then(|packet| self.handle(id, session, packet, now));
        if let Err(fault) = done {
            self.fail(id, fault, now);
        }
        done
    }

    /// Handles bytes that are not a packet.
    pub fn fail(&mut self, id: ConnectionId, fault: ProtocolFault, now: MonoTime) {
        let Some(connection) = self.connections.get_mut(&id).filter(|it| !it.is_ending) else {
            return;
        };
        connection.is_ending = true;
        self.woken.insert(id);
        if let Some(session) = connection.session.take() {
            connection.dismiss(fault.reason, fault.why);
            self.detach(session, true, now);
        }
    }

    /// Handles the closing of the socket.
    pub fn closed(&mut self, id: ConnectionId, now: MonoTime) {
        if let Some(session) = self.connections.remove(&id).and_then(|it| it.session) {
            self.detach(session, true, now);
        }
    }

    /// Appends bytes to be sent to `out`, up to a limit; the next call returns more.
    pub fn hand_over(&mut self, id: ConnectionId, now: MonoTime, out: &mut Vec<u8>) {
        let Some(connection) = self.connections.get_mut(&id) else {
            return;
        };
        out.append(&mut connection.replies);
        let Some(session) = connection.session.and_then(|it| self.sessions.get_mut(&it)) else {
            return;
        };
        while out.len() < HANDED_OVER
            && session
                .queue
                .next(connection.taking, &self.retained, now, out)
        {}
    }

    /// Whether the connection is to be closed, once all is sent.
    pub fn is_ending(&self, id: ConnectionId) -> bool {
        self.connections.get(&id).is_none_or(|it| it.is_ending)
    }

    /// Whether more may be read from it: a client that does not read its answers has to wait.
    pub fn may_say_more(&self, id: ConnectionId) -> bool {
        self.connections
            .get(&id)
            .is_some_and(|it| it.replies.len() < REPLIES_MAX)
    }

    /// Handles timeouts: silent clients, due wills and expired sessions.
    pub fn tick(&mut self, now: MonoTime) {
        if now.since(std::mem::replace(&mut self.ticked, now)) >= STALL {
            self.connections.values_mut().for_each(|it| it.heard = now);
        }
        let is_silent =
            |it: &BrokerConnection| it.silence_max.is_some_and(|max| now.since(it.heard) >= max);
        let silent = self
            .connections
            .iter()
            .filter(|(_, it)| is_silent(it))
            .map(|(id, _)| *id);
        for id in silent.collect::<Vec<_>>() {
            self.fail(
                id,
                ProtocolFault {
                    reason: reason::KEEP_ALIVE_TIMEOUT,
                    why: "silence",
                },
                now,
            );
        }
        self.let_sessions_pass(now);
        if now.since(self.swept) >= SWEEP {
            self.swept = now;
            self.retained.sweep(now);
        }
    }

    /// Connections that have bytes to send or are to be closed.
    pub fn take_woken(&mut self) -> BTreeSet<ConnectionId> {
        std::mem::take(&mut self.woken)
    }

    /// What was dropped since the last report.
    pub fn take_report(&mut self) -> DroppedReport {
        let mut dropped = std::mem::take(&mut self.dropped);
        for session in self.sessions.values_mut() {
            let count = session.queue.take_dropped();
            if count > 0 {
                *dropped.entry(Arc::clone(&session.client)).or_default() += count;
            }
        }
        DroppedReport {
            dropped,
            not_kept: std::mem::take(&mut self.not_kept),
        }
    }

    fn received_first(
        &mut self,
        id: ConnectionId,
        first: u8,
        body: &[u8],
        now: MonoTime,
    ) -> Result<(), ProtocolFault> {
        match decode::connect(first, body, PACKET_MAX as usize) {
            Ok(connect) => {
                self.connect(id, connect, now);
                Ok(())
            }
            Err(ConnectRefusal::Silent(fault)) => {
                self.fail(id, fault, now);
                Err(fault)
            }
            Err(ConnectRefusal::Said(version, code)) => {
                self.refuse(id, version, code);
                Err(ProtocolFault {
                    reason: code,
                    why: "a connection that is refused",
                })
            }
        }
    }

    fn handle(
        &mut self,
        id: ConnectionId,
        session: SessionId,
        packet: IncomingPacket,
        now: MonoTime,
    ) -> Result<(), ProtocolFault> {
        match packet {
            IncomingPacket::Publish { message, packet_id } => {
                let qos = message.qos;
                let post = ExpiringMessage::new(message, now);
                return self.published(id, session, qos, packet_id, &post);
            }
            IncomingPacket::Subscribe { packet_id, wanted } => {
                self.subscribe(id, session, packet_id, &wanted)
            }
            IncomingPacket::Unsubscribe { packet_id, filters } => {
                self.unsubscribe(id, session, packet_id, &filters)
            }
            IncomingPacket::Ping => self.reply(id, &OutgoingPacket::Pong),
            IncomingPacket::Disconnect { with_will, expiry } => {
                return self.leave(id, session, with_will, expiry, now);
            }
            IncomingPacket::Released(packet_id) => {
                let was_there = self
                    .sessions
                    .get_mut(&session)
                    .is_some_and(|it| it.incoming.remove(&packet_id));
                let code = if was_there {
                    reason::SUCCESS
                } else {
                    reason::IDENTIFIER_NOT_FOUND
                };
                self.reply(id, &OutgoingPacket::Completed(packet_id, code));
            }
            IncomingPacket::Acked(packet_id) => self.queue(session, |queue| queue.acked(packet_id)),
            IncomingPacket::Completed(packet_id) => {
                self.queue(session, |queue| queue.completed(packet_id))
            }
            IncomingPacket::Received {
                packet_id,
                is_taken,
            } => {
                let mut answer = None;
                self.queue(session, |queue| {
                    answer = queue.received(packet_id, is_taken)
                });
                if let Some(code) = answer {
                    self.reply(id, &OutgoingPacket::Released(packet_id, code));
                }
            }
        }
        Ok(())
    }

    /// Handles a message of a client: it is acknowledged, and delivered once.
    fn published(
        &mut self,
        id: ConnectionId,
        session: SessionId,
        qos: PacketQos,
        packet_id: Option<u16>,
        post: &ExpiringMessage,
    ) -> Result<(), ProtocolFault> {
        match (qos, packet_id) {
            (PacketQos::ExactlyOnce, Some(packet_id)) => {
                let Some(incoming) = self.sessions.get_mut(&session).map(|it| &mut it.incoming)
                else {
                    return Ok(());
                };
                let is_new = incoming.insert(packet_id);
                if incoming.len()
                    > self
                        .connections
                        .get(&id)
                        .map_or(0, BrokerConnection::incoming_max)
                {
                    let why = "receive maximum exceeded";
                    return Err(ProtocolFault {
                        reason: reason::RECEIVE_MAXIMUM_EXCEEDED,
                        why,
                    });
                }
                self.reply(id, &OutgoingPacket::Received(packet_id));
                if is_new {
                    self.deliver(post, Some(session));
                }
            }
            (PacketQos::AtLeastOnce, Some(packet_id)) => {
                self.reply(id, &OutgoingPacket::Acked(packet_id));
                self.deliver(post, Some(session));
            }
            _ => self.deliver(post, Some(session)),
        }
        Ok(())
    }

    pub(super) fn reply(&mut self, id: ConnectionId, packet: &OutgoingPacket<'_>) {
        if let Some(connection) = self.connections.get_mut(&id) {
            connection.reply(packet);
            self.woken.insert(id);
        }
    }

    fn queue(
        &mut self,
        session: SessionId,
        change: impl FnOnce(&mut super::client_queue::ClientQueue),
    ) {
        if let Some(session) = self.sessions.get_mut(&session) {
            change(&mut session.queue);
            self.woken.extend(session.connection);
        }
    }
}
