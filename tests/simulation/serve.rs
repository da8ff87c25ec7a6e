//! The daemon's part between clients and the line: calls are answered from views, or passed to the line and answered
//! when that has answered.

use super::client::Client;
use super::world::World;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{CommandAnswer, CommandRequest, Order};
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Ticket};
use vfd_gateway::domain::native::{NativeAnswer, NativeRequest};
use vfd_gateway::domain::report::LineReport;
use vfd_gateway::domain::standby::LineRole;
use vfd_gateway::drive::description::DriveDescription;
use vfd_gateway::drive::view::DriveView;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::north::modbus::{
    EndedCall, ModbusAnswer, ModbusRequest, RequestAction, RequestContext, RequestedOrder,
    UniformUnit, UnitCall, WordBuffer, native, own,
};

/// A command is sent within this time or never.
const COMMAND_DEADLINE: Duration = Duration::from_secs(1);

/// The contents of unit 255.
struct Shown<'a> {
    report: LineReport,
    uniform: &'a [UniformUnit],
    views: &'a [Arc<DriveView>],
}

impl own::ServedGateway for Shown<'_> {
    fn lines(&self) -> usize {
        1
    }

    fn line(&self, place: usize) -> Option<LineReport> {
        (place == 0).then(|| self.report.clone())
    }

    fn drives(&self) -> usize {
        self.uniform.len()
    }

    fn drive(&self, place: usize) -> Option<(&UniformUnit, Arc<DriveView>)> {
        Some((self.uniform.get(place)?, Arc::clone(self.views.get(place)?)))
    }

    fn standby(&self, _: usize) -> Option<LineRole> {
        self.report.standby.map(|standby| standby.role)
    }
}

/// Whether a client's request to `unit` is a stop.
fn is_stop(
    drives: &[DriveDescription],
    uniform: &[UniformUnit],
    views: &[Arc<DriveView>],
    unit: u8,
    ask: &ModbusRequest,
) -> bool {
    let place = drives.iter().position(|it| it.unit.get() == unit);
    let picture = drives.iter().position(|it| it.uniform_unit.get() == unit);
    match (place, picture) {
        (Some(place), _) => native::is_stop(&drives[place].model, ask),
        (_, Some(place)) => uniform[place].is_stop(ask, &views[place]),
        _ => own::is_stop(unit, ask),
    }
}

impl World {
    /// A client sends `bytes`, whose requests are passed on.
    pub fn client_sends(&mut self, who: usize, bytes: &[u8]) {
        if self.clients[who]
            .stalled_until
            .is_some_and(|until| until > self.now)
        {
            return self.clients[who].waiting.extend_from_slice(bytes);
        }
        self.tally.client_events += 1;
        self.checker.client_sent(self.now.as_nanos(), who, bytes);
        self.look_at_views();
        let drives = &self.descriptions;
        let uniform = &self.uniform;
        let views = &self.views;
        let is_stop = |unit: u8, ask: &ModbusRequest| is_stop(drives, uniform, views, unit, ask);
        self.clients[who].machine.receive(self.now, bytes, &is_stop);
        while let Some(call) = self.clients[who].machine.next_call() {
            self.serve(who, call);
        }
        self.flush(who);
    }

    fn serve(&mut self, who: usize, call: UnitCall) {
        let is_stop = || {
            is_stop(
                &self.descriptions,
                &self.uniform,
                &self.views,
                call.unit,
                &call.ask,
            )
        };
        if self.has_waited && call.ask.writes() && !is_stop() {
            return self.clients[who].machine.answer(
                self.now,
                call.ticket,
                ModbusAnswer::Exception(6),
            );
        }
        let native_place = self
            .descriptions
            .iter()
            .position(|it| it.unit.get() == call.unit);
        if let Some(place) = native_place {
            return self.ask_drive(who, place, call);
        }
        self.look_at_views();
        let place = self
            .descriptions
            .iter()
            .position(|it| it.uniform_unit.get() == call.unit);
        let mut words = WordBuffer::default();
        let present = self.present(who);
        let taken = match place {
            Some(place) => {
                self.uniform[place].take(&call.ask, &self.views[place], &present, &mut words)
            }
            None if call.unit == own::UNIT || call.unit == own::BROADCAST => {
                let shown = Shown {
                    report: self.core.report(),
                    uniform: &self.uniform,
                    views: &self.views,
                };
                own::take(call.unit, &call.ask, &shown, &present, &mut words)
            }
            None => RequestAction::Exception(0x0A),
        };
        self.settle(who, &call, taken, &words, place);
    }

    fn ask_drive(&mut self, who: usize, place: usize, call: UnitCall) {
        let client = &mut self.clients[who];
        let UnitCall {
            ticket,
            ask,
            deadline,
            ..
        } = call;
        match native::ask_of(&self.descriptions[place].model, ask) {
            Ok(ask) => {
                let drive = DriveIndex(place as u16);
                let request = NativeRequest {
                    asker: client.asker,
                    ticket,
                    drive,
                    origin: client.origin,
                    ask,
                    deadline,
                };
                self.core.handle(self.now, LineInput::Native(request));
            }
            Err(code) => client
                .machine
                .answer(self.now, ticket, ModbusAnswer::Exception(code)),
        }
    }

    fn settle(
        &mut self,
        who: usize,
        call: &UnitCall,
        taken: RequestAction,
        words: &WordBuffer,
        place: Option<usize>,
    ) {
        let machine = &mut self.clients[who].machine;
        let now = self.now;
        match (
            taken.at_once(words, |answer| machine.answer(now, call.ticket, answer)),
            place,
        ) {
            (Ok(()), _) => {}
            (Err(RequestedOrder::One(order)), Some(place)) => {
                self.expect(who, call, vec![call.ticket]);
                self.give(who, call.ticket, place, order);
            }
            (Err(_), _) => {
                let controlled: Vec<usize> = (0..self.uniform.len())
                    .filter(|place| self.uniform[*place].has_control())
                    .collect();
                if controlled.is_empty() {
                    return machine.answer(now, call.ticket, ModbusAnswer::Exception(1));
                }
                let tickets: Vec<Ticket> =
                    controlled.iter().map(|_| machine.fresh_ticket()).collect();
                self.expect(who, call, tickets.clone());
                for (place, ticket) in controlled.into_iter().zip(tickets) {
                    self.give(who, ticket, place, Order::Stop { setpoint: None });
                }
            }
        }
    }

    fn give(&mut self, who: usize, ticket: Ticket, place: usize, order: Order) {
        let Client { asker, origin, .. } = self.clients[who];
        let command = CommandRequest {
            asker,
            ticket,
            drive: DriveIndex(place as u16),
            origin,
            order,
            start_before: self.now + COMMAND_DEADLINE,
            issued: None,
            epoch: None,
            trial: None,
        };
        self.core.handle(self.now, LineInput::Command(command));
    }

    fn expect(&mut self, who: usize, call: &UnitCall, tickets: Vec<Ticket>) {
        self.clients[who].commands.expect(
            self.now,
            call.ticket,
            call.deadline,
            tickets,
            None,
            None,
        );
    }

    fn present(&self, who: usize) -> RequestContext {
        RequestContext {
            now: self.now,
            uptime_s: 0,
            owner: self.clients[who].origin.owner,
            standby: None,
        }
    }

    /// The line answers a native request.
    pub fn hear_native(&mut self, answer: &NativeAnswer) {
        let Some(who) = self.client_of(answer.asker) else {
            return;
        };
        self.clients[who].machine.answer(
            self.now,
            answer.ticket,
            native::answer_of(&answer.outcome),
        );
        self.flush(who);
    }

    /// The line reports on a command.
    pub fn hear_command(&mut self, answer: &CommandAnswer) {
        let Some(who) = self.client_of(answer.asker) else {
            return;
        };
        let Some(EndedCall {
            call, exception, ..
        }) = self.clients[who].commands.take(answer)
        else {
            return;
        };
        let answer = exception.map_or(ModbusAnswer::Written, ModbusAnswer::Exception);
        self.clients[who].machine.answer(self.now, call, answer);
        self.flush(who);
    }

    fn client_of(&self, asker: AskerId) -> Option<usize> {
        self.clients.iter().position(|client| client.asker == asker)
    }

    /// Passes the output of connections to their clients; a closed connection is replaced by a new one.
    pub fn flush(&mut self, who: usize) {
        let machine = &mut self.clients[who].machine;
        let bytes = machine.output().len();
        if bytes > 0 {
            self.checker
                .client_got(self.now.as_nanos(), who, machine.output());
            machine.wrote(bytes);
        }
        if machine.close_reason().is_some() {
            self.reconnect(who, true);
        }
        self.north_wake = self
            .clients
            .iter()
            .filter_map(|client| client.machine.next_wake())
            .min();
    }

    /// A client's connection ends and another takes its place.
    pub fn reconnect(&mut self, who: usize, by_gateway: bool) {
        let now = self.now.as_nanos();
        self.checker.client_closed(now, who, by_gateway);
        self.core
            .handle(self.now, LineInput::AskerGone(self.clients[who].asker));
        self.askers += 1;
        let stalled_until = self.clients[who].stalled_until;
        self.clients[who] = Client::new(who, self.askers, self.now);
        self.clients[who].stalled_until = stalled_until;
        self.checker.client_opened(now, who);
    }

    /// Connections do what is due.
    pub fn tick_clients(&mut self) {
        for who in 0..self.clients.len() {
            self.clients[who].machine.tick(self.now);
            self.flush(who);
        }
    }
}
