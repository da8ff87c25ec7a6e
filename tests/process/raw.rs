//! Modbus TCP by hand, for what no decent client would send.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Longer than any answer takes that the gateway owes: it gives up on a request after 5 s.
const ANSWER_WITHIN: Duration = Duration::from_secs(8);

/// One connection.
pub struct Raw {
    stream: TcpStream,
    transaction: u16,
}

impl From<TcpStream> for Raw {
    fn from(stream: TcpStream) -> Self {
        stream.set_read_timeout(Some(ANSWER_WITHIN)).unwrap();
        Self {
            stream,
            transaction: 0x4100,
        }
    }
}

impl Raw {
    pub fn connect(address: SocketAddr) -> Self {
        Self::try_connect(address).unwrap()
    }

    /// Nothing as long as nobody listens.
    pub fn try_connect(address: SocketAddr) -> Option<Self> {
        let stream = TcpStream::connect(address).ok()?;
        stream.set_nodelay(true).unwrap();
        Some(Self::from(stream))
    }

    /// Sends bytes as they are. The gateway may have closed the connection already.
    pub fn send(&mut self, bytes: &[u8]) {
        let _ = self.stream.write_all(bytes);
    }

    /// Sends `pdu` to `unit` and returns the PDU of the answer, whose header must be that of the request.
    pub fn ask(&mut self, unit: u8, pdu: &[u8]) -> Vec<u8> {
        self.try_ask(unit, pdu).unwrap()
    }

    /// Whether there is an answer to `pdu`; else the gateway has closed the connection.
    pub fn is_answered(&mut self, unit: u8, pdu: &[u8]) -> bool {
        self.try_ask(unit, pdu).is_ok()
    }

    fn try_ask(&mut self, unit: u8, pdu: &[u8]) -> std::io::Result<Vec<u8>> {
        self.transaction += 1;
        let [high, low] = self.transaction.to_be_bytes();
        let length = u8::try_from(pdu.len() + 1).unwrap();
        self.stream
            .write_all(&[&[high, low, 0, 0, 0, length, unit], pdu].concat())?;
        let mut header = [0; 7];
        self.stream.read_exact(&mut header)?;
        assert_eq!(header[..4], [high, low, 0, 0], "transaction and protocol");
        assert_eq!(header[6], unit, "unit");
        let mut answer = vec![0; usize::from(u16::from_be_bytes([header[4], header[5]])) - 1];
        self.stream.read_exact(&mut answer)?;
        Ok(answer)
    }

    /// Reads `count` words at `address` of unit 1: the words, or the code of the exception.
    pub fn read(&mut self, address: u16, count: u16) -> Result<Vec<u16>, u8> {
        self.read_unit(1, address, count)
    }

    /// Reads `count` words at `address` of `unit`: the words, or the code of the exception.
    pub fn read_unit(&mut self, unit: u8, address: u16, count: u16) -> Result<Vec<u16>, u8> {
        let ([a, b], [c, d]) = (address.to_be_bytes(), count.to_be_bytes());
        match self.ask(unit, &[3, a, b, c, d]).as_slice() {
            [0x83, code] => Err(*code),
            [3, bytes, words @ ..]
                if usize::from(*bytes) == words.len() && words.len() == 2 * usize::from(count) =>
            {
                Ok(words
                    .chunks(2)
                    .map(|word| u16::from_be_bytes([word[0], word[1]]))
                    .collect())
            }
            other => panic!("no answer to a read: {other:02X?}"),
        }
    }

    /// Writes one word at `address` of `unit`, or gives the code of the exception.
    pub fn write(&mut self, unit: u8, address: u16, word: u16) -> Result<(), u8> {
        let ([a, b], [c, d]) = (address.to_be_bytes(), word.to_be_bytes());
        match self.ask(unit, &[6, a, b, c, d]).as_slice() {
            [0x86, code] => Err(*code),
            answer if answer == [6, a, b, c, d] => Ok(()),
            other => panic!("no answer to a write: {other:02X?}"),
        }
    }

    /// Whether the gateway closes the connection without a word.
    pub fn is_closed_in_silence(&mut self) -> bool {
        let mut byte = [0];
        match self.stream.read(&mut byte) {
            Ok(bytes) => bytes == 0,
            Err(error) => error.kind() == ErrorKind::ConnectionReset,
        }
    }
}
