//! The calls of one client: answered from pictures at once, or given to lines and answered when those have answered.

use super::super::answers::News;
use super::super::inbox::{Full, Inbox, Message};
use super::super::router::{Drive, Target};
use super::Client;
use crate::domain::command::{CommandAnswer, CommandRequest, Order};
use crate::domain::ids::{DriveIndex, Ticket};
use crate::domain::native::NativeRequest;
use crate::domain::time::MonoTime;
use crate::guard::COMMAND_DEADLINE;
use crate::north::modbus::{
    Answer, Ask, Call, Connection, Ended, Ordered, Present, ReadBehind, Taken, Words, native, own,
};
use crate::wire::exception;
use std::time::Duration;

/// Reads that renew a lease do so at most this often for each drive of a connection.
const RENEW_EVERY: Duration = Duration::from_millis(100);

impl Client {
    /// Answers a call at once, or hands it on.
    pub(super) fn serve_call(&self, now: MonoTime, machine: &mut Connection, call: Call, words: &mut Words) {
        let ticket = call.ticket;
        match self.router.find(call.unit) {
            Some(Target::Native(inbox, drive)) => {
                if let Err(code) = self.ask_drive(inbox, drive, call) {
                    machine.answer(now, ticket, Answer::Exception(code));
                }
            }
            Some(Target::Uniform(drive)) => {
                let taken = drive.unit.take(&call.ask, &drive.shared.view.load(), &self.present(now), words);
                if self.reads_renew && !call.ask.writes() && !matches!(taken, Taken::Exception(_)) {
                    self.renew(now, machine, drive);
                }
                self.settle(now, machine, &call, taken, words, Some(drive));
            }
            Some(Target::Own) => {
                let taken = own::take(call.unit, &call.ask, self.router.as_ref(), &self.present(now), words);
                self.settle(now, machine, &call, taken, words, None);
            }
            None => machine.answer(now, ticket, Answer::Exception(exception::GATEWAY_PATH_UNAVAILABLE)),
        }
    }

    /// Hands a native request to its line, or returns the exception that answers it.
    fn ask_drive(&self, inbox: &Inbox, drive: DriveIndex, call: Call) -> Result<(), u8> {
        let Call { ticket, ask, deadline, .. } = call;
        let ask = native::ask_of(ask)?;
        let request = NativeRequest { asker: self.asker, ticket, drive, origin: self.origin, ask, deadline };
        inbox.put(Message::Native(request)).map_err(|Full| exception::SERVER_DEVICE_BUSY)
    }

    /// Answers a call at once, or gives the orders that have to be answered first.
    fn settle(
        &self,
        now: MonoTime,
        machine: &mut Connection,
        call: &Call,
        taken: Taken,
        words: &Words,
        drive: Option<Drive<'_>>,
    ) {
        match (taken.at_once(words, |answer| machine.answer(now, call.ticket, answer)), drive) {
            (Ok(()), _) => {}
            (Err(Ordered::One(order)), Some(drive)) => {
                let result = self.order(now, call.ticket, drive, order);
                self.expect(now, machine, call, vec![(call.ticket, result)]);
            }
            (Err(_), _) => {
                let stop = |drive| {
                    let ticket = machine.fresh_ticket();
                    (ticket, self.order(now, ticket, drive, Order::Stop { setpoint: None }))
                };
                let given = self.router.controlled().map(stop).collect();
                self.expect(now, machine, call, given);
            }
        }
    }

    /// Gives an order to a drive, or returns why not.
    fn order(&self, now: MonoTime, ticket: Ticket, drive: Drive<'_>, order: Order) -> Result<(), Full> {
        drive.inbox.put(Message::Command(CommandRequest {
            asker: self.asker,
            ticket,
            drive: drive.shared.description.place.drive,
            origin: self.origin,
            order,
            start_before: now + COMMAND_DEADLINE,
            issued: None,
            epoch: None,
        }))
    }

    /// Waits for the answers to what was ordered for `call`. If nothing was (no drive has control), it is never
    /// allowed; if nothing could be, the answer comes at once.
    fn expect(&self, now: MonoTime, machine: &mut Connection, call: &Call, given: Vec<(Ticket, Result<(), Full>)>) {
        if given.is_empty() {
            return machine.answer(now, call.ticket, Answer::Exception(exception::ILLEGAL_FUNCTION));
        }
        let has_full = given.iter().any(|(_, result)| result.is_err());
        let worst = has_full.then_some(exception::SERVER_DEVICE_BUSY);
        let out: Vec<Ticket> = given.into_iter().filter_map(|(ticket, result)| result.ok().map(|()| ticket)).collect();
        if let (true, Some(code)) = (out.is_empty(), worst) {
            return machine.answer(now, call.ticket, Answer::Exception(code));
        }
        let read = read_behind(call);
        self.commands.borrow_mut().expect(now, call.ticket, call.deadline, out, worst, read);
    }

    /// Takes what a line says.
    pub(super) fn hear(&self, now: MonoTime, news: &News) {
        match news {
            News::Native(answer) => {
                self.machine.borrow_mut().answer(now, answer.ticket, native::answer_of(&answer.outcome));
            }
            News::Command(answer) => self.hear_command(now, answer),
            News::Trip(..) | News::Events { .. } => {}
        }
    }

    fn hear_command(&self, now: MonoTime, answer: &CommandAnswer) {
        let Some(Ended { call, exception, read }) = self.commands.borrow_mut().take(answer) else { return };
        let mut machine = self.machine.borrow_mut();
        let Some(read) = read else {
            return machine.answer(now, call, exception.map_or(Answer::Written, Answer::Exception));
        };
        let Some(Target::Uniform(drive)) = self.router.find(read.unit) else {
            return machine.answer(now, call, Answer::Exception(exception::SERVER_DEVICE_FAILURE));
        };
        let mut words = Words::default();
        let (view, present) = (drive.shared.view.load(), self.present(now));
        let taken = drive.unit.read(read.address, read.count, &view, &present, &mut words);
        // A read orders nothing.
        let _ = taken.at_once(&words, |answer| machine.answer(now, call, answer));
    }

    /// Renews the lease that this client holds. Nobody waits for the answer.
    fn renew(&self, now: MonoTime, machine: &mut Connection, drive: Drive<'_>) {
        let view = drive.shared.view.load();
        let lease = view.control.as_ref().and_then(|control| control.lease);
        if lease.is_none_or(|(owner, _)| owner != self.origin.owner) {
            return;
        }
        let mut renewed = self.renewed.borrow_mut();
        if renewed.get(&drive.place).is_some_and(|at| now.since(*at) < RENEW_EVERY) {
            return;
        }
        if self.order(now, machine.fresh_ticket(), drive, Order::Renew).is_ok() {
            renewed.insert(drive.place, now);
        }
    }

    fn present(&self, now: MonoTime) -> Present {
        Present { now, uptime_s: self.router.uptime_s(now), owner: self.origin.owner }
    }
}

/// What is read once the order in `call` is answered.
const fn read_behind(call: &Call) -> Option<ReadBehind> {
    match call.ask {
        Ask::ReadWriteWords { read_address, read_count, .. } => {
            Some(ReadBehind { unit: call.unit, address: read_address, count: read_count })
        }
        _ => None,
    }
}
