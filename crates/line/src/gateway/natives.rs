//! Native requests of clients: each has one or more frames on the line and gets exactly one outcome.

use super::event::LineEffect;
use super::outbox::EffectOutbox;
use crate::domain::ids::{AskerId, DriveIndex, Ticket};
use crate::domain::native::{NativeAnswer, NativeOutcome, NativeRequest};
use crate::domain::time::MonoTime;
use crate::line::schedule::{QueuedRead, ReadJob, ReadKey, ReadSchedule, ScheduleFull, WaiterId};
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

/// Maximum number of pending requests per line: 256 clients with 16 each.
pub const REQUESTS_MAX: usize = 4096;

/// What the clients of one line have asked its drives: the requests, and their frames that wait for the line.
#[derive(Debug, Default)]
pub(super) struct ClientReads {
    pending: PendingNatives,
    schedule: ReadSchedule,
}

impl ClientReads {
    /// Whether there is no room for another request.
    pub fn is_full(&self) -> bool {
        self.pending.is_full()
    }

    /// The number of pending requests.
    pub fn len(&self) -> usize {
        self.pending.len()
    }

    /// The earliest deadline.
    pub fn next_deadline(&self) -> Option<MonoTime> {
        self.pending.next_deadline()
    }

    /// Adds a request whose frames carry `parts` words each, and returns its number.
    pub fn open(&mut self, request: &NativeRequest, parts: &[u16]) -> u64 {
        self.pending.open(request, parts)
    }

    /// Queues a frame of a request. If there is no room, the request is dropped without an answer.
    pub fn queue(
        &mut self,
        key: ReadKey,
        asker: AskerId,
        waiter: WaiterId,
    ) -> Result<QueuedRead, ScheduleFull> {
        let queued = self.schedule.push_read(key, asker, waiter);
        if queued.is_err() {
            self.pending.end(waiter, NativeOutcome::Expired);
            self.drop_unwanted();
        }
        queued
    }

    /// Drops all requests of a client that is gone.
    pub fn forget(&mut self, asker: AskerId) {
        self.pending.forget(asker);
        self.schedule.forget(asker);
        self.drop_unwanted();
    }

    /// The frames that wait.
    pub fn keys(&self) -> impl Iterator<Item = &ReadKey> {
        self.schedule.reads()
    }

    /// The next frame that `may_go`.
    pub fn take(&mut self, may_go: impl Fn(&ReadKey) -> bool) -> Option<ReadJob> {
        self.schedule.take_read(may_go)
    }

    /// The waiting frame with the same question as `key`.
    pub fn take_same(&mut self, key: &ReadKey) -> Option<ReadJob> {
        self.schedule.take_same(key)
    }

    /// A frame is sent once more.
    pub fn repeat(&mut self, job: ReadJob) {
        self.schedule.repeat_read(job);
    }

    pub fn is_waited_for(&self, job: &ReadJob) -> bool {
        job.waiters
            .iter()
            .any(|waiter| self.pending.is_waited_for(*waiter))
    }

    /// The words that a frame has brought.
    pub fn deliver(&mut self, job: ReadJob, words: Vec<u16>, effects: &mut EffectOutbox) {
        let words: Arc<[u16]> = Arc::from(words);
        for waiter in job.waiters {
            if let Some(answer) = self.pending.words(waiter, &words) {
                effects.push_back(LineEffect::Answer(answer));
            }
        }
    }

    /// Ends requests before their words have arrived; their other queued frames are dropped.
    pub fn end_all(
        &mut self,
        waiters: Vec<WaiterId>,
        outcome: &NativeOutcome,
        effects: &mut EffectOutbox,
    ) {
        let had_waiters = !waiters.is_empty();
        for waiter in waiters {
            if let Some(answer) = self.pending.end(waiter, outcome.clone()) {
                effects.push_back(LineEffect::Answer(answer));
            }
        }
        if had_waiters {
            self.drop_unwanted();
        }
    }

    /// Ends the requests that wait for `drive`.
    pub fn end_those_of(
        &mut self,
        drive: DriveIndex,
        outcome: &NativeOutcome,
        effects: &mut EffectOutbox,
    ) {
        let waiting = self.schedule.take_reads_of(drive);
        let waiters = waiting.into_iter().flat_map(|job| job.waiters).collect();
        self.end_all(waiters, outcome, effects);
    }

    /// Ends all requests that wait.
    pub fn end_waiting(&mut self, outcome: &NativeOutcome, effects: &mut EffectOutbox) {
        let waiting = self.schedule.clear();
        self.end_all(waiting, outcome, effects);
    }

    /// Ends the requests whose deadline has passed at `now`, and returns their number.
    pub fn expire(&mut self, now: MonoTime, effects: &mut EffectOutbox) -> u64 {
        let mut expired = 0;
        while let Some(answer) = self.pending.expire(now) {
            expired += 1;
            effects.push_back(LineEffect::Answer(answer));
        }
        if expired > 0 {
            self.drop_unwanted();
        }
        expired
    }

    fn drop_unwanted(&mut self) {
        self.schedule
            .drop_unwanted(|waiter| self.pending.is_waited_for(waiter));
    }
}

/// A pending request.
#[derive(Debug)]
struct PendingNative {
    asker: AskerId,
    ticket: Ticket,
    deadline: MonoTime,
    words: CollectedWords,
}

/// The words received so far.
#[derive(Debug)]
enum CollectedWords {
    /// One frame carries all words.
    AtOnce,
    /// Several frames carry the words: the offset of each, the number of missing frames, and the words.
    InParts {
        starts: Vec<u16>,
        out: usize,
        words: Vec<u16>,
    },
}

/// The pending requests of one line.
#[derive(Debug, Default)]
struct PendingNatives {
    last: u64,
    waiting: HashMap<u64, PendingNative>,
    deadlines: BTreeSet<(MonoTime, u64)>,
}

impl PendingNatives {
    /// Whether there is no room for another request.
    fn is_full(&self) -> bool {
        self.waiting.len() >= REQUESTS_MAX
    }

    /// The number of pending requests.
    fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Adds a request whose frames carry `parts` words each, and returns its number.
    fn open(&mut self, request: &NativeRequest, parts: &[u16]) -> u64 {
        self.last += 1;
        let words = if parts.len() <= 1 {
            CollectedWords::AtOnce
        } else {
            collected(parts)
        };
        let native = PendingNative {
            asker: request.asker,
            ticket: request.ticket,
            deadline: request.deadline,
            words,
        };
        self.deadlines.insert((request.deadline, self.last));
        self.waiting.insert(self.last, native);
        self.last
    }

    /// Whether a request still waits for a job.
    fn is_waited_for(&self, waiter: WaiterId) -> bool {
        self.waiting.contains_key(&waiter.request)
    }

    /// Takes the words of one frame. Returns the answer once all frames have arrived.
    fn words(&mut self, waiter: WaiterId, words: &Arc<[u16]>) -> Option<NativeAnswer> {
        let native = self.waiting.get_mut(&waiter.request)?;
        let all = match &mut native.words {
            CollectedWords::AtOnce => Arc::clone(words),
            CollectedWords::InParts {
                starts,
                out,
                words: all,
            } => {
                let start = usize::from(*starts.get(usize::from(waiter.part))?);
                all.get_mut(start..start + words.len())?
                    .copy_from_slice(words);
                *out -= 1;
                if *out > 0 {
                    return None;
                }
                Arc::from(std::mem::take(all))
            }
        };
        self.end(waiter, NativeOutcome::Words(all))
    }

    /// Ends the request of `waiter`, if it is still pending.
    fn end(&mut self, waiter: WaiterId, outcome: NativeOutcome) -> Option<NativeAnswer> {
        let native = self.waiting.remove(&waiter.request)?;
        self.deadlines.remove(&(native.deadline, waiter.request));
        Some(NativeAnswer {
            asker: native.asker,
            ticket: native.ticket,
            outcome,
        })
    }

    /// Ends a request whose deadline has passed at `now`, if there is one.
    fn expire(&mut self, now: MonoTime) -> Option<NativeAnswer> {
        let (deadline, request) = *self.deadlines.first()?;
        (deadline <= now)
            .then(|| self.end(WaiterId { request, part: 0 }, NativeOutcome::Expired))?
    }

    /// The earliest deadline.
    fn next_deadline(&self) -> Option<MonoTime> {
        self.deadlines.first().map(|(deadline, _)| *deadline)
    }

    /// Drops all requests of a client that is gone.
    fn forget(&mut self, asker: AskerId) {
        let deadlines = &mut self.deadlines;
        self.waiting.retain(|request, native| {
            let stays = native.asker != asker;
            if !stays {
                deadlines.remove(&(native.deadline, *request));
            }
            stays
        });
    }
}

fn collected(parts: &[u16]) -> CollectedWords {
    let mut total = 0;
    let mut starts = Vec::with_capacity(parts.len());
    for count in parts {
        starts.push(total);
        total += count;
    }
    CollectedWords::InParts {
        starts,
        out: parts.len(),
        words: vec![0; usize::from(total)],
    }
}
