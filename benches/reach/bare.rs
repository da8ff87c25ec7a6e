//! The same hops without the gateway: client, relay thread, line thread, pseudo-terminal, drive thread, and back. This
//! shows what the machine allows today; the table compares the gateway with it.

use rustix::event::{PollFd, PollFlags, epoll, poll};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::host::sys;
use vfd_gateway::daemon::host::timer::RawTimer;
use vfd_gateway::domain::link::LinkSettings;

/// A request as the bench's clients send it, and the answer to it: one word.
const ASKED_BYTES: usize = 12;
const ANSWER: [u8; 11] = [0, 0, 0, 0, 0, 5, 1, 3, 2, 0, 0];
/// The bytes over the pseudo-terminal in each direction.
const REQUEST: [u8; 8] = [1, 3, 0x30, 0, 0, 1, 0, 0];
const REPLY: [u8; 7] = [1, 3, 2, 0, 0, 0, 0];

/// The running hops.
pub struct Bare {
    pub address: SocketAddr,
    end: Arc<AtomicBool>,
    drive: JoinHandle<()>,
    relay: JoinHandle<()>,
}

impl Bare {
    pub fn start() -> Self {
        let pty = Pty::new().expect("a pseudo-terminal");
        let port = OpenOptions::new()
            .read(true)
            .write(true)
            .open(pty.path())
            .expect("its other side");
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let drive = std::thread::spawn(move || answer(&pty, &ended));
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let relay = std::thread::spawn(move || relay(&listener, port));
        Self {
            address,
            end,
            drive,
            relay,
        }
    }

    /// Stops; the client must have closed its connection.
    pub fn stop(self) {
        self.relay.join().expect("the relay ends");
        self.end.store(true, Ordering::Relaxed);
        self.drive.join().expect("the drive ends");
    }
}

/// How late a thread that only waits is woken, in ms, sorted: what the machine allows today.
pub fn timer(count: usize, real_time: bool) -> Vec<f64> {
    if real_time {
        let _ = sys::ask_for_real_time();
    }
    let mut timer = RawTimer::new().expect("a timer");
    let mut late: Vec<f64> = (0..count)
        .map(|_| {
            let at = clock::now() + LinkSettings::DEFAULT.chars(30.0);
            timer.arm(at).expect("armed");
            let mut fds = [PollFd::new(&timer, PollFlags::IN)];
            poll(&mut fds, None).expect("polled");
            let late = clock::now().since(at).as_secs_f64() * 1e3;
            timer.acknowledge();
            late
        })
        .collect();
    late.sort_by(f64::total_cmp);
    late
}

/// How long one byte takes through a pseudo-terminal, written and read by the same real-time thread, in ms, sorted. A
/// kernel worker without real-time priority passes it on: each gap contains two such hops.
pub fn hop(count: usize) -> Vec<f64> {
    let _ = sys::ask_for_real_time();
    let pty = Pty::new().expect("a pseudo-terminal");
    let mut port = OpenOptions::new()
        .read(true)
        .write(true)
        .open(pty.path())
        .expect("its other side");
    let mut took: Vec<f64> = (0..count)
        .map(|_| {
            std::thread::sleep(LinkSettings::DEFAULT.chars(30.0));
            let at = clock::now();
            rustix::io::write(pty.master(), &REPLY[..1]).expect("written");
            port.read_exact(&mut [0]).expect("read");
            clock::now().since(at).as_secs_f64() * 1e3
        })
        .collect();
    took.sort_by(f64::total_cmp);
    took
}

/// A thread that answers every request of `clients` connections at once, with constant data, until they close.
pub fn answerer(clients: usize) -> (SocketAddr, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    let thread = std::thread::spawn(move || {
        let streams: Vec<TcpStream> = (0..clients)
            .map(|_| listener.accept().expect("a client").0)
            .collect();
        let poll = epoll::create(epoll::CreateFlags::CLOEXEC).expect("epoll");
        for (stream, index) in streams.iter().zip(0..) {
            stream.set_nodelay(true).expect("TCP_NODELAY");
            epoll::add(
                &poll,
                stream,
                epoll::EventData::new_u64(index),
                epoll::EventFlags::IN,
            )
            .expect("epoll add");
        }
        answer_all(&poll, &streams);
    });
    (address, thread)
}

fn answer_all(poll: &impl AsFd, streams: &[TcpStream]) {
    let mut events = [epoll::Event {
        flags: epoll::EventFlags::empty(),
        data: epoll::EventData::new_u64(0),
    }; 64];
    let mut open = streams.len();
    while open > 0 {
        let ready = epoll::wait(poll, &mut events[..], None).expect("events");
        for event in &events[..ready] {
            let mut stream = &streams[event.data.u64() as usize];
            match request(&mut stream) {
                Some(transaction) => {
                    let mut answer = ANSWER;
                    answer[..2].copy_from_slice(&transaction);
                    stream.write_all(&answer).expect("answered");
                }
                None => {
                    epoll::delete(poll, stream).expect("epoll delete");
                    open -= 1;
                }
            }
        }
    }
}

fn answer(pty: &Pty, end: &AtomicBool) {
    let mut buffer = [0; 64];
    while !end.load(Ordering::Relaxed) {
        let mut fds = [PollFd::from_borrowed_fd(
            pty.master().as_fd(),
            PollFlags::IN,
        )];
        let timeout = Duration::from_millis(200).try_into().expect("a time");
        poll(&mut fds, Some(&timeout)).expect("polled");
        if rustix::io::read(pty.master(), &mut buffer).is_ok_and(|bytes| bytes == REQUEST.len()) {
            rustix::io::write(pty.master(), &REPLY).expect("written");
        }
    }
}

fn relay(listener: &TcpListener, port: File) {
    let (ask, asked) = mpsc::sync_channel(1);
    let (tell, told) = mpsc::sync_channel(1);
    let line = std::thread::spawn(move || exchange(port, &asked, &tell));
    let (mut client, _) = listener.accept().expect("a client");
    client.set_nodelay(true).expect("TCP_NODELAY");
    while let Some(transaction) = request(&mut client) {
        ask.send(()).expect("the line thread");
        told.recv().expect("the line thread");
        let mut answer = ANSWER;
        answer[..2].copy_from_slice(&transaction);
        client.write_all(&answer).expect("answered");
    }
    drop(ask);
    line.join().expect("the line thread ends");
}

fn request(client: &mut impl Read) -> Option<[u8; 2]> {
    let mut bytes = [0; ASKED_BYTES];
    client.read_exact(&mut bytes).ok()?;
    Some([bytes[0], bytes[1]])
}

fn exchange(mut port: File, asked: &mpsc::Receiver<()>, tell: &mpsc::SyncSender<()>) {
    let mut reply = [0; REPLY.len()];
    while asked.recv().is_ok() {
        port.write_all(&REQUEST).expect("written");
        port.read_exact(&mut reply).expect("read");
        tell.send(()).expect("the relay");
    }
}
