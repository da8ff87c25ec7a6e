//! The traffic on a line in words: each frame with its station, its registers by the model's names, values in their
//! units.
//!
//! A reply says little without its request, so a [`TrafficDecoder`] sees the frames of one line in order. It keeps only the
//! last request.

mod frame;
mod json;
pub mod packets;
pub mod pcapng;
mod register;
mod reply;
mod request;
#[cfg(test)]
mod tests;

use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{FramePurpose, TrafficKind, TrafficRecord};
use crate::wire::framing;
use frame::{FrameText, OpenRequest};
pub use frame::{FrameValue, KnownDrive, LineFacts, TrafficFrame};

/// Decodes the frames of one line, in order.
#[derive(Debug)]
pub struct TrafficDecoder {
    facts: LineFacts,
    asked: Option<OpenRequest>,
    last_end: Option<MonoTime>,
}

impl TrafficDecoder {
    /// A decoder that has seen nothing yet.
    #[must_use]
    pub const fn new(facts: LineFacts) -> Self {
        Self {
            facts,
            asked: None,
            last_end: None,
        }
    }

    /// Some frames were missed: the next one is treated as the first.
    pub fn skip(&mut self) {
        self.asked = None;
        self.last_end = None;
    }

    /// The next frame in words.
    pub fn decode(&mut self, record: &TrafficRecord) -> TrafficFrame {
        let gap = self.last_end.map(|end| record.begin.since(end));
        self.last_end = Some(self.last_end.map_or(record.end, |end| end.max(record.end)));
        let whole = match record.kind {
            TrafficKind::Noise => None,
            _ => framing::decode(self.facts.framing, &record.bytes),
        };
        let (station, drive) = match &whole {
            Some((station, _)) => (Some(Station(*station)), self.drive_at(*station)),
            None => (None, None),
        };
        let said = match &whole {
            Some((station, pdu)) => self.frame(record, *station, pdu),
            None => FrameText::text(reply::damaged(
                self.facts.framing,
                &record.bytes,
                self.asked.as_ref(),
            )),
        };
        let frame = TrafficFrame {
            kind: record.kind,
            why: record.why,
            gap,
            on_wire: record.end.since(record.begin),
            station,
            drive: drive.map(|drive| drive.name.clone()),
            function: whole.as_ref().and_then(|(_, pdu)| pdu.first()).copied(),
            exception: said.exception,
            text: said.text,
            values: said.values,
        };
        match (record.kind, whole) {
            (TrafficKind::Request, Some((station, pdu))) => {
                self.asked = Some(OpenRequest {
                    station,
                    pdu: pdu.into_owned(),
                    why: record.why,
                });
            }
            (TrafficKind::Reply, _) => self.asked = None,
            _ => {}
        }
        frame
    }

    fn frame(&self, record: &TrafficRecord, station: u8, pdu: &[u8]) -> FrameText {
        let drive = self.drive_at(station);
        match record.kind {
            TrafficKind::Request => {
                let is_for_all = drive.is_none() && self.is_for_all(station);
                let drive = if is_for_all { self.any_drive() } else { drive };
                let said = request::request_text(drive, pdu);
                FrameText {
                    text: format!("{}{}", prefix(is_for_all, record.why), said.text),
                    ..said
                }
            }
            TrafficKind::OtherMaster(_) => {
                let said = request::request_text(drive, pdu);
                FrameText {
                    text: format!("another master requests: {}", said.text),
                    ..said
                }
            }
            TrafficKind::Echo => FrameText::text("our own frame came back"),
            TrafficKind::Reply => reply::reply_text(
                drive,
                pdu,
                self.asked.as_ref().filter(|asked| asked.station == station),
            ),
            TrafficKind::Stray(_) | TrafficKind::Foreign(_) | TrafficKind::Noise => {
                reply::reply_text(drive, pdu, None)
            }
        }
    }

    fn drive_at(&self, station: u8) -> Option<&KnownDrive> {
        self.facts
            .drives
            .iter()
            .find(|drive| drive.station.0 == station)
    }

    /// Whether no drive has this station and it addresses all.
    fn is_for_all(&self, station: u8) -> bool {
        let names_all = |drive: &KnownDrive| {
            drive
                .model
                .link
                .broadcast
                .as_ref()
                .is_some_and(|broadcast| broadcast.station.value == station)
        };
        station == 0 || self.facts.drives.iter().any(names_all)
    }

    /// A drive that represents all, if all are the same.
    fn any_drive(&self) -> Option<&KnownDrive> {
        let (first, others) = self.facts.drives.split_first()?;
        others
            .iter()
            .all(|other| other.model.id == first.model.id)
            .then_some(first)
    }
}

const fn prefix(is_for_all: bool, why: Option<FramePurpose>) -> &'static str {
    match why {
        _ if is_for_all => "to all: ",
        Some(FramePurpose::Barrier) => "barrier: ",
        Some(FramePurpose::Trial) => "trial of a barrier: ",
        Some(FramePurpose::Probe) => "looking for an echo: ",
        _ => "",
    }
}
