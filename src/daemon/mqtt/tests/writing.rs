//! Writing, and what is reported as sent.

use super::super::exchange::ProtocolState;
use super::super::incident::ConnectionIncident;
use super::super::v4::V4;
use super::super::wire::BrokerWire;
use super::*;
use bytes::BytesMut;
use rumqttc::{Packet as Mqtt, Publish, QoS, Request};
use std::future::poll_fn;
use std::pin::pin;
use std::task::Poll;
use tokio::io::{AsyncReadExt, duplex};

fn protocol() -> V4 {
    V4::new(
        &settings("127.0.0.1:1".parse().unwrap(), MqttVersion::V4),
        text("will", "gone"),
    )
}

fn publish() -> Publish {
    Publish::new("topic", QoS::AtLeastOnce, vec![7; 100])
}

#[tokio::test]
async fn a_write_that_was_dropped_half_way_continues_where_it_was() {
    let (near, mut far) = duplex(16);
    let protocol = protocol();
    let mut wire = BrokerWire::new(Box::new(near));
    let packet = Mqtt::Publish(Publish {
        pkid: 1,
        ..publish()
    });
    let mut expected = BytesMut::new();
    protocol.encode(packet.clone(), &mut expected).unwrap();
    wire.put(&protocol, packet).unwrap();
    {
        let mut flush = pin!(wire.flush::<V4>());
        let polled = poll_fn(|cx| Poll::Ready(flush.as_mut().poll(cx))).await;
        assert!(polled.is_pending(), "the stream is full");
    }
    let mut came = vec![0; expected.len()];
    let (read, flushed) = tokio::join!(far.read_exact(&mut came), wire.flush::<V4>());
    read.unwrap();
    flushed.unwrap();
    assert_eq!(came, expected);
}

#[test]
fn what_was_not_written_is_not_reported_as_sent() {
    let mut written = protocol();
    written.outgoing(Request::Publish(publish())).unwrap();
    assert!(matches!(
        written.next_incident(),
        Some(ConnectionIncident::PublicationLeft(1))
    ));

    let mut broken = protocol();
    broken.outgoing(Request::Publish(publish())).unwrap();
    broken.forget_unsent();
    assert!(broken.next_incident().is_none());
}

#[test]
fn an_unanswered_ping_ends_the_connection_at_the_next_one() {
    let mut protocol = protocol();
    assert!(protocol.ping().unwrap().is_some());
    assert!(protocol.ping().is_err());
    let mut answered = self::protocol();
    answered.ping().unwrap();
    answered.incoming(Mqtt::PingResp).unwrap();
    assert!(answered.ping().is_ok());
}
