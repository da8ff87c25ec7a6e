//! A uniform unit played by the test: words that can be set, and a record of what was written.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

/// A Modbus TCP server with one map for all units. It serves until the test program ends.
pub struct StandIn {
    pub address: SocketAddr,
    unit: Arc<Mutex<Unit>>,
}

#[derive(Default)]
struct Unit {
    words: BTreeMap<u16, u16>,
    written: Vec<(u16, u16)>,
    /// Exception for writes to an address.
    refused: BTreeMap<u16, u8>,
}

impl StandIn {
    pub fn new(words: &[(u16, u16)]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let unit = Arc::new(Mutex::new(Unit {
            words: words.iter().copied().collect(),
            ..Unit::default()
        }));
        let served = Arc::clone(&unit);
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let unit = Arc::clone(&served);
                std::thread::spawn(move || serve(stream.unwrap(), &unit));
            }
        });
        Self { address, unit }
    }

    pub fn set(&self, address: u16, word: u16) {
        self.unit.lock().unwrap().words.insert(address, word);
    }

    /// Answers writes to `address` with `code` from now on.
    pub fn refuse(&self, address: u16, code: u8) {
        self.unit.lock().unwrap().refused.insert(address, code);
    }

    /// What was written so far, in order.
    pub fn written(&self) -> Vec<(u16, u16)> {
        self.unit.lock().unwrap().written.clone()
    }
}

/// Serves one client until it goes.
fn serve(mut stream: TcpStream, unit: &Mutex<Unit>) {
    let mut request = [0; 12];
    while stream.read_exact(&mut request).is_ok() {
        let answer = unit.lock().unwrap().answer(&request[7..]);
        let length = u8::try_from(answer.len() + 1).unwrap();
        let header = [request[0], request[1], 0, 0, 0, length, request[6]];
        // A client that has gone needs no answer.
        let _ = stream.write_all(&[&header, answer.as_slice()].concat());
    }
}

impl Unit {
    fn answer(&mut self, pdu: &[u8]) -> Vec<u8> {
        let number = |at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
        let (function, address, second) = (pdu[0], number(1), number(3));
        match function {
            3 => {
                let words: Option<Vec<u16>> = (0..second)
                    .map(|at| self.words.get(&(address + at)).copied())
                    .collect();
                let Some(words) = words else {
                    return vec![0x83, 2];
                };
                let bytes = words.iter().flat_map(|word| word.to_be_bytes());
                [3, u8::try_from(words.len() * 2).unwrap()]
                    .into_iter()
                    .chain(bytes)
                    .collect()
            }
            6 => match self.refused.get(&address) {
                Some(code) => vec![0x86, *code],
                None => {
                    self.words.insert(address, second);
                    self.written.push((address, second));
                    pdu.to_vec()
                }
            },
            _ => vec![function | 0x80, 1],
        }
    }
}
