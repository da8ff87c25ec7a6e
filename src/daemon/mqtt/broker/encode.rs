//! Encodes packets of the broker.

use super::limits::{IN_FLIGHT_MAX, PACKET_MAX};
use super::packet::{OutgoingPacket, PacketQos, PublishedMessage, reason};
use super::properties;
use crate::north::broker::MqttVersion;

/// Appends `packet` to `out`.
pub fn packet(packet: &OutgoingPacket<'_>, version: MqttVersion, out: &mut Vec<u8>) {
    match packet {
        OutgoingPacket::ConnAck {
            session_present,
            code,
            assigned,
        } => {
            conn_ack(*session_present, *code, *assigned, version, out);
        }
        OutgoingPacket::Publish {
            message,
            qos,
            retain,
            packet_id,
            expiry,
            identifiers,
        } => {
            let is_repeat = packet_id.is_some_and(|(_, is_repeat)| is_repeat);
            let flags = u8::from(is_repeat) << 3 | (*qos as u8) << 1 | u8::from(*retain);
            let head = publish_head(
                message,
                *qos,
                packet_id.map(|it| it.0),
                *expiry,
                identifiers,
                version,
            );
            frame(0x30 | flags, &[&head, &message.payload], out);
        }
        OutgoingPacket::Acked(id) => ack(0x40, *id, reason::SUCCESS, version, out),
        OutgoingPacket::Received(id) => ack(0x50, *id, reason::SUCCESS, version, out),
        OutgoingPacket::Released(id, code) => ack(0x62, *id, *code, version, out),
        OutgoingPacket::Completed(id, code) => ack(0x70, *id, *code, version, out),
        OutgoingPacket::SubAck(id, codes) => {
            frame(0x90, &[&id.to_be_bytes(), none(version), codes], out)
        }
        // 3.1.1 has no codes here.
        OutgoingPacket::UnsubAck(id, _) if version == MqttVersion::V4 => {
            frame(0xB0, &[&id.to_be_bytes()], out)
        }
        OutgoingPacket::UnsubAck(id, codes) => frame(0xB0, &[&id.to_be_bytes(), &[0], codes], out),
        OutgoingPacket::Pong => frame(0xD0, &[], out),
        // In 3.1.1 a broker only closes the connection.
        OutgoingPacket::Disconnect(..) if version == MqttVersion::V4 => {}
        OutgoingPacket::Disconnect(code, why) => disconnect(*code, why, out),
    }
}

/// No properties.
const fn none(version: MqttVersion) -> &'static [u8] {
    match version {
        MqttVersion::V4 => &[],
        MqttVersion::V5 => &[0],
    }
}

fn conn_ack(
    session_present: bool,
    code: u8,
    assigned: Option<&str>,
    version: MqttVersion,
    out: &mut Vec<u8>,
) {
    let head = [u8::from(session_present), code];
    if version == MqttVersion::V4 {
        return frame(0x20, &[&head], out);
    }
    let mut list = Vec::new();
    if code == reason::SUCCESS {
        list.push(properties::RECEIVE_MAXIMUM);
        list.extend(IN_FLIGHT_MAX.to_be_bytes());
        list.push(properties::PACKET_MAXIMUM);
        list.extend(PACKET_MAX.to_be_bytes());
    }
    if let Some(client) = assigned {
        list.push(properties::ASSIGNED_CLIENT_IDENTIFIER);
        text(client, &mut list);
    }
    let mut length = Vec::new();
    variable(list.len(), &mut length);
    frame(0x20, &[&head, &length, &list], out);
}

/// All of PUBLISH up to its payload.
fn publish_head(
    message: &PublishedMessage,
    qos: PacketQos,
    packet_id: Option<u16>,
    expiry: Option<u32>,
    identifiers: &[u32],
    version: MqttVersion,
) -> Vec<u8> {
    let mut head = Vec::with_capacity(message.topic.len() + message.properties.len() + 32);
    text(&message.topic, &mut head);
    if qos != PacketQos::AtMostOnce {
        head.extend(packet_id.unwrap_or_default().to_be_bytes());
    }
    if version == MqttVersion::V4 {
        return head;
    }
    let mut list = Vec::new();
    if let Some(seconds) = expiry {
        list.push(properties::MESSAGE_EXPIRY);
        list.extend(seconds.to_be_bytes());
    }
    for identifier in identifiers {
        list.push(properties::SUBSCRIPTION_IDENTIFIER);
        variable(*identifier as usize, &mut list);
    }
    variable(list.len() + message.properties.len(), &mut head);
    head.extend(list);
    head.extend(&message.properties);
    head
}

/// The empty property length could be omitted, but not every client accepts that.
fn disconnect(code: u8, why: &str, out: &mut Vec<u8>) {
    let mut list = Vec::new();
    if !why.is_empty() {
        list.push(properties::REASON_STRING);
        text(why, &mut list);
    }
    let mut length = Vec::new();
    variable(list.len(), &mut length);
    frame(0xE0, &[&[code], &length, &list], out);
}

fn ack(first: u8, id: u16, code: u8, version: MqttVersion, out: &mut Vec<u8>) {
    let code: &[u8] = if version == MqttVersion::V4 || code == reason::SUCCESS {
        &[]
    } else {
        &[code]
    };
    frame(first, &[&id.to_be_bytes(), code], out);
}

fn frame(first: u8, parts: &[&[u8]], out: &mut Vec<u8>) {
    out.push(first);
    variable(parts.iter().map(|part| part.len()).sum(), out);
    for part in parts {
        out.extend_from_slice(part);
    }
}

/// A text that was received in a packet, so its length fits.
fn text(text: &str, out: &mut Vec<u8>) {
    out.extend(u16::try_from(text.len()).unwrap_or(u16::MAX).to_be_bytes());
    out.extend(text.as_bytes());
}

/// A number in one to four bytes.
fn variable(mut number: usize, out: &mut Vec<u8>) {
    loop {
        let [low, ..] = number.to_le_bytes();
        number >>= 7;
        if number == 0 {
            return out.push(low & 0x7F);
        }
        out.push(low | 0x80);
    }
}
