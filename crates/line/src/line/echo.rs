//! Whether a line echoes what is sent. On such a line an answer that repeats its request proves nothing unless our own
//! bytes are removed first.

use crate::domain::traffic::TrafficKind;

/// Consecutive reads without an echo before a known echo is considered gone: an adapter may lose one.
pub const CLEAN_READS: u8 = 2;

/// What is known of a line since its port was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LocalEcho {
    /// Not known: no read has completed yet, or something was seen that needs another read.
    #[default]
    Unknown,
    /// A read has ended without an echo, but without a reply as well.
    NotSeen,
    /// A reply that differs from its request arrived, with nothing like the request before it.
    Excluded,
    /// The line echoes what is sent.
    Found,
}

/// Watches for an echo of each frame. Replies to reads differ from their requests, so reads are conclusive.
#[derive(Debug, Default)]
pub struct EchoWatch {
    /// There is nothing on the line that could echo.
    is_impossible: bool,
    known: LocalEcho,
    /// The last frame sent.
    sent: Vec<u8>,
    /// The valid reply to the last frame differs from it.
    differs: bool,
    /// The exchange of the last frame is over.
    is_over: bool,
    /// Our own bytes were received.
    came_back: bool,
    /// Bytes received before its reply that are neither.
    others: usize,
    was_answered: bool,
    clean_reads: u8,
}

impl EchoWatch {
    /// A watch on a line where an echo is possible, or not.
    #[must_use]
    pub fn new(is_possible: bool) -> Self {
        Self {
            is_impossible: !is_possible,
            ..Self::default()
        }
    }

    /// What is known.
    #[must_use]
    pub const fn known(&self) -> LocalEcho {
        if self.is_impossible {
            LocalEcho::Excluded
        } else {
            self.known
        }
    }

    /// Whether an answer that repeats its request proves that the drive has sent it.
    #[must_use]
    pub const fn proves_echoes(&self) -> bool {
        matches!(self.known(), LocalEcho::Excluded | LocalEcho::Found)
    }

    /// The port was opened: there may be another adapter now.
    pub fn port_opened(&mut self) {
        *self = Self::new(!self.is_impossible);
    }

    /// `frame` is sent; `differs`: its valid reply does not repeat it.
    pub fn sent(&mut self, frame: &[u8], differs: bool) {
        let Self {
            is_impossible,
            known,
            clean_reads,
            ..
        } = *self;
        *self = Self {
            is_impossible,
            known,
            clean_reads,
            differs,
            ..Self::default()
        };
        self.sent.extend_from_slice(frame);
    }

    /// `bytes` were received and classified as `kind`.
    pub fn heard(&mut self, kind: TrafficKind, bytes: &[u8]) {
        match kind {
            TrafficKind::Echo => {
                self.known = LocalEcho::Found;
                self.came_back = true;
                self.is_supported();
            }
            TrafficKind::Reply => {
                self.was_answered = true;
                self.is_supported();
            }
            // Twice the same: an echo and the drive's reply, or two drives with the same number. A read decides.
            _ if self.is_over
                && !self.differs
                && self.known != LocalEcho::Found
                && bytes == self.sent =>
            {
                self.known = LocalEcho::Unknown;
            }
            _ if !self.was_answered => self.others += bytes.len(),
            _ => {}
        }
    }

    /// Requires new reads before an echo is considered gone. A single copy of a write does not: it may be the drive's
    /// own reply, and a drive that is sent stops until it acknowledges one would never be believed.
    const fn is_supported(&mut self) {
        if self.came_back && (self.differs || self.was_answered) {
            self.clean_reads = 0;
        }
    }

    /// A frame that only this gateway sends has come back.
    pub fn found(&mut self) {
        self.known = LocalEcho::Found;
        self.clean_reads = 0;
    }

    /// Whether the line echoes, and the last frame did not come back as it was sent.
    #[must_use]
    pub fn misses_echo(&self) -> bool {
        self.known() == LocalEcho::Found && !self.came_back
    }

    /// The exchange is over.
    pub fn ended(&mut self) {
        if std::mem::replace(&mut self.is_over, true) || !self.differs || self.came_back {
            return;
        }
        // Noise of half our frame's length may be a damaged echo.
        if self.others * 2 >= self.sent.len() {
            self.clean_reads = 0;
            return;
        }
        self.clean_reads = self.clean_reads.saturating_add(1);
        let is_gone = self.known != LocalEcho::Found || self.clean_reads >= CLEAN_READS;
        if is_gone && self.was_answered {
            self.known = LocalEcho::Excluded;
        } else if is_gone && self.known != LocalEcho::Excluded {
            self.known = LocalEcho::NotSeen;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_nothing_can_echo_no_copy_is_an_echo() {
        let mut watch = EchoWatch::new(false);
        for kind in [
            TrafficKind::Echo,
            TrafficKind::Stray(crate::domain::ids::Station(1)),
        ] {
            watch.port_opened();
            watch.sent(b"frame", false);
            watch.ended();
            watch.heard(kind, b"frame");
            assert_eq!(
                (watch.known(), watch.misses_echo()),
                (LocalEcho::Excluded, false)
            );
            assert!(watch.proves_echoes());
        }
    }
    use crate::domain::ids::Station;
    use TrafficKind::{Echo, Noise, Reply, Stray};

    const READ: [u8; 8] = [0x01, 0x03, 0x01, 0x01, 0x00, 0x01, 0xD4, 0x36];
    const REPLY: [u8; 7] = [0x01, 0x03, 0x02, 0x17, 0x70, 0xB6, 0x50];
    const WRITE: [u8; 8] = [0x01, 0x06, 0x00, 0x02, 0x00, 0x01, 0xE9, 0xCA];

    fn exchange(watch: &mut EchoWatch, heard: &[(TrafficKind, &[u8])]) -> LocalEcho {
        watch.sent(&READ, true);
        for (kind, bytes) in heard {
            watch.heard(*kind, bytes);
        }
        watch.ended();
        watch.known()
    }

    #[test]
    fn a_read_tells_whether_our_own_bytes_come_back() {
        for (heard, expected) in [
            (&[(Reply, &REPLY[..])][..], LocalEcho::Excluded),
            (&[], LocalEcho::NotSeen),
            (&[(Echo, &READ), (Reply, &REPLY)], LocalEcho::Found),
            (&[(Echo, &READ)], LocalEcho::Found),
            (&[(Noise, &[0x55]), (Reply, &REPLY)], LocalEcho::Excluded),
            (&[(Noise, &READ[..7]), (Reply, &REPLY)], LocalEcho::Unknown),
            (&[(Noise, &READ[..7])], LocalEcho::Unknown),
            (&[(Reply, &REPLY), (Noise, &READ)], LocalEcho::Excluded),
        ] {
            assert_eq!(
                exchange(&mut EchoWatch::default(), heard),
                expected,
                "{heard:02X?}"
            );
        }
    }

    #[test]
    fn an_echo_is_believed_until_two_reads_in_a_row_come_without_it() {
        let with = &[(Echo, &READ[..]), (Reply, &REPLY[..])][..];
        let without = &[(Reply, &REPLY[..])][..];
        let mut watch = EchoWatch::default();
        assert_eq!(exchange(&mut watch, without), LocalEcho::Excluded);
        for (heard, expected) in [
            (with, LocalEcho::Found),
            (without, LocalEcho::Found),
            (with, LocalEcho::Found),
            (without, LocalEcho::Found),
            (without, LocalEcho::Excluded),
            (&[], LocalEcho::Excluded),
        ] {
            assert_eq!(exchange(&mut watch, heard), expected);
        }
        watch.port_opened();
        assert_eq!(watch.known(), LocalEcho::Unknown);
    }

    /// The copy of a write may be the drive's own reply, mistaken for an echo.
    #[test]
    fn only_a_write_that_comes_back_twice_supports_the_belief_in_an_echo() {
        for (heard, expected) in [
            (&[(Echo, &WRITE)][..], LocalEcho::Excluded),
            (&[(Echo, &WRITE), (Reply, &WRITE)], LocalEcho::Found),
        ] {
            let mut watch = EchoWatch::default();
            assert_eq!(
                exchange(&mut watch, &[(Echo, &READ), (Reply, &REPLY)]),
                LocalEcho::Found
            );
            assert_eq!(exchange(&mut watch, &[(Reply, &REPLY)]), LocalEcho::Found);
            watch.sent(&WRITE, false);
            heard
                .iter()
                .for_each(|(kind, bytes)| watch.heard(*kind, *bytes));
            watch.ended();
            assert_eq!(watch.known(), LocalEcho::Found);
            assert_eq!(
                exchange(&mut watch, &[(Reply, &REPLY)]),
                expected,
                "{heard:02X?}"
            );
        }
    }

    #[test]
    fn a_write_that_is_answered_twice_makes_another_read_necessary() {
        let mut watch = EchoWatch::default();
        exchange(&mut watch, &[(Reply, &REPLY)]);
        watch.sent(&WRITE, false);
        watch.heard(Reply, &WRITE);
        watch.ended();
        assert_eq!(
            watch.known(),
            LocalEcho::Excluded,
            "a write alone tells nothing"
        );
        watch.heard(Stray(Station(1)), &WRITE);
        assert_eq!(watch.known(), LocalEcho::Unknown);
        assert_eq!(
            exchange(&mut watch, &[(Reply, &REPLY)]),
            LocalEcho::Excluded,
            "it was a second drive"
        );
    }
}
