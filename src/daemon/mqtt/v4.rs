//! MQTT 3.1.1: between the client library's words and ours.

use super::link::{self, Broken, Cause, Incident, NotQueued, Received, Terms};
use super::reason;
use super::settings::{ConnectionSettings, Keeps, Secret};
use super::window::QUEUE_MAX;
use crate::north::mqtt::{Filter, Publication, Qos};
use rumqttc::mqttbytes::Error as BytesError;
use rumqttc::{
    AsyncClient, ConnectReturnCode, ConnectionError, Event, EventLoop, LastWill, MqttOptions, NetworkOptions, Outgoing,
    Packet, Publish, QoS, StateError, SubscribeFilter, SubscribeReasonCode, Transport,
};
use std::io::ErrorKind;

/// Prepares a connection.
pub fn open(
    settings: &ConnectionSettings,
    will: Publication,
    transport: Transport,
    network: NetworkOptions,
) -> (AsyncClient, EventLoop) {
    let mut options = MqttOptions::new(&settings.client_id, &settings.host, settings.port);
    options
        .set_transport(transport)
        .set_keep_alive(settings.keep_alive())
        .set_clean_session(settings.keeps == Keeps::Nothing)
        .set_max_packet_size(link::PACKET_MAX, link::PACKET_MAX)
        .set_inflight(link::INFLIGHT_MAX)
        .set_last_will(LastWill::new(will.topic, will.payload, qos(will.qos), will.retain));
    if settings.user.is_some() || settings.password.is_some() {
        let password = settings.password.as_ref().map_or("", Secret::expose);
        options.set_credentials(settings.user.as_deref().unwrap_or_default(), password);
    }
    let (client, mut events) = AsyncClient::new(options, QUEUE_MAX);
    events.network_options = network;
    (client, events)
}

/// Queues a publication.
pub fn publish(client: &AsyncClient, it: Publication) -> Result<(), NotQueued> {
    client.try_publish(it.topic, qos(it.qos), it.retain, it.payload).map_err(|_| NotQueued)
}

/// Queues a subscription.
pub fn subscribe(client: &AsyncClient, filters: Vec<Filter>) -> Result<(), NotQueued> {
    let filters = filters.into_iter().map(|filter| SubscribeFilter::new(filter.path, qos(filter.qos)));
    client.try_subscribe_many(filters).map_err(|_| NotQueued)
}

/// Bytes of a publication on the wire.
pub const fn packet_bytes(it: &Publication) -> usize {
    let identifier = if matches!(it.qos, Qos::AtLeastOnce) { 2 } else { 0 };
    link::with_header(2 + it.topic.len() + identifier + it.payload.len())
}

/// What an event means.
pub fn incident(event: Event) -> Incident {
    match event {
        Event::Incoming(packet) => heard(packet),
        Event::Outgoing(Outgoing::Publish(identifier)) => Incident::PublicationLeft(identifier),
        Event::Outgoing(Outgoing::Subscribe(_) | Outgoing::Disconnect) => Incident::OtherLeft,
        Event::Outgoing(_) => Incident::Nothing,
    }
}

/// Why the connection is over.
pub fn broken(error: &ConnectionError) -> Broken {
    let is_fresh = !matches!(
        error,
        ConnectionError::Io(_)
            | ConnectionError::FlushTimeout
            | ConnectionError::NetworkTimeout
            | ConnectionError::MqttState(StateError::Io(_) | StateError::Deserialization(BytesError::Io(_)))
    );
    let cause = match error {
        ConnectionError::Io(_)
        | ConnectionError::NetworkTimeout
        | ConnectionError::MqttState(
            StateError::Io(_) | StateError::ConnectionAborted | StateError::Deserialization(BytesError::Io(_)),
        ) => Cause::Gone,
        _ => Cause::Other,
    };
    // An established connection is reset or closed; only one that does not come about is refused.
    let is_unsent = matches!(error, ConnectionError::Io(error) if error.kind() == ErrorKind::ConnectionRefused)
        || matches!(error, ConnectionError::Tls(_));
    Broken { reason: reason_for(error).unwrap_or_else(|| error.to_string()), is_fresh, cause, is_unsent }
}

/// The reason in words of ours.
fn reason_for(error: &ConnectionError) -> Option<String> {
    match error {
        ConnectionError::ConnectionRefused(
            ConnectReturnCode::BadUserNamePassword | ConnectReturnCode::NotAuthorized,
        ) => Some(reason::CREDENTIALS.to_owned()),
        ConnectionError::ConnectionRefused(ConnectReturnCode::BadClientId) => Some(reason::CLIENT_ID.to_owned()),
        ConnectionError::Tls(error) => reason::of_tls(error),
        ConnectionError::Io(error)
        | ConnectionError::MqttState(StateError::Io(error) | StateError::Deserialization(BytesError::Io(error))) => {
            reason::of_io(error)
        }
        _ => None,
    }
}

fn heard(packet: Packet) -> Incident {
    match packet {
        Packet::ConnAck(_) => Incident::Connected(Terms::default()),
        Packet::SubAck(answer) => Incident::Subscribed(answer.return_codes.iter().map(is_granted).collect()),
        Packet::Publish(publish) => Incident::Message(received(publish)),
        Packet::PubAck(answer) => Incident::Acknowledged(answer.pkid),
        _ => Incident::Heard,
    }
}

const fn is_granted(code: &SubscribeReasonCode) -> bool {
    matches!(code, SubscribeReasonCode::Success(_))
}

fn received(publish: Publish) -> Received {
    Received {
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
