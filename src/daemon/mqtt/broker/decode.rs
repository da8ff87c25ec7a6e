//! Decodes packets of clients strictly: what the specification forbids is an error.

use super::packet::{
    ConnectPacket, ConnectRefusal, IncomingPacket, PacketQos, ProtocolFault, PublishedMessage,
    RetainHandling, SessionExpiry, SubscriptionOptions, WantedFilter, WillMessage, reason,
};
use super::properties::{self, PacketProperties};
use super::reader::PacketReader;
use super::topic;
use crate::north::broker::MqttVersion;
use std::time::Duration;

/// CONNECT, as the first nibble of a packet.
pub const CONNECT: u8 = 1;

/// Reads CONNECT.
pub fn connect(first: u8, body: &[u8], packet_max: usize) -> Result<ConnectPacket, ConnectRefusal> {
    let mut reader = PacketReader::new(body);
    let version = version(first, &mut reader)?;
    rest_of_connect(version, &mut reader, packet_max).map_err(|fault| match version {
        MqttVersion::V4 => ConnectRefusal::Silent(fault),
        MqttVersion::V5 => ConnectRefusal::Said(version, fault.reason),
    })
}

fn version(first: u8, reader: &mut PacketReader<'_>) -> Result<MqttVersion, ConnectRefusal> {
    if first != CONNECT << 4 {
        return Err(ConnectRefusal::Silent(ProtocolFault::protocol(
            "the first packet is not CONNECT",
        )));
    }
    let name = reader.text().map_err(ConnectRefusal::Silent)?;
    let level = reader.byte().map_err(ConnectRefusal::Silent)?;
    match (name, level) {
        ("MQTT", 4) => Ok(MqttVersion::V4),
        ("MQTT", 5) => Ok(MqttVersion::V5),
        // 3.1 and bridges of mosquitto, which set the highest bit; both understand this answer.
        ("MQIsdp", _) | ("MQTT", 0..4 | 0x80..) => Err(ConnectRefusal::Said(MqttVersion::V4, 1)),
        ("MQTT", _) => Err(ConnectRefusal::Said(
            MqttVersion::V5,
            reason::UNSUPPORTED_VERSION,
        )),
        _ => Err(ConnectRefusal::Silent(ProtocolFault::protocol(
            "another protocol",
        ))),
    }
}

fn rest_of_connect(
    version: MqttVersion,
    reader: &mut PacketReader<'_>,
    packet_max: usize,
) -> Result<ConnectPacket, ProtocolFault> {
    let flags = ConnectFlags(reader.byte()?);
    flags.check(version)?;
    let keep_alive = Duration::from_secs(u64::from(reader.two()?));
    let properties = properties_of(version, reader, properties::OF_CONNECT)?;
    if properties.has(properties::AUTHENTICATION_METHOD) {
        return Err(ProtocolFault {
            reason: reason::BAD_AUTHENTICATION_METHOD,
            why: "enhanced authentication",
        });
    }
    let receive_maximum = properties
        .number(properties::RECEIVE_MAXIMUM)
        .unwrap_or(u32::from(u16::MAX));
    let packet_maximum = properties
        .number(properties::PACKET_MAXIMUM)
        .map_or(packet_max, |it| it as usize);
    if receive_maximum == 0 || packet_maximum == 0 {
        return Err(ProtocolFault::protocol("a maximum of 0"));
    }
    let expiry = match version {
        MqttVersion::V4 if flags.is(0x02) => SessionExpiry::AT_ONCE,
        MqttVersion::V4 => SessionExpiry::Never,
        MqttVersion::V5 => {
            SessionExpiry::from_seconds(properties.number(properties::SESSION_EXPIRY).unwrap_or(0))
        }
    };
    let client = reader.text()?.to_owned();
    let will = if flags.is(0x04) {
        Some(will(version, flags, reader)?)
    } else {
        None
    };
    // Any client may connect; user name and password only have to be well-formed.
    if flags.is(0x80) {
        reader.text()?;
    }
    if flags.is(0x40) {
        reader.binary()?;
    }
    reader.end()?;
    Ok(ConnectPacket {
        version,
        client,
        clean_start: flags.is(0x02),
        keep_alive,
        expiry,
        receive_maximum: u16::try_from(receive_maximum).unwrap_or(u16::MAX),
        packet_maximum: packet_maximum.min(packet_max),
        will,
    })
}

/// Flags of CONNECT.
#[derive(Clone, Copy)]
struct ConnectFlags(u8);

impl ConnectFlags {
    const fn is(self, bit: u8) -> bool {
        self.0 & bit != 0
    }

    fn check(self, version: MqttVersion) -> Result<(), ProtocolFault> {
        let has_no_will = !self.is(0x04) && self.is(0x38);
        let has_password_alone = version == MqttVersion::V4 && self.is(0x40) && !self.is(0x80);
        if self.is(0x01) || has_no_will || has_password_alone {
            return Err(ProtocolFault::malformed("contradictory flags of CONNECT"));
        }
        Ok(())
    }
}

fn will(
    version: MqttVersion,
    flags: ConnectFlags,
    reader: &mut PacketReader<'_>,
) -> Result<WillMessage, ProtocolFault> {
    let qos =
        PacketQos::new(flags.0 >> 3 & 3).ok_or(ProtocolFault::malformed("quality of service 3"))?;
    let properties = properties_of(version, reader, properties::OF_WILL)?;
    let delay = properties.number(properties::WILL_DELAY).unwrap_or(0);
    let topic = reader.text()?;
    let payload = reader.binary()?;
    let message = message(topic, payload, qos, flags.is(0x20), properties)?;
    Ok(WillMessage {
        message,
        delay: Duration::from_secs(u64::from(delay)),
    })
}

/// Reads any other packet.
pub fn packet(
    first: u8,
    body: &[u8],
    version: MqttVersion,
) -> Result<IncomingPacket, ProtocolFault> {
    let mut reader = PacketReader::new(body);
    let packet = match (first >> 4, first & 0x0F) {
        (3, flags) => return publish(flags, &mut reader, version),
        (4, 0) => IncomingPacket::Acked(ack(&mut reader, version)?.0),
        (5, 0) => {
            let (packet_id, code) = ack(&mut reader, version)?;
            IncomingPacket::Received {
                packet_id,
                is_taken: code < reason::REFUSED,
            }
        }
        (6, 2) => IncomingPacket::Released(ack(&mut reader, version)?.0),
        (7, 0) => IncomingPacket::Completed(ack(&mut reader, version)?.0),
        (8, 2) => subscribe(&mut reader, version)?,
        (10, 2) => unsubscribe(&mut reader, version)?,
        (12, 0) => IncomingPacket::Ping,
        (14, 0) => disconnect(&mut reader, version)?,
        (CONNECT, _) => return Err(ProtocolFault::protocol("a second CONNECT")),
        (15, _) if version == MqttVersion::V5 => {
            return Err(ProtocolFault::protocol("AUTH without a method"));
        }
        (2 | 9 | 11 | 13, _) => {
            return Err(ProtocolFault::protocol("a packet that only brokers send"));
        }
        _ => {
            return Err(ProtocolFault::malformed(
                "an unknown packet, or wrong flags",
            ));
        }
    };
    reader.end()?;
    Ok(packet)
}

fn properties_of<'a>(
    version: MqttVersion,
    reader: &mut PacketReader<'a>,
    allowed: &[u8],
) -> Result<PacketProperties<'a>, ProtocolFault> {
    match version {
        MqttVersion::V4 => Ok(PacketProperties::default()),
        MqttVersion::V5 => PacketProperties::read(reader, allowed),
    }
}

fn publish(
    flags: u8,
    reader: &mut PacketReader<'_>,
    version: MqttVersion,
) -> Result<IncomingPacket, ProtocolFault> {
    let qos =
        PacketQos::new(flags >> 1 & 3).ok_or(ProtocolFault::malformed("quality of service 3"))?;
    if qos == PacketQos::AtMostOnce && flags & 0x08 != 0 {
        return Err(ProtocolFault::malformed("a repeat at quality of service 0"));
    }
    let topic = reader.text()?;
    let packet_id = if qos == PacketQos::AtMostOnce {
        None
    } else {
        Some(reader.packet_id()?)
    };
    let properties = properties_of(version, reader, properties::OF_PUBLISH)?;
    if properties.has(properties::TOPIC_ALIAS) {
        return Err(ProtocolFault {
            reason: reason::TOPIC_ALIAS_INVALID,
            why: "a topic alias, and none is allowed",
        });
    }
    let message = message(topic, reader.rest(), qos, flags & 1 != 0, properties)?;
    Ok(IncomingPacket::Publish { message, packet_id })
}

fn message(
    topic: &str,
    payload: &[u8],
    qos: PacketQos,
    retain: bool,
    properties: PacketProperties<'_>,
) -> Result<PublishedMessage, ProtocolFault> {
    if !topic::is_name(topic) {
        return Err(ProtocolFault {
            reason: reason::TOPIC_INVALID,
            why: "a topic name that is not valid",
        });
    }
    if properties
        .text(properties::RESPONSE_TOPIC)
        .is_some_and(|it| !topic::is_name(it))
    {
        return Err(ProtocolFault::protocol(
            "a response topic that is not valid",
        ));
    }
    let expiry = properties
        .number(properties::MESSAGE_EXPIRY)
        .map(|it| Duration::from_secs(u64::from(it)));
    let topic = topic.into();
    let payload = payload.to_vec();
    Ok(PublishedMessage {
        topic,
        payload,
        qos,
        retain,
        expiry,
        properties: properties.passed_on(),
    })
}

/// The identifier and the reason of an acknowledgement.
fn ack(reader: &mut PacketReader<'_>, version: MqttVersion) -> Result<(u16, u8), ProtocolFault> {
    let packet_id = reader.packet_id()?;
    if version == MqttVersion::V4 || reader.is_empty() {
        return Ok((packet_id, reason::SUCCESS));
    }
    let code = reader.byte()?;
    if !reader.is_empty() {
        PacketProperties::read(reader, properties::OF_ACK)?;
    }
    Ok((packet_id, code))
}

fn subscribe(
    reader: &mut PacketReader<'_>,
    version: MqttVersion,
) -> Result<IncomingPacket, ProtocolFault> {
    let packet_id = reader.packet_id()?;
    let properties = properties_of(version, reader, properties::OF_SUBSCRIBE)?;
    let identifier = properties.number(properties::SUBSCRIPTION_IDENTIFIER);
    if identifier == Some(0) {
        return Err(ProtocolFault::protocol("subscription identifier 0"));
    }
    let mut wanted = Vec::new();
    while !reader.is_empty() {
        let filter = reader.text()?;
        wanted.push(one_wanted(filter, reader.byte()?, identifier, version)?);
    }
    if wanted.is_empty() {
        return Err(ProtocolFault::protocol("a subscription without a filter"));
    }
    Ok(IncomingPacket::Subscribe { packet_id, wanted })
}

fn one_wanted(
    filter: &str,
    options: u8,
    identifier: Option<u32>,
    version: MqttVersion,
) -> Result<WantedFilter, ProtocolFault> {
    let reserved = if version == MqttVersion::V4 {
        0xFC
    } else {
        0xC0
    };
    if options & reserved != 0 {
        return Err(ProtocolFault::malformed(
            "options of a subscription that do not exist",
        ));
    }
    let qos =
        PacketQos::new(options & 3).ok_or(ProtocolFault::malformed("quality of service 3"))?;
    let no_local = options & 0x04 != 0;
    if no_local && filter.starts_with("$share/") {
        return Err(ProtocolFault::protocol(
            "a shared subscription that leaves out the client's own messages",
        ));
    }
    let retained = match options >> 4 & 3 {
        0 => RetainHandling::Always,
        1 => RetainHandling::IfNew,
        2 => RetainHandling::Never,
        _ => return Err(ProtocolFault::protocol("retain handling 3")),
    };
    let options = SubscriptionOptions {
        qos,
        no_local,
        as_published: options & 0x08 != 0,
        identifier,
    };
    Ok(WantedFilter {
        filter: filter.to_owned(),
        options,
        retained,
    })
}

fn unsubscribe(
    reader: &mut PacketReader<'_>,
    version: MqttVersion,
) -> Result<IncomingPacket, ProtocolFault> {
    let packet_id = reader.packet_id()?;
    properties_of(version, reader, properties::OF_UNSUBSCRIBE)?;
    let mut filters = Vec::new();
    while !reader.is_empty() {
        filters.push(reader.text()?.to_owned());
    }
    if filters.is_empty() {
        return Err(ProtocolFault::protocol("UNSUBSCRIBE without a filter"));
    }
    Ok(IncomingPacket::Unsubscribe { packet_id, filters })
}

fn disconnect(
    reader: &mut PacketReader<'_>,
    version: MqttVersion,
) -> Result<IncomingPacket, ProtocolFault> {
    if version == MqttVersion::V4 || reader.is_empty() {
        return Ok(IncomingPacket::Disconnect {
            with_will: false,
            expiry: None,
        });
    }
    let code = reader.byte()?;
    let mut expiry = None;
    if !reader.is_empty() {
        let properties = PacketProperties::read(reader, properties::OF_DISCONNECT)?;
        expiry = properties
            .number(properties::SESSION_EXPIRY)
            .map(SessionExpiry::from_seconds);
    }
    // Every reason but the ordinary one leaves the will.
    Ok(IncomingPacket::Disconnect {
        with_will: code != reason::SUCCESS,
        expiry,
    })
}
