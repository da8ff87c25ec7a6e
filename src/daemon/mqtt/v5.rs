//! MQTT 5: between the client library's words and ours.

use super::link::{self, Broken, Cause, Incident, NotQueued, Received, Terms};
use super::reason;
use super::settings::{ConnectionSettings, Keeps, Secret};
use super::window::QUEUE_MAX;
use crate::north::mqtt::{Broker, Filter as Wanted, Publication, Qos, Refusal};
use rumqttc::v5::mqttbytes::v5::{
    ConnAck, ConnectReturnCode, DisconnectReasonCode, Filter, LastWill, LastWillProperties, Packet, PubAckReason,
    Publish, PublishProperties, RetainForwardRule, SubscribeReasonCode,
};
use rumqttc::v5::mqttbytes::{Error as BytesError, QoS};
use rumqttc::v5::{AsyncClient, ConnectionError, Event, EventLoop, MqttOptions, StateError};
use rumqttc::{NetworkOptions, Outgoing, Transport};
use std::io::ErrorKind;
use std::time::Duration;

/// How long a broker keeps a session that is kept, in seconds: longer than it takes to start a broker again.
const SESSION_SECONDS: u32 = 3600;

/// Prepares a connection. No topic aliases are offered: the library tells messages that come by one without a topic.
pub fn open(
    settings: &ConnectionSettings,
    will: Publication,
    transport: Transport,
    network: NetworkOptions,
) -> (AsyncClient, EventLoop) {
    let mut options = MqttOptions::new(&settings.client_id, &settings.host, settings.port);
    options
        .set_transport(transport)
        .set_network_options(network)
        .set_connection_timeout(link::CONNECT_TIMEOUT.as_secs())
        .set_keep_alive(settings.keep_alive())
        .set_clean_start(settings.keeps == Keeps::Nothing)
        .set_max_packet_size(u32::try_from(link::PACKET_MAX).ok())
        .set_outgoing_inflight_upper_limit(link::INFLIGHT_MAX)
        .set_last_will(last_will(will));
    if settings.keeps == Keeps::Session {
        options.set_session_expiry_interval(Some(SESSION_SECONDS));
    }
    if settings.user.is_some() || settings.password.is_some() {
        let password = settings.password.as_ref().map_or("", Secret::expose);
        options.set_credentials(settings.user.as_deref().unwrap_or_default(), password);
    }
    AsyncClient::new(options, QUEUE_MAX)
}

/// Queues a publication.
pub fn publish(client: &AsyncClient, it: Publication) -> Result<(), NotQueued> {
    let properties = PublishProperties {
        message_expiry_interval: it.expiry.map(seconds),
        correlation_data: it.correlation.map(Into::into),
        ..PublishProperties::default()
    };
    client.try_publish_with_properties(it.topic, qos(it.qos), it.retain, it.payload, properties).map_err(|_| NotQueued)
}

/// Queues a subscription, without retained messages and with the retain flag as published.
pub fn subscribe(client: &AsyncClient, filters: Vec<Wanted>) -> Result<(), NotQueued> {
    let filters = filters.into_iter().map(|it: Wanted| Filter {
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
    client.try_subscribe_many(filters).map_err(|_| NotQueued)
}

/// Bytes of a publication on the wire.
pub fn packet_bytes(it: &Publication) -> usize {
    let identifier = if matches!(it.qos, Qos::AtLeastOnce) { 2 } else { 0 };
    let expiry = if it.expiry.is_some() { 5 } else { 0 };
    let correlation = it.correlation.as_ref().map_or(0, |data| 3 + data.len());
    let properties = expiry + correlation;
    let fields = 2 + it.topic.len() + identifier + link::length_bytes(properties) + properties;
    link::with_header(fields + it.payload.len())
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
            | ConnectionError::Timeout(_)
            | ConnectionError::MqttState(StateError::Io(_) | StateError::Deserialization(BytesError::Io(_)))
    );
    let cause = match error {
        ConnectionError::MqttState(StateError::ServerDisconnect {
            reason_code: DisconnectReasonCode::SessionTakenOver,
            ..
        }) => Cause::TakenOver,
        ConnectionError::Io(_)
        | ConnectionError::Timeout(_)
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
        ConnectionError::ConnectionRefused(ConnectReturnCode::ClientIdentifierNotValid) => {
            Some(reason::CLIENT_ID.to_owned())
        }
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
        Packet::ConnAck(answer) => Incident::Connected(terms(&answer)),
        Packet::SubAck(answer) => Incident::Subscribed(answer.return_codes.iter().map(is_granted).collect()),
        Packet::Publish(publish) => match offence(&publish) {
            Some(what) => Incident::Offence(what),
            None => received(publish).map_or(Incident::Heard, Incident::Message),
        },
        Packet::PubAck(answer) => match answer.reason {
            PubAckReason::Success | PubAckReason::NoMatchingSubscribers => Incident::Acknowledged(answer.pkid),
            reason => Incident::Refused(answer.pkid, refusal(reason), format!("{reason:?}")),
        },
        _ => Incident::Heard,
    }
}

const fn refusal(reason: PubAckReason) -> Refusal {
    match reason {
        PubAckReason::QuotaExceeded => Refusal::Full,
        PubAckReason::NotAuthorized | PubAckReason::TopicNameInvalid | PubAckReason::PayloadFormatInvalid => {
            Refusal::Never
        }
        _ => Refusal::Failed,
    }
}

fn terms(answer: &ConnAck) -> Terms {
    let Some(properties) = &answer.properties else { return Terms::default() };
    let limit = properties.max_packet_size.and_then(|bytes| usize::try_from(bytes).ok());
    let retains = properties.retain_available != Some(0);
    Terms {
        broker: Broker { maximum_packet_bytes: limit, retains },
        packet_max: limit.unwrap_or(usize::MAX).min(link::PACKET_MAX),
        keep_alive: properties.server_keep_alive.map(|seconds| Duration::from_secs(seconds.into())),
    }
}

const fn is_granted(code: &SubscribeReasonCode) -> bool {
    matches!(code, SubscribeReasonCode::Success(_))
}

fn received(publish: Publish) -> Option<Received> {
    let topic = match String::from_utf8(publish.topic.into()) {
        Ok(topic) if !topic.is_empty() => topic,
        _ => {
            tracing::warn!("a message without a readable topic is dropped");
            return None;
        }
    };
    let properties = publish.properties.unwrap_or_default();
    Some(Received {
        topic,
        payload: publish.payload,
        retain: publish.retain,
        duplicate: publish.dup,
        expiry: properties.message_expiry_interval.map(|seconds| Duration::from_secs(seconds.into())),
        response_topic: properties.response_topic,
        correlation: properties.correlation_data,
    })
}

/// What the protocol forbids about a message; the library takes it all the same.
fn offence(publish: &Publish) -> Option<&'static str> {
    if publish.properties.as_ref().is_some_and(|it| it.topic_alias.is_some()) {
        return Some("a message with a topic alias, of which we offer none");
    }
    // Topic and payload are parts of the packet as it came: what lies between them is identifier and properties.
    let identifier = if publish.qos == QoS::AtMostOnce { 0 } else { 2 };
    let between = publish.payload.as_ptr().addr().checked_sub(publish.topic.as_ptr().addr())?;
    let came = between.checked_sub(publish.topic.len() + identifier)?;
    let told = publish.properties.as_ref().map_or(0, property_bytes);
    (came != link::length_bytes(told) + told)
        .then_some("a message with a property that stands there twice, or ill-formed")
}

/// Bytes of properties on the wire, each once.
fn property_bytes(it: &PublishProperties) -> usize {
    let text = |text: &String| 2 + text.len();
    let fixed = [(it.payload_format_indicator.is_some(), 2), (it.message_expiry_interval.is_some(), 5)];
    let fixed = fixed.into_iter().filter(|(is_there, _)| *is_there).map(|(_, bytes)| bytes).sum::<usize>();
    let texts = [it.response_topic.as_ref(), it.content_type.as_ref()].into_iter().flatten().map(|it| 1 + text(it));
    let users = it.user_properties.iter().map(|(key, value)| 1 + text(key) + text(value));
    let identifiers = it.subscription_identifiers.iter().map(|id| 1 + link::length_bytes(*id));
    let correlation = it.correlation_data.as_ref().map_or(0, |data| 3 + data.len());
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
    LastWill::new(will.topic, will.payload, qos(will.qos), will.retain, Some(properties))
}

/// Whole seconds, rounded up: 0 would mean that nobody gets it.
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
