//! A client asks: the request is cut into frames that the model allows, or reviewed as a write.

use super::core::LineCore;
use crate::domain::ids::DriveIndex;
use crate::domain::native::{NativeAnswer, NativeAsk, NativeOutcome, NativeRequest, Refusal};
use crate::domain::report::LineState;
use crate::domain::time::MonoTime;
use crate::guard::{self, Attempt};
use crate::line::schedule::{Full, Queued, ReadKey, WaiterId, WriteJob};
use crate::profile::model::Model;

/// Most frames that one request may need.
pub const FRAMES_MAX: usize = 16;

impl LineCore {
    pub(super) fn on_native(&mut self, now: MonoTime, request: NativeRequest) {
        let taken = match &request.ask {
            NativeAsk::Read { address, count } => self.take_read(now, &request, *address, *count),
            NativeAsk::Write { address, values } => self.take_write(&request, *address, values.clone()),
        };
        if let Err(outcome) = taken {
            if outcome == NativeOutcome::Refused(Refusal::QueueFull) {
                self.counters.queue_full += 1;
            }
            self.answer(NativeAnswer { asker: request.asker, ticket: request.ticket, outcome });
        }
    }

    fn take_read(
        &mut self,
        now: MonoTime,
        request: &NativeRequest,
        address: u16,
        count: u16,
    ) -> Result<(), NativeOutcome> {
        let Some(drive) = self.setup.drives.get(request.drive.get()) else {
            return Err(NativeOutcome::Refused(Refusal::NoSuchUnit));
        };
        let frames = frames_of(&drive.model, address, count).ok_or(Refusal::TooManyFrames).map_err(refused)?;
        self.may_wait(now, request.drive)?;
        let parts: Vec<u16> = frames.iter().map(|(_, count)| *count).collect();
        let id = self.natives.open(request, &parts);
        for (part, (address, count)) in (0..).zip(frames) {
            let key = ReadKey { drive: request.drive, address, count };
            let waiter = WaiterId { request: id, part };
            match self.schedule.push_read(key, request.asker, waiter) {
                Ok(Queued::Alone) => {}
                Ok(Queued::Joined) => self.counters.joined += 1,
                Err(Full) => return self.give_back(waiter),
            }
        }
        Ok(())
    }

    fn take_write(&mut self, request: &NativeRequest, address: u16, values: Vec<u16>) -> Result<(), NativeOutcome> {
        let Some(drive) = self.setup.drives.get(request.drive.get()) else {
            return Err(NativeOutcome::Refused(Refusal::NoSuchUnit));
        };
        let attempt = Attempt { drive: request.drive, address, values, deadline: request.deadline };
        let approved = guard::review(&attempt, &drive.control).map_err(refused)?;
        if self.state == LineState::Down {
            return Err(refused(Refusal::LineDown));
        }
        let waiter = WaiterId { request: self.natives.open(request, &[]), part: 0 };
        self.schedule.push_write(WriteJob { approved, waiter }).or_else(|Full| self.give_back(waiter))
    }

    /// Whether a read of `drive` may wait now: the line is up, there is room, and the drive is not silent.
    fn may_wait(&self, now: MonoTime, drive: DriveIndex) -> Result<(), NativeOutcome> {
        if self.state == LineState::Down {
            return Err(refused(Refusal::LineDown));
        }
        if self.natives.is_full() {
            return Err(refused(Refusal::QueueFull));
        }
        if now < self.stations[drive.get()].ask_again_at() {
            return Err(NativeOutcome::NoReply);
        }
        Ok(())
    }

    /// Takes back a request that did not fit whole.
    fn give_back(&mut self, waiter: WaiterId) -> Result<(), NativeOutcome> {
        self.natives.end(waiter, NativeOutcome::Expired);
        self.drop_unwanted();
        Err(refused(Refusal::QueueFull))
    }
}

fn refused(refusal: Refusal) -> NativeOutcome {
    NativeOutcome::Refused(refusal)
}

/// Cuts a read into frames within the model's limit and group boundaries; nothing if it needs too many.
fn frames_of(model: &Model, mut address: u16, mut count: u16) -> Option<Vec<(u16, u16)>> {
    let mut frames = Vec::with_capacity(1);
    while count > 0 {
        if frames.len() == FRAMES_MAX {
            return None;
        }
        let words = count.min(model.words_in_one_read(address));
        frames.push((address, words));
        address = address.wrapping_add(words);
        count -= words;
    }
    Some(frames)
}
