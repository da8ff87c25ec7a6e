//! Subscriptions, and the delivery of messages to them.

use super::client_queue::ClientDelivery;
use super::limits::SUBSCRIPTIONS_MAX;
use super::machine::{BrokerMachine, ConnectionId};
use super::packet::{
    OutgoingPacket, PacketQos, RetainHandling, SubscriptionOptions, WantedFilter, reason,
};
use super::retained::ExpiringMessage;
use super::session::{ClientSession, SessionId};
use super::topic::TopicFilter;
use super::tree::{Members, MessageTaker};
use crate::north::broker::MqttVersion;
use std::collections::BTreeMap;

impl BrokerMachine {
    pub(super) fn subscribe(
        &mut self,
        id: ConnectionId,
        session: SessionId,
        packet_id: u16,
        wanted: &[WantedFilter],
    ) {
        let Some(connection) = self.connections.get(&id) else {
            return;
        };
        let version = connection.taking.version;
        let codes: Vec<u8> = wanted
            .iter()
            .map(|it| self.subscribe_one(session, it))
            .collect();
        // 3.1.1 has a single code to refuse.
        let said = |code: u8| {
            if version == MqttVersion::V4 {
                code.min(reason::REFUSED)
            } else {
                code
            }
        };
        let codes: Vec<u8> = codes.into_iter().map(said).collect();
        self.reply(id, &OutgoingPacket::SubAck(packet_id, &codes));
    }

    fn subscribe_one(&mut self, id: SessionId, wanted: &WantedFilter) -> u8 {
        let Some(filter) = TopicFilter::new(&wanted.filter) else {
            return reason::FILTER_INVALID;
        };
        let Some(session) = self.sessions.get_mut(&id) else {
            return reason::REFUSED;
        };
        if session.filters.len() >= SUBSCRIPTIONS_MAX && !session.filters.contains(&wanted.filter) {
            return reason::QUOTA_EXCEEDED;
        }
        session.filters.insert(wanted.filter.clone());
        let is_new = self.subscriptions.insert(filter, id, wanted.options);
        let wants_retained = match wanted.retained {
            RetainHandling::Always => true,
            RetainHandling::IfNew => is_new,
            RetainHandling::Never => false,
        };
        if wants_retained && filter.group.is_none() {
            session
                .queue
                .ask(&wanted.filter, wanted.options, &self.retained);
        }
        wanted.options.qos as u8
    }

    pub(super) fn unsubscribe(
        &mut self,
        id: ConnectionId,
        session: SessionId,
        packet_id: u16,
        filters: &[String],
    ) {
        let codes: Vec<u8> = filters
            .iter()
            .map(|it| self.unsubscribe_one(session, it))
            .collect();
        self.reply(id, &OutgoingPacket::UnsubAck(packet_id, &codes));
    }

    fn unsubscribe_one(&mut self, id: SessionId, text: &str) -> u8 {
        let Some(filter) = TopicFilter::new(text) else {
            return reason::FILTER_INVALID;
        };
        if let Some(session) = self.sessions.get_mut(&id) {
            session.filters.remove(text);
            session.queue.forget(text);
        }
        if self.subscriptions.remove(filter, id) {
            reason::SUCCESS
        } else {
            reason::NO_SUBSCRIPTION_EXISTED
        }
    }

    /// Retains `post` if requested, and delivers it to all subscribers. `from` has published it.
    pub(super) fn deliver(&mut self, post: &ExpiringMessage, from: Option<SessionId>) {
        if post.message.retain && !self.retained.set(post) {
            self.not_kept += 1;
        }
        let mut once = BTreeMap::new();
        let mut shared = Vec::new();
        for taker in self.subscriptions.takers(&post.message.topic) {
            match taker {
                MessageTaker::Each(members) => {
                    for (session, options) in members {
                        if !(options.no_local && from == Some(*session)) {
                            merge(
                                once.entry(*session).or_insert_with(|| none_of(post)),
                                *options,
                            );
                        }
                    }
                }
                MessageTaker::OneOf(members) => {
                    self.turn = self.turn.wrapping_add(1);
                    if let Some((session, options)) = one_of(members, &self.sessions, self.turn) {
                        let mut delivery = none_of(post);
                        merge(&mut delivery, options);
                        shared.push((session, delivery));
                    }
                }
            }
        }
        for (id, delivery) in once.into_iter().chain(shared) {
            let Some(session) = self.sessions.get_mut(&id) else {
                continue;
            };
            // Messages at quality of service 0 do not wait for a client without a connection.
            if session.connection.is_some() || delivery.qos != PacketQos::AtMostOnce {
                session.queue.add(delivery);
                self.woken.extend(session.connection);
            }
        }
    }
}

fn none_of(post: &ExpiringMessage) -> ClientDelivery {
    ClientDelivery {
        post: post.clone(),
        qos: PacketQos::AtMostOnce,
        retain: false,
        identifiers: Vec::new(),
    }
}

/// Merges the options of one more subscription into a message, which a client gets once however many of its filters
/// match.
fn merge(delivery: &mut ClientDelivery, options: SubscriptionOptions) {
    delivery.qos = delivery.qos.max(options.qos.min(delivery.post.message.qos));
    delivery.retain |= options.as_published && delivery.post.message.retain;
    delivery.identifiers.extend(options.identifier);
}

/// The next member; one without a connection only if none has one.
fn one_of(
    members: &Members,
    sessions: &BTreeMap<SessionId, ClientSession>,
    turn: usize,
) -> Option<(SessionId, SubscriptionOptions)> {
    let is_here = |id: &SessionId| sessions.get(id).is_some_and(|it| it.connection.is_some());
    let here = members.iter().filter(|(id, _)| is_here(id));
    let here: Vec<(SessionId, SubscriptionOptions)> =
        here.map(|(id, options)| (*id, *options)).collect();
    let all = || {
        members
            .iter()
            .map(|(id, options)| (*id, *options))
            .collect()
    };
    let those: Vec<(SessionId, SubscriptionOptions)> = if here.is_empty() { all() } else { here };
    those.get(turn.checked_rem(those.len())?).copied()
}
