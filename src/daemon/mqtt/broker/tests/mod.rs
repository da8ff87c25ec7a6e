//! The machine in simulated time. Its clients use the client library, which is independent of this broker.

mod delivery;
mod sessions;
mod wrong;

use super::limits::PACKET_MAX;
use super::machine::{BrokerMachine, ConnectionId};
use super::reader::frame;
use super::{BrokerError, listen};
use crate::domain::time::MonoTime;
use bytes::BytesMut;
use rumqttc::mqttbytes::v4;
use rumqttc::v5::mqttbytes::v5;
use rumqttc::v5::mqttbytes::{QoS, v5::RetainForwardRule};
use std::io;
use std::time::Duration;

/// A broker and the time.
struct Rig {
    machine: BrokerMachine,
    now: MonoTime,
}

/// A connection to it.
type Id = ConnectionId;

impl Rig {
    fn new() -> Self {
        Self {
            machine: BrokerMachine::new(1, MonoTime::ZERO),
            now: MonoTime::ZERO,
        }
    }

    fn open(&mut self) -> Id {
        self.machine.open(self.now).unwrap()
    }

    /// Passes bytes to it as from a socket; returns whether all of them were valid.
    fn bytes(&mut self, id: Id, mut bytes: &[u8]) -> bool {
        let mut is_right = true;
        loop {
            match frame(bytes, PACKET_MAX as usize) {
                Ok(None) => return is_right && bytes.is_empty(),
                Ok(Some(it)) => {
                    is_right &= self
                        .machine
                        .received(id, it.first, &bytes[it.body..it.end], self.now)
                        .is_ok();
                    bytes = &bytes[it.end..];
                }
                Err(fault) => {
                    self.machine.fail(id, fault, self.now);
                    return false;
                }
            }
        }
    }

    fn say(&mut self, id: Id, packet: &v5::Packet) -> bool {
        let mut bytes = BytesMut::new();
        packet.write(&mut bytes, None).unwrap();
        self.bytes(id, &bytes)
    }

    fn say_v4(&mut self, id: Id, packet: &v4::Packet) -> bool {
        let mut bytes = BytesMut::new();
        packet.write(&mut bytes, usize::MAX).unwrap();
        self.bytes(id, &bytes)
    }

    /// The bytes for a connection.
    fn sent(&mut self, id: Id) -> BytesMut {
        let mut all = Vec::new();
        loop {
            // It returns a limited amount at a time.
            let mut some = Vec::new();
            self.machine.hand_over(id, self.now, &mut some);
            if some.is_empty() {
                return BytesMut::from(&*all);
            }
            all.append(&mut some);
        }
    }

    fn take(&mut self, id: Id) -> Vec<v5::Packet> {
        let mut bytes = self.sent(id);
        let mut packets = Vec::new();
        while !bytes.is_empty() {
            packets.push(v5::Packet::read(&mut bytes, None).unwrap());
        }
        packets
    }

    fn take_v4(&mut self, id: Id) -> Vec<v4::Packet> {
        let mut bytes = self.sent(id);
        let mut packets = Vec::new();
        while !bytes.is_empty() {
            packets.push(v4::Packet::read(&mut bytes, usize::MAX).unwrap());
        }
        packets
    }

    /// The messages for a connection.
    fn messages(&mut self, id: Id) -> Vec<v5::Publish> {
        let message = |packet| {
            if let v5::Packet::Publish(publish) = packet {
                Some(publish)
            } else {
                None
            }
        };
        self.take(id).into_iter().filter_map(message).collect()
    }

    fn payloads(&mut self, id: Id) -> Vec<String> {
        self.messages(id)
            .iter()
            .map(|it| String::from_utf8(it.payload.to_vec()).unwrap())
            .collect()
    }

    /// Connects with MQTT 5.
    fn connect(&mut self, client: &str) -> Id {
        self.connect_with(connect(client), None).0
    }

    fn connect_with(
        &mut self,
        connect: v5::Connect,
        will: Option<v5::LastWill>,
    ) -> (Id, v5::ConnAck) {
        let id = self.open();
        assert!(self.say(id, &v5::Packet::Connect(connect, will, None)));
        let packets = self.take(id);
        let Some(v5::Packet::ConnAck(ack)) = packets.first() else {
            panic!("{packets:?}")
        };
        let ack = ack.clone();
        (id, ack)
    }

    fn connect_v4(&mut self, client: &str, clean_session: bool) -> (Id, v4::ConnAck) {
        let id = self.open();
        let connect = v4::Connect {
            clean_session,
            ..v4::Connect::new(client)
        };
        assert!(self.say_v4(id, &v4::Packet::Connect(connect)));
        let packets = self.take_v4(id);
        let Some(v4::Packet::ConnAck(ack)) = packets.first() else {
            panic!("{packets:?}")
        };
        (id, ack.clone())
    }

    /// Subscribes with MQTT 5; the codes of the answer.
    fn subscribe(&mut self, id: Id, filters: &[v5::Filter]) -> Vec<v5::SubscribeReasonCode> {
        self.ask(id, filters, None);
        match self.machine_answer(id) {
            Some(v5::Packet::SubAck(ack)) => ack.return_codes,
            other => panic!("{other:?}"),
        }
    }

    fn ask(&mut self, id: Id, filters: &[v5::Filter], identifier: Option<usize>) {
        let properties = identifier.map(|it| v5::SubscribeProperties {
            id: Some(it),
            user_properties: Vec::new(),
        });
        let subscribe = v5::Subscribe {
            pkid: 7,
            ..v5::Subscribe::new_many(filters.to_vec(), properties)
        };
        assert!(self.say(id, &v5::Packet::Subscribe(subscribe)));
    }

    /// The answer alone: messages stay queued.
    fn machine_answer(&mut self, id: Id) -> Option<v5::Packet> {
        let connection = self.machine.connections.get_mut(&id)?;
        let mut bytes = BytesMut::from(&*std::mem::take(&mut connection.replies));
        v5::Packet::read(&mut bytes, None).ok()
    }

    fn publish(&mut self, id: Id, publish: v5::Publish) -> bool {
        self.say(id, &v5::Packet::Publish(publish))
    }

    /// Lets time pass in ticks, as the process does.
    fn pass(&mut self, span: Duration) {
        let end = self.now + span;
        while self.now < end {
            self.now = (self.now + super::BEAT).min(end);
            self.machine.tick(self.now);
        }
    }
}

fn connect(client: &str) -> v5::Connect {
    v5::Connect {
        keep_alive: 0,
        client_id: client.to_owned(),
        clean_start: true,
        properties: None,
    }
}

/// A CONNECT whose session lasts for `seconds` without a connection.
fn lasting(client: &str, seconds: u32) -> v5::Connect {
    let properties = v5::ConnectProperties {
        session_expiry_interval: Some(seconds),
        ..Default::default()
    };
    v5::Connect {
        clean_start: false,
        properties: Some(properties),
        ..connect(client)
    }
}

fn filter(path: &str, qos: QoS) -> v5::Filter {
    v5::Filter::new(path, qos)
}

/// A message with MQTT 5; above quality of service 0 its identifier is 9.
fn message(topic: &str, payload: &str, qos: QoS) -> v5::Publish {
    let pkid = if qos == QoS::AtMostOnce { 0 } else { 9 };
    v5::Publish {
        pkid,
        ..v5::Publish::new(topic, qos, payload.to_owned(), None)
    }
}

fn retained(topic: &str, payload: &str) -> v5::Publish {
    v5::Publish {
        retain: true,
        ..message(topic, payload, QoS::AtLeastOnce)
    }
}

#[tokio::test]
async fn it_stays_on_this_machine() {
    let refused = listen("0.0.0.0:0".parse().unwrap()).await;
    assert!(matches!(refused, Err(BrokerError::NotLoopback(_))));
}

#[tokio::test]
async fn a_taken_port_is_named() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let Err(refused) = listen(address).await else {
        panic!("it listens on a taken port")
    };
    assert!(
        refused.to_string().contains(&address.to_string()),
        "{refused}"
    );
    assert!(
        matches!(refused, BrokerError::Listen { error, .. } if error.kind() == io::ErrorKind::AddrInUse)
    );
}
