//! Load clients: many connections of one thread, each waiting for its answer before the next request.

use rustix::event::epoll;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};
use vfd_gateway::wire::mbap;

/// The next request of a client: unit, address, count.
pub type Ask = (u8, u16, u16);

/// One connection.
struct Client {
    stream: TcpStream,
    received: Vec<u8>,
    asked: u64,
    /// Answers with words, and exceptions.
    right: u64,
    exceptions: u64,
}

/// What the clients received.
pub struct Load {
    /// Right answers of each client.
    pub right: Vec<u64>,
    /// Exceptions of all.
    pub exceptions: u64,
    pub took: Duration,
}

impl Load {
    /// Right answers a second of all clients.
    pub fn rate(&self) -> f64 {
        self.right.iter().sum::<u64>() as f64 / self.took.as_secs_f64()
    }
}

/// Lets `count` clients send requests for `time`, after `warm_up` that does not count. `next` returns the n-th request
/// of client c.
pub fn run(
    address: SocketAddr,
    count: usize,
    warm_up: Duration,
    time: Duration,
    next: impl Fn(usize, u64) -> Ask,
) -> Load {
    let poll = epoll::create(epoll::CreateFlags::CLOEXEC).expect("epoll");
    let mut clients: Vec<Client> = (0..count).map(|_| connect(address)).collect();
    for (index, client) in clients.iter_mut().enumerate() {
        let data = epoll::EventData::new_u64(index as u64);
        epoll::add(&poll, &client.stream, data, epoll::EventFlags::IN).expect("epoll add");
        ask(client, index, &next);
    }
    let mut begun = Instant::now();
    let mut counts = false;
    loop {
        let limit = if counts { time } else { warm_up };
        if begun.elapsed() >= limit {
            if counts {
                break;
            }
            counts = true;
            begun = Instant::now();
            clients
                .iter_mut()
                .for_each(|client| (client.right, client.exceptions) = (0, 0));
        }
        let mut events = [epoll::Event {
            flags: epoll::EventFlags::empty(),
            data: epoll::EventData::new_u64(0),
        }; 64];
        let timeout = rustix::event::Timespec {
            tv_sec: 0,
            tv_nsec: 100_000_000,
        };
        let ready = epoll::wait(&poll, &mut events[..], Some(&timeout)).unwrap_or(0);
        for event in &events[..ready] {
            let index = event.data.u64() as usize;
            if take_answers(&mut clients[index]) {
                ask(&mut clients[index], index, &next);
            }
        }
    }
    let exceptions = clients.iter().map(|client| client.exceptions).sum();
    Load {
        right: clients.iter().map(|client| client.right).collect(),
        exceptions,
        took: begun.elapsed(),
    }
}

/// One request of one client, answered with words or an exception code.
pub fn once(stream: &mut TcpStream, (unit, address, count): Ask) -> Result<Vec<u16>, u8> {
    stream
        .write_all(&request(1, unit, address, count))
        .expect("the gateway takes requests");
    let mut bytes = Vec::new();
    let mut buffer = [0; 512];
    loop {
        let read = stream.read(&mut buffer).expect("the gateway answers");
        assert!(read > 0, "the gateway closed the connection");
        bytes.extend_from_slice(&buffer[..read]);
        if let Some(message) = mbap::decode(&bytes).expect("an answer") {
            return match message.pdu {
                [code, exception] if code & 0x80 != 0 => Err(*exception),
                [_, _, words @ ..] => Ok(vfd_gateway::wire::pdu::words(words)),
                _ => panic!("no answer to a read"),
            };
        }
    }
}

fn connect(address: SocketAddr) -> Client {
    let stream = TcpStream::connect(address).expect("the gateway accepts");
    stream.set_nodelay(true).expect("TCP_NODELAY");
    stream.set_nonblocking(true).expect("non-blocking");
    Client {
        stream,
        received: Vec::new(),
        asked: 0,
        right: 0,
        exceptions: 0,
    }
}

fn ask(client: &mut Client, index: usize, next: &impl Fn(usize, u64) -> Ask) {
    let (unit, address, count) = next(index, client.asked);
    client.asked += 1;
    client
        .stream
        .write_all(&request(client.asked as u16, unit, address, count))
        .expect("room for one request");
}

fn take_answers(client: &mut Client) -> bool {
    let mut buffer = [0; 512];
    let Ok(read) = client.stream.read(&mut buffer) else {
        return false;
    };
    assert!(read > 0, "the gateway closed the connection");
    client.received.extend_from_slice(&buffer[..read]);
    let Some(message) = mbap::decode(&client.received).expect("an answer") else {
        return false;
    };
    assert_eq!(
        message.transaction, client.asked as u16,
        "the answer to the request that is open"
    );
    if message.pdu[0] & 0x80 == 0 {
        client.right += 1;
    } else {
        client.exceptions += 1;
    }
    client.received.clear();
    true
}

fn request(transaction: u16, unit: u8, address: u16, count: u16) -> Vec<u8> {
    let mut out = Vec::with_capacity(12);
    mbap::encode(&mut out, transaction, unit, |pdu| {
        pdu.push(3);
        pdu.extend(address.to_be_bytes());
        pdu.extend(count.to_be_bytes());
    });
    out
}
