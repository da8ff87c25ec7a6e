//! Frames from gateway to gateway on a line that they share. No drive answers them.
//!
//! Each has the form of a read from a station that no drive may have (248 to 255 are reserved, MODBUS over serial line V1.02,
//! 2.2), as if a drive were missing: every device on the line knows where it ends. Its address is the number of the sender: a
//! copy of one's own is an echo, any other comes from another gateway.

use super::pdu::Request;
use crate::domain::address::{Address, Table};
use crate::domain::ids::Station;

/// The station that they are for.
pub const STATION: Station = Station(0xFA);

/// Length of their PDU.
pub const PDU_BYTES: usize = 5;

/// The number of words that says: I am active.
const ACTIVE_WORDS: u16 = 86;
/// The number of words that says: take the line over.
const HAND_OVER_WORDS: u16 = 70;

/// The number of words that asks: who listens?
const QUESTION_WORDS: u16 = 63;
/// The number of words that says: I listen.
const LISTENING_WORDS: u16 = 76;

/// What a gateway says to the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalKind {
    /// It is active.
    Active,
    /// It gives the line up, and asks the next one to take it over: nothing is silent for long, and no drive is stopped.
    HandOver,
    /// It is active, and asks whether another one listens.
    Question,
    /// It listens: the answer to that.
    Listening,
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
        };
        Request::read(Address::holding(self.sender), count)
    }

    /// The signal in a frame for `station` with `pdu`, if it is one.
    #[must_use]
    pub fn decode(station: Station, pdu: &[u8]) -> Option<Self> {
        if station != STATION {
            return None;
        }
        let Request::Read { address, count } = Request::decode(pdu)? else { return None };
        let kind = match count {
            ACTIVE_WORDS => SignalKind::Active,
            HAND_OVER_WORDS => SignalKind::HandOver,
            QUESTION_WORDS => SignalKind::Question,
            LISTENING_WORDS => SignalKind::Listening,
            _ => return None,
        };
        (address.table() == Table::Holding).then_some(Self { kind, sender: address.number() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_what_it_was_and_nothing_else_is_one() {
        for kind in [SignalKind::Active, SignalKind::HandOver, SignalKind::Question, SignalKind::Listening] {
            let signal = Signal { kind, sender: 0xBEEF };
            let mut pdu = Vec::new();
            signal.request().encode(&mut pdu);
            assert_eq!((pdu.len(), Signal::decode(STATION, &pdu)), (PDU_BYTES, Some(signal)));
            assert_eq!(Signal::decode(Station(1), &pdu), None);
            for (place, value) in [(0, 4), (3, 1), (4, 1)] {
                let mut other = pdu.clone();
                other[place] = value;
                assert_eq!(Signal::decode(STATION, &other), None, "{place}");
            }
        }
    }
}
