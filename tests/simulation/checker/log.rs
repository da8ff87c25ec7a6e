//! The last events, kept without allocations and formatted only when something is wrong.

use std::fmt::Write;

/// Events that are kept.
const KEPT: usize = 40;
/// Bytes of an event that are kept.
const BYTES: usize = 256;

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// A frame of the gateway.
    Frame,
    /// The reply of the addressed drive, before any fault.
    Truth,
    /// Bytes that the gateway was handed.
    Heard,
    /// Bytes of a client.
    ClientSent,
    /// Bytes for a client.
    ClientGot,
    /// A client connected or left.
    Client,
    /// The port was opened or lost.
    Port,
    /// A message for the gateway.
    Message,
    /// A message of the gateway.
    Published,
    /// Something was done to drives or line.
    World,
}

/// One event.
#[derive(Clone, Copy, Debug)]
struct Entry {
    at: u64,
    what: What,
    who: u16,
    length: u16,
    bytes: [u8; BYTES],
}

/// The last events, and a hash over all of them.
#[derive(Debug)]
pub struct Log {
    entries: Box<[Entry]>,
    next: usize,
    hash: u64,
}

impl Log {
    pub fn new() -> Self {
        let none = Entry {
            at: 0,
            what: What::World,
            who: 0,
            length: 0,
            bytes: [0; BYTES],
        };
        Self {
            entries: vec![none; KEPT].into(),
            next: 0,
            hash: 0xCBF2_9CE4_8422_2325,
        }
    }

    /// Keeps an event of `who` at `at` (ns).
    #[inline]
    pub fn add(&mut self, at: u64, what: What, who: u16, bytes: &[u8]) {
        let entry = &mut self.entries[self.next % KEPT];
        let kept = bytes.len().min(BYTES);
        entry.at = at;
        entry.what = what;
        entry.who = who;
        entry.length = bytes.len() as u16;
        entry.bytes[..kept].copy_from_slice(&bytes[..kept]);
        self.next += 1;
        self.mix(at ^ (what as u64) << 56 ^ u64::from(who) << 40);
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.mix(u64::from_le_bytes(word));
        }
    }

    #[inline]
    fn mix(&mut self, word: u64) {
        self.hash = (self.hash ^ word)
            .wrapping_mul(0x9E37_79B9_7F4A_7C15)
            .rotate_left(23);
    }

    /// A hash over all events so far.
    pub const fn hash(&self) -> u64 {
        self.hash
    }

    /// The last events as text, oldest first.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for place in self.next.saturating_sub(KEPT)..self.next {
            let entry = &self.entries[place % KEPT];
            let kept = usize::from(entry.length).min(BYTES);
            let _ = write!(
                text,
                "{:>16.6} ms {:<10} {:>4} ",
                entry.at as f64 / 1e6,
                format!("{:?}", entry.what),
                entry.who
            );
            match entry.what {
                What::Client | What::Port | What::Message | What::Published | What::World => {
                    text.push_str(&String::from_utf8_lossy(&entry.bytes[..kept]));
                }
                _ => entry.bytes[..kept]
                    .iter()
                    .for_each(|byte| _ = write!(text, "{byte:02X} ")),
            }
            text.push_str(if usize::from(entry.length) > kept {
                "...\n"
            } else {
                "\n"
            });
        }
        text
    }
}
