//! Changes of a drive while no host could be reached: bounded, oldest first, and given up only when they are proven to
//! have passed the broker.
//!
//! Sparkplug sends at quality of service 0, so a broker that dies takes the last messages with it. What was sent stays
//! here until a probe that was sent after it returns.

use super::payload::PayloadValue;
use std::collections::VecDeque;

/// Most changes that concern trips, per drive: a night of a drive that trips again and again. They are never dropped
/// for telemetry.
const TRIPS_MAX: usize = 256;

/// A change of one metric.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MetricChange {
    /// The metric's index in its device.
    pub(super) metric: usize,
    /// When, in milliseconds since 1970.
    pub(super) at_ms: u64,
    /// The value; `None`: there was none.
    pub(super) value: Option<PayloadValue>,
    pub(super) is_trip: bool,
}

impl MetricChange {
    /// Its size in a message, rounded up.
    fn bytes(&self) -> usize {
        /// Alias, moment, type, quality and a number.
        const OTHER_BYTES: usize = 64;
        OTHER_BYTES
            + if let Some(PayloadValue::Text(text)) = &self.value {
                text.len()
            } else {
                0
            }
    }
}

/// The changes of one drive.
#[derive(Debug, Default)]
pub(super) struct MetricHistory {
    /// Most changes of telemetry.
    keep: usize,
    telemetry: VecDeque<(u64, MetricChange)>,
    trips: VecDeque<(u64, MetricChange)>,
    /// Sent, each with the number of probes that had been sent before.
    unproven: VecDeque<(u64, MetricChange)>,
    last: u64,
    dropped: u64,
}

impl MetricHistory {
    pub(super) fn new(keep: usize) -> Self {
        Self {
            keep,
            ..Self::default()
        }
    }

    /// Appends a change.
    pub(super) fn add(&mut self, entry: MetricChange) {
        self.last += 1;
        let (queue, most) = if entry.is_trip {
            (&mut self.trips, TRIPS_MAX)
        } else {
            (&mut self.telemetry, self.keep)
        };
        if most == 0 {
            return;
        }
        if queue.len() >= most {
            queue.pop_front();
            self.dropped += 1;
        }
        queue.push_back((self.last, entry));
    }

    /// Takes up to `most` of the oldest, and no more after the one that fills `room_bytes`.
    pub(super) fn take(&mut self, most: usize, room_bytes: usize) -> Vec<MetricChange> {
        let mut taken = Vec::new();
        let mut bytes = 0;
        while taken.len() < most && bytes < room_bytes {
            let next = match (self.telemetry.front(), self.trips.front()) {
                (Some((telemetry, _)), Some((trip, _))) if telemetry < trip => {
                    self.telemetry.pop_front()
                }
                (_, Some(_)) => self.trips.pop_front(),
                (_, None) => self.telemetry.pop_front(),
            };
            let Some((_, entry)) = next else { break };
            bytes += entry.bytes();
            taken.push(entry);
        }
        taken
    }

    /// `entries` were sent after `probes` probes.
    pub(super) fn sent(&mut self, probes: u64, entries: impl IntoIterator<Item = MetricChange>) {
        let kept = |entry: &MetricChange| entry.is_trip || self.keep > 0;
        self.unproven.extend(
            entries
                .into_iter()
                .filter(kept)
                .map(|entry| (probes, entry)),
        );
        // Values that arrive faster than probes return deserve no more room than they have in an outage.
        let most = self.keep + TRIPS_MAX;
        let surplus = self.unproven.len().saturating_sub(most);
        self.unproven.drain(..surplus);
    }

    /// The probe with this number returned: what was sent before it has passed the broker.
    pub(super) fn proven(&mut self, probe: u64) {
        while self
            .unproven
            .front()
            .is_some_and(|(sent_behind, _)| *sent_behind < probe)
        {
            self.unproven.pop_front();
        }
    }

    /// The connection is lost: what was not proven is to be sent again, before everything else.
    pub(super) fn lost(&mut self) {
        if self.unproven.is_empty() {
            return;
        }
        let waiting = self.take(usize::MAX, usize::MAX);
        let unproven = std::mem::take(&mut self.unproven);
        unproven
            .into_iter()
            .map(|(_, entry)| entry)
            .chain(waiting)
            .for_each(|entry| self.add(entry));
    }

    /// Changes that wait to be sent.
    pub(super) fn len(&self) -> usize {
        self.telemetry.len() + self.trips.len()
    }

    /// Takes the count of changes that were dropped for newer ones.
    pub(super) const fn take_dropped(&mut self) -> u64 {
        std::mem::replace(&mut self.dropped, 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(at_ms: u64, is_trip: bool) -> MetricChange {
        MetricChange {
            metric: 0,
            at_ms,
            value: Some(PayloadValue::Boolean(is_trip)),
            is_trip,
        }
    }

    fn moments(entries: &[MetricChange]) -> Vec<u64> {
        entries.iter().map(|entry| entry.at_ms).collect()
    }

    #[test]
    fn it_comes_out_in_the_order_in_which_it_happened() {
        let mut history = MetricHistory::new(10);
        for at in 0..6 {
            history.add(entry(at, at % 3 == 1));
        }
        assert_eq!(moments(&history.take(3, usize::MAX)), [0, 1, 2]);
        assert_eq!(moments(&history.take(usize::MAX, 1)), [3], "one at least");
        assert_eq!(moments(&history.take(usize::MAX, usize::MAX)), [4, 5]);
        assert_eq!(history.len(), 0);
    }

    #[test]
    fn the_oldest_telemetry_gives_way_and_trips_do_not() {
        let mut history = MetricHistory::new(2);
        history.add(entry(0, true));
        for at in 1..5 {
            history.add(entry(at, false));
        }
        assert_eq!(
            (
                history.len(),
                history.take_dropped(),
                history.take_dropped()
            ),
            (3, 2, 0)
        );
        assert_eq!(moments(&history.take(9, usize::MAX)), [0, 3, 4]);
        let mut history = MetricHistory::new(0);
        (0..1000).for_each(|at| history.add(entry(at, at % 2 == 0)));
        assert_eq!(history.len(), TRIPS_MAX, "telemetry is not wanted");
    }

    #[test]
    fn what_no_probe_has_followed_through_the_broker_is_sent_again_first() {
        let mut history = MetricHistory::new(10);
        history.sent(4, [entry(1, false)]);
        history.sent(5, [entry(2, false), entry(3, true)]);
        history.add(entry(4, false));
        history.proven(5);
        history.lost();
        assert_eq!(moments(&history.take(9, usize::MAX)), [2, 3, 4]);
        history.sent(6, [entry(5, false)]);
        history.proven(7);
        history.lost();
        assert_eq!(history.len(), 0);
    }
}
