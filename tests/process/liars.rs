//! Brokers that accept a connection and then do not do what they should.

use super::brokers::gateway_at;
use super::rig::Place;
use super::started::{PATIENCE, until};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

/// What is wrong with a broker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lie {
    /// It does not answer the subscription.
    Mute,
    /// It refuses the first filter.
    Refuses,
    /// It answers one filter too few.
    Short,
    /// It delivers nothing.
    Deaf,
}

/// A connection as the broker has seen it.
#[derive(Clone, Debug, Default)]
struct Seen {
    has_subscribed: bool,
    /// Topics that were published on, in order.
    published: Vec<String>,
}

const CONNECT: u8 = 1;
const PUBLISH: u8 = 3;
const SUBSCRIBE: u8 = 8;
const PINGREQ: u8 = 12;

/// Starts a broker that lies until the test program ends. Returns its port, and what it sees.
fn lying(lie: Lie, has_properties: bool) -> (u16, Arc<Mutex<Vec<Seen>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let all = Arc::new(Mutex::new(Vec::new()));
    let seen = Arc::clone(&all);
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let place = {
                let mut seen = seen.lock().unwrap();
                seen.push(Seen::default());
                seen.len() - 1
            };
            // The client closes it sooner or later.
            let _ = serve(stream, lie, has_properties, &mut |note| {
                note(&mut seen.lock().unwrap()[place])
            });
        }
    });
    (port, all)
}

type Note<'a> = &'a mut dyn FnMut(&dyn Fn(&mut Seen));

fn serve(
    mut stream: TcpStream,
    lie: Lie,
    has_properties: bool,
    note: Note<'_>,
) -> std::io::Result<()> {
    let none: &[u8] = if has_properties { &[0] } else { &[] };
    loop {
        let (kind, body) = packet(&mut stream)?;
        match kind {
            CONNECT => answer(&mut stream, 0x20, &[&[0, 0], none])?,
            SUBSCRIBE => {
                note(&|seen| seen.has_subscribed = true);
                let filters = filters(&body[2 + none.len()..]);
                let mut codes = vec![1; filters];
                match lie {
                    Lie::Mute => continue,
                    Lie::Refuses => codes[0] = 0x80,
                    Lie::Short => drop(codes.pop()),
                    Lie::Deaf => {}
                }
                answer(&mut stream, 0x90, &[&body[..2], none, &codes])?;
            }
            PUBLISH => {
                let length = usize::from(u16::from_be_bytes([body[0], body[1]]));
                let topic = String::from_utf8(body[2..2 + length].to_vec()).unwrap();
                note(&|seen| seen.published.push(topic.clone()));
            }
            PINGREQ => answer(&mut stream, 0xD0, &[])?,
            _ => {}
        }
    }
}

/// The next packet: its kind, and what follows the fixed header.
fn packet(stream: &mut TcpStream) -> std::io::Result<(u8, Vec<u8>)> {
    let mut byte = [0];
    stream.read_exact(&mut byte)?;
    let kind = byte[0] >> 4;
    let (mut length, mut shift) = (0, 0);
    loop {
        stream.read_exact(&mut byte)?;
        length |= usize::from(byte[0] & 0x7F) << shift;
        shift += 7;
        if byte[0] < 0x80 {
            break;
        }
    }
    let mut body = vec![0; length];
    stream.read_exact(&mut body)?;
    Ok((kind, body))
}

fn answer(stream: &mut TcpStream, first: u8, parts: &[&[u8]]) -> std::io::Result<()> {
    let body = parts.concat();
    stream.write_all(&[&[first, u8::try_from(body.len()).unwrap()], body.as_slice()].concat())
}

/// How many filters a subscription has: each is a text and a byte.
fn filters(mut rest: &[u8]) -> usize {
    let mut count = 0;
    while let [high, low, ..] = rest {
        rest = &rest[3 + usize::from(u16::from_be_bytes([*high, *low]))..];
        count += 1;
    }
    count
}

#[test]
fn a_broker_that_grants_or_delivers_nothing_is_reported_nothing_and_asked_again() {
    for lie in [Lie::Mute, Lie::Refuses, Lie::Short, Lie::Deaf] {
        for version in [5, 4] {
            let (port, all) = lying(lie, version == 5);
            let place = Place::new();
            let keys = format!("version = {version}\nprobe_interval = \"200ms\"");
            let mut gateway = gateway_at(&place, port, &keys);
            let connections = until("three connections were given up", PATIENCE, || {
                let all = all.lock().unwrap();
                (all.len() > 3).then(|| all[..3].to_vec())
            });
            let reason = match lie {
                Lie::Mute => "the broker did not answer the subscription",
                Lie::Refuses | Lie::Short => "the broker did not grant every subscription",
                Lie::Deaf => "the probe did not come back",
            };
            gateway.wait_for(reason, |line| line.contains(reason).then_some(()));
            for seen in connections {
                assert!(
                    seen.has_subscribed,
                    "{lie:?}, version {version}: on every connection"
                );
                let others = seen
                    .published
                    .iter()
                    .filter(|topic| *topic != "vfd/plant/probe")
                    .count();
                assert_eq!(
                    others, 0,
                    "{lie:?}, version {version}: {:?}",
                    seen.published
                );
                assert_eq!(
                    seen.published.is_empty(),
                    lie != Lie::Deaf,
                    "{lie:?}, version {version}"
                );
            }
            gateway.kill();
        }
    }
}
