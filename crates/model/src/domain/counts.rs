//! Counters of one drive since the gateway started. They only rise.

use super::command::{Outcome, Owner};
use std::time::Duration;

/// Upper ends of the buckets of reply times, in milliseconds; longer times are counted after the last. They range from
/// what a fast drive needs to the longest wait that a model asks for.
pub const REPLY_BUCKETS_MS: [u64; 12] = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];

/// Cumulative reply times of one class of requests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplyCounts {
    buckets: [u64; REPLY_BUCKETS_MS.len() + 1],
    sum_us: u64,
}

impl ReplyCounts {
    /// Counts a reply that began `time` after the end of its request.
    pub fn add(&mut self, time: Duration) {
        let place = REPLY_BUCKETS_MS
            .iter()
            .position(|end| time <= Duration::from_millis(*end));
        if let Some(bucket) = self
            .buckets
            .get_mut(place.unwrap_or(REPLY_BUCKETS_MS.len()))
        {
            *bucket += 1;
        }
        self.sum_us = self
            .sum_us
            .saturating_add(u64::try_from(time.as_micros()).unwrap_or(u64::MAX));
    }

    /// Upper end of each bucket (`None` for the last) and the number of replies in that bucket alone.
    pub fn buckets(&self) -> impl Iterator<Item = (Option<Duration>, u64)> + '_ {
        let ends = REPLY_BUCKETS_MS
            .iter()
            .map(|end| Some(Duration::from_millis(*end)));
        ends.chain([None]).zip(self.buckets.iter().copied())
    }

    /// The number of replies.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.buckets.iter().sum()
    }

    /// The sum of all times.
    #[must_use]
    pub const fn sum(&self) -> Duration {
        Duration::from_micros(self.sum_us)
    }
}

/// The sources of commands, in the order of [`CommandCounts`].
pub const COMMAND_SOURCES: [&str; 7] = [
    "modbus-tcp",
    "modbus-security",
    "mqtt",
    "local",
    "page",
    "sparkplug",
    "modbus-rtu",
];

const fn source(owner: &Owner) -> usize {
    match owner {
        Owner::ModbusTcp(_) => 0,
        Owner::ModbusSecurity(_) => 1,
        Owner::Mqtt | Owner::MqttBy(_) => 2,
        Owner::Local => 3,
        Owner::Page(_) => 4,
        Owner::Sparkplug => 5,
        Owner::ModbusRtu(_) => 6,
    }
}

/// Completed attempts to command or to write, by source and outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CommandCounts([[u64; Outcome::ALL.len()]; COMMAND_SOURCES.len()]);

impl CommandCounts {
    /// Counts a completed attempt of `owner`.
    pub fn add(&mut self, owner: &Owner, outcome: Outcome) {
        let place = usize::from(outcome.number()).checked_sub(1);
        let of_source = self.0.get_mut(source(owner));
        if let Some(count) = of_source
            .zip(place)
            .and_then(|(counts, place)| counts.get_mut(place))
        {
            *count += 1;
        }
    }

    /// Source, outcome and count: all outcomes of each source that has been used.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, Outcome, u64)> + '_ {
        let sources = COMMAND_SOURCES
            .iter()
            .zip(&self.0)
            .filter(|(_, counts)| counts.iter().any(|count| *count > 0));
        sources.flat_map(|(source, counts)| {
            Outcome::ALL
                .iter()
                .zip(counts)
                .map(|(outcome, count)| (*source, *outcome, *count))
        })
    }
}

/// How the exchanges with one drive ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExchangeCounts {
    /// With the right reply.
    pub replies: u64,
    /// With an exception of the drive's own.
    pub exceptions: u64,
    /// With a damaged reply of the right length.
    pub garbled: u64,
    /// Without any frame from it in time.
    pub silent: u64,
    /// Reads that were repeated after damage. They do not count as exchanges of their own.
    pub retries: u64,
}

impl ExchangeCounts {
    /// All exchanges that have ended.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.replies + self.exceptions + self.garbled + self.silent
    }

    /// The increase since `before`.
    #[must_use]
    pub const fn since(&self, before: &Self) -> Self {
        Self {
            replies: self.replies.saturating_sub(before.replies),
            exceptions: self.exceptions.saturating_sub(before.exceptions),
            garbled: self.garbled.saturating_sub(before.garbled),
            silent: self.silent.saturating_sub(before.silent),
            retries: self.retries.saturating_sub(before.retries),
        }
    }
}

/// Kinds of damage in the data received from one drive, as far as the bytes tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DamageCounts {
    /// Exchanges without an answer in which bytes arrived.
    pub damaged: u64,
    /// Of these: only the first characters of the reply were wrong or missing.
    pub head: u64,
    /// Of these: the end of the reply was missing.
    pub cut: u64,
    /// Sound replies preceded by bytes that belong to no frame.
    pub led: u64,
    /// Sound frames of the drive that no request explains.
    pub doubled: u64,
    /// Replies of the drive that arrived when none, or another one, was awaited.
    pub late: u64,
    /// Of these: later than the declared maximum lateness.
    pub beyond_limit: u64,
    /// Exchanges whose reply is long, see [`LONG_REPLY_PDU_BYTES`].
    pub long: u64,
    /// Of these: damaged ones.
    pub long_damaged: u64,
}

impl DamageCounts {
    /// The increase since `before`.
    #[must_use]
    pub const fn since(&self, before: &Self) -> Self {
        Self {
            damaged: self.damaged.saturating_sub(before.damaged),
            head: self.head.saturating_sub(before.head),
            cut: self.cut.saturating_sub(before.cut),
            led: self.led.saturating_sub(before.led),
            doubled: self.doubled.saturating_sub(before.doubled),
            late: self.late.saturating_sub(before.late),
            beyond_limit: self.beyond_limit.saturating_sub(before.beyond_limit),
            long: self.long.saturating_sub(before.long),
            long_damaged: self.long_damaged.saturating_sub(before.long_damaged),
        }
    }
}

/// PDU bytes from which a reply counts as long: five words, about twice as long on the wire as one word.
pub const LONG_REPLY_PDU_BYTES: usize = 12;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_counted_in_the_bucket_that_ends_with_it() {
        let mut counts = ReplyCounts::default();
        for micros in [0, 1000, 1001, 5_000_000, 5_000_001, 60_000_000] {
            counts.add(Duration::from_micros(micros));
        }
        let filled: Vec<_> = counts.buckets().filter(|(_, count)| *count > 0).collect();
        let ms = |ms| Some(Duration::from_millis(ms));
        assert_eq!(filled, [(ms(1), 2), (ms(2), 1), (ms(5000), 1), (None, 2)]);
        assert_eq!(
            (counts.count(), counts.sum()),
            (6, Duration::from_micros(70_002_002))
        );
        assert!(REPLY_BUCKETS_MS.is_sorted());
    }

    #[test]
    fn attempts_are_counted_by_source_and_outcome_and_an_unused_source_is_left_out() {
        let mut counts = CommandCounts::default();
        assert_eq!(counts.iter().count(), 0);
        let owners = [
            Owner::ModbusTcp([127, 0, 0, 1].into()),
            Owner::Mqtt,
            Owner::Local,
        ];
        for (owner, outcome) in owners
            .iter()
            .flat_map(|owner| Outcome::ALL.iter().map(move |it| (owner, *it)))
        {
            counts.add(owner, outcome);
        }
        counts.add(&Owner::Mqtt, Outcome::Refused);
        let shown: Vec<_> = counts.iter().collect();
        assert_eq!(shown.len(), 3 * Outcome::ALL.len());
        assert!(
            shown.contains(&("mqtt", Outcome::Refused, 2))
                && shown.contains(&("local", Outcome::Confirmed, 1))
        );
        assert!(
            !shown
                .iter()
                .any(|(source, ..)| *source == "modbus-security")
        );
    }
}
