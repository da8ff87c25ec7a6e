//! A command that is being carried out: its steps one after the other, then a look at what the drive shows of them;
//! one outcome for all.

use super::waiter::Waiter;
use crate::domain::command::{Order, Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::steps::{Part, Step, Write};
use crate::guard::{Approved, Void};
use crate::wire::pdu::{Reply, Request};

/// How often a read is sent before it is given up. A write is sent once.
const READS_MAX: u8 = 3;

/// One approved command and how far it has come.
#[derive(Debug)]
pub struct List {
    approved: Approved,
    waiter: Waiter,
    stage: Stage,
    /// A frame of it was written.
    has_begun: bool,
    /// How often the present read was sent in vain.
    reads: u8,
}

/// Where a command stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The step at this index.
    Step(usize),
    /// All is written; what the write at this index shows is being read back.
    ReadBack(usize),
    /// The write at this index was not answered: what it shows tells whether it took effect. Nothing more is written.
    Resolve(usize),
    /// Nothing is left to do.
    Done,
}

/// What follows from a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// The list goes on; there may be something to tell already.
    Goes(Option<Report>),
    /// The list is over.
    Ends(Report),
}

impl List {
    /// An approved command that has not begun.
    #[must_use]
    pub const fn new(approved: Approved, waiter: Waiter) -> Self {
        Self { approved, waiter, stage: Stage::Step(0), has_begun: false, reads: 0 }
    }

    /// Who waits for it.
    pub const fn waiter(&mut self) -> &mut Waiter {
        &mut self.waiter
    }

    /// What was ordered.
    #[must_use]
    pub const fn order(&self) -> &Order {
        self.approved.order()
    }

    /// The writes that were not sent, or that the drive refused: everything from the present step on.
    pub fn parts_left(&self) -> impl Iterator<Item = Part> + '_ {
        let from = match self.stage {
            Stage::Step(index) => index,
            Stage::Resolve(index) => index + 1,
            Stage::ReadBack(_) | Stage::Done => self.approved.steps().len(),
        };
        self.approved.steps().iter().skip(from).filter_map(|step| match step {
            Step::Write(write) => Some(write.part),
            Step::Check { .. } => None,
        })
    }

    /// Whether `newer` says everything that this one says, and nothing of this one is on its way: the newer one takes
    /// its place.
    #[must_use]
    pub fn is_replaced_by(&self, newer: &Self) -> bool {
        let (Order::Go(old), Order::Go(new)) = (self.order(), newer.order()) else { return false };
        self.stage == Stage::Step(0)
            && !self.has_begun
            && old.registers().is_empty()
            && self.approved.owner() == newer.approved.owner()
            && (old.frequency().is_none() || new.frequency().is_some())
            && (old.run().is_none() || new.run().is_some())
    }

    /// The request that comes next.
    #[must_use]
    pub fn request(&self) -> Option<Request> {
        match self.stage {
            Stage::Step(index) => self.approved.request(index),
            Stage::ReadBack(index) | Stage::Resolve(index) => {
                let (address, _) = self.write_at(index)?.shown?;
                Some(Request::ReadHolding { address, count: 1 })
            }
            Stage::Done => None,
        }
    }

    /// Whether the next request may be sent: reads that follow a write always may.
    ///
    /// # Errors
    /// [`Void`]
    pub fn may_go(&self, now: MonoTime, stops: u64) -> Result<(), Void> {
        match self.stage {
            Stage::Step(_) => self.approved.may_go(self.has_begun, now, stops),
            Stage::ReadBack(_) | Stage::Resolve(_) | Stage::Done => Ok(()),
        }
    }

    /// Before this moment its first write leaves or never.
    #[must_use]
    pub const fn start_before(&self) -> MonoTime {
        self.approved.start_before()
    }

    /// Whether something of it was written.
    #[must_use]
    pub const fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Whether its first step is still to come.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.stage == Stage::Step(0)
    }

    /// The next request goes out.
    pub fn was_sent(&mut self) {
        self.has_begun |= self.present_write().is_some();
    }

    /// The write that the next request is, if it is one.
    #[must_use]
    pub fn present_write(&self) -> Option<&Write> {
        match self.stage {
            Stage::Step(index) => self.write_at(index),
            Stage::ReadBack(_) | Stage::Resolve(_) | Stage::Done => None,
        }
    }

    /// The drive answered.
    pub fn answered(&mut self, reply: &Reply) -> Next {
        match (self.stage, reply) {
            (Stage::Step(index), reply) => self.step_answered(index, reply),
            (Stage::ReadBack(index) | Stage::Resolve(index), Reply::Words(words)) => {
                let shown = self.write_at(index).and_then(|write| write.shown).map(|(_, word)| word);
                self.shown(words.first().copied(), shown)
            }
            (Stage::ReadBack(_) | Stage::Resolve(_) | Stage::Done, _) => self.unanswered(),
        }
    }

    /// The drive answered with an exception.
    pub fn excepted(&mut self, code: u8) -> Next {
        if !matches!(self.stage, Stage::Step(_)) {
            return self.give_up_reading();
        }
        let failed = Report::new(Outcome::Failed, Reason::DriveException);
        Next::Ends(Report { exception: Some(code), ..failed })
    }

    /// The drive did not answer, or only with damage. A write is never repeated: where the model shows what became of
    /// it, that is read.
    pub fn unanswered(&mut self) -> Next {
        if let Some(write) = self.present_write() {
            let report = Report::new(Outcome::Unknown, Reason::NoReply);
            return match (self.stage, write.shown) {
                (Stage::Step(index), Some(_)) => {
                    self.stage = Stage::Resolve(index);
                    Next::Goes(Some(report))
                }
                _ => Next::Ends(report),
            };
        }
        self.reads += 1;
        if self.reads < READS_MAX { Next::Goes(None) } else { self.give_up_reading() }
    }

    fn step_answered(&mut self, index: usize, reply: &Reply) -> Next {
        match (self.approved.steps().get(index), reply) {
            (Some(Step::Check { least, most, .. }), Reply::Words(words)) => match words.first() {
                Some(word) if (least..=most).contains(&word) => self.go_on_from(index),
                _ => Next::Ends(Report::refused(Reason::SetpointUnknown)),
            },
            (Some(Step::Check { .. }), _) => self.unanswered(),
            (Some(Step::Write(write)), Reply::Holds { value }) if *value != write.value => {
                let kept = Report::new(Outcome::Failed, Reason::KeptOldValue);
                Next::Ends(Report { held: Some(*value), ..kept })
            }
            (Some(Step::Write(_)), _) => self.go_on_from(index),
            (None, _) => self.end(),
        }
    }

    fn go_on_from(&mut self, index: usize) -> Next {
        self.reads = 0;
        if index + 1 < self.approved.steps().len() {
            self.stage = Stage::Step(index + 1);
            return Next::Goes(None);
        }
        match self.next_shown(0) {
            Some(first) => {
                self.stage = Stage::ReadBack(first);
                Next::Goes(Some(Report::new(Outcome::Acknowledged, Reason::None)))
            }
            None => self.end(),
        }
    }

    fn shown(&mut self, held: Option<u16>, wanted: Option<u16>) -> Next {
        let is_there = held.is_some() && held == wanted;
        match self.stage {
            Stage::ReadBack(index) if is_there => match self.next_shown(index + 1) {
                Some(next) => {
                    (self.stage, self.reads) = (Stage::ReadBack(next), 0);
                    Next::Goes(None)
                }
                None => self.end(),
            },
            Stage::Resolve(index) if is_there && index + 1 >= self.approved.steps().len() => self.end(),
            Stage::Resolve(_) => {
                // Either the write had no effect, or the steps after it were never sent.
                Next::Ends(Report { held, ..Report::new(Outcome::Failed, Reason::NoReply) })
            }
            _ => Next::Ends(Report { held, ..Report::new(Outcome::Failed, Reason::NotReadBack) }),
        }
    }

    /// All steps are done: confirmed if the drive has shown the effect of all of them, else acknowledged is all that
    /// there is.
    fn end(&mut self) -> Next {
        let has_read_back = matches!(self.stage, Stage::ReadBack(_) | Stage::Resolve(_));
        let all_show = self.approved.steps().iter().all(|step| match step {
            Step::Write(write) => write.shown.is_some() || write.part == Part::Reset { ends: false },
            Step::Check { .. } => true,
        });
        let outcome = if has_read_back && all_show { Outcome::Confirmed } else { Outcome::Acknowledged };
        self.stage = Stage::Done;
        Next::Ends(Report::new(outcome, Reason::None))
    }

    fn give_up_reading(&mut self) -> Next {
        Next::Ends(match self.stage {
            Stage::Step(_) => Report::refused(Reason::NoReply),
            Stage::ReadBack(_) | Stage::Done => Report::new(Outcome::Acknowledged, Reason::NoReply),
            Stage::Resolve(_) => Report::new(Outcome::Unknown, Reason::NoReply),
        })
    }

    /// The first write from `from` on whose effect the drive shows.
    fn next_shown(&self, from: usize) -> Option<usize> {
        (from..self.approved.steps().len()).find(|index| self.write_at(*index).is_some_and(|it| it.shown.is_some()))
    }

    fn write_at(&self, index: usize) -> Option<&Write> {
        match self.approved.steps().get(index)? {
            Step::Write(write) => Some(write),
            Step::Check { .. } => None,
        }
    }
}
