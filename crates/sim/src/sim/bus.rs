//! A half-duplex bus with simulated drives: the master's bytes in, the drives' bytes out, each at its moment.

use super::bus_options::{BusOptions, BusPacing};
use super::drive::SimDrive;
use super::fault::{FaultGenerator, FaultPlan, ReplyFate};
use super::incoming::{IncomingBytes, least_silence, silence_for};
use super::node::SimNode;
use super::report::BusReport;
use super::transmissions::DriveTransmissions;
use crate::domain::ids::Station;
use crate::domain::link::LinkSettings;
use crate::domain::time::MonoTime;
use crate::wire::framing;
use std::time::Duration;

/// The sender of bytes that come from no drive of the bus.
const NOBODY: Station = Station(0);

/// The bus. Moments passed to it may be equal but never go back.
///
/// An RTU request ends at its function's length with a valid CRC, else by silence; an ASCII request ends with CR LF, else
/// after a second without a character, and is dropped by the ':' of another one. A request with an invalid check or for
/// an absent station is ignored. The drives do not hear each other. A master that talks over a drive is counted but
/// damages nothing; two drives that talk at the same time damage each other.
///
/// Each drive is a queue: it never answers a newer request before an older one.
#[derive(Debug)]
pub struct SimBus {
    link: LinkSettings,
    options: BusOptions,
    silence: Duration,
    faults: FaultGenerator,
    nodes: Vec<SimNode>,
    request: IncomingBytes,
    /// End of the master's last character.
    master_end: MonoTime,
    /// End of the last character on the wire, as far as the drives' bytes were taken.
    quiet_since: Option<MonoTime>,
    /// What the drives still have to transmit.
    transmissions: DriveTransmissions,
    report: BusReport,
    /// The newest reply of a drive, before any fault.
    newest_reply: Vec<u8>,
    /// The master's bytes are echoed, as on a half-duplex line whose adapter hears itself.
    echoes: bool,
}

impl SimBus {
    /// An empty bus. The same `seed` gives the same faults.
    #[must_use]
    pub fn new(link: LinkSettings, options: BusOptions, seed: u64) -> Self {
        Self {
            link,
            options,
            silence: options
                .silence
                .unwrap_or_else(|| least_silence(options.framing, link)),
            faults: FaultGenerator::new(options.faults, options.framing, link.data_bits, seed),
            nodes: Vec::new(),
            request: IncomingBytes::new(options.framing),
            master_end: MonoTime::ZERO,
            quiet_since: None,
            transmissions: DriveTransmissions::new(
                (options.pacing == BusPacing::CharacterTimes).then_some(link),
                options.delivery,
            ),
            report: BusReport::default(),
            newest_reply: Vec::new(),
            echoes: false,
        }
    }

    /// Sets whether the master's bytes are echoed, as on a half-duplex line whose adapter hears itself.
    pub const fn set_echoes(&mut self, echoes: bool) {
        self.echoes = echoes;
    }

    /// Connects `drive` as `station`, replacing any drive at this station. Its exchanges are
    /// numbered from 1.
    pub fn connect(&mut self, station: Station, drive: SimDrive) {
        if self.options.silence.is_none() {
            self.silence =
                self.silence
                    .max(silence_for(drive.model(), self.options.framing, self.link));
        }
        self.nodes.retain(|node| node.station != station);
        self.transmissions.silence(MonoTime::ZERO, station);
        self.faults.connect(station.0);
        self.nodes.push(SimNode::new(station, drive));
    }

    /// The stations on the bus, in the order in which they were connected.
    pub fn stations(&self) -> impl Iterator<Item = Station> {
        self.nodes.iter().map(|node| node.station)
    }

    /// The drive at `station`.
    #[must_use]
    pub fn drive(&self, station: Station) -> Option<&SimDrive> {
        self.nodes
            .iter()
            .find(|node| node.station == station)
            .map(|node| &node.drive)
    }

    /// The drive at `station`, to trip it or to operate its panel.
    pub fn drive_mut(&mut self, station: Station) -> Option<&mut SimDrive> {
        self.nodes
            .iter_mut()
            .find(|node| node.station == station)
            .map(|node| &mut node.drive)
    }

    /// Switches the drive at `station` on or off. When switched off, it stops transmitting after a whole character.
    pub fn set_powered(&mut self, at: MonoTime, station: Station, powered: bool) {
        let Some(node) = self.nodes.iter_mut().find(|node| node.station == station) else {
            return;
        };
        node.drive.set_powered(at, powered);
        if !powered {
            node.busy_until = at;
            node.late_until = at;
            self.transmissions.silence(at, station);
        }
    }

    /// The connection to a Modbus TCP server was closed at `at`: nothing more is sent over it.
    pub fn hang_up(&mut self, at: MonoTime) {
        self.drop_request();
        for node in &mut self.nodes {
            node.busy_until = at;
            node.late_until = at;
            self.transmissions.silence(at, node.station);
        }
    }

    /// Changes the faults from now on; the random sequence continues.
    pub fn set_faults(&mut self, plan: FaultPlan) {
        self.faults.plan = plan;
    }

    /// Changes the turnaround from now on.
    pub fn set_turnaround(&mut self, turnaround: Duration) {
        self.options.turnaround = turnaround;
    }

    /// Number of the newest exchange with `station`: how many sound requests addressed to it have ended on
    /// the wire, including those that it ignored or that arrived while it was off. 0 for an unknown station.
    ///
    /// Right after [`Self::receive`] has got the end of a request, this is that request's number. Every proof
    /// word (see [`super::DriveOptions::proof_words`]) is the low half of the number of the exchange that asked
    /// for it, so a word belongs to a request if and only if the two agree, as long as no reply is older than
    /// 65,535 exchanges.
    #[must_use]
    pub fn exchange(&self, station: Station) -> u64 {
        self.nodes
            .iter()
            .find(|node| node.station == station)
            .map_or(0, |node| node.exchanges)
    }

    /// The reply of the addressed drive as a whole frame, before any fault; empty if the last bytes passed to
    /// [`Self::receive`] formed no request that was answered.
    #[must_use]
    pub fn newest_reply(&self) -> &[u8] {
        &self.newest_reply
    }

    /// Puts unsolicited `bytes` from no drive on the wire from `at` on: from a foreign master, a babbling node, an
    /// adapter that hears itself. Beyond [`Self::WAITING_MAX`] waiting transmissions they are lost.
    pub fn speak(&mut self, at: MonoTime, bytes: &[u8]) {
        if let Some(frame) = self.transmissions.frame_of(bytes) {
            self.report.collisions += self.transmissions.add(NOBODY, at, false, frame, usize::MAX);
        }
    }

    /// Puts unsolicited `bytes` from no drive on the wire from `at` on, which any other transmission cuts off: a burst
    /// mixed with a frame would have a valid check once in 65,536 times, whatever a master does.
    fn burst(&mut self, at: MonoTime, bytes: &[u8]) {
        if let Some(frame) = self.transmissions.frame_of(bytes) {
            self.report.bursts += 1;
            self.transmissions.add_yielding(NOBODY, at, frame);
        }
    }

    /// Maximum number of transmissions that may wait to be taken.
    pub const WAITING_MAX: usize = DriveTransmissions::MAX_WAITING;

    /// Whether characters take time on this bus.
    #[must_use]
    pub const fn is_paced(&self) -> bool {
        self.transmissions.is_paced()
    }

    /// The counters of an observer on the wire.
    #[must_use]
    pub const fn report(&self) -> &BusReport {
        &self.report
    }

    /// The silence that the master must keep before a request.
    #[must_use]
    pub const fn required_silence(&self) -> Duration {
        self.silence
    }

    /// Takes `bytes` that the master put into its port at `at`. On a paced bus they go out from then on, or
    /// from the end of its earlier bytes if those are still going out.
    pub fn receive(&mut self, at: MonoTime, bytes: &[u8]) {
        self.newest_reply.clear();
        let start = if self.transmissions.is_paced() {
            at.max(self.master_end)
        } else {
            at
        };
        self.end_request_by_silence(start);
        for (n, byte) in bytes.iter().enumerate() {
            if self.request.begins_with(*byte) {
                self.drop_request();
                self.observe(start + self.transmissions.time(n));
            }
            self.request.push(*byte);
            self.master_end = start + self.transmissions.time(n + 1);
            self.quiet_since = self.quiet_since.max(Some(self.master_end));
            if self.request.is_whole() {
                self.end_request(self.master_end);
            }
        }
        self.speak(start, if self.echoes { bytes } else { &[] });
    }

    /// When to call [`Self::take_due`] next; `None` if nothing will happen until the master transmits.
    #[must_use]
    pub fn next_due(&self) -> Option<MonoTime> {
        let silence = (!self.request.is_empty()).then(|| self.request_end());
        [silence, self.transmissions.next_due()]
            .into_iter()
            .flatten()
            .min()
    }

    /// Takes the bytes that the drives have put on the wire until `at`, in order. On a paced bus `sink` gets each byte
    /// with the moment at which its character ends, else whole transmissions with the moment they are due.
    pub fn take_due(&mut self, at: MonoTime, sink: impl FnMut(MonoTime, &[u8])) {
        self.end_request_by_silence(at);
        self.quiet_since = self.quiet_since.max(self.transmissions.take(at, sink));
    }

    /// Checks the silence before a request that begins at `start`.
    fn observe(&mut self, start: MonoTime) {
        if !self.transmissions.is_paced() {
            return;
        }
        let on_wire = self.transmissions.is_on_wire(start);
        self.report.talked_over += u64::from(on_wire || self.transmissions.is_awaited(start));
        if let Some(quiet_since) = self.quiet_since.max(self.transmissions.last_end(start)) {
            let gap = if on_wire {
                Duration::ZERO
            } else {
                start.since(quiet_since)
            };
            self.report.count_gap(gap, self.silence);
        }
    }

    fn end_request_by_silence(&mut self, at: MonoTime) {
        let end = self.request_end();
        if !self.request.is_empty() && at >= end {
            self.end_request(end);
        }
    }

    /// When silence ends the request that has begun.
    fn request_end(&self) -> MonoTime {
        self.master_end + self.request.longest_hole(self.silence)
    }

    /// Drops the request that has begun, if any.
    fn drop_request(&mut self) {
        self.report.bad_crc += u64::from(!self.request.is_empty());
        let request = self.request.take();
        self.request.clear(request);
    }

    fn end_request(&mut self, end: MonoTime) {
        let request = self.request.take();
        match framing::decode(self.options.framing, &request) {
            Some((station, pdu))
                if request.len() <= framing::max_adu_bytes(self.options.framing) =>
            {
                self.report.requests_heard += 1;
                self.deliver(end, Station(station), &pdu, &request);
            }
            _ => self.report.bad_crc += 1,
        }
        self.request.clear(request);
    }

    fn deliver(&mut self, end: MonoTime, station: Station, pdu: &[u8], request: &[u8]) {
        if let Some(place) = self.nodes.iter().position(|node| node.station == station) {
            return self.ask(place, end, pdu, request);
        }
        for node in &mut self.nodes {
            let broadcast = node.drive.model().link.broadcast.as_ref();
            if broadcast.is_some_and(|broadcast| broadcast.station.value == station.0) {
                node.drive.obey(end, pdu);
            }
        }
    }

    /// Passes a `request` with `pdu` that ended at `end` to the drive at `place` and schedules its reply.
    fn ask(&mut self, place: usize, end: MonoTime, pdu: &[u8], request: &[u8]) {
        let node = &mut self.nodes[place];
        node.exchanges += 1;
        if end < node.late_until && self.faults.ignores_new_request() {
            self.report.requests_ignored += 1;
            return;
        }
        if !node.takes(end.before(self.transmissions.time(request.len())), end, pdu) {
            self.report.requests_too_soon += 1;
            return;
        }
        let mut frame = self.transmissions.buffer();
        let mut answered = false;
        framing::encode(self.options.framing, &mut frame, node.station.0, |out| {
            answered = node.drive.answer(end, pdu, node.exchanges, out);
        });
        if !answered {
            return self.transmissions.recycle(frame);
        }
        let transaction = framing::transaction_of(self.options.framing, request);
        if let Some(id) = transaction {
            framing::set_transaction(self.options.framing, &mut frame, id);
        }
        self.newest_reply.extend_from_slice(&frame);
        let transmissions = &self.transmissions;
        let turnaround = self.options.turnaround;
        let burst = self.faults.burst(request, &frame, turnaround, |bytes| {
            transmissions.time(bytes)
        });
        if let Some((after, bytes)) = burst {
            self.burst(end + after, &bytes);
        }
        let (fate, hole) = self.faults.spoil(&mut frame);
        if fate == ReplyFate::Lost || self.transmissions.is_full() {
            self.report.replies_lost += 1;
            return self.transmissions.recycle(frame);
        }
        self.schedule(place, end, fate, frame, hole);
    }

    /// Decides when `frame`, the reply to a request that ended at `end`, is sent; from the byte at `hole` on it is
    /// delivered late.
    fn schedule(
        &mut self,
        place: usize,
        end: MonoTime,
        fate: ReplyFate,
        frame: Vec<u8>,
        hole: usize,
    ) {
        let length = self.transmissions.time(frame.len());
        let has_turnaround =
            self.transmissions.is_paced() || !self.options.framing.has_characters();
        let right_time = if has_turnaround {
            end + self.options.turnaround
        } else {
            end
        };
        let wanted = match fate {
            ReplyFate::Late => end + self.faults.late_start(length),
            ReplyFate::Beyond => end + self.faults.beyond_start(),
            ReplyFate::OnTime | ReplyFate::Lost => right_time,
        };
        let is_late = matches!(fate, ReplyFate::Late | ReplyFate::Beyond);
        let twin = self.faults.twin().map(|behind| (behind, frame.clone()));
        let node = &mut self.nodes[place];
        let start = wanted.max(node.busy_until);
        node.transmits(start + length, start > right_time);
        self.report.replies_sent += 1;
        self.report.replies_late += u64::from(is_late);
        let station = node.station;
        self.report.collisions +=
            self.transmissions
                .add(station, start, start <= right_time, frame, hole);
        if let Some((behind, frame)) = twin
            && !self.transmissions.is_full()
        {
            self.report.collisions +=
                self.transmissions
                    .add(station, start + length + behind, false, frame, usize::MAX);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::*;
    use super::*;
    use crate::wire::rtu;

    const D001: [u8; 8] = [0x01, 0x03, 0x01, 0x01, 0x00, 0x01, 0xD4, 0x36];
    const STANDSTILL: [u8; 7] = [0x01, 0x03, 0x02, 0x00, 0x00, 0xB8, 0x44];

    fn paced(plan: &str, seed: u64) -> SimBus {
        bus(
            BusOptions {
                faults: plan.parse().unwrap(),
                ..BusOptions::default()
            },
            seed,
            &[1, 2],
        )
    }

    fn ms(millis: u64) -> MonoTime {
        MonoTime::from_millis(millis)
    }

    /// Word of a reply to a read of one word; nothing else was on the wire until `at`.
    fn word_taken(bus: &mut SimBus, at: MonoTime) -> u16 {
        let reply = taken(bus, at);
        let (_, pdu) = rtu::decode(&reply).unwrap();
        assert_eq!(pdu[..2], [3, 2]);
        u16::from_be_bytes([pdu[2], pdu[3]])
    }

    #[test]
    fn character_times_are_exact_to_the_nanosecond() {
        let mut bus = paced("", 0);
        bus.receive(ms(1_000), &D001);
        // 8 characters of 10 bits at 9600 bit/s, 2 ms turnaround, then one character after the other.
        let start = 1_000_000_000 + 8_333_334 + 2_000_000;
        let ends = [
            1_041_667, 2_083_334, 3_125_000, 4_166_667, 5_208_334, 6_250_000, 7_291_667,
        ];
        assert_eq!(bus.next_due(), Some(MonoTime::from_nanos(start + ends[0])));
        assert!(taken(&mut bus, MonoTime::from_nanos(start + ends[0] - 1)).is_empty());
        let mut seen = Vec::new();
        bus.take_due(ms(2_000), |at, bytes| {
            seen.push((at.as_nanos() - start, bytes.to_vec()))
        });
        let expected: Vec<_> = ends
            .into_iter()
            .zip(STANDSTILL)
            .map(|(end, byte)| (end, vec![byte]))
            .collect();
        assert_eq!(seen, expected);
        assert_eq!(bus.next_due(), None);
        assert_eq!(
            (bus.report().requests_heard, bus.report().replies_sent),
            (1, 1)
        );
    }

    #[test]
    fn without_pacing_the_reply_is_due_at_once_and_whole() {
        let mut bus = bus(UNPACED, 0, &[1]);
        bus.receive(ms(5), &D001);
        assert_eq!(bus.next_due(), Some(ms(5)));
        let mut seen = Vec::new();
        bus.take_due(ms(5), |at, bytes| seen.push((at, bytes.to_vec())));
        assert_eq!(seen, [(ms(5), STANDSTILL.to_vec())]);
        assert!(bus.report().gaps().is_empty());
    }

    #[test]
    fn the_observer_measures_the_gap_from_the_end_of_the_reply() {
        let mut bus = paced("", 0);
        // 4.5 characters of 10 bits at 9600 bit/s.
        assert_eq!(bus.required_silence(), Duration::from_nanos(4_687_500));
        bus.receive(ms(1_000), &D001);
        let reply_end = MonoTime::from_nanos(1_000_000_000 + 8_333_334 + 2_000_000 + 7_291_667);
        let second = reply_end + Duration::from_nanos(4_687_500);
        bus.receive(second, &D001);
        assert_eq!(bus.report().gaps_too_short, 0);
        taken(&mut bus, ms(1_500));
        let reply_end = second + Duration::from_nanos(8_333_334 + 2_000_000 + 7_291_667);
        bus.receive(reply_end + Duration::from_nanos(4_687_499), &D001);
        let report = bus.report();
        assert_eq!(
            report.gaps(),
            [
                Duration::from_nanos(4_687_500),
                Duration::from_nanos(4_687_499)
            ]
        );
        assert_eq!((report.gaps_too_short, report.talked_over), (1, 0));
        assert_eq!(report.shortest_gap, Some(Duration::from_nanos(4_687_499)));
    }

    #[test]
    fn without_a_reply_the_gap_counts_from_the_end_of_the_request() {
        let mut bus = paced("", 0);
        bus.receive(ms(0), &frame(9, 3, OUTPUT, 1));
        bus.receive(MonoTime::from_nanos(8_333_334 + 1_000), &D001);
        assert_eq!(bus.report().gaps(), [Duration::from_nanos(1_000)]);
        // Written while the previous request is still being sent: no silence at all.
        let mut bus = paced("", 0);
        bus.receive(ms(0), &frame(9, 3, OUTPUT, 1));
        bus.receive(ms(1), &D001);
        assert_eq!(
            (bus.report().gaps(), bus.report().gaps_too_short),
            (&[Duration::ZERO][..], 1)
        );
        assert_eq!(
            bus.next_due(),
            Some(MonoTime::from_nanos(2 * 8_333_334 + 2_000_000 + 1_041_667))
        );
    }

    #[test]
    fn talking_over_a_drive_is_counted() {
        // 9 ms: in the turnaround. 12 ms: while the drive transmits. 30 ms: it is quiet.
        for (at, talked_over) in [(9, 1), (12, 1), (30, 0)] {
            let mut bus = paced("", 0);
            bus.receive(ms(0), &D001);
            bus.receive(ms(at), &frame(2, 3, OUTPUT, 1));
            assert_eq!(bus.report().talked_over, talked_over, "{at} ms");
            assert_eq!(
                bus.report().shortest_gap.is_some_and(|gap| gap.is_zero()),
                at == 12
            );
        }
    }

    #[test]
    fn a_broadcast_is_obeyed_by_all_and_answered_by_none() {
        let mut bus = paced("", 0);
        bus.receive(ms(0), &frame(0xFF, 6, SETPOINT, 6000));
        bus.receive(ms(100), &frame(0xFF, 6, RUN, 1));
        // Only 06 is a broadcast function, and station 0 is not a broadcast station.
        bus.receive(ms(200), &frame(0xFF, 3, OUTPUT, 1));
        bus.receive(ms(300), &frame(0, 6, RUN, 0));
        assert_eq!(bus.next_due(), None);
        let stations: Vec<_> = bus.stations().collect();
        assert_eq!(stations, [Station(1), Station(2)]);
        for station in stations {
            assert_eq!(bus.drive(station).unwrap().output(ms(30_000)), 60_000_000);
        }
        assert_eq!(
            (bus.report().requests_heard, bus.report().replies_sent),
            (4, 0)
        );
    }

    #[test]
    fn damaged_requests_are_ignored_until_silence() {
        let mut bus = paced("", 0);
        let mut damaged = D001;
        damaged[4] ^= 1;
        bus.receive(ms(0), &damaged);
        assert_eq!(
            bus.next_due(),
            Some(MonoTime::from_nanos(8_333_334 + 4_687_500))
        );
        bus.receive(ms(50), &D001);
        assert_eq!(taken(&mut bus, ms(100)), STANDSTILL);
        assert_eq!((bus.report().bad_crc, bus.report().requests_heard), (1, 1));
        // Endless babble neither grows the queue nor is heard.
        bus.receive(ms(200), &[0x55; 10_000]);
        assert!(taken(&mut bus, ms(20_000)).is_empty());
        assert_eq!(bus.report().bad_crc, 2);
    }

    #[test]
    fn a_request_may_come_byte_by_byte_or_end_by_silence() {
        let mut bus = paced("", 0);
        for (n, byte) in D001.into_iter().enumerate() {
            bus.receive(ms(2 * n as u64), &[byte]);
        }
        assert_eq!(taken(&mut bus, ms(100)), STANDSTILL);
        assert!(bus.report().gaps().is_empty());

        let mut unknown_function = Vec::new();
        rtu::encode(&mut unknown_function, 1, |pdu| {
            pdu.extend([0x2B, 0x0E, 0x01, 0x00])
        });
        bus.receive(ms(200), &unknown_function);
        assert!(taken(&mut bus, ms(300)).is_empty());
        assert_eq!((bus.report().bad_crc, bus.exchange(Station(1))), (0, 2));
    }

    #[test]
    fn a_drive_that_is_switched_off_is_silent_and_comes_back() {
        let mut bus = paced("", 0);
        bus.receive(ms(0), &D001);
        // The first three characters of the reply are out by then.
        bus.set_powered(ms(14), Station(1), false);
        assert_eq!(taken(&mut bus, ms(100)), STANDSTILL[..3]);
        bus.receive(ms(200), &D001);
        assert_eq!(bus.next_due(), None);
        bus.set_powered(ms(300), Station(1), true);
        bus.receive(ms(400), &D001);
        assert_eq!(taken(&mut bus, ms(500)), STANDSTILL);
    }

    #[test]
    fn a_late_reply_comes_after_the_time_out_and_never_after_a_newer_one() {
        let read = frame(1, 3, 0x3123, 1);
        let mut ignored = 0;
        let mut queued = 0;
        for seed in 0..200 {
            let mut bus = paced("late=1000,timeout-ms=100,lateness-ms=500", seed);
            bus.receive(ms(0), &read);
            let late_due = bus.next_due().unwrap();
            assert!(late_due > ms(108) && late_due < ms(609));
            bus.set_faults(FaultPlan::NONE);
            bus.receive(ms(109), &read);
            assert_eq!(bus.exchange(Station(1)), 2);
            let first_end = late_due + Duration::from_nanos(6_250_000);
            assert_eq!(
                word_taken(&mut bus, first_end),
                1,
                "never the newer one first"
            );
            match bus.report().requests_ignored {
                0 => {
                    assert_eq!(word_taken(&mut bus, ms(2_000)), 2);
                    queued += 1;
                }
                _ => {
                    assert!(taken(&mut bus, ms(2_000)).is_empty());
                    ignored += 1;
                }
            }
            assert_eq!(
                (bus.report().replies_late, bus.report().talked_over),
                (1, 0)
            );
        }
        assert!(ignored > 50 && queued > 50, "{ignored} {queued}");
    }

    #[test]
    fn late_replies_of_one_drive_collide_with_those_of_another() {
        let mut collisions = 0;
        for seed in 0..200 {
            let mut bus = paced("late=1000,timeout-ms=50,lateness-ms=20", seed);
            bus.receive(ms(0), &frame(1, 3, 0x3000, 1));
            bus.set_faults(FaultPlan::NONE);
            bus.receive(ms(60), &frame(2, 3, 0x3000, 1));
            collisions += bus.report().collisions;
            let seen = taken(&mut bus, ms(1_000));
            assert_eq!(seen.len() < 14, bus.report().collisions > 0);
        }
        assert!(collisions > 20, "{collisions}");
    }

    #[test]
    fn faults_repeat_bit_for_bit() {
        let run = |seed| {
            let mut bus = paced(
                "noise=100,lost=50,late=50,cut=50,flip=50,foreign=50,lateness-ms=900",
                seed,
            );
            let mut seen = Vec::new();
            for n in 0..2_000 {
                bus.receive(
                    ms(n * 250),
                    &frame(1 + (n % 2) as u8, 3, 0x3000, 1 + (n % 8) as u16),
                );
                bus.take_due(ms(n * 250 + 249), |at, bytes| {
                    seen.push((at, bytes.to_vec()))
                });
            }
            seen
        };
        assert_eq!(run(7), run(7));
        assert_ne!(run(7), run(8));
    }

    #[test]
    fn a_proof_word_belongs_to_exactly_one_exchange() {
        let mut bus = bus(UNPACED, 0, &[1, 2]);
        for n in 1..=70_000_u64 {
            bus.receive(MonoTime::from_micros(n), &frame(2, 3, 0x3FFF, 1));
            assert_eq!(bus.exchange(Station(2)), n);
            assert_eq!(
                word_taken(&mut bus, MonoTime::from_micros(n)),
                (n & 0xFFFF) as u16
            );
        }
        assert_eq!(bus.exchange(Station(1)), 0);
    }

    #[test]
    fn replies_that_nobody_takes_do_not_pile_up() {
        let mut bus = bus(UNPACED, 0, &[1]);
        for n in 0..1_000 {
            bus.receive(ms(n), &D001);
        }
        assert_eq!(
            taken(&mut bus, ms(1_000)).len(),
            DriveTransmissions::MAX_WAITING * STANDSTILL.len()
        );
        assert_eq!(
            bus.report().replies_lost,
            1_000 - DriveTransmissions::MAX_WAITING as u64
        );
    }
}
