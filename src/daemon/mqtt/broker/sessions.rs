//! Beginning, taking over and ending sessions.

use super::client_queue::DeliveryLimits;
use super::limits::{CLIENT_IDENTIFIER_MAX, IN_FLIGHT_MAX, SESSIONS_MAX};
use super::machine::{BrokerMachine, ConnectionId};
use super::packet::{
    ConnectPacket, OutgoingPacket, ProtocolFault, SessionExpiry, WillMessage, reason,
};
use super::retained::ExpiringMessage;
use super::session::{ClientSession, SessionId};
use super::topic::TopicFilter;
use crate::domain::time::MonoTime;
use crate::north::broker::MqttVersion;
use std::sync::Arc;

impl BrokerMachine {
    /// Handles CONNECT.
    pub(super) fn connect(&mut self, id: ConnectionId, connect: ConnectPacket, now: MonoTime) {
        let version = connect.version;
        let is_nameless = connect.client.is_empty();
        // 3.1.1 allows an empty identifier only if no session is kept.
        if (version == MqttVersion::V4 && is_nameless && !connect.clean_start)
            || connect.client.len() > CLIENT_IDENTIFIER_MAX
        {
            let code = if version == MqttVersion::V4 {
                2
            } else {
                reason::CLIENT_IDENTIFIER_INVALID
            };
            return self.refuse(id, version, code);
        }
        let client = if is_nameless {
            self.free_identifier()
        } else {
            connect.client.as_str().into()
        };
        let kept = self.take_over(&client, connect.clean_start, now);
        let session_present = kept.is_some();
        let session_id = kept.unwrap_or_else(|| self.begin(Arc::clone(&client), now));
        let Some(connection) = self.connections.get_mut(&id) else {
            return;
        };
        let window = usize::from(connect.receive_maximum.min(IN_FLIGHT_MAX));
        connection.taking = DeliveryLimits {
            version,
            window,
            packet_max: connect.packet_maximum,
        };
        connection.session = Some(session_id);
        connection.silence_max =
            (!connect.keep_alive.is_zero()).then(|| connect.keep_alive * 3 / 2);
        let assigned = is_nameless.then_some(&*client);
        connection.reply(&OutgoingPacket::ConnAck {
            session_present,
            code: reason::SUCCESS,
            assigned,
        });
        self.woken.insert(id);
        if let Some(session) = self.sessions.get_mut(&session_id) {
            session.connection = Some(id);
            session.expiry = connect.expiry;
            session.will = connect.will;
            session.queue.begin();
        }
    }

    /// Refuses the connection, and closes it.
    pub(super) fn refuse(&mut self, id: ConnectionId, version: MqttVersion, code: u8) {
        let Some(connection) = self.connections.get_mut(&id) else {
            return;
        };
        connection.taking.version = version;
        connection.reply(&OutgoingPacket::ConnAck {
            session_present: false,
            code,
            assigned: None,
        });
        connection.is_ending = true;
        self.woken.insert(id);
    }

    /// Handles DISCONNECT of a client.
    pub(super) fn leave(
        &mut self,
        id: ConnectionId,
        session: SessionId,
        with_will: bool,
        expiry: Option<SessionExpiry>,
        now: MonoTime,
    ) -> Result<(), ProtocolFault> {
        if let (Some(expiry), Some(session)) = (expiry, self.sessions.get_mut(&session)) {
            if session.expiry == SessionExpiry::AT_ONCE && expiry != SessionExpiry::AT_ONCE {
                return Err(ProtocolFault::protocol(
                    "a session expiry after CONNECT had none",
                ));
            }
            session.expiry = expiry;
        }
        if let Some(connection) = self.connections.get_mut(&id) {
            connection.session = None;
            connection.is_ending = true;
            self.woken.insert(id);
        }
        self.detach(session, with_will, now);
        Ok(())
    }

    /// Detaches `session` from its connection, which has ended.
    pub(super) fn detach(&mut self, session: SessionId, with_will: bool, now: MonoTime) {
        let Some(kept) = self.sessions.get_mut(&session) else {
            return;
        };
        kept.connection = None;
        kept.gone_at = now;
        kept.queue.end();
        if !with_will {
            kept.will = None;
        }
        self.let_pass(session, now);
    }

    /// Publishes due wills, and ends expired sessions.
    pub(super) fn let_sessions_pass(&mut self, now: MonoTime) {
        let away = self
            .sessions
            .iter()
            .filter(|(_, it)| it.connection.is_none());
        for session in away.map(|(id, _)| *id).collect::<Vec<_>>() {
            self.let_pass(session, now);
        }
    }

    fn let_pass(&mut self, id: SessionId, now: MonoTime) {
        let Some(session) = self.sessions.get_mut(&id) else {
            return;
        };
        let is_over = session.is_over(now);
        let will = session.take_due_will(now);
        self.publish_will(will, id, now);
        if is_over {
            self.end(id, now);
        }
    }

    /// Ends a session; its will is published without further delay.
    fn end(&mut self, id: SessionId, now: MonoTime) {
        let Some(mut session) = self.sessions.remove(&id) else {
            return;
        };
        self.clients.remove(&session.client);
        for filter in session.filters.iter().filter_map(|it| TopicFilter::new(it)) {
            self.subscriptions.remove(filter, id);
        }
        let dropped = session.queue.take_dropped();
        if dropped > 0 && self.dropped.len() < SESSIONS_MAX {
            *self.dropped.entry(Arc::clone(&session.client)).or_default() += dropped;
        }
        self.publish_will(session.will, id, now);
    }

    /// Closes another connection of `client`. Returns the session that continues.
    fn take_over(&mut self, client: &str, clean_start: bool, now: MonoTime) -> Option<SessionId> {
        let id = *self.clients.get(client)?;
        let session = self.sessions.get_mut(&id)?;
        let other = session.connection;
        let will = if clean_start {
            None
        } else {
            session.take_will_at_once()
        };
        session.connection = None;
        if let Some((other, connection)) =
            other.and_then(|it| Some((it, self.connections.get_mut(&it)?)))
        {
            connection.session = None;
            connection.dismiss(reason::TAKEN_OVER, "another connection of the same client");
            self.woken.insert(other);
            session.queue.end();
        }
        self.publish_will(will, id, now);
        if clean_start {
            self.end(id, now);
        }
        (!clean_start).then_some(id)
    }

    fn begin(&mut self, client: Arc<str>, now: MonoTime) -> SessionId {
        if self.sessions.len() >= SESSIONS_MAX {
            let away = self
                .sessions
                .iter()
                .filter(|(_, it)| it.connection.is_none());
            if let Some(oldest) = away.min_by_key(|(_, it)| it.gone_at).map(|(id, _)| *id) {
                self.end(oldest, now);
            }
        }
        self.number += 1;
        let id = SessionId(self.number);
        self.clients.insert(Arc::clone(&client), id);
        self.sessions.insert(id, ClientSession::new(client, now));
        id
    }

    fn free_identifier(&mut self) -> Arc<str> {
        loop {
            let client: Arc<str> = format!("auto-{:016x}", self.random.u64(..)).into();
            if !self.clients.contains_key(&client) {
                return client;
            }
        }
    }

    fn publish_will(&mut self, will: Option<WillMessage>, session: SessionId, now: MonoTime) {
        if let Some(WillMessage { message, .. }) = will {
            self.deliver(&ExpiringMessage::new(message, now), Some(session));
        }
    }
}
