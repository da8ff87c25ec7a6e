//! What went over the pair, frame by frame, and who was master of it.

use super::wire::Character;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::wire::crc;

/// An end that has been silent for this long has left the line to others.
const HAS_LEFT: Duration = Duration::from_secs(1);

/// The stations of a frame for all drives: that of Modbus, and that of an N700.
pub const FOR_ALL: [u8; 2] = [0, 255];

/// Characters that one end sent without a pause.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    pub from: usize,
    pub start: MonoTime,
    pub end: MonoTime,
    pub bytes: Vec<u8>,
    /// Another end spoke at the same time.
    pub is_damaged: bool,
}

impl Frame {
    /// The register and the word of a single write to `station`, broadcasts included.
    pub fn written(&self, station: u8) -> Option<(u16, u16)> {
        match self.bytes[..] {
            [to, 6, high, low, word_high, word_low, _, _]
                if (to == station || FOR_ALL.contains(&to)) && self.is_sound() =>
            {
                Some((
                    u16::from_be_bytes([high, low]),
                    u16::from_be_bytes([word_high, word_low]),
                ))
            }
            _ => None,
        }
    }

    /// Whether it is the answer of a gateway that only listens, to the question whether one does.
    pub fn is_of_listener(&self) -> bool {
        matches!(self.bytes[..], [250, 3, _, _, 0, 76, _, _])
    }

    /// Whether it was whole, and heard as it was sent.
    pub fn is_sound(&self) -> bool {
        !self.is_damaged && self.bytes.len() >= 4 && crc::is_sound(&self.bytes)
    }
}

/// All frames in the order in which they began to be heard.
#[derive(Default)]
pub struct Record {
    pub frames: Vec<Frame>,
    /// Of each end its newest.
    newest: Vec<Option<usize>>,
}

impl Record {
    pub fn new(ends: usize) -> Self {
        Self {
            frames: Vec::new(),
            newest: vec![None; ends],
        }
    }

    pub fn add(&mut self, character: &Character) {
        let pause = character.end.since(character.start) / 2;
        let newest = self.newest[character.from].map(|place| &mut self.frames[place]);
        if let Some(frame) = newest.filter(|frame| character.start <= frame.end + pause) {
            frame.end = character.end;
            frame.bytes.push(character.sent);
            frame.is_damaged |= character.is_damaged();
            return;
        }
        self.newest[character.from] = Some(self.frames.len());
        self.frames.push(Frame {
            from: character.from,
            start: character.start,
            end: character.end,
            bytes: vec![character.sent],
            is_damaged: character.is_damaged(),
        });
    }
}

/// Two masters that came upon each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Meeting {
    pub at: MonoTime,
    /// Frames that the one sent which then left, from the first frame of the newcomer on.
    pub frames: usize,
    /// From the first frame of the newcomer to the last one of the one which left.
    pub lasted: Duration,
}

/// Each time that a master sent less than [`HAS_LEFT`] after another one, up to when only one was left.
pub fn meetings(frames: &[Frame], masters: &[usize]) -> Vec<Meeting> {
    let is_of_master = |frame: &&Frame| masters.contains(&frame.from) && !frame.is_of_listener();
    let sent: Vec<_> = frames.iter().filter(is_of_master).collect();
    let mut meetings = Vec::new();
    let mut place = 1;
    while place < sent.len() {
        let (before, newcomer) = (sent[place - 1], sent[place]);
        place += 1;
        if newcomer.from == before.from || newcomer.start.since(before.end) >= HAS_LEFT {
            continue;
        }
        // It is over when one of them sends and no other has done so for a while.
        let (mut last, mut changed) = (newcomer, newcomer.start);
        while let Some(next) = sent
            .get(place)
            .filter(|next| next.start.since(changed) < HAS_LEFT)
        {
            if next.from != last.from {
                changed = next.start;
            }
            last = *next;
            place += 1;
        }
        let during = |frame: &&&Frame| frame.start >= newcomer.start && frame.start <= last.start;
        let left: Vec<_> = sent
            .iter()
            .filter(during)
            .filter(|frame| frame.from != last.from)
            .collect();
        let lasted = left
            .iter()
            .map(|frame| frame.end.since(newcomer.start))
            .max()
            .unwrap_or_default();
        meetings.push(Meeting {
            at: newcomer.start,
            frames: left.len(),
            lasted,
        });
    }
    meetings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(from: usize, start_ms: u64) -> Frame {
        let (start, end) = (
            MonoTime::from_millis(start_ms),
            MonoTime::from_millis(start_ms + 8),
        );
        Frame {
            from,
            start,
            end,
            bytes: Vec::new(),
            is_damaged: false,
        }
    }

    fn seen(frames: &[(usize, u64)]) -> Vec<(usize, u128)> {
        let frames: Vec<_> = frames.iter().map(|(from, at)| frame(*from, *at)).collect();
        meetings(&frames, &[0, 1])
            .iter()
            .map(|meeting| (meeting.frames, meeting.lasted.as_millis()))
            .collect()
    }

    #[test]
    fn one_that_takes_a_silent_line_meets_nobody() {
        assert_eq!(
            seen(&[(0, 0), (0, 100), (1, 2_600), (1, 2_700), (0, 9_000)]),
            []
        );
        assert_eq!(
            seen(&[(0, 0), (2, 10), (0, 100), (2, 110)]),
            [],
            "drives are no masters"
        );
    }

    #[test]
    fn one_frame_into_the_line_of_another_is_a_meeting_of_one_frame() {
        assert_eq!(
            seen(&[(0, 0), (0, 100), (1, 150), (0, 200), (0, 300), (0, 1_400)]),
            [(1, 8)]
        );
        // The first one has said nothing behind the frame of the newcomer.
        assert_eq!(
            seen(&[(0, 0), (0, 100), (1, 150), (1, 200), (1, 1_400)]),
            [(0, 0)]
        );
    }

    #[test]
    fn two_who_stay_are_counted_until_one_leaves() {
        let both = [
            (0, 0),
            (1, 500),
            (0, 600),
            (1, 700),
            (0, 800),
            (1, 900),
            (1, 1_900),
            (1, 2_500),
        ];
        assert_eq!(seen(&both), [(2, 308)]);
    }
}
