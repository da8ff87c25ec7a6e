//! The way through the broker: subscription, probe, what may have waited on it, and when a connection is given up.
//!
//! Probes go and come in the same queues as commands. A probe that was sent after a command was published cannot come
//! back before that command. So a command is young as long as every probe comes back in time, and one that waited is
//! noticed at the latest when the next probe is overdue: after [`unnoticed`].

use crate::domain::time::MonoTime;
use std::collections::VecDeque;
use std::time::Duration;

/// A probe that comes back so much later than usual is overdue.
const LATE: Duration = Duration::from_millis(250);
/// The longest round trip that counts as usual, so that a way that becomes slower and slower is noticed. It is also
/// what is assumed of a way that is not known yet.
const USUAL_MAX: Duration = Duration::from_millis(500);
/// By what part of the difference the usual round trip follows a faster one; it follows a slower one at once.
const USUAL_PART: u32 = 8;
/// Most probes whose moments are kept. With more under way the oldest is overdue long since.
const UNDER_WAY_MAX: usize = 16;

/// The longest time that a command can wait without a sign of it, where the way is probed every `interval`: it waits
/// behind a probe that has just come back, and the next one is overdue.
#[must_use]
pub const fn unnoticed(interval: Duration) -> Duration {
    interval.saturating_add(USUAL_MAX).saturating_add(LATE)
}

/// Where the connection stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No connection.
    Down,
    /// Accepted by the broker; the subscription is to be asked for.
    Connected,
    /// The subscription was asked for, then.
    Subscribing(MonoTime),
    /// Every filter is granted; no probe came back yet.
    Granted,
    /// A probe came back.
    Open,
    /// A new connection is to be asked for, for this reason.
    GivingUp(&'static str),
    /// A new connection was asked for.
    GivenUp,
}

/// What a returned probe means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::north) enum Returned {
    /// The way is open.
    Ours,
    /// It is a probe of another connection or another gateway.
    Foreign,
}

/// The connection and its probe.
#[derive(Debug)]
pub(in crate::north) struct Path {
    interval: Duration,
    timeout: Duration,
    /// What distinguishes the probes of this process.
    run: String,
    phase: Phase,
    /// Number of the last probe sent.
    sent: u64,
    /// Probes up to this number have returned, or belong to an earlier connection.
    settled: u64,
    next_probe: MonoTime,
    /// Since when a probe is missing.
    missing_since: Option<MonoTime>,
    last_return: Option<MonoTime>,
    /// Probes that were sent and did not return, each with the moment at which it was due. Bounded.
    under_way: VecDeque<(u64, MonoTime)>,
    /// The usual time from the moment at which a probe is due to its return.
    usual: Duration,
    /// What comes may have waited.
    stall: Option<Stall>,
}

/// Why what comes may have waited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stall {
    /// It ends when the probe with this number, or a later one, has come back in time.
    until: u64,
    /// How long this side stood still.
    stood: Duration,
    /// The way itself is not proven: a probe is overdue, or none came back on this connection.
    is_of_the_way: bool,
}

impl Path {
    pub(in crate::north) const fn new(run: String, interval: Duration, timeout: Duration) -> Self {
        Self {
            interval,
            timeout,
            run,
            phase: Phase::Down,
            sent: 0,
            settled: 0,
            next_probe: MonoTime::ZERO,
            missing_since: None,
            last_return: None,
            under_way: VecDeque::new(),
            usual: USUAL_MAX,
            stall: None,
        }
    }

    pub(in crate::north) fn connected(&mut self) {
        self.reset(Phase::Connected);
    }

    pub(in crate::north) fn lost(&mut self) {
        self.reset(Phase::Down);
    }

    fn reset(&mut self, phase: Phase) {
        self.phase = phase;
        self.settled = self.sent;
        self.missing_since = None;
        self.last_return = None;
        self.under_way.clear();
        self.usual = USUAL_MAX;
        // Even the answer to the subscription may have waited, and commands right behind it.
        self.stall = Some(Stall { until: self.sent + 1, stood: Duration::ZERO, is_of_the_way: true });
    }

    /// This side stood still for so long. It has missed what came, so that nothing is overdue, and a probe is due.
    pub(in crate::north) fn stalled(&mut self, at: MonoTime, stood: Duration) {
        let before = self.stall.unwrap_or(Stall { until: 0, stood: Duration::ZERO, is_of_the_way: false });
        self.stall = Some(Stall { until: self.sent + 1, stood: before.stood.saturating_add(stood), ..before });
        self.under_way.clear();
        self.probe_from(at);
        if let Phase::Subscribing(since) = &mut self.phase {
            *since = at;
        }
    }

    /// Looks whether a probe is overdue, sent or not. From then on what comes may have waited, until a probe that is sent
    /// later has come back in time. To be asked before anything that came is judged.
    pub(in crate::north) fn look(&mut self, at: MonoTime) {
        if !self.is_granted() {
            return;
        }
        let until = self.stall.map_or(0, |stall| stall.until);
        // Of those from before a stall only one thing is known: that it was there.
        let sent = self.under_way.iter().find(|(number, _)| *number >= until).map(|(_, due)| *due);
        let oldest = sent.unwrap_or(self.next_probe);
        if at.since(oldest) > self.usual + LATE {
            let stood = self.stall.map_or(Duration::ZERO, |stall| stall.stood);
            self.stall = Some(Stall { until: self.sent + 1, stood, is_of_the_way: true });
        }
    }

    /// How long a message that comes now may have waited because this side stood still.
    pub(in crate::north) fn may_have_waited(&self) -> Duration {
        self.stall.map_or(Duration::ZERO, |stall| stall.stood)
    }

    /// Whether a message that comes now may have waited on the way, for a time that is not known.
    pub(in crate::north) fn is_unproven(&self) -> bool {
        self.stall.is_some_and(|stall| stall.is_of_the_way)
    }

    /// Whether the subscription is to be asked for now; once per connection.
    pub(in crate::north) fn take_subscription(&mut self, at: MonoTime) -> bool {
        let is_due = self.phase == Phase::Connected;
        if is_due {
            self.phase = Phase::Subscribing(at);
        }
        is_due
    }

    /// The broker's answer to the subscription. True if the way to the probe is free now.
    pub(in crate::north) fn subscribed(&mut self, at: MonoTime, is_granted: bool) -> bool {
        if !matches!(self.phase, Phase::Subscribing(_)) {
            return false;
        }
        self.phase =
            if is_granted { Phase::Granted } else { Phase::GivingUp("the broker did not grant every subscription") };
        self.next_probe = at;
        is_granted
    }

    /// Probes are due from `at` on, and none is missing yet.
    pub(in crate::north) const fn probe_from(&mut self, at: MonoTime) {
        (self.next_probe, self.missing_since) = (at, None);
    }

    /// Probes sent so far.
    pub(in crate::north) const fn sent(&self) -> u64 {
        self.sent
    }

    /// The number of the last probe that returned.
    pub(in crate::north) const fn settled(&self) -> u64 {
        self.settled
    }

    /// The payload of the probe that is due.
    pub(in crate::north) fn take_probe(&mut self, at: MonoTime) -> Option<Vec<u8>> {
        if !self.is_granted() || at < self.next_probe {
            return None;
        }
        self.look(at);
        let due = self.next_probe;
        self.missing_since.get_or_insert(due);
        // In step, so that none is late for those before; what was missed while nobody asked is left out.
        let next = due + self.interval;
        self.next_probe = if next > at { next } else { at + self.interval };
        self.sent += 1;
        if self.under_way.len() < UNDER_WAY_MAX {
            self.under_way.push_back((self.sent, due));
        }
        Some(format!("{}-{}", self.run, self.sent).into_bytes())
    }

    /// A probe came in.
    pub(in crate::north) fn returned(&mut self, at: MonoTime, payload: &[u8]) -> Returned {
        let number = self.number_of(payload).filter(|number| (self.settled + 1..=self.sent).contains(number));
        let Some(number) = number.filter(|_| self.is_granted()) else { return Returned::Foreign };
        self.look(at);
        self.settled = number;
        let due = self.under_way.iter().find(|(sent, _)| *sent == number).map(|(_, due)| *due);
        self.under_way.retain(|(sent, _)| *sent > number);
        self.learn(at, due);
        self.stall.take_if(|stall| stall.until <= number);
        if self.stall.is_some_and(|stall| stall.until > self.sent) {
            // The way moves again: the probe that proves it goes at once.
            self.next_probe = self.next_probe.min(at);
        }
        self.missing_since = (number < self.sent).then_some(at);
        self.last_return = Some(at);
        self.phase = Phase::Open;
        Returned::Ours
    }

    /// Takes the round trip of a probe that was due then. It is usual up to a bound only.
    fn learn(&mut self, at: MonoTime, due: Option<MonoTime>) {
        let Some(due) = due else { return };
        let trip = at.since(due).min(USUAL_MAX);
        self.usual = trip.max(self.usual - self.usual.saturating_sub(trip) / USUAL_PART);
    }

    fn number_of(&self, payload: &[u8]) -> Option<u64> {
        let text = std::str::from_utf8(payload).ok()?;
        text.strip_prefix(self.run.as_str())?.strip_prefix('-')?.parse().ok()
    }

    /// Gives the connection up if the broker has been silent for too long. True if it was a probe that got lost.
    pub(in crate::north) fn check(&mut self, at: MonoTime) -> bool {
        if self.overdue().is_none_or(|overdue| at < overdue) {
            return false;
        }
        let is_probe = self.is_granted();
        self.phase = Phase::GivingUp(if is_probe {
            "the probe did not come back"
        } else {
            "the broker did not answer the subscription"
        });
        is_probe
    }

    /// The reason for which a new connection is to be asked for; once.
    pub(in crate::north) fn take_reconnect(&mut self) -> Option<&'static str> {
        let Phase::GivingUp(reason) = self.phase else { return None };
        self.phase = Phase::GivenUp;
        Some(reason)
    }

    /// Whether every filter is granted.
    pub(in crate::north) const fn is_granted(&self) -> bool {
        matches!(self.phase, Phase::Granted | Phase::Open)
    }

    /// Whether a probe came back on this connection, and the connection is not given up.
    pub(in crate::north) fn is_open(&self) -> bool {
        self.phase == Phase::Open
    }

    /// Whether a probe came back not longer ago than it may be missing.
    pub(in crate::north) fn is_alive(&self, at: MonoTime) -> bool {
        let is_fresh = |returned| at.since(returned) <= self.interval + self.timeout;
        self.is_open() && self.last_return.is_some_and(is_fresh)
    }

    /// When something is to be done without a cause from outside.
    pub(in crate::north) fn wake(&self) -> Option<MonoTime> {
        let probe = self.is_granted().then_some(self.next_probe);
        probe.into_iter().chain(self.overdue()).min()
    }

    /// When the connection is given up if nothing comes.
    pub(in crate::north) fn overdue(&self) -> Option<MonoTime> {
        let since = match self.phase {
            Phase::Subscribing(since) => Some(since),
            Phase::Granted | Phase::Open => self.missing_since,
            _ => None,
        };
        since.map(|since| since + self.timeout)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn at(seconds: u64) -> MonoTime {
        MonoTime::ZERO + SECOND * u32::try_from(seconds).unwrap()
    }

    fn granted() -> Path {
        let mut path = Path::new("7".into(), SECOND * 5, SECOND * 15);
        path.connected();
        assert!(path.take_subscription(at(0)) && !path.take_subscription(at(0)));
        assert!(path.subscribed(at(1), true));
        path
    }

    #[test]
    fn only_a_probe_of_this_connection_opens_the_way() {
        let mut path = granted();
        let first = path.take_probe(at(1)).unwrap();
        assert_eq!(path.take_probe(at(1)), None);
        for foreign in [&b"7-2"[..], b"7-0", b"8-1", b"7-", b"", b"\xFF", b"7-99999999999999999999999"] {
            assert_eq!(path.returned(at(2), foreign), Returned::Foreign);
        }
        assert!(!path.is_open());
        assert_eq!(path.returned(at(2), &first), Returned::Ours);
        assert!(path.is_open() && path.is_alive(at(2)));
        assert_eq!(path.returned(at(2), &first), Returned::Foreign, "each counts once");
        path.lost();
        path.connected();
        path.take_subscription(at(3));
        path.subscribed(at(3), true);
        assert_eq!(path.returned(at(3), &first), Returned::Foreign, "a probe of the connection before");
    }

    #[test]
    fn a_missing_probe_or_subscription_gives_the_connection_up_once() {
        let mut path = granted();
        path.take_probe(at(1)).unwrap();
        assert!(path.take_probe(at(6)).is_some(), "a lost one does not stop the next");
        assert!(!path.check(at(15)));
        assert_eq!(path.wake(), Some(at(11)));
        assert!(path.check(at(16)));
        assert!(path.take_reconnect().is_some() && path.take_reconnect().is_none());
        assert_eq!((path.wake(), path.take_probe(at(30))), (None, None));

        path.connected();
        path.take_subscription(at(40));
        assert_eq!(path.wake(), Some(at(55)));
        assert!(!path.check(at(55)), "no probe was lost");
        assert_eq!(path.take_reconnect(), Some("the broker did not answer the subscription"));
    }

    #[test]
    fn a_filter_that_is_not_granted_gives_the_connection_up() {
        let mut path = Path::new("7".into(), SECOND, SECOND);
        assert!(!path.subscribed(at(0), true), "not asked for");
        path.connected();
        path.take_subscription(at(0));
        assert!(!path.subscribed(at(0), false));
        assert!(path.take_reconnect().is_some());
    }
}
