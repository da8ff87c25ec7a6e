//! An observer that sees the wire, the north sides and the numbers of the configuration, but nothing inside the
//! gateway. It shares no code and no addresses with what it checks: CRC, parsers, registers and values are its own.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `wire` | exchanges; O5, O6 |
//! | `clients` | requests of clients and their answers; O3, O7 |
//! | `orders` | orders and their results; O4, O8 |
//! | `written` | what is written and why; O1, O2 |
//! | `book` | the known state of one drive |
//! | `messages` | commands and results over MQTT |
//! | `picture` | what is served from memory; O13 |
//! | `kept` | what is kept, and what a restart may do; O9, O14 |
//! | `lease` | stops that must be sent, clients that stop responding; L1, O11 |
//! | `motor` | the true state of the motors, and what is reported of them; M1 to M5 |
//! | `tables` | numbers typed from the vendors' manuals |
//! | `crc`, `log` | the check of frames; the last events as text |

pub mod book;
pub mod clients;
pub mod crc;
pub mod kept;
mod lease;
pub mod log;
pub mod messages;
pub mod motor;
pub mod orders;
mod picture;
pub mod tables;
pub mod wire;
mod written;

use book::Book;
use clients::Client;
use log::{Log, What};
use messages::Messages;
use motor::Motor;

use tables::Line;
use wire::Wire;

/// A violation of an invariant.
#[derive(Clone, Debug)]
pub struct Violation {
    /// Which invariant.
    pub rule: &'static str,
    pub text: String,
    /// At which moment (ns) and after how many exchanges.
    pub at: u64,
    pub exchange: u64,
    /// The last events as text.
    pub events: String,
}

/// Counts of what was checked.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    pub requests: u64,
    pub answers: u64,
    pub exceptions: u64,
    pub words_checked: u64,
    pub pictures: u64,
    pub writes: u64,
    pub replies: u64,
    /// Sound replies of the right form that the drive gave in another exchange.
    pub mistakable: u64,
    pub messages: u64,
    pub results: u64,
    /// Run states that were compared with the truth.
    pub states: u64,
}

/// The observer.
#[derive(Debug)]
pub struct Checker {
    pub line: Line,
    pub log: Log,
    pub wire: Wire,
    pub clients: Vec<Client>,
    pub books: Vec<Book>,
    pub counts: Counts,
    messages: Messages,
    motors: Vec<Motor>,
    trips: Vec<kept::Trips>,
    attempts: kept::Attempts,
    /// There is a journal.
    pub keeps: bool,
    /// When the gateway was last suspended.
    stood: (u64, u64),
    order_count: u64,
    bound: u64,
    now: u64,
    checked_at: u64,
    found: Option<Violation>,
}

/// Interval of time-dependent checks, in ns.
const LOOK_EVERY: u64 = 100_000_000;

impl Checker {
    pub fn new(line: Line, clients: usize) -> Self {
        let mut checker = Self {
            log: Log::new(),
            wire: Wire::new(line.silence()),
            clients: (0..clients).map(|_| Client::default()).collect(),
            books: line.drives.iter().map(|_| Book::default()).collect(),
            counts: Counts::default(),
            messages: Messages::default(),
            motors: line.drives.iter().map(|_| Motor::default()).collect(),
            trips: line.drives.iter().map(|_| kept::Trips::default()).collect(),
            attempts: kept::Attempts::default(),
            keeps: false,
            stood: (0, 0),
            order_count: 0,
            bound: 0,
            now: 0,
            checked_at: 0,
            found: None,
            line,
        };
        checker.bound = checker.bound();
        checker
    }

    /// Time advances to `at`. What happened before is settled.
    pub fn time(&mut self, at: u64) {
        if at > self.now {
            self.now = at;
            for drive in 0..self.books.len() {
                self.settle_stops(drive);
            }
        }
        if at >= self.checked_at + LOOK_EVERY {
            self.checked_at = at;
            self.check_waiting(at);
            self.check_leases(at);
            self.check_resets(at);
        }
    }

    /// The gateway is suspended until then.
    pub fn stands_still(&mut self, from: u64, until: u64) {
        self.note(from, 0, "the process stands still");
        self.stood = (from, until);
    }

    /// The gateway was suspended: no request was answered, and no frame was sent.
    pub fn stood_still(&mut self, from: u64, until: u64) {
        self.log.add(until, What::World, 0, b"the process goes on");
        self.stood = (from, until);
        self.wire.noise_at = until;
    }

    /// Something was done to drives or line that explains what follows.
    pub fn note(&mut self, at: u64, who: usize, text: &str) {
        self.log.add(at, What::World, who as u16, text.as_bytes());
    }

    /// Reports a violation that was found while executing the gateway's effects.
    pub fn says(&mut self, rule: &'static str, text: &str) {
        self.object(rule, || text.to_owned());
    }

    /// Keeps the first violation.
    fn object(&mut self, rule: &'static str, text: impl FnOnce() -> String) {
        if self.found.is_none() {
            let events = self.log.text();
            self.found = Some(Violation {
                rule,
                text: text(),
                at: self.now,
                exchange: self.wire.count(),
                events,
            });
        }
    }

    /// The first violation, if there is one.
    pub const fn violation(&self) -> Option<&Violation> {
        self.found.as_ref()
    }
}
