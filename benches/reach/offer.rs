//! Clients that always offer more reads than the gateway accepts, all in one thread: refused reads are repeated.

use crate::pipeline::{Answers, Request, taken};
use rustix::event::epoll;
use std::collections::VecDeque;
use std::io::{ErrorKind, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long a client waits before it repeats a refused read. Otherwise one thread that is refused at once would send as
/// fast as a processor can.
const ASK_ANEW_AFTER: Duration = Duration::from_secs(5);

/// One connection, what it offers by transaction, and what it will repeat.
struct Client {
    stream: TcpStream,
    requests: Vec<Request>,
    received: Vec<u8>,
    out: Vec<u8>,
    refused: VecDeque<(Instant, u16)>,
}

/// The offer on a thread of its own, until it is ended.
pub struct Offer {
    end: Arc<AtomicBool>,
    thread: JoinHandle<Answers>,
}

impl Offer {
    /// Connects `clients` that offer `slots` reads each: `next` makes the request of a client's slot.
    pub fn start(
        address: SocketAddr,
        clients: usize,
        slots: u16,
        next: impl Fn(usize, u16) -> Request,
    ) -> Self {
        let connect = |index: usize| {
            let stream = TcpStream::connect(address).expect("the gateway accepts");
            stream.set_nodelay(true).expect("TCP_NODELAY");
            stream.set_nonblocking(true).expect("non-blocking");
            let requests: Vec<Request> = (0..slots).map(|slot| next(index, slot)).collect();
            let out = requests.concat();
            Client {
                stream,
                requests,
                received: Vec::new(),
                out,
                refused: VecDeque::new(),
            }
        };
        let mut all: Vec<Client> = (0..clients).map(connect).collect();
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let thread = std::thread::spawn(move || {
            let poll = epoll::create(epoll::CreateFlags::CLOEXEC).expect("epoll");
            for (client, index) in all.iter().zip(0..) {
                epoll::add(
                    &poll,
                    &client.stream,
                    epoll::EventData::new_u64(index),
                    epoll::EventFlags::IN,
                )
                .expect("added");
            }
            let mut answers = Answers::default();
            let mut again = Instant::now();
            while !ended.load(Ordering::Relaxed) {
                turn(&poll, &mut all, &mut answers);
                if again.elapsed() >= Duration::from_millis(20) {
                    again = Instant::now();
                    all.iter_mut().for_each(|client| client.ask_again(again));
                }
            }
            answers
        });
        Self { end, thread }
    }

    pub fn stop(self) -> Answers {
        self.end.store(true, Ordering::Relaxed);
        self.thread.join().expect("the clients end")
    }
}

fn turn(poll: &std::os::fd::OwnedFd, clients: &mut [Client], answers: &mut Answers) {
    let mut events = [epoll::Event {
        flags: epoll::EventFlags::empty(),
        data: epoll::EventData::new_u64(0),
    }; 64];
    let timeout = rustix::event::Timespec {
        tv_sec: 0,
        tv_nsec: 20_000_000,
    };
    let ready = epoll::wait(poll, &mut events[..], Some(&timeout)).unwrap_or(0);
    for event in &events[..ready] {
        clients[event.data.u64() as usize].take(answers);
    }
}

impl Client {
    fn take(&mut self, answers: &mut Answers) {
        for (slot, is_right) in taken(&mut self.stream, &mut self.received) {
            if is_right {
                answers.right += 1;
                self.out
                    .extend_from_slice(&self.requests[usize::from(slot)]);
            } else {
                answers.exceptions += 1;
                self.refused.push_back((Instant::now(), slot));
            }
        }
        self.send();
    }

    fn ask_again(&mut self, now: Instant) {
        while let Some((at, slot)) = self.refused.front().copied() {
            if now.duration_since(at) < ASK_ANEW_AFTER {
                break;
            }
            self.refused.pop_front();
            self.out
                .extend_from_slice(&self.requests[usize::from(slot)]);
        }
        self.send();
    }

    /// What the socket does not take is kept: the gateway stops reading from a client that does not read.
    fn send(&mut self) {
        while !self.out.is_empty() {
            match self.stream.write(&self.out) {
                Ok(written) => drop(self.out.drain(..written)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) => panic!("the gateway closed the connection: {error}"),
            }
        }
    }
}
