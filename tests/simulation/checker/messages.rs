//! The side of the broker: commands and their results. Topics and payloads are parsed independently.

use super::Checker;
use super::book::{Order, Wish};
use super::log::What;
use super::orders::DEADLINE;
use super::tables::Run;

/// After a stop a plain RUN is accepted only after this time.
const RESTART_DELAY: u64 = 2_000_000_000;
/// The greatest age of a message that arrived while no stall of the path was noticed: the time between two probes, and
/// until one is overdue.
const UNNOTICED: u64 = 1_350_000_000;
/// The same while a connection is so young that its usual round trip is not known.
const UNNOTICED_WHEN_YOUNG: u64 = 1_750_000_000;
const YOUNG: u64 = 10_000_000_000;
/// How far the clock of a client may be ahead, in ms.
const AHEAD: u64 = 2_000;
/// Commands with an id, and epochs, that are remembered.
const KEPT: usize = 64;

/// The state of the broker's side.
#[derive(Debug, Default)]
pub struct Messages {
    /// Ids with the drive and the order that they were first used for.
    ids: Vec<(u64, usize, u64)>,
    /// Drive, epoch, and when it was first shown.
    epochs: Vec<(usize, u64, u64)>,
    /// Stamps of commands, and when each was issued as far as the gateway can know it.
    stamps: Vec<(u64, u64)>,
    pub(super) opened_at: u64,
    /// The last order without an id: when it came, for which drive, and its number. `None` where another one came in the
    /// same moment, since a result does not tell which one it is for.
    plain: Option<(u64, usize, u64)>,
    /// When the last message arrived, and whether it was the only one at that moment.
    came_at: u64,
    is_only_one: bool,
}

/// A message as received from the broker.
#[derive(Clone, Copy, Debug)]
pub struct Inbound<'a> {
    pub topic: &'a str,
    pub payload: &'a str,
    pub retain: bool,
    pub duplicate: bool,
    /// The gateway's wall clock, in ms.
    pub wall_ms: u64,
    /// When it was actually issued, or first issued if it is a replay.
    pub issued: u64,
}

impl Checker {
    /// The gateway's subscription was granted again.
    pub fn broker_opened(&mut self, at: u64) {
        self.log.add(at, What::Message, 0, b"(subscribed)");
        self.messages.opened_at = at;
    }

    /// A message was delivered to the gateway.
    pub fn message(&mut self, at: u64, it: Inbound<'_>) {
        self.log.add(
            at,
            What::Message,
            u16::from(it.retain) + 2 * u16::from(it.duplicate),
            it.topic.as_bytes(),
        );
        self.log.add(at, What::Message, 0, it.payload.as_bytes());
        self.counts.messages += 1;
        self.time(at);
        self.sign_of_life(at);
        self.messages.plain = None;
        self.messages.is_only_one = self.messages.came_at < at;
        self.messages.came_at = at;
        let Some(rest) = it.topic.strip_prefix("vfd/plant/") else {
            return;
        };
        if rest == "all/run/set" && it.payload.trim().eq_ignore_ascii_case("stop") {
            for drive in 0..self.books.len() {
                self.plain(at, drive, Some(Run::Stop), None, it);
            }
            return;
        }
        let Some((name, input)) = rest
            .strip_prefix("drive/d")
            .and_then(|rest| rest.split_once('/'))
        else {
            return;
        };
        let Some(drive) = name
            .parse::<usize>()
            .ok()
            .filter(|drive| *drive < self.books.len())
        else {
            return;
        };
        match input {
            "run/set" => self.plain(at, drive, run_word(it.payload), None, it),
            "frequency/set" => self.plain(at, drive, None, centihertz(it.payload), it),
            "trip/reset" => self.plain(at, drive, Some(Run::Reset), None, it),
            "command" => self.command(at, drive, it),
            _ => {}
        }
    }

    fn plain(
        &mut self,
        at: u64,
        drive: usize,
        run: Option<Run>,
        setpoint: Option<u16>,
        it: Inbound<'_>,
    ) {
        let stops = matches!(run, Some(Run::Stop | Run::Coast));
        // A replay and a repeat order nothing; a live stop is executed all the same.
        let counts = stops || !(it.retain || it.duplicate);
        if !counts || !self.line.drives[drive].has_control || (run, setpoint) == (None, None) {
            return;
        }
        let stopped_at = self.books[drive].stopped_at;
        let order = self.take_order(
            at,
            drive,
            Wish {
                run,
                setpoint,
                register: None,
            },
            at + DEADLINE,
            None,
        );
        let runs = matches!(run, Some(Run::Forward | Run::Reverse));
        if !stops {
            self.messages.plain = self.messages.is_only_one.then_some((at, drive, order));
            self.outdate(at, drive, order, it.issued, DEADLINE);
        }
        if runs && stopped_at.is_some_and(|stopped| at < stopped + RESTART_DELAY) {
            self.void(drive, order);
        }
    }

    fn command(&mut self, at: u64, drive: usize, it: Inbound<'_>) {
        let id = number_behind(it.payload, "\"id\":\"o");
        let run = text_behind(it.payload, "\"run\":\"").and_then(run_word);
        let setpoint = text_behind(it.payload, "\"frequency_hz\":").and_then(centihertz);
        let reset = it.payload.contains("\"reset\":true").then_some(Run::Reset);
        let stops = matches!(run, Some(Run::Stop | Run::Coast));
        if !self.line.drives[drive].has_control || (it.retain && !stops) {
            return;
        }
        let is_known = self
            .messages
            .ids
            .iter()
            .any(|(other, of, _)| Some(*other) == id && *of == drive);
        if is_known && !stops {
            return;
        }
        let ttl = number_behind(it.payload, "\"ttl_ms\":").map_or(DEADLINE, |ms| ms * 1_000_000);
        let is_stale = number_behind(it.payload, "\"issued_at\":")
            .is_some_and(|ms| it.wall_ms > ms + ttl / 1_000_000);
        if is_stale && !stops {
            return;
        }
        let is_ahead =
            number_behind(it.payload, "\"issued_at\":").is_some_and(|ms| ms > it.wall_ms + AHEAD);
        let epoch = number_behind(it.payload, "\"epoch\":");
        let is_old = epoch.is_some_and(|epoch| self.is_old(drive, epoch));
        let order = self.take_order(
            at,
            drive,
            Wish {
                run: run.or(reset),
                setpoint,
                register: None,
            },
            at + ttl,
            None,
        );
        if is_old {
            self.void(drive, order);
        }
        if !stops {
            // The clock that it was stamped by may be ahead, or ours has been set back since.
            let stamp = number_behind(it.payload, "\"issued_at\":");
            let may_be_ahead = if stamp.is_some() {
                AHEAD * 1_000_000
            } else {
                0
            };
            let issued = stamp.map_or(it.issued, |ms| self.issued_by_clock(at, it, ms));
            self.outdate(at, drive, order, issued, ttl + may_be_ahead);
            if is_ahead {
                self.outdate_order(drive, order, it.issued);
            }
        }
        let Some(id) = id else {
            if !stops {
                self.messages.plain = self.messages.is_only_one.then_some((at, drive, order));
            }
            return;
        };
        if self.messages.ids.len() >= KEPT {
            self.messages.ids.remove(0);
        }
        self.messages.ids.push((id, drive, order));
    }

    /// When a command that is stamped `ms` was issued, as far as the gateway can know it. One that comes for the first time
    /// is as old as the clocks say: where both are wrong they may agree. One that comes again is as old as it was, and the
    /// time since.
    fn issued_by_clock(&mut self, at: u64, it: Inbound<'_>, ms: u64) -> u64 {
        if let Some((_, issued)) = self.messages.stamps.iter().find(|(stamp, _)| *stamp == ms) {
            return *issued;
        }
        let age = it.wall_ms.saturating_sub(ms) * 1_000_000;
        let issued = at.saturating_sub(age).max(it.issued);
        if self.messages.stamps.len() >= KEPT {
            self.messages.stamps.remove(0);
        }
        self.messages.stamps.push((ms, issued));
        issued
    }

    /// What was issued before the last stop, or too long ago for its time, is no order any more.
    fn outdate(&mut self, at: u64, drive: usize, order: u64, issued: u64, ttl: u64) {
        // A setpoint or a reset moves nothing after a stop.
        let runs = |it: &Order| matches!(it.wish.run, Some(Run::Forward | Run::Reverse));
        let starts = self.books[drive]
            .orders
            .iter()
            .any(|it| it.number == order && runs(it));
        let is_before_stop = starts
            && self.books[drive]
                .stopped_at
                .is_some_and(|stopped| issued < stopped);
        let is_young = at < self.messages.opened_at + YOUNG;
        let unnoticed = if is_young {
            UNNOTICED_WHEN_YOUNG
        } else {
            UNNOTICED
        };
        if is_before_stop || at > issued + ttl.max(unnoticed) {
            self.outdate_order(drive, order, issued);
        }
    }

    /// The gateway has forgotten which commands it received.
    pub(super) fn messages_forgotten(&mut self) {
        self.messages.ids.clear();
        self.messages.stamps.clear();
    }

    /// Whether a stop arrived, or the path was reopened, since `epoch` was shown.
    fn is_old(&self, drive: usize, epoch: u64) -> bool {
        let shown = self
            .messages
            .epochs
            .iter()
            .find(|(of, it, _)| (*of, *it) == (drive, epoch))
            .map(|(.., at)| *at);
        let stopped = self.books[drive].stopped_at.unwrap_or(0);
        shown.is_some_and(|shown| shown < stopped || shown < self.messages.opened_at)
    }

    /// An order from which no frame may follow.
    fn void(&mut self, drive: usize, number: u64) {
        self.void_order(drive, number);
    }

    /// The gateway published something.
    pub fn published(&mut self, at: u64, topic: &str, payload: &str) {
        self.log.add(at, What::Published, 0, topic.as_bytes());
        self.log.add(at, What::Published, 1, payload.as_bytes());
        let Some(rest) = topic.strip_prefix("vfd/plant/drive/d") else {
            return;
        };
        let Some((name, input)) = rest.split_once('/') else {
            return;
        };
        let Some(drive) = name
            .parse::<usize>()
            .ok()
            .filter(|drive| *drive < self.books.len())
        else {
            return;
        };
        match input {
            "state" => {
                if let Some(epoch) = number_behind(payload, "\"epoch\":")
                    && !self
                        .messages
                        .epochs
                        .iter()
                        .any(|(of, it, _)| (*of, *it) == (drive, epoch))
                {
                    if self.messages.epochs.len() >= KEPT {
                        self.messages.epochs.remove(0);
                    }
                    self.messages.epochs.push((drive, epoch, at));
                }
            }
            "result" => self.told(at, drive, payload),
            "frequency/output" if !payload.is_empty() => {
                if let Some(word) = centihertz(payload) {
                    self.shown(at, drive, word);
                }
            }
            _ => {}
        }
    }

    fn told(&mut self, at: u64, drive: usize, payload: &str) {
        self.counts.results += 1;
        let outcome = text_behind(payload, "\"outcome\":\"");
        let Some(id) = number_behind(payload, "\"id\":\"o") else {
            // An order that is refused on arrival orders nothing.
            let plain = self
                .messages
                .plain
                .take_if(|it| (it.0, it.1) == (at, drive) && outcome == Some("refused"));
            return plain
                .into_iter()
                .for_each(|(.., order)| self.order_excepted(at, drive, order, 6));
        };
        let found = self
            .messages
            .ids
            .iter()
            .find(|(it, of, _)| (*it, *of) == (id, drive));
        let Some((.., order)) = found.copied() else {
            return;
        };
        let reason = text_behind(payload, "\"reason\":\"");
        match outcome {
            // The earlier result is sent again, whatever has happened since.
            _ if payload.contains("\"repeat\":true") => {}
            // That is about the message and not about the order that had this id first.
            Some("refused") if matches!(reason, Some("retained" | "duplicate" | "stale")) => {}
            Some("acknowledged" | "confirmed") => self.order_succeeded(at, drive, order),
            Some("refused" | "superseded" | "expired") => self.order_excepted(at, drive, order, 6),
            Some("failed") => self.order_excepted(at, drive, order, 4),
            _ => {}
        }
    }
}

fn run_word(text: &str) -> Option<Run> {
    match text.trim().to_ascii_lowercase().as_str() {
        "forward" => Some(Run::Forward),
        "reverse" => Some(Run::Reverse),
        "stop" => Some(Run::Stop),
        "coast" => Some(Run::Coast),
        _ => None,
    }
}

/// Hertz in hundredths, if they are whole.
fn centihertz(text: &str) -> Option<u16> {
    let hertz = text.trim().parse::<f64>().ok()? * 100.0;
    ((hertz - hertz.round()).abs() < 1e-6 && (0.0..65_535.0).contains(&hertz))
        .then_some(hertz.round() as u16)
}

/// The value after `key`.
fn text_behind<'a>(payload: &'a str, key: &str) -> Option<&'a str> {
    let rest = &payload[payload.find(key)? + key.len()..];
    rest.split(['"', ',', '}']).next()
}

fn number_behind(payload: &str, key: &str) -> Option<u64> {
    text_behind(payload, key)?.parse().ok()
}
