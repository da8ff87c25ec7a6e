//! A Modbus TCP client that writes single words, and may look at the clock between request and answer.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use crate::pipeline::request;

/// Longest wait for an answer; the gateway's own is shorter.
const PATIENCE: Duration = Duration::from_secs(20);

pub struct Commander {
    stream: TcpStream,
}

impl Commander {
    pub fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).expect("the gateway accepts");
        stream.set_nodelay(true).expect("TCP_NODELAY");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time-out");
        Self { stream }
    }

    /// Sends 06.
    pub fn send(&mut self, unit: u8, address: u16, value: u16) {
        self.stream
            .write_all(&request(1, unit, 6, [address, value]))
            .expect("the gateway takes requests");
    }

    /// Sends 03 and takes the answer.
    pub fn read(&mut self, unit: u8, address: u16, count: u16) -> Result<(), u8> {
        self.stream
            .write_all(&request(1, unit, 3, [address, count]))
            .expect("the gateway takes requests");
        self.answer()
    }

    /// Waits for the answer: success, or an exception code.
    pub fn answer(&mut self) -> Result<(), u8> {
        let mut header = [0; 8];
        self.stream.read_exact(&mut header).expect("an answer");
        let mut rest = vec![0; usize::from(u16::from_be_bytes([header[4], header[5]])) - 2];
        self.stream
            .read_exact(&mut rest)
            .expect("the rest of the answer");
        if header[7] < 0x80 {
            Ok(())
        } else {
            Err(rest[0])
        }
    }

    /// Sends 06 and waits for the answer; repeats it while the gateway refuses it.
    pub fn insist(&mut self, unit: u8, address: u16, value: u16) {
        let mut codes = Vec::new();
        while codes.len() < 400 {
            self.send(unit, address, value);
            match self.answer() {
                Ok(()) => return,
                Err(code) => codes.push(code),
            }
            std::thread::sleep(Duration::from_millis(25));
        }
        codes.dedup();
        panic!("word {address} = {value} is refused for ever: exceptions {codes:?}");
    }
}
