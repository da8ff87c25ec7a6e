//! MQTT 5: conversion between the client library's types and ours.

use super::exchange::ProtocolState;
use super::incident::{
    self, BrokenConnection, BrokerTerms, ConnectionIncident, EndCause, NotQueued, ReceivedMessage,
};
use super::reason;
use super::settings::{BrokerKeeps, ConnectionSettings, HiddenText};
use crate::north::broker::{
    BrokerLimits, Publication, PublicationRefusal, Qos, SubscriptionFilter,
};
use bytes::BytesMut;
use rumqttc::Outgoing;
use rumqttc::v5::mqttbytes::v5::{
    ConnAck, Connect, ConnectProperties, ConnectReturnCode, DisconnectReasonCode, Filter, LastWill,
    LastWillProperties, Login, Packet, PubAckReason, Publish, PublishProperties, RetainForwardRule,
    Subscribe, SubscribeReasonCode,
};
use rumqttc::v5::mqttbytes::{Error as BytesError, QoS};
use rumqttc::v5::{ConnectionError, Event, MqttState, Request, StateError};
use std::io;
use std::time::Duration;
use tokio::sync::mpsc::Sender;

/// Longest packet that is accepted.
const INCOMING_MAX: u32 = 256 * 1024;
const _: () = assert!(INCOMING_MAX as usize == incident::PACKET_MAX, "one limit");

/// How long a broker keeps a session, in seconds: longer than it takes to restart a broker.
const SESSION_SECONDS: u32 = 3600;

/// The state of a connection.
pub struct V5 {
    connect: Connect,
    will: LastWill,
    login: Option<Login>,
    state: MqttState,
    /// Longest packet that the broker accepts.
    outgoing_max: Option<u32>,
    /// Unacknowledged publications that it accepts at once.
    inflight_max: u16,
}

impl V5 {
    /// No topic aliases are offered: the library returns messages with an alias without their topic.
    pub fn new(settings: &ConnectionSettings, will: Publication) -> Self {
        let mut properties = ConnectProperties::new();
        properties.max_packet_size = Some(INCOMING_MAX);
        if settings.keeps == BrokerKeeps::Session {
            properties.session_expiry_interval = Some(SESSION_SECONDS);
        }
        let connect = Connect {
            keep_alive: incident::keep_alive_seconds(settings),
            client_id: settings.client_id.clone(),
            clean_start: settings.keeps == BrokerKeeps::Nothing,
            properties: Some(properties),
        };
        let password = settings.password.as_ref().map_or("", HiddenText::expose);
        let login = (settings.user.is_some() || settings.password.is_some())
            .then(|| Login::new(settings.user.as_deref().unwrap_or_default(), password));
        let state = MqttState::new(incident::INFLIGHT_MAX, false);
        let will = last_will(will);
        Self {
            connect,
            will,
            login,
            state,
            outgoing_max: None,
            inflight_max: incident::INFLIGHT_MAX,
        }
    }
}

impl ProtocolState for V5 {
    type Packet = Packet;
    type Request = Request;
    const FLUSH_MAX: Option<Duration> = None;
    const CONNECT_OVERDUE: &str = "Timeout";

    fn decode(bytes: &mut BytesMut) -> Result<Option<Packet>, BrokenConnection> {
        match Packet::read(bytes, Some(INCOMING_MAX)) {
            Ok(packet) => Ok(Some(packet)),
            Err(BytesError::InsufficientBytes(_)) => Ok(None),
            Err(error) => Err(of_codec(error)),
        }
    }

    fn encode(&self, packet: Packet, bytes: &mut BytesMut) -> Result<(), BrokenConnection> {
        packet
            .write(bytes, self.outgoing_max)
            .map(|_| ())
            .map_err(of_codec)
    }

    fn connect(&self) -> Packet {
        Packet::Connect(
            self.connect.clone(),
            Some(self.will.clone()),
            self.login.clone(),
        )
    }

    fn accept(&mut self, packet: Packet) -> Result<Option<Duration>, BrokenConnection> {
        let answer = match packet {
            Packet::ConnAck(answer) if answer.code == ConnectReturnCode::Success => answer,
            Packet::ConnAck(answer) => {
                return Err(broken(&ConnectionError::ConnectionRefused(answer.code)));
            }
            packet => return Err(broken(&ConnectionError::NotConnAck(Box::new(packet)))),
        };
        if let Some(properties) = &answer.properties {
            self.outgoing_max = properties.max_packet_size;
            self.inflight_max = properties
                .receive_max
                .unwrap_or(u16::MAX)
                .min(incident::INFLIGHT_MAX);
        }
        let keep_alive = terms(&answer).keep_alive;
        self.incoming(Packet::ConnAck(answer))?;
        Ok(keep_alive)
    }

    fn incoming(&mut self, packet: Packet) -> Result<Option<Packet>, BrokenConnection> {
        self.state.handle_incoming_packet(packet).map_err(of_state)
    }

    fn has_room(&self) -> bool {
        self.state.inflight() < self.inflight_max && self.state.collision.is_none()
    }

    fn outgoing(&mut self, request: Request) -> Result<Option<Packet>, BrokenConnection> {
        self.state.handle_outgoing_packet(request).map_err(of_state)
    }

    fn ping(&mut self) -> Result<Option<Packet>, BrokenConnection> {
        self.outgoing(Request::PingReq)
    }

    fn next_incident(&mut self) -> Option<ConnectionIncident> {
        self.state.events.pop_front().map(incident)
    }

    fn forget_unsent(&mut self) {
        self.state
            .events
            .retain(|event| matches!(event, Event::Incoming(_)));
    }

    fn io(error: io::Error) -> BrokenConnection {
        of_codec(BytesError::Io(error))
    }

    fn closed() -> BrokenConnection {
        of_state(StateError::ConnectionAborted)
    }
}

/// Queues a publication.
pub fn publish(queue: &Sender<Request>, it: Publication) -> Result<(), NotQueued> {
    let properties = PublishProperties {
        message_expiry_interval: it.expiry.map(seconds),
        correlation_data: it.correlation.map(Into::into),
        ..PublishProperties::default()
    };
    let mut publish = Publish::new(it.topic, qos(it.qos), it.payload, Some(properties));
    publish.retain = it.retain;
    queue
        .try_send(Request::Publish(publish))
        .map_err(|_| NotQueued)
}

/// Queues a subscription, without retained messages and with the retain flag as published.
pub fn subscribe(
    queue: &Sender<Request>,
    filters: Vec<SubscriptionFilter>,
) -> Result<(), NotQueued> {
    incident::check_filters(&filters)?;
    let filters = filters.into_iter().map(|it: SubscriptionFilter| Filter {
        path: it.path,
        qos: qos(it.qos),
        nolocal: false,
        preserve_retain: true,
        retain_forward_rule: if it.wants_retained {
            RetainForwardRule::OnEverySubscribe
        } else {
            RetainForwardRule::Never
        },
    });
    queue
        .try_send(Request::Subscribe(Subscribe::new_many(filters, None)))
        .map_err(|_| NotQueued)
}

/// Queues the orderly end.
pub fn disconnect(queue: &Sender<Request>) -> Result<(), NotQueued> {
    queue.try_send(Request::Disconnect).map_err(|_| NotQueued)
}

/// Bytes of a publication on the wire.
pub fn packet_bytes(it: &Publication) -> usize {
    let identifier = if matches!(it.qos, Qos::AtLeastOnce) {
        2
    } else {
        0
    };
    let expiry = if it.expiry.is_some() { 5 } else { 0 };
    let correlation = it.correlation.as_ref().map_or(0, |data| 3 + data.len());
    let properties = expiry + correlation;
    let fields = 2 + it.topic.len() + identifier + incident::length_bytes(properties) + properties;
    incident::with_header(fields + it.payload.len())
}

/// Converts an event.
fn incident(event: Event) -> ConnectionIncident {
    match event {
        Event::Incoming(packet) => heard(packet),
        Event::Outgoing(Outgoing::Publish(identifier)) => {
            ConnectionIncident::PublicationLeft(identifier)
        }
        Event::Outgoing(Outgoing::Subscribe(_) | Outgoing::Disconnect) => {
            ConnectionIncident::OtherLeft
        }
        Event::Outgoing(_) => ConnectionIncident::Nothing,
    }
}

fn of_codec(error: BytesError) -> BrokenConnection {
    of_state(StateError::Deserialization(error))
}

fn of_state(error: StateError) -> BrokenConnection {
    broken(&ConnectionError::MqttState(error))
}

/// Why the connection is over. An error of the protocol can only occur after CONNECT.
fn broken(error: &ConnectionError) -> BrokenConnection {
    let is_io = matches!(
        error,
        ConnectionError::MqttState(
            StateError::Io(_) | StateError::Deserialization(BytesError::Io(_))
        )
    );
    let cause = match error {
        ConnectionError::MqttState(StateError::ServerDisconnect {
            reason_code: DisconnectReasonCode::SessionTakenOver,
            ..
        }) => EndCause::TakenOver,
        ConnectionError::MqttState(StateError::ServerDisconnect {
            reason_code: DisconnectReasonCode::PacketTooLarge,
            ..
        }) => EndCause::TooLarge,
        ConnectionError::MqttState(StateError::ConnectionAborted) => EndCause::Gone,
        _ if is_io => EndCause::Gone,
        _ => EndCause::Other,
    };
    let reason = reason_for(error).unwrap_or_else(|| error.to_string());
    BrokenConnection {
        reason,
        is_fresh: !is_io,
        cause,
        is_unsent: false,
    }
}

/// The reason in our own words, if we have any.
fn reason_for(error: &ConnectionError) -> Option<String> {
    match error {
        ConnectionError::ConnectionRefused(
            ConnectReturnCode::BadUserNamePassword | ConnectReturnCode::NotAuthorized,
        ) => Some(reason::CREDENTIALS.to_owned()),
        ConnectionError::ConnectionRefused(ConnectReturnCode::ClientIdentifierNotValid) => {
            Some(reason::CLIENT_ID.to_owned())
        }
        ConnectionError::Io(error)
        | ConnectionError::MqttState(
            StateError::Io(error) | StateError::Deserialization(BytesError::Io(error)),
        ) => reason::of_io(error).or_else(|| Some(error.to_string())),
        _ => None,
    }
}

fn heard(packet: Packet) -> ConnectionIncident {
    match packet {
        Packet::ConnAck(answer) => ConnectionIncident::Connected(terms(&answer)),
        Packet::SubAck(answer) => {
            ConnectionIncident::Subscribed(answer.return_codes.iter().map(is_granted).collect())
        }
        Packet::Publish(publish) => match offence(&publish) {
            Some(what) => ConnectionIncident::Offence(what),
            None => {
                received(publish).map_or(ConnectionIncident::Heard, ConnectionIncident::Message)
            }
        },
        Packet::PubAck(answer) => match answer.reason {
            PubAckReason::Success | PubAckReason::NoMatchingSubscribers => {
                ConnectionIncident::Acknowledged(answer.pkid)
            }
            reason => {
                ConnectionIncident::Refused(answer.pkid, refusal(reason), format!("{reason:?}"))
            }
        },
        _ => ConnectionIncident::Heard,
    }
}

const fn refusal(reason: PubAckReason) -> PublicationRefusal {
    match reason {
        PubAckReason::QuotaExceeded => PublicationRefusal::Full,
        PubAckReason::NotAuthorized
        | PubAckReason::TopicNameInvalid
        | PubAckReason::PayloadFormatInvalid => PublicationRefusal::Never,
        _ => PublicationRefusal::Failed,
    }
}

fn terms(answer: &ConnAck) -> BrokerTerms {
    let Some(properties) = &answer.properties else {
        return BrokerTerms::default();
    };
    let limit = properties
        .max_packet_size
        .and_then(|bytes| usize::try_from(bytes).ok());
    let retains = properties.retain_available != Some(0);
    BrokerTerms {
        broker: BrokerLimits {
            maximum_packet_bytes: limit,
            retains,
        },
        packet_max: limit.unwrap_or(usize::MAX).min(incident::PACKET_MAX),
        keep_alive: properties
            .server_keep_alive
            .map(|seconds| Duration::from_secs(seconds.into())),
    }
}

const fn is_granted(code: &SubscribeReasonCode) -> bool {
    matches!(code, SubscribeReasonCode::Success(_))
}

fn received(publish: Publish) -> Option<ReceivedMessage> {
    let topic = match String::from_utf8(publish.topic.into()) {
        Ok(topic) if !topic.is_empty() => topic,
        _ => {
            tracing::warn!("message without a readable topic dropped");
            return None;
        }
    };
    let properties = publish.properties.unwrap_or_default();
    Some(ReceivedMessage {
        topic,
        payload: publish.payload,
        retain: publish.retain,
        duplicate: publish.dup,
        expiry: properties
            .message_expiry_interval
            .map(|seconds| Duration::from_secs(seconds.into())),
        response_topic: properties.response_topic,
        correlation: properties.correlation_data,
    })
}

/// The protocol violation in a message, if there is one; the library accepts it.
fn offence(publish: &Publish) -> Option<&'static str> {
    if publish
        .properties
        .as_ref()
        .is_some_and(|it| it.topic_alias.is_some())
    {
        return Some("a message with a topic alias, of which we offer none");
    }
    // Topic and payload are slices of the received packet: between them are the identifier and the properties.
    let identifier = if publish.qos == QoS::AtMostOnce { 0 } else { 2 };
    let between = publish
        .payload
        .as_ptr()
        .addr()
        .checked_sub(publish.topic.as_ptr().addr())?;
    let actual_bytes = between.checked_sub(publish.topic.len() + identifier)?;
    let known_bytes = publish.properties.as_ref().map_or(0, property_bytes);
    (actual_bytes != incident::length_bytes(known_bytes) + known_bytes)
        .then_some("a message with a duplicate or malformed property")
}

/// Bytes of the properties on the wire, each counted once.
fn property_bytes(it: &PublishProperties) -> usize {
    let text = |text: &String| 2 + text.len();
    let fixed = [
        (it.payload_format_indicator.is_some(), 2),
        (it.message_expiry_interval.is_some(), 5),
    ];
    let fixed = fixed
        .into_iter()
        .filter(|(is_there, _)| *is_there)
        .map(|(_, bytes)| bytes)
        .sum::<usize>();
    let texts = [it.response_topic.as_ref(), it.content_type.as_ref()]
        .into_iter()
        .flatten()
        .map(|it| 1 + text(it));
    let users = it
        .user_properties
        .iter()
        .map(|(key, value)| 1 + text(key) + text(value));
    let identifiers = it
        .subscription_identifiers
        .iter()
        .map(|id| 1 + incident::length_bytes(*id));
    let correlation = it
        .correlation_data
        .as_ref()
        .map_or(0, |data| 3 + data.len());
    fixed + correlation + texts.chain(users).chain(identifiers).sum::<usize>()
}

fn last_will(will: Publication) -> LastWill {
    let properties = LastWillProperties {
        delay_interval: None,
        payload_format_indicator: None,
        message_expiry_interval: will.expiry.map(seconds),
        content_type: None,
        response_topic: None,
        correlation_data: will.correlation.map(Into::into),
        user_properties: Vec::new(),
    };
    LastWill::new(
        will.topic,
        will.payload,
        qos(will.qos),
        will.retain,
        Some(properties),
    )
}

/// Whole seconds, rounded up: with 0 it would not be delivered.
fn seconds(span: Duration) -> u32 {
    let up = u64::from(span.subsec_nanos() > 0);
    u32::try_from((span.as_secs() + up).max(1)).unwrap_or(u32::MAX)
}

const fn qos(qos: Qos) -> QoS {
    match qos {
        Qos::AtMostOnce => QoS::AtMostOnce,
        Qos::AtLeastOnce => QoS::AtLeastOnce,
    }
}
