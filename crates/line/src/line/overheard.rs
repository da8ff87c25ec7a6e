//! What a listener understands of the traffic between another master and the drives: requests and replies, paired.

use super::exchange::{Exchange, ExchangeEnding, answer_in};
use crate::domain::ids::Station;
use crate::wire::pdu::Request;
use std::time::Duration;

/// What one more frame of the line means.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OverheardFrame {
    /// Another master asks or orders; the answer is awaited. `unanswered`: the station that did not answer the request
    /// before.
    Request {
        /// The station that the request is for.
        station: Station,
        /// What is asked or ordered.
        request: Request,
        /// The station of the request before, if that remained without an answer.
        unanswered: Option<Station>,
    },
    /// A station answered the request before.
    Answer {
        /// The station.
        station: Station,
        /// What was asked.
        request: Request,
        /// The reply or exception.
        ending: ExchangeEnding,
    },
    /// A frame that fits nothing: its request was not heard.
    Alone,
}

/// The request that was heard last, while its answer may follow.
#[derive(Debug, Default)]
pub struct RequestListener {
    open: Option<(Station, Request)>,
}

impl RequestListener {
    /// Forgets the request that waits for its answer.
    pub fn clear(&mut self) {
        self.open = None;
    }

    /// No answer can follow any more. Returns the station that did not answer, if one was asked.
    pub fn silent(&mut self) -> Option<Station> {
        self.open.take().map(|(station, _)| station)
    }

    /// Takes the next sound frame of the line, from or for `station`.
    pub fn take(&mut self, station: Station, pdu: &[u8]) -> OverheardFrame {
        if let Some((asked, request)) = self.open.take() {
            if let Some(ending) = (asked == station)
                .then(|| answer(station, &request, pdu))
                .flatten()
            {
                return OverheardFrame::Answer {
                    station,
                    request,
                    ending,
                };
            }
            return match Request::decode(pdu) {
                Some(next) => self.open_with(station, next, Some(asked)),
                None => OverheardFrame::Alone,
            };
        }
        match Request::decode(pdu) {
            Some(request) => self.open_with(station, request, None),
            None => OverheardFrame::Alone,
        }
    }

    fn open_with(
        &mut self,
        station: Station,
        request: Request,
        unanswered: Option<Station>,
    ) -> OverheardFrame {
        // A broadcast is not answered.
        let is_broadcast = station == Station(0);
        self.open = (!is_broadcast).then(|| (station, request.clone()));
        OverheardFrame::Request {
            station,
            request,
            unanswered,
        }
    }
}

fn answer(station: Station, request: &Request, pdu: &[u8]) -> Option<ExchangeEnding> {
    let exchange = Exchange {
        station,
        request: request.clone(),
        timeout: Duration::ZERO,
        in_doubt: false,
    };
    answer_in(&exchange, pdu)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::address::Address;
    use crate::wire::pdu::Reply;

    const ONE: Station = Station(1);
    const TWO: Station = Station(2);

    fn pdu(request: &Request) -> Vec<u8> {
        let mut out = Vec::new();
        request.encode(&mut out);
        out
    }

    #[test]
    fn each_answer_belongs_to_the_request_before_it() {
        let mut listener = RequestListener::default();
        let read = Request::read(Address::holding(2), 2);
        let write = Request::write(Address::holding(1), 3);
        let asked = |station, request: &Request, unanswered| OverheardFrame::Request {
            station,
            request: request.clone(),
            unanswered,
        };
        let answered = |station, request: &Request, ending| OverheardFrame::Answer {
            station,
            request: request.clone(),
            ending,
        };
        let words = [3, 4, 0, 5, 0, 6];
        let steps: Vec<(Station, Vec<u8>, OverheardFrame)> = vec![
            (ONE, words.to_vec(), OverheardFrame::Alone),
            (ONE, pdu(&read), asked(ONE, &read, None)),
            (
                ONE,
                words.to_vec(),
                answered(ONE, &read, ExchangeEnding::Reply(Reply::Words(vec![5, 6]))),
            ),
            (ONE, words.to_vec(), OverheardFrame::Alone),
            (TWO, pdu(&write), asked(TWO, &write, None)),
            (
                TWO,
                pdu(&write),
                answered(
                    TWO,
                    &write,
                    ExchangeEnding::Reply(Reply::Holds { value: 3 }),
                ),
            ),
            (TWO, pdu(&write), asked(TWO, &write, None)),
            (ONE, pdu(&read), asked(ONE, &read, Some(TWO))),
            (TWO, words.to_vec(), OverheardFrame::Alone),
            (ONE, pdu(&read), asked(ONE, &read, None)),
            (
                ONE,
                vec![0x83, 2],
                answered(ONE, &read, ExchangeEnding::Exception(2)),
            ),
            (Station(0), pdu(&write), asked(Station(0), &write, None)),
            (ONE, pdu(&write), asked(ONE, &write, None)),
        ];
        for (at, (station, pdu, expected)) in steps.into_iter().enumerate() {
            assert_eq!(listener.take(station, &pdu), expected, "step {at}");
        }
        listener.clear();
        assert_eq!(listener.take(ONE, &words), OverheardFrame::Alone);
    }
}
