//! Messages to one client: those that wait, those that it has not acknowledged, and retained ones that it requested.

use super::encode;
use super::limits::{IN_FLIGHT_MAX, WAITING_BYTES_MAX, WAITING_MAX};
use super::packet::{OutgoingPacket, PacketQos, SubscriptionOptions, reason};
use super::retained::{ExpiringMessage, RetainedMessages};
use crate::domain::time::MonoTime;
use crate::north::broker::MqttVersion;
use std::collections::VecDeque;
use std::sync::Arc;

/// A message for one client.
#[derive(Clone, Debug)]
pub struct ClientDelivery {
    pub post: ExpiringMessage,
    pub qos: PacketQos,
    pub retain: bool,
    pub identifiers: Vec<u32>,
}

/// What a connection accepts.
#[derive(Clone, Copy, Debug)]
pub struct DeliveryLimits {
    pub version: MqttVersion,
    /// Messages that may wait for an acknowledgement.
    pub window: usize,
    /// The longest packet.
    pub packet_max: usize,
}

/// All messages to one client.
#[derive(Debug, Default)]
pub struct ClientQueue {
    waiting: VecDeque<ClientDelivery>,
    /// Size of the waiting messages, in bytes.
    bytes: usize,
    /// Number of waiting messages at quality of service 0.
    passing: usize,
    in_flight: VecDeque<InFlightDelivery>,
    asked: VecDeque<RetainedBatch>,
    last_id: u16,
    dropped: u64,
}

#[derive(Debug)]
struct InFlightDelivery {
    id: u16,
    stage: DeliveryStage,
    /// Whether it was sent on this connection.
    is_sent: bool,
}

#[derive(Debug)]
enum DeliveryStage {
    Published(ClientDelivery),
    /// The client has received it, but has not sent PUBCOMP yet.
    Released,
}

/// Retained messages that a subscription wants, one after the other.
#[derive(Debug)]
struct RetainedBatch {
    filter: String,
    options: SubscriptionOptions,
    after: Option<Arc<str>>,
    /// Messages that are retained later are delivered live.
    number: u64,
}

impl ClientQueue {
    /// Adds a message. If there is no room, the oldest at quality of service 0 is dropped, or else this one.
    pub fn add(&mut self, delivery: ClientDelivery) {
        let weight = delivery.post.message.weight();
        while self.waiting.len() >= WAITING_MAX || self.bytes + weight > WAITING_BYTES_MAX {
            self.dropped += 1;
            let oldest = if self.passing == 0 {
                None
            } else {
                self.waiting.iter().position(is_passing)
            };
            let Some(oldest) = oldest.and_then(|at| self.waiting.remove(at)) else {
                return;
            };
            self.count_out(&oldest);
        }
        self.bytes += weight;
        self.passing += usize::from(is_passing(&delivery));
        self.waiting.push_back(delivery);
    }

    /// Sends what is retained for `filter` now, before what waits.
    pub fn ask(&mut self, filter: &str, options: SubscriptionOptions, retained: &RetainedMessages) {
        self.forget(filter);
        let number = retained.number();
        self.asked.push_back(RetainedBatch {
            filter: filter.to_owned(),
            options,
            after: None,
            number,
        });
    }

    /// Removes a subscription.
    pub fn forget(&mut self, filter: &str) {
        self.asked.retain(|it| it.filter != filter);
    }

    /// Begins a connection: what was not acknowledged is sent again.
    pub fn begin(&mut self) {
        self.in_flight.iter_mut().for_each(|it| it.is_sent = false);
    }

    /// Ends a connection: messages at quality of service 0 are dropped.
    pub fn end(&mut self) {
        let gone: Vec<ClientDelivery> = self
            .waiting
            .iter()
            .filter(|it| is_passing(it))
            .cloned()
            .collect();
        gone.iter().for_each(|it| self.count_out(it));
        self.waiting.retain(|it| !is_passing(it));
    }

    /// How many messages were dropped since the last call.
    pub const fn take_dropped(&mut self) -> u64 {
        std::mem::replace(&mut self.dropped, 0)
    }

    /// Handles an acknowledgement at quality of service 1.
    pub fn acked(&mut self, id: u16) {
        self.in_flight
            .retain(|it| it.id != id || it.qos() != Some(PacketQos::AtLeastOnce));
    }

    /// Handles PUBREC: the client has the message, or refuses it. Returns the reason to answer with.
    pub fn received(&mut self, id: u16, is_taken: bool) -> Option<u8> {
        let is_it = |it: &InFlightDelivery| it.id == id && it.qos() != Some(PacketQos::AtLeastOnce);
        let Some(at) = self.in_flight.iter().position(is_it) else {
            return Some(reason::IDENTIFIER_NOT_FOUND);
        };
        if !is_taken {
            self.in_flight.remove(at);
            return None;
        }
        self.in_flight[at].stage = DeliveryStage::Released;
        self.in_flight[at].is_sent = true;
        Some(reason::SUCCESS)
    }

    /// Handles PUBCOMP, the end of a message at quality of service 2.
    pub fn completed(&mut self, id: u16) {
        self.in_flight
            .retain(|it| it.id != id || it.qos().is_some());
    }

    /// Appends the next packet to `out`; returns false if there is none now.
    pub fn next(
        &mut self,
        taking: DeliveryLimits,
        retained: &RetainedMessages,
        now: MonoTime,
        out: &mut Vec<u8>,
    ) -> bool {
        let sent = self.in_flight.iter().filter(|it| it.is_sent).count();
        if sent < taking.window
            && let Some(again) = self.in_flight.iter_mut().find(|it| !it.is_sent)
        {
            again.write(taking, now, out);
            return true;
        }
        let window = taking.window.min(usize::from(IN_FLIGHT_MAX));
        while let Some(delivery) = self.take(self.in_flight.len() < window, retained, now) {
            if delivery.post.is_expired(now) {
                continue;
            }
            let before = out.len();
            let id = self.free_id();
            write(&delivery, id, false, taking.version, now, out);
            if out.len() - before > taking.packet_max {
                out.truncate(before);
                self.dropped += 1;
                continue;
            }
            if delivery.qos != PacketQos::AtMostOnce {
                self.last_id = id;
                self.in_flight.push_back(InFlightDelivery {
                    id,
                    stage: DeliveryStage::Published(delivery),
                    is_sent: true,
                });
            }
            return true;
        }
        false
    }

    /// The next message that may be sent: above quality of service 0 only if `has_room`.
    fn take(
        &mut self,
        has_room: bool,
        retained: &RetainedMessages,
        now: MonoTime,
    ) -> Option<ClientDelivery> {
        while let Some(asked) = self.asked.front_mut() {
            let Some(post) = retained.next(&asked.filter, asked.after.as_ref(), asked.number, now)
            else {
                self.asked.pop_front();
                continue;
            };
            let qos = post.message.qos.min(asked.options.qos);
            if qos != PacketQos::AtMostOnce && !has_room {
                return None;
            }
            asked.after = Some(Arc::clone(&post.message.topic));
            let identifiers = asked.options.identifier.into_iter().collect();
            return Some(ClientDelivery {
                post: post.clone(),
                qos,
                retain: true,
                identifiers,
            });
        }
        let delivery = self.waiting.pop_front_if(|it| has_room || is_passing(it))?;
        self.count_out(&delivery);
        Some(delivery)
    }

    fn count_out(&mut self, delivery: &ClientDelivery) {
        self.bytes -= delivery.post.message.weight();
        self.passing -= usize::from(is_passing(delivery));
    }

    /// An unused packet identifier; there are more identifiers than messages in flight.
    fn free_id(&self) -> u16 {
        let mut id = self.last_id;
        loop {
            id = id.checked_add(1).unwrap_or(1);
            if self.in_flight.iter().all(|it| it.id != id) {
                return id;
            }
        }
    }
}

impl InFlightDelivery {
    /// The quality of service of a message that waits for its first acknowledgement.
    const fn qos(&self) -> Option<PacketQos> {
        match &self.stage {
            DeliveryStage::Published(delivery) => Some(delivery.qos),
            DeliveryStage::Released => None,
        }
    }

    /// Writes it again, on another connection.
    fn write(&mut self, taking: DeliveryLimits, now: MonoTime, out: &mut Vec<u8>) {
        self.is_sent = true;
        match &self.stage {
            DeliveryStage::Published(delivery) => {
                write(delivery, self.id, true, taking.version, now, out)
            }
            DeliveryStage::Released => encode::packet(
                &OutgoingPacket::Released(self.id, reason::SUCCESS),
                taking.version,
                out,
            ),
        }
    }
}

fn is_passing(delivery: &ClientDelivery) -> bool {
    delivery.qos == PacketQos::AtMostOnce
}

fn write(
    delivery: &ClientDelivery,
    id: u16,
    is_repeat: bool,
    version: MqttVersion,
    now: MonoTime,
    out: &mut Vec<u8>,
) {
    let ClientDelivery {
        post,
        qos,
        retain,
        identifiers,
    } = delivery;
    let packet_id = (*qos != PacketQos::AtMostOnce).then_some((id, is_repeat));
    let message = &*post.message;
    let expiry = post.seconds_left(now);
    let packet = OutgoingPacket::Publish {
        message,
        qos: *qos,
        retain: *retain,
        packet_id,
        expiry,
        identifiers,
    };
    encode::packet(&packet, version, out);
}
