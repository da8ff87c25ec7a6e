//! The side of the clients: O3 and O7. Each has its own parser of Modbus TCP.

use super::log::What;
use super::wire::{Exchange, Truth, WORDS};
use super::{Checker, orders};

/// The longest time of a request without an answer: the 5 s after which clients get one, and a moment.
const ANSWERED_WITHIN: u64 = 5_000_000_000;
/// Requests of one client in flight: 16, and a stop for each unit.
const PENDING: usize = 24;

/// The kind of a request, as far as its answer can be checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// Words of a drive's own registers.
    Native {
        drive: usize,
        address: u16,
        count: u16,
    },
    /// Words of a drive's view.
    Picture {
        drive: usize,
        address: u16,
        count: u16,
    },
    /// A write to a drive: the number of the order that it may be.
    Order { drive: usize, order: u64 },
    /// STOP for all drives.
    StopAll { order: u64 },
    /// A request for no drive.
    Other,
    /// A write that is not allowed.
    Never,
    /// A unit that does not exist.
    Nobody,
}

/// A request without its answer.
#[derive(Clone, Copy, Debug)]
pub struct Pending {
    pub transaction: u16,
    pub unit: u8,
    pub function: u8,
    pub at: u64,
    pub ask: Ask,
    /// The first four bytes after the function.
    pub head: [u8; 4],
}

/// One connection.
#[derive(Debug, Default)]
pub struct Client {
    sent: Vec<u8>,
    got: Vec<u8>,
    pub pending: Vec<Pending>,
    /// The bytes sent are no longer valid Modbus TCP.
    is_broken: bool,
}

impl Checker {
    /// A client connected in place of one that has left.
    pub fn client_opened(&mut self, at: u64, who: usize) {
        self.log.add(at, What::Client, who as u16, b"connects");
        self.clients[who] = Client::default();
    }

    /// A client's connection is closed: no more answers are expected.
    pub fn client_closed(&mut self, at: u64, who: usize, by_gateway: bool) {
        self.log.add(
            at,
            What::Client,
            who as u16,
            if by_gateway { b"is closed" } else { b"leaves" },
        );
        let gone = std::mem::take(&mut self.clients[who]);
        for request in &gone.pending {
            if let Ask::Order { drive, order } = request.ask {
                self.nobody_is_told(drive, order);
            }
        }
    }

    /// A client sent `bytes`.
    pub fn client_sent(&mut self, at: u64, who: usize, bytes: &[u8]) {
        self.log.add(at, What::ClientSent, who as u16, bytes);
        self.time(at);
        let mut stream = std::mem::take(&mut self.clients[who].sent);
        stream.extend_from_slice(bytes);
        let mut used = 0;
        while !self.clients[who].is_broken {
            match cut(&stream[used..]) {
                Cut::More => break,
                Cut::Broken => self.clients[who].is_broken = true,
                Cut::Message(length) => {
                    self.asked(at, who, &stream[used..used + length]);
                    used += length;
                }
            }
        }
        stream.drain(..used);
        self.clients[who].sent = stream;
    }

    fn asked(&mut self, at: u64, who: usize, message: &[u8]) {
        let transaction = u16::from_be_bytes([message[0], message[1]]);
        let unit = message[6];
        let pdu = &message[7..];
        let ask = self.ask_of(at, who, unit, pdu);
        let mut head = [0; 4];
        head.iter_mut()
            .zip(&pdu[1..])
            .for_each(|(to, from)| *to = *from);
        self.counts.requests += 1;
        self.clients[who].pending.push(Pending {
            transaction,
            unit,
            function: pdu[0],
            at,
            ask,
            head,
        });
    }

    fn ask_of(&mut self, at: u64, who: usize, unit: u8, pdu: &[u8]) -> Ask {
        let native = self.line.drives.iter().position(|drive| drive.unit == unit);
        let uniform = self
            .line
            .drives
            .iter()
            .position(|drive| drive.uniform == unit);
        let word = |at: usize| {
            pdu.get(at..at + 2)
                .map_or(0, |it| u16::from_be_bytes([it[0], it[1]]))
        };
        match (native, uniform, pdu[0]) {
            (Some(drive), _, 3 | 4) => Ask::Native {
                drive,
                address: word(1),
                count: word(3),
            },
            (_, Some(drive), 3 | 4) => Ask::Picture {
                drive,
                address: word(1),
                count: word(3),
            },
            (_, _, function)
                if (native, uniform) != (None, None) && !matches!(function, 5 | 6 | 15 | 16) =>
            {
                Ask::Other
            }
            (Some(drive), ..) => self.order(at, who, drive, |facts| orders::of_native(facts, pdu)),
            (_, Some(drive), _) => self.order(at, who, drive, |_| orders::of_uniform(pdu)),
            (None, None, 5) if unit == 255 && word(1) == 0 && word(3) == 0xFF00 => Ask::StopAll {
                order: self.stop_all(at, who),
            },
            (None, None, _) if unit == 255 || unit == 0 => Ask::Other,
            (None, None, _) => Ask::Nobody,
        }
    }

    /// A client received `bytes`.
    pub fn client_got(&mut self, at: u64, who: usize, bytes: &[u8]) {
        self.log.add(at, What::ClientGot, who as u16, bytes);
        if self.clients[who].got.is_empty() {
            let used = self.take_answers(at, who, bytes);
            self.clients[who].got.extend_from_slice(&bytes[used..]);
            return;
        }
        let mut stream = std::mem::take(&mut self.clients[who].got);
        stream.extend_from_slice(bytes);
        let used = self.take_answers(at, who, &stream);
        stream.drain(..used);
        self.clients[who].got = stream;
    }

    fn take_answers(&mut self, at: u64, who: usize, stream: &[u8]) -> usize {
        let mut used = 0;
        loop {
            match cut(&stream[used..]) {
                Cut::More => return used,
                Cut::Broken => {
                    self.object("O3", || {
                        format!("an answer that is no Modbus TCP: {:02X?}", &stream[used..])
                    });
                    return stream.len();
                }
                Cut::Message(length) => {
                    self.got_answer(at, who, &stream[used..used + length]);
                    used += length;
                }
            }
        }
    }

    fn got_answer(&mut self, at: u64, who: usize, message: &[u8]) {
        let transaction = u16::from_be_bytes([message[0], message[1]]);
        let unit = message[6];
        let pdu = &message[7..];
        let pending = &mut self.clients[who].pending;
        let Some(place) = pending
            .iter()
            .position(|it| it.transaction == transaction && it.unit == unit)
        else {
            return self.object("O3", || {
                format!("an answer that no client waits for: {message:02X?}")
            });
        };
        let request = pending.remove(place);
        self.counts.answers += 1;
        if pdu[0] & 0x7F != request.function & 0x7F {
            return self.object("O3", || {
                format!("function {:02X} answers {:02X}", pdu[0], request.function)
            });
        }
        if pdu[0] & 0x80 != 0 {
            let code = pdu.get(1).copied().unwrap_or(0);
            self.counts.exceptions += 1;
            if let Ask::Order { drive, order } = request.ask {
                self.order_excepted(at, drive, order, code);
            }
            return;
        }
        match request.ask {
            Ask::Native {
                drive,
                address,
                count,
            } => self.check_words(&request, drive, address, count, pdu),
            Ask::Picture {
                drive,
                address,
                count,
            } => self.check_picture(at, drive, address, count, pdu),
            Ask::Order { drive, order } => {
                let echoes = match request.function {
                    5 | 6 | 15 | 16 => pdu.get(1..5) == Some(&request.head[..]),
                    _ => true,
                };
                if !echoes {
                    self.object("O3", || {
                        format!("a write of {:02X?} is answered {pdu:02X?}", request.head)
                    });
                }
                self.order_succeeded(at, drive, order);
            }
            Ask::StopAll { order } => self.all_stopped(at, order),
            Ask::Other => {}
            Ask::Never => self.object("O8", || {
                format!("a write that nothing allows is answered {pdu:02X?}")
            }),
            Ask::Nobody => self.object("O3", || {
                format!("unit {unit} is nobody and answers {pdu:02X?}")
            }),
        }
    }

    /// O3: the words are those that the drive gave in exchanges that began after the question; where one frame brings
    /// all, in the exchange that has just ended.
    fn check_words(
        &mut self,
        request: &Pending,
        drive: usize,
        address: u16,
        count: u16,
        pdu: &[u8],
    ) {
        let station = self.line.drives[drive].station;
        let most = self.line.drives[drive].kind.facts().most_words;
        let is_right_length =
            pdu.len() == 2 + 2 * usize::from(count) && usize::from(pdu[1]) == pdu.len() - 2;
        let mut left = if count >= 128 {
            u128::MAX
        } else {
            (1_u128 << count) - 1
        };
        let mut back = 0;
        while left != 0 && is_right_length {
            let Some(it) = self.wire.back(back).filter(|it| it.at >= request.at) else {
                break;
            };
            let offset = it.address.wrapping_sub(address);
            let is_part = it.station == station
                && it.function == 3
                && offset < count
                && it.count <= count - offset;
            if is_part && is_given(it, pdu, offset) {
                left &= !(((1_u128 << it.count) - 1) << offset);
            } else if back == 0 {
                break;
            }
            back += 1;
            if count <= most {
                break;
            }
        }
        if left != 0 {
            self.object("O3", || {
                format!("{pdu:02X?} for {count} words from {address:04X} of station {station} is not what it gave")
            });
        }
        self.counts.words_checked += u64::from(count);
    }

    /// O7: no client waits longer than promised.
    pub fn check_waiting(&mut self, at: u64) {
        for who in 0..self.clients.len() {
            let pending = &self.clients[who].pending;
            // While the gateway is suspended, no request is answered.
            let (from, until) = self.stood;
            let excuse = |asked: u64| {
                if asked < until {
                    until - from + ANSWERED_WITHIN
                } else {
                    0
                }
            };
            let oldest = pending.first().map(|it| it.at);
            if oldest.is_some_and(|oldest| at > oldest + ANSWERED_WITHIN + excuse(oldest))
                || pending.len() > PENDING
            {
                let text = format!("client {who} waits for {:?}", pending.first());
                self.object("O7", || text);
            }
        }
    }
}

/// Whether the words of `pdu` from `offset` on are what the drive gave in `exchange`.
fn is_given(exchange: &Exchange, pdu: &[u8], offset: u16) -> bool {
    let is_whole = exchange.truth == Truth::Words(usize::from(exchange.count).min(WORDS) as u8);
    let mut words = (0..exchange.count).map(|place| {
        (
            word_of(pdu, offset + place),
            exchange.words[usize::from(place)],
        )
    });
    is_whole && exchange.heard_at.is_some() && words.all(|(got, given)| got == given)
}

fn word_of(pdu: &[u8], place: u16) -> u16 {
    let at = 2 + 2 * usize::from(place);
    u16::from_be_bytes([pdu[at], pdu[at + 1]])
}

/// The message at the start of a stream.
enum Cut {
    More,
    Broken,
    Message(usize),
}

/// Transaction, protocol 0, length of what follows: 2 to 254.
fn cut(stream: &[u8]) -> Cut {
    if stream.len() < 6 {
        return Cut::More;
    }
    let length = usize::from(u16::from_be_bytes([stream[4], stream[5]]));
    if stream[2..4] != [0, 0] || !(2..=254).contains(&length) {
        return Cut::Broken;
    }
    if stream.len() < 6 + length {
        Cut::More
    } else {
        Cut::Message(6 + length)
    }
}
