//! What a listener makes of the traffic between another gateway and the drives: their picture, and what was ordered.

use super::core::LineCore;
use crate::domain::ids::{DriveIndex, Station};
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficKind;
use crate::drive::decode;
use crate::drive::snapshot::Presence;
use crate::line::exchange::{Ending, Heard};
use crate::line::overheard::Overheard;
use crate::wire::framing;
use crate::wire::pdu::{Reply, Request};
use crate::wire::signal::Signal;

/// Requests in a row that a station leaves unanswered before a listener shows it as offline.
const SILENT_AFTER: u8 = 3;

impl LineCore {
    /// A listener takes what was `heard`; returns whether it did.
    pub(super) fn overhears(&mut self, now: MonoTime, heard: &Heard) -> bool {
        if !self.listens() {
            return false;
        }
        match heard.kind {
            TrafficKind::Noise => {
                self.counters.noise_bytes += heard.bytes.len() as u64;
                // It may have been another request: what answers it must not be taken for the answer to the last one.
                self.share.iter_mut().for_each(|share| share.listener.clear());
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
        share.answer = None;
        if let Some(signal) = Signal::decode(station, pdu) {
            if share.is_own(signal) {
                // The answer to a question has come back: what this adapter does is known before the line is needed.
                self.counters.echoes += 1;
                return self.echo.found();
            }
            let unanswered = share.heard_signal(now, at, signal);
            return self.is_unanswered(now, unanswered);
        }
        match share.listener.take(station, pdu) {
            // It may be the late one to a request of our own.
            Overheard::Alone => share.rule.heard_alone(at),
            Overheard::Request { station, request, unanswered } => {
                share.another_sends(at);
                self.is_unanswered(now, unanswered);
                self.overhear_order(at, station, &request);
            }
            Overheard::Answer { station, request, ending } => {
                share.another_sends(at);
                if let Some(index) = self.drives.at_station(station) {
                    self.overhear_answer(now, at, index, &request, &ending);
                }
            }
        }
    }

    /// Another gateway has asked the drive at `station` in vain.
    fn is_unanswered(&mut self, now: MonoTime, station: Option<Station>) {
        let Some(index) = station.and_then(|station| self.drives.at_station(station)) else { return };
        let Some(count) = self.share.as_mut().and_then(|share| share.unanswered.get_mut(index.get())) else { return };
        *count = count.saturating_add(1);
        if *count >= SILENT_AFTER {
            self.drives[index].set_presence(now, Presence::Offline, &mut self.effects);
        }
    }

    /// Another gateway orders something, perhaps of all drives at once.
    fn overhear_order(&mut self, at: MonoTime, station: Station, request: &Request) {
        let (address, values) = match request {
            Request::WriteSingle { address, value } => (*address, std::slice::from_ref(value)),
            Request::WriteMultiple { address, values } => (*address, values.as_slice()),
            Request::Read { .. } | Request::Loopback { .. } | Request::Unserved { .. } => return,
        };
        let is_for_all = station == Station(0) || self.all_stop_at == Some(station.0);
        for drive in self.drives.iter_mut() {
            if !is_for_all && drive.setup.station != station {
                continue;
            }
            // Memory that is older no longer answers reads.
            drive.order_heard(at);
            let order = decode::order_on(&drive.setup.model, drive.work.guard().bases(), address, values);
            if let Ok(order) = order {
                drive.work.heard(&order, at, &mut self.effects);
            }
        }
    }

    fn overhear_answer(&mut self, now: MonoTime, at: MonoTime, index: DriveIndex, request: &Request, ending: &Ending) {
        // The copy of a write may be its repetition, and no reply.
        if request.is_repeated_by_its_reply() {
            return;
        }
        if let Some(count) = self.share.as_mut().and_then(|share| share.unanswered.get_mut(index.get())) {
            *count = 0;
        }
        let drive = &mut self.drives[index];
        drive.station.is_there();
        drive.set_presence(now, Presence::Online, &mut self.effects);
        let (Request::Read { address, .. }, Ending::Reply(Reply::Words(words))) = (request, ending) else { return };
        let is_wanted = drive.work.wants().any(|want| want.request == *request);
        if is_wanted {
            drive.take_words(now, at, (*address, words), &mut self.effects);
        } else {
            drive.take_read(now, at, (*address, words), &mut self.effects);
        }
    }
}
