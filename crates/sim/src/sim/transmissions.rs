//! Pending transmissions of the drives on a bus, each byte at its moment.

use crate::domain::ids::Station;
use crate::domain::link::LinkSettings;
use crate::domain::time::MonoTime;
use crate::wire::{crc, rtu};
use std::time::Duration;

/// How long an adapter delays the rest of a transmission after a hole: the latency timer of common USB chips.
pub const HOLE: Duration = Duration::from_millis(16);
/// Maximum distance of two transmissions that a master may take for one with an adapter's hole in it.
const HOLE_MAX: Duration = Duration::from_millis(20);
/// Characters delivered together of an unexpected transmission: fewer than any silence between frames lasts, so that a
/// listener always notices the traffic.
const UNEXPECTED_CHARS: usize = 3;

/// The pieces in which a paced bus delivers bytes to the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum BusDelivery {
    /// Each character by itself, at its end.
    #[default]
    Characters,
    /// A reply in time as a whole, at its end; anything else three characters at a time. A waiting master learns no less,
    /// at a fraction of the cost.
    Replies,
}

/// Bytes that a drive puts on the wire without a pause.
#[derive(Debug)]
pub(super) struct DriveTransmission {
    pub station: Station,
    pub start: MonoTime,
    pub end: MonoTime,
    /// Whether the master may expect it: it begins right after the turnaround.
    pub on_time: bool,
    pub bytes: Vec<u8>,
    /// From this byte on the adapter delivers it later by [`HOLE`].
    pub hole: usize,
    /// Any other transmission cuts it off, and it does not begin during another one.
    yields: bool,
    /// Number of bytes that were taken or swallowed by a collision.
    sent: usize,
}

/// Transmissions in order of their start.
#[derive(Debug)]
pub(super) struct DriveTransmissions {
    /// `None`: characters take no time.
    pace: Option<LinkSettings>,
    delivery: BusDelivery,
    /// The last delivery of the adapter; nothing after it arrives sooner.
    handed_on: MonoTime,
    waiting: Vec<DriveTransmission>,
    /// The last delivered bytes, as far as an RTU frame may begin in them.
    newest: Vec<u8>,
    /// Empty buffers for reuse.
    spare: Vec<Vec<u8>>,
}

impl DriveTransmissions {
    /// Maximum number of waiting transmissions. More mean that the bus is not being read.
    pub const MAX_WAITING: usize = 64;

    pub const fn new(pace: Option<LinkSettings>, delivery: BusDelivery) -> Self {
        Self {
            pace,
            delivery,
            handed_on: MonoTime::ZERO,
            waiting: Vec::new(),
            newest: Vec::new(),
            spare: Vec::new(),
        }
    }

    pub const fn is_paced(&self) -> bool {
        self.pace.is_some()
    }

    /// Time that `bytes` bytes take on the wire.
    pub fn time(&self, bytes: usize) -> Duration {
        self.pace.map_or(Duration::ZERO, |link| link.bytes(bytes))
    }

    pub const fn is_full(&self) -> bool {
        self.waiting.len() >= Self::MAX_WAITING
    }

    /// An empty buffer for a frame.
    pub fn buffer(&mut self) -> Vec<u8> {
        self.spare.pop().unwrap_or_default()
    }

    /// A frame of `bytes`; `None` if there are none, or too many transmissions wait already.
    pub fn frame_of(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        if bytes.is_empty() || self.is_full() {
            return None;
        }
        let mut frame = self.buffer();
        frame.extend_from_slice(bytes);
        Some(frame)
    }

    /// Takes a buffer back that is no longer needed.
    pub fn recycle(&mut self, mut buffer: Vec<u8>) {
        buffer.clear();
        self.spare.push(buffer);
    }

    /// Adds `bytes` of `station` from `start` on, delivered late from the byte at `hole` on; returns the number of
    /// collisions.
    pub fn add(
        &mut self,
        station: Station,
        start: MonoTime,
        on_time: bool,
        bytes: Vec<u8>,
        hole: usize,
    ) -> u64 {
        self.cut_yielding(start, start + self.time(bytes.len()));
        self.insert(station, start, on_time, bytes, hole, false)
    }

    /// Adds `bytes` of `station` from `start` on, as far as the bus is idle.
    pub fn add_yielding(&mut self, station: Station, start: MonoTime, mut bytes: Vec<u8>) {
        let end = start + self.time(bytes.len());
        let others = self
            .waiting
            .iter()
            .filter(|other| other.start < end && start < other.end);
        let room = others.map(|other| other.start.since(start)).min();
        if let Some(room) = room {
            let count = (0..=bytes.len())
                .rev()
                .find(|count| self.time(*count) <= room)
                .unwrap_or_default();
            bytes.truncate(count);
        }
        if bytes.is_empty() {
            return self.recycle(bytes);
        }
        self.insert(station, start, false, bytes, usize::MAX, true);
    }

    /// Another transmission lasts from `start` to `end`: transmissions that give way end before it.
    fn cut_yielding(&mut self, start: MonoTime, end: MonoTime) {
        let pace = self.pace;
        let time = |bytes| pace.map_or(Duration::ZERO, |link| link.bytes(bytes));
        for other in self
            .waiting
            .iter_mut()
            .filter(|other| other.yields && start < other.end && other.start < end)
        {
            let whole = (1..=other.bytes.len())
                .filter(|bytes| other.start + time(*bytes) <= start)
                .count();
            other.bytes.truncate(whole.max(other.sent));
            other.end = other.start + time(other.bytes.len());
        }
        self.waiting
            .retain(|other| !other.yields || other.sent < other.bytes.len());
    }

    fn insert(
        &mut self,
        station: Station,
        start: MonoTime,
        on_time: bool,
        bytes: Vec<u8>,
        hole: usize,
        yields: bool,
    ) -> u64 {
        let end = start + self.time(bytes.len());
        let place = self.waiting.partition_point(|other| other.start <= start);
        self.waiting.insert(
            place,
            DriveTransmission {
                station,
                start,
                end,
                on_time,
                bytes,
                hole,
                yields,
                sent: 0,
            },
        );
        let Some(link) = self.pace else { return 0 };
        let mut collisions = 0;
        for other in (0..self.waiting.len()).filter(|other| *other != place) {
            let (head, tail) = self.waiting.split_at_mut(place.max(other));
            let first = &mut head[place.min(other)];
            let second = &mut tail[0];
            if second.start < first.end {
                collide(link, first, second);
                collisions += 1;
            }
        }
        collisions
    }

    /// When the next byte is complete.
    pub fn next_due(&self) -> Option<MonoTime> {
        self.waiting.first().map(|first| self.due(first))
    }

    /// Delivers the bytes up to `at`; returns the end of the last transmission that is now complete.
    pub fn take(
        &mut self,
        at: MonoTime,
        mut sink: impl FnMut(MonoTime, &[u8]),
    ) -> Option<MonoTime> {
        let mut last_end = None;
        while let Some(first) = self.waiting.first() {
            let due = self.due(first);
            let is_left = first.sent < first.bytes.len();
            if is_left && due > at {
                break;
            }
            if self.makes_up_a_frame(first) {
                let burst = self.waiting.remove(0);
                self.recycle(burst.bytes);
                continue;
            }
            let upto = if is_left {
                self.upto(first)
            } else {
                first.bytes.len()
            };
            if is_left {
                let bytes = &first.bytes[first.sent..upto];
                sink(due, bytes);
                self.newest.extend_from_slice(bytes);
                let excess = self.newest.len().saturating_sub(rtu::MAX_ADU_BYTES);
                self.newest.drain(..excess);
                self.handed_on = if self.is_paced() { due } else { self.handed_on };
            }
            last_end = last_end.max(self.mark_sent(upto));
        }
        last_end
    }

    /// Whether the beginning of a frame was delivered, and the unsolicited `next` completes it to a valid frame after a pause
    /// that may be an adapter's: a truncated reply and the end of an earlier one then repeat the earlier one. No master can
    /// distinguish that from the reply it waits for.
    fn makes_up_a_frame(&self, next: &DriveTransmission) -> bool {
        if !next.yields || next.sent > 0 || next.start.since(self.handed_on) > HOLE_MAX {
            return false;
        }
        let both = [self.newest.as_slice(), &next.bytes].concat();
        let seam = self.newest.len();
        let least = rtu::adu_bytes(2);
        (0..seam).any(|begin| {
            let ends = (seam + 1..=both.len()).filter(|end| end - begin >= least);
            ends.map(|end| &both[begin..end]).any(crc::is_sound)
        })
    }

    /// Whether a drive is transmitting at `at`.
    pub fn is_on_wire(&self, at: MonoTime) -> bool {
        self.waiting
            .iter()
            .any(|drive| drive.start < at && at < drive.end)
    }

    /// Whether a reply in time is not complete at `at`.
    pub fn is_awaited(&self, at: MonoTime) -> bool {
        self.waiting
            .iter()
            .any(|drive| drive.on_time && at < drive.end)
    }

    /// The last end of a transmission that is over at `at` but was not taken.
    pub fn last_end(&self, at: MonoTime) -> Option<MonoTime> {
        self.waiting
            .iter()
            .map(|drive| drive.end)
            .filter(|end| *end <= at)
            .max()
    }

    /// Removes what `station` has not transmitted at `at`.
    pub fn silence(&mut self, at: MonoTime, station: Station) {
        let pace = self.pace;
        let time = |bytes| pace.map_or(Duration::ZERO, |link| link.bytes(bytes));
        for drive in self
            .waiting
            .iter_mut()
            .filter(|drive| drive.station == station)
        {
            let went_out = (1..=drive.bytes.len())
                .filter(|bytes| drive.start + time(*bytes) <= at)
                .count();
            drive.bytes.truncate(went_out.max(drive.sent));
            drive.end = drive.end.min(at);
        }
        self.waiting.retain(|drive| drive.sent < drive.bytes.len());
    }

    /// When the next byte of `drive` is complete.
    fn due(&self, drive: &DriveTransmission) -> MonoTime {
        let end = drive.start + self.time(self.upto(drive));
        if self.is_paced() && drive.sent >= drive.hole {
            end + HOLE
        } else {
            end.max(self.handed_on)
        }
    }

    /// The byte up to which `drive` is delivered next.
    fn upto(&self, drive: &DriveTransmission) -> usize {
        let length = drive.bytes.len();
        let upto = match self.delivery {
            _ if !self.is_paced() => return length,
            BusDelivery::Characters => drive.sent + 1,
            BusDelivery::Replies if drive.on_time => length,
            BusDelivery::Replies => (drive.sent + UNEXPECTED_CHARS).min(length),
        };
        if drive.sent < drive.hole {
            upto.min(drive.hole)
        } else {
            upto
        }
    }

    /// Counts `sent` bytes of the first transmission as sent; returns its end with the last one.
    fn mark_sent(&mut self, sent: usize) -> Option<MonoTime> {
        let first = self.waiting.first_mut()?;
        first.sent = sent;
        if sent < first.bytes.len() {
            return None;
        }
        let done = self.waiting.remove(0);
        self.recycle(done.bytes);
        Some(done.end)
    }
}

/// What two drives at the same time make of each other's characters: wrong ones while both talk, and of the
/// second drive only what comes after the first one is done. Damage that leaves the check valid is not simulated: CRC-16
/// accepts one badly damaged frame in 65,536, and no receiver can detect that.
fn collide(link: LinkSettings, first: &mut DriveTransmission, second: &mut DriveTransmission) {
    for n in first.sent..first.bytes.len() {
        if first.start + link.bytes(n + 1) > second.start {
            first.bytes[n] ^= 0x55;
        }
    }
    if crc::is_sound(&first.bytes)
        && let Some(last) = first.bytes.last_mut()
    {
        *last ^= 1;
    }
    while second.sent < second.bytes.len() && second.start + link.bytes(second.sent) < first.end {
        second.sent += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A character takes 1 ms.
    const LINK: LinkSettings = LinkSettings {
        baud: 10_000,
        ..LinkSettings::DEFAULT
    };

    fn ms(millis: u64) -> MonoTime {
        MonoTime::from_millis(millis)
    }

    fn taken(transmissions: &mut DriveTransmissions, at: MonoTime) -> Vec<(u64, u8)> {
        let mut bytes = Vec::new();
        transmissions.take(at, |due, byte| {
            bytes.push((due.as_nanos() / 1_000_000, byte[0]))
        });
        bytes
    }

    #[test]
    fn damage_is_never_hidden_from_the_check() {
        let frame = |start, bytes: &[u8]| DriveTransmission {
            station: Station(1),
            start: ms(start),
            end: ms(start + bytes.len() as u64),
            on_time: true,
            bytes: bytes.to_vec(),
            hole: usize::MAX,
            yields: false,
            sent: 0,
        };
        // A sound frame of which nothing overlaps any more but what a second hit has restored.
        let mut first = frame(0, &[1, 3, 2, 0, 0, 0xB8, 0x44]);
        let mut second = frame(2, &[0; 3]);
        collide(LINK, &mut first, &mut second);
        let mut third = frame(2, &[0; 3]);
        collide(LINK, &mut first, &mut third);
        assert!(!crc::is_sound(&first.bytes), "{:02X?}", first.bytes);
    }

    #[test]
    fn two_drives_at_the_same_time_damage_each_other() {
        let mut transmissions = DriveTransmissions::new(Some(LINK), BusDelivery::Characters);
        assert_eq!(
            transmissions.add(Station(2), ms(102), false, vec![5, 6, 7, 8], usize::MAX),
            0
        );
        assert_eq!(
            transmissions.add(Station(1), ms(100), true, vec![1, 2, 3, 4], usize::MAX),
            1
        );
        let expected = [
            (101, 1),
            (102, 2),
            (103, 3 ^ 0x55),
            (104, 4 ^ 0x55),
            (105, 7),
            (106, 8),
        ];
        assert_eq!(taken(&mut transmissions, ms(200)), expected);
        assert_eq!(transmissions.next_due(), None);
    }

    #[test]
    fn a_burst_gives_way_to_anyone_who_talks() {
        let mut transmissions = DriveTransmissions::new(Some(LINK), BusDelivery::Characters);
        transmissions.add_yielding(Station(0), ms(100), vec![1, 2, 3, 4]);
        assert_eq!(
            transmissions.add(Station(1), ms(102), true, vec![7, 8], usize::MAX),
            0
        );
        transmissions.add_yielding(Station(0), ms(103), vec![9, 9]);
        assert_eq!(
            taken(&mut transmissions, ms(200)),
            [(101, 1), (102, 2), (103, 7), (104, 8)]
        );
        transmissions.add(Station(1), ms(305), true, vec![7], usize::MAX);
        transmissions.add_yielding(Station(0), ms(304), vec![5, 6]);
        assert_eq!(taken(&mut transmissions, ms(400)), [(305, 5), (306, 7)]);
    }

    #[test]
    fn a_burst_does_not_end_what_was_cut_off_within_an_adapters_hole() {
        let reply = [0x01, 0x03, 0x02, 0x17, 0x70, 0xB6, 0x50];
        for (pause, is_heard) in [(0, false), (20, false), (21, true)] {
            let mut transmissions = DriveTransmissions::new(Some(LINK), BusDelivery::Replies);
            transmissions.add(Station(1), ms(100), false, reply[..3].to_vec(), usize::MAX);
            transmissions.add_yielding(Station(0), ms(103 + pause), reply[3..].to_vec());
            let mut count = 0;
            transmissions.take(ms(400), |_, bytes| count += bytes.len());
            assert_eq!(count, if is_heard { 7 } else { 3 }, "{pause}");
        }
    }

    #[test]
    fn one_that_is_switched_off_stops_after_its_last_whole_character() {
        let mut transmissions = DriveTransmissions::new(Some(LINK), BusDelivery::Characters);
        transmissions.add(Station(1), ms(100), true, vec![1, 2, 3, 4], usize::MAX);
        transmissions.add(Station(1), ms(300), false, vec![9], usize::MAX);
        assert_eq!(taken(&mut transmissions, ms(101)), [(101, 1)]);
        transmissions.silence(MonoTime::from_micros(102_500), Station(1));
        assert_eq!(taken(&mut transmissions, ms(400)), [(102, 2)]);
    }
}
