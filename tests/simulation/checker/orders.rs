//! Orders to drives and their results: O4 and O8. A book for each drive says what may be written.

use super::Checker;
use super::book::{Order, Stop, Wish};
use super::clients::Ask;
use super::tables::{Facts, Run};
use super::wire::{Exchange, Truth};

/// A command without a deadline of its own is sent within this time or never.
pub const DEADLINE: u64 = 1_000_000_000;
/// Orders that are remembered for a drive.
const ORDERS: usize = 48;
/// After this time no frame of an order can follow.
const FORGOTTEN: u64 = 60_000_000_000;
/// How long after a stop its frame may be one more of the same.
const REPEATED_FOR: u64 = 30_000_000_000;

/// The order in a write to a drive's own registers.
pub fn of_native(facts: &Facts, pdu: &[u8]) -> Option<Wish> {
    let word = |at: usize| {
        pdu.get(at..at + 2)
            .map(|it| u16::from_be_bytes([it[0], it[1]]))
    };
    let (address, values) = match (pdu[0], pdu.len()) {
        (6, 5) => (word(1)?, [word(3), None]),
        (16, 8) => (word(1)?, [word(6), None]),
        (16, 10) => (word(1)?, [word(6), word(8)]),
        _ => return None,
    };
    let mut wish = Wish::default();
    for (address, value) in (address..=u16::MAX).zip(values.into_iter().flatten()) {
        match address {
            it if it == facts.run => wish.run = Some(facts.run_of(value)?),
            it if it == facts.setpoint => wish.setpoint = Some(value),
            it if it == facts.listed => wish.register = Some((it, value)),
            _ => return None,
        }
    }
    Some(wish)
}

/// The order in a write to a uniform unit.
pub fn of_uniform(pdu: &[u8]) -> Option<Wish> {
    let word = |at: usize| {
        pdu.get(at..at + 2)
            .map(|it| u16::from_be_bytes([it[0], it[1]]))
    };
    let run = |value| {
        let table = [
            Run::Stop,
            Run::Forward,
            Run::Reverse,
            Run::Coast,
            Run::Reset,
        ];
        table.get(usize::from(value)).copied()
    };
    let mut wish = Wish::default();
    match (pdu[0], word(1)?) {
        (5, coil @ 0..=3) => {
            wish.run = match (coil, word(3)? != 0) {
                (0, true) => Some(Run::Forward),
                (1, true) => Some(Run::Reverse),
                (0 | 1, false) | (3, true) => Some(Run::Stop),
                (2, true) => Some(Run::Reset),
                // Reset taken back orders nothing.
                _ => return Some(wish),
            }
        }
        (6, 256) => wish.run = Some(run(word(3)?)?),
        (6, 257) => wish.setpoint = word(3),
        (6, 258) => {}
        (16, 256) => {
            wish.run = Some(run(word(6)?)?);
            wish.setpoint = word(8);
        }
        (16, 257) => wish.setpoint = word(6),
        _ => return None,
    }
    Some(wish)
}

impl Checker {
    /// A client sends an order to `drive`.
    pub(super) fn order(
        &mut self,
        at: u64,
        who: usize,
        drive: usize,
        wish: impl Fn(&Facts) -> Option<Wish>,
    ) -> Ask {
        let it = &self.line.drives[drive];
        match wish(it.kind.facts()).filter(|_| it.has_control) {
            Some(wish) => Ask::Order {
                drive,
                order: self.take_order(at, drive, wish, at + DEADLINE, Some(who / 2)),
            },
            None => Ask::Never,
        }
    }

    /// Notes an order. That of a client, two of which share an address, may turn out to change nothing.
    pub(super) fn take_order(
        &mut self,
        at: u64,
        drive: usize,
        wish: Wish,
        before: u64,
        by: Option<usize>,
    ) -> u64 {
        let cyclic = by.is_some();
        self.order_count += 1;
        let number = self.order_count;
        if matches!(wish.run, Some(Run::Stop | Run::Coast)) {
            self.stop_asked(at, drive, number);
        }
        let book = &mut self.books[drive];
        book.sign_at = at;
        if let Some(kind @ (Run::Stop | Run::Coast)) = wish.run {
            if self.line.drives[drive].kind.facts().word_of(kind).is_none() {
                return number;
            }
            book.asked[usize::from(kind == Run::Coast)] = true;
            book.stop_comes(at, number, by, kind == Run::Coast);
            // Beside a stop that changes nothing, a setpoint counts.
            let is_only_setpoint =
                cyclic && kind == Run::Stop && wish.setpoint.is_some() && book.may_be_stopped(at);
            if !is_only_setpoint {
                book.fresh.push((number, at, kind == Run::Coast));
                if !cyclic {
                    self.settle_stops(drive);
                }
                return number;
            }
            book.may_stop.get_or_insert((number, at));
            book.void_given_up(at);
        }
        if book.orders.len() >= ORDERS {
            book.orders
                .retain(|it| !it.is_over && at < it.at + FORGOTTEN);
            if book.orders.len() >= ORDERS {
                book.orders.remove(0);
            }
        }
        // Which of two equal orders a frame belongs to is not always known: a client that may hold the lease counts as
        // its holder.
        book.is_of_mqtt |= !cyclic && wish != Wish::default();
        // A stop is complete for the gateway once it has read that the motor is at standstill.
        let is_void =
            book.stop.is_pending && wish.register.is_none() && !self.motors[drive].stands();
        let order = Order {
            number,
            wish,
            at,
            before,
            sent: 0,
            taken: 0,
            has_run: false,
            has_setpoint: false,
            has_register: false,
            reset_step: 0,
            is_void,
            is_over: false,
            is_message: !cyclic,
            issued_old: None,
        };
        book.orders.push(order);
        number
    }

    /// A client orders all drives to stop. For a stopped drive only a frame shows whether that changed something.
    pub(super) fn stop_all(&mut self, at: u64, who: usize) -> u64 {
        self.order_count += 1;
        for (book, _) in self
            .books
            .iter_mut()
            .zip(&self.line.drives)
            .filter(|(_, drive)| drive.has_control)
        {
            book.sign_at = at;
            book.asked[0] = true;
            book.stop_comes(at, self.order_count, Some(who / 2), false);
            if book.may_be_stopped(at) {
                book.void_given_up(at);
                book.may_stop.get_or_insert((self.order_count, at));
            } else {
                book.fresh.push((self.order_count, at, false));
            }
        }
        let number = self.order_count;
        for drive in 0..self.books.len() {
            if self.line.drives[drive].has_control {
                self.stop_asked(at, drive, number);
            }
        }
        number
    }

    /// The stop of all drives is answered.
    pub(super) fn all_stopped(&mut self, at: u64, number: u64) {
        self.books
            .iter_mut()
            .for_each(|book| book.fresh.retain(|(it, ..)| *it != number));
        self.all_stops_answered(at, number);
    }

    /// Stops that were not answered from memory at once are new ones.
    pub(super) fn settle_stops(&mut self, drive: usize) {
        let stands = self.motors[drive].stands();
        let book = &mut self.books[drive];
        for (number, at, is_coast) in book.fresh.drain(..) {
            if !book.stop.is_pending && number < u64::MAX && book.repeat != Some(number) {
                book.stopped_at = Some(at);
            }
            // Another one of the same kind may go on at its rate; that of a drive that was started since goes at once.
            if number < u64::MAX && book.is_running {
                book.stop_due = Some(at + self.bound);
            }
            // Another one of the same kind is the same, and what the drive has answered to it counts.
            book.is_of_mqtt = false;
            let is_young = book
                .stop
                .was_accepted_at
                .is_some_and(|before| at < before + REPEATED_FOR);
            let has_moved = book.moved_at > book.stop.was_accepted_at;
            let is_same = is_young && !has_moved && book.stop.is_coast == is_coast;
            book.stop = Stop {
                echoed: book.stop.echoed && is_same,
                zeros: if is_same { book.stop.zeros } else { 0 },
                is_pending: true,
                was_accepted_at: Some(at),
                is_coast,
                last_output: book.stop.last_output,
            };
            // Orders that move nothing continue. At standstill a stop may be done at once, and later orders count.
            let goes_on = |it: &Order| it.wish.register.is_some() || (stands && it.number > number);
            book.orders
                .iter_mut()
                .for_each(|it| it.is_void |= !goes_on(it));
        }
    }

    /// No frame may follow from this order, which was issued too long ago, or before a stop.
    pub(super) fn outdate_order(&mut self, drive: usize, number: u64, issued: u64) {
        let order = self.books[drive]
            .orders
            .iter_mut()
            .find(|it| it.number == number);
        order
            .into_iter()
            .for_each(|it| (it.is_void, it.issued_old) = (true, Some(issued)));
    }

    /// No frame may follow from this order.
    pub(super) fn void_order(&mut self, drive: usize, number: u64) {
        let orders = &mut self.books[drive].orders;
        orders
            .iter_mut()
            .filter(|it| it.number == number)
            .for_each(|it| it.is_void = true);
    }

    /// The client left before the result. Only a frame shows whether a stop changed something; no frame of another
    /// order may follow if none was sent.
    pub(super) fn nobody_is_told(&mut self, drive: usize, number: u64) {
        let book = &mut self.books[drive];
        if let Some(place) = book.fresh.iter().position(|(it, ..)| *it == number) {
            let (_, at, _) = book.fresh.remove(place);
            book.may_stop.get_or_insert((number, at));
        }
        book.orders
            .iter_mut()
            .filter(|it| it.number == number && it.sent == 0)
            .for_each(|it| it.is_over = true);
    }

    /// A request that may have ordered something is answered with an exception.
    pub(super) fn order_excepted(&mut self, at: u64, drive: usize, number: u64, code: u8) {
        self.stop_refused(drive, number);
        let it = self.line.drives[drive];
        let lost_after = it.lost_after;
        // The drive's own answer is passed on.
        let newest = self
            .wire
            .newest()
            .filter(|newest| newest.station == it.station);
        let is_of_drive = newest.is_some_and(|newest| newest.truth == Truth::Exception(code));
        let book = &mut self.books[drive];
        book.fresh
            .retain(|(it, ..)| *it != number || matches!(code, 4 | 0x0B));
        let Some(order) = book.orders.iter_mut().find(|it| it.number == number) else {
            return;
        };
        let is_refused = matches!(code, 1 | 2 | 3 | 6);
        order.is_over |= is_refused || code == 4 || is_of_drive;
        // What a stop or the end of a lease has cut is told so, also when a frame of it is out.
        let is_lost = at >= order.at + lost_after;
        // A motor that others have started is stopped after all, where a stop was answered from memory.
        // It may not have come far, or may have been started just before the order.
        let motor = &self.motors[drive];
        let is_started_by_others =
            (motor.ran_since(order.at) || !motor.rests()) && book.run_taken == Some(Run::Stop);
        if is_refused
            && !is_of_drive
            && order.sent > 0
            && !order.is_void
            && book.last_stop_at < order.at
            && !book.is_ending
            && !is_lost
            && !is_started_by_others
        {
            let text = format!(
                "refused with {code:02X} after {} frames: {order:?}",
                order.sent
            );
            self.object("O8", || text);
        }
    }

    /// A request that ordered something is answered as done.
    pub(super) fn order_succeeded(&mut self, at: u64, drive: usize, number: u64) {
        self.stop_answered(at, drive, number);
        let book = &mut self.books[drive];
        if let Some(place) = book.fresh.iter().position(|(it, ..)| *it == number) {
            // It changed nothing, or joined a stop that was answered.
            book.fresh.remove(place);
            return;
        }
        book.reset_answered(number);
        let Some(order) = book.orders.iter_mut().find(|it| it.number == number) else {
            return self.stop_succeeded(drive);
        };
        order.is_over = true;
        let order = *order;
        let wish = order.wish;
        let is_motion = matches!(wish.run, Some(Run::Forward | Run::Reverse));
        let is_stop = matches!(wish.run, Some(Run::Stop | Run::Coast));
        let is_in_force = (!is_motion || order.has_run || wish.run == book.run_taken)
            && wish
                .setpoint
                .is_none_or(|it| order.has_setpoint || Some(it) == book.setpoint_taken || is_stop);
        let ends_reset = wish.run == Some(Run::Reset);
        // Where a write stayed without an answer, only what the drive shows afterwards counts.
        let shown = self
            .wire
            .newest()
            .filter(|it| it.station == self.line.drives[drive].station && it.function == 3);
        let shown = shown
            .filter(|it| it.heard_at.is_some())
            .map(|it| it.words[0]);
        let is_shown = match (wish.register, wish.setpoint) {
            (Some((_, word)), _) => shown == Some(word),
            (None, Some(word)) if !is_motion => shown == Some(word),
            _ => shown.is_some(),
        };
        let is_taken = order.taken == order.sent || (ends_reset && order.taken > 0) || is_shown;
        if !(is_in_force && is_taken) {
            let text = format!(
                "told as done, but the drive did not take it: {order:?}, {:?} {:?}",
                book.run_taken, book.setpoint_taken
            );
            self.object("O4", || text);
        } else if is_shown && wish.setpoint.is_some() && !is_motion {
            // The write itself may have been lost, where others have set the same.
            self.books[drive].setpoint_taken = wish.setpoint;
        }
    }

    fn stop_succeeded(&mut self, drive: usize) {
        let book = &self.books[drive];
        let is_taken = matches!(book.run_taken, Some(Run::Stop | Run::Coast)) || book.stop.echoed;
        if !is_taken && book.stop.is_pending {
            let text = format!(
                "a stop is told as done that drive {drive} did not take: {:?}",
                book.stop
            );
            self.object("O4", || text);
        }
    }

    /// A reply was received.
    pub(super) fn answered(&mut self, at: u64, exchange: &Exchange) {
        let Some(drive) = self
            .line
            .drives
            .iter()
            .position(|it| it.station == exchange.station)
        else {
            return;
        };
        let facts = self.line.drives[drive].kind.facts();
        self.counts.replies += 1;
        if matches!((exchange.function, exchange.truth), (3, Truth::Words(_))) {
            self.shows_trips(at, drive, exchange);
        }
        if matches!(exchange.function, 6 | 16) && exchange.address == facts.run {
            self.run_write_answered(drive);
        }
        let bound = self.bound;
        let book = &mut self.books[drive];
        match (exchange.function, exchange.truth) {
            (3, Truth::Words(_)) => {
                let word = |register: u16| {
                    let offset = register
                        .checked_sub(exchange.address)
                        .filter(|it| *it < exchange.count)?;
                    Some(exchange.words[usize::from(offset)])
                };
                if let Some(output) = word(facts.output) {
                    book.is_seen(at, output > 0, bound);
                    book.shows_output(at, output);
                }
                if let Some((register, is_running)) = facts.status
                    && let Some(status) = word(register)
                {
                    book.shows_status(is_running(status));
                }
            }
            (6 | 16, Truth::Holds(value))
                if exchange.address == facts.run && value == exchange.values[0] =>
            {
                let is_stop = matches!(facts.run_of(value), Some(Run::Stop | Run::Coast));
                book.echoes += u32::from(is_stop);
                book.stop.echoed |= is_stop;
                if is_stop && !book.stop.is_pending {
                    // One that was perhaps none is the last one now: another one of its kind is the same.
                    book.stop.was_accepted_at = Some(at);
                }
                if is_stop {
                    self.stop_taken(drive);
                }
            }
            // A stop that a resting drive refuses is settled.
            (6 | 16, Truth::Exception(_))
                if exchange.address == facts.run && self.motors[drive].rests() =>
            {
                self.books[drive].stop.is_pending = false;
            }
            _ => {}
        }
    }
}
