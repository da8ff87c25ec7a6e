//! One exchange: its request, how it ends, and which answer ends it.

use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficKind;
use crate::wire::pdu::{Reply, Request, function};
use std::time::Duration;

/// A request to one station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// The addressed station.
    pub station: Station,
    /// The request.
    pub request: Request,
    /// Longest wait from the end of the request to the start of the reply.
    pub timeout: Duration,
    /// An exception, or a write's reply with another value, could be the late answer to an earlier request
    /// of the same function: neither is accepted as the answer to this one.
    pub in_doubt: bool,
}

/// How an exchange ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ExchangeEnding {
    /// With the valid reply.
    Reply(Reply),
    /// With an exception of the drive's own.
    Exception(u8),
    /// Without a sound frame of the station in time; the data received looks like the reply, but is damaged. It may
    /// have been something else, so that the reply still arrives late.
    Garbled,
    /// Without any frame of the station in time.
    Silent,
}

/// Data received on the wire. The bytes are for observers of the traffic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeardData {
    /// What it was.
    pub kind: TrafficKind,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// The latest moment at which the first byte may have begun.
    pub begin: MonoTime,
    /// When the last byte was read.
    pub end: MonoTime,
}

/// How `pdu`, sent by the addressed station, ends the exchange; `None` if it does not answer it.
pub(super) fn answer_in(exchange: &Exchange, pdu: &[u8]) -> Option<ExchangeEnding> {
    if let [code, exception] = pdu
        && *code == exchange.request.function() | function::EXCEPTION_BIT
    {
        let answers = !exchange.in_doubt && exchange.request.is_answered_by(*exception);
        return answers.then_some(ExchangeEnding::Exception(*exception));
    }
    let reply = exchange.request.reply_in(pdu)?;
    match (&exchange.request, &reply) {
        (Request::WriteSingle { value, .. }, Reply::Holds { value: held })
            if exchange.in_doubt && value != held =>
        {
            None
        }
        _ => Some(ExchangeEnding::Reply(reply)),
    }
}

/// Whether `pdu` answers `request`, as its reply or as an exception.
#[must_use]
pub fn answers(request: &Request, pdu: &[u8]) -> bool {
    match pdu {
        [code, _] => *code == request.function() | function::EXCEPTION_BIT,
        _ => request.reply_in(pdu).is_some(),
    }
}
