//! Thousands of connected clients in one thread, each of which sends a request at its own moment of every second.

use crate::pipeline::{Request, request};
use crate::plant::UNIFORM;
use crate::table::Times;
use rustix::event::{Timespec, epoll};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

const SECOND: Duration = Duration::from_secs(1);
/// Longer than any answer takes.
const PATIENCE: Duration = Duration::from_secs(10);
/// Words that each reads of the uniform unit.
const WORDS: u16 = 16;
const ANSWER_BYTES: usize = 9 + 2 * WORDS as usize;
/// Requests of a burst before answers are read.
const BURST: usize = 64;

struct Client {
    stream: TcpStream,
    /// Bytes of the answer so far.
    received: usize,
    asked: Option<Instant>,
}

/// The connected clients.
pub struct Crowd {
    poll: OwnedFd,
    clients: Vec<Client>,
    request: Request,
    events: Vec<epoll::Event>,
}

/// What the clients saw.
#[derive(Default)]
pub struct Seen {
    /// From each request to its answer.
    took: Vec<Duration>,
    /// How much later than planned each request was sent: the delay of this thread itself.
    late: Vec<Duration>,
    /// Requests without an answer, or whose client was still waiting.
    pub lost: u64,
}

impl Seen {
    pub fn took(&self) -> Times {
        Times::new(self.took.iter().copied())
    }

    pub fn late(&self) -> Times {
        Times::new(self.late.iter().copied())
    }
}

impl Crowd {
    /// Connects `count` clients, at most `a_second` of them.
    pub fn connect(address: SocketAddr, count: usize, a_second: u32) -> Self {
        let poll = epoll::create(epoll::CreateFlags::CLOEXEC).expect("epoll");
        let begun = Instant::now();
        let gap = SECOND / a_second;
        let connect = |index: usize| {
            std::thread::sleep(
                (begun + gap * index as u32).saturating_duration_since(Instant::now()),
            );
            let stream = TcpStream::connect(address).expect("the gateway accepts");
            stream.set_nodelay(true).expect("TCP_NODELAY");
            stream.set_nonblocking(true).expect("non-blocking");
            epoll::add(
                &poll,
                &stream,
                epoll::EventData::new_u64(index as u64),
                epoll::EventFlags::IN,
            )
            .expect("added");
            Client {
                stream,
                received: 0,
                asked: None,
            }
        };
        let clients = (0..count).map(connect).collect();
        let none = epoll::Event {
            flags: epoll::EventFlags::empty(),
            data: epoll::EventData::new_u64(0),
        };
        Self {
            poll,
            clients,
            request: request(1, UNIFORM, 3, [0, WORDS]),
            events: vec![none; 256],
        }
    }

    /// Each client sends a request once a second for `seconds` seconds, at a moment of its own.
    pub fn ask_for(&mut self, seconds: u32) -> Seen {
        let mut random = fastrand::Rng::with_seed(7);
        let mut plan: Vec<(Duration, usize)> = (0..self.clients.len())
            .map(|client| (Duration::from_nanos(random.u64(0..1_000_000_000)), client))
            .collect();
        plan.sort_unstable();
        let begun = Instant::now();
        let mut seen = Seen::default();
        for second in 0..seconds {
            for (phase, client) in &plan {
                let due = begun + SECOND * second + *phase;
                // Received answers are taken first, also when this program is late: that is not a delay of the gateway.
                self.look(Some(due), &mut seen);
                while Instant::now() < due {
                    self.look(Some(due), &mut seen);
                }
                seen.late.push(due.elapsed());
                self.ask(*client, &mut seen);
            }
        }
        self.finish(&mut seen);
        seen
    }

    /// All send a request at once.
    pub fn burst(&mut self) -> Seen {
        let mut seen = Seen::default();
        for client in 0..self.clients.len() {
            self.ask(client, &mut seen);
            if client % BURST == 0 {
                self.look(None, &mut seen);
            }
        }
        self.finish(&mut seen);
        seen
    }

    /// How many are still connected.
    pub fn connected(&mut self) -> usize {
        let is_open = |client: &mut Client| matches!(client.stream.read(&mut [0]), Err(error) if error.kind() == ErrorKind::WouldBlock);
        self.clients
            .iter_mut()
            .map(is_open)
            .filter(|it| *it)
            .count()
    }

    fn ask(&mut self, client: usize, seen: &mut Seen) {
        let client = &mut self.clients[client];
        if client.asked.is_some() {
            seen.lost += 1;
            return;
        }
        client.asked = Some(Instant::now());
        client
            .stream
            .write_all(&self.request)
            .expect("room for one request");
    }

    fn finish(&mut self, seen: &mut Seen) {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end && self.clients.iter().any(|client| client.asked.is_some()) {
            self.look(Some(Instant::now() + Duration::from_millis(5)), seen);
        }
        for client in &mut self.clients {
            seen.lost += u64::from(client.asked.take().is_some());
        }
    }

    /// Takes received answers, or waits for them until `until`.
    fn look(&mut self, until: Option<Instant>, seen: &mut Seen) {
        let left = until.map_or(Duration::ZERO, |until| {
            until.saturating_duration_since(Instant::now())
        });
        let timeout = Timespec {
            tv_sec: left.as_secs() as i64,
            tv_nsec: i64::from(left.subsec_nanos()),
        };
        let ready = epoll::wait(&self.poll, &mut self.events[..], Some(&timeout)).unwrap_or(0);
        for event in &self.events[..ready] {
            let client = &mut self.clients[event.data.u64() as usize];
            let mut buffer = [0; 2 * ANSWER_BYTES];
            let read = client
                .stream
                .read(&mut buffer)
                .expect("the gateway keeps the connection");
            assert!(
                read > 0 && (client.received > 0 || buffer[7] == 3),
                "an answer with words, not {:02x?}",
                &buffer[..read]
            );
            client.received += read;
            if client.received == ANSWER_BYTES {
                client.received = 0;
                seen.took
                    .extend(client.asked.take().map(|asked| asked.elapsed()));
            }
        }
    }
}

impl Drop for Crowd {
    /// Resets the connections, so that they do not keep ports of this host for a minute.
    fn drop(&mut self) {
        for client in &self.clients {
            let _ = rustix::net::sockopt::set_socket_linger(&client.stream, Some(Duration::ZERO));
        }
    }
}
