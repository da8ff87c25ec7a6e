//! The wire: frames of the gateway, what comes back, and O5 and O6.

use super::Checker;
use super::crc;
use super::log::What;
use super::tables::Run;

/// Exchanges that are kept.
const KEPT: usize = 256;
/// Most words of one reply that are kept.
pub const WORDS: usize = 40;
/// Most bytes that are kept of what was heard since the last frame.
const HEARD: usize = 600;
/// A stop is sent over a node that has talked for this long without a pause.
const JAMMED: u64 = 500_000_000;
/// How long the drives are left alone after a frame to all of them.
const TURNAROUND: u64 = 100_000_000;
/// Replies of a drive whose slowest determines how long a stop for another drive may have to wait for it.
const REPLIES: usize = 64;
/// The shortest wait for a reply that the gateway may have: that for a drive known to be silent.
const PROBE: u64 = 100_000_000;

/// The actual reply of the addressed drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Truth {
    /// Nothing.
    Silence,
    /// Words; how many.
    Words(u8),
    /// What a write or a loop test is answered with; the word that the drive holds.
    Holds(u16),
    Exception(u8),
}

/// One exchange.
#[derive(Clone, Copy, Debug)]
pub struct Exchange {
    /// First bit and last bit of our frame.
    pub at: u64,
    pub end: u64,
    pub station: u8,
    pub function: u8,
    pub address: u16,
    /// Words that are read or written.
    pub count: u16,
    /// The first word that is written, and the second of a block.
    pub values: [u16; 2],
    pub truth: Truth,
    pub words: [u16; WORDS],
    /// When the drive's reply in this exchange was received.
    pub heard_at: Option<u64>,
    /// The wait for the reply, in ns.
    pub timeout: u64,
}

/// The wire so far.
#[derive(Debug)]
pub struct Wire {
    silence: u64,
    exchanges: Vec<Exchange>,
    count: u64,
    /// The port was opened or a byte was handed over last at this moment.
    quiet_from: u64,
    heard: Vec<u8>,
    truth: Vec<u8>,
    /// Since when bytes were received or sent without a silence in between.
    talks_since: u64,
    /// The last frame was sent over a talking node, and is waited for until then.
    waits_in_jam_until: u64,
    /// The drives are left alone until then.
    held_until: u64,
    /// How long the newest replies took to begin, for each station; and how many there were.
    replies: Vec<(u8, [u64; REPLIES], usize)>,
    /// The last exchange is still open.
    is_open: bool,
    is_up: bool,
    /// Bytes were received that look like the reply to the open exchange but are not.
    was_mistakable: bool,
    /// When the port was last opened.
    up_since: u64,
    /// When bytes that are not a complete reply were last received.
    pub noise_at: u64,
    pub shortest_excess: u64,
}

impl Wire {
    pub fn new(silence: u64) -> Self {
        Self {
            silence,
            exchanges: Vec::with_capacity(KEPT),
            count: 0,
            quiet_from: 0,
            heard: Vec::with_capacity(HEARD),
            truth: Vec::with_capacity(300),
            talks_since: 0,
            waits_in_jam_until: 0,
            held_until: 0,
            replies: Vec::with_capacity(8),
            is_open: false,
            is_up: false,
            was_mistakable: false,
            up_since: 0,
            noise_at: 0,
            shortest_excess: u64::MAX,
        }
    }

    /// Exchanges so far.
    pub const fn count(&self) -> u64 {
        self.count
    }

    pub const fn is_up(&self) -> bool {
        self.is_up
    }

    /// When the port was last opened.
    pub const fn up_since(&self) -> u64 {
        self.up_since
    }

    /// The exchange that was sent last.
    pub fn newest(&self) -> Option<&Exchange> {
        self.back(0)
    }

    /// The exchange that was sent `back` exchanges before the last.
    pub fn back(&self, back: usize) -> Option<&Exchange> {
        let number = (self.count as usize).checked_sub(back + 1)?;
        if back >= KEPT {
            None
        } else {
            self.exchanges.get(number % KEPT)
        }
    }

    /// A reply of `station` began `after` the end of the request.
    fn replied(&mut self, station: u8, after: u64) {
        match self.replies.iter_mut().find(|it| it.0 == station) {
            Some((_, times, count)) => {
                times[*count % REPLIES] = after;
                *count += 1;
            }
            None => self.replies.push((station, [after; REPLIES], 1)),
        }
    }

    /// The slowest of the newest replies of `station`; `None` while there were few.
    fn slowest_reply(&self, station: u8) -> Option<u64> {
        let (_, times, count) = self.replies.iter().find(|it| it.0 == station)?;
        if *count < REPLIES {
            None
        } else {
            times.iter().max().copied()
        }
    }

    fn newest_mut(&mut self) -> Option<&mut Exchange> {
        let place = (self.count as usize).checked_sub(1)? % KEPT;
        self.exchanges.get_mut(place)
    }

    fn push(&mut self, exchange: Exchange) {
        let place = self.count as usize % KEPT;
        if place < self.exchanges.len() {
            self.exchanges[place] = exchange;
        } else {
            self.exchanges.push(exchange);
        }
        self.count += 1;
    }
}

impl Checker {
    /// The port was opened or lost at `at`.
    pub fn port(&mut self, at: u64, is_up: bool) {
        self.log
            .add(at, What::Port, 0, if is_up { b"up" } else { b"down" });
        self.wire.is_up = is_up;
        self.wire.is_open = false;
        self.wire.quiet_from = at;
        self.wire.up_since = at;
        self.port_changed(at, is_up);
    }

    /// The gateway wrote `frame` to the port at `at`, and the addressed drive replied with `truth`, if at all.
    pub fn request(&mut self, at: u64, frame: &[u8], truth: &[u8]) {
        self.log.add(at, What::Frame, 0, frame);
        self.log.add(at, What::Truth, 0, truth);
        self.time(at);
        if !self.wire.is_up {
            self.object("O1", || "a frame left while the port was closed".to_owned());
        }
        let gap = at.saturating_sub(self.wire.quiet_from);
        let is_over_babble = self.is_stop(frame) && at >= self.wire.talks_since + JAMMED;
        if gap < self.wire.silence && !is_over_babble {
            let asked = self.wire.silence;
            self.object("O5", || {
                format!("{gap} ns of silence before a frame, {asked} are asked for")
            });
        }
        if at < self.wire.held_until {
            self.object("O5", || {
                "the drives are not left alone after a frame to all of them".to_owned()
            });
        }
        if gap >= self.wire.silence {
            self.wire.talks_since = at;
        }
        self.wire.waits_in_jam_until = 0;
        if !is_over_babble {
            self.wire.shortest_excess = self
                .wire
                .shortest_excess
                .min(gap.wrapping_sub(self.wire.silence));
        }
        self.may_open(at, frame);
        if Some(frame[0]) == self.line.broadcast() {
            self.told_to_all(at, frame);
            if is_over_babble && gap < self.wire.silence {
                self.wire.waits_in_jam_until = self.wire.held_until;
            }
            return;
        }
        let Some(mut exchange) = self.read_frame(at, frame) else {
            return self.object("O1", || format!("no sound frame: {frame:02X?}"));
        };
        (exchange.truth, exchange.words) = truth_of(&exchange, truth);
        self.wire.quiet_from = exchange.end;
        if is_over_babble && gap < self.wire.silence {
            let reply = self.line.on_wire(reply_bytes(&exchange));
            self.wire.waits_in_jam_until = exchange.end + exchange.timeout + reply;
        }
        self.wire.heard.clear();
        self.wire.was_mistakable = false;
        self.wire.truth.clear();
        self.wire.truth.extend_from_slice(truth);
        self.wire.is_open = true;
        self.wire.push(exchange);
        if matches!(exchange.function, 6 | 16) {
            self.written(&exchange);
        }
    }

    /// A frame that stops all drives: each must have a stop to wait for, and none answers.
    fn told_to_all(&mut self, at: u64, frame: &[u8]) {
        self.wire.is_open = false;
        let end = at + self.line.on_wire(frame.len());
        self.wire.quiet_from = end;
        self.wire.held_until = end + TURNAROUND;
        self.wire.heard.clear();
        for drive in self.line.drives.clone() {
            let own = [&[drive.station], &frame[1..frame.len() - 2]].concat();
            let sound = [own.as_slice(), &crc::of(&own).to_le_bytes()].concat();
            match self.read_frame(at, &sound) {
                Some(exchange) if self.is_stop(&sound) => {
                    self.written(&exchange);
                    if let Some(place) = self
                        .line
                        .drives
                        .iter()
                        .position(|it| it.station == drive.station)
                    {
                        self.stop_sent(at, place);
                    }
                }
                _ => self.object("O1", || format!("not for all: {frame:02X?}")),
            }
        }
    }

    /// Whether `frame` is a stop, for any station.
    fn is_stop(&self, frame: &[u8]) -> bool {
        let word = |at: usize| u16::from_be_bytes([frame[at], frame[at + 1]]);
        let written = match (frame[1], frame.len()) {
            (6, 8) => word(4),
            (16, 11) => word(7),
            _ => return false,
        };
        let mut kinds = self.line.drives.iter().map(|drive| drive.kind.facts());
        kinds.any(|facts| {
            word(2) == facts.run && matches!(facts.run_of(written), Some(Run::Stop | Run::Coast))
        })
    }

    /// O6: the exchange before must be over: answered, damaged and followed by silence, or waited for. A stop for
    /// another drive waits only until the slowest reply would have arrived.
    fn may_open(&mut self, at: u64, frame: &[u8]) {
        let Some(last) = self.wire.newest().filter(|_| self.wire.is_open) else {
            return;
        };
        let waited = at.saturating_sub(last.end);
        let is_damaged = !self.wire.heard.is_empty() || self.wire.was_mistakable;
        if last.heard_at.is_some() || is_damaged || waited >= last.timeout.min(PROBE) {
            return;
        }
        let is_cut = frame[0] != last.station && self.is_stop(frame);
        let reply = self.line.on_wire(reply_bytes(last));
        let slowest = self.wire.slowest_reply(last.station).filter(|_| is_cut);
        if slowest.is_some_and(|slowest| waited >= slowest + reply) {
            return;
        }
        let station = last.station;
        self.object("O6", || {
            format!("a frame {waited} ns after one to station {station} that is not answered")
        });
    }

    fn read_frame(&self, at: u64, frame: &[u8]) -> Option<Exchange> {
        if !crc::is_right(frame) || frame.len() < 8 {
            return None;
        }
        let word = |at: usize| u16::from_be_bytes([frame[at], frame[at + 1]]);
        let station = frame[0];
        let function = frame[1];
        let drive = self
            .line
            .drives
            .iter()
            .find(|drive| drive.station == station)?;
        let (count, values) = match (function, frame.len()) {
            (3, 8) => (word(4), [0; 2]),
            (6 | 8, 8) => (1, [word(4), 0]),
            (16, 11) if word(4) == 1 => (1, [word(7), 0]),
            (16, 13) if word(4) == 2 => (2, [word(7), word(9)]),
            _ => return None,
        };
        Some(Exchange {
            at,
            end: at + self.line.on_wire(frame.len()),
            station,
            function,
            address: word(2),
            count,
            values,
            truth: Truth::Silence,
            words: [0; WORDS],
            heard_at: None,
            timeout: drive.timeout,
        })
    }

    /// The gateway received `bytes` at `at`.
    pub fn heard(&mut self, at: u64, bytes: &[u8]) {
        self.log.add(at, What::Heard, 0, bytes);
        self.time(at);
        let wire = &mut self.wire;
        // No frame can be sent in a silence that falls into the wait for our own frame, nor in one that ends at the
        // moment in which it is long enough: the node goes on talking.
        if at > (wire.quiet_from + wire.silence).max(wire.waits_in_jam_until) {
            wire.talks_since = at;
        }
        wire.quiet_from = wire.quiet_from.max(at);
        if wire.heard.len() + bytes.len() > HEARD {
            wire.heard.clear();
        }
        wire.heard.extend_from_slice(bytes);
        while let Some(last) = wire
            .newest()
            .filter(|last| wire.is_open && last.heard_at.is_none())
        {
            let Some(place) = reply_in(last, &wire.heard) else {
                break;
            };
            if wire.heard[place.clone()] != wire.truth[..] {
                // It looks like the reply but is not, so the reply may still arrive.
                wire.heard.drain(..place.end);
                wire.was_mistakable = true;
                self.counts.mistakable += 1;
                continue;
            }
            if let Some(last) = wire.newest_mut() {
                last.heard_at = Some(at);
            }
            let last = *last_of(&self.wire);
            let reply = self.line.on_wire(self.wire.truth.len());
            let after = at.saturating_sub(last.end + reply);
            // Late replies need not be learned from.
            if after <= last.timeout {
                self.wire.replied(last.station, after);
            }
            return self.answered(at, &last);
        }
        wire.noise_at = at;
    }
}

fn last_of(wire: &Wire) -> &Exchange {
    wire.newest().expect("there is one")
}

/// Length of the normal reply to `exchange`.
fn reply_bytes(exchange: &Exchange) -> usize {
    if exchange.function == 3 {
        5 + 2 * usize::from(exchange.count)
    } else {
        8
    }
}

/// The position of a sound reply to `exchange` in `bytes`.
fn reply_in(exchange: &Exchange, bytes: &[u8]) -> Option<std::ops::Range<usize>> {
    let length = reply_bytes(exchange);
    (0..bytes.len().saturating_sub(4)).find_map(|start| {
        let rest = &bytes[start..];
        if rest[0] != exchange.station {
            return None;
        }
        let length = match rest[1] {
            3 if rest
                .get(2)
                .is_some_and(|bytes| usize::from(*bytes) != length - 5) =>
            {
                return None;
            }
            function if function == exchange.function => length,
            function if function == exchange.function | 0x80 => 5,
            _ => return None,
        };
        let is_sound = rest.len() >= length && crc::is_right(&rest[..length]);
        is_sound.then_some(start..start + length)
    })
}

/// The meaning of `frame`, which a drive sent, in `exchange`.
fn truth_of(exchange: &Exchange, frame: &[u8]) -> (Truth, [u16; WORDS]) {
    let mut words = [0; WORDS];
    let word = |at: usize| {
        frame
            .get(at..at + 2)
            .map_or(0, |it| u16::from_be_bytes([it[0], it[1]]))
    };
    let truth = match frame.get(1) {
        None => Truth::Silence,
        Some(function) if function & 0x80 != 0 => Truth::Exception(frame[2]),
        Some(3) => {
            let count = usize::from(exchange.count).min(WORDS);
            words
                .iter_mut()
                .take(count)
                .enumerate()
                .for_each(|(place, it)| *it = word(3 + 2 * place));
            Truth::Words(count as u8)
        }
        Some(16) => Truth::Holds(exchange.values[0]),
        Some(_) => Truth::Holds(word(4)),
    };
    (truth, words)
}
