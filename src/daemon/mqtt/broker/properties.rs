//! Properties of MQTT 5: a table of all, and a reader that accepts those that a packet may have.

use super::packet::ProtocolFault;
use super::reader::PacketReader;

pub const PAYLOAD_FORMAT: u8 = 0x01;
pub const MESSAGE_EXPIRY: u8 = 0x02;
pub const CONTENT_TYPE: u8 = 0x03;
pub const RESPONSE_TOPIC: u8 = 0x08;
pub const CORRELATION_DATA: u8 = 0x09;
pub const SUBSCRIPTION_IDENTIFIER: u8 = 0x0B;
pub const SESSION_EXPIRY: u8 = 0x11;
pub const ASSIGNED_CLIENT_IDENTIFIER: u8 = 0x12;
pub const AUTHENTICATION_METHOD: u8 = 0x15;
pub const AUTHENTICATION_DATA: u8 = 0x16;
pub const REQUEST_PROBLEM_INFORMATION: u8 = 0x17;
pub const WILL_DELAY: u8 = 0x18;
pub const REQUEST_RESPONSE_INFORMATION: u8 = 0x19;
pub const REASON_STRING: u8 = 0x1F;
pub const RECEIVE_MAXIMUM: u8 = 0x21;
pub const TOPIC_ALIAS_MAXIMUM: u8 = 0x22;
pub const TOPIC_ALIAS: u8 = 0x23;
pub const USER_PROPERTY: u8 = 0x26;
pub const PACKET_MAXIMUM: u8 = 0x27;

/// What CONNECT may have.
pub const OF_CONNECT: &[u8] = &[
    SESSION_EXPIRY,
    AUTHENTICATION_METHOD,
    AUTHENTICATION_DATA,
    REQUEST_PROBLEM_INFORMATION,
    REQUEST_RESPONSE_INFORMATION,
    RECEIVE_MAXIMUM,
    TOPIC_ALIAS_MAXIMUM,
    USER_PROPERTY,
    PACKET_MAXIMUM,
];
/// What a will may have.
pub const OF_WILL: &[u8] = &[
    PAYLOAD_FORMAT,
    MESSAGE_EXPIRY,
    CONTENT_TYPE,
    RESPONSE_TOPIC,
    CORRELATION_DATA,
    WILL_DELAY,
    USER_PROPERTY,
];
/// What PUBLISH of a client may have.
pub const OF_PUBLISH: &[u8] = &[
    PAYLOAD_FORMAT,
    MESSAGE_EXPIRY,
    CONTENT_TYPE,
    RESPONSE_TOPIC,
    CORRELATION_DATA,
    TOPIC_ALIAS,
    USER_PROPERTY,
];
pub const OF_SUBSCRIBE: &[u8] = &[SUBSCRIPTION_IDENTIFIER, USER_PROPERTY];
pub const OF_UNSUBSCRIBE: &[u8] = &[USER_PROPERTY];
/// What acknowledgements may have.
pub const OF_ACK: &[u8] = &[REASON_STRING, USER_PROPERTY];
/// What DISCONNECT of a client may have.
pub const OF_DISCONNECT: &[u8] = &[SESSION_EXPIRY, REASON_STRING, USER_PROPERTY];

/// Properties that receivers get unchanged.
const PASSED_ON: &[u8] = &[
    PAYLOAD_FORMAT,
    CONTENT_TYPE,
    RESPONSE_TOPIC,
    CORRELATION_DATA,
    USER_PROPERTY,
];

/// The value of a property, as far as this broker needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PacketValue<'a> {
    Number(u32),
    Text(&'a str),
    /// Only passed on.
    Other,
}

/// The properties of one packet.
#[derive(Debug, Default)]
pub struct PacketProperties<'a> {
    found: Vec<(u8, PacketValue<'a>)>,
    passed_on: Vec<u8>,
}

impl<'a> PacketProperties<'a> {
    /// Reads them; `allowed` are those that the packet may have.
    pub fn read(reader: &mut PacketReader<'a>, allowed: &[u8]) -> Result<Self, ProtocolFault> {
        let length = reader.variable()?;
        let mut reader = reader.take(length as usize)?;
        let mut properties = Self::default();
        while !reader.is_empty() {
            let begin = reader.rest();
            let name = reader.byte()?;
            if !allowed.contains(&name) {
                return Err(ProtocolFault::malformed(
                    "a property that does not belong there",
                ));
            }
            let value = value(name, &mut reader)?;
            if name != USER_PROPERTY {
                if properties.found.iter().any(|(it, _)| *it == name) {
                    return Err(ProtocolFault::protocol("a property twice"));
                }
                properties.found.push((name, value));
            }
            if PASSED_ON.contains(&name) {
                properties
                    .passed_on
                    .extend_from_slice(&begin[..begin.len() - reader.rest().len()]);
            }
        }
        Ok(properties)
    }

    /// The number that `name` holds.
    pub fn number(&self, name: u8) -> Option<u32> {
        self.found.iter().find_map(|(it, value)| match value {
            PacketValue::Number(number) if *it == name => Some(*number),
            _ => None,
        })
    }

    /// The text that `name` holds.
    pub fn text(&self, name: u8) -> Option<&'a str> {
        self.found.iter().find_map(|(it, value)| match value {
            PacketValue::Text(text) if *it == name => Some(*text),
            _ => None,
        })
    }

    /// Whether there is a property `name`.
    pub fn has(&self, name: u8) -> bool {
        self.found.iter().any(|(it, _)| *it == name)
    }

    /// The properties that receivers get, encoded, without the total length.
    pub fn passed_on(self) -> Vec<u8> {
        self.passed_on
    }
}

fn value<'a>(name: u8, reader: &mut PacketReader<'a>) -> Result<PacketValue<'a>, ProtocolFault> {
    let number = match name {
        PAYLOAD_FORMAT | REQUEST_PROBLEM_INFORMATION | REQUEST_RESPONSE_INFORMATION => {
            let flag = reader.byte()?;
            if flag > 1 {
                return Err(ProtocolFault::protocol(
                    "a property that is neither 0 nor 1",
                ));
            }
            u32::from(flag)
        }
        RECEIVE_MAXIMUM | TOPIC_ALIAS_MAXIMUM | TOPIC_ALIAS => u32::from(reader.two()?),
        MESSAGE_EXPIRY | SESSION_EXPIRY | WILL_DELAY | PACKET_MAXIMUM => reader.four()?,
        SUBSCRIPTION_IDENTIFIER => reader.variable()?,
        CONTENT_TYPE | RESPONSE_TOPIC | AUTHENTICATION_METHOD | REASON_STRING => {
            return Ok(PacketValue::Text(reader.text()?));
        }
        CORRELATION_DATA | AUTHENTICATION_DATA => {
            reader.binary()?;
            return Ok(PacketValue::Other);
        }
        USER_PROPERTY => {
            reader.text()?;
            reader.text()?;
            return Ok(PacketValue::Other);
        }
        _ => return Err(ProtocolFault::malformed("an unknown property")),
    };
    Ok(PacketValue::Number(number))
}
