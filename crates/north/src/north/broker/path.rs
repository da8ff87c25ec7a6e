//! The path through the broker: subscription, probe, what may have been delayed on it, and when a connection is given
//! up.
//!
//! Probes pass through the same queues as commands. A probe that was sent after a command was published cannot return
//! before that command. So a command is fresh as long as every probe returns in time, and a delayed one is noticed at
//! the latest when the next probe is overdue: after [`unnoticed`].

use crate::domain::time::MonoTime;
use crate::north::seal::SecretSeal;
use std::collections::VecDeque;
use std::time::Duration;

/// A probe that returns this much later than usual is overdue.
const LATE: Duration = Duration::from_millis(250);
/// The longest round trip that counts as usual, so that a path that keeps slowing down is noticed. It is also assumed
/// for a path that is not known yet.
const USUAL_MAX: Duration = Duration::from_millis(500);
/// A connection that ended sooner than this was a brief one.
const BRIEF: Duration = Duration::from_secs(5);
/// By what part of the difference the usual round trip follows a faster one; it follows a slower one at once.
const USUAL_PART: u32 = 8;
/// Most probes whose moments are kept. With more in flight the oldest has long been overdue.
const UNDER_WAY_MAX: usize = 16;

/// The longest time that a command can be delayed unnoticed if the path is probed every `interval`: it is delayed just
/// after a probe has returned, and the next one is overdue.
#[must_use]
pub const fn unnoticed(interval: Duration) -> Duration {
    interval.saturating_add(USUAL_MAX).saturating_add(LATE)
}

/// State of the connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PathPhase {
    /// No connection.
    Down,
    /// Accepted by the broker; the subscription is still to be requested.
    Connected,
    /// The subscription was requested at this moment.
    Subscribing(MonoTime),
    /// Every filter is granted; no probe has returned yet.
    Granted,
    /// A probe has returned.
    Open,
    /// A new connection is to be requested, for this reason.
    GivingUp(&'static str),
    /// A new connection was requested.
    GivenUp,
}

/// What a returned probe means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::north) enum ReturnedProbe {
    /// The path is open.
    Ours,
    /// The message is a probe of another connection or another gateway.
    Foreign,
}

/// The connection and its probe.
#[derive(Debug)]
pub(in crate::north) struct BrokerPath {
    interval: Duration,
    timeout: Duration,
    /// Marks the probes of this session, so that no peer can forge one.
    seal: SecretSeal,
    phase: PathPhase,
    /// Number of the last probe sent.
    sent: u64,
    /// Probes up to this number have returned, or belong to an earlier connection.
    settled: u64,
    next_probe: MonoTime,
    /// Since when a probe is missing.
    missing_since: Option<MonoTime>,
    last_return: Option<MonoTime>,
    /// Probes that were sent and have not returned, each with the moment at which it was due. Bounded.
    under_way: VecDeque<(u64, MonoTime)>,
    /// The usual time from the moment at which a probe is due to its return.
    usual: Duration,
    /// Why what arrives may have been delayed.
    stall: Option<PathStall>,
    /// When the first probe returned on this connection.
    opened_at: Option<MonoTime>,
    /// How long the path has to be open without interruption before it counts as a heartbeat again.
    proves_after: Duration,
}

/// Why what arrives may have been delayed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PathStall {
    /// Ends when the probe with this number, or a later one, has returned in time.
    until: u64,
    /// How long the process was suspended.
    stood: Duration,
    /// The path itself is not proven: a probe is overdue, or none has returned on this connection.
    is_of_the_way: bool,
}

impl BrokerPath {
    /// A path that is not connected. `probe_key` is random, and used by this session only.
    pub(in crate::north) fn new(probe_key: u128, interval: Duration, timeout: Duration) -> Self {
        Self {
            interval,
            timeout,
            seal: SecretSeal::new(probe_key),
            phase: PathPhase::Down,
            sent: 0,
            settled: 0,
            next_probe: MonoTime::ZERO,
            missing_since: None,
            last_return: None,
            under_way: VecDeque::new(),
            usual: USUAL_MAX,
            stall: None,
            opened_at: None,
            proves_after: Duration::ZERO,
        }
    }

    pub(in crate::north) fn connected(&mut self) {
        self.reset(PathPhase::Connected);
    }

    /// The connection is lost. The next one counts as a heartbeat of the clients once it has lasted for one more probe;
    /// after a brief one, once it has lasted longer than that. A path that is open only for moments keeps no lease
    /// alive.
    pub(in crate::north) fn lost(&mut self, at: MonoTime) {
        if let Some(opened) = self.opened_at {
            self.proves_after = if at.since(opened) < BRIEF {
                BRIEF
            } else {
                self.interval / 2
            };
        }
        self.reset(PathPhase::Down);
    }

    fn reset(&mut self, phase: PathPhase) {
        self.phase = phase;
        self.settled = self.sent;
        self.missing_since = None;
        self.last_return = None;
        self.opened_at = None;
        self.under_way.clear();
        self.usual = USUAL_MAX;
        // Even the answer to the subscription may have been delayed, and commands right after it.
        self.stall = Some(PathStall {
            until: self.sent + 1,
            stood: Duration::ZERO,
            is_of_the_way: true,
        });
    }

    /// The process was suspended for this long; [`Duration::MAX`]: the delay of what arrives now is unknown. It has
    /// missed what arrived, so nothing is overdue, and a probe is due.
    pub(in crate::north) fn stalled(&mut self, at: MonoTime, stood: Duration) {
        let before = self.stall.unwrap_or(PathStall {
            until: 0,
            stood: Duration::ZERO,
            is_of_the_way: false,
        });
        let is_of_the_way = before.is_of_the_way || stood == Duration::MAX;
        self.stall = Some(PathStall {
            until: self.sent + 1,
            stood: before.stood.saturating_add(stood),
            is_of_the_way,
        });
        self.under_way.clear();
        self.probe_from(at);
        if let PathPhase::Subscribing(since) = &mut self.phase {
            *since = at;
        }
    }

    /// Checks whether a probe is overdue, sent or not. From then on what arrives may have been delayed, until a probe
    /// that is sent later has returned in time. To be called before anything that arrived is judged.
    pub(in crate::north) fn look(&mut self, at: MonoTime) {
        if !self.is_granted() {
            return;
        }
        let until = self.stall.map_or(0, |stall| stall.until);
        // Of those from before a suspension only their return is known.
        let sent = self
            .under_way
            .iter()
            .find(|(number, _)| *number >= until)
            .map(|(_, due)| *due);
        let oldest = sent.unwrap_or(self.next_probe);
        if at.since(oldest) > self.usual + LATE {
            let stood = self.stall.map_or(Duration::ZERO, |stall| stall.stood);
            self.stall = Some(PathStall {
                until: self.sent + 1,
                stood,
                is_of_the_way: true,
            });
        }
    }

    /// How long a message that arrives now may have been delayed because the process was suspended.
    pub(in crate::north) fn may_have_waited(&self) -> Duration {
        self.stall.map_or(Duration::ZERO, |stall| stall.stood)
    }

    /// Whether a message that arrives now may have been delayed on the path, for an unknown time.
    pub(in crate::north) fn is_unproven(&self) -> bool {
        self.stall.is_some_and(|stall| stall.is_of_the_way)
    }

    /// Whether the subscription is to be requested now; once per connection.
    pub(in crate::north) fn take_subscription(&mut self, at: MonoTime) -> bool {
        let is_due = self.phase == PathPhase::Connected;
        if is_due {
            self.phase = PathPhase::Subscribing(at);
        }
        is_due
    }

    /// The broker's answer to the subscription. True if the probe may be sent now.
    pub(in crate::north) fn subscribed(&mut self, at: MonoTime, is_granted: bool) -> bool {
        if !matches!(self.phase, PathPhase::Subscribing(_)) {
            return false;
        }
        self.phase = if is_granted {
            PathPhase::Granted
        } else {
            PathPhase::GivingUp("the broker did not grant every subscription")
        };
        self.next_probe = at;
        is_granted
    }

    /// Probes are due from `at` on, and none is missing yet.
    pub(in crate::north) const fn probe_from(&mut self, at: MonoTime) {
        self.next_probe = at;
        self.missing_since = None;
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
        // In step, so that none is late because of earlier ones; those missed while not polled are skipped.
        let next = due + self.interval;
        self.next_probe = if next > at { next } else { at + self.interval };
        self.sent += 1;
        if self.under_way.len() < UNDER_WAY_MAX {
            self.under_way.push_back((self.sent, due));
        }
        Some(self.seal.text(self.sent).into_bytes())
    }

    /// A probe arrived.
    pub(in crate::north) fn returned(&mut self, at: MonoTime, payload: &[u8]) -> ReturnedProbe {
        let Some(number) = self.seal.number(payload) else {
            return ReturnedProbe::Foreign;
        };
        let is_awaited = (self.settled + 1..=self.sent).contains(&number);
        if !is_awaited || !self.is_granted() {
            return ReturnedProbe::Foreign;
        }
        self.look(at);
        self.settled = number;
        let due = self
            .under_way
            .iter()
            .find(|(sent, _)| *sent == number)
            .map(|(_, due)| *due);
        self.under_way.retain(|(sent, _)| *sent > number);
        self.learn(at, due);
        match &mut self.stall {
            // With too many in flight it is unknown whether this one is in time.
            Some(stall) if stall.until <= number && due.is_none() => stall.until = self.sent + 1,
            stall => drop(stall.take_if(|stall| stall.until <= number)),
        }
        if self.stall.is_some_and(|stall| stall.until > self.sent) {
            // The path is moving again: the probe that proves it is sent at once.
            self.next_probe = self.next_probe.min(at);
        }
        self.missing_since = (number < self.sent).then_some(at);
        self.last_return = Some(at);
        self.opened_at.get_or_insert(at);
        self.phase = PathPhase::Open;
        ReturnedProbe::Ours
    }

    /// Takes the round trip of a probe that was due at this moment. It is usual only up to a bound.
    fn learn(&mut self, at: MonoTime, due: Option<MonoTime>) {
        let Some(due) = due else { return };
        let trip = at.since(due).min(USUAL_MAX);
        self.usual = trip.max(self.usual - self.usual.saturating_sub(trip) / USUAL_PART);
    }

    /// Gives the connection up if the broker has been silent for too long. True if the cause was a lost probe.
    pub(in crate::north) fn check(&mut self, at: MonoTime) -> bool {
        if self.overdue().is_none_or(|overdue| at < overdue) {
            return false;
        }
        let is_probe = self.is_granted();
        self.phase = PathPhase::GivingUp(if is_probe {
            "the probe did not come back"
        } else {
            "the broker did not answer the subscription"
        });
        is_probe
    }

    /// The reason for which a new connection is to be requested; returned once.
    pub(in crate::north) fn take_reconnect(&mut self) -> Option<&'static str> {
        let PathPhase::GivingUp(reason) = self.phase else {
            return None;
        };
        self.phase = PathPhase::GivenUp;
        Some(reason)
    }

    /// Whether every filter is granted.
    pub(in crate::north) const fn is_granted(&self) -> bool {
        matches!(self.phase, PathPhase::Granted | PathPhase::Open)
    }

    /// Whether a probe has returned on this connection, and the connection is not given up.
    pub(in crate::north) fn is_open(&self) -> bool {
        self.phase == PathPhase::Open
    }

    /// Whether a probe has returned no longer ago than it may be missing.
    pub(in crate::north) fn is_alive(&self, at: MonoTime) -> bool {
        let is_fresh = |returned| at.since(returned) <= self.interval + self.timeout;
        self.is_open() && self.last_return.is_some_and(is_fresh)
    }

    /// Whether the path has been open for long enough to be a heartbeat of its clients.
    pub(in crate::north) fn is_sign_of_life(&self, at: MonoTime) -> bool {
        self.opened_at
            .is_some_and(|opened| at.since(opened) >= self.proves_after)
    }

    /// When something is to be done without an external event.
    pub(in crate::north) fn wake(&self) -> Option<MonoTime> {
        let probe = self.is_granted().then_some(self.next_probe);
        probe.into_iter().chain(self.overdue()).min()
    }

    /// When the connection is given up if nothing arrives.
    pub(in crate::north) fn overdue(&self) -> Option<MonoTime> {
        let since = match self.phase {
            PathPhase::Subscribing(since) => Some(since),
            PathPhase::Granted | PathPhase::Open => self.missing_since,
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

    fn granted() -> BrokerPath {
        let mut path = BrokerPath::new(7, SECOND * 5, SECOND * 15);
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
        let ours = SecretSeal::new(7);
        let another = SecretSeal::new(8);
        for foreign in [
            ours.text(2),
            ours.text(0),
            another.text(1),
            "1".to_owned(),
            "1-".to_owned(),
            String::new(),
        ] {
            assert_eq!(
                path.returned(at(2), foreign.as_bytes()),
                ReturnedProbe::Foreign,
                "{foreign}"
            );
        }
        assert_eq!(path.returned(at(2), b"\xFF"), ReturnedProbe::Foreign);
        assert!(!path.is_open());
        assert_eq!(path.returned(at(2), &first), ReturnedProbe::Ours);
        assert!(path.is_open() && path.is_alive(at(2)));
        assert_eq!(
            path.returned(at(2), &first),
            ReturnedProbe::Foreign,
            "each counts once"
        );
        path.lost(at(2));
        path.connected();
        path.take_subscription(at(3));
        path.subscribed(at(3), true);
        assert_eq!(
            path.returned(at(3), &first),
            ReturnedProbe::Foreign,
            "a probe of the connection before"
        );
    }

    #[test]
    fn the_next_probe_cannot_be_forged_from_those_before() {
        let mut path = granted();
        let first = path.take_probe(at(1)).unwrap();
        assert_eq!(path.returned(at(1), &first), ReturnedProbe::Ours);
        let second = path.take_probe(at(6)).unwrap();
        // A peer that has read the first writes the second, which is still in flight.
        let first = String::from_utf8(first).unwrap();
        for (place, digit) in first.match_indices('1') {
            let mut forged = first.clone();
            forged.replace_range(place..place + digit.len(), "2");
            assert_eq!(
                path.returned(at(6), forged.as_bytes()),
                ReturnedProbe::Foreign,
                "{forged}"
            );
        }
        path.look(at(20));
        assert!(path.is_unproven(), "it is still overdue");
        assert_eq!(path.returned(at(20), &second), ReturnedProbe::Ours);
    }

    #[test]
    fn a_missing_probe_or_subscription_gives_the_connection_up_once() {
        let mut path = granted();
        path.take_probe(at(1)).unwrap();
        assert!(
            path.take_probe(at(6)).is_some(),
            "a lost one does not stop the next"
        );
        assert!(!path.check(at(15)));
        assert_eq!(path.wake(), Some(at(11)));
        assert!(path.check(at(16)));
        assert!(path.take_reconnect().is_some() && path.take_reconnect().is_none());
        assert_eq!((path.wake(), path.take_probe(at(30))), (None, None));

        path.connected();
        path.take_subscription(at(40));
        assert_eq!(path.wake(), Some(at(55)));
        assert!(!path.check(at(55)), "no probe was lost");
        assert_eq!(
            path.take_reconnect(),
            Some("the broker did not answer the subscription")
        );
    }

    #[test]
    fn a_filter_that_is_not_granted_gives_the_connection_up() {
        let mut path = BrokerPath::new(7, SECOND, SECOND);
        assert!(!path.subscribed(at(0), true), "not asked for");
        path.connected();
        path.take_subscription(at(0));
        assert!(!path.subscribed(at(0), false));
        assert!(path.take_reconnect().is_some());
    }

    /// A path with a round trip of `trip` that stalls between two moments, in milliseconds: what is sent into it then
    /// arrives at the end, in order. `run` is published at that moment. Returns when it arrives, and whether it is
    /// trusted.
    fn run_through(interval: u64, trip: u64, stall: (u64, u64), run: u64) -> (u64, bool) {
        let ms = |millis: u64| MonoTime::from_millis(millis);
        let mut path = BrokerPath::new(
            7,
            Duration::from_millis(interval),
            Duration::from_secs(3600),
        );
        path.connected();
        path.take_subscription(ms(0));
        path.subscribed(ms(0), true);
        // In flight from the broker: when it arrives, and a probe or the run.
        let mut coming: VecDeque<(u64, Option<Vec<u8>>)> = VecDeque::new();
        let through = |sent: u64, coming: &VecDeque<(u64, Option<Vec<u8>>)>, trip: u64| {
            let free = if (stall.0..stall.1).contains(&(sent + trip)) {
                stall.1
            } else {
                sent + trip
            };
            coming.back().map_or(free, |(last, _)| free.max(*last))
        };
        for now in (0..).step_by(10) {
            while coming.front().is_some_and(|(at, _)| *at <= now) {
                let Some((_, what)) = coming.pop_front() else {
                    break;
                };
                path.look(ms(now));
                match what {
                    Some(probe) => assert_eq!(path.returned(ms(now), &probe), ReturnedProbe::Ours),
                    None => return (now, !path.is_unproven()),
                }
            }
            if now == run {
                let at = through(now, &coming, trip / 2);
                coming.push_back((at, None));
            }
            while let Some(probe) = path.take_probe(ms(now)) {
                let at = through(now, &coming, trip);
                coming.push_back((at, Some(probe)));
            }
        }
        unreachable!()
    }

    #[test]
    fn no_command_that_waited_longer_than_is_noticed_is_trusted_however_long_the_way_stood_still() {
        const BEGIN: u64 = 6_000;
        let mut trusted = [0, 0];
        for (interval, phases) in [(200, 130), (1_000, 390), (3_250, 1_170)] {
            let most =
                u64::try_from(unnoticed(Duration::from_millis(interval)).as_millis()).unwrap();
            for trip in [0, 20, 600] {
                for phase in (0..interval).step_by(phases) {
                    for length in (0..15_000).step_by(1_130) {
                        let stall = (
                            BEGIN + phase / 10 * 10,
                            BEGIN + phase / 10 * 10 + length / 10 * 10,
                        );
                        for run in (stall.0..=stall.1 + 2_000).step_by(870) {
                            let (came, is_trusted) = run_through(interval, trip, stall, run);
                            let waited = came - run;
                            trusted[usize::from(is_trusted)] += 1;
                            assert!(
                                !is_trusted || waited <= most,
                                "{interval} {trip} {stall:?}: {run} waited {waited}"
                            );
                        }
                    }
                }
            }
        }
        assert!(trusted[0] > 500 && trusted[1] > 500, "{trusted:?}");
    }

    #[test]
    fn a_way_that_works_is_trusted_and_again_soon_after_it_stood_still() {
        for trip in [0, 20, 300, 600] {
            for run in (2_000..5_000).step_by(170) {
                assert!(run_through(1_000, trip, (0, 0), run).1, "{trip} {run}");
            }
            // At most two round trips after the end: of the probe that was late, and of the one that proves the path,
            // which is not sent on schedule but at once.
            for end in [15_000, 15_100, 15_500] {
                assert!(
                    run_through(1_000, trip, (5_000, end), end + 2 * trip + 100).1,
                    "{trip} {end}"
                );
            }
        }
    }

    #[test]
    fn a_way_that_was_never_proven_or_becomes_ever_slower_is_not_trusted() {
        let mut path = granted();
        assert!(path.is_unproven(), "right after the subscription");
        let probe = path.take_probe(at(1)).unwrap();
        path.returned(at(1), &probe);
        assert!(!path.is_unproven());
        for second in 2..100 {
            path.next_probe = at(10 * second);
            let probe = path.take_probe(at(10 * second)).unwrap();
            let slow = at(10 * second) + Duration::from_millis(50 * second);
            path.look(slow);
            path.returned(slow, &probe);
            assert!(second <= 15 || path.is_unproven(), "{second}");
        }
        // Not even one that cannot be sent, because nothing is sent.
        let mut path = granted();
        let probe = path.take_probe(at(1)).unwrap();
        path.returned(at(1), &probe);
        path.look(at(6));
        assert!(!path.is_unproven());
        path.look(at(7));
        assert!(path.is_unproven());
    }
}
