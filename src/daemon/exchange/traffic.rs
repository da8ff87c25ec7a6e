//! Traffic of a line, recorded for those who watch it and only while it is watched.
//!
//! A line that is not watched pays one atomic load a round. The line's thread never waits for listeners: what it cannot
//! hand over at once it hands over in its next round.

use crate::daemon::exchange::shared::SharedLine;
use crate::domain::time::MonoTime;
use crate::domain::traffic::TrafficRecord;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

/// Most listeners of one line. A person with a page and a capture counts as two.
pub const LISTENERS_MAX: usize = 4;
/// Most records that are kept for listeners: ten seconds of the fastest serial line, at most 4 MB.
pub const RECORDS_MAX: usize = 4096;
/// How long recording continues after the last listener has left: one that returns in time misses nothing.
const LINGER: Duration = Duration::from_secs(10);
/// Most records that a line's thread holds back while a listener has the lock.
const HELD_BACK_MAX: usize = 256;

/// The traffic of one line.
#[derive(Debug, Default)]
pub struct LineTraffic {
    /// Until when the line is watched, in nanoseconds; 0 if it is not.
    watched_until: AtomicU64,
    ring: Mutex<TrafficRing>,
}

/// The newest records. They are numbered from 1 over the life of the line.
#[derive(Debug, Default)]
struct TrafficRing {
    records: VecDeque<Arc<TrafficRecord>>,
    last: u64,
    listeners: usize,
}

impl TrafficRing {
    fn put(&mut self, record: TrafficRecord) {
        if self.records.len() == RECORDS_MAX {
            self.records.pop_front();
        }
        self.records.push_back(Arc::new(record));
        self.last += 1;
    }

    /// The number of the oldest record that is kept.
    fn first(&self) -> u64 {
        self.last + 1 - self.records.len() as u64
    }
}

impl LineTraffic {
    /// Whether the line is watched at `now`.
    #[must_use]
    pub fn is_watched(&self, now: MonoTime) -> bool {
        self.watched_until.load(Ordering::Relaxed) > now.as_nanos()
    }

    /// Takes over `records`, unless a listener has the lock and few of them wait.
    pub fn take_over(&self, records: &mut Vec<TrafficRecord>) {
        if records.is_empty() {
            return;
        }
        let mut ring = match self.ring.try_lock() {
            Ok(ring) => ring,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) if records.len() < HELD_BACK_MAX => return,
            Err(TryLockError::WouldBlock) => self.lock(),
        };
        records.drain(..).for_each(|record| ring.put(record));
    }

    /// The line is not watched any more: drops the records and frees their memory.
    pub fn forget(&self) {
        self.lock().records = VecDeque::new();
    }

    fn lock(&self) -> MutexGuard<'_, TrafficRing> {
        self.ring.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A listener of a line, with its own position in the recording.
#[derive(Debug)]
pub struct TrafficListener {
    line: Arc<SharedLine>,
    /// The number of the last record that it has seen.
    seen: u64,
    clock: fn() -> MonoTime,
}

/// What was recorded since a listener looked last.
#[derive(Debug, Default)]
pub struct TrafficNews {
    /// Records that were dropped before the listener had seen them.
    pub lost: u64,
    /// The records with their numbers, in order.
    pub records: Vec<(u64, Arc<TrafficRecord>)>,
}

impl TrafficListener {
    /// Watches `line` from now on, or from after the record with the number `after` if that is still kept. `None` if
    /// [`LISTENERS_MAX`] watch it already. `clock` is read when the listener leaves.
    #[must_use]
    pub fn new(line: Arc<SharedLine>, after: Option<u64>, clock: fn() -> MonoTime) -> Option<Self> {
        let mut ring = line.traffic.lock();
        if ring.listeners >= LISTENERS_MAX {
            return None;
        }
        ring.listeners += 1;
        line.traffic
            .watched_until
            .store(u64::MAX, Ordering::Relaxed);
        // A number that was never assigned is from an earlier run.
        let seen = after
            .filter(|after| *after <= ring.last)
            .unwrap_or(ring.last);
        drop(ring);
        Some(Self { line, seen, clock })
    }

    /// The line.
    #[must_use]
    pub const fn line(&self) -> &Arc<SharedLine> {
        &self.line
    }

    /// The oldest records that it has not seen, at most `most` of them.
    pub fn look(&mut self, most: usize) -> TrafficNews {
        let ring = self.line.traffic.lock();
        let first = ring.first();
        let lost = first.saturating_sub(self.seen + 1);
        self.seen += lost;
        let skipped = usize::try_from(self.seen + 1 - first).unwrap_or(usize::MAX);
        let records: Vec<_> = (self.seen + 1..)
            .zip(ring.records.iter().skip(skipped).take(most).cloned())
            .collect();
        self.seen += records.len() as u64;
        TrafficNews { lost, records }
    }
}

impl Drop for TrafficListener {
    fn drop(&mut self) {
        let mut ring = self.line.traffic.lock();
        ring.listeners -= 1;
        if ring.listeners == 0 {
            let until = (self.clock)() + LINGER;
            self.line
                .traffic
                .watched_until
                .store(until.as_nanos(), Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::ids::Name;
    use crate::domain::link::Interface;
    use crate::domain::traffic::TrafficKind;

    fn line() -> Arc<SharedLine> {
        Arc::new(SharedLine::new(
            0,
            Name::new("hall-1").unwrap(),
            Interface::Rs485,
            [],
        ))
    }

    fn listen(line: &Arc<SharedLine>, after: Option<u64>) -> Option<TrafficListener> {
        TrafficListener::new(Arc::clone(line), after, || MonoTime::from_millis(1_000))
    }

    fn put(line: &SharedLine, count: u64) {
        let record = |at| {
            let at = MonoTime::from_millis(at);
            TrafficRecord {
                kind: TrafficKind::Noise,
                why: None,
                bytes: vec![0],
                begin: at,
                end: at,
            }
        };
        line.traffic
            .take_over(&mut (1..=count).map(record).collect());
    }

    fn numbers(news: &TrafficNews) -> Vec<u64> {
        news.records.iter().map(|(number, _)| *number).collect()
    }

    #[test]
    fn each_listener_has_a_place_of_his_own() {
        let line = line();
        let mut first = listen(&line, None).unwrap();
        put(&line, 3);
        let mut second = listen(&line, None).unwrap();
        put(&line, 2);
        assert_eq!(numbers(&first.look(4)), [1, 2, 3, 4]);
        assert_eq!(numbers(&first.look(4)), [5]);
        assert_eq!(numbers(&second.look(4)), [4, 5]);
        assert_eq!(numbers(&second.look(4)), [0; 0]);
    }

    #[test]
    fn what_was_given_up_is_counted_and_the_rest_is_there() {
        let line = line();
        let mut listener = listen(&line, None).unwrap();
        put(&line, RECORDS_MAX as u64 + 7);
        let news = listener.look(2);
        assert_eq!((news.lost, numbers(&news)), (7, vec![8, 9]));
        let news = listener.look(usize::MAX);
        assert_eq!((news.lost, news.records.len()), (0, RECORDS_MAX - 2));
        assert_eq!(news.records.last().unwrap().0, RECORDS_MAX as u64 + 7);
    }

    #[test]
    fn who_comes_back_goes_on_where_he_was() {
        let line = line();
        drop(listen(&line, None));
        put(&line, 5);
        assert_eq!(numbers(&listen(&line, Some(3)).unwrap().look(9)), [4, 5]);
        assert_eq!(numbers(&listen(&line, Some(5)).unwrap().look(9)), [0; 0]);
        assert_eq!(
            numbers(&listen(&line, Some(77)).unwrap().look(9)),
            [0; 0],
            "a number of another life"
        );
        line.traffic.forget();
        put(&line, 1);
        let news = listen(&line, Some(3)).unwrap().look(9);
        assert_eq!((news.lost, numbers(&news)), (2, vec![6]));
    }

    #[test]
    fn a_line_is_watched_as_long_as_somebody_is_there_and_a_moment_longer() {
        let line = line();
        let now = MonoTime::from_millis(1_000);
        assert!(!line.traffic.is_watched(MonoTime::ZERO));
        let first = listen(&line, None);
        let second = listen(&line, None);
        drop(first);
        assert!(
            line.traffic
                .is_watched(MonoTime::from_millis(u64::MAX / 2_000_000))
        );
        drop(second);
        assert!(line.traffic.is_watched(now + LINGER.mul_f64(0.9)));
        assert!(!line.traffic.is_watched(now + LINGER));
    }

    #[test]
    fn listeners_are_bounded() {
        let line = line();
        let mut held: Vec<_> = (0..LISTENERS_MAX)
            .map(|_| listen(&line, None).unwrap())
            .collect();
        assert!(listen(&line, None).is_none());
        held.pop();
        assert!(listen(&line, None).is_some());
    }

    #[test]
    fn the_line_never_waits_for_who_looks() {
        let line = line();
        let looking = line.traffic.lock();
        let at = MonoTime::ZERO;
        let mut records = vec![TrafficRecord {
            kind: TrafficKind::Noise,
            why: None,
            bytes: vec![0],
            begin: at,
            end: at,
        }];
        line.traffic.take_over(&mut records);
        assert_eq!(records.len(), 1);
        drop(looking);
        line.traffic.take_over(&mut records);
        assert_eq!((records.len(), line.traffic.lock().last), (0, 1));
    }
}
