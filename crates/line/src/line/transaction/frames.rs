//! Takes frames out of the received data and classifies them.

use super::super::exchange::{Exchange, ExchangeEnding, answer_in};
use super::LineWire;
use crate::domain::ids::Station;
use crate::domain::traffic::TrafficKind;
use crate::wire::frame::FoundFrame;
use crate::wire::{framing, pdu};

impl LineWire {
    /// Removes the frames from the received data. `is_over`: silence has followed. Returns how the open exchange ended,
    /// if it did.
    pub(super) fn take_frames(&mut self, is_over: bool) -> Option<(Exchange, ExchangeEnding)> {
        let mut ended = None;
        while let Some(found) = self.next_frame(is_over) {
            self.note_noise(found.noise);
            let (kind, ending) = self.judge(&found.adu);
            let transaction = framing::transaction_of(self.timing.framing, &found.adu);
            transaction
                .into_iter()
                .for_each(|id| self.transactions.answered(id));
            self.note(kind, found.adu);
            if let Some(ExchangeEnding::Exception(code)) = ending
                && !self.assembler.sees_ends()
                && !is_over
            {
                self.open
                    .iter_mut()
                    .for_each(|open| open.exception = Some(code));
            } else if let Some(ending) = ending
                && let Some(open) = self.open.take()
            {
                self.own_echo.is_over();
                ended = Some((open.exchange, ending));
            }
        }
        if self.assembler.is_out_of_step() {
            self.is_out_of_step = true;
            let rest = self.assembler.clear();
            self.note(TrafficKind::Noise, rest);
        }
        ended
    }

    fn next_frame(&mut self, is_over: bool) -> Option<FoundFrame> {
        match &self.open {
            None if self.listens => self.assembler.take_any(),
            open => self
                .assembler
                .take_certain(open.as_ref().map(|open| &open.expected), is_over),
        }
    }

    /// Notes bytes that are no part of a reply. Among them may be the request of another gateway: a reply that is awaited
    /// does not hide it, and what looks like one inside a sound reply is none.
    pub(super) fn note_noise(&mut self, mut bytes: Vec<u8>) {
        while let Some(place) = self
            .listens
            .then(|| framing::find_read_request(self.timing.framing, &bytes))
            .flatten()
        {
            let rest = bytes.split_off(place.end);
            let request = bytes.split_off(place.start);
            self.note(TrafficKind::Noise, bytes);
            self.note(TrafficKind::OtherMaster(Station(request[0])), request);
            bytes = rest;
        }
        self.note(TrafficKind::Noise, bytes);
    }

    /// Classifies a sound frame: our answer, another station's or master's, or one that is late.
    fn judge(&self, adu: &[u8]) -> (TrafficKind, Option<ExchangeEnding>) {
        let frame = framing::decode(self.timing.framing, adu);
        let Some((station, pdu)) = frame else {
            return (TrafficKind::Noise, None);
        };
        // A connection has no other master.
        if pdu::is_request(&pdu) && !self.timing.framing.identifies_replies() {
            return (TrafficKind::OtherMaster(Station(station)), None);
        }
        let stray = TrafficKind::Stray(Station(station));
        let Some(open) = &self.open else {
            return (stray, None);
        };
        if framing::transaction_of(self.timing.framing, adu) != open.transaction {
            return (stray, None);
        }
        if station != open.expected.station {
            return (TrafficKind::Foreign(Station(station)), None);
        }
        if self.last_byte_at < open.sent_until {
            // No station answers a request before it is complete.
            return (stray, None);
        }
        match answer_in(&open.exchange, &pdu) {
            Some(ending) => (TrafficKind::Reply, Some(ending)),
            None => (stray, None),
        }
    }
}
