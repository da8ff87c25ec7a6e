//! What a listener makes of the traffic between another gateway and the drives: their picture, and what was ordered.

use super::core::LineCore;
use super::event::LineEffect;
use super::note::DriveNote;
use crate::domain::address::Address;
use crate::domain::command::Order;
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficKind;
use crate::drive::decode;
use crate::drive::snapshot::DrivePresence;
use crate::line::exchange::{ExchangeEnding, HeardData};
use crate::line::overheard::OverheardFrame;
use crate::wire::framing;
use crate::wire::pdu::{Reply, Request};
use crate::wire::signal::{Signal, SignalKind, SignalWord};

impl LineCore {
    /// A listener takes what was `heard`; returns whether it did.
    pub(super) fn overhears(&mut self, now: MonoTime, heard: &HeardData) -> bool {
        // The reply to a stop of its own is none.
        let is_own =
            self.flight.is_some() && matches!(heard.kind, TrafficKind::Reply | TrafficKind::Echo);
        if !self.listens() || is_own {
            return false;
        }
        match heard.kind {
            TrafficKind::Noise => {
                self.counters.noise_bytes += heard.bytes.len() as u64;
                if let Some(share) = &mut self.share {
                    share.noise_heard();
                }
            }
            _ => {
                if let Some((station, pdu)) = framing::decode(self.timing.framing, &heard.bytes) {
                    self.overhear(now, heard.end, Station(station), &pdu);
                }
            }
        }
        true
    }

    pub(super) fn overhear(&mut self, now: MonoTime, at: MonoTime, station: Station, pdu: &[u8]) {
        let Some(share) = &mut self.share else { return };
        // Whatever follows a question ends the time for its answer.
        share.calls.end_answer();
        if let Some(word) = SignalWord::decode(station, pdu) {
            share.sound_heard(at);
            share.word_heard(at, word);
            return self.hears_word(at, word);
        }
        if let Some(signal) = Signal::decode(station, pdu) {
            if share.is_own(signal) {
                // The answer to a question has come back: what this adapter does is known before the line is needed.
                self.counters.echoes += 1;
                return self.echo.found();
            }
            share.sound_heard(at);
            return self.hears_signal(now, at, signal);
        }
        share.sound_heard(at);
        let drives = &self.drives;
        let is_known = |station| drives.at_station(station).is_some();
        match share.frame_heard(at, (station, pdu), is_known) {
            OverheardFrame::Alone => {}
            OverheardFrame::Request {
                station,
                request,
                unanswered,
            } => {
                self.is_unanswered(now, unanswered);
                self.overhear_order(at, station, &request);
            }
            OverheardFrame::Answer {
                station,
                request,
                ending,
            } => {
                if let Some(index) = self.drives.at_station(station) {
                    self.overhear_answer(now, at, index, &request, &ending);
                }
            }
        }
    }

    /// Another gateway has sent `signal`, which ended at `at`.
    fn hears_signal(&mut self, now: MonoTime, at: MonoTime, signal: Signal) {
        let may_accept = signal.kind != SignalKind::HandOver || self.knows_orders();
        let Some(share) = &mut self.share else { return };
        let unanswered = share.signal_heard(now, at, signal, may_accept);
        self.is_unanswered(now, unanswered);
        if !signal.kind.is_of_listener() {
            self.left_to_another();
        }
    }

    /// Another gateway has asked the drive at `station` in vain.
    fn is_unanswered(&mut self, now: MonoTime, station: Option<Station>) {
        let Some(index) = station.and_then(|station| self.drives.at_station(station)) else {
            return;
        };
        let Some(share) = &mut self.share else { return };
        if share.is_silent(index.get()) {
            self.drives[index].set_presence(now, DrivePresence::Offline, &mut self.effects);
        }
    }

    /// The active gateway tells something that its next frames build on.
    fn hears_word(&mut self, at: MonoTime, word: SignalWord) {
        if let SignalWord::Order(station, order) = word
            && let Some(index) = self.drives.at_station(station)
        {
            self.drives[index].work.order_received(order, at);
        }
    }

    /// Whether this listener knows by which order each drive runs: only then can it take the line without stopping one. Tells
    /// of those for which it does not.
    fn knows_orders(&mut self) -> bool {
        let unknown: Vec<_> = self
            .drives
            .iter()
            .filter(|drive| drive.work.lacks_order())
            .map(|it| it.index)
            .collect();
        for drive in &unknown {
            self.effects
                .push_back(LineEffect::Note(*drive, DriveNote::HandOverRefused));
        }
        unknown.is_empty()
    }

    /// Another gateway is active, and sees to what is declared for the drives.
    pub(super) fn left_to_another(&mut self) {
        let is_informed = self
            .share
            .as_ref()
            .is_some_and(|share| share.is_informed(self.effects.now()));
        self.drives
            .works_mut()
            .for_each(|work| work.left_to_another(is_informed, &mut self.effects));
    }

    /// The drives that the request `frame` stops, and whether it cuts their output off.
    pub(super) fn stops_in(&self, frame: &[u8]) -> Vec<(DriveIndex, bool)> {
        let Some((station, pdu)) = framing::decode(self.timing.framing, frame) else {
            return Vec::new();
        };
        let Some(request) = Request::decode(&pdu) else {
            return Vec::new();
        };
        let Some((address, values)) = written(&request) else {
            return Vec::new();
        };
        let is_for_all = self.broadcast.is_for_all(Station(station));
        let addressed = self
            .drives
            .iter()
            .filter(|drive| is_for_all || drive.setup.station == Station(station));
        let stopped = addressed.filter_map(|drive| {
            match decode::order_on(
                &drive.setup.model,
                drive.work.guard().bases(),
                address,
                values,
            ) {
                Ok(Order::Stop { .. }) => Some((drive.index, false)),
                Ok(Order::Coast) => Some((drive.index, true)),
                _ => None,
            }
        });
        stopped.collect()
    }

    /// Another gateway orders something, perhaps of all drives at once.
    fn overhear_order(&mut self, at: MonoTime, station: Station, request: &Request) {
        let Some((address, values)) = written(request) else {
            return;
        };
        let is_for_all = self.broadcast.is_for_all(station);
        for drive in self.drives.iter_mut() {
            if !is_for_all && drive.setup.station != station {
                continue;
            }
            // Memory that is older no longer answers reads.
            drive.order_heard(at);
            let order = decode::order_on(
                &drive.setup.model,
                drive.work.guard().bases(),
                address,
                values,
            );
            if let Ok(order) = order {
                drive.work.heard(&order, at, &mut self.effects);
            }
        }
    }

    fn overhear_answer(
        &mut self,
        now: MonoTime,
        at: MonoTime,
        index: DriveIndex,
        request: &Request,
        ending: &ExchangeEnding,
    ) {
        // The copy of a write may be its repetition, and no reply.
        if request.is_repeated_by_its_reply() {
            return;
        }
        if let Some(share) = &mut self.share {
            share.has_answered(index.get());
        }
        let drive = &mut self.drives[index];
        drive.station.is_there();
        drive.set_presence(now, DrivePresence::Online, &mut self.effects);
        let (Request::Read { address, .. }, ExchangeEnding::Reply(Reply::Words(words))) =
            (request, ending)
        else {
            return;
        };
        drive.overheard_at = Some(now);
        let is_wanted = drive.work.wants().any(|want| want.request == *request);
        if is_wanted {
            drive.take_words(now, at, (*address, words), &mut self.effects);
        } else {
            drive.take_read(now, at, (*address, words), &mut self.effects);
        }
    }
}

/// The values that `request` writes, and where.
const fn written(request: &Request) -> Option<(Address, &[u16])> {
    match request {
        Request::WriteSingle { address, value } => Some((*address, std::slice::from_ref(value))),
        Request::WriteMultiple { address, values } => Some((*address, values.as_slice())),
        Request::Read { .. } | Request::Loopback { .. } | Request::Unserved { .. } => None,
    }
}
