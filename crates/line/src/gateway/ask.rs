//! Requests from clients: reads are split into frames that the model allows, writes are reviewed.

use super::core::LineCore;
use super::drive::DriveOnLine;
use super::waiter::ReportWaiter;
use crate::domain::address::Address;
use crate::domain::command::{CommandRequest, Order, Reason, Report};
use crate::domain::ids::{AskerId, DriveIndex};
use crate::domain::native::{
    FRAMES_MAX, NativeAnswer, NativeAsk, NativeOutcome, NativeRefusal, NativeRequest,
};
use crate::domain::time::MonoTime;
use crate::drive::decode;
use crate::guard::{COMMAND_DEADLINE, DriveFacts};
use crate::journal::TriedWrite;
use crate::line::schedule::{NativeQuery, QueuedRead, ReadKey, ScheduleFull, WaiterId};
use crate::profile::model::Model;
use crate::wire::pdu::function;

impl LineCore {
    pub(super) fn on_native(&mut self, now: MonoTime, request: NativeRequest) {
        if request.writes() {
            self.order_taken(now, request.drive);
        }
        let taken = match &request.ask {
            NativeAsk::Read { address, count } => self.take_read(now, &request, *address, *count),
            NativeAsk::Write { address, values } => {
                self.take_write(now, &request, *address, values)
            }
            NativeAsk::Loop { data } => self.take_loop(now, &request, *data),
        };
        if let Err(outcome) = taken {
            if outcome == NativeOutcome::Refused(NativeRefusal::QueueFull) {
                self.counters.queue_full += 1;
            }
            self.answer(NativeAnswer {
                asker: request.asker,
                ticket: request.ticket,
                outcome,
            });
        }
    }

    /// A departing client's reads and commands that have not begun are dropped. A stop stays, and so does what is on the wire.
    pub(super) fn on_asker_gone(&mut self, asker: AskerId) {
        self.clients.forget(asker);
        for work in self.drives.works_mut() {
            self.counters.withdrawn += work.withdraw(asker, &mut self.effects);
        }
    }

    /// A client gives a command.
    pub(super) fn on_command(&mut self, now: MonoTime, command: &CommandRequest) {
        let CommandRequest {
            asker,
            ticket,
            drive,
            ..
        } = *command;
        if !command.order.is_no_attempt() {
            self.order_taken(now, drive);
        }
        self.command(now, command, ReportWaiter::of_command(asker, ticket, drive));
    }

    fn order_taken(&mut self, now: MonoTime, drive: DriveIndex) {
        if let Some(drive) = self.drives.get_mut(drive) {
            drive.order_taken(now);
        }
    }

    fn command(&mut self, now: MonoTime, command: &CommandRequest, mut waiter: ReportWaiter) {
        let Some(drive) = self.drives.get(command.drive) else {
            let report = Report::refused(Reason::UnknownDrive);
            let tried = TriedWrite::Order(command.order.clone());
            self.effects
                .attempt_ended(command.drive, command.origin.owner, tried, report);
            self.effects.tell(&mut waiter, report, true);
            return;
        };
        let facts = DriveFacts {
            listens: self.listens(),
            line_is_bad: self.health.is_suspended(command.drive.get()),
            is_implausible: drive.snapshot.is_implausible,
            ..drive
                .work
                .facts(self.takes_requests(), self.is_offline(command.drive), now)
        };
        self.drives[command.drive]
            .work
            .command(now, command, waiter, facts, &mut self.effects);
        if !self.port.is_open() {
            self.drives[command.drive]
                .work
                .stop_waits_for_the_line(&mut self.effects);
        }
    }

    fn take_read(
        &mut self,
        now: MonoTime,
        request: &NativeRequest,
        address: Address,
        count: u16,
    ) -> Result<(), NativeOutcome> {
        let Some(DriveOnLine { setup, .. }) = self.drives.get(request.drive) else {
            return Err(NativeOutcome::Refused(NativeRefusal::NoSuchUnit));
        };
        let frames = frames_of(&setup.model, address, count)
            .ok_or(NativeRefusal::TooManyFrames)
            .map_err(refused)?;
        self.may_wait(now, request.drive)?;
        let parts: Vec<u16> = frames.iter().map(|(_, count)| *count).collect();
        let id = self.clients.open(request, &parts);
        for (part, (address, count)) in (0..).zip(frames) {
            let key = ReadKey {
                drive: request.drive,
                what: NativeQuery::Words { address, count },
            };
            self.queue(key, request.asker, WaiterId { request: id, part })?;
        }
        Ok(())
    }

    /// A loop test is sent to the drive if it serves function 08.
    fn take_loop(
        &mut self,
        now: MonoTime,
        request: &NativeRequest,
        data: u16,
    ) -> Result<(), NativeOutcome> {
        let Some(DriveOnLine { setup, .. }) = self.drives.get(request.drive) else {
            return Err(NativeOutcome::Refused(NativeRefusal::NoSuchUnit));
        };
        if !setup.model.serves(function::DIAGNOSTICS) {
            return Err(refused(NativeRefusal::Guard(Reason::NotCapable)));
        }
        self.may_wait(now, request.drive)?;
        let id = self.clients.open(request, &[]);
        let key = ReadKey {
            drive: request.drive,
            what: NativeQuery::Loop { data },
        };
        self.queue(
            key,
            request.asker,
            WaiterId {
                request: id,
                part: 0,
            },
        )
    }

    fn queue(
        &mut self,
        key: ReadKey,
        asker: AskerId,
        waiter: WaiterId,
    ) -> Result<(), NativeOutcome> {
        match self.clients.queue(key, asker, waiter) {
            Ok(QueuedRead::Alone) => Ok(()),
            Ok(QueuedRead::Joined) => {
                self.counters.joined += 1;
                Ok(())
            }
            Err(ScheduleFull) => Err(refused(NativeRefusal::QueueFull)),
        }
    }

    /// A write to the drive's own registers is reviewed like any order.
    fn take_write(
        &mut self,
        now: MonoTime,
        request: &NativeRequest,
        address: Address,
        values: &[u16],
    ) -> Result<(), NativeOutcome> {
        let NativeRequest {
            asker,
            ticket,
            drive,
            origin,
            deadline,
            ..
        } = *request;
        let order = self.order_of(drive, address, values).map_err(|reason| {
            let tried = TriedWrite::Registers {
                address,
                values: values.to_vec(),
            };
            self.effects
                .attempt_ended(drive, origin.owner, tried, Report::refused(reason));
            refused(if reason == Reason::UnknownDrive {
                NativeRefusal::NoSuchUnit
            } else {
                NativeRefusal::Guard(reason)
            })
        })?;
        let start_before = deadline.min(now + COMMAND_DEADLINE);
        let (issued, epoch, trial) = (None, None, None);
        let command = CommandRequest {
            asker,
            ticket,
            drive,
            origin,
            order,
            start_before,
            issued,
            epoch,
            trial,
        };
        self.command(now, &command, ReportWaiter::of_write(asker, ticket, drive));
        Ok(())
    }

    fn order_of(
        &self,
        drive: DriveIndex,
        address: Address,
        values: &[u16],
    ) -> Result<Order, Reason> {
        let DriveOnLine { setup, work, .. } = self.drives.get(drive).ok_or(Reason::UnknownDrive)?;
        work.guard().control().ok_or(Reason::ReadOnly)?;
        decode::order_on(&setup.model, work.guard().bases(), address, values)
    }

    /// Whether a read of `drive` may be queued: the line is up, there is room, and the drive is not silent.
    fn may_wait(&self, now: MonoTime, drive: DriveIndex) -> Result<(), NativeOutcome> {
        if self.listens() {
            return Err(refused(NativeRefusal::Standby));
        }
        if !self.takes_requests() {
            return Err(refused(NativeRefusal::LineDown));
        }
        if self.clients.is_full() {
            return Err(refused(NativeRefusal::QueueFull));
        }
        if now < self.drives[drive].station.ask_again_at() {
            return Err(NativeOutcome::NoReply);
        }
        Ok(())
    }
}

fn refused(refusal: NativeRefusal) -> NativeOutcome {
    NativeOutcome::Refused(refusal)
}

/// Cuts a read into frames within the model's limit and group boundaries; nothing if it needs too many.
fn frames_of(model: &Model, mut address: Address, mut count: u16) -> Option<Vec<(Address, u16)>> {
    let mut frames = Vec::with_capacity(1);
    while count > 0 {
        if frames.len() == FRAMES_MAX {
            return None;
        }
        let words = count.min(model.words_in_one_read(address));
        frames.push((address, words));
        address = (0..words).fold(address, |address, _| model.next_address(address));
        count -= words;
    }
    Some(frames)
}
