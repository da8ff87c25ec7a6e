//! Whether a line echoes what is sent: on such a line every answer that repeats its request is worthless.

use crate::domain::traffic::TrafficKind;

/// What is known of a line since its port was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LocalEcho {
    /// Nothing yet.
    #[default]
    Unknown,
    /// A reply that differs from its request came, and nothing before it.
    Excluded,
    /// What was sent came back.
    Found,
}

/// Watches the reads of one line: their replies differ from their requests.
#[derive(Debug, Default)]
pub struct EchoWatch {
    known: LocalEcho,
    /// The frame of the read that is on the wire.
    sent: Vec<u8>,
    /// What was heard since, as far as it could be that frame.
    heard: Vec<u8>,
}

impl EchoWatch {
    /// What is known.
    #[must_use]
    pub const fn known(&self) -> LocalEcho {
        self.known
    }

    /// The port was opened: another adapter may stand there now.
    pub fn port_opened(&mut self) {
        *self = Self::default();
    }

    /// `frame` goes out.
    pub fn sent(&mut self, frame: &[u8], is_read: bool) {
        self.sent.clear();
        self.heard.clear();
        if is_read {
            self.sent.extend_from_slice(frame);
        }
    }

    /// `bytes` were heard, as `kind`.
    pub fn heard(&mut self, kind: TrafficKind, bytes: &[u8]) {
        if self.sent.is_empty() {
            return;
        }
        if kind == TrafficKind::Reply {
            if self.heard.is_empty() && self.known == LocalEcho::Unknown {
                self.known = LocalEcho::Excluded;
            }
            self.sent.clear();
            return;
        }
        let room = self.sent.len() - self.heard.len();
        self.heard.extend(bytes.iter().take(room));
        if self.heard == self.sent {
            self.known = LocalEcho::Found;
            self.sent.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::ids::Station;

    const READ: [u8; 8] = [0x01, 0x03, 0x01, 0x01, 0x00, 0x01, 0xD4, 0x36];
    const REPLY: [u8; 7] = [0x01, 0x03, 0x02, 0x17, 0x70, 0xB6, 0x50];

    fn known(is_read: bool, heard: &[(TrafficKind, &[u8])]) -> LocalEcho {
        let mut watch = EchoWatch::default();
        watch.sent(&READ, is_read);
        for (kind, bytes) in heard {
            watch.heard(*kind, bytes);
        }
        watch.known()
    }

    #[test]
    fn a_reply_alone_excludes_an_echo_and_the_request_before_it_is_one() {
        use TrafficKind::{Noise, Reply, Stray};
        let stray = Stray(Station(1));
        for (is_read, heard, expected) in [
            (true, &[(Reply, &REPLY[..])][..], LocalEcho::Excluded),
            (false, &[(Reply, &REPLY)], LocalEcho::Unknown),
            (true, &[(Noise, &READ), (Reply, &REPLY)], LocalEcho::Found),
            (true, &[(stray, &READ), (Reply, &REPLY)], LocalEcho::Found),
            (true, &[(Noise, &READ)], LocalEcho::Found),
            (true, &[(Noise, &READ[..3]), (Noise, &READ[3..])], LocalEcho::Found),
            (true, &[(Noise, &[0x55]), (Reply, &REPLY)], LocalEcho::Unknown),
            (true, &[(Noise, &READ[..7]), (Reply, &REPLY)], LocalEcho::Unknown),
            (true, &[(Reply, &REPLY), (Noise, &READ)], LocalEcho::Excluded),
        ] {
            assert_eq!(known(is_read, heard), expected, "{heard:02X?}");
        }
    }

    #[test]
    fn an_echo_is_believed_until_the_port_is_opened_again() {
        let mut watch = EchoWatch::default();
        let read = |watch: &mut EchoWatch, before: &[u8]| {
            watch.sent(&READ, true);
            watch.heard(TrafficKind::Noise, before);
            watch.heard(TrafficKind::Reply, &REPLY);
            watch.known()
        };
        assert_eq!(read(&mut watch, &[]), LocalEcho::Excluded);
        assert_eq!(read(&mut watch, &READ), LocalEcho::Found, "somebody has switched it on");
        assert_eq!(read(&mut watch, &[]), LocalEcho::Found);
        watch.port_opened();
        assert_eq!(read(&mut watch, &[]), LocalEcho::Excluded);
    }
}
