//! The calls of one client: answered at once from the views, or passed to lines and answered when those have answered.

use super::ModbusClient;
use crate::daemon::exchange::answers::LineNews;
use crate::daemon::exchange::inbox::{InboxFull, LineMessage};
use crate::daemon::exchange::router::{UnitDrive, UnitTarget};
use crate::domain::address::Address;
use crate::domain::command::{
    CommandAnswer, CommandRequest, Order, OrderManner, Origin, Reason, Report,
};
use crate::domain::ids::Ticket;
use crate::domain::native::{NativeAsk, NativeRequest};
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveRef;
use crate::guard::COMMAND_DEADLINE;
use crate::journal::TriedWrite;
use crate::north::modbus::{
    EndedCall, ModbusAnswer, ModbusConnection, ModbusRequest, ReadBehind, RequestAction,
    RequestContext, RequestedOrder, UnitCall, WordBuffer, memory, native, own, presses_stop,
};
use crate::wire::exception;
use std::time::Duration;

/// Reads renew a lease at most this often for each drive of a connection.
const RENEW_EVERY: Duration = Duration::from_millis(100);

impl ModbusClient {
    /// Processes what the client has sent. Each request is answered before the next one is taken if that can be done at
    /// once, so only those that wait for a line count as in flight. Of what `has_waited` through a stall only stops are
    /// executed.
    pub(super) fn serve_bytes(&self, now: MonoTime, mut bytes: &[u8], has_waited: bool) {
        let mut words = WordBuffer::default();
        let mut machine = self.machine.borrow_mut();
        let router = self.router();
        while !bytes.is_empty() {
            let (piece, rest) = bytes.split_at(machine.next_piece(bytes));
            machine.receive(now, piece, &|unit, ask| router.is_stop(unit, ask));
            while let Some(call) = machine.next_call() {
                self.serve_call(now, &mut machine, call, &mut words, has_waited);
            }
            bytes = rest;
        }
    }

    /// Answers a call at once, or passes it on. One that `has_waited` does not prove that its client is still there.
    fn serve_call(
        &self,
        now: MonoTime,
        machine: &mut ModbusConnection,
        call: UnitCall,
        words: &mut WordBuffer,
        has_waited: bool,
    ) {
        let router = self.router();
        if has_waited && call.ask.writes() && !router.is_stop(call.unit, &call.ask) {
            return machine.refuse(now, &call, tried_of(&call), Report::refused(Reason::Stale));
        }
        if !self.may_ask.get() {
            return machine.refuse(
                now,
                &call,
                tried_of(&call),
                Report::refused(Reason::NotAllowed),
            );
        }
        match router.find(call.unit) {
            Some(UnitTarget::Native(drive)) => {
                if let Err((tried, reason)) = self.ask_drive(now, machine, drive, &call, words) {
                    machine.refuse(now, &call, tried, Report::refused(reason));
                }
            }
            Some(UnitTarget::Uniform(drive)) => {
                let present = RequestContext {
                    standby: drive.shared.role.get(),
                    ..self.present(now)
                };
                let taken = drive
                    .unit
                    .take(&call.ask, &drive.shared.view.load(), &present, words);
                let is_read = !call.ask.writes()
                    && !matches!(
                        taken,
                        RequestAction::Exception(_) | RequestAction::Refused(_)
                    );
                if self.reads_renew.get() && is_read && !has_waited {
                    self.renew(now, machine, drive);
                }
                self.settle(now, machine, &call, taken, words, Some(drive));
            }
            Some(UnitTarget::Own) => {
                let taken = own::take(
                    call.unit,
                    &call.ask,
                    router.as_ref(),
                    &self.present(now),
                    words,
                );
                self.settle(now, machine, &call, taken, words, None);
            }
            None => machine.refuse(
                now,
                &call,
                tried_of(&call),
                Report::refused(Reason::UnknownDrive),
            ),
        }
    }

    /// Answers a native read from memory where the listener allows it, passes a native request to its line, or returns what
    /// was tried and why it is refused.
    fn ask_drive(
        &self,
        now: MonoTime,
        machine: &mut ModbusConnection,
        drive: UnitDrive<'_>,
        call: &UnitCall,
        words: &mut WordBuffer,
    ) -> Result<(), (Option<TriedWrite>, Reason)> {
        let UnitCall {
            ticket, deadline, ..
        } = *call;
        let UnitDrive { inbox, shared, .. } = drive;
        let ask = native::ask_of(&shared.description.model, call.ask.clone())
            .map_err(|_| (tried_of(call), Reason::NotCapable))?;
        let tried = match &ask {
            NativeAsk::Write { address, values } => Some(TriedWrite::Registers {
                address: *address,
                values: values.clone(),
            }),
            NativeAsk::Read { address, count } => {
                // What is heard of the other gateway is all that there is.
                let listens = shared.role.get() == Some(LineRole::Listening);
                if (listens || self.listener.remembers())
                    && self.recall(now, drive, (*address, *count), words)
                {
                    machine.answer(now, ticket, ModbusAnswer::Words(words.as_slice()));
                    return Ok(());
                }
                self.listener.reads().count_from_line();
                None
            }
            NativeAsk::Loop { .. } => None,
        };
        let drive = shared.description.place.drive;
        let request = NativeRequest {
            asker: self.asker,
            ticket,
            drive,
            origin: self.origin.get(),
            ask,
            deadline,
        };
        let until = if tried.is_some() {
            MonoTime::NEVER
        } else {
            deadline
        };
        let is_stop = self.router().is_stop(call.unit, &call.ask);
        let message = if is_stop {
            LineMessage::NativeStop(request)
        } else {
            LineMessage::Native(request)
        };
        inbox
            .put(message)
            .map_err(|InboxFull| (tried, Reason::QueueFull))?;
        self.known_until.set(self.known_until.get().max(until));
        Ok(())
    }

    /// Fills in the words of a native read that may be answered from memory, and returns whether it may.
    fn recall(
        &self,
        now: MonoTime,
        drive: UnitDrive<'_>,
        read: (Address, u16),
        words: &mut WordBuffer,
    ) -> bool {
        let description = &drive.shared.description;
        // Before the view: if the line takes an order in between, the counts differ.
        let orders = drive.inbox.orders(description.place.drive);
        let view = drive.shared.view.load();
        let Some(age) = memory::recall(description, &view, orders, read, now, words) else {
            return false;
        };
        self.listener.reads().count_from_memory(age);
        let (listener, age_ms) = (self.listener.reads().listener(), age.as_millis());
        tracing::trace!(listener, drive = %description.name, address = %read.0, count = read.1, age_ms, "read from memory");
        true
    }

    /// Answers a call at once, or sends the orders that have to be answered first.
    fn settle(
        &self,
        now: MonoTime,
        machine: &mut ModbusConnection,
        call: &UnitCall,
        taken: RequestAction,
        words: &WordBuffer,
        drive: Option<UnitDrive<'_>>,
    ) {
        if let RequestAction::Refused(reason) = taken {
            return machine.refuse(now, call, tried_of(call), Report::refused(reason));
        }
        match (
            taken.at_once(words, |answer| machine.answer(now, call.ticket, answer)),
            drive,
        ) {
            (Ok(()), _) => {}
            (Err(RequestedOrder::One(order)), Some(drive)) => {
                let manner = if presses_stop(&call.ask) {
                    OrderManner::Once
                } else {
                    OrderManner::Cyclic
                };
                let result = self.order(now, call.ticket, drive, order, manner);
                self.expect(now, machine, call, vec![(call.ticket, result)]);
            }
            (Err(_), _) => {
                let given = self.stop_all(now, machine);
                self.expect(now, machine, call, given);
            }
        }
    }

    /// Sends an order to a drive, or returns why not. An order that its line does not accept still counts as an
    /// attempt; renewing a lease does not.
    fn order(
        &self,
        now: MonoTime,
        ticket: Ticket,
        drive: UnitDrive<'_>,
        order: Order,
        manner: OrderManner,
    ) -> Result<(), InboxFull> {
        let place = drive.shared.description.place;
        let command = self.command_for(now, ticket, place, order.clone(), manner);
        drive
            .inbox
            .put(LineMessage::Command(command))
            .inspect_err(|InboxFull| self.found_no_room(place, order))
    }

    /// Sends a stop to each drive of this listener that has control. Each line finds its stops together.
    fn stop_all(
        &self,
        now: MonoTime,
        machine: &mut ModbusConnection,
    ) -> Vec<(Ticket, Result<(), InboxFull>)> {
        let router = self.router();
        let order = Order::Stop { setpoint: None };
        let places = router
            .controlled()
            .map(|drive| drive.shared.description.place);
        let commands: Vec<_> = places
            .map(|place| {
                (
                    place,
                    self.command_for(
                        now,
                        machine.fresh_ticket(),
                        place,
                        order.clone(),
                        OrderManner::Once,
                    ),
                )
            })
            .collect();
        let given: Vec<_> = commands
            .iter()
            .map(|(place, command)| (*place, command.ticket))
            .collect();
        let taken = router.shared().put_together(commands);
        let result = |((place, ticket), is_taken)| {
            let result = if is_taken { Ok(()) } else { Err(InboxFull) };
            (
                ticket,
                result.inspect_err(|InboxFull| self.found_no_room(place, order.clone())),
            )
        };
        given.into_iter().zip(taken).map(result).collect()
    }

    fn command_for(
        &self,
        now: MonoTime,
        ticket: Ticket,
        place: DriveRef,
        order: Order,
        manner: OrderManner,
    ) -> CommandRequest {
        self.known_until.set(MonoTime::NEVER);
        CommandRequest {
            asker: self.asker,
            ticket,
            drive: place.drive,
            origin: Origin {
                manner,
                ..self.origin.get()
            },
            order,
            start_before: now + COMMAND_DEADLINE,
            issued: None,
            epoch: None,
            trial: None,
        }
    }

    /// An order that a line does not accept still counts as an attempt.
    fn found_no_room(&self, place: DriveRef, order: Order) {
        if !order.is_no_attempt() {
            let owner = self.origin.get().owner;
            let report = Report::refused(Reason::QueueFull);
            self.keeper
                .keep(Some(place), owner, TriedWrite::Order(order), report);
        }
    }

    /// Waits for the answers to the orders for `call`. If there are none (no drive has control), the call is refused;
    /// if none was accepted, it is answered at once.
    fn expect(
        &self,
        now: MonoTime,
        machine: &mut ModbusConnection,
        call: &UnitCall,
        given: Vec<(Ticket, Result<(), InboxFull>)>,
    ) {
        if given.is_empty() {
            return machine.refuse(now, call, tried_of(call), Report::refused(Reason::ReadOnly));
        }
        let has_full = given.iter().any(|(_, result)| result.is_err());
        let worst = has_full.then_some(exception::SERVER_DEVICE_BUSY);
        let out: Vec<Ticket> = given
            .into_iter()
            .filter_map(|(ticket, result)| result.ok().map(|()| ticket))
            .collect();
        if let (true, Some(code)) = (out.is_empty(), worst) {
            return machine.answer(now, call.ticket, ModbusAnswer::Exception(code));
        }
        let read = read_behind(call);
        self.commands
            .borrow_mut()
            .expect(now, call.ticket, call.deadline, out, worst, read);
    }

    /// Processes news from a line.
    pub(super) fn hear(&self, now: MonoTime, news: &LineNews) {
        match news {
            LineNews::Native(answer) => {
                self.machine.borrow_mut().answer(
                    now,
                    answer.ticket,
                    native::answer_of(&answer.outcome),
                );
            }
            LineNews::Command(answer) => self.hear_command(now, answer),
            LineNews::Trip(..) | LineNews::Events { .. } => {}
        }
    }

    fn hear_command(&self, now: MonoTime, answer: &CommandAnswer) {
        let Some(EndedCall {
            call,
            exception,
            read,
        }) = self.commands.borrow_mut().take(answer)
        else {
            return;
        };
        let mut machine = self.machine.borrow_mut();
        let Some(read) = read else {
            return machine.answer(
                now,
                call,
                exception.map_or(ModbusAnswer::Written, ModbusAnswer::Exception),
            );
        };
        let router = self.router();
        let Some(UnitTarget::Uniform(drive)) = router.find(read.unit) else {
            return machine.answer(
                now,
                call,
                ModbusAnswer::Exception(exception::SERVER_DEVICE_FAILURE),
            );
        };
        let mut words = WordBuffer::default();
        let view = drive.shared.view.load();
        let present = self.present(now);
        let taken = drive
            .unit
            .read(read.address, read.count, &view, &present, &mut words);
        // A read orders nothing.
        let _ = taken.at_once(&words, |answer| machine.answer(now, call, answer));
    }

    /// Renews the lease that this client holds. The answer is not waited for.
    fn renew(&self, now: MonoTime, machine: &mut ModbusConnection, drive: UnitDrive<'_>) {
        let view = drive.shared.view.load();
        let lease = view.control.as_ref().and_then(|control| control.lease);
        if lease.is_none_or(|(owner, _)| owner != self.origin.get().owner) {
            return;
        }
        let mut renewed = self.renewed.borrow_mut();
        if renewed
            .get(&drive.place)
            .is_some_and(|at| now.since(*at) < RENEW_EVERY)
        {
            return;
        }
        if self
            .order(
                now,
                machine.fresh_ticket(),
                drive,
                Order::Renew,
                OrderManner::Cyclic,
            )
            .is_ok()
        {
            renewed.insert(drive.place, now);
        }
    }

    fn present(&self, now: MonoTime) -> RequestContext {
        RequestContext {
            now,
            uptime_s: self.router().uptime_s(now),
            owner: self.origin.get().owner,
            standby: None,
        }
    }
}

/// What a call tries to write, as text; `None` if it does not write.
fn tried_of(call: &UnitCall) -> Option<TriedWrite> {
    call.ask.writes().then(|| call.ask.tried(call.unit))
}

/// What is read once the order in `call` is answered.
const fn read_behind(call: &UnitCall) -> Option<ReadBehind> {
    match call.ask {
        ModbusRequest::ReadWriteWords {
            read_address,
            read_count,
            ..
        } => Some(ReadBehind {
            unit: call.unit,
            address: read_address,
            count: read_count,
        }),
        _ => None,
    }
}
