//! MQTT 3.1.1: conversion between the client library's types and ours.

use super::exchange::ProtocolState;
use super::incident::{
    self, BrokenConnection, BrokerTerms, ConnectionIncident, EndCause, NotQueued, ReceivedMessage,
};
use super::reason;
use super::settings::{BrokerKeeps, ConnectionSettings, HiddenText};
use crate::north::broker::{Publication, Qos, SubscriptionFilter};
use bytes::BytesMut;
use rumqttc::mqttbytes::Error as BytesError;
use rumqttc::{
    Connect, ConnectReturnCode, ConnectionError, Disconnect, Event, LastWill, Login, MqttState,
    Outgoing, Packet, PingReq, Publish, QoS, Request, StateError, Subscribe, SubscribeFilter,
    SubscribeReasonCode,
};
use std::io;
use std::time::Duration;
use tokio::sync::mpsc::Sender;

/// The state of a connection.
pub struct V4 {
    connect: Connect,
    state: MqttState,
}

impl V4 {
    pub fn new(settings: &ConnectionSettings, will: Publication) -> Self {
        let mut connect = Connect::new(&settings.client_id);
        connect.keep_alive = incident::keep_alive_seconds(settings);
        connect.clean_session = settings.keeps == BrokerKeeps::Nothing;
        connect.last_will = Some(LastWill::new(
            will.topic,
            will.payload,
            qos(will.qos),
            will.retain,
        ));
        if settings.user.is_some() || settings.password.is_some() {
            let password = settings.password.as_ref().map_or("", HiddenText::expose);
            connect.login = Some(Login::new(
                settings.user.as_deref().unwrap_or_default(),
                password,
            ));
        }
        Self {
            connect,
            state: MqttState::new(incident::INFLIGHT_MAX, false),
        }
    }
}

impl ProtocolState for V4 {
    type Packet = Packet;
    type Request = Request;
    const FLUSH_MAX: Option<Duration> = Some(incident::CONNECT_TIMEOUT);
    const CONNECT_OVERDUE: &str = "Network timeout";

    fn decode(bytes: &mut BytesMut) -> Result<Option<Packet>, BrokenConnection> {
        match Packet::read(bytes, incident::PACKET_MAX) {
            Ok(packet) => Ok(Some(packet)),
            Err(BytesError::InsufficientBytes(_)) => Ok(None),
            Err(error) => Err(of_codec(error)),
        }
    }

    fn encode(&self, packet: Packet, bytes: &mut BytesMut) -> Result<(), BrokenConnection> {
        packet
            .write(bytes, incident::PACKET_MAX)
            .map(|_| ())
            .map_err(of_codec)
    }

    fn connect(&self) -> Packet {
        Packet::Connect(self.connect.clone())
    }

    fn accept(&mut self, packet: Packet) -> Result<Option<Duration>, BrokenConnection> {
        match packet {
            Packet::ConnAck(answer) if answer.code == ConnectReturnCode::Success => {
                self.state
                    .events
                    .push_back(Event::Incoming(Packet::ConnAck(answer)));
                Ok(None)
            }
            Packet::ConnAck(answer) => {
                Err(broken(&ConnectionError::ConnectionRefused(answer.code)))
            }
            packet => Err(broken(&ConnectionError::NotConnAck(packet))),
        }
    }

    fn incoming(&mut self, packet: Packet) -> Result<Option<Packet>, BrokenConnection> {
        self.state.handle_incoming_packet(packet).map_err(of_state)
    }

    fn has_room(&self) -> bool {
        self.state.inflight() < incident::INFLIGHT_MAX && self.state.collision.is_none()
    }

    fn outgoing(&mut self, request: Request) -> Result<Option<Packet>, BrokenConnection> {
        self.state.handle_outgoing_packet(request).map_err(of_state)
    }

    fn ping(&mut self) -> Result<Option<Packet>, BrokenConnection> {
        self.outgoing(Request::PingReq(PingReq))
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
    let mut publish = Publish::new(it.topic, qos(it.qos), it.payload);
    publish.retain = it.retain;
    queue
        .try_send(Request::Publish(publish))
        .map_err(|_| NotQueued)
}

/// Queues a subscription.
pub fn subscribe(
    queue: &Sender<Request>,
    filters: Vec<SubscriptionFilter>,
) -> Result<(), NotQueued> {
    incident::check_filters(&filters)?;
    let filters = filters
        .into_iter()
        .map(|filter| SubscribeFilter::new(filter.path, qos(filter.qos)));
    queue
        .try_send(Request::Subscribe(Subscribe::new_many(filters)))
        .map_err(|_| NotQueued)
}

/// Queues the orderly end.
pub fn disconnect(queue: &Sender<Request>) -> Result<(), NotQueued> {
    queue
        .try_send(Request::Disconnect(Disconnect))
        .map_err(|_| NotQueued)
}

/// Bytes of a publication on the wire.
pub const fn packet_bytes(it: &Publication) -> usize {
    let identifier = if matches!(it.qos, Qos::AtLeastOnce) {
        2
    } else {
        0
    };
    incident::with_header(2 + it.topic.len() + identifier + it.payload.len())
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
    let is_closed = matches!(
        error,
        ConnectionError::MqttState(StateError::ConnectionAborted)
    );
    let cause = if is_io || is_closed {
        EndCause::Gone
    } else {
        EndCause::Other
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
        ConnectionError::ConnectionRefused(ConnectReturnCode::BadClientId) => {
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
        Packet::ConnAck(_) => ConnectionIncident::Connected(BrokerTerms::default()),
        Packet::SubAck(answer) => {
            ConnectionIncident::Subscribed(answer.return_codes.iter().map(is_granted).collect())
        }
        Packet::Publish(publish) => ConnectionIncident::Message(received(publish)),
        Packet::PubAck(answer) => ConnectionIncident::Acknowledged(answer.pkid),
        _ => ConnectionIncident::Heard,
    }
}

const fn is_granted(code: &SubscribeReasonCode) -> bool {
    matches!(code, SubscribeReasonCode::Success(_))
}

fn received(publish: Publish) -> ReceivedMessage {
    ReceivedMessage {
        topic: publish.topic,
        payload: publish.payload,
        retain: publish.retain,
        duplicate: publish.dup,
        expiry: None,
        response_topic: None,
        correlation: None,
    }
}

const fn qos(qos: Qos) -> QoS {
    match qos {
        Qos::AtMostOnce => QoS::AtMostOnce,
        Qos::AtLeastOnce => QoS::AtLeastOnce,
    }
}
