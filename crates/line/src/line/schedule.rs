//! The queue of native reads and loop tests: equal ones share an exchange, and askers are served fairly.
//!
//! Other work, above all stops, has priority and is queued with each drive.

use crate::domain::address::Address;
use crate::domain::ids::{AskerId, DriveIndex};
use crate::wire::pdu::Request;
use std::collections::{BTreeMap, HashMap};

/// Maximum number of different native reads waiting on one line. At 9600 bit/s this is more than half a minute of
/// work, longer than any client waits.
pub const READS_MAX: usize = 1024;
/// How often a read may be overtaken by younger ones that are next by address. Clients that scan the same registers
/// thus come to share exchanges, and no client waits more than this many exchanges longer.
pub const OVERTAKEN_MAX: u32 = 16;

/// How many turns an asker may be ahead of the one whose turn it is. However many reads it has queued, it gets no more
/// than that beyond its share.
const AHEAD_MAX: u64 = OVERTAKEN_MAX as u64;

/// A native read by what it reads. Equal keys share one exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ReadKey {
    /// Which drive of the line.
    pub drive: DriveIndex,
    /// The query.
    pub what: NativeQuery,
}

/// What a native read asks of its drive, ordered by address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum NativeQuery {
    /// Holding registers.
    Words {
        /// First register.
        address: Address,
        /// Number of words, within the model's limit.
        count: u16,
    },
    /// Return this word.
    Loop {
        /// The word.
        data: u16,
    },
}

impl ReadKey {
    /// Its request on the wire.
    #[must_use]
    pub const fn request(&self) -> Request {
        match self.what {
            NativeQuery::Words { address, count } => Request::Read { address, count },
            NativeQuery::Loop { data } => Request::Loopback { data },
        }
    }
}

/// A native read that is queued or on the wire.
#[derive(Debug)]
pub struct ReadJob {
    /// What it reads.
    pub key: ReadKey,
    /// Requests that wait for it, in order of arrival.
    pub waiters: Vec<WaiterId>,
    /// Whether it is on its second try.
    pub repeated: bool,
    /// Start tag of fair queueing: the turn of the asker whose turn comes first.
    tag: u64,
    overtaken: u32,
}

/// A request that waits on the line, and the frame of it that a job reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WaiterId {
    /// The request.
    pub request: u64,
    /// Which of its frames.
    pub part: u16,
}

/// The queue is full; the read was not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScheduleFull;

/// Whether a read joined another or waits on its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QueuedRead {
    /// The read waits on its own.
    Alone,
    /// The read shares the exchange of an earlier request that is not on the wire yet.
    Joined,
}

/// The queued native reads of one line.
#[derive(Debug, Default)]
pub struct ReadSchedule {
    reads: BTreeMap<ReadKey, ReadJob>,
    /// The turn that is being served.
    turn: u64,
    /// The next turn of each asker that has one ahead.
    next_turn: HashMap<AskerId, u64>,
    last_served: Option<ReadKey>,
}

impl ReadSchedule {
    /// Queues a native read for `waiter` of `asker`, or joins it to a queued one.
    ///
    /// # Errors
    /// [`ScheduleFull`] if too many different reads are queued.
    pub fn push_read(
        &mut self,
        key: ReadKey,
        asker: AskerId,
        waiter: WaiterId,
    ) -> Result<QueuedRead, ScheduleFull> {
        if self.reads.len() >= READS_MAX && !self.reads.contains_key(&key) {
            return Err(ScheduleFull);
        }
        let tag = self.take_turn(asker);
        match self.reads.get_mut(&key) {
            Some(job) => {
                job.waiters.push(waiter);
                job.tag = job.tag.min(tag);
                Ok(QueuedRead::Joined)
            }
            None => {
                let job = ReadJob {
                    key,
                    waiters: vec![waiter],
                    repeated: false,
                    tag,
                    overtaken: 0,
                };
                self.reads.insert(key, job);
                Ok(QueuedRead::Alone)
            }
        }
    }

    /// Puts back a read to be sent once more, before all others.
    pub fn repeat_read(&mut self, mut job: ReadJob) {
        job.repeated = true;
        job.tag = 0;
        job.overtaken = OVERTAKEN_MAX;
        if let Some(newer) = self.reads.remove(&job.key) {
            job.waiters.extend(newer.waiters);
        }
        self.reads.insert(job.key, job);
    }

    /// Removes the next native read that `may_go` allows. The one whose turn it is comes first, but up to
    /// [`OVERTAKEN_MAX`] times the next one by address is preferred, unless that would favour an asker with many
    /// requests.
    pub fn take_read(&mut self, may_go: impl Fn(&ReadKey) -> bool) -> Option<ReadJob> {
        let head = self
            .reads
            .values()
            .filter(|job| may_go(&job.key))
            .min_by_key(|job| (job.tag, std::cmp::Reverse(job.overtaken), job.key))?;
        let present_turn = head.tag;
        let last_turn = present_turn.saturating_add(AHEAD_MAX);
        let may_overtake = |job: &ReadJob| job.tag <= last_turn && may_go(&job.key);
        let key = if head.overtaken >= OVERTAKEN_MAX {
            head.key
        } else {
            self.next_on_the_way(may_overtake)?
        };
        let job = self.reads.remove(&key)?;
        for other in self.reads.values_mut().filter(|other| other.tag < job.tag) {
            other.overtaken += 1;
        }
        // An overtaking read does not advance the turn: those overtaken would lose theirs.
        self.turn = self.turn.max(present_turn);
        self.last_served = Some(key);
        Some(job)
    }

    /// Removes the native read of `key`, if it is queued: a poll of the same words is about to be sent.
    pub fn take_same(&mut self, key: &ReadKey) -> Option<ReadJob> {
        self.reads.remove(key)
    }

    /// The queued native reads.
    pub fn reads(&self) -> impl Iterator<Item = &ReadKey> {
        self.reads.keys()
    }

    /// Removes all native reads of `drive`.
    pub fn take_reads_of(&mut self, drive: DriveIndex) -> Vec<ReadJob> {
        self.reads
            .extract_if(.., |key, _| key.drive == drive)
            .map(|(_, job)| job)
            .collect()
    }

    /// Removes everything; returns the waiters.
    pub fn clear(&mut self) -> Vec<WaiterId> {
        std::mem::take(&mut self.reads)
            .into_values()
            .flat_map(|job| job.waiters)
            .collect()
    }

    /// Removes waiters for which `is_waited_for` is false, and reads without waiters.
    pub fn drop_unwanted(&mut self, is_waited_for: impl Fn(WaiterId) -> bool) {
        self.reads.retain(|_, job| {
            job.waiters.retain(|waiter| is_waited_for(*waiter));
            !job.waiters.is_empty()
        });
    }

    /// Forgets an asker that is gone.
    pub fn forget(&mut self, asker: AskerId) {
        self.next_turn.remove(&asker);
    }

    fn next_on_the_way(&self, may_overtake: impl Fn(&ReadJob) -> bool) -> Option<ReadKey> {
        let ahead = self.last_served.map(|last| {
            let beyond = (std::ops::Bound::Excluded(last), std::ops::Bound::Unbounded);
            self.reads.range(beyond).map(|(_, job)| job)
        });
        let mut all = ahead.into_iter().flatten().chain(self.reads.values());
        all.find(|job| may_overtake(job)).map(|job| job.key)
    }

    fn take_turn(&mut self, asker: AskerId) -> u64 {
        let next = self.next_turn.entry(asker).or_insert(0);
        let tag = self.turn.max(*next);
        *next = tag + 1;
        tag
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(address: Address) -> ReadKey {
        ReadKey {
            drive: DriveIndex(0),
            what: NativeQuery::Words { address, count: 1 },
        }
    }

    fn waiter(request: u64) -> WaiterId {
        WaiterId { request, part: 0 }
    }

    fn served(schedule: &mut ReadSchedule) -> Vec<u16> {
        std::iter::from_fn(|| schedule.take_read(|_| true))
            .map(|job| match job.key.what {
                NativeQuery::Words { address, .. } => address.number(),
                NativeQuery::Loop { data } => data,
            })
            .collect()
    }

    #[test]
    fn equal_reads_share_one_exchange() {
        let mut schedule = ReadSchedule::default();
        assert_eq!(
            schedule.push_read(key(1_u16.into()), AskerId(1), waiter(1)),
            Ok(QueuedRead::Alone)
        );
        assert_eq!(
            schedule.push_read(key(1_u16.into()), AskerId(2), waiter(2)),
            Ok(QueuedRead::Joined)
        );
        let job = schedule.take_read(|_| true).unwrap();
        assert_eq!(job.waiters, [waiter(1), waiter(2)]);
        // What is on the wire is joined no more.
        assert_eq!(
            schedule.push_read(key(1_u16.into()), AskerId(3), waiter(3)),
            Ok(QueuedRead::Alone)
        );
    }

    #[test]
    fn two_walks_over_the_same_registers_meet() {
        let mut schedule = ReadSchedule::default();
        let mut at = [1_u16, 5];
        for (asker, address) in (0..).zip(at) {
            schedule
                .push_read(key(address.into()), AskerId(asker), waiter(asker))
                .unwrap();
        }
        let mut exchanges = 0;
        while at[0] != at[1] {
            let job = schedule.take_read(|_| true).unwrap();
            exchanges += 1;
            for WaiterId { request: asker, .. } in job.waiters {
                let place = &mut at[asker as usize];
                *place = *place % 8 + 1;
                schedule
                    .push_read(key((*place).into()), AskerId(asker), waiter(asker))
                    .unwrap();
            }
            assert!(exchanges < 20, "{at:?}");
        }
    }

    #[test]
    fn a_busy_asker_cannot_starve_a_modest_one() {
        let mut schedule = ReadSchedule::default();
        for n in 0..500 {
            schedule
                .push_read(key(n.into()), AskerId(1), waiter(n.into()))
                .unwrap();
        }
        for _ in 0..100 {
            schedule.take_read(|_| true).unwrap();
        }
        // Its register lies behind all others on the way.
        schedule
            .push_read(key(9999_u16.into()), AskerId(2), waiter(9999))
            .unwrap();
        let waited = served(&mut schedule)
            .iter()
            .position(|address| *address == 9999)
            .unwrap();
        assert!(waited <= OVERTAKEN_MAX as usize + 1, "{waited}");
    }

    #[test]
    fn an_asker_of_many_reads_gets_no_more_turns_than_one_of_single_reads() {
        let mut schedule = ReadSchedule::default();
        for n in 0..500 {
            schedule
                .push_read(key(n.into()), AskerId(1), waiter(1))
                .unwrap();
        }
        let mut served = [0_u64; 3];
        let mut next = 1000;
        for asker in [0, 2] {
            schedule
                .push_read(
                    key((next + asker as u16).into()),
                    AskerId(asker),
                    waiter(asker),
                )
                .unwrap();
        }
        for _ in 0..600 {
            let asker = schedule.take_read(|_| true).unwrap().waiters[0].request;
            served[asker as usize] += 1;
            next += 3;
            // The one asks for the next right away, as the other two do.
            schedule
                .push_read(key(next.into()), AskerId(asker), waiter(asker))
                .unwrap();
        }
        assert!(
            served
                .iter()
                .all(|served| served.abs_diff(200) <= AHEAD_MAX),
            "{served:?}"
        );
    }

    #[test]
    fn every_read_is_served_within_its_turn_and_what_may_overtake_it() {
        let mut schedule = ReadSchedule::default();
        for asker in 0..10 {
            for n in 0..20_u16 {
                let at = n * 10 + asker as u16;
                schedule
                    .push_read(key(at.into()), AskerId(asker), waiter(at.into()))
                    .unwrap();
            }
        }
        assert_eq!(served(&mut schedule).len(), 200);
    }

    #[test]
    fn a_full_queue_refuses_what_it_cannot_join() {
        let mut schedule = ReadSchedule::default();
        for n in 0..READS_MAX as u16 {
            schedule
                .push_read(key(n.into()), AskerId(1), waiter(n.into()))
                .unwrap();
        }
        assert_eq!(
            schedule.push_read(key((u16::MAX).into()), AskerId(2), waiter(1)),
            Err(ScheduleFull)
        );
        assert_eq!(
            schedule.push_read(key(0_u16.into()), AskerId(2), waiter(2)),
            Ok(QueuedRead::Joined)
        );
    }

    #[test]
    fn a_repeated_read_goes_first_and_takes_newcomers_along() {
        let mut schedule = ReadSchedule::default();
        schedule
            .push_read(key(7_u16.into()), AskerId(1), waiter(1))
            .unwrap();
        let job = schedule.take_read(|_| true).unwrap();
        schedule
            .push_read(key(8_u16.into()), AskerId(1), waiter(2))
            .unwrap();
        schedule
            .push_read(key(7_u16.into()), AskerId(2), waiter(3))
            .unwrap();
        schedule.repeat_read(job);
        let again = schedule.take_read(|_| true).unwrap();
        assert_eq!((again.key, again.repeated), (key(7_u16.into()), true));
        assert_eq!(again.waiters, [waiter(1), waiter(3)]);
    }

    #[test]
    fn a_read_is_taken_in_the_place_of_a_poll_of_the_same_words_only() {
        let mut schedule = ReadSchedule::default();
        schedule
            .push_read(key(1_u16.into()), AskerId(1), waiter(1))
            .unwrap();
        assert!(schedule.take_same(&key(2_u16.into())).is_none());
        let longer = ReadKey {
            what: NativeQuery::Words {
                address: 1_u16.into(),
                count: 2,
            },
            ..key(1_u16.into())
        };
        assert!(schedule.take_same(&longer).is_none());
        assert_eq!(
            schedule.take_same(&key(1_u16.into())).unwrap().waiters,
            [waiter(1)]
        );
        assert!(schedule.take_same(&key(1_u16.into())).is_none());
    }

    #[test]
    fn reads_without_waiters_are_dropped() {
        let mut schedule = ReadSchedule::default();
        schedule
            .push_read(key(1_u16.into()), AskerId(1), waiter(1))
            .unwrap();
        schedule
            .push_read(key(1_u16.into()), AskerId(2), waiter(2))
            .unwrap();
        schedule
            .push_read(key(2_u16.into()), AskerId(1), waiter(3))
            .unwrap();
        schedule.drop_unwanted(|waiter| waiter.request == 2);
        assert_eq!(served(&mut schedule), [1]);
    }
}
