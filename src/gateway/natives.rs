//! Pending native requests: each has one or more frames on the line and gets exactly one outcome.

use crate::domain::ids::{AskerId, Ticket};
use crate::domain::native::{NativeAnswer, NativeOutcome, NativeRequest};
use crate::domain::time::MonoTime;
use crate::line::schedule::WaiterId;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

/// Maximum number of pending requests per line: 256 clients with 16 each.
pub const REQUESTS_MAX: usize = 4096;

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
pub struct PendingNatives {
    last: u64,
    waiting: HashMap<u64, PendingNative>,
    deadlines: BTreeSet<(MonoTime, u64)>,
}

impl PendingNatives {
    /// Whether there is no room for another request.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.waiting.len() >= REQUESTS_MAX
    }

    /// The number of pending requests.
    #[must_use]
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Adds a request whose frames carry `parts` words each, and returns its number.
    pub fn open(&mut self, request: &NativeRequest, parts: &[u16]) -> u64 {
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
    #[must_use]
    pub fn is_waited_for(&self, waiter: WaiterId) -> bool {
        self.waiting.contains_key(&waiter.request)
    }

    /// Takes the words of one frame. Returns the answer once all frames have arrived.
    pub fn words(&mut self, waiter: WaiterId, words: &Arc<[u16]>) -> Option<NativeAnswer> {
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
    pub fn end(&mut self, waiter: WaiterId, outcome: NativeOutcome) -> Option<NativeAnswer> {
        let native = self.waiting.remove(&waiter.request)?;
        self.deadlines.remove(&(native.deadline, waiter.request));
        Some(NativeAnswer {
            asker: native.asker,
            ticket: native.ticket,
            outcome,
        })
    }

    /// Ends a request whose deadline has passed at `now`, if there is one.
    pub fn expire(&mut self, now: MonoTime) -> Option<NativeAnswer> {
        let (deadline, request) = *self.deadlines.first()?;
        (deadline <= now)
            .then(|| self.end(WaiterId { request, part: 0 }, NativeOutcome::Expired))?
    }

    /// The earliest deadline.
    #[must_use]
    pub fn next_deadline(&self) -> Option<MonoTime> {
        self.deadlines.first().map(|(deadline, _)| *deadline)
    }

    /// Drops all requests of a client that is gone.
    pub fn forget(&mut self, asker: AskerId) {
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
