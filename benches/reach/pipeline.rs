//! Clients that keep several requests in flight each, all in one thread that does little for an answer.

use rustix::event::epoll;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// A request for words as it goes over the socket.
pub type Request = [u8; 12];

/// A request of transaction `slot`: `function` (03 or 06) with two words.
pub fn request(slot: u16, unit: u8, function: u8, words: [u16; 2]) -> Request {
    let ([t0, t1], [a0, a1], [b0, b1]) = (
        slot.to_be_bytes(),
        words[0].to_be_bytes(),
        words[1].to_be_bytes(),
    );
    [t0, t1, 0, 0, 0, 6, unit, function, a0, a1, b0, b1]
}

/// One connection and the requests that it repeats, by transaction.
struct Client {
    stream: TcpStream,
    requests: Vec<Request>,
    received: Vec<u8>,
    out: Vec<u8>,
}

/// Received answers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Answers {
    pub right: u64,
    pub exceptions: u64,
}

/// The connections of one thread.
pub struct Pipeline {
    poll: std::os::fd::OwnedFd,
    clients: Vec<Client>,
    pub answers: Answers,
}

impl Pipeline {
    /// Connects and sends every request once: `next` makes the request of a client's slot.
    pub fn connect(
        address: SocketAddr,
        clients: usize,
        slots: u16,
        next: impl Fn(usize, u16) -> Request,
    ) -> Self {
        let poll = epoll::create(epoll::CreateFlags::CLOEXEC).expect("epoll");
        let connect = |index: usize| {
            let mut stream = TcpStream::connect(address).expect("the gateway accepts");
            stream.set_nodelay(true).expect("TCP_NODELAY");
            let requests: Vec<Request> = (0..slots).map(|slot| next(index, slot)).collect();
            stream
                .write_all(&requests.concat())
                .expect("room for the first requests");
            stream.set_nonblocking(true).expect("non-blocking");
            let data = epoll::EventData::new_u64(index as u64);
            epoll::add(&poll, &stream, data, epoll::EventFlags::IN).expect("epoll add");
            Client {
                stream,
                requests,
                received: Vec::new(),
                out: Vec::new(),
            }
        };
        let clients = (0..clients).map(connect).collect();
        Self {
            poll,
            clients,
            answers: Answers::default(),
        }
    }

    /// Takes answers once and repeats the request of each, waiting at most 50 ms.
    pub fn turn(&mut self) {
        let mut events = [epoll::Event {
            flags: epoll::EventFlags::empty(),
            data: epoll::EventData::new_u64(0),
        }; 64];
        let timeout = rustix::event::Timespec {
            tv_sec: 0,
            tv_nsec: 50_000_000,
        };
        let ready = epoll::wait(&self.poll, &mut events[..], Some(&timeout)).unwrap_or(0);
        for event in &events[..ready] {
            self.clients[event.data.u64() as usize].take(&mut self.answers);
        }
    }

    /// Answers within `time`, after `warm_up` that does not count, and how long that actually took.
    pub fn run(mut self, warm_up: Duration, time: Duration) -> (Answers, Duration) {
        let begun = Instant::now();
        while begun.elapsed() < warm_up {
            self.turn();
        }
        self.answers = Answers::default();
        let begun = Instant::now();
        while begun.elapsed() < time {
            self.turn();
        }
        (self.answers, begun.elapsed())
    }
}

impl Client {
    fn take(&mut self, answers: &mut Answers) {
        for (slot, is_right) in taken(&mut self.stream, &mut self.received) {
            *(if is_right {
                &mut answers.right
            } else {
                &mut answers.exceptions
            }) += 1;
            self.out
                .extend_from_slice(&self.requests[usize::from(slot)]);
        }
        if !self.out.is_empty() {
            self.stream
                .write_all(&self.out)
                .expect("room for the next requests");
            self.out.clear();
        }
    }
}

/// The complete answers from `stream`, appended to what is in `received`: transaction, and whether they are right.
pub(crate) fn taken(stream: &mut TcpStream, received: &mut Vec<u8>) -> Vec<(u16, bool)> {
    let mut buffer = [0; 4096];
    let read = match stream.read(&mut buffer) {
        Ok(read) => read,
        Err(error) if error.kind() == ErrorKind::WouldBlock => return Vec::new(),
        Err(error) => panic!("the gateway closed the connection: {error}"),
    };
    assert!(read > 0, "the gateway closed the connection");
    received.extend_from_slice(&buffer[..read]);
    let mut answers = Vec::new();
    let mut used = 0;
    while let [t0, t1, _, _, l0, l1, _, function, ..] = received[used..] {
        let bytes = 6 + usize::from(u16::from_be_bytes([l0, l1]));
        if received.len() < used + bytes {
            break;
        }
        used += bytes;
        answers.push((u16::from_be_bytes([t0, t1]), function < 0x80));
    }
    received.drain(..used);
    answers
}
