//! Classifies damage in what drives send, from the bytes of each exchange: at the beginning, at the end or anywhere,
//! and unexpected data.

use super::fault::Fault;
use super::station::StrayFrame;
use crate::domain::counts::{DamageCounts, LONG_REPLY_PDU_BYTES};
use crate::domain::ids::Station;
use crate::domain::link::Framing;
use crate::domain::traffic::TrafficKind;
use crate::wire::framing;

/// Length of a frame's beginning up to the function: two bytes in RTU, ':' and four digits in ASCII, a header and one
/// byte in Modbus TCP.
const fn head_bytes(framing: Framing) -> usize {
    match framing {
        Framing::Rtu => 2,
        Framing::Ascii => 5,
        Framing::Mbap => 8,
    }
}

/// Counts damage of the stations of one line.
#[derive(Debug)]
pub struct DamageWatch {
    framing: Framing,
    stations: Vec<(Station, DamageCounts)>,
    /// How often bytes without a frame arrived while no reply was awaited.
    between: u64,
    /// The station addressed last, and the requested function.
    asked: usize,
    function: u8,
    /// Whether its exchange is still open.
    is_open: bool,
    /// Whether its reply has arrived.
    was_answered: bool,
    /// Bytes received since then that belong to no frame; at most two of the longest frames.
    loose: Vec<u8>,
}

impl DamageWatch {
    /// A line from which nothing has been received.
    pub fn new(framing: Framing, stations: impl Iterator<Item = Station>) -> Self {
        Self {
            framing,
            stations: stations
                .map(|station| (station, DamageCounts::default()))
                .collect(),
            between: 0,
            asked: 0,
            function: 0,
            is_open: false,
            was_answered: false,
            loose: Vec::new(),
        }
    }

    /// A request with `function` is sent to the station at `place`.
    pub fn sent(&mut self, place: usize, function: u8) {
        self.asked = place;
        self.function = function;
        self.is_open = true;
        self.was_answered = false;
        self.loose.clear();
    }

    /// `bytes` were received and classified as `kind`.
    pub fn heard(&mut self, kind: TrafficKind, bytes: &[u8]) {
        match kind {
            TrafficKind::Request | TrafficKind::Echo | TrafficKind::OtherMaster(_) => {}
            TrafficKind::Noise if self.was_answered || !self.is_open => self.between += 1,
            TrafficKind::Noise => {
                let room = 2 * framing::max_adu_bytes(self.framing) - self.loose.len();
                self.loose
                    .extend_from_slice(&bytes[..bytes.len().min(room)]);
            }
            TrafficKind::Reply => self.was_answered = true,
            TrafficKind::Stray(_) | TrafficKind::Foreign(_) => {}
        }
    }

    /// A frame of the station at `place` arrived that answers no open request.
    pub fn stray(&mut self, place: usize, stray: StrayFrame) {
        let Some((_, counts)) = self.stations.get_mut(place) else {
            return;
        };
        match stray {
            StrayFrame::Explained => counts.late += 1,
            StrayFrame::BeyondLimit(_) => {
                counts.late += 1;
                counts.beyond_limit += 1;
            }
            StrayFrame::TooMany(_) => counts.doubled += 1,
            // What it is, the end of the exchange tells.
            StrayFrame::WrongForm(_) => {}
        }
    }

    /// The exchange ended, with a `fault` or successfully; its valid reply has `reply_bytes`.
    pub fn ended(&mut self, fault: Option<Fault>, reply_bytes: usize) {
        self.is_open = false;
        let is_damaged =
            matches!(fault, Some(Fault::Garbled | Fault::Silent)) && !self.loose.is_empty();
        let is_head = is_damaged && self.is_head(reply_bytes);
        let is_cut = is_damaged && self.is_cut(reply_bytes);
        let is_long = reply_bytes >= framing::adu_bytes(self.framing, LONG_REPLY_PDU_BYTES);
        if let Some((_, counts)) = self.stations.get_mut(self.asked) {
            counts.damaged += u64::from(is_damaged);
            counts.head += u64::from(is_head);
            counts.cut += u64::from(is_cut);
            counts.led += u64::from(fault.is_none() && !self.loose.is_empty());
            counts.long += u64::from(is_long);
            counts.long_damaged += u64::from(is_long && is_damaged);
        }
        self.loose.clear();
    }

    /// The counts of the station at `place`.
    #[must_use]
    pub fn of(&self, place: usize) -> DamageCounts {
        self.stations
            .get(place)
            .map(|(_, counts)| *counts)
            .unwrap_or_default()
    }

    /// How often bytes without a frame arrived while no reply was awaited.
    #[must_use]
    pub const fn between(&self) -> u64 {
        self.between
    }

    /// Whether the reply is sound except for its first characters: with the right ones its check is right.
    fn is_head(&self, reply_bytes: usize) -> bool {
        let head = self.head();
        let missing = reply_bytes.saturating_sub(self.loose.len());
        if self.loose.len() > reply_bytes || missing > head.len() || self.loose.starts_with(&head) {
            return false;
        }
        let rest = self.loose.get(head.len() - missing..).unwrap_or_default();
        framing::decode(self.framing, &[&head, rest].concat()).is_some()
    }

    /// Whether the reply begins correctly but is too short.
    fn is_cut(&self, reply_bytes: usize) -> bool {
        self.loose.len() < reply_bytes && self.loose.starts_with(&self.head())
    }

    /// The beginning of a reply of the addressed station.
    fn head(&self) -> Vec<u8> {
        let station = self
            .stations
            .get(self.asked)
            .map_or(0, |(station, _)| station.0);
        let mut frame = Vec::new();
        framing::encode(self.framing, &mut frame, station, |pdu| {
            pdu.push(self.function)
        });
        frame.truncate(head_bytes(self.framing));
        frame
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// Reply of station 1 to a read of one word: 60.00 Hz.
    const RTU: [u8; 7] = [0x01, 0x03, 0x02, 0x17, 0x70, 0xB6, 0x50];
    const ASCII: &[u8] = b":010302177073\r\n";
    const READ: u8 = 3;

    fn watch(framing: Framing) -> DamageWatch {
        DamageWatch::new(framing, [Station(1), Station(2)].into_iter())
    }

    /// The counts after one exchange in which only these bytes arrive.
    fn after(framing: Framing, reply_bytes: usize, bytes: &[u8], fault: Fault) -> DamageCounts {
        let mut watch = watch(framing);
        watch.sent(0, READ);
        if !bytes.is_empty() {
            watch.heard(TrafficKind::Noise, bytes);
        }
        watch.ended(Some(fault), reply_bytes);
        watch.of(0)
    }

    #[test]
    fn beginning_and_end_of_a_damaged_reply_are_distinguished() {
        let with = |at: usize, byte: u8| {
            let mut reply = RTU;
            reply[at] = byte;
            reply.to_vec()
        };
        let ascii_with = |at: usize, byte: u8| {
            let mut reply = ASCII.to_vec();
            reply[at] = byte;
            reply
        };
        for (framing, whole, bytes, fault, [damaged, head, cut]) in [
            (Framing::Rtu, 7, Vec::new(), Fault::Silent, [0, 0, 0]),
            (Framing::Rtu, 7, with(4, 0x71), Fault::Garbled, [1, 0, 0]),
            (Framing::Rtu, 7, with(0, 0x81), Fault::Silent, [1, 1, 0]),
            (Framing::Rtu, 7, with(1, 0x07), Fault::Silent, [1, 1, 0]),
            (Framing::Rtu, 7, RTU[1..].to_vec(), Fault::Silent, [1, 1, 0]),
            (Framing::Rtu, 7, RTU[2..].to_vec(), Fault::Silent, [1, 1, 0]),
            (Framing::Rtu, 7, RTU[3..].to_vec(), Fault::Silent, [1, 0, 0]),
            (Framing::Rtu, 7, RTU[..5].to_vec(), Fault::Silent, [1, 0, 1]),
            (
                Framing::Rtu,
                7,
                [&[0xFF], &RTU[..]].concat(),
                Fault::Silent,
                [1, 0, 0],
            ),
            (
                Framing::Rtu,
                7,
                RTU[1..].to_vec(),
                Fault::Ignored,
                [0, 0, 0],
            ),
            (
                Framing::Ascii,
                15,
                ascii_with(6, b'1'),
                Fault::Garbled,
                [1, 0, 0],
            ),
            (
                Framing::Ascii,
                15,
                ascii_with(0, b'*'),
                Fault::Silent,
                [1, 1, 0],
            ),
            (
                Framing::Ascii,
                15,
                ASCII[1..].to_vec(),
                Fault::Silent,
                [1, 1, 0],
            ),
            (
                Framing::Ascii,
                15,
                ASCII[..9].to_vec(),
                Fault::Silent,
                [1, 0, 1],
            ),
        ] {
            let counts = after(framing, whole, &bytes, fault);
            assert_eq!(
                [counts.damaged, counts.head, counts.cut],
                [damaged, head, cut],
                "{bytes:02X?}"
            );
        }
    }

    #[test]
    fn bytes_in_front_of_a_reply_and_between_exchanges_are_counted_by_themselves() {
        let mut watch = watch(Framing::Rtu);
        watch.heard(TrafficKind::Noise, &[0]);
        watch.sent(1, READ);
        watch.heard(TrafficKind::Noise, &[0, 0]);
        watch.heard(TrafficKind::Reply, &RTU);
        watch.heard(TrafficKind::Noise, &[0]);
        watch.ended(None, RTU.len());
        watch.heard(TrafficKind::Noise, &[0]);
        assert_eq!((watch.of(1).led, watch.between()), (1, 3));
        assert_eq!(watch.of(0), DamageCounts::default());
        watch.sent(1, READ);
        watch.heard(TrafficKind::Reply, &RTU);
        watch.ended(None, RTU.len());
        assert_eq!(
            watch.of(1).led,
            1,
            "what came before belongs to no later exchange"
        );
    }

    #[test]
    fn a_second_reply_is_no_late_one() {
        let mut watch = watch(Framing::Rtu);
        let late = Duration::from_millis(700);
        for (place, stray) in [
            (0, StrayFrame::Explained),
            (0, StrayFrame::TooMany(late)),
            (1, StrayFrame::BeyondLimit(late)),
            (1, StrayFrame::Explained),
            (9, StrayFrame::Explained),
        ] {
            watch.stray(place, stray);
        }
        let counts = |place: usize| {
            (
                watch.of(place).late,
                watch.of(place).doubled,
                watch.of(place).beyond_limit,
            )
        };
        assert_eq!((counts(0), counts(1)), ((1, 1, 0), (2, 0, 1)));
    }

    #[test]
    fn babble_is_kept_no_longer_than_two_frames() {
        let mut watch = watch(Framing::Rtu);
        watch.sent(0, READ);
        for _ in 0..100 {
            watch.heard(TrafficKind::Noise, &[0; 100]);
        }
        assert_eq!(watch.loose.len(), 2 * framing::max_adu_bytes(Framing::Rtu));
    }

    #[test]
    fn damage_of_long_replies_is_counted_beside_all() {
        for (bytes, long) in [(14, 0), (15, 1)] {
            let counts = after(Framing::Rtu, bytes, &[0], Fault::Silent);
            assert_eq!(
                (counts.damaged, counts.long, counts.long_damaged),
                (1, long, long),
                "{bytes}"
            );
        }
    }
}
