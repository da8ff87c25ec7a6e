//! Commands of one broker on their way to the lines: stops first, every queue bounded, and each command answered or
//! given up. Attempts that never reach a line are recorded here; a line records those that reach it.

use crate::domain::address::Address;
use crate::domain::command::{
    CommandRequest, Order, OrderManner, Origin, Outcome, Owner, Reason, Report, Rights,
};
use crate::domain::ids::{AskerId, Ticket};
use crate::domain::native::{NativeAsk, NativeRequest};
use crate::domain::time::MonoTime;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::journal::{AttemptId, TriedWrite, WriteAttempt};
use crate::north::command_words::short;
use crate::profile::scale::setpoint_step;
use std::collections::VecDeque;
use std::time::Duration;

/// Most unanswered commands over all drives, not counting stops.
const COMMANDS_MAX: usize = 64;
/// Most unanswered stops of one drive: a stop for an offline drive stays pending for minutes, and its repeats must not
/// take the room of others.
const STOPS_MAX: usize = 4;
/// Most unanswered reads over all drives.
const READS_MAX: usize = 64;
/// Most attempts waiting to be fetched.
pub(in crate::north) const ATTEMPTS_MAX: usize = 256;
/// How long after its deadline a command may stay without its final answer.
const ANSWERED_WITHIN: Duration = Duration::from_secs(60);

/// Something for the lines.
#[derive(Clone, Debug, PartialEq)]
pub enum ToLine {
    /// Give a command to a drive.
    Command(DriveRef, CommandRequest),
    /// Ask a drive for registers.
    Read(DriveRef, NativeRequest),
    /// Tell every line that the path from the clients is open.
    PathAlive,
    /// Tell every line that the path was opened again after a loss.
    PathOpened,
}

/// What was requested of a drive.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::north) enum DriveRequest {
    /// A command.
    Order(Order),
    /// The register at this place in the drive's model.
    Read(usize),
}

/// A command or read that is not yet answered. `C` is what its session needs to answer it.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::north) struct PendingRequest<C> {
    pub(in crate::north) ticket: Ticket,
    /// Place of the drive in the session's list.
    pub(in crate::north) drive: usize,
    pub(in crate::north) by: Owner,
    pub(in crate::north) request: DriveRequest,
    pub(in crate::north) context: C,
    place: DriveRef,
    /// When it is given up: long after the line must have answered.
    forget_at: MonoTime,
}

/// A command to be given to a drive.
pub(in crate::north) struct NewCommand<C> {
    pub(in crate::north) ticket: Ticket,
    /// Place of the drive in the session's list.
    pub(in crate::north) drive: usize,
    pub(in crate::north) by: Owner,
    pub(in crate::north) order: Order,
    /// Its first frame is sent before this moment or never.
    pub(in crate::north) start_before: MonoTime,
    /// When it was issued, if known.
    pub(in crate::north) issued: Option<MonoTime>,
    pub(in crate::north) epoch: Option<u64>,
    pub(in crate::north) context: C,
}

/// A register to be read from a drive.
pub(in crate::north) struct NewRead<C> {
    pub(in crate::north) ticket: Ticket,
    /// Place of the drive in the session's list.
    pub(in crate::north) drive: usize,
    pub(in crate::north) by: Owner,
    /// Its place in the drive's model.
    pub(in crate::north) register: usize,
    pub(in crate::north) address: Address,
    pub(in crate::north) deadline: MonoTime,
    pub(in crate::north) context: C,
}

/// The commands of one broker.
#[derive(Debug)]
pub(in crate::north) struct BrokerCommands<C> {
    asker: AskerId,
    /// Messages for the lines, in order: path opened first, then stops. Bounded by the limits on unanswered requests.
    to_lines: VecDeque<ToLine>,
    /// Unanswered requests, oldest first.
    unanswered: Vec<PendingRequest<C>>,
    /// Attempts that reach no line and have not been fetched, oldest first.
    attempts: VecDeque<(Option<DriveRef>, WriteAttempt)>,
    last_attempt: u64,
    attempts_lost: u64,
    last_ticket: u64,
}

impl<C> BrokerCommands<C> {
    /// Commands that the lines answer to `asker`.
    pub(in crate::north) const fn new(asker: AskerId) -> Self {
        Self {
            asker,
            to_lines: VecDeque::new(),
            unanswered: Vec::new(),
            attempts: VecDeque::new(),
            last_attempt: 0,
            attempts_lost: 0,
            last_ticket: 0,
        }
    }

    /// Ticket numbers continue from this one.
    pub(in crate::north) const fn count_tickets_from(&mut self, first: Ticket) {
        self.last_ticket = first.0;
    }

    /// A ticket that is not in use.
    pub(in crate::north) const fn next_ticket(&mut self) -> Ticket {
        self.last_ticket += 1;
        Ticket(self.last_ticket)
    }

    /// The next thing for the lines.
    pub(in crate::north) fn next_to_line(&mut self) -> Option<ToLine> {
        self.to_lines.pop_front()
    }

    /// The next attempt for the journal.
    pub(in crate::north) fn next_attempt(&mut self) -> Option<(Option<DriveRef>, WriteAttempt)> {
        self.attempts.pop_front()
    }

    /// Attempts that were dropped because too many waited.
    pub(in crate::north) const fn attempts_lost(&self) -> u64 {
        self.attempts_lost
    }

    /// Tells the lines that the path was opened, before any command that arrived on this connection and is still
    /// queued.
    pub(in crate::north) fn path_opened(&mut self) {
        self.to_lines.push_front(ToLine::PathOpened);
    }

    /// Tells the lines that the path is open.
    pub(in crate::north) fn path_alive(&mut self) {
        if !self.to_lines.contains(&ToLine::PathAlive) {
            self.to_lines.push_back(ToLine::PathAlive);
        }
    }

    /// The connection is lost: queued path messages no longer hold.
    pub(in crate::north) fn path_lost(&mut self) {
        self.to_lines
            .retain(|it| !matches!(it, ToLine::PathAlive | ToLine::PathOpened));
    }

    /// Stops have room of their own.
    pub(in crate::north) fn has_room_for_command(&self) -> bool {
        let is_command = |it: &&PendingRequest<C>| matches!(&it.request, DriveRequest::Order(order) if !order.is_stop());
        self.unanswered.iter().filter(is_command).count() < COMMANDS_MAX
    }

    /// Whether there is room for one more read.
    pub(in crate::north) fn has_room_for_read(&self) -> bool {
        self.unanswered
            .iter()
            .filter(|it| matches!(it.request, DriveRequest::Read(_)))
            .count()
            < READS_MAX
    }

    /// Gives a command to `description`, its drive. Before a stop, [`give_way_to_stop`](Self::give_way_to_stop) is called
    /// until it returns `None`.
    pub(in crate::north) fn give(&mut self, description: &DriveDescription, new: NewCommand<C>) {
        let NewCommand {
            ticket,
            drive,
            by,
            order,
            start_before,
            issued,
            epoch,
            context,
        } = new;
        let place = description.place;
        let is_stop = order.is_stop();
        let stop_pending_for = match &description.control {
            Some(control) if is_stop => control.stop_pending_for,
            _ => Duration::ZERO,
        };
        let forget_at = start_before + stop_pending_for + ANSWERED_WITHIN;
        let command = CommandRequest {
            asker: self.asker,
            ticket,
            drive: place.drive,
            origin: origin(by),
            order: order.clone(),
            start_before,
            issued,
            epoch,
            trial: None,
        };
        let request = DriveRequest::Order(order);
        self.unanswered.push(PendingRequest {
            ticket,
            drive,
            by,
            request,
            context,
            place,
            forget_at,
        });
        self.queue(ToLine::Command(place, command), is_stop);
    }

    /// Asks `description`, its drive, for a register.
    pub(in crate::north) fn read(&mut self, description: &DriveDescription, new: NewRead<C>) {
        let NewRead {
            ticket,
            drive,
            by,
            register,
            address,
            deadline,
            context,
        } = new;
        let place = description.place;
        let words = description
            .model
            .registers
            .get(register)
            .map_or(1, |register| register.form.words());
        let ask = NativeAsk::Read {
            address,
            count: words,
        };
        let read = NativeRequest {
            asker: self.asker,
            ticket,
            drive: place.drive,
            origin: origin(by),
            ask,
            deadline,
        };
        let forget_at = deadline + ANSWERED_WITHIN;
        let request = DriveRequest::Read(register);
        self.unanswered.push(PendingRequest {
            ticket,
            drive,
            by,
            request,
            context,
            place,
            forget_at,
        });
        self.queue(ToLine::Read(place, read), false);
    }

    /// Appends a request to the queue for the lines; a stop is appended to the queued stops.
    fn queue(&mut self, request: ToLine, is_stop: bool) {
        let goes_first = |it: &&ToLine| match it {
            ToLine::Command(_, command) => command.order.is_stop(),
            ToLine::PathOpened => true,
            ToLine::Read(..) | ToLine::PathAlive => false,
        };
        let stops = self.to_lines.iter().take_while(goes_first).count();
        let place = if is_stop { stops } else { self.to_lines.len() };
        self.to_lines.insert(place, request);
    }

    /// Withdraws, one by one, what gives way to a stop of `drive`: commands of that drive that are still queued here,
    /// and the oldest stop if there are too many.
    pub(in crate::north) fn give_way_to_stop(
        &mut self,
        drive: usize,
    ) -> Option<(PendingRequest<C>, Report)> {
        let waits = |pending: &&PendingRequest<C>| {
            let moves = matches!(&pending.request, DriveRequest::Order(it) if !it.is_stop() && *it != Order::Renew);
            moves && pending.drive == drive && self.is_waiting(pending.ticket)
        };
        let waiting = self
            .unanswered
            .iter()
            .find(waits)
            .map(|it| (it.ticket, Reason::Stopped));
        let (ticket, reason) =
            waiting.or_else(|| Some((self.surplus_stop(drive)?, Reason::Newer)))?;
        self.give_up(ticket, Report::new(Outcome::Superseded, reason))
    }

    /// The oldest stop of `drive`, if there is no room for one more.
    fn surplus_stop(&self, drive: usize) -> Option<Ticket> {
        let is_its_stop = |it: &&PendingRequest<C>| {
            it.drive == drive
                && matches!(&it.request, DriveRequest::Order(order) if order.is_stop())
        };
        let mut stops = self.unanswered.iter().filter(is_its_stop);
        let oldest = stops.next()?.ticket;
        (stops.count() + 1 >= STOPS_MAX).then_some(oldest)
    }

    /// Takes one that should have been answered long ago.
    pub(in crate::north) fn take_overdue(
        &mut self,
        at: MonoTime,
    ) -> Option<(PendingRequest<C>, Report)> {
        let overdue = self.unanswered.iter().find(|it| it.forget_at <= at)?;
        let report = Report::new(unanswered_outcome(&overdue.request), Reason::NoReply);
        self.give_up(overdue.ticket, report)
    }

    /// Takes one whose drive has no place any more in `moved`, which holds the new place of each drive.
    pub(in crate::north) fn take_gone(
        &mut self,
        moved: &[Option<usize>],
    ) -> Option<(PendingRequest<C>, Report)> {
        let gone = self
            .unanswered
            .iter()
            .find(|it| moved.get(it.drive).copied().flatten().is_none())?;
        let report = Report::new(unanswered_outcome(&gone.request), Reason::Removed);
        self.give_up(gone.ticket, report)
    }

    /// Moves the drives to these places.
    pub(in crate::north) fn move_drives(&mut self, moved: &[Option<usize>]) {
        for pending in &mut self.unanswered {
            pending.drive = moved
                .get(pending.drive)
                .copied()
                .flatten()
                .unwrap_or(pending.drive);
        }
    }

    /// When the next one is given up.
    pub(in crate::north) fn wake(&self) -> Option<MonoTime> {
        self.unanswered.iter().map(|it| it.forget_at).min()
    }

    /// The request with this ticket.
    pub(in crate::north) fn get(&self, ticket: Ticket) -> Option<&PendingRequest<C>> {
        self.unanswered.iter().find(|it| it.ticket == ticket)
    }

    /// Takes the request with this ticket because it was answered.
    pub(in crate::north) fn take(&mut self, ticket: Ticket) -> Option<PendingRequest<C>> {
        let place = self.unanswered.iter().position(|it| it.ticket == ticket)?;
        Some(self.unanswered.remove(place))
    }

    /// Takes the request that a line could not accept because its inbox was full.
    pub(in crate::north) fn refused_by_line(
        &mut self,
        ticket: Ticket,
    ) -> Option<(PendingRequest<C>, Report)> {
        let pending = self.take(ticket)?;
        let report = Report::refused(Reason::QueueFull);
        self.account_for(&pending, report);
        Some((pending, report))
    }

    /// Takes a request that ends with this outcome. If it is still queued here, no line records it.
    fn give_up(&mut self, ticket: Ticket, report: Report) -> Option<(PendingRequest<C>, Report)> {
        let pending = self.take(ticket)?;
        if self.is_waiting(ticket) {
            self.to_lines.retain(|it| ticket_of(it) != Some(ticket));
            self.account_for(&pending, report);
        }
        Some((pending, report))
    }

    fn is_waiting(&self, ticket: Ticket) -> bool {
        self.to_lines.iter().any(|it| ticket_of(it) == Some(ticket))
    }

    fn account_for(&mut self, pending: &PendingRequest<C>, report: Report) {
        if let DriveRequest::Order(order) = &pending.request {
            self.add_attempt(Some(pending.place), pending.by, tried_by(order), report);
        }
    }

    /// Records an attempt that no line sees; `None` for `tried` if nothing was attempted. `None` for the drive: it is for
    /// all, or for one that does not exist.
    pub(in crate::north) fn keep_attempt(
        &mut self,
        drive: Option<&DriveDescription>,
        owner: Owner,
        tried: Option<TriedWrite>,
        report: Report,
    ) {
        self.add_attempt(drive.map(|drive| drive.place), owner, tried, report);
    }

    fn add_attempt(
        &mut self,
        place: Option<DriveRef>,
        owner: Owner,
        tried: Option<TriedWrite>,
        report: Report,
    ) {
        let Some(tried) = tried else { return };
        if self.attempts.len() >= ATTEMPTS_MAX {
            self.attempts_lost += 1;
            return;
        }
        self.last_attempt += 1;
        let attempt = WriteAttempt {
            id: AttemptId(self.last_attempt),
            owner,
            tried,
            report: Some(report),
        };
        self.attempts.push_back((place, attempt));
    }
}

/// A client that commands through a broker may write and stop; each message is a command of its own.
const fn origin(owner: Owner) -> Origin {
    Origin {
        owner,
        rights: Rights {
            write: true,
            stop: true,
        },
        manner: OrderManner::Once,
    }
}

/// What `order` attempts. Renewing a lease is no attempt.
pub(in crate::north) fn tried_by(order: &Order) -> Option<TriedWrite> {
    (*order != Order::Renew).then(|| TriedWrite::Order(order.clone()))
}

/// What was attempted at `place` by something that is no order: on one line, and short.
pub(in crate::north) fn tried_text(place: &str, says: &str) -> TriedWrite {
    let visible = |c: char| if c.is_control() { ' ' } else { c };
    let text = format!("{place}: {}", short(says));
    TriedWrite::Text(text.chars().map(visible).collect())
}

/// A frequency outside the limits is refused, and the refusal names the limits; of one between two steps it names the step.
pub(in crate::north) fn refused_frequency(
    description: &DriveDescription,
    request: &DriveRequest,
    report: Report,
) -> Option<String> {
    let control = description.control.as_ref()?;
    let DriveRequest::Order(Order::Go(go)) = request else {
        return None;
    };
    let frequency = go.frequency()?;
    match report.reason {
        Reason::OutsideLimits => Some(format!(
            "{frequency} Hz is outside the limits of {} to {} Hz",
            control.least, control.most
        )),
        Reason::BetweenSteps => {
            let step = setpoint_step(&description.model)?;
            Some(format!(
                "{frequency} Hz is between the drive's steps of {step} Hz"
            ))
        }
        _ => None,
    }
}

/// The report on a request that no line has answered.
const fn unanswered_outcome(request: &DriveRequest) -> Outcome {
    match request {
        DriveRequest::Order(_) => Outcome::Unknown,
        DriveRequest::Read(_) => Outcome::Failed,
    }
}

const fn ticket_of(it: &ToLine) -> Option<Ticket> {
    match it {
        ToLine::Command(_, command) => Some(command.ticket),
        ToLine::Read(_, request) => Some(request.ticket),
        ToLine::PathAlive | ToLine::PathOpened => None,
    }
}
