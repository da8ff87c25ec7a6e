//! A broker for tests that does exactly what the test says, byte by byte.

use crate::north::broker::MqttVersion;
use std::net::SocketAddr;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

pub const CONNECT: u8 = 1;
pub const PUBLISH: u8 = 3;
pub const PUBACK: u8 = 4;
pub const SUBSCRIBE: u8 = 8;
pub const DISCONNECT: u8 = 14;

/// A listener for clients.
pub struct Stub {
    listener: TcpListener,
    version: MqttVersion,
}

/// One connection of a client.
pub struct Peer {
    stream: TcpStream,
    version: MqttVersion,
}

/// A packet from the client.
#[derive(Debug)]
pub struct Frame {
    pub kind: u8,
    pub flags: u8,
    pub body: Vec<u8>,
}

/// A publication of the client.
#[derive(Debug, PartialEq, Eq)]
pub struct Published {
    pub topic: String,
    pub identifier: u16,
    pub payload: Vec<u8>,
    pub retain: bool,
}

impl Stub {
    pub async fn new(version: MqttVersion) -> Self {
        Self::at("127.0.0.1:0".parse().unwrap(), version).await
    }

    /// Listens on the address of an earlier stub.
    pub async fn at(address: SocketAddr, version: MqttVersion) -> Self {
        Self {
            listener: TcpListener::bind(address).await.unwrap(),
            version,
        }
    }

    pub fn address(&self) -> SocketAddr {
        self.listener.local_addr().unwrap()
    }

    /// Accepts a connection and sends nothing.
    pub async fn accept(&self) -> Peer {
        let (stream, _) = self.listener.accept().await.unwrap();
        Peer {
            stream,
            version: self.version,
        }
    }

    /// Accepts a connection, reads CONNECT and answers it.
    pub async fn welcome(&self) -> Peer {
        self.welcome_on(&[]).await
    }

    /// Accepts a connection, reads CONNECT and answers it with `properties` (MQTT 5).
    pub async fn welcome_on(&self, properties: &[u8]) -> Peer {
        let mut peer = self.accept().await;
        peer.expect(CONNECT).await;
        peer.answer_connect(properties).await;
        peer
    }
}

impl Peer {
    pub async fn answer_connect(&mut self, properties: &[u8]) {
        let mut body = vec![0, 0];
        self.add_properties(&mut body, properties);
        self.send(0x20, &body).await;
    }

    /// The next packet; `None` if the client has closed the connection.
    pub async fn read(&mut self) -> Option<Frame> {
        let first = self.stream.read_u8().await.ok()?;
        let mut length = 0;
        let mut shift = 0;
        loop {
            let byte = usize::from(self.stream.read_u8().await.ok()?);
            length |= (byte & 0x7F) << shift;
            if byte < 0x80 {
                break;
            }
            shift += 7;
        }
        let mut body = vec![0; length];
        self.stream.read_exact(&mut body).await.ok()?;
        Some(Frame {
            kind: first >> 4,
            flags: first & 0x0F,
            body,
        })
    }

    /// Skips packets up to one of this kind.
    pub async fn expect(&mut self, kind: u8) -> Frame {
        loop {
            let frame = self
                .read()
                .await
                .expect("the client has closed the connection");
            if frame.kind == kind {
                return frame;
            }
        }
    }

    /// Skips packets up to a publication.
    pub async fn published(&mut self) -> Published {
        let Frame { flags, body, .. } = self.expect(PUBLISH).await;
        let end = 2 + usize::from(u16::from_be_bytes([body[0], body[1]]));
        let topic = String::from_utf8(body[2..end].to_vec()).unwrap();
        let mut rest = &body[end..];
        let mut identifier = 0;
        if flags & 0x06 != 0 {
            identifier = u16::from_be_bytes([rest[0], rest[1]]);
            rest = &rest[2..];
        }
        if self.version == MqttVersion::V5 {
            rest = &rest[1 + usize::from(rest[0])..];
        }
        Published {
            topic,
            identifier,
            payload: rest.to_vec(),
            retain: flags & 1 != 0,
        }
    }

    /// Publishes at quality of service 0.
    pub async fn publish(&mut self, topic: &str, payload: &[u8], properties: &[u8]) {
        let mut body = Vec::new();
        body.extend(u16::try_from(topic.len()).unwrap().to_be_bytes());
        body.extend(topic.as_bytes());
        self.add_properties(&mut body, properties);
        body.extend(payload);
        self.send(0x30, &body).await;
    }

    /// Publishes at quality of service 1, marked as a repeat.
    pub async fn publish_again(&mut self, topic: &str, identifier: u16) {
        let mut body = Vec::new();
        body.extend(u16::try_from(topic.len()).unwrap().to_be_bytes());
        body.extend(topic.as_bytes());
        body.extend(identifier.to_be_bytes());
        self.add_properties(&mut body, &[]);
        self.send(0x30 | 0x08 | 0x02, &body).await;
    }

    pub async fn acknowledge(&mut self, identifier: u16) {
        self.send(0x40, &identifier.to_be_bytes()).await;
    }

    /// Answers a subscription with these codes.
    pub async fn answer_subscribe(&mut self, subscribe: &Frame, codes: &[u8]) {
        let mut body = subscribe.body[..2].to_vec();
        self.add_properties(&mut body, &[]);
        body.extend(codes);
        self.send(0x90, &body).await;
    }

    /// Sends a packet; ignores a client that is gone.
    pub async fn send(&mut self, first: u8, body: &[u8]) {
        let mut bytes = vec![first];
        let mut length = body.len();
        loop {
            let more = length >= 0x80;
            bytes.push(u8::try_from(length & 0x7F).unwrap() | if more { 0x80 } else { 0 });
            length >>= 7;
            if !more {
                break;
            }
        }
        bytes.extend(body);
        let _ = self.stream.write_all(&bytes).await;
    }

    fn add_properties(&self, body: &mut Vec<u8>, properties: &[u8]) {
        if self.version == MqttVersion::V5 {
            body.push(u8::try_from(properties.len()).unwrap());
            body.extend(properties);
        }
    }
}
