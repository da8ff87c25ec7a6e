//! Frames from gateway to gateway on a line that they share. No drive answers them.
//!
//! Each has the form of a read from a station that no drive may have (248 to 255 are reserved, MODBUS over serial line V1.02,
//! 2.2), as if a drive were missing: every device on the line knows where it ends. Its address is the number of the sender: a
//! copy of one's own is an echo, any other comes from another gateway.

use super::pdu::Request;
use crate::domain::address::{Address, DataTable};
use crate::domain::command::Direction;
use crate::domain::ids::Station;

/// The station number to which signals are addressed.
pub const STATION: Station = Station(0xFA);

/// Length of a signal's PDU, in bytes.
pub const PDU_BYTES: usize = 5;

/// The number of words that says: I am active.
const ACTIVE_WORDS: u16 = 86;
/// The number of words that says: take the line over.
const HAND_OVER_WORDS: u16 = 70;

/// The number of words that asks: who listens?
const QUESTION_WORDS: u16 = 63;
/// The number of words that says: I listen.
const LISTENING_WORDS: u16 = 76;
/// The number of words that says: I listen, and my drives are not yours.
const DIFFERS_WORDS: u16 = 79;
/// The number of words of a digest of the sender's drives, which stands in the address.
const DIGEST_WORDS: u16 = 91;
/// The number of words of the order of a drive, which stand in the address.
const ORDER_WORDS: u16 = 94;

/// What a gateway says to the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalKind {
    /// The sender is active.
    Active,
    /// The sender leaves the line, and asks the next one to take it over: nothing is silent for long, and no drive is stopped.
    HandOver,
    /// The sender is active, and asks whether another one listens.
    Question,
    /// The sender listens: the answer to a question.
    Listening,
    /// The sender listens, and its drives differ from those of the gateway that asks.
    Differs,
}

impl SignalKind {
    /// Whether it comes from a gateway that only listens.
    #[must_use]
    pub const fn is_of_listener(self) -> bool {
        matches!(self, Self::Listening | Self::Differs)
    }
}

/// What the active gateway tells the others, without saying who it is: a copy of it means nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalWord {
    /// A digest of its drives on the line.
    Digest(u16),
    /// The order by which the drive at this station runs; `None`: it runs, and not by an order over the line.
    Order(Station, Option<Direction>),
}

impl SignalWord {
    /// The request that says it.
    #[must_use]
    pub const fn request(self) -> Request {
        let (number, count) = match self {
            Self::Digest(digest) => (digest, DIGEST_WORDS),
            Self::Order(station, order) => {
                let order = match order {
                    None => 0,
                    Some(Direction::Forward) => 1,
                    Some(Direction::Reverse) => 2,
                };
                (u16::from_be_bytes([station.0, order]), ORDER_WORDS)
            }
        };
        Request::Read {
            address: Address::holding(number),
            count,
        }
    }

    /// What the frame for `station` with `pdu` tells, if it is of this kind.
    #[must_use]
    pub fn decode(station: Station, pdu: &[u8]) -> Option<Self> {
        let (number, count) = read_of_signal(station, pdu)?;
        match (count, number.to_be_bytes()) {
            (DIGEST_WORDS, _) => Some(Self::Digest(number)),
            (ORDER_WORDS, [station, 0]) => Some(Self::Order(Station(station), None)),
            (ORDER_WORDS, [station, 1]) => {
                Some(Self::Order(Station(station), Some(Direction::Forward)))
            }
            (ORDER_WORDS, [station, 2]) => {
                Some(Self::Order(Station(station), Some(Direction::Reverse)))
            }
            _ => None,
        }
    }
}

/// One frame of a gateway to the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signal {
    /// What it says.
    pub kind: SignalKind,
    /// Who sent it: a random number of this start of the gateway.
    pub sender: u16,
}

impl Signal {
    /// The request that says it.
    #[must_use]
    pub fn request(self) -> Request {
        let count = match self.kind {
            SignalKind::Active => ACTIVE_WORDS,
            SignalKind::HandOver => HAND_OVER_WORDS,
            SignalKind::Question => QUESTION_WORDS,
            SignalKind::Listening => LISTENING_WORDS,
            SignalKind::Differs => DIFFERS_WORDS,
        };
        Request::read(Address::holding(self.sender), count)
    }

    /// The signal in a frame for `station` with `pdu`, if it is one.
    #[must_use]
    pub fn decode(station: Station, pdu: &[u8]) -> Option<Self> {
        let (sender, count) = read_of_signal(station, pdu)?;
        let kind = match count {
            ACTIVE_WORDS => SignalKind::Active,
            HAND_OVER_WORDS => SignalKind::HandOver,
            QUESTION_WORDS => SignalKind::Question,
            LISTENING_WORDS => SignalKind::Listening,
            DIFFERS_WORDS => SignalKind::Differs,
            _ => return None,
        };
        Some(Self { kind, sender })
    }
}

/// The address and the number of words of a read from the station of signals.
fn read_of_signal(station: Station, pdu: &[u8]) -> Option<(u16, u16)> {
    if station != STATION {
        return None;
    }
    let Request::Read { address, count } = Request::decode(pdu)? else {
        return None;
    };
    (address.table() == DataTable::Holding).then(|| (address.number(), count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_what_it_was_and_nothing_else_is_one() {
        for kind in [
            SignalKind::Active,
            SignalKind::HandOver,
            SignalKind::Question,
            SignalKind::Listening,
            SignalKind::Differs,
        ] {
            let signal = Signal {
                kind,
                sender: 0xBEEF,
            };
            let mut pdu = Vec::new();
            signal.request().encode(&mut pdu);
            assert_eq!(
                (pdu.len(), Signal::decode(STATION, &pdu)),
                (PDU_BYTES, Some(signal))
            );
            assert_eq!(Signal::decode(Station(1), &pdu), None);
            for (place, value) in [(0, 4), (3, 1), (4, 1)] {
                let mut other = pdu.clone();
                other[place] = value;
                assert_eq!(Signal::decode(STATION, &other), None, "{place}");
            }
        }
    }

    #[test]
    fn a_word_is_what_it_was_and_no_signal() {
        for word in [
            SignalWord::Digest(0xBEEF),
            SignalWord::Order(Station(247), None),
            SignalWord::Order(Station(1), Some(Direction::Forward)),
            SignalWord::Order(Station(2), Some(Direction::Reverse)),
        ] {
            let mut pdu = Vec::new();
            word.request().encode(&mut pdu);
            assert_eq!(
                (pdu.len(), SignalWord::decode(STATION, &pdu)),
                (PDU_BYTES, Some(word))
            );
            assert_eq!(
                (
                    SignalWord::decode(Station(1), &pdu),
                    Signal::decode(STATION, &pdu)
                ),
                (None, None)
            );
        }
    }
}
