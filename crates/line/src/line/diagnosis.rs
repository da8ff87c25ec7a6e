//! What is probably wrong with a line, from the pattern of data received since its port was opened.

use super::fault::Fault;
use super::station::StrayFrame;
use crate::domain::ids::Station;
use crate::domain::link::Framing;
use crate::domain::suspicion::LineSuspicion;
use crate::domain::traffic::{HeardFrame, TrafficKind};

/// Number of signs of one kind before they are believed: one alone may be chance.
pub const SIGNS: u32 = 3;
/// Exchanges without a single byte before [`LineSuspicion::NothingHeard`] is raised.
pub const SILENCES: u32 = 4;
/// Exchanges after which the counts of signs restart: what is seen once in months is no pattern.
pub const WINDOW: u32 = 500;

/// What is remembered of one station.
#[derive(Clone, Copy, Debug)]
struct StationHistory {
    station: Station,
    was_heard: bool,
    silences: u32,
    second_replies: u32,
    /// Replies that arrived later than any may.
    beyond_limit: u32,
    /// Requests that were answered in the wrong form.
    wrong_replies: u32,
    /// The last such request, and what came.
    wrong: Option<(HeardFrame, HeardFrame)>,
}

/// The evidence of one line.
#[derive(Debug)]
pub struct LineDiagnosis {
    /// The line has a speed and a parity; Modbus TCP has neither.
    has_characters: bool,
    stations: Vec<StationHistory>,
    /// Exchanges since the counts last restarted.
    exchanges: u32,
    /// Consecutive exchanges without a byte, as long as nothing was ever received.
    silences: u32,
    was_anything_heard: bool,
    was_frame_heard: bool,
    right_length: u32,
    too_few: u32,
    too_many: u32,
    other_requests: u32,
    /// Bytes in the current exchange that belong to no frame.
    loose_bytes: usize,
    /// The station addressed last.
    asked: usize,
    found: Option<LineSuspicion>,
}

impl LineDiagnosis {
    /// A line with these stations from which nothing has been received.
    pub fn new(framing: Framing, stations: impl Iterator<Item = Station>) -> Self {
        Self::of(framing.has_characters(), stations)
    }

    fn of(has_characters: bool, stations: impl Iterator<Item = Station>) -> Self {
        let seen = |station| StationHistory {
            station,
            was_heard: false,
            silences: 0,
            second_replies: 0,
            beyond_limit: 0,
            wrong_replies: 0,
            wrong: None,
        };
        Self {
            has_characters,
            stations: stations.map(seen).collect(),
            exchanges: 0,
            silences: 0,
            was_anything_heard: false,
            was_frame_heard: false,
            right_length: 0,
            too_few: 0,
            too_many: 0,
            other_requests: 0,
            loose_bytes: 0,
            asked: 0,
            found: None,
        }
    }

    /// The port was opened: all evidence is discarded.
    pub fn port_opened(&mut self) {
        let stations = std::mem::take(&mut self.stations);
        *self = Self::of(
            self.has_characters,
            stations.into_iter().map(|seen| seen.station),
        );
    }

    /// A request is sent to the station at `place`.
    pub const fn sent(&mut self, place: usize) {
        self.loose_bytes = 0;
        self.asked = place;
    }

    /// `bytes` were received and classified as `kind`.
    pub fn heard(&mut self, kind: TrafficKind, bytes: &[u8]) {
        self.was_anything_heard = true;
        match kind {
            TrafficKind::Request | TrafficKind::Echo => {}
            TrafficKind::Noise => self.loose_bytes += bytes.len(),
            TrafficKind::OtherMaster(_) => self.other_requests += 1,
            TrafficKind::Reply | TrafficKind::Stray(_) | TrafficKind::Foreign(_) => {
                self.was_frame_heard = true
            }
        }
    }

    /// A frame of the station at `place` arrived that answers no open request.
    pub fn stray(&mut self, place: usize, stray: StrayFrame) {
        let Some(seen) = self.stations.get_mut(place) else {
            return;
        };
        seen.was_heard = true;
        match stray {
            StrayFrame::Explained | StrayFrame::WrongForm(_) => {}
            StrayFrame::BeyondLimit(_) => seen.beyond_limit += 1,
            StrayFrame::TooMany(_) => seen.second_replies += 1,
        }
    }

    /// `reply` was all that came to `request` from the station at `place`.
    pub fn wrong_reply(&mut self, place: usize, request: HeardFrame, reply: HeardFrame) {
        let Some(seen) = self.stations.get_mut(place) else {
            return;
        };
        seen.was_heard = true;
        seen.wrong_replies += 1;
        seen.wrong = Some((request, reply));
    }

    /// The exchange ended, with a `fault` or successfully; its valid reply has `reply_bytes`.
    pub fn ended(&mut self, fault: Option<Fault>, reply_bytes: usize) {
        self.exchanges += 1;
        let is_answer = fault.is_none();
        let is_silent = matches!(fault, Some(Fault::Silent | Fault::Unreachable));
        if let Some(seen) = self.stations.get_mut(self.asked) {
            seen.was_heard |= is_answer;
            seen.silences = if is_silent {
                seen.silences.saturating_add(1)
            } else {
                0
            };
        }
        self.silences = if self.was_anything_heard {
            0
        } else {
            self.silences.saturating_add(1)
        };
        if self.loose_bytes > 0 && !is_answer {
            match self.loose_bytes.cmp(&reply_bytes) {
                std::cmp::Ordering::Equal => self.right_length += 1,
                std::cmp::Ordering::Less => self.too_few += 1,
                std::cmp::Ordering::Greater => self.too_many += 1,
            }
        }
    }

    /// The current suspicion.
    pub fn suspicion(&mut self) -> Option<LineSuspicion> {
        let pattern = self.pattern();
        if let Some(pattern) = pattern
            && !self.found.is_some_and(|found| is_same(found, pattern))
        {
            self.found = Some(pattern);
        }
        let is_settled = match self.found {
            Some(LineSuspicion::OneSilent(station) | LineSuspicion::OneUnitSilent(station)) => self
                .stations
                .iter()
                .any(|it| it.station == station && it.was_heard),
            Some(LineSuspicion::NothingHeard | LineSuspicion::ServerSilent) => {
                self.was_anything_heard
            }
            Some(
                LineSuspicion::DuplicateStation(_)
                | LineSuspicion::LateBeyondLimit(_)
                | LineSuspicion::OtherMaster
                | LineSuspicion::WrongReplies { .. },
            ) => false,
            _ => self.was_frame_heard,
        };
        let is_over = self.exchanges >= WINDOW;
        if (is_settled || is_over) && pattern.is_none() {
            self.found = None;
        }
        if is_over {
            self.restart_counts();
        }
        self.found
    }

    fn pattern(&self) -> Option<LineSuspicion> {
        // The replies to another master's requests look like second replies.
        if self.other_requests >= SIGNS {
            return Some(LineSuspicion::OtherMaster);
        }
        if let Some(twice) = self
            .stations
            .iter()
            .find(|seen| seen.second_replies >= SIGNS)
        {
            return Some(LineSuspicion::DuplicateStation(twice.station));
        }
        if let Some(late) = self.stations.iter().find(|seen| seen.beyond_limit > 0) {
            return Some(LineSuspicion::LateBeyondLimit(late.station));
        }
        let wrong = self.stations.iter().find_map(|seen| {
            if seen.wrong_replies < SIGNS {
                return None;
            }
            let (request, reply) = seen.wrong?;
            Some(LineSuspicion::WrongReplies {
                station: seen.station,
                request,
                reply,
            })
        });
        if wrong.is_some() {
            return wrong;
        }
        if !self.was_anything_heard {
            let silence = if self.has_characters {
                LineSuspicion::NothingHeard
            } else {
                LineSuspicion::ServerSilent
            };
            return (self.silences >= SILENCES).then_some(silence);
        }
        if !self.was_frame_heard {
            let damaged = self.right_length + self.too_few + self.too_many;
            return (damaged >= SIGNS).then(|| self.of_loose_bytes());
        }
        let others_answer =
            |silent: &&StationHistory| !silent.was_heard && silent.silences >= SILENCES;
        let one_silent = if self.has_characters {
            LineSuspicion::OneSilent
        } else {
            LineSuspicion::OneUnitSilent
        };
        self.stations
            .iter()
            .find(others_answer)
            .map(|silent| one_silent(silent.station))
    }

    fn of_loose_bytes(&self) -> LineSuspicion {
        if !self.has_characters {
            LineSuspicion::NotModbusTcp
        } else if self.right_length >= self.too_few.max(self.too_many) {
            LineSuspicion::AlwaysDamaged
        } else if self.too_few > self.too_many {
            LineSuspicion::DrivesAreFaster
        } else {
            LineSuspicion::DrivesAreSlower
        }
    }

    fn restart_counts(&mut self) {
        self.exchanges = 0;
        self.other_requests = 0;
        self.right_length = 0;
        self.too_few = 0;
        self.too_many = 0;
        for seen in &mut self.stations {
            seen.second_replies = 0;
            seen.beyond_limit = 0;
            seen.wrong_replies = 0;
        }
    }
}

/// Whether both suspect the same of the same station, whatever frames show it.
fn is_same(one: LineSuspicion, other: LineSuspicion) -> bool {
    match (one, other) {
        (
            LineSuspicion::WrongReplies { station: one, .. },
            LineSuspicion::WrongReplies { station: other, .. },
        ) => one == other,
        _ => one == other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// One exchange with the first station: what is received and how it ends, with 7 bytes expected.
    fn exchange(
        diagnosis: &mut LineDiagnosis,
        heard: &[(TrafficKind, &[u8])],
        fault: Option<Fault>,
    ) -> Option<LineSuspicion> {
        diagnosis.sent(0);
        heard
            .iter()
            .for_each(|(kind, bytes)| diagnosis.heard(*kind, bytes));
        diagnosis.ended(fault, 7);
        diagnosis.suspicion()
    }

    fn line() -> LineDiagnosis {
        LineDiagnosis::new(Framing::Rtu, [Station(1), Station(2)].into_iter())
    }

    #[test]
    fn each_pattern_has_its_suspicion() {
        use TrafficKind::{Noise, OtherMaster, Reply};
        let noise = [0xFE; 20];
        let reply = [1; 7];
        for (heard, fault, expected) in [
            (&[][..], Some(Fault::Silent), LineSuspicion::NothingHeard),
            (
                &[(Noise, &noise[..7])],
                Some(Fault::Garbled),
                LineSuspicion::AlwaysDamaged,
            ),
            (
                &[(Noise, &noise[..3])],
                Some(Fault::Silent),
                LineSuspicion::DrivesAreFaster,
            ),
            (
                &[(Noise, &noise[..15])],
                Some(Fault::Silent),
                LineSuspicion::DrivesAreSlower,
            ),
            (
                &[(OtherMaster(Station(9)), &noise), (Reply, &reply)],
                None,
                LineSuspicion::OtherMaster,
            ),
        ] {
            let mut diagnosis = line();
            assert_eq!(
                exchange(&mut diagnosis, heard, fault),
                None,
                "once is chance: {expected:?}"
            );
            let found = (0..4)
                .filter_map(|_| exchange(&mut diagnosis, heard, fault))
                .last();
            assert_eq!(found, Some(expected));
        }
    }

    #[test]
    fn speed_and_parity_are_not_suspected_of_a_connection() {
        let line = || LineDiagnosis::new(Framing::Mbap, [Station(1), Station(2)].into_iter());
        for (heard, fault) in [(7, Fault::Garbled), (3, Fault::Silent), (15, Fault::Silent)] {
            let mut diagnosis = line();
            let noise = [(TrafficKind::Noise, &[0xFE; 20][..heard])];
            let found = (0..5)
                .filter_map(|_| exchange(&mut diagnosis, &noise, Some(fault)))
                .last();
            assert_eq!(found, Some(LineSuspicion::NotModbusTcp), "{heard}");
        }
        let mut diagnosis = line();
        exchange(&mut diagnosis, &[(TrafficKind::Reply, &[1; 7])], None);
        for _ in 0..SILENCES {
            diagnosis.sent(1);
            diagnosis.ended(Some(Fault::Silent), 7);
        }
        assert_eq!(
            diagnosis.suspicion(),
            Some(LineSuspicion::OneUnitSilent(Station(2)))
        );
        for suspicion in [
            LineSuspicion::NotModbusTcp,
            LineSuspicion::ServerSilent,
            LineSuspicion::OneUnitSilent(Station(2)),
        ] {
            let text = suspicion.to_string();
            assert!(
                !["speed", "parity", "wiring"]
                    .iter()
                    .any(|word| text.contains(word)),
                "{text}"
            );
        }
    }

    #[test]
    fn one_silent_drive_among_others_is_named_until_it_is_heard() {
        let mut diagnosis = line();
        exchange(&mut diagnosis, &[(TrafficKind::Reply, &[1; 7])], None);
        for _ in 0..SILENCES {
            diagnosis.sent(1);
            diagnosis.ended(Some(Fault::Silent), 7);
        }
        assert_eq!(
            diagnosis.suspicion(),
            Some(LineSuspicion::OneSilent(Station(2)))
        );
        diagnosis.ended(None, 7);
        assert_eq!(diagnosis.suspicion(), None);
    }

    #[test]
    fn an_answer_settles_what_was_suspected_of_the_whole_line() {
        let mut diagnosis = line();
        for _ in 0..SILENCES {
            exchange(&mut diagnosis, &[], Some(Fault::Silent));
        }
        assert_eq!(diagnosis.suspicion(), Some(LineSuspicion::NothingHeard));
        assert_eq!(
            exchange(&mut diagnosis, &[(TrafficKind::Reply, &[1; 7])], None),
            None
        );
    }

    #[test]
    fn frames_that_nothing_explains_name_their_station() {
        let reply = [(TrafficKind::Reply, &[1; 7][..])];
        for (stray, signs, expected) in [
            (
                StrayFrame::TooMany(Duration::ZERO),
                SIGNS,
                Some(LineSuspicion::DuplicateStation(Station(2))),
            ),
            (StrayFrame::TooMany(Duration::ZERO), SIGNS - 1, None),
            (
                StrayFrame::BeyondLimit(Duration::ZERO),
                1,
                Some(LineSuspicion::LateBeyondLimit(Station(2))),
            ),
            (StrayFrame::Explained, 100, None),
        ] {
            let mut diagnosis = line();
            (0..signs).for_each(|_| diagnosis.stray(1, stray));
            assert_eq!(
                exchange(&mut diagnosis, &reply, None),
                expected,
                "{stray:?}"
            );
        }
    }

    #[test]
    fn wrong_replies_are_named_with_both_frames() {
        let mut diagnosis = line();
        let frames = [&[1, 3, 0x20, 0, 0, 1][..], &[1, 3, 4, 0, 0, 0]].map(HeardFrame::of);
        for _ in 0..SIGNS {
            diagnosis.sent(0);
            diagnosis.wrong_reply(0, frames[0], frames[1]);
            diagnosis.ended(Some(Fault::Silent), 7);
        }
        let found = diagnosis.suspicion();
        let [request, reply] = frames;
        assert_eq!(
            found,
            Some(LineSuspicion::WrongReplies {
                station: Station(1),
                request,
                reply
            })
        );
        assert!(
            found
                .unwrap()
                .to_string()
                .contains("01 03 04 00 00 00 to 01 03 20 00 00 01"),
            "{found:?}"
        );
    }

    #[test]
    fn a_station_that_answers_each_request_in_the_wrong_form_is_told_once() {
        let mut diagnosis = line();
        let request = HeardFrame::of(&[1, 3, 0x20, 0, 0, 1]);
        let mut suspicions = Vec::new();
        for number in 0..200 {
            diagnosis.sent(0);
            diagnosis.wrong_reply(0, request, HeardFrame::of(&[1, 3, 4, 0, 0, number]));
            diagnosis.ended(Some(Fault::Silent), 7);
            suspicions.push(diagnosis.suspicion());
        }
        suspicions.dedup();
        assert!(
            matches!(
                suspicions.as_slice(),
                [
                    None,
                    Some(LineSuspicion::WrongReplies {
                        station: Station(1),
                        ..
                    })
                ]
            ),
            "{suspicions:?}"
        );
    }

    #[test]
    fn a_pattern_that_has_ended_is_forgotten() {
        let mut diagnosis = line();
        let reply = [(TrafficKind::Reply, &[1; 7][..])];
        for _ in 0..SIGNS {
            diagnosis.stray(0, StrayFrame::TooMany(Duration::ZERO));
            exchange(&mut diagnosis, &reply, None);
        }
        assert_eq!(
            diagnosis.suspicion(),
            Some(LineSuspicion::DuplicateStation(Station(1)))
        );
        let left = (0..3 * WINDOW).position(|_| exchange(&mut diagnosis, &reply, None).is_none());
        assert!(
            left.is_some_and(|left| left <= 2 * WINDOW as usize),
            "{left:?}"
        );
    }
}
