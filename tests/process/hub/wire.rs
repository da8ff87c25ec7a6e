//! The pair of wires: characters of all ends, each at its time, and which of them damage each other.

use std::collections::VecDeque;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;

/// The pair. Ends lie on it in the order of their numbers.
///
/// A character that another end speaks into is damaged for every end that listens, and so is the other one. An end that
/// speaks does not hear: the receiver of an RS-485 adapter is off while it transmits.
pub struct Wire {
    character: Duration,
    ends: Vec<End>,
    /// The pair is cut behind this end.
    cut_behind: Option<usize>,
    random: fastrand::Rng,
}

#[derive(Default)]
struct End {
    waiting: VecDeque<Character>,
    /// The end of the last character that was put in.
    busy_until: MonoTime,
    /// The end of the last one that went over the pair.
    spoke_until: MonoTime,
}

/// A character on the pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Character {
    pub from: usize,
    pub start: MonoTime,
    pub end: MonoTime,
    /// As it was sent.
    pub sent: u8,
    /// As it is heard.
    pub heard: u8,
}

impl Character {
    pub const fn is_damaged(&self) -> bool {
        self.sent != self.heard
    }
}

impl Wire {
    /// A pair with `ends` ends whose characters last for `character` each.
    pub fn new(ends: usize, character: Duration) -> Self {
        let ends = (0..ends).map(|_| End::default()).collect();
        Self {
            character,
            ends,
            cut_behind: None,
            random: fastrand::Rng::with_seed(1),
        }
    }

    /// Cuts the pair behind an end, or repairs it.
    pub fn cut(&mut self, behind: Option<usize>) {
        self.cut_behind = behind;
    }

    /// `end` begins to send `bytes` at `at`, or as soon as what it sends already is over.
    pub fn put(&mut self, at: MonoTime, end: usize, bytes: &[u8]) {
        let speaker = &mut self.ends[end];
        for byte in bytes {
            let start = speaker.busy_until.max(at);
            speaker.busy_until = start + self.character;
            let character = Character {
                from: end,
                start,
                end: speaker.busy_until,
                sent: *byte,
                heard: *byte,
            };
            speaker.waiting.push_back(character);
        }
    }

    /// `end` begins to speak at `at`, for `time` and without order.
    pub fn babble(&mut self, at: MonoTime, end: usize, time: Duration) {
        let count = time.as_nanos() / self.character.as_nanos().max(1);
        let bytes: Vec<u8> = (0..count).map(|_| self.random.u8(..)).collect();
        self.put(at, end, &bytes);
    }

    /// What `end` has not sent yet is lost.
    pub fn silence(&mut self, end: usize) {
        self.ends[end].waiting.clear();
        self.ends[end].busy_until = self.ends[end].spoke_until;
    }

    /// When the first of those that speak now will have said all.
    pub fn next_pause(&self) -> Option<MonoTime> {
        self.ends
            .iter()
            .filter(|end| !end.waiting.is_empty())
            .map(|end| end.busy_until)
            .min()
    }

    /// The next character that is over at `until`, and the ends that hear it.
    pub fn take(&mut self, until: MonoTime) -> Option<(Character, Vec<usize>)> {
        let first = self
            .ends
            .iter()
            .filter_map(|end| end.waiting.front())
            .min_by_key(|character| character.end)?;
        if first.end > until {
            return None;
        }
        let mut character = *first;
        let others = (0..self.ends.len())
            .filter(|end| *end != character.from && self.reaches(character.from, *end));
        let (speaking, listening): (Vec<_>, Vec<_>) =
            others.partition(|end| self.ends[*end].speaks_during(&character));
        if !speaking.is_empty() {
            character.heard ^= self.random.u8(1..);
        }
        let speaker = &mut self.ends[character.from];
        speaker.waiting.pop_front();
        speaker.spoke_until = character.end;
        Some((character, listening))
    }

    fn reaches(&self, from: usize, to: usize) -> bool {
        self.cut_behind
            .is_none_or(|cut| (from <= cut) == (to <= cut))
    }
}

impl End {
    fn speaks_during(&self, character: &Character) -> bool {
        let spoke = self.spoke_until > character.start;
        spoke
            || self
                .waiting
                .front()
                .is_some_and(|next| next.start < character.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHARACTER: Duration = Duration::from_millis(1);

    fn ms(millis: u64) -> MonoTime {
        MonoTime::from_millis(millis)
    }

    /// What each of the three ends has heard until `until`.
    fn heard(wire: &mut Wire, until: u64) -> [Vec<u8>; 3] {
        let mut heard = [Vec::new(), Vec::new(), Vec::new()];
        while let Some((character, ends)) = wire.take(ms(until)) {
            for end in ends {
                heard[end].push(character.heard);
            }
        }
        heard
    }

    #[test]
    fn all_others_hear_a_character_when_it_is_over() {
        let mut wire = Wire::new(3, CHARACTER);
        wire.put(ms(10), 1, b"ab");
        assert_eq!(wire.next_pause(), Some(ms(12)));
        assert_eq!(heard(&mut wire, 10), [b"", b"", b""]);
        assert_eq!(heard(&mut wire, 11), [b"a", &b""[..], b"a"]);
        wire.put(ms(11), 1, b"c");
        assert_eq!(
            heard(&mut wire, 13),
            [b"bc", &b""[..], b"bc"],
            "one behind the other"
        );
        assert_eq!(wire.next_pause(), None);
    }

    #[test]
    fn who_speaks_at_the_same_time_hears_nothing_and_is_heard_damaged() {
        let mut wire = Wire::new(3, CHARACTER);
        wire.put(ms(10), 0, b"abc");
        wire.put(MonoTime::from_micros(11_500), 2, b"x");
        let [first, between, last] = heard(&mut wire, 20);
        assert_eq!((first.as_slice(), last.as_slice()), (&b""[..], &b"a"[..]));
        assert_eq!(between.len(), 4);
        assert_eq!(between[0], b'a');
        assert!(
            between[1] != b'b' && between[2] != b'x' && between[3] != b'c',
            "{between:?}"
        );
    }

    #[test]
    fn behind_a_cut_nothing_is_heard_and_nothing_is_damaged() {
        let mut wire = Wire::new(3, CHARACTER);
        wire.cut(Some(1));
        wire.put(ms(10), 0, b"a");
        wire.put(ms(10), 2, b"x");
        assert_eq!(heard(&mut wire, 20), [b"", &b"a"[..], b""]);
        wire.cut(None);
        wire.put(ms(20), 2, b"y");
        assert_eq!(heard(&mut wire, 30), [&b"y"[..], b"y", b""]);
    }

    #[test]
    fn what_was_not_sent_when_an_end_is_pulled_out_is_lost() {
        let mut wire = Wire::new(3, CHARACTER);
        wire.put(ms(10), 0, b"abc");
        assert_eq!(heard(&mut wire, 11)[1], b"a");
        wire.silence(0);
        wire.put(ms(12), 0, b"d");
        assert_eq!(heard(&mut wire, 20)[1], b"d");
    }
}
