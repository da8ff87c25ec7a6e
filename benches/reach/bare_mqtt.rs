//! A minimal client of a broker: MQTT 3.1.1 at quality of service 0 on a blocking socket.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::{Duration, Instant};

/// A message from the broker.
pub struct Message {
    pub topic: String,
    pub payload: Vec<u8>,
    pub retain: bool,
}

/// One connection.
pub struct Talker {
    stream: TcpStream,
    received: Vec<u8>,
}

impl Talker {
    /// Connects, and subscribes if there are filters.
    pub fn connect(port: u16, id: &str, filters: &[&str]) -> io::Result<Self> {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port))?;
        stream.set_nodelay(true)?;
        let mut talker = Self {
            stream,
            received: Vec::new(),
        };
        let mut body = vec![0, 4];
        // Protocol level 4, clean session, no keep-alive.
        body.extend(b"MQTT\x04\x02\0\0");
        put_text(&mut body, id);
        talker.send(0x10, &body)?;
        talker.packet_of(2)?;
        if !filters.is_empty() {
            let mut body = vec![0, 1];
            for filter in filters {
                put_text(&mut body, filter);
                body.push(0);
            }
            talker.send(0x82, &body)?;
            talker.packet_of(9)?;
        }
        Ok(talker)
    }

    pub fn publish(&mut self, topic: &str, payload: &[u8], retain: bool) -> io::Result<()> {
        let mut body = Vec::new();
        put_text(&mut body, topic);
        body.extend_from_slice(payload);
        self.send(0x30 | u8::from(retain), &body)
    }

    /// The next message; `None` if none arrives in time.
    pub fn next(&mut self, patience: Duration) -> io::Result<Option<Message>> {
        let until = Instant::now() + patience;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            self.stream.set_read_timeout(Some(left))?;
            match self.packet() {
                Ok((kind, body)) if kind >> 4 == 3 => return message(kind, &body).map(Some),
                Ok(_) => {}
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
                    ) =>
                {
                    return Ok(None);
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn send(&mut self, kind: u8, body: &[u8]) -> io::Result<()> {
        let mut packet = vec![kind];
        let mut left = body.len();
        while left >= 0x80 {
            packet.push((left % 0x80) as u8 | 0x80);
            left /= 0x80;
        }
        packet.push(left as u8);
        packet.extend_from_slice(body);
        self.stream.write_all(&packet)
    }

    /// Waits for a packet of this kind. Messages before it are dropped: a broker answers first.
    fn packet_of(&mut self, kind: u8) -> io::Result<()> {
        self.stream.set_read_timeout(Some(Duration::from_secs(5)))?;
        while self.packet()?.0 >> 4 != kind {}
        Ok(())
    }

    fn packet(&mut self) -> io::Result<(u8, Vec<u8>)> {
        loop {
            if let Some((header, bytes)) = length(&self.received)
                && self.received.len() >= header + bytes
            {
                let packet = (
                    self.received[0],
                    self.received[header..header + bytes].to_vec(),
                );
                self.received.drain(..header + bytes);
                return Ok(packet);
            }
            let mut buffer = [0; 4096];
            match self.stream.read(&mut buffer)? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                read => self.received.extend_from_slice(&buffer[..read]),
            }
        }
    }
}

fn put_text(body: &mut Vec<u8>, text: &str) {
    body.extend((text.len() as u16).to_be_bytes());
    body.extend_from_slice(text.as_bytes());
}

/// Bytes of the header, and of what follows it; `None` if the header is incomplete.
fn length(bytes: &[u8]) -> Option<(usize, usize)> {
    let mut length = 0;
    for (n, byte) in bytes.iter().skip(1).enumerate().take(4) {
        length |= usize::from(byte & 0x7F) << (7 * n);
        if byte & 0x80 == 0 {
            return Some((n + 2, length));
        }
    }
    None
}

fn message(kind: u8, body: &[u8]) -> io::Result<Message> {
    let broken = || io::Error::from(io::ErrorKind::InvalidData);
    let (length, rest) = body.split_first_chunk::<2>().ok_or_else(broken)?;
    let (topic, payload) = rest
        .split_at_checked(usize::from(u16::from_be_bytes(*length)))
        .ok_or_else(broken)?;
    let topic = String::from_utf8(topic.to_vec()).map_err(|_| broken())?;
    Ok(Message {
        topic,
        payload: payload.to_vec(),
        retain: kind & 1 == 1,
    })
}
