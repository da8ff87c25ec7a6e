//! Uniform reads from memory, many in flight, compared with a thread that answers as many with constant bytes.

use crate::pipeline::{Pipeline, request};
use crate::plant::{Gateway, Setup, UNIFORM};
use crate::table::{Row, medians};
use crate::tapped::TappedLine;
use rustix::event::epoll;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::thread::JoinHandle;
use std::time::Duration;
use vfd_gateway::sim::BusOptions;

const CLIENTS: usize = 50;
const IN_FLIGHT: u16 = 16;
const WANTED: f64 = 300_000.0;
const SECOND: Duration = Duration::from_secs(1);

pub fn uniform() -> Vec<Row> {
    let line = TappedLine::start(1, BusOptions::default());
    let setup = Setup {
        device: line.path(),
        drives: 1,
        unpaced: false,
        poll: "500ms",
        mqtt: None,
        listen: 0,
    };
    let gateway = Gateway::start(&setup);
    std::thread::sleep(SECOND / 2);
    let rows = [1, 16]
        .into_iter()
        .flat_map(|words| of_words(gateway.address, words))
        .collect();
    gateway.stop();
    line.stop();
    rows
}

fn of_words(gateway: SocketAddr, words: u16) -> Vec<Row> {
    let mut pairs = vec![(0.0, 0.0); if crate::is_quick() { 1 } else { 5 }];
    for pair in &mut pairs {
        pair.0 = rate(gateway, words);
        let (address, thread) = constant(words);
        pair.1 = rate(address, words);
        thread.join().expect("the bare thread ends");
    }
    let least = pairs.iter().map(|pair| pair.0).fold(f64::MAX, f64::min);
    let most = pairs.iter().map(|pair| pair.0).fold(0.0, f64::max);
    let (gateway, bare) = medians(&pairs);
    let what = format!("uniform: {CLIENTS} connections, {IN_FLIGHT} in flight, {words} words");
    vec![
        Row::rate(format!("{what}: answers/s"), WANTED, gateway),
        Row::told(
            "uniform: slowest and fastest run",
            format!("{least:.0} / {most:.0}"),
        ),
        Row::told(
            "uniform: a bare thread with constant bytes in the same run",
            format!("{bare:.0}"),
        ),
    ]
}

fn rate(address: SocketAddr, words: u16) -> f64 {
    let pipeline = Pipeline::connect(address, CLIENTS, IN_FLIGHT, |_, slot| {
        request(slot, UNIFORM, 3, [0, words])
    });
    let (answers, took) = pipeline.run(SECOND / 2, 2 * SECOND);
    assert_eq!(answers.exceptions, 0);
    answers.right as f64 / took.as_secs_f64()
}

/// A thread that answers whole requests with zeros until all clients are gone.
fn constant(words: u16) -> (SocketAddr, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    let thread = std::thread::spawn(move || {
        let poll = epoll::create(epoll::CreateFlags::CLOEXEC).expect("epoll");
        let mut streams: Vec<TcpStream> = (0..CLIENTS)
            .map(|_| listener.accept().expect("a client").0)
            .collect();
        for (index, stream) in streams.iter().enumerate() {
            stream.set_nodelay(true).expect("TCP_NODELAY");
            let data = epoll::EventData::new_u64(index as u64);
            epoll::add(&poll, stream, data, epoll::EventFlags::IN).expect("epoll add");
        }
        serve(&poll, &mut streams, &answer_of(words));
    });
    (address, thread)
}

fn answer_of(words: u16) -> Vec<u8> {
    let bytes = words as u8 * 2;
    let mut answer = vec![0, 0, 0, 0, 0, 3 + bytes, UNIFORM, 3, bytes];
    answer.resize(9 + usize::from(bytes), 0);
    answer
}

fn serve(poll: &std::os::fd::OwnedFd, streams: &mut [TcpStream], answer: &[u8]) {
    let mut events = [epoll::Event {
        flags: epoll::EventFlags::empty(),
        data: epoll::EventData::new_u64(0),
    }; 64];
    let mut open = streams.len();
    let mut buffer = [0; 512];
    let mut out = Vec::new();
    while open > 0 {
        let ready = epoll::wait(poll, &mut events[..], None).expect("events");
        for event in &events[..ready] {
            let stream = &mut streams[event.data.u64() as usize];
            // A request is never split here: clients send whole ones, at most 16 at once.
            let read = stream.read(&mut buffer).unwrap_or(0);
            if read == 0 {
                epoll::delete(poll, &*stream).expect("epoll delete");
                open -= 1;
                continue;
            }
            out.clear();
            for request in buffer[..read].chunks_exact(12) {
                let begun = out.len();
                out.extend_from_slice(answer);
                out[begun..begun + 2].copy_from_slice(&request[..2]);
            }
            // The client may be gone.
            let _ = stream.write_all(&out);
        }
    }
}
